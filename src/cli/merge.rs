//! `trisplat merge CITY -o OUT.ply`: one scene of the blocks of a plan.

use super::Global;
use super::counts::{many, thousands};
use super::files;
use super::inputs::Inputs;
use super::messages;
use super::outputs::Outputs;
use std::io::Write;
use std::path::PathBuf;
use trisplat_dataset::{DatasetOptions, ShrunkSize};
use trisplat_scale::{Blocks, SeamQuality, seams};
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
    /// Compare the merged scene with the held-out photos, at seams and elsewhere. Needs the memory of the
    /// whole scene.
    #[arg(long)]
    pub evaluate: bool,
    /// Compare another scene of the same photos at the same places, for example of one run.
    #[arg(long, value_name = "SCENE", requires = "evaluate")]
    pub against: Option<PathBuf>,
    /// How the held-out photos are read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Merges, and compares if requested.
pub fn run(args: &MergeArgs, global: &Global, inputs: &Inputs) -> Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        let wants = "a name that ends with .ply; bake turns it into .glb";
        return Err(Error::invalid("--output", args.output.display(), wants));
    }
    let blocks = Blocks::open(&args.city, &args.dataset_options.limits)?;
    let mut files = Outputs::new(inputs, args.force);
    // The report comes first, so that it exists when the scene does.
    let outputs: Vec<_> =
        args.report.iter().map(|path| ("--report", path)).chain([("--output", &args.output)]).collect();
    let mut set = files.claim_set(&outputs)?;
    let mut scene = set.pop().ok_or_else(|| Error::invalid("--output", "missing", "a file name"))?;
    let mut report = blocks.merge_into(&mut scene)?;
    if args.evaluate {
        scene.flush().map_err(|e| Error::io(&args.output, e))?;
        let against = args.against.iter().map(|path| (path.as_path(), path.as_path()));
        let scenes: Vec<_> = std::iter::once((args.output.as_path(), scene.aside())).chain(against).collect();
        report.quality = seams::compare(&blocks, &scenes, &args.dataset_options)?;
    }
    for file in &mut set {
        files::print_json(&report, file).map_err(|e| Error::io(file.path(), e))?;
    }
    set.push(scene);
    atomic::publish(set)?;
    if !global.quiet {
        let (triangles, count) = (many(report.triangles, "triangle"), many(blocks.len() as u64, "block"));
        let crossing: u64 = report.blocks.iter().map(|block| block.crossing).sum();
        let crossing = thousands(crossing);
        let out = args.output.display();
        messages::print(&format!("wrote {out}: {triangles} of {count}, {crossing} of them across seams"));
        report.quality.iter().for_each(|quality| messages::print(&line(quality)));
    }
    Ok(())
}

fn line(quality: &SeamQuality) -> String {
    let db = |psnr: Option<f64>| psnr.map_or("-".to_owned(), |psnr| format!("{psnr:.2} dB"));
    format!(
        "{}: {:.2} dB over {} held-out photos{}; {} at seams ({:.1}% of the pixels), {} elsewhere",
        quality.scene,
        quality.psnr,
        quality.photos,
        ShrunkSize::beside(quality.photo_size),
        db(quality.seams_psnr),
        100.0 * quality.seams_share,
        db(quality.elsewhere_psnr)
    )
}
