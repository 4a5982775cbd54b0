//! The C ABI, `cpp/include/m4gn.h`: the only exported symbols of `libm4gn.so`.
//!
//! Every export goes through one guard ([`guard`]): floating-point traps are off inside, panics stop, and an
//! error becomes a status with its message kept for `m4gn_last_error`. What a pointer must be is said in the header;
//! here it is checked as far as it can be ([`pointers`]), and the ranks agree before anything collective begins.
#![allow(unsafe_code)]

#[macro_use]
mod guard;
mod fit;
mod host;
mod model;
mod modes;
mod options;
mod pointers;
mod recorder;
mod reports;
mod ride;
mod segments;
mod session;
mod solids;
mod state;
mod user_surrogate;

pub use fit::*;
pub use host::HostData;
pub use model::*;
pub use modes::*;
pub use options::tables;
pub use pointers::{MeshData, SolidData};
pub use recorder::*;
pub use reports::*;
pub use ride::*;
pub use segments::*;
pub use session::*;
pub use solids::*;
pub use state::{AheadFunction, ArrayData};
pub use user_surrogate::SurrogateData;

use std::ffi::c_char;

/// `M4GN_ABI_VERSION`
pub const ABI_VERSION: i32 = 19;

/// Version of this interface.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_abi_version() -> i32 {
    ABI_VERSION
}

/// Version of the library.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// Message of the last failed call on this thread, or an empty string.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_last_error() -> *const c_char {
    m4gn_base::plugin::last_error()
}

/// Exports that free a handle.
macro_rules! frees {
    ($($name:ident($handle:ty);)*) => {
        exports! {$(
            /// Frees it; null is none.
            fn $name(handle: *mut $handle) -> (), or |_| (); {
                if !handle.is_null() {
                    // SAFETY: made by an export and freed once.
                    drop(unsafe { Box::from_raw(handle) });
                }
                Ok(())
            }
        )*}
    };
}

frees! {
    m4gn_model_free(ModelHandle);
    m4gn_session_free(SessionHandle);
    m4gn_ride_free(RideHandle);
    m4gn_segments_free(SegmentsHandle);
    m4gn_modes_free(ModesHandle);
    m4gn_recorder_free(RecorderHandle);
}

exports! {
    /// Ends MPI and PETSc if they were started here.
    fn m4gn_finalize() -> (), or |_| (); {
        m4gn_parallel::finalize();
        Ok(())
    }
}

#[cfg(test)]
extern crate self as m4gn;
#[cfg(test)]
mod tests;
