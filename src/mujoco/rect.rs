//! A part of a window.

use super::ffi;

/// A rectangle of pixels, counted from the window's lower left corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// Of its left edge \[px\].
    pub left: u32,
    /// Of its lower edge \[px\].
    pub bottom: u32,
    /// \[px\]
    pub width: u32,
    /// \[px\]
    pub height: u32,
}

impl Rect {
    pub(super) fn raw(self) -> ffi::mjrRect {
        let pixels = |n: u32| i32::try_from(n).unwrap_or(i32::MAX);
        let (left, bottom) = (pixels(self.left), pixels(self.bottom));
        ffi::mjrRect { left, bottom, width: pixels(self.width), height: pixels(self.height) }
    }
}
