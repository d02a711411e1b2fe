//! `trisplat man FOLDER`: manual pages of the program and its commands.

use crate::atomic::AtomicFolder;
use crate::error::{Error, Result};
use std::path::PathBuf;

/// The page that names all others.
const PROGRAM_PAGE: &str = "trisplat.1";

/// Where to.
#[derive(Debug, clap::Args)]
pub struct ManArgs {
    /// Folder for the pages; made when it is not there. Pages in it are replaced.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Writes trisplat.1, trisplat-bake.1 and so on.
pub fn run(args: &ManArgs, program: clap::Command) -> Result<()> {
    let folder = AtomicFolder::create(&args.folder)?;
    clap_mangen::generate_to(program, folder.path()).map_err(|e| Error::io(&args.folder, e))?;
    folder.publish(PROGRAM_PAGE)
}
