//! What is generated from the flags: manual pages (`trisplat man FOLDER`) and completions (`trisplat completions SHELL`).

use super::files::Stdout;
use clap_mangen::Man;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result, atomic::AtomicFolder};

/// The main page, which names all others.
const PROGRAM_PAGE: &str = "trisplat.1";

/// Where to.
#[derive(Debug, clap::Args)]
pub struct ManArgs {
    /// Folder for the pages; made if missing. Pages in it are replaced.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Writes trisplat.1, trisplat-bake.1 and so on.
pub fn man(args: &ManArgs, program: clap::Command) -> Result<()> {
    let folder = AtomicFolder::create(&args.folder)?;
    let mut program = program.disable_help_subcommand(true);
    program.build();
    write_pages(program, folder.path()).map_err(|e| Error::io(&args.folder, e))?;
    folder.publish(PROGRAM_PAGE)
}

/// Writes the pages of a command and its subcommands, each in one write, because rendering into a file would
/// take hundreds.
fn write_pages(command: clap::Command, folder: &Path) -> std::io::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()).cloned() {
        write_pages(below, folder)?;
    }
    let page = Man::new(command);
    let mut text = Vec::new();
    page.render(&mut text)?;
    std::fs::write(folder.join(page.get_filename()), text)
}

/// Which shell.
#[derive(Debug, clap::Args)]
pub struct CompletionsArgs {
    /// The shell to complete for.
    pub shell: clap_complete::Shell,
}

/// Prints the completion script of `program` to standard output.
pub fn completions(args: &CompletionsArgs, program: &mut clap::Command) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, program, "trisplat", &mut script);
    Stdout.write_all(&script).map_err(|e| Error::io("-", e))
}
