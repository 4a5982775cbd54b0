//! OpenFOAM cases, read and written through OpenFOAM's own libraries (`Time`, `fvMesh`, `volVectorField`): ASCII,
//! binary, compressed, undecomposed and decomposed cases alike, and no parser of our own.
//!
//! libOpenFOAM reads its `etc/controlDict` while it is being loaded and ends the process when `WM_PROJECT_DIR` is
//! not set. So nothing links this library: m4gn sets the variable, loads it when a command reads a case, and talks
//! to it through the C interface of [`abi`].

mod abi;

// The macro writes the calls across; its declarations are safe functions on our side.
#[allow(unsafe_code, clippy::undocumented_unsafe_blocks, missing_docs)]
#[cxx::bridge(namespace = "m4gn")]
mod foam {
    /// A patch of the mesh, in the mesh's order.
    struct Patch {
        /// Name in `constant/polyMesh/boundary`.
        name: String,
        /// Type of the polyPatch: `wall`, `patch`, `empty`, ...
        kind: String,
        /// Number of faces.
        faces: usize,
        /// Lower corner of the points of its faces, m.
        lower: [f64; 3],
        /// Upper corner, m.
        upper: [f64; 3],
    }

    /// What a case holds.
    struct Description {
        /// Folder of the case.
        path: String,
        /// `application` of `system/controlDict`; empty when there is none.
        application: String,
        /// `deltaT` of `system/controlDict`, s.
        delta_t: f64,
        /// Number of processor folders that the fields are read from; 0: the case's own time folders.
        processors: usize,
        /// Name of the folder that a run of the case starts from, `0`.
        start: String,
        /// The case's function object `m4gnSurrogate`, else `m4gnSegments`, else `m4gnHarvest`, as a JSON object; `{}`
        /// if it has none.
        function_object: String,
        /// Times that are stored, s, ascending.
        times: Vec<f64>,
        /// Number of cells.
        cells: usize,
        /// Solved directions: 0 x, 1 y, 2 z.
        directions: Vec<i32>,
        /// All patches.
        patches: Vec<Patch>,
    }

    /// Faces of the cells in the plane of a 2-D case.
    struct Polygons {
        /// Points of cell i: `start[i]..start[i + 1]`; length cells + 1.
        start: Vec<usize>,
        /// x, y in the solved directions, one pair a point, m.
        points: Vec<f64>,
    }

    /// Force of the fluid on a patch divided by the density, m^4/s^2.
    struct Force {
        /// Pressure part.
        pressure: [f64; 3],
        /// Viscous part.
        viscous: [f64; 3],
    }

    /// Flow through a patch.
    struct Flow {
        /// Integral of U . n, outward, m^3/s.
        flux: f64,
        /// Area, m^2.
        area: f64,
        /// Integral of U over the area, m^3/s.
        velocity: [f64; 3],
    }

    unsafe extern "C++" {
        include!("FoamCase.H");

        type FoamCase;

        fn open_case(path: &str) -> Result<UniquePtr<FoamCase>>;
        fn describe(&self) -> Result<Description>;
        fn cell_volumes(&self) -> Result<Vec<f64>>;
        fn cell_centres(&self) -> Result<Vec<f64>>;
        fn polygons(&self) -> Result<Polygons>;
        fn has_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<bool>;
        fn scalar_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<Vec<f64>>;
        fn vector_field(self: Pin<&mut FoamCase>, name: &str, time: usize) -> Result<Vec<f64>>;
        fn force(self: Pin<&mut FoamCase>, patch: &str, time: usize) -> Result<Force>;
        fn flow(self: Pin<&mut FoamCase>, patch: &str, time: usize) -> Result<Flow>;
        fn set_node_types(self: Pin<&mut FoamCase>, keys: &Vec<String>, types: &Vec<String>) -> Result<()>;
        fn mesh_part(&self, name: &str) -> Result<Vec<f64>>;
        fn start_note(&self, name: &str) -> Result<String>;
        fn remove_start_field(&self, name: &str) -> Result<()>;
        fn write_start_fields(&self, names: &Vec<String>, note: &str, values: &[f64]) -> Result<()>;
    }
}
