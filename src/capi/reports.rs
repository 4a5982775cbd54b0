//! Exports: what a ride reports: its texts, and fields of errors and waves.

use super::pointers;
use super::ride::RideHandle;
use m4gn_base::Error;
use m4gn_ride::Text;
use std::ffi::{CString, c_char};

exports! {
    /// Takes what there is to be said.
    fn m4gn_ride_text(ride: *mut RideHandle, kind: i32) -> *const c_char, or |_| std::ptr::null(); {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        let text = match kind {
            0 => handle.ride.take(Text::Log),
            1 => handle.ride.take(Text::Warning),
            2 => handle.ride.take(Text::Jumps),
            3 => handle.ride.take(Text::Strides),
            4 => handle.ride.take(Text::Errors),
            5 => handle.ride.take(Text::SegmentErrors),
            6 => handle.ride.end(),
            7 => (0..handle.ride.layout().arrays().len())
                .find_map(|array| handle.ride.difference(0, array))
                .map_or_else(String::new, |(_, time)| time.into()),
            8 => handle.ride.take(Text::Modes),
            _ => return Err(Error::Input(format!("kind of text {kind}: expected 0 to 8"))),
        };
        let bytes: Vec<u8> = text.bytes().filter(|b| *b != 0).collect();
        handle.text = CString::new(bytes).unwrap_or_default();
        Ok(handle.text.as_ptr())
    }

    /// Rollout minus solver of an observed surrogate.
    fn m4gn_ride_difference(
        ride: *const RideHandle,
        surrogate: i32,
        array: i32,
        values: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference("ride", ride)? };
        let which = usize::try_from(surrogate).ok().zip(usize::try_from(array).ok());
        let found = which.and_then(|(surrogate, array)| handle.ride.difference(surrogate, array));
        let (found, _) = found.ok_or_else(|| Error::Input(format!("no difference of array {array}: nothing was compared yet")))?;
        // SAFETY: the host's array, as the header says.
        unsafe { pointers::slice_mut("values", values, found.len())? }.copy_from_slice(found);
        Ok(0)
    }

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
