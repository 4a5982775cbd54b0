//! The command line `m4gn`.

fn main() -> std::process::ExitCode {
    m4gn::cli::main()
}
