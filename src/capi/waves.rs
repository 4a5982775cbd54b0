//! Exports: what the waves of a fit look like.

use super::pointers;
use super::ride::RideHandle;
use m4gn_base::Error;

exports! {
    /// What does not oscillate in a fit in use, and what a wave adds.
    fn m4gn_ride_wave(
        ride: *const RideHandle,
        surrogate: i32,
        wave: i32,
        part: i32,
        array: i32,
        values: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference("ride", ride)? };
        let [surrogate, wave, part, array] = [surrogate, wave, part, array].map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        let found = handle.ride.wave(surrogate, wave, part, array);
        let found = found.ok_or_else(|| Error::Input(format!("no part {part} of wave {wave} in array {array}: the fit has no such wave, or none is in use")))?;
        // SAFETY: the host's array, as the header says.
        unsafe { pointers::slice_mut("values", values, found.len())? }.copy_from_slice(&found);
        Ok(0)
    }
}
