//! MuJoCo's virtual file system: files that the loader reads from memory.

use super::compat;
use super::error::Error;
use super::ffi;
use super::guard;
use std::alloc::{Layout, alloc_zeroed};
use std::ffi::CString;
use std::ptr::NonNull;

/// An owned `mjVFS`. It is 2 MB, so it lives on the heap and is never built on the stack.
pub(super) struct Vfs {
    ptr: NonNull<ffi::mjVFS>,
}

impl Vfs {
    pub(super) fn new() -> Self {
        let layout = Layout::new::<ffi::mjVFS>();
        // SAFETY: the layout is not empty; a structure of plain numbers and pointers.
        let ptr = unsafe { alloc_zeroed(layout) }.cast::<ffi::mjVFS>();
        match NonNull::new(ptr) {
            Some(ptr) => {
                // SAFETY: fresh and zeroed.
                unsafe { compat::vfs::init(ptr.as_ptr()) };
                Self { ptr }
            }
            None => std::alloc::handle_alloc_error(layout),
        }
    }

    pub(super) fn as_ptr(&self) -> *const ffi::mjVFS {
        self.ptr.as_ptr()
    }

    /// Adds a file. The engine keeps only the last part of the name, in lower case.
    pub(super) fn add(&mut self, name: &str, content: &[u8]) -> Result<(), Error> {
        let refuse = |message: &str| Error::Load { what: format!("file {name:?} in memory"), message: message.into() };
        let c_name = CString::new(name).map_err(|_| refuse("its name contains a NUL byte"))?;
        if content.is_empty() {
            return Err(refuse("it is empty"));
        }
        i32::try_from(content.len()).map_err(|_| refuse("it is larger than 2 GB"))?;
        // SAFETY: a valid file system and name, and a size that was looked at.
        let add = || unsafe { compat::vfs::add(self.ptr.as_ptr(), c_name.as_ptr(), content) };
        match guard::call("adding a file in memory", add)? {
            0 => Ok(()),
            1 => Err(refuse("there are too many files (the engine takes 1999)")),
            2 => Err(refuse("another file has this name (the engine ignores folders and case)")),
            _ => Err(refuse("the engine could not make it")),
        }
    }
}

impl Drop for Vfs {
    fn drop(&mut self) {
        // SAFETY: frees the file buffers that the engine allocated, once.
        let _ = guard::call("mj_deleteVFS", || unsafe { ffi::mj_deleteVFS(self.ptr.as_ptr()) });
        // SAFETY: allocated in `new` with this layout, freed once.
        unsafe { std::alloc::dealloc(self.ptr.as_ptr().cast(), Layout::new::<ffi::mjVFS>()) };
    }
}
