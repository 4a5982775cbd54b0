//! The structs against the header's layout, and the exports without a host. `tests/cabi` has the view from C++.

use super::*;
use arrays::Host;
use m4gn_samples::mesh as sample;
use std::ffi::CStr;
use std::mem::{offset_of, size_of};

#[path = "../../tests/host/mod.rs"]
mod arrays;

#[test]
fn layouts_are_those_of_the_header() {
    // Sizes and offsets as the x86-64 and AArch64 ABIs of C lay out m4gn.h.
    assert_eq!((size_of::<MeshData>(), offset_of!(MeshData, cell_global)), (304, 24));
    assert_eq!((offset_of!(MeshData, n_boundary), offset_of!(MeshData, patch_names)), (80, 200));
    assert_eq!(
        (size_of::<ArrayData>(), offset_of!(ArrayData, n), offset_of!(ArrayData, weights)),
        (48, 24, 40)
    );
    assert_eq!((size_of::<HostData>(), offset_of!(HostData, ahead)), (56, 40));
    assert_eq!((size_of::<SurrogateData>(), offset_of!(SurrogateData, step)), (48, 32));
    assert_eq!((size_of::<RideStep>(), size_of::<RideAnswer>()), (64, 56));
    assert_eq!((size_of::<FieldInfo>(), offset_of!(FieldInfo, dimensions)), (48, 12));
    assert_eq!(size_of::<RankReport>(), 16);
    assert_eq!((size_of::<SolidData>(), offset_of!(SolidData, fixed_components)), (144, 128));
}

#[test]
fn meshes_are_copied_and_checked() {
    let h = Host::new(sample::chain(4, 1.0));
    // SAFETY: the host's arrays live as long as h.
    let read = |data: &MeshData| unsafe { pointers::mesh(data) };
    assert_eq!(read(&h.data).unwrap(), h.mesh);
    let null = std::ptr::null();
    let broken = [
        (MeshData { n_cells: -1, ..h.data }, "n_cells: expected a count"),
        (MeshData { cell_centres: null, ..h.data }, "cell_centres: expected an array of 12, found a null"),
        (MeshData { n_directions: 4, ..h.data }, "n_directions: expected 2 or 3, found 4"),
        (MeshData { directions: [0, 7, 0], ..h.data }, "directions: expected 0 (x), 1 (y) or 2 (z), found 7"),
        (MeshData { boundary_owner: std::ptr::null(), ..h.data }, "boundary_owner: expected an array of 2"),
        (MeshData { n_coupled: i32::MIN, ..h.data }, "n_coupled"),
        (MeshData { cell_volumes: h.data.cell_volumes.wrapping_byte_add(1), ..h.data }, "not aligned"),
    ];
    for (data, message) in broken {
        m4gn_samples::fails(read(&data), &[message]);
    }
}

#[test]
fn null_handles_and_pointers_are_errors() {
    // SAFETY: null pointers, which the exports accept as bad input.
    unsafe {
        use std::ptr::{null, null_mut};
        assert_eq!(session::m4gn_session_new(i32::MIN, null(), null(), null(), null(), null_mut()), 1);
        assert!(CStr::from_ptr(m4gn_last_error()).to_str().unwrap().contains("session: expected"));
        let mut model = null_mut();
        assert_eq!(model::m4gn_model_open(i32::MIN, null(), &mut model), 1);
        assert_eq!(model::m4gn_model_open(i32::MIN, c"/nowhere".as_ptr(), null_mut()), 1);
        assert_eq!(model::m4gn_model_open(i32::MIN, c"/nowhere".as_ptr(), &mut model), 2);
        assert!(model.is_null());
        assert_eq!(model::m4gn_model_n_elastic_modes(model), -1);
        m4gn_model_free(model);
        let mut handle = std::ptr::null_mut();
        assert_eq!(session::m4gn_session_new(i32::MIN, null(), null(), null(), null(), &mut handle), 1);
        assert!(CStr::from_ptr(m4gn_last_error()).to_str().unwrap().contains("mesh: expected"));
        assert!(handle.is_null());
        assert_eq!(session::m4gn_session_step(null_mut(), null(), null(), null()), 1);
        assert_eq!(session::m4gn_session_field(null(), 0, null_mut()), 1);
        assert_eq!(session::m4gn_session_segments(null(), null_mut()), 1);
        assert_eq!(session::m4gn_session_n_fields(null()), -1);
        assert_eq!(session::m4gn_session_n_segments(null()), -1);
        assert_eq!(session::m4gn_session_n_groups(null()), -1);
        assert_eq!(session::m4gn_session_groups(null(), null_mut()), 1);
        assert_eq!(session::m4gn_session_stride(null()), 0.0);
        assert_eq!(options::m4gn_options_check(null(), null()), 1);
        assert_eq!(options::m4gn_options_check(c"session".as_ptr(), null()), 0);
        m4gn_session_free(null_mut());
        assert_eq!(recorder::m4gn_recorder_append(null_mut(), 0.0, null(), null()), 1);
        assert_eq!(recorder::m4gn_recorder_finish(null_mut()), 1);
        assert_eq!(recorder::m4gn_recorder_n_frames(null()), -1);
        m4gn_recorder_free(null_mut());
        assert_eq!(CStr::from_ptr(m4gn_version()).to_str().unwrap(), env!("CARGO_PKG_VERSION"));
        assert_eq!(m4gn_abi_version(), ABI_VERSION);
    }
}

#[test]
fn a_surrogate_of_the_host_names_each_field_once() {
    unsafe extern "C" fn step(_: *mut std::ffi::c_void, _: *const *const f64, _: *const *mut f64) -> i32 {
        0
    }
    let layout = m4gn_state::Layout::new(vec![m4gn_state::Array::solved("U", 1, vec![1.0; 4])]).unwrap();
    let made = |names: &[*const std::ffi::c_char]| {
        let own = SurrogateData {
            name: c"own".as_ptr(),
            stride: 0.1,
            n_fields: names.len() as i32,
            fields: names.as_ptr(),
            step: Some(step),
            data: std::ptr::null_mut(),
        };
        // SAFETY: strings, and an array of as many, that live through the call.
        unsafe { user_surrogate::UserSurrogate::new(&own, m4gn_parallel::Comm::serial(), &layout) }
    };
    assert!(made(&[c"U".as_ptr()]).is_ok());
    let twice = made(&[c"U".as_ptr(), c"U".as_ptr()]).err().unwrap().to_string();
    assert!(twice.contains("'U' is no array") && twice.contains("named twice"), "{twice}");
}
