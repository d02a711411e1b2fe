//! `trisplat merge CITY -o OUT.ply`: one scene of the blocks of a plan.

use super::Global;
use super::counts::{many, thousands};
use super::files;
use super::inputs::Inputs;
use super::messages;
use super::outputs::Outputs;
use std::path::PathBuf;
use trisplat_scale::Blocks;
use trisplat_scene::{Error, Result, atomic};

/// What to merge.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// Folder of a plan all of whose blocks are trained, or its manifest.json.
    #[arg(value_name = "CITY")]
    pub city: PathBuf,
    /// Soup to write, .ply.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Replace files that are there.
    #[arg(short, long)]
    pub force: bool,
    /// Write the results at the seams as JSON (schema: trisplat schema merge).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
}

/// Merges.
pub fn run(args: &MergeArgs, global: &Global, inputs: &Inputs) -> Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        let wants = "a name that ends with .ply; bake turns it into .glb";
        return Err(Error::invalid("--output", args.output.display(), wants));
    }
    let blocks = Blocks::open(&args.city, &global.limits()?)?;
    let mut files = Outputs::new(inputs, args.force);
    // The report comes first, so that it exists when the scene does.
    let outputs: Vec<_> =
        args.report.iter().map(|path| ("--report", path)).chain([("--output", &args.output)]).collect();
    let mut set = files.claim_set(&outputs)?;
    let mut scene = set.pop().ok_or_else(|| Error::invalid("--output", "missing", "a file name"))?;
    let report = blocks.merge_into(&mut scene)?;
    for file in &mut set {
        files::print_json(&report, file).map_err(|e| Error::io(file.path(), e))?;
    }
    set.push(scene);
    atomic::publish(set)?;
    if !global.quiet {
        let (triangles, count) = (many(report.triangles, "triangle"), many(blocks.count() as u64, "block"));
        let crossing: u64 = report.blocks.iter().map(|block| block.crossing).sum();
        let crossing = thousands(crossing);
        let out = args.output.display();
        messages::print(&format!("wrote {out}: {triangles} of {count}, {crossing} of them across seams"));
    }
    Ok(())
}
