//! C++ exceptions of the model compiler, caught.
//!
//! One that arrives at Rust's `catch_unwind` ends the process: the language cannot catch what it did not throw. So [`catch`]
//! calls through a frame of its own, whose exception handler (its *personality*, as every C++ function has one) takes C++
//! exceptions and leaves Rust's alone. It goes back to the frame by itself, without help of the unwinder, because MuJoCo's
//! wheels bring an unwinder of their own, whose state ours cannot read.
//!
//! What the compiler had allocated until then is lost. Elsewhere than on x86-64 Linux such an exception still ends the process.

use std::ffi::c_void;

/// What is called: nothing in it may need to be dropped when an exception passes.
pub(super) type Body = unsafe extern "C-unwind" fn(*mut c_void);

/// Calls `body(data)`; a C++ exception in it becomes its description.
///
/// # Safety
/// As for calling `body` with `data`; what an exception skips has no destructors of Rust's.
pub(super) unsafe fn catch(body: Body, data: *mut c_void) -> Result<(), String> {
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    {
        // SAFETY: as the caller promises.
        unsafe { frame::catch(body, data) }
    }
    #[cfg(not(all(target_arch = "x86_64", target_os = "linux")))]
    {
        // SAFETY: as the caller promises.
        unsafe { body(data) };
        Ok(())
    }
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod frame {
    use super::Body;
    use std::cell::Cell;
    use std::ffi::{CStr, c_char, c_int, c_void};
    use std::ptr::null_mut;

    /// The header that the Itanium C++ ABI puts before a thrown object.
    #[repr(C)]
    struct Exception {
        class: u64,
        cleanup: Option<unsafe extern "C" fn(c_int, *mut Exception)>,
    }

    thread_local! {
        /// The base pointer of the innermost frame that catches, and what it caught.
        static FRAME: Cell<*mut c_void> = const { Cell::new(null_mut()) };
        static CAUGHT: Cell<*mut Exception> = const { Cell::new(null_mut()) };
    }

    // mujoco_grasp_catch(body, data, frame): saves all registers that belong to its caller, notes its base pointer in
    // *frame, and calls body(data). From mujoco_grasp_caught on it returns, with the base pointer restored, however it came
    // there. 0x1b: the personality's address is relative, of 32 bits.
    std::arch::global_asm!(
        ".pushsection .text.mujoco_grasp_catch, \"ax\", @progbits",
        ".globl mujoco_grasp_catch",
        ".hidden mujoco_grasp_catch",
        ".type mujoco_grasp_catch, @function",
        "mujoco_grasp_catch:",
        ".cfi_startproc",
        ".cfi_personality 0x1b, {personality}",
        "push rbp",
        ".cfi_def_cfa_offset 16",
        ".cfi_offset rbp, -16",
        "mov rbp, rsp",
        ".cfi_def_cfa_register rbp",
        "push rbx",
        ".cfi_offset rbx, -24",
        "push r12",
        ".cfi_offset r12, -32",
        "push r13",
        ".cfi_offset r13, -40",
        "push r14",
        ".cfi_offset r14, -48",
        "push r15",
        ".cfi_offset r15, -56",
        "sub rsp, 8",
        "mov [rdx], rbp",
        "mov rax, rdi",
        "mov rdi, rsi",
        "call rax",
        ".globl mujoco_grasp_caught",
        ".hidden mujoco_grasp_caught",
        "mujoco_grasp_caught:",
        "lea rsp, [rbp - 40]",
        "pop r15",
        "pop r14",
        "pop r13",
        "pop r12",
        "pop rbx",
        "pop rbp",
        ".cfi_def_cfa rsp, 8",
        "ret",
        ".cfi_endproc",
        ".size mujoco_grasp_catch, . - mujoco_grasp_catch",
        ".popsection",
        personality = sym personality,
    );

    unsafe extern "C-unwind" {
        fn mujoco_grasp_catch(body: Body, data: *mut c_void, frame: *mut *mut c_void);
        fn mujoco_grasp_caught();
    }

    /// Puts the outer frame back, also when a fault unwinds.
    struct Outer(*mut c_void);

    impl Drop for Outer {
        fn drop(&mut self) {
            FRAME.set(self.0);
        }
    }

    /// # Safety
    /// See [`super::catch`].
    pub unsafe fn catch(body: Body, data: *mut c_void) -> Result<(), String> {
        let _outer = Outer(FRAME.get());
        CAUGHT.set(null_mut());
        // SAFETY: the cell lives as long as the thread; the rest as the caller promises.
        unsafe { mujoco_grasp_catch(body, data, FRAME.with(Cell::as_ptr)) };
        let exception = CAUGHT.replace(null_mut());
        if exception.is_null() {
            return Ok(());
        }
        // SAFETY: a C++ exception that is ours alone now; its type's name is read before it is freed.
        unsafe {
            let name = type_name(exception);
            if let Some(cleanup) = (*exception).cleanup {
                cleanup(CAUGHT_AS_FOREIGN, exception);
            }
            Err(describe(&name))
        }
    }

    const CAUGHT_AS_FOREIGN: c_int = 1;
    const SEARCH_PHASE: c_int = 1;
    const HANDLER_FRAME: c_int = 4;
    const FORCED: c_int = 8;
    const HANDLER_FOUND: c_int = 6;
    const CONTINUE_UNWIND: c_int = 8;

    /// Asked by the unwinder, first whether the frame catches this exception, and, once all frames below it have cleaned
    /// up, to enter the handler.
    unsafe extern "C" fn personality(
        _version: c_int,
        actions: c_int,
        class: u64,
        exception: *mut Exception,
        _context: *mut c_void,
    ) -> c_int {
        let is_cpp = [b"GNUCC++\0", b"CLNGC++\0"].iter().any(|known| class & !0xff == u64::from_be_bytes(**known));
        if !is_cpp || actions & FORCED != 0 {
            return CONTINUE_UNWIND;
        }
        if actions & SEARCH_PHASE != 0 {
            return HANDLER_FOUND;
        }
        if actions & HANDLER_FRAME == 0 {
            return CONTINUE_UNWIND;
        }
        CAUGHT.set(exception);
        // SAFETY: this frame is still there, as its callees have only cleaned up; from there its registers are restored
        // relative to its base pointer. What is skipped, here and in the unwinder, owns nothing.
        unsafe {
            std::arch::asm!(
                "mov rbp, {frame}",
                "jmp {caught}",
                frame = in(reg) FRAME.get(),
                caught = sym mujoco_grasp_caught,
                options(noreturn),
            )
        }
    }

    /// The mangled name of the thrown type. GNU's and LLVM's runtime keep the same eighty bytes before the header.
    ///
    /// # Safety
    /// `exception` is the header of a C++ exception.
    unsafe fn type_name(exception: *const Exception) -> String {
        // SAFETY: as the caller promises; a std::type_info begins with its table of functions and its name.
        unsafe {
            let info = *exception.byte_sub(80).cast::<*const [*const c_char; 2]>();
            let name = if info.is_null() { std::ptr::null() } else { (*info)[1] };
            if name.is_null() { String::new() } else { CStr::from_ptr(name).to_string_lossy().into_owned() }
        }
    }

    fn describe(mangled: &str) -> String {
        match mangled {
            "St9bad_alloc" | "St20bad_array_new_length" => {
                "it needs more memory than there is (std::bad_alloc in MuJoCo's compiler)".into()
            }
            "St12length_error" => "it has a size that no list can have (std::length_error in MuJoCo's compiler)".into(),
            other => format!("MuJoCo's compiler threw a C++ exception of the type {other:?}"),
        }
    }
}

#[cfg(all(test, target_arch = "x86_64", target_os = "linux"))]
mod tests {
    use super::*;
    use crate::mujoco::error::Error;
    use crate::mujoco::{compat, guard};

    #[test]
    fn what_returns_and_what_rust_throws_pass_through() {
        unsafe extern "C-unwind" fn double(data: *mut c_void) {
            // SAFETY: the test's own number.
            unsafe { *data.cast::<u32>() *= 2 };
        }
        unsafe extern "C-unwind" fn fault(_: *mut c_void) {
            compat::raise_fault(c"a wheel fell off");
        }
        let mut number = 21_u32;
        // SAFETY: the function takes a number.
        assert_eq!(unsafe { catch(double, (&raw mut number).cast()) }, Ok(()));
        assert_eq!(number, 42);
        // SAFETY: the function takes nothing.
        let result = guard::call("mju_error", || unsafe { catch(fault, std::ptr::null_mut()) });
        assert!(matches!(result, Err(Error::Engine { message, .. }) if message == "a wheel fell off"));
    }
}
