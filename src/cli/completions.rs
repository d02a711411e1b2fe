//! `trisplat completions SHELL`.

use super::stdout::Stdout;
use clap::Command;
use std::io::Write;
use trisplat_scene::{Error, Result};

/// Which shell.
#[derive(Debug, clap::Args)]
pub struct CompletionsArgs {
    /// The shell to complete for.
    pub shell: clap_complete::Shell,
}

/// Prints the completion script of `program` to standard output.
pub fn run(args: &CompletionsArgs, program: &mut Command) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, program, "trisplat", &mut script);
    Stdout.write_all(&script).map_err(|e| Error::io("-", e))
}
