//! `trisplat merge CITY -o OUT.ply`: one scene of the blocks of a plan.

use super::Global;
use super::counts::many;
use super::inputs::Inputs;
use super::messages;
use super::outputs::Outputs;
use std::path::PathBuf;
use trisplat_scale::Blocks;
use trisplat_scene::{Error, Result};

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
}

/// Merges.
pub fn run(args: &MergeArgs, global: &Global, inputs: &Inputs) -> Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        let wants = "a name that ends with .ply; bake turns it into .glb";
        return Err(Error::invalid("--output", args.output.display(), wants));
    }
    let blocks = Blocks::open(&args.city, &global.limits()?)?;
    let mut files = Outputs::new(inputs, args.force);
    files.claim("--output", &args.output)?;
    let mut scene = files.take(&args.output)?;
    let triangles = blocks.merge_into(&mut scene)?;
    scene.commit()?;
    if !global.quiet {
        let (triangles, count) = (many(triangles, "triangle"), many(blocks.count() as u64, "block"));
        messages::print(&format!("wrote {}: {triangles} of {count}", args.output.display()));
    }
    Ok(())
}
