//! `trisplat bake CITY -o OUT.tileset.json`: the blocks of a plan, one after the other.

use super::Global;
use super::bake_args::BakeArgs;
use super::counts::{many, thousands};
use super::inputs::Inputs;
use super::messages;
use super::outputs::Outputs;
use std::path::Path;
use std::time::Instant;
use trisplat_bake::BakeOptions;
use trisplat_scale::{Blocks, NAME, bake_tiles};
use trisplat_scene::{Error, Result};

/// Whether a path is a plan of a scene in blocks, or its folder.
pub(super) fn is_plan(path: &Path) -> bool {
    path.join(NAME).is_file() || path.file_name().is_some_and(|name| name == NAME)
}

/// Bakes the blocks of `plan`.
pub(super) fn run(
    args: &BakeArgs,
    plan: &Path,
    mut options: BakeOptions,
    global: &Global,
    inputs: &Inputs,
) -> Result<()> {
    let clock = Instant::now();
    check(args, &options)?;
    let output = options.plan_output(&args.output, args.format)?;
    if !options.tiles.tiles {
        let wants = "a name ending in .tileset.json; for one file merge the blocks first";
        return Err(Error::invalid("output", args.output.display(), wants));
    }
    let blocks = Blocks::open(plan, &args.dataset_options.limits)?;
    Outputs::new(inputs, args.force).plan_scene(&output)?;
    let mut say = |index: usize, triangles: u64| {
        if global.verbose {
            messages::print(&format!("block {index}: {}", many(triangles, "triangle")));
        }
    };
    let done = bake_tiles(&blocks, &args.output, &options, &mut say)?;
    if !global.quiet {
        let (out, folder) = (args.output.display(), done.folder.display());
        let (triangles, bytes) = (many(done.triangles, "triangle"), thousands(done.bytes));
        let seconds = clock.elapsed().as_secs_f64();
        let count = many(blocks.count() as u64, "block");
        messages::print(&format!(
            "wrote {out} and {folder}: {triangles} of {count} ({bytes} bytes, {seconds:.2} s)"
        ));
    }
    Ok(())
}

/// Refuses options that need the whole scene at once.
fn check(args: &BakeArgs, options: &BakeOptions) -> Result<()> {
    let refused = [
        (args.dataset.is_some(), "dataset", "a merged scene: blocks are baked one by one, without photos"),
        (args.harden.harden.is_some(), "harden", "a merged scene"),
        (args.max_bytes.is_some(), "max_bytes", "a merged scene"),
        (args.report.is_some(), "report", "a merged scene"),
        (args.dry_run, "dry_run", "a merged scene"),
        (options.collision.collision, "collision", "a merged scene"),
        (options.texture.is_wanted(), "texture", "a merged scene"),
        (options.prune.max_triangles.is_some(), "max_triangles", "a merged scene"),
    ];
    match refused.iter().find(|(is, ..)| *is) {
        Some((_, option, wants)) => Err(Error::invalid(*option, "given with a plan", *wants)),
        None => Ok(()),
    }
}
