//! OpenFOAM cases, read and written through OpenFOAM's own libraries (`Time`, `fvMesh`, `volVectorField`): ASCII,
//! binary, compressed, undecomposed and decomposed cases alike, and no parser of our own.
//!
//! libOpenFOAM reads its `etc/controlDict` while it is being loaded and ends the process when `WM_PROJECT_DIR` is
//! not set. So nothing links this library: m4gn sets the variable, loads it when a command reads a case, and talks
//! to it through the C interface of [`abi`].

mod abi;

// The macro writes the calls across; its declarations are safe functions on our side.
#[allow(unsafe_code, clippy::undocumented_unsafe_blocks, missing_docs, non_camel_case_types)]
#[cxx::bridge(namespace = "m4gn")]
mod foam {
    unsafe extern "C++" {
        include!("m4gn.h");

        /// As in `m4gn.h`.
        #[namespace = ""]
        type m4gn_mesh_data;
        /// As in `m4gn.h`.
        #[namespace = ""]
        type m4gn_solid;
    }

    unsafe extern "C++" {
        include!("FoamCase.H");

        type FoamCase;
        fn open_case(path: &str) -> Result<UniquePtr<FoamCase>>;
        fn describe(&self) -> Result<String>;
        fn cell_centres(&self) -> Result<Vec<f64>>;
        fn polygons(&self) -> Result<Vec<f64>>;
        fn has_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<bool>;
        fn scalar_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<Vec<f64>>;
        fn vector_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<Vec<f64>>;
        fn force(self: Pin<&mut FoamCase>, patch: &str, time: usize) -> Result<Vec<f64>>;
        fn flow(self: Pin<&mut FoamCase>, patch: &str, time: usize) -> Result<Vec<f64>>;
        fn stress(self: Pin<&mut FoamCase>, time: usize) -> Result<Vec<f64>>;
        fn reaction(self: Pin<&mut FoamCase>, patch: &str, time: usize) -> Result<Vec<f64>>;
        fn set_node_types(self: Pin<&mut FoamCase>, keys: &Vec<String>, types: &Vec<String>) -> Result<()>;
        fn mesh(&self) -> *const m4gn_mesh_data;
        fn body(&self) -> *const m4gn_solid;
        fn start_note(&self, name: &str) -> Result<String>;
        fn remove_start_field(&self, name: &str) -> Result<()>;
        fn write_start_fields(
            &self,
            names: &Vec<String>,
            note: &str,
            values: &[f64],
            segment_record: &str,
        ) -> Result<()>;
        fn take_start(&self, sources: &Vec<String>, weights: &[f64], ratios: &[f64]) -> Result<usize>;
        fn products(&self, folders: &Vec<String>) -> Result<Vec<f64>>;
    }
}
