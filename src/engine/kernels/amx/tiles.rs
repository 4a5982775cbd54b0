//! The shapes of a thread's tiles.

use crate::kernels::Isa;
use crate::kernels::Level;
use std::arch::asm;
use std::cell::Cell;

/// What `ldtilecfg` reads: the shape of each of the eight tiles.
#[repr(C, align(64))]
struct Shapes {
    palette: u8,
    start: u8,
    reserved: [u8; 14],
    bytes: [u16; 16],
    rows: [u8; 16],
}

static SHAPES: Shapes = Shapes {
    palette: 1,
    start: 0,
    reserved: [0; 14],
    bytes: [64, 64, 64, 64, 64, 64, 64, 64, 0, 0, 0, 0, 0, 0, 0, 0],
    rows: [16, 16, 16, 16, 16, 16, 16, 16, 0, 0, 0, 0, 0, 0, 0, 0],
};

thread_local! {
    /// Whether a [`Tiles`] of this thread lives.
    static READY: Cell<bool> = const { Cell::new(false) };
}

/// While one lives, its thread's tiles have their shapes. Setting them takes as long as a small product, so that whoever
/// does many holds one around them; those within it cost nothing.
pub struct Tiles {
    /// Whether this one set the shapes.
    owner: bool,
    /// A pointer, so that it stays with its thread.
    thread: std::marker::PhantomData<*const ()>,
}

impl Tiles {
    /// For products with this instruction set; nothing where it has no tiles.
    pub fn new(isa: Isa) -> Self {
        let owner = isa.0 == Level::Amx && !READY.replace(true);
        if owner {
            // SAFETY: an Isa of this level exists only where the processor has tiles and the system grants them.
            unsafe {
                asm!("ldtilecfg [{}]", in(reg) &raw const SHAPES, options(nostack, readonly, preserves_flags));
            }
        }
        Tiles { owner, thread: std::marker::PhantomData }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        if self.owner {
            READY.set(false);
            // SAFETY: as above. Other code of this thread finds the tiles unset, as it would without us.
            unsafe { asm!("tilerelease", options(nomem, nostack, preserves_flags)) };
        }
    }
}
