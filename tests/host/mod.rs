//! The C ABI as a host sees it: its functions, with meshes as plain arrays.
// Each test program uses a part of it.
#![allow(dead_code, unsafe_code)]

pub use m4gn::*;
use m4gn_mesh::ElasticModes;
use m4gn_mesh::Mesh;
use m4gn_model::Model;
use m4gn_modes::fem::PointMesh;
use m4gn_samples::model::bodies;
use std::any::Any;
use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};

pub type Session = *mut SessionHandle;

/// What a host brings along to a ride of this session: a state of these arrays.
pub fn ride_host(session: Session, host: &Host, arrays: &[ArrayData]) -> HostData {
    HostData {
        session: session.cast(),
        own: null(),
        mesh: &host.data,
        arrays: arrays.as_ptr(),
        n_arrays: arrays.len() as i32,
        ahead: None,
        data: null_mut(),
    }
}

/// An array of a state: of a solved one all components are.
pub fn array(name: &'static CStr, place: i32, role: i32, components: i32, n: usize) -> ArrayData {
    ArrayData {
        name: name.as_ptr(),
        place,
        role,
        components,
        solved: components,
        n: n as i64,
        floor: f64::NEG_INFINITY,
        weights: null(),
    }
}

/// The state of a plane flow on this mesh: U and p, solved and following at cells, with the values that boundary faces carry.
pub fn flow_arrays(host: &Host) -> [ArrayData; 4] {
    let (n, b) = (host.mesh.n_cells(), host.mesh.boundary.len());
    [
        ArrayData { solved: host.mesh.directions.len() as i32, ..array(c"U", 0, 0, 3, n) },
        array(c"p", 0, 1, 1, n),
        array(c"U", 3, 2, 3, b),
        array(c"p", 3, 2, 1, b),
    ]
}

/// As [`flow_arrays`], with the inlet's value, which the host knows beforehand, behind them.
pub fn flow_and_inlet(host: &Host) -> Vec<ArrayData> {
    [&flow_arrays(host)[..], &[array(c"inlet", 2, 3, 1, 1)]].concat()
}

/// The end of the step of this index.
pub fn ride_step(index: i64, delta_t: f64) -> RideStep {
    RideStep {
        time: delta_t * index as f64,
        delta_t,
        end_time: f64::INFINITY,
        output_time: 0.0,
        within: 0.0,
        index,
        name: null(),
        correctors: -1,
        most_correctors: -1,
    }
}

/// A field of a recording, m/s.
pub fn declared(name: *const c_char, components: i32) -> FieldInfo {
    FieldInfo { name, components, dimensions: [0, 1, -1, 0, 0, 0, 0], is_input: 0, is_output: 0 }
}

/// Rows of a matrix.
pub struct Rows {
    pub row: Vec<i64>,
    pub column: Vec<i64>,
    pub value: Vec<f64>,
}

impl Rows {
    /// These of n rows with three entries each.
    pub fn band(rows: std::ops::Range<i64>, n: i64, inner: f64, outer: f64) -> Rows {
        let mut band = Rows { row: vec![0], column: Vec::new(), value: Vec::new() };
        for i in rows {
            for (j, v) in [(i - 1, outer), (i, inner), (i + 1, outer)] {
                if (0..n).contains(&j) {
                    band.column.push(j);
                    band.value.push(v);
                }
            }
            band.row.push(band.column.len() as i64);
        }
        band
    }

    pub fn data(&self) -> CsrData {
        CsrData {
            n_rows: self.row.len() as i32 - 1,
            row: self.row.as_ptr(),
            column: self.column.as_ptr(),
            value: self.value.as_ptr(),
        }
    }
}

/// Values of U and p at cells and boundary faces.
pub struct Flow {
    pub u: Vec<f64>,
    pub p: Vec<f64>,
    pub faces: Vec<f64>,
}

impl Flow {
    /// All alike.
    pub fn of(host: &Host, value: f64) -> Flow {
        let (n, b) = (host.mesh.cell_global.len(), host.mesh.boundary.len());
        Flow { u: vec![value; 3 * n], p: vec![value; n], faces: vec![value; 3 * b] }
    }

    /// For a step of a session: cells and boundary faces of each field.
    pub fn cells(&self) -> [*const f64; 2] {
        [self.u.as_ptr(), self.p.as_ptr()]
    }

    pub fn boundary(&self) -> [*const f64; 2] {
        [self.faces.as_ptr(); 2]
    }

    /// For a ride with [`flow_arrays`].
    pub fn state(&self) -> [*const f64; 4] {
        [self.u.as_ptr(), self.p.as_ptr(), self.faces.as_ptr(), self.faces.as_ptr()]
    }

    /// Where the cells of the next state go.
    pub fn next(&mut self) -> [*mut f64; 2] {
        [self.u.as_mut_ptr(), self.p.as_mut_ptr()]
    }
}

/// Message of the last failed call.
pub fn message() -> String {
    // SAFETY: a string of this thread until its next call.
    unsafe { CStr::from_ptr(m4gn_last_error()) }.to_string_lossy().into_owned()
}

/// Settings as a host hands them over.
pub fn options(settings: &serde_json::Value) -> CString {
    CString::new(settings.to_string()).unwrap()
}

/// Arrays that a host's pointers are to.
#[derive(Default)]
struct Kept(Vec<Box<dyn Any>>);

impl Kept {
    fn list<T: 'static>(&mut self, values: impl IntoIterator<Item = T>) -> *const T {
        let values: Vec<T> = values.into_iter().collect();
        let place = values.as_ptr();
        self.0.push(Box::new(values));
        place
    }

    fn vectors<'a>(&mut self, values: impl IntoIterator<Item = &'a [f64; 3]>) -> *const f64 {
        self.list(values.into_iter().flatten().copied())
    }
}

fn directions(mesh: &[usize]) -> [i32; 3] {
    std::array::from_fn(|i| mesh.get(i).map_or(-1, |&d| d as i32))
}

/// A mesh as arrays; what `data` points to lives here.
pub struct Host {
    pub data: MeshData,
    pub mesh: Mesh,
    kept: Kept,
}

impl Host {
    pub fn new(mesh: Mesh) -> Host {
        let (b, c, mut kept) = (&mesh.boundary, &mesh.coupled, Kept::default());
        let names: Vec<CString> = mesh.patches.iter().map(|p| CString::new(p.as_str()).unwrap()).collect();
        let mut data = MeshData {
            n_directions: mesh.directions.len() as i32,
            directions: directions(&mesh.directions),
            // A body's points have no volumes.
            n_cells: mesh.cell_global.len() as i32,
            cell_global: mesh.cell_global.as_ptr(),
            cell_centres: mesh.cell_centres.as_flattened().as_ptr(),
            cell_volumes: mesh.cell_volumes.as_ptr(),
            n_faces: mesh.face_owner.len() as i32,
            face_owner: mesh.face_owner.as_ptr(),
            face_neighbour: mesh.face_neighbour.as_ptr(),
            face_coeff: mesh.face_coeff.as_ptr(),
            n_boundary: b.len() as i32,
            boundary_owner: kept.list(b.iter().map(|f| f.owner)),
            boundary_global: kept.list(b.iter().map(|f| f.global)),
            boundary_centres: kept.vectors(b.iter().map(|f| &f.centre)),
            boundary_area: kept.vectors(b.iter().map(|f| &f.area)),
            boundary_coeff: kept.list(b.iter().map(|f| f.coeff)),
            boundary_type: kept.list(b.iter().map(|f| f.kind as i32)),
            boundary_patch: kept.list(b.iter().map(|f| f.patch)),
            n_coupled: c.len() as i32,
            coupled_owner: kept.list(c.iter().map(|f| f.owner)),
            coupled_rank: kept.list(c.iter().map(|f| f.rank)),
            coupled_global: kept.list(c.iter().map(|f| f.global)),
            coupled_delta: kept.vectors(c.iter().map(|f| &f.delta)),
            coupled_coeff: kept.list(c.iter().map(|f| f.coeff)),
            n_patches: names.len() as i32,
            patch_names: kept.list(names.iter().map(|n| n.as_ptr())),
            // SAFETY: integers and null pointers.
            ..unsafe { std::mem::zeroed() }
        };
        kept.list(names);
        if let Some(body) = &mesh.body {
            data.cell_type = kept.list(body.types.iter().map(|&t| t as i32));
            data.n_elements = body.kind.len() as i32;
            data.element_kind = kept.list(body.kind.iter().map(|&k| k as i32));
            data.element_points = body.points.as_ptr();
            data.element_material = kept
                .vectors(&body.material.iter().map(|m| [m.young, m.poisson, m.density]).collect::<Vec<_>>());
        }
        if let Some(obstacle) = &mesh.obstacle {
            data.n_obstacle = obstacle.positions.len() as i32;
            data.obstacle_positions = obstacle.positions.as_flattened().as_ptr();
            data.n_obstacle_triangles = obstacle.triangles.len() as i32;
            data.obstacle_triangles = obstacle.triangles.as_flattened().as_ptr();
        }
        Host { data, mesh, kept }
    }

    /// Hands elastic modes in with the mesh.
    pub fn give_modes(&mut self, modes: &ElasticModes) {
        self.data.n_modes = modes.eigenvalues.len() as i32;
        self.data.mode_eigenvalues = self.kept.list(modes.eigenvalues.iter().copied());
        self.data.mode_cells = self.kept.vectors(modes.vectors.iter().flatten());
    }
}

/// An elastic body as arrays; what `data` points to lives here.
pub struct BodyHost {
    pub data: SolidData,
    pub mesh: PointMesh,
    _kept: Kept,
}

impl BodyHost {
    /// Of one material, held at x = 0.
    pub fn new(mesh: PointMesh) -> BodyHost {
        let (n, mut kept) = (mesh.n_cells, Kept::default());
        let fixed = (0..mesh.points.len()).filter(|p| mesh.points[*p][0] < 1e-9);
        let fixed: Vec<i32> = fixed.map(|p| p as i32).collect();
        let data = SolidData {
            n_directions: mesh.directions.len() as i32,
            directions: directions(&mesh.directions),
            n_points: mesh.points.len() as i32,
            point_global: mesh.point_global.as_ptr(),
            points: mesh.points.as_flattened().as_ptr(),
            n_faces: mesh.n_faces() as i32,
            n_internal_faces: mesh.face_neighbour.len() as i32,
            face_start: mesh.face_start.as_ptr(),
            face_points: mesh.face_points.as_ptr(),
            face_owner: mesh.face_owner.as_ptr(),
            face_neighbour: mesh.face_neighbour.as_ptr(),
            n_cells: n as i32,
            young: kept.list(vec![1e6; n]),
            poisson: kept.list(vec![0.3; n]),
            density: kept.list(vec![1000.0; n]),
            n_fixed: fixed.len() as i32,
            fixed_point: kept.list(fixed),
            fixed_components: null(),
            plane_stress: 0,
            free_body: 0,
        };
        BodyHost { data, mesh, _kept: kept }
    }
}

/// A small model of bodies at points.
pub fn body_model() -> Model {
    let mut spec = bodies();
    (spec.segments.count, spec.segments.modes) = (3, 1);
    let mut model = Model::random(spec, 5).unwrap();
    // Random weights move points far.
    model.tensors.get_mut("norm.output.std").unwrap().data.fill(0.01);
    model
}

/// No handle yet.
pub fn none<T>() -> *mut T {
    null_mut()
}

/// A model of this process alone, to be freed.
pub fn open_model(path: impl AsRef<std::path::Path>) -> *mut ModelHandle {
    let path = CString::new(path.as_ref().to_str().unwrap()).unwrap();
    let mut model = none();
    // SAFETY: a C string and a place for the handle.
    let status = unsafe { m4gn_model_open(m4gn_parallel::NO_MPI, path.as_ptr(), &mut model) };
    assert_eq!(status, 0, "{}", message());
    model
}
