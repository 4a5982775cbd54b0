//! Names the library that solvers load, and keeps it loaded.

fn main() {
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libm4gn.so");
    // OpenFOAM unloads libraries before MPI ends, and parallel HDF5 has asked MPI to call it at that moment.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
}
