//! The C interface through which the core crate uses this library, loaded with libloading.
//!
//! Status codes are those of [`m4gn::Error::status`]; the message of the last failure of the calling thread is
//! kept for `m4gn_torch_last_error`. Panics end here.
#![allow(unsafe_code)]

use crate::pool::panic_message;
use crate::request::Request;
use m4gn::{Error, Result};
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicU8;

/// Version of this interface; the core crate refuses another one.
pub const ABI_VERSION: u32 = 1;

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::new(CString::default());
}

/// The door of every exported function: errors and panics become a status and a message.
pub(crate) fn guard(body: impl FnOnce() -> Result<()>) -> i32 {
    let result = catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|p| Err(Error::Internal(panic_message(&*p))));
    let Err(error) = result else { return 0 };
    let text = match &error {
        // The other side adds the words that go with the status.
        Error::Internal(message) => message.clone(),
        other => other.to_string(),
    };
    let message = CString::new(text.replace('\0', " ")).unwrap_or_default();
    LAST_ERROR.with(|last| *last.borrow_mut() = message);
    error.status()
}

/// Version of this interface.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_torch_abi_version() -> u32 {
    ABI_VERSION
}

/// Message of the last failure of this thread; valid until its next call.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_torch_last_error() -> *const c_char {
    LAST_ERROR.with(|last| last.borrow().as_ptr())
}

/// Trains as a JSON request says (see [`Request`]). `stop` is read now and then: nonzero, save and stop.
///
/// # Safety
/// `request_json` is a NUL-terminated string; `stop` points to a byte that lives, and is only changed
/// atomically, until the call returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_train(request_json: *const c_char, stop: *const u8) -> i32 {
    guard(|| {
        if request_json.is_null() || stop.is_null() {
            return Err(Error::Input("m4gn_torch_train: a null pointer".into()));
        }
        // SAFETY: not null, and NUL-terminated by this function's contract.
        let text = unsafe { CStr::from_ptr(request_json) };
        let text = text.to_str().map_err(|e| Error::Input(format!("the training request is not UTF-8: {e}")))?;
        let request: Request =
            serde_json::from_str(text).map_err(|e| Error::Input(format!("the training request: {e}")))?;
        // SAFETY: not null, lives and is atomic by this function's contract; a u8 is aligned anywhere.
        let stop = unsafe { AtomicU8::from_ptr(stop.cast_mut()) };
        crate::trainer::train(&request, stop).map(|_| ())
    })
}
