//! Ctrl-C and SIGTERM: a flag that long jobs look at.

use m4gn_base::{Error, Result};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

static STOP: AtomicU8 = AtomicU8::new(0);

/// The flag that Ctrl-C and SIGTERM make nonzero; the second one ends the program at once.
pub fn stop_flag() -> Result<&'static AtomicU8> {
    static INSTALLED: OnceLock<std::result::Result<(), String>> = OnceLock::new();
    INSTALLED
        .get_or_init(|| {
            ctrlc::set_handler(|| {
                if STOP.swap(1, Ordering::Relaxed) != 0 {
                    std::process::exit(130);
                }
                eprintln!("m4gn: stopping; once more to end at once");
            })
            .map_err(|e| e.to_string())
        })
        .clone()
        .map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    Ok(&STOP)
}
