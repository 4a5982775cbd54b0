//! Bakes libtorch's folder into the library's run path, so that nothing has to be set to load it.

fn main() {
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    match std::env::var("LIBTORCH") {
        Ok(libtorch) => println!("cargo:rustc-link-arg=-Wl,-rpath,{libtorch}/lib"),
        Err(_) => println!(
            "cargo:warning=LIBTORCH is not set: expected the folder that holds libtorch's include/ and lib/"
        ),
    }
}
