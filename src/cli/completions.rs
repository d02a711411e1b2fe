//! `trisplat completions SHELL`.

use super::Cli;
use crate::error::{Error, Result};
use clap::CommandFactory;
use std::io::Write;

/// Which shell.
#[derive(Debug, clap::Args)]
pub struct CompletionsArgs {
    /// The shell to complete for.
    pub shell: clap_complete::Shell,
}

/// Prints the completion script to standard output.
pub fn run(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "trisplat", &mut script);
    std::io::stdout().write_all(&script).map_err(|e| Error::io("-", e))
}
