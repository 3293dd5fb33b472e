//! The macro that turns the engine's arrays into slices of their true length.

/// A slice over an engine array.
///
/// # Safety
/// If `len > 0`, `ptr` points to `len` initialised values that live and are not written for `'a`.
#[inline]
pub(super) unsafe fn slice<'a, T>(ptr: *const T, len: usize) -> &'a [T] {
    // SAFETY: as the caller promises.
    if len == 0 { &[] } else { unsafe { std::slice::from_raw_parts(ptr, len) } }
}

/// A mutable slice over an engine array.
///
/// # Safety
/// If `len > 0`, `ptr` points to `len` initialised values that live for `'a` and that nothing else touches in `'a`.
#[inline]
pub(super) unsafe fn slice_mut<'a, T>(ptr: *mut T, len: usize) -> &'a mut [T] {
    // SAFETY: as the caller promises.
    if len == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(ptr, len) } }
}

/// Memory of the engine's type `Self` that may be read as `T`.
pub(super) trait ReadAs<T> {}

impl ReadAs<f64> for f64 {}
impl ReadAs<f32> for f32 {}
impl ReadAs<i32> for i32 {}
impl ReadAs<u8> for u8 {}
// The engine's switches are bytes in 2.2.2, and booleans of one byte in 3.x.
impl ReadAs<u8> for bool {}

/// The engine's array under the crate's type.
#[inline]
pub(super) fn read_as<S: ReadAs<T>, T>(ptr: *const S) -> *const T {
    ptr.cast()
}

/// One factor of a length: a number, or the name of a size field of the model (or, for rows, of the data).
macro_rules! factor {
    ($sizes:expr, $n:literal) => {
        $n
    };
    ($sizes:expr, $field:ident) => {
        $sizes.$field as usize
    };
}

/// `name: type [rows x columns], "doc";` lines become `fn name(&self) -> &[type]`.
///
/// `$source` is the method that gives the structure with the array, `$sizes` the one with the sizes. The dimensions
/// are those of the engine's own headers (mjxmacro.h).
macro_rules! read_arrays {
    ($source:ident, $sizes:ident; $($name:ident: $ty:ty [$first:tt $(x $more:tt)*], $doc:literal;)*) => { $(
        #[doc = concat!($doc, ". Shape: `", stringify!($first $(x $more)*), "`.")]
        #[inline]
        pub fn $name(&self) -> &[$ty] {
            let sizes = self.$sizes();
            let len = factor!(sizes, $first) $(* factor!(sizes, $more))*;
            // SAFETY: the engine allocates this array with exactly this shape and it lives as long as `self`;
            // whatever writes it takes `&mut self`.
            unsafe { slice($crate::mujoco::arrays::read_as::<_, $ty>(self.$source().$name), len) }
        }
    )* };
}

/// As `read_arrays`, for writing: `name => name_mut`. Only arrays of plain numbers that the engine never uses as
/// an address or a count may be listed. `$note` is a method that is called first.
macro_rules! write_arrays {
    ($source:ident, $sizes:ident, $note:ident; $($name:ident => $fn:ident: $ty:ty [$first:tt $(x $more:tt)*], $doc:literal;)*) => { $(
        #[doc = concat!($doc, ". Shape: `", stringify!($first $(x $more)*), "`.")]
        #[inline]
        pub fn $fn(&mut self) -> &mut [$ty] {
            self.$note();
            let sizes = self.$sizes();
            let len = factor!(sizes, $first) $(* factor!(sizes, $more))*;
            // SAFETY: the engine allocates this array with exactly this shape, it lives as long as `self`, and `&mut
            // self` makes the access exclusive; any bit pattern is a valid number.
            unsafe { slice_mut(self.$source().$name, len) }
        }
    )* };
}

pub(super) use {factor, read_arrays, write_arrays};
