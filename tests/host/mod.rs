//! The C ABI as a host sees it: its functions, with meshes as plain arrays.
// Each test program uses a part of it.
#![allow(dead_code, unsafe_code)]

pub use m4gn::*;
use m4gn_mesh::ElasticModes;
use m4gn_mesh::Mesh;
use m4gn_model::Model;
use m4gn_modes::fem::PointMesh;
use m4gn_samples::model::bodies;
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

/// A mesh as arrays; what `data` points to lives here.
pub struct Host {
    pub data: MeshData,
    pub mesh: Mesh,
    modes: [Vec<f64>; 2],
    vectors: [Vec<f64>; 4],
    integers: [Vec<i32>; 5],
    longs: [Vec<i64>; 2],
    reals: [Vec<f64>; 2],
    /// Of a body: types of its points, kinds of its elements, the obstacle's triangles.
    codes: [Vec<i32>; 3],
    /// Of a body: its elements' materials, the obstacle's points.
    figures: [Vec<f64>; 2],
    _names: Vec<CString>,
    names: Vec<*const c_char>,
}

impl Host {
    pub fn new(mesh: Mesh) -> Box<Host> {
        let flat = |v: Vec<[f64; 3]>| v.into_flattened();
        let (b, c) = (&mesh.boundary, &mesh.coupled);
        let names: Vec<CString> = mesh.patches.iter().map(|p| CString::new(p.as_str()).unwrap()).collect();
        let mut host = Box::new(Host {
            // SAFETY: integers and null pointers; filled in below.
            data: unsafe { std::mem::zeroed() },
            modes: Default::default(),
            vectors: [
                flat(mesh.cell_centres.clone()),
                flat(b.iter().map(|f| f.centre).collect()),
                flat(b.iter().map(|f| f.area).collect()),
                flat(c.iter().map(|f| f.delta).collect()),
            ],
            integers: [
                b.iter().map(|f| f.owner).collect(),
                b.iter().map(|f| f.kind as i32).collect(),
                b.iter().map(|f| f.patch).collect(),
                c.iter().map(|f| f.owner).collect(),
                c.iter().map(|f| f.rank).collect(),
            ],
            longs: [b.iter().map(|f| f.global).collect(), c.iter().map(|f| f.global).collect()],
            reals: [b.iter().map(|f| f.coeff).collect(), c.iter().map(|f| f.coeff).collect()],
            names: names.iter().map(|n| n.as_ptr()).collect(),
            _names: names,
            codes: Default::default(),
            figures: Default::default(),
            mesh,
        });
        let mut directions = [-1; 3];
        for (to, from) in directions.iter_mut().zip(&host.mesh.directions) {
            *to = *from as i32;
        }
        host.data = MeshData {
            n_directions: host.mesh.directions.len() as i32,
            directions,
            // A body's points have no volumes.
            n_cells: host.mesh.cell_global.len() as i32,
            cell_global: host.mesh.cell_global.as_ptr(),
            cell_centres: host.vectors[0].as_ptr(),
            cell_volumes: host.mesh.cell_volumes.as_ptr(),
            n_faces: host.mesh.face_owner.len() as i32,
            face_owner: host.mesh.face_owner.as_ptr(),
            face_neighbour: host.mesh.face_neighbour.as_ptr(),
            face_coeff: host.mesh.face_coeff.as_ptr(),
            n_boundary: host.mesh.boundary.len() as i32,
            boundary_owner: host.integers[0].as_ptr(),
            boundary_global: host.longs[0].as_ptr(),
            boundary_centres: host.vectors[1].as_ptr(),
            boundary_area: host.vectors[2].as_ptr(),
            boundary_coeff: host.reals[0].as_ptr(),
            boundary_type: host.integers[1].as_ptr(),
            boundary_patch: host.integers[2].as_ptr(),
            n_coupled: host.mesh.coupled.len() as i32,
            coupled_owner: host.integers[3].as_ptr(),
            coupled_rank: host.integers[4].as_ptr(),
            coupled_global: host.longs[1].as_ptr(),
            coupled_delta: host.vectors[3].as_ptr(),
            coupled_coeff: host.reals[1].as_ptr(),
            n_patches: host.names.len() as i32,
            patch_names: host.names.as_ptr(),
            n_modes: 0,
            mode_eigenvalues: null(),
            mode_cells: null(),
            cell_type: null(),
            n_elements: 0,
            element_kind: null(),
            element_points: null(),
            element_material: null(),
            n_obstacle: 0,
            obstacle_positions: null(),
            n_obstacle_triangles: 0,
            obstacle_triangles: null(),
        };
        host.give_body();
        host
    }

    /// Hands in the body and the obstacle that the mesh has, if any.
    fn give_body(&mut self) {
        if let Some(body) = &self.mesh.body {
            let values = body.material.iter().map(|m| [m.young, m.poisson, m.density]);
            self.figures[0] = values.flatten().collect();
            self.codes[0] = body.types.iter().map(|&t| t as i32).collect();
            self.codes[1] = body.kind.iter().map(|&k| k as i32).collect();
            self.data.cell_type = self.codes[0].as_ptr();
            self.data.n_elements = self.codes[1].len() as i32;
            self.data.element_kind = self.codes[1].as_ptr();
            self.data.element_points = body.points.as_ptr();
            self.data.element_material = self.figures[0].as_ptr();
        }
        if let Some(obstacle) = &self.mesh.obstacle {
            self.figures[1] = obstacle.positions.as_flattened().to_vec();
            self.codes[2] = obstacle.triangles.as_flattened().to_vec();
            self.data.n_obstacle = obstacle.positions.len() as i32;
            self.data.obstacle_positions = self.figures[1].as_ptr();
            self.data.n_obstacle_triangles = obstacle.triangles.len() as i32;
            self.data.obstacle_triangles = self.codes[2].as_ptr();
        }
    }

    /// Hands elastic modes in with the mesh.
    pub fn give_modes(&mut self, modes: &ElasticModes) {
        let cells = modes.vectors.iter().flatten().flatten().copied().collect();
        self.modes = [modes.eigenvalues.clone(), cells];
        self.data.n_modes = modes.eigenvalues.len() as i32;
        self.data.mode_eigenvalues = self.modes[0].as_ptr();
        self.data.mode_cells = self.modes[1].as_ptr();
    }
}

/// An elastic body as arrays; what `data` points to lives here.
pub struct BodyHost {
    pub data: SolidData,
    pub mesh: PointMesh,
    points: Vec<f64>,
    cells: [Vec<f64>; 3],
    fixed: Vec<i32>,
}

impl BodyHost {
    /// Of one material, held at x = 0.
    pub fn new(mesh: PointMesh) -> Box<BodyHost> {
        let n = mesh.n_cells;
        let held = |p: &usize| mesh.points[*p][0] < 1e-9;
        let mut host = Box::new(BodyHost {
            // SAFETY: integers and null pointers; filled in below.
            data: unsafe { std::mem::zeroed() },
            points: mesh.points.clone().into_flattened(),
            cells: [vec![1e6; n], vec![0.3; n], vec![1000.0; n]],
            fixed: (0..mesh.points.len()).filter(held).map(|p| p as i32).collect(),
            mesh,
        });
        let mut directions = [-1; 3];
        for (to, from) in directions.iter_mut().zip(&host.mesh.directions) {
            *to = *from as i32;
        }
        host.data = SolidData {
            n_directions: host.mesh.directions.len() as i32,
            directions,
            n_points: host.mesh.points.len() as i32,
            point_global: host.mesh.point_global.as_ptr(),
            points: host.points.as_ptr(),
            n_faces: host.mesh.n_faces() as i32,
            n_internal_faces: host.mesh.face_neighbour.len() as i32,
            face_start: host.mesh.face_start.as_ptr(),
            face_points: host.mesh.face_points.as_ptr(),
            face_owner: host.mesh.face_owner.as_ptr(),
            face_neighbour: host.mesh.face_neighbour.as_ptr(),
            n_cells: n as i32,
            young: host.cells[0].as_ptr(),
            poisson: host.cells[1].as_ptr(),
            density: host.cells[2].as_ptr(),
            n_fixed: host.fixed.len() as i32,
            fixed_point: host.fixed.as_ptr(),
            fixed_components: null(),
            plane_stress: 0,
            free_body: 0,
        };
        host
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
