//! The guarded guard that every export goes through.

use m4gn_base::ffi::fpe::without_traps;
use m4gn_base::plugin::keep_error;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_parallel::panic_text;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a count is after a failure.
pub fn no_count(_: i32) -> i32 {
    -1
}

/// Runs the body of export `name`; an error or a panic is kept and becomes `failed(status)`.
pub fn enter<T>(name: &str, failed: impl FnOnce(i32) -> T, body: impl FnOnce() -> Result<T>) -> T {
    // Unwind safety: after a panic the handle is only good to be freed, and says so (status < 0).
    let result = without_traps(|| catch_unwind(AssertUnwindSafe(body)));
    let error = match result {
        Ok(Ok(value)) => return value,
        Ok(Err(error)) => error,
        Err(panic) => Error::Internal(format!("{name}: {}", panic_text(&*panic))),
    };
    keep_error(&error.to_string());
    failed(error.status())
}

/// The body of the collective export `name`: each rank reads what its host gave, all agree that they could and that
/// the options are the same on all (a line for each; what belongs to a rank alone is left out), and then work together.
/// It ends on all ranks with the same class of status.
pub fn together<I, T>(
    name: &str,
    comm: &Comm,
    read: impl FnOnce() -> Result<(I, String)>,
    work: impl FnOnce(I) -> Result<T>,
) -> Result<T> {
    comm.guarded(|| {
        let (input, options) = match read() {
            Ok((input, options)) => (Ok(input), options),
            Err(e) => (Err(e), String::new()),
        };
        work(comm.agree_with(input, &format!("call {name}\n{options}"))?)
    })
}

/// The body of an export that changes the handle of a `name`. The handle's `broken` is set while it runs: after a panic, or where
/// it cannot go on, the handle may only be freed.
pub fn changed<H>(
    name: &str,
    handle: &mut H,
    broken: fn(&mut H) -> &mut bool,
    work: impl FnOnce(&mut H) -> Result<()>,
) -> Result<i32> {
    let result = match std::mem::replace(broken(handle), true) {
        true => Err(Error::Internal(format!("the {name} broke in an earlier call and can only be freed"))),
        false => work(handle),
    };
    *broken(handle) = matches!(result, Err(Error::Internal(_)));
    result.map(|()| 0)
}

/// The body of the collective export `name` that puts a handle where the host wants it, and null there before. A rank whose place cannot be
/// used stays [with the others](together), as one that cannot read what its host gave.
pub fn create<I, T>(
    name: &str,
    comm: Result<Comm>,
    place: Result<&mut *mut T>,
    read: impl FnOnce(&Comm) -> Result<(I, String)>,
    make: impl FnOnce(&Comm, I) -> Result<T>,
) -> Result<i32> {
    let place = place.map(|place| {
        *place = std::ptr::null_mut();
        place
    });
    let comm = comm?;
    let read = || place.and_then(|place| read(&comm).map(|(input, same)| ((place, input), same)));
    together(name, &comm, read, |(place, input)| {
        *place = Box::into_raw(Box::new(make(&comm, input)?));
        Ok(0)
    })
}

/// The last part of a path: folders may differ between ranks (distributed roots), the file is the same.
pub fn file_name(path: &std::path::Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Defines exports whose bodies run behind the guard. `or` says what is returned for a status after a failure.
macro_rules! exports {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $kind:ty),* $(,)?) -> $out:ty, or $failed:expr; $body:block)*) => {$(
        $(#[$doc])*
        ///
        /// # Safety
        /// Pointers must be what `m4gn.h` says, for the length of the call.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name($($arg: $kind),*) -> $out {
            $crate::guard::enter(stringify!($name), $failed, || $body)
        }
    )*};
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_base::plugin::last_error;
    use std::ffi::CStr;

    fn message() -> String {
        // SAFETY: the string of this thread lives until the next call.
        unsafe { CStr::from_ptr(last_error()) }.to_string_lossy().into_owned()
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
