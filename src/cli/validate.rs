//! `trisplat validate FILE`: what stops a file from being read, and what engines reject.

use super::messages;
use std::io::{self, Write};
use std::path::PathBuf;
use trisplat_formats::ReadOptions;
use trisplat_formats::check::{Checked, Severity, check};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Result};

/// What to check.
#[derive(Debug, clap::Args)]
pub struct ValidateArgs {
    /// File to check: .ply, .splat, .spz, .sog, .pt, .off, .obj, .glb or .gltf; "-" is standard input.
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Print JSON (`trisplat schema validation` describes it).
    #[arg(long)]
    pub json: bool,
}

/// Lists every finding on `out`; an error when any of them is one.
pub fn run(args: &ValidateArgs, options: &ReadOptions, out: &mut dyn Write) -> Result<()> {
    let checked = check(&args.input, options)?;
    let printed = if args.json { messages::print_json(&checked, out) } else { print(&checked, out) };
    printed.map_err(|e| Error::io("-", e))?;
    match checked.count(Severity::Error) {
        0 => Ok(()),
        n => Err(Error::malformed(
            &args.input,
            "validation",
            format!("{}, listed above", counted(n as u64, "error")),
        )),
    }
}

fn print(checked: &Checked, out: &mut dyn Write) -> io::Result<()> {
    for finding in &checked.findings {
        let severity = match finding.severity {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        messages::write(out, &format!("{severity:<8} {}: {}", finding.place, finding.what))?;
    }
    let triangles = checked.triangles.map_or(String::new(), |n| format!(", {}", counted(n, "triangle")));
    let counts = [(Severity::Error, "error"), (Severity::Warning, "warning"), (Severity::Note, "note")]
        .map(|(severity, name)| counted(checked.count(severity) as u64, name))
        .join(", ");
    messages::write(out, &format!("{}: {}{triangles}: {counts}", checked.path, checked.format.name()))
}
