//! A window in which a scenario runs, is looked at from all sides, and is pushed at with the mouse.
//!
//! ```text
//! window -> pointer -> session <- recording
//! (winit)   (mouse)    (steps)    (a file)
//!    `----> overlay: what is drawn on top of MuJoCo's own scene
//! ```
//!
//! What the window does to the simulation is a [`Session`]'s list of [`Action`]s and nothing else: replayed without a window
//! it gives the same simulation bit for bit. Pauses, slow motion and the camera are not among them.

mod digest;
mod keys;
mod overlay;
mod pace;
mod pointer;
mod recording;
mod session;
mod window;

pub use digest::Digest;
pub use keys::KEYS;
pub use pointer::{Button, Gaze, Modifiers, Pointer, Seen};
pub use recording::Recording;
pub use session::{Action, Event, Session};
pub use window::{Summary, show};
