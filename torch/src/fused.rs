//! Operations of the forward pass that are joined into one pass over memory on the CPU, with their gradients; in
//! C++ (`cpp/`) because tch cannot define differentiable operations.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};
use tch::{Kind, Tensor};

/// A C++ `at::Tensor`, as tch holds it.
type Raw = torch_sys::C_tensor;

unsafe extern "C" {
    fn m4gn_fused_edge_input(
        a: *const Raw,
        ends: *const Raw,
        senders: *const Raw,
        receivers: *const Raw,
        result: *mut *mut Raw,
    ) -> *mut c_char;
    fn m4gn_fused_norm(
        residual: *const Raw,
        x: *const Raw,
        scale: *const Raw,
        shift: *const Raw,
        receivers: *const Raw,
        nodes: i64,
        results: *mut *mut Raw,
    ) -> *mut c_char;
}

/// `relu(a + ends[senders, ..d] + ends[receivers, d..])`: `a` `[E x d]`, `ends` `[N x 2d]`, both fp32 or both
/// bfloat16. Panics as tch does where shapes do not match.
pub fn edge_input(a: &Tensor, ends: &Tensor, senders: &Tensor, receivers: &Tensor) -> Tensor {
    let mut result = std::ptr::null_mut();
    // SAFETY: live tensors; on success the result is a new tensor that is ours.
    unsafe {
        check(m4gn_fused_edge_input(
            a.as_ptr(),
            ends.as_ptr(),
            senders.as_ptr(),
            receivers.as_ptr(),
            &mut result,
        ));
        Tensor::from_ptr(result)
    }
}

/// What [`norm`] returns.
pub struct Normed {
    /// `residual + layer_norm(x)`, fp32.
    pub rows: Tensor,
    /// The same in the kind of `x`, for the next product.
    pub operand: Tensor,
    /// Sums of the rows of each receiver in the kind of `x`, where asked for.
    pub sums: Option<Tensor>,
}

/// `residual + layer_norm(x) * scale + shift` over rows, and their sums over `receivers` (`(indices, nodes)`).
/// Panics as tch does where shapes do not match.
pub fn norm(
    residual: Option<&Tensor>,
    x: &Tensor,
    scale: &Tensor,
    shift: &Tensor,
    receivers: Option<(&Tensor, i64)>,
) -> Normed {
    let pointer = |t: Option<&Tensor>| t.map_or(std::ptr::null(), |t| t.as_ptr());
    let (index, nodes) = receivers.unzip();
    let mut results = [std::ptr::null_mut(); 3];
    // SAFETY: live tensors or null where that is allowed; each result that is set is a new tensor that is ours.
    let mut results = unsafe {
        check(m4gn_fused_norm(
            pointer(residual),
            x.as_ptr(),
            scale.as_ptr(),
            shift.as_ptr(),
            pointer(index),
            nodes.unwrap_or(0),
            results.as_mut_ptr(),
        ));
        results.into_iter().filter(|r| !r.is_null()).map(|r| Tensor::from_ptr(r)).collect::<Vec<_>>()
    };
    let sums = index.and_then(|_| results.pop());
    let operand = if x.kind() == Kind::BFloat16 { results.pop() } else { None };
    let rows = results.swap_remove(0);
    Normed { operand: operand.unwrap_or_else(|| rows.shallow_clone()), rows, sums }
}

/// Panics with the message of a C++ exception, as tch does with libtorch's.
///
/// # Safety
/// `message` is null or a string from `strdup`.
unsafe fn check(message: *mut c_char) {
    if !message.is_null() {
        // SAFETY: a NUL-terminated string that is ours to free.
        let text = unsafe {
            let text = CStr::from_ptr(message).to_string_lossy().into_owned();
            libc::free(message.cast());
            text
        };
        panic!("{text}");
    }
}
