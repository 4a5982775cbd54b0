//! The C interface through which the core crate uses this library, loaded with libloading.
//!
//! Status codes are those of [`m4gn_base::Error::status`]; the message of the last failure of the calling thread is
//! kept for `m4gn_torch_last_error`. Panics end here.
#![allow(unsafe_code)]

use crate::backend::{TorchBackend, guarded};
use crate::device::parse_device;
use crate::inference::Inference;
use m4gn_base::plugin::{keep_error, last_error};
use m4gn_base::{Error, Result, refuse};
use m4gn_engine::backward::Optimiser;
use m4gn_engine::torch::LIBRARY;
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_train::{Request, Task, train};
use m4gn_workbench::bench::{Prepared, Trial};
use std::ffi::{CStr, c_char, c_void};
use std::sync::atomic::AtomicU8;

/// The door of every exported function: errors and panics become a status and a message.
pub(crate) fn guard(body: impl FnOnce() -> Result<()>) -> i32 {
    let Err(error) = guarded(body) else { return 0 };
    match &error {
        // The other side adds the words that go with the status.
        Error::Internal(message) => keep_error(message),
        other => keep_error(&other.to_string()),
    }
    error.status()
}

/// Refuses a null pointer to an exported function.
fn given(name: &str, null: bool) -> Result<()> {
    refuse(null, Error::Input, || format!("{name}: a null pointer"))
}

/// Lets the allocator keep the memory of freed tensors instead of giving it back to the system at every step, which
/// costs some 5 % of a training step in page faults.
pub(crate) fn keep_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt may be called at any time; it changes thresholds only.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 32 << 20);
        libc::mallopt(libc::M_TRIM_THRESHOLD, 512 << 20);
    }
}

/// Version of this interface.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_torch_abi_version() -> u32 {
    LIBRARY.version
}

/// Message of the last failure of this thread; valid until its next call.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_torch_last_error() -> *const c_char {
    last_error()
}

/// Trains as a JSON request says (see [`m4gn_train::Request`]). `stop` is read now and then: nonzero, save and stop.
///
/// # Safety
/// `request_json` is a NUL-terminated string; `stop` points to a byte that lives, and is only changed
/// atomically, until the call returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_train(request_json: *const c_char, stop: *const u8) -> i32 {
    guard(|| {
        given("m4gn_torch_train", request_json.is_null() || stop.is_null())?;
        // SAFETY: not null, and NUL-terminated by this function's contract.
        let text = unsafe { CStr::from_ptr(request_json) };
        let text =
            text.to_str().map_err(|e| Error::Input(format!("the training request is not UTF-8: {e}")))?;
        let request: Request =
            serde_json::from_str(text).map_err(|e| Error::Input(format!("the training request: {e}")))?;
        // SAFETY: not null, lives and is atomic by this function's contract; a u8 is aligned anywhere.
        let stop = unsafe { AtomicU8::from_ptr(stop.cast_mut()) };
        keep_memory();
        // Before anything is read or written.
        let device = parse_device(request.device.as_deref().unwrap_or("cpu"))?;
        train(&request, stop, &Comm::serial(), |task| Ok(Box::new(TorchBackend::new(task, device)?)))
            .map(|_| ())
    })
}

/// A step of training to be measured.
struct Measured {
    backend: TorchBackend,
    prepared: Prepared,
    optimiser: Optimiser,
}

/// Prepares a [`Trial`] in JSON; `device` as in [`m4gn_torch_load`].
///
/// # Safety
/// The strings are NUL-terminated; `handle` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_trial(
    trial: *const c_char,
    device: *const c_char,
    handle: *mut *mut c_void,
) -> i32 {
    guard(|| {
        given("m4gn_torch_trial", trial.is_null() || device.is_null() || handle.is_null())?;
        // SAFETY: not null, and NUL-terminated by this function's contract.
        let (text, device) = unsafe { (CStr::from_ptr(trial), CStr::from_ptr(device)) };
        let trial: Trial = serde_json::from_slice(text.to_bytes())
            .map_err(|e| Error::Input(format!("the trial to be measured: {e}")))?;
        let device = parse_device(&device.to_string_lossy())?;
        keep_memory();
        let prepared = trial.prepare()?;
        let task = Task {
            training: &prepared.training,
            spec: &prepared.spec,
            work: &prepared.work,
            threads: trial.threads,
        };
        let backend = TorchBackend::new(&task, device)?;
        let measured = Measured { backend, optimiser: prepared.optimiser(), prepared };
        // SAFETY: not null, and can be written by this function's contract.
        unsafe { *handle = Box::into_raw(Box::new(measured)).cast() };
        Ok(())
    })
}

/// One step of training.
///
/// # Safety
/// `handle` came from [`m4gn_torch_trial`]; `loss` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_trial_step(handle: *mut c_void, loss: *mut f64) -> i32 {
    guard(|| {
        given("m4gn_torch_trial_step", handle.is_null() || loss.is_null())?;
        // SAFETY: not null, and from m4gn_torch_trial by this function's contract.
        let m = unsafe { &mut *handle.cast::<Measured>() };
        let value = m.prepared.step(&mut m.backend, &mut m.optimiser)?;
        // SAFETY: not null, and can be written by this function's contract.
        unsafe { *loss = value };
        Ok(())
    })
}

/// Frees a trial; null does nothing.
///
/// # Safety
/// `handle` came from [`m4gn_torch_trial`] and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_trial_free(handle: *mut c_void) {
    if !handle.is_null() {
        // SAFETY: made by Box::into_raw in m4gn_torch_trial, given back once.
        drop(unsafe { Box::from_raw(handle.cast::<Measured>()) });
    }
}

/// Loads a model for a structure in JSON (see [`Structure`]). `device` null: the CPU.
///
/// # Safety
/// `model` has `size` bytes, `structure` and `device` are NUL-terminated; `handle` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_load(
    model: *const u8,
    size: u64,
    structure: *const c_char,
    device: *const c_char,
    handle: *mut *mut c_void,
) -> i32 {
    guard(|| {
        given("m4gn_torch_load", model.is_null() || structure.is_null() || handle.is_null())?;
        // SAFETY: not null, and of this length by this function's contract.
        let bytes = unsafe { std::slice::from_raw_parts(model, size as usize) };
        let model = Model::from_bytes(bytes, "the session's model")?;
        let device = if device.is_null() {
            "cpu".into()
        } else {
            // SAFETY: NUL-terminated by this function's contract.
            unsafe { CStr::from_ptr(device) }.to_string_lossy().into_owned()
        };
        // SAFETY: not null, and NUL-terminated by this function's contract.
        let text = unsafe { CStr::from_ptr(structure) };
        let structure: Structure = serde_json::from_slice(text.to_bytes())
            .map_err(|e| Error::Input(format!("the structure of the session: {e}")))?;
        let device = parse_device(&device)?;
        let loaded = Inference::new(&model, &structure, device)?;
        // SAFETY: not null, and writable by this function's contract.
        unsafe { *handle = Box::into_raw(Box::new(loaded)).cast() };
        Ok(())
    })
}

/// One forward step: physical inputs of all nodes to physical outputs of cells, changes not added.
///
/// # Safety
/// `handle` came from [`m4gn_torch_load`] and is not used elsewhere meanwhile; `inputs` and `outputs` have
/// n_owned x inputs and n_cells x outputs values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_step(handle: *mut c_void, inputs: *const f32, outputs: *mut f32) -> i32 {
    guard(|| {
        given("m4gn_torch_step", handle.is_null() || inputs.is_null() || outputs.is_null())?;
        // SAFETY: a live handle by this function's contract.
        let loaded = unsafe { &*handle.cast::<Inference>() };
        let (n_inputs, n_outputs) = loaded.lengths();
        // SAFETY: the arrays have these lengths by this function's contract.
        let (inputs, outputs) = unsafe {
            (std::slice::from_raw_parts(inputs, n_inputs), std::slice::from_raw_parts_mut(outputs, n_outputs))
        };
        loaded.step(inputs, outputs)
    })
}

/// Frees a loaded model; null does nothing.
///
/// # Safety
/// `handle` came from [`m4gn_torch_load`] and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_torch_free(handle: *mut c_void) {
    if !handle.is_null() {
        // SAFETY: made by Box::into_raw in m4gn_torch_load, given back once.
        drop(unsafe { Box::from_raw(handle.cast::<Inference>()) });
    }
}
