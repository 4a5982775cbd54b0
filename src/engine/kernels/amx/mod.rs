//! AMX: tiles of 16 rows of 64 bytes, and products of bf16 between them.
//!
//! A tile of x holds 16 rows of 32 inputs; a tile of a packed weight 16 pairs of inputs for 16 outputs, which is how
//! [`Packed`](super::Packed) orders them; a tile of sums 16 rows of 16 outputs in fp32. The instructions stand in assembly
//! because the compiler's own functions for them are not stable yet.

mod block;
mod outer;
mod product;
mod tiles;

pub use block::registers;
pub use outer::outer;
pub use product::product;
pub use tiles::Tiles;

use super::Isa;
use super::simd::Number;
use crate::kernels::Level;
use std::arch::asm;
use std::sync::OnceLock;

/// Rows of a tile.
pub const ROWS: usize = 16;

/// Inputs that one step of tiles takes.
pub const INPUTS: usize = 32;

/// Whether a product has the shape of tiles; `rows` is how many rows of x can be read.
pub fn takes<T: Number>(isa: Isa, inputs: usize, rows: usize) -> bool {
    isa.0 == Level::Amx && T::STEP == 2 && inputs.is_multiple_of(INPUTS) && inputs > 0 && rows >= ROWS
}

/// Whether the processor has AMX with bf16 and the system lets this process use it, which is asked for once.
pub fn available() -> bool {
    static AVAILABLE: OnceLock<bool> = OnceLock::new();
    *AVAILABLE.get_or_init(|| !cfg!(miri) && processor_has_tiles() && system_grants_tiles())
}

fn processor_has_tiles() -> bool {
    let features = std::arch::x86_64::__cpuid(1).ecx;
    if features & (1 << 27) == 0 || std::arch::x86_64::__cpuid(0).eax < 7 {
        return false;
    }
    // AMX-BF16 and AMX-TILE.
    let edx = std::arch::x86_64::__cpuid_count(7, 0).edx;
    if edx & (1 << 22) == 0 || edx & (1 << 24) == 0 {
        return false;
    }
    let saved: u32;
    // SAFETY: bit 27 of the features above says that the instruction is there; it reads what the system saves.
    unsafe { asm!("xgetbv", in("ecx") 0, out("eax") saved, out("edx") _, options(nomem, nostack)) };
    const TILES: u32 = 0b11 << 17;
    saved & TILES == TILES
}

#[cfg(target_os = "linux")]
fn system_grants_tiles() -> bool {
    // Linux keeps room for a thread's tiles only where the process has asked for it (arch_prctl(2)).
    const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
    const TILE_DATA: libc::c_long = 18;
    // SAFETY: a system call with two numbers.
    unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, TILE_DATA) == 0 }
}

#[cfg(not(target_os = "linux"))]
fn system_grants_tiles() -> bool {
    false
}
