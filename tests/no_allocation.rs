//! A step allocates nothing: a solver calls it thousands of times beside its own work.
#![allow(unsafe_code)]

#[path = "samples/flow.rs"]
mod flow;

use flow::Flow;
use m4gn_engine::PrecisionChoice;
use m4gn_mesh::NodeType;
use m4gn_model::{Activation, Architecture, Kind, M4gn, MacroSpec, Model, ModelSpec, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_step::{Session, SessionOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting what this thread asks for.
struct Counting;

// SAFETY: all work is the system allocator's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    let kinds = [
        (64, 1, 0, PrecisionChoice::Fp32, 1),
        (128, 2, 1, PrecisionChoice::Bf16, 1),
        (20, 1, 0, PrecisionChoice::Fp32, 2),
        (64, 3, 1, PrecisionChoice::Bf16, 3),
    ];
    for (width, hidden_layers, overlap, precision, n_threads) in kinds {
        let segment_transformer =
            MacroSpec { layers: 2, heads: 4, ffn_width: 100, rwse_steps: 3, centroids: true, offsets: true };
        // Its pressure has a level, which is taken off in each step.
        let small = m4gn_samples::model::spec();
        let spec = ModelSpec {
            node_types: NodeType::ALL.to_vec(),
            architecture: Architecture {
                width,
                hidden_layers,
                activation: Activation::Silu,
                kind: Kind::M4gn(M4gn { layers_before: 2, layers_after: 2, segment_transformer }),
                ..small.architecture
            },
            segments: SegmentSpec { count: 12, overlap, ..SegmentSpec::default() },
            ..small
        };
        let mesh = sample::triangles(30, 12, 1.6, 0.41);
        let model = Model::random(spec, 1).unwrap();
        let options = SessionOptions { precision, n_threads, ..SessionOptions::default() };
        let mut session = Session::new(Comm::serial(), &mesh, &model, &options).unwrap();
        let (n, b) = (mesh.n_cells(), mesh.boundary.len());
        let (u, u_boundary, p, p_boundary) = (vec![0.1; 3 * n], vec![0.2; 3 * b], vec![0.3; n], vec![0.4; b]);
        let flow = Flow { u, u_boundary, p, p_boundary };
        let (mut u, mut p) = (vec![0.0; 3 * n], vec![0.0; n]);
        for i in 0..3 {
            let before = COUNT.get();
            flow.step(&mut session, &mut u, &mut p).unwrap();
            let count = COUNT.get() - before;
            assert_eq!(count, 0, "width {width}: step {i} allocated {count} times");
        }
    }
}
