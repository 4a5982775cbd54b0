//! Compiles the C++ side against OpenFOAM's headers and links OpenFOAM's libraries with their folder baked in.
//!
//! Where OpenFOAM is comes from `setup/openfoam.sh --export` as environment variables: `M4GN_FOAM_INCLUDES`
//! (folders, separated by ':'), `M4GN_FOAM_LIBDIR`, `M4GN_FOAM_MPI_LIBDIR` (where `libPstream.so` is),
//! `M4GN_FOAM_DEFINES` (separated by spaces, with or without -D) and `M4GN_FOAM_CXXSTD`.

use std::path::{Path, PathBuf};
use std::{env, fs, process::exit};

const HINT: &str = "Type\n    eval \"$(setup/openfoam.sh --export)\"\nbefore cargo, or build with setup/build.sh, which does. \
    The headers of Debian's OpenFOAM are fetched by setup/openfoam-source.sh.";

/// Debian's libOpenFOAM is v1912 with 32-bit labels and doubles.
const DEFINES: &str = "OPENFOAM=1912 WM_DP WM_LABEL_SIZE=32 NoRepository";

const LIBRARIES: [&str; 6] =
    ["OpenFOAM", "finiteVolume", "meshTools", "reconstruct", "genericPatchFields", "Pstream"];

/// Sources of the bridge, and those that it shares with the function objects: one way to turn an fvMesh into arrays.
const SOURCES: &[&str] = &[
    "FoamCase.C",
    "FoamFields.C",
    "FoamSolids.C",
    "FoamMesh.C",
    "FoamWrite.C",
    "../../openfoam/case/m4gnNodes.C",
    "../../openfoam/case/m4gnNodeTypes.C",
    "../../openfoam/case/m4gnDictionary.C",
    "../../openfoam/case/m4gnFieldFiles.C",
    "../../openfoam/case/m4gnSegmentField.C",
    "../../openfoam/case/m4gnElasticBody.C",
    "../../openfoam/case/m4gnElasticMaterial.C",
    "../../openfoam/case/m4gnMechanicalProperties.C",
];

/// What they include, beside the header of each.
const HEADERS: &[&str] = &["FoamData.H", "../include/m4gn.h", "../../openfoam/case/m4gnVersion.H"];

fn stop(message: &str) -> ! {
    eprintln!("error: the OpenFOAM bridge cannot be built: {message}.\n{HINT}");
    exit(1)
}

fn variable(name: &str) -> Option<String> {
    println!("cargo:rerun-if-env-changed={name}");
    env::var(name).ok().filter(|v| !v.trim().is_empty())
}

/// Files that include the sources, one for each folder: OpenFOAM's headers are most of a source's compile time.
fn gathered() -> Vec<PathBuf> {
    let out = PathBuf::from(env::var("OUT_DIR").expect("set by Cargo"));
    let here = env::current_dir().expect("the folder of this crate");
    let (shared, own): (Vec<&str>, Vec<&str>) = SOURCES.iter().partition(|file| file.starts_with(".."));
    let gather = |name: &str, sources: Vec<&str>| {
        let lines = sources.iter().map(|file| format!("#include \"{}\"\n", here.join(file).display()));
        let file = out.join(name);
        fs::write(&file, lines.collect::<String>()).expect("OUT_DIR can be written to");
        file
    };
    vec![gather("bridge.C", own), gather("case.C", shared)]
}

fn main() {
    for file in SOURCES.iter().chain(HEADERS).chain(&["lib.rs"]) {
        // A file that is not there counts as changed each time
        assert!(Path::new(file).exists(), "{file} is not there");
        println!("cargo:rerun-if-changed={file}");
        let header = Path::new(file).with_extension("H");
        if header.exists() {
            println!("cargo:rerun-if-changed={}", header.display());
        }
    }
    let Some(includes) = variable("M4GN_FOAM_INCLUDES") else {
        stop("M4GN_FOAM_INCLUDES, the folders of OpenFOAM's headers, is not set")
    };
    let lib_dir = variable("M4GN_FOAM_LIBDIR").unwrap_or_else(|| "/usr/lib".into());
    let mpi_dir = variable("M4GN_FOAM_MPI_LIBDIR").unwrap_or_else(|| lib_dir.clone());
    let defines = variable("M4GN_FOAM_DEFINES").unwrap_or_else(|| DEFINES.into());
    let standard = variable("M4GN_FOAM_CXXSTD").unwrap_or_else(|| "14".into());

    let includes: Vec<&str> = includes.split(':').filter(|d| !d.is_empty()).collect();
    for header in ["Time.H", "fvMesh.H", "fvFieldReconstructor.H"] {
        if !includes.iter().any(|d| Path::new(d).join(header).exists()) {
            stop(&format!(
                "{header} is in none of the folders of M4GN_FOAM_INCLUDES ({})",
                includes.join(", ")
            ))
        }
    }
    for library in LIBRARIES {
        let name = format!("lib{library}.so");
        if !Path::new(&lib_dir).join(&name).exists() && !Path::new(&mpi_dir).join(&name).exists() {
            stop(&format!(
                "{name} is neither in {lib_dir} nor in {mpi_dir} (M4GN_FOAM_LIBDIR, M4GN_FOAM_MPI_LIBDIR)"
            ))
        }
    }

    let mut build = cxx_build::bridge("lib.rs");
    build.files(gathered()).includes([".", "../../openfoam/case", "../include"]).warnings(false);
    // OpenFOAM's headers are not ours to warn about.
    for dir in &includes {
        build.flag(format!("-isystem{dir}"));
    }
    for define in defines.split_whitespace() {
        let define = define.strip_prefix("-D").unwrap_or(define);
        let (name, value) = define.split_once('=').map_or((define, None), |(n, v)| (n, Some(v)));
        build.define(name, value);
    }
    // ListLoopM.H of v1912 puts __restrict__ on pointers that do alias: with it, GCC 12 gives wrong tensor products.
    build.define("__restrict__", "");
    build.flag(format!("-std=c++{standard}")).flag("-Wno-old-style-cast").flag("-fno-math-errno");
    // It copies numbers, and is the last to be built.
    build.opt_level(1).debug(false);
    build.compile("m4gn_foam_case");

    println!("cargo:rustc-link-search=native={lib_dir}");
    println!("cargo:rustc-link-search=native={mpi_dir}");
    for library in LIBRARIES {
        println!("cargo:rustc-link-lib=dylib={library}");
    }
    // RPATH, not RUNPATH: OpenFOAM's own libraries find each other through it too.
    println!("cargo:rustc-cdylib-link-arg=-Wl,--disable-new-dtags,-rpath,{mpi_dir},-rpath,{lib_dir}");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libm4gn_foam_bridge.so");
    // genericPatchFields registers its types when it is loaded; no symbol of it is called.
    println!("cargo:rustc-cdylib-link-arg=-Wl,--no-as-needed,-lgenericPatchFields,--as-needed");
}
