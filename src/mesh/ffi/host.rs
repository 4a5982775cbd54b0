//! Meshes as C has them: `m4gn_mesh_data` of `m4gn.h`, and the way from pointers and counts to slices, strings and a mesh.
//!
//! Hosts hand it to `libm4gn.so`, and the bridge to OpenFOAM hands it to `m4gn`.

use super::host_body as body;
pub use super::host_solid::{SolidArrays, SolidData};
use crate::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_base::{Error, Result, refuse};
use std::ffi::{CStr, c_char};

/// `m4gn_mesh_data`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct MeshData {
    pub n_directions: i32,
    pub directions: [i32; 3],
    pub n_cells: i32,
    pub cell_global: *const i64,
    pub cell_centres: *const f64,
    pub cell_volumes: *const f64,
    pub n_faces: i32,
    pub face_owner: *const i32,
    pub face_neighbour: *const i32,
    pub face_coeff: *const f64,
    pub n_boundary: i32,
    pub boundary_owner: *const i32,
    pub boundary_global: *const i64,
    pub boundary_centres: *const f64,
    pub boundary_area: *const f64,
    pub boundary_coeff: *const f64,
    pub boundary_type: *const i32,
    pub boundary_patch: *const i32,
    pub n_coupled: i32,
    pub coupled_owner: *const i32,
    pub coupled_rank: *const i32,
    pub coupled_global: *const i64,
    pub coupled_delta: *const f64,
    pub coupled_coeff: *const f64,
    pub n_patches: i32,
    pub patch_names: *const *const c_char,
    pub n_modes: i32,
    pub mode_eigenvalues: *const f64,
    pub mode_cells: *const f64,
    pub cell_type: *const i32,
    pub n_elements: i32,
    pub element_kind: *const i32,
    pub element_points: *const i64,
    pub element_material: *const f64,
    pub n_obstacle: i32,
    pub obstacle_positions: *const f64,
    pub n_obstacle_triangles: i32,
    pub obstacle_triangles: *const i32,
}

/// A count from the host.
pub fn count(what: &str, n: i32) -> Result<usize> {
    usize::try_from(n)
        .map_err(|_| Error::Input(format!("{what}: expected a count that is not negative, found {n}")))
}

/// An array from the host, or an error naming it: null or misaligned with a length.
///
/// # Safety
/// A pointer that is not null must point to `n` values that nobody writes to while the slice lives.
pub unsafe fn slice<'a, T>(what: &str, pointer: *const T, n: usize) -> Result<&'a [T]> {
    if n == 0 {
        return Ok(&[]);
    }
    check(what, pointer, n)?;
    // SAFETY: not null, aligned, and of this length by the caller's contract.
    Ok(unsafe { std::slice::from_raw_parts(pointer, n) })
}

/// An array that is written to.
///
/// # Safety
/// As [`slice`], and nobody else reads it while the slice lives.
pub unsafe fn slice_mut<'a, T>(what: &str, pointer: *mut T, n: usize) -> Result<&'a mut [T]> {
    if n == 0 {
        return Ok(&mut []);
    }
    check(what, pointer, n)?;
    // SAFETY: not null, aligned, and of this length by the caller's contract.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, n) })
}

fn check<T>(what: &str, pointer: *const T, n: usize) -> Result<()> {
    if pointer.is_null() {
        return Err(Error::Input(format!("{what}: expected an array of {n}, found a null pointer")));
    }
    if !pointer.is_aligned() {
        return Err(Error::Input(format!("{what}: the pointer is not aligned to {} bytes", align_of::<T>())));
    }
    Ok(())
}

/// One struct from the host.
///
/// # Safety
/// A pointer that is not null must point to a `T` that lives and stays as it is while the reference does.
pub unsafe fn reference<'a, T>(what: &str, pointer: *const T) -> Result<&'a T> {
    check(what, pointer, 1)?;
    // SAFETY: not null, aligned, valid by the caller's contract.
    Ok(unsafe { &*pointer })
}

/// One struct of the host's or ours that is written to.
///
/// # Safety
/// As [`reference`], and nobody else uses it while the reference lives.
pub unsafe fn reference_mut<'a, T>(what: &str, pointer: *mut T) -> Result<&'a mut T> {
    check(what, pointer, 1)?;
    // SAFETY: not null, aligned, valid by the caller's contract.
    Ok(unsafe { &mut *pointer })
}

/// A string from the host; null is none.
///
/// # Safety
/// A pointer that is not null must point to a string that ends with a zero byte.
pub unsafe fn optional_text<'a>(what: &str, pointer: *const c_char) -> Result<Option<&'a str>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: not null, and a C string by the caller's contract.
    let text = unsafe { CStr::from_ptr(pointer) };
    match text.to_str() {
        Ok(text) => Ok(Some(text)),
        Err(_) => Err(Error::Input(format!("{what}: {:?} is not UTF-8", text.to_string_lossy()))),
    }
}

/// A string from the host that must be there.
///
/// # Safety
/// As [`optional_text`].
pub unsafe fn text<'a>(what: &str, pointer: *const c_char) -> Result<&'a str> {
    // SAFETY: passed on to the caller.
    unsafe { optional_text(what, pointer) }?
        .ok_or_else(|| Error::Input(format!("{what}: expected a string, found a null pointer")))
}

/// Solved directions: 2 or 3 of 0, 1, 2.
pub fn directions(n: i32, which: [i32; 3]) -> Result<Vec<usize>> {
    refuse(!matches!(n, 2 | 3), Error::Input, || format!("n_directions: expected 2 or 3, found {n}"))?;
    let direction = |&d: &i32| match d {
        0..=2 => Ok(d as usize),
        _ => Err(Error::Input(format!("directions: expected 0 (x), 1 (y) or 2 (z), found {d}"))),
    };
    which[..n as usize].iter().map(direction).collect()
}

/// A copy of the host's mesh. Labels are checked when the graph is made.
///
/// # Safety
/// The struct's pointers must be what `m4gn.h` says.
pub unsafe fn mesh(data: &MeshData) -> Result<Mesh> {
    // SAFETY: the lengths are those that the header gives for each array; the host keeps them valid for the call.
    unsafe {
        let directions = directions(data.n_directions, data.directions)?;
        let n = count("n_cells", data.n_cells)?;
        if !data.cell_type.is_null() {
            return body::mesh(data, directions, n);
        }
        if data.n_elements != 0 || data.n_obstacle != 0 {
            return Err(Error::Input(
                "cell_type: expected the types of the body's points beside elements or an obstacle, found a null pointer"
                    .into(),
            ));
        }
        let faces = count("n_faces", data.n_faces)?;
        Ok(Mesh {
            directions,
            cell_global: slice("cell_global", data.cell_global, n)?.to_vec(),
            cell_centres: vectors("cell_centres", data.cell_centres, n)?.to_vec(),
            cell_volumes: slice("cell_volumes", data.cell_volumes, n)?.to_vec(),
            face_owner: slice("face_owner", data.face_owner, faces)?.to_vec(),
            face_neighbour: slice("face_neighbour", data.face_neighbour, faces)?.to_vec(),
            face_coeff: slice("face_coeff", data.face_coeff, faces)?.to_vec(),
            boundary: boundary(data)?,
            coupled: coupled(data)?,
            patches: patches(data)?,
            elastic: elastic(data)?,
            ..Mesh::default()
        })
    }
}

/// # Safety
/// As [`mesh`].
unsafe fn boundary(data: &MeshData) -> Result<Vec<BoundaryFace>> {
    let n = count("n_boundary", data.n_boundary)?;
    // SAFETY: as in `mesh`.
    let (owner, global, centre, area, coeff, kind, patch) = unsafe {
        (
            slice("boundary_owner", data.boundary_owner, n)?,
            slice("boundary_global", data.boundary_global, n)?,
            vectors("boundary_centres", data.boundary_centres, n)?,
            vectors("boundary_area", data.boundary_area, n)?,
            slice("boundary_coeff", data.boundary_coeff, n)?,
            slice("boundary_type", data.boundary_type, n)?,
            slice("boundary_patch", data.boundary_patch, n)?,
        )
    };
    (0..n)
        .map(|i| {
            let kind =
                NodeType::from_code(kind[i]).map_err(|e| Error::Mesh(format!("boundary_type[{i}]: {e}")))?;
            Ok(BoundaryFace {
                owner: owner[i],
                global: global[i],
                centre: centre[i],
                area: area[i],
                coeff: coeff[i],
                kind,
                patch: patch[i],
            })
        })
        .collect()
}

/// # Safety
/// As [`mesh`].
unsafe fn coupled(data: &MeshData) -> Result<Vec<CoupledFace>> {
    let n = count("n_coupled", data.n_coupled)?;
    // SAFETY: as in `mesh`.
    let (owner, rank, global, delta, coeff) = unsafe {
        (
            slice("coupled_owner", data.coupled_owner, n)?,
            slice("coupled_rank", data.coupled_rank, n)?,
            slice("coupled_global", data.coupled_global, n)?,
            vectors("coupled_delta", data.coupled_delta, n)?,
            slice("coupled_coeff", data.coupled_coeff, n)?,
        )
    };
    Ok((0..n)
        .map(|i| CoupledFace {
            owner: owner[i],
            rank: rank[i],
            global: global[i],
            delta: delta[i],
            coeff: coeff[i],
        })
        .collect())
}

/// # Safety
/// As [`mesh`].
unsafe fn elastic(data: &MeshData) -> Result<Option<ElasticModes>> {
    let (n, m) = (count("n_cells", data.n_cells)?, count("n_modes", data.n_modes)?);
    if m == 0 {
        return Ok(None);
    }
    // SAFETY: as in `mesh`.
    let (eigenvalues, cells) = unsafe {
        (slice("mode_eigenvalues", data.mode_eigenvalues, m)?, vectors("mode_cells", data.mode_cells, m * n)?)
    };
    Ok(Some(ElasticModes {
        eigenvalues: eigenvalues.to_vec(),
        vectors: (0..m).map(|i| cells[i * n..(i + 1) * n].to_vec()).collect(),
    }))
}

/// # Safety
/// As [`mesh`].
unsafe fn patches(data: &MeshData) -> Result<Vec<String>> {
    let n = count("n_patches", data.n_patches)?;
    // SAFETY: as in `mesh`.
    let names = unsafe { slice("patch_names", data.patch_names, n)? };
    let name = |(i, &p): (usize, &*const c_char)| {
        // SAFETY: as in `mesh`.
        unsafe { text(&format!("patch_names[{i}]"), p) }.map(str::to_owned)
    };
    names.iter().enumerate().map(name).collect()
}

/// `n` rows of x, y, z.
///
/// # Safety
/// As [`slice`], for 3 n values.
pub unsafe fn vectors<'a>(what: &str, pointer: *const f64, n: usize) -> Result<&'a [[f64; 3]]> {
    // SAFETY: passed on to the caller.
    Ok(unsafe { slice(what, pointer, 3 * n)? }.as_chunks::<3>().0)
}
