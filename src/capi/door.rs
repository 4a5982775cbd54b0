//! The guarded door that every export goes through.

use crate::ffi::fpe::without_traps;
use crate::{Error, Result};
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Runs the body of export `name`; an error or a panic is kept and becomes `failed(status)`.
pub fn enter<T>(name: &str, failed: impl FnOnce(i32) -> T, body: impl FnOnce() -> Result<T>) -> T {
    // Unwind safety: after a panic the handle is only good to be freed, and says so (status < 0).
    let result = without_traps(|| catch_unwind(AssertUnwindSafe(body)));
    let error = match result {
        Ok(Ok(value)) => return value,
        Ok(Err(error)) => error,
        Err(panic) => Error::Internal(format!("{name}: {}", text(&*panic))),
    };
    keep(&error.to_string());
    failed(error.status())
}

/// `m4gn_last_error`.
pub fn last_error() -> *const c_char {
    // A thread that is being torn down has no message any more.
    LAST_ERROR
        .try_with(|m| m.borrow().as_ptr())
        .unwrap_or(c"".as_ptr())
}

fn keep(message: &str) {
    let clean: Vec<u8> = message.bytes().filter(|b| *b != 0).collect();
    if let Ok(message) = CString::new(clean) {
        let _ = LAST_ERROR.try_with(|m| *m.borrow_mut() = message);
    }
}

fn text(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(s), _) => s,
        (_, Some(s)) => s,
        _ => "panic without a message",
    }
}

/// Defines exports whose bodies run behind the door. `or` says what is returned for a status after a failure.
macro_rules! exports {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $kind:ty),* $(,)?) -> $out:ty, or $failed:expr; $body:block)*) => {$(
        $(#[$doc])*
        ///
        /// # Safety
        /// Pointers must be what `m4gn.h` says, for the length of the call.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name($($arg: $kind),*) -> $out {
            $crate::capi::door::enter(stringify!($name), $failed, || $body)
        }
    )*};
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn message() -> String {
        // SAFETY: the string of this thread lives until the next call.
        unsafe { CStr::from_ptr(last_error()) }
            .to_string_lossy()
            .into_owned()
    }

    #[test]
    fn errors_and_panics_become_statuses() {
        std::thread::spawn(|| {
            assert_eq!(message(), "");
            assert_eq!(enter("a", |s| s, || Err(Error::Mesh("hole\0s".into()))), 4);
            assert_eq!(message(), "holes");
            assert_eq!(enter("a", |s| s, || Ok(0)), 0);
            assert_eq!(message(), "holes", "the last failure is kept");
            assert_eq!(enter("m4gn_x", |s| s, || panic!("no {}", 1)), -1);
            assert!(message().contains("m4gn_x: no 1"), "{}", message());
        })
        .join()
        .unwrap();
    }
}
