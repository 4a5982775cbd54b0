//! Generates the PETSc and SLEPc bindings and links both.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libm4gn_slepc.so");
    println!("cargo:rerun-if-changed=wrapper.h");
    let [slepc, petsc, mpi] =
        [("slepc", "libslepc-real-dev"), ("petsc", "libpetsc-real-dev"), ("ompi-c", "libopenmpi-dev")].map(
            |(name, package)| {
                pkg_config::Config::new().cargo_metadata(false).probe(name).unwrap_or_else(|e| {
            panic!("{name} was not found through pkg-config: {e}\nInstall {package} or run setup/debian.sh")
        })
            },
        );
    for dir in slepc.link_paths.iter().chain(&petsc.link_paths) {
        println!("cargo:rustc-link-search=native={}", dir.display());
    }
    println!("cargo:rustc-link-lib=dylib=slepc_real");
    println!("cargo:rustc-link-lib=dylib=petsc_real");

    let includes = [&slepc, &petsc, &mpi].into_iter().flat_map(|l| &l.include_paths);
    let bindings = bindgen::Builder::default()
        .header("wrapper.h")
        .clang_args(includes.map(|p| format!("-I{}", p.display())))
        .allowlist_function("EPS(Create|Destroy|Get.*|Set.*|Solve)")
        .allowlist_function("(Slepc|Petsc)(Initialize|Initialized|Finalize|InitializeNoArguments)")
        .allowlist_function("PetscInitialized|PetscFinalized|PetscErrorMessage|PetscPopErrorHandler")
        .allowlist_function(
            "PetscPushErrorHandler|PetscReturnErrorHandler|PetscOptions(SetValue|ClearValue|HasName)",
        )
        .allowlist_function("Mat(Create|Destroy|SetSizes|SetType|SetOption)")
        .allowlist_function(
            "Mat(Mult|SetBlockSize|CreateVecs|MPIAIJSetPreallocationCSR|SeqAIJSetPreallocationCSR)",
        )
        .allowlist_function(
            "Mat(Duplicate|AXPY|GetFactor|MumpsSetIcntl|CholeskyFactor(Symbolic|Numeric)|FactorGetError|GetInertia)",
        )
        .allowlist_function("MatFactorInfoInitialize|MatGetDiagonal|MatDiagonalScale")
        .allowlist_function("Vec(Destroy|GetArrayRead|RestoreArrayRead|GetLocalSize|SqrtAbs|Reciprocal)")
        .allowlist_function("ST(Set.*|Get.*)")
        .allowlist_function("KSP(Set.*|Get.*)")
        .allowlist_function("PC(SetType|FactorSetMatSolverType|FactorSetMatOrderingType)")
        .allowlist_var("PETSC_(COMM_SELF|COMM_WORLD|VERSION.*|DECIDE|DEFAULT)")
        .blocklist_type("MPI_Comm|ompi_communicator_t")
        .raw_line("pub type MPI_Comm = mpi::ffi::MPI_Comm;")
        .layout_tests(false)
        .generate_comments(false)
        .generate()
        .expect("bindgen failed on wrapper.h: is libclang-dev installed?");
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    bindings.write_to_file(out.join("slepc.rs")).expect("OUT_DIR is writable");
}
