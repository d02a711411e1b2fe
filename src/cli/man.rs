//! `trisplat man FOLDER`: manual pages of the program and its commands.

use crate::error::{Error, Result};
use std::path::PathBuf;

/// Where to.
#[derive(Debug, clap::Args)]
pub struct ManArgs {
    /// Folder for the pages; made when it is not there. Pages in it are replaced.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Writes trisplat.1, trisplat-bake.1 and so on.
pub fn run(args: &ManArgs, program: clap::Command) -> Result<()> {
    let io = |e| Error::io(&args.folder, e);
    std::fs::create_dir_all(&args.folder).map_err(io)?;
    clap_mangen::generate_to(program, &args.folder).map_err(io)
}
