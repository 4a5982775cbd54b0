//! The floating-point environment of the host: saved, cleared and restored around our work.

use std::mem::MaybeUninit;

/// x86-64's and AArch64's `fenv_t` are 32 and 8 bytes; twice the larger leaves room for others.
#[repr(C, align(16))]
struct Environment([u8; 64]);

unsafe extern "C" {
    fn feholdexcept(env: *mut Environment) -> i32;
    fn fesetenv(env: *const Environment) -> i32;
}

/// Restores the saved environment, also when the work panics.
struct Restore(MaybeUninit<Environment>);

impl Drop for Restore {
    fn drop(&mut self) {
        // SAFETY: feholdexcept filled the environment before this guard was made.
        unsafe { fesetenv(self.0.as_ptr()) };
    }
}

/// Clears the upper halves of the vector registers, when it is dropped. Kernels of libraries may leave them in use, and each SSE instruction of
/// the host then waits for what they hold: a solver is a fifth slower, its logarithms ten times.
struct ClearUpperHalves;

impl Drop for ClearUpperHalves {
    fn drop(&mut self) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx") {
            // SAFETY: the processor has AVX; compiled code expects nothing in the upper halves across a call.
            unsafe { std::arch::asm!("vzeroupper", options(nomem, nostack, preserves_flags)) };
        }
    }
}

/// Runs `work` with floating-point traps off and restores the caller's traps and flags afterwards, with no vector register wider than
/// SSE's in use.
///
/// OpenFOAM traps division by zero, overflow and invalid operations (FOAM_SIGFPE). BLAS, LAPACK and
/// vectorised code raise those flags on purpose, in lanes whose results they discard.
pub fn without_traps<R>(work: impl FnOnce() -> R) -> R {
    let mut environment = MaybeUninit::<Environment>::uninit();
    // SAFETY: the pointer is valid and the storage is larger than any platform's fenv_t.
    let held = unsafe { feholdexcept(environment.as_mut_ptr()) } == 0;
    let _restore = held.then(|| Restore(environment));
    let _clear = ClearUpperHalves;
    apart(work)
}

/// A call of its own: the compiler knows nothing of traps and may move inlined arithmetic past the calls above.
#[inline(never)]
fn apart<R>(work: impl FnOnce() -> R) -> R {
    std::hint::black_box(work())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FE_DIVBYZERO: i32 = 4;

    unsafe extern "C" {
        fn feenableexcept(mask: i32) -> i32;
        fn fedisableexcept(mask: i32) -> i32;
        fn fegetexcept() -> i32;
    }

    /// Whether an upper half is in use, where the processor tells (XGETBV of 1, bit 2).
    #[cfg(target_arch = "x86_64")]
    fn upper_halves_in_use() -> bool {
        let low: u32;
        // SAFETY: called where XSAVE is there, of which AVX-512 is a later part; XGETBV changes nothing but these registers.
        unsafe {
            std::arch::asm!("xgetbv", in("ecx") 1, out("eax") low, out("edx") _, options(nomem, nostack, preserves_flags));
        }
        low & 4 != 0
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn the_hosts_vector_registers_are_narrow_afterwards() {
        if !std::arch::is_x86_feature_detected!("avx512f") {
            return;
        }
        // SAFETY: the processor has AVX; ymm15 is said to be changed.
        let dirty = || unsafe {
            std::arch::asm!("vcmptrueps ymm15, ymm15, ymm15", out("xmm15") _, options(nomem, nostack));
            upper_halves_in_use()
        };
        assert!(without_traps(dirty) && !upper_halves_in_use());
    }

    #[test]
    fn traps_are_off_inside_and_back_afterwards() {
        // SAFETY: glibc's functions on this thread's own environment.
        unsafe { feenableexcept(FE_DIVBYZERO) };
        // SAFETY: as above.
        let inside = without_traps(|| (unsafe { fegetexcept() }, 1.0 / std::hint::black_box(0.0f64)));
        // SAFETY: as above.
        let after = unsafe { fegetexcept() };
        // SAFETY: as above.
        unsafe { fedisableexcept(FE_DIVBYZERO) };
        assert_eq!(inside.0, 0);
        assert!(inside.1.is_infinite());
        assert_eq!(after, FE_DIVBYZERO);
    }
}
