//! Compiles the fused operations of `cpp/` against libtorch, and bakes libtorch's folder into the library's run
//! path, so that nothing has to be set to load it.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    println!("cargo:rerun-if-changed=cpp");
    let Ok(libtorch) = std::env::var("LIBTORCH") else {
        println!(
            "cargo:warning=LIBTORCH is not set: expected the folder that holds libtorch's include/ and lib/"
        );
        return;
    };
    println!("cargo:rustc-link-arg=-Wl,-rpath,{libtorch}/lib");
    let x86 = std::env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|arch| arch == "x86_64");
    let sets: &[(&str, &str)] = if x86 {
        &[("base", "x86-64"), ("v3", "x86-64-v3"), ("v4", "x86-64-v4")]
    } else {
        &[("base", "native")]
    };
    for (name, machine) in sets {
        let mut build = cc::Build::new();
        build.cpp(true).std("c++17").opt_level(3).file("cpp/kernels.cpp").define("M4GN_ISA", *name);
        // Sums may be reordered, so that they become vectors; NaN and infinity stay what they are.
        for flag in ["-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math"] {
            build.flag(flag);
        }
        if x86 {
            build.define("M4GN_X86", None).flag(format!("-march={machine}"));
            build.flag_if_supported("-mprefer-vector-width=512");
        }
        build.compile(&format!("m4gn_kernels_{name}"));
    }
    let mut build = cc::Build::new();
    build.cpp(true).std("c++17").file("cpp/fused.cpp").warnings(false);
    if x86 {
        build.define("M4GN_X86", None);
    }
    let include = Path::new(&libtorch).join("include");
    build.include(&include).include(include.join("torch/csrc/api/include"));
    build.compile("m4gn_fused");
}
