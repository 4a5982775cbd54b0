//! `m4gn shell-files`: manual pages and completions, made from the definitions of the commands.

use clap::CommandFactory;
use clap_complete::Shell;
use m4gn_base::{Error, Result};
use std::path::PathBuf;

/// Write manual pages (man1) and completions of shells (bash, zsh, fish)
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for them
    #[arg(value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: Args) -> Result<()> {
    let write = |e: std::io::Error| Error::file(&args.out, format!("cannot be written: {e}"));
    let pages = args.out.join("man1");
    std::fs::create_dir_all(&pages).map_err(write)?;
    let mut command = super::Cli::command();
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut command, "m4gn", &args.out).map_err(write)?;
    }
    clap_mangen::generate_to(command, pages).map_err(write)
}
