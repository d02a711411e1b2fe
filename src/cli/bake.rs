//! `trisplat bake IN... -o OUT`.

use super::GlobalArgs;
use super::flags::{self, OptionSources};
use super::inputs::Inputs;
use super::messages::{self, many, thousands};
use super::outputs::Outputs;
use super::progress::Progress;
use super::terminal::Terminal;
use clap::ArgMatches;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;
use trisplat_bake::{BakeOptions, ReshapeDetails, ShDetails, TeacherDetails, TextureWhen};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::info::Softness;
use trisplat_formats::output::OutputFormat;
use trisplat_job::{BakeInput, BakeJob, Baked};
use trisplat_scale::{Blocks, bake_tiles, is_plan};
use trisplat_scene::report::{Report, counted};
use trisplat_scene::{Error, Result};
use trisplat_train::TrainDetails;

/// Bakes; `matches` says which flags were typed.
pub fn run(
    args: &BakeArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<()> {
    let clock = Instant::now();
    let sources = OptionSources { matches, sets: &args.sets, config: args.config.as_deref() };
    let mut options =
        sources.resolve(&args.options, &args.dataset_options.limits, BakeOptions::preset)?.options;
    if args.dataset.is_some() {
        textured_by_itself(&mut options, matches, &args.output);
    }
    if let [plan] = &args.inputs[..]
        && is_plan(plan)
    {
        return bake_blocks(args, plan, options, global, inputs);
    }
    let output = options.plan_output(&args.output, args.format)?;
    let mut outputs = Outputs::new(inputs, args.force);
    let files = outputs.start_scene(&output, args.dry_run, args.report.as_deref())?;

    let read = |path: &PathBuf| Dataset::load(path, &args.dataset_options);
    let photos = args.dataset.as_ref().map(read).transpose()?;
    photos.as_ref().map_or(Ok(()), |photos| outputs.forbid_overwriting_photos(photos))?;
    let job = BakeJob {
        inputs: args.inputs.iter().cloned().map(BakeInput::File).collect(),
        options,
        photos,
        dataset_options: args.dataset_options.clone(),
        harden: args.harden,
        max_bytes: args.max_bytes.map(|size| size.0),
        began: Some(clock),
    };
    let mut terminal = Terminal::new(global, flags::command_of::<BakeArgs>("bake"));
    let Baked { mut report, .. } = job.write(&output, files, &mut |event| terminal.tell(event))?;
    report.dry_run = args.dry_run;
    say(&report, &terminal.done());
    outputs.save_report(args.report.as_deref(), &report)
}

/// Phones show no colours of corners in USDZ: photos become a texture unless `--texture` was typed.
pub(super) fn textured_by_itself(options: &mut BakeOptions, matches: &ArgMatches, output: &Path) {
    if OutputFormat::of(output).ok() == Some(OutputFormat::Usdz)
        && !flags::is_typed(matches, "texture")
    {
        options.texture.texture = TextureWhen::On;
    }
}

/// The lines after the stages of a bake.
fn say(report: &Report, progress: &Progress) {
    for warning in &report.warnings {
        progress.warn(warning);
    }
    let hardened = report.details::<TrainDetails>();
    let softness = report.details::<TeacherDetails>().and_then(|details| details.softness);
    if let Some(softness) = softness
        && hardened.is_none()
    {
        progress.line(&soft_note(&softness, report.details().as_ref()));
    }
    if let Some(note) = shine_note(report) {
        progress.line(&note);
    }
    progress.wrote(report);
}

/// The gain of view-dependent colours, if the files have some.
pub(super) fn shine_note(report: &Report) -> Option<String> {
    let gain = report.details::<ShDetails>()?.gain()?;
    Some(format!(
        "view-dependent colours gain {gain:.1} dB on photos that they were not fitted to; \
         viewers that do not know them show the plain ones"
    ))
}

/// The softness of the scene, the score of its solid triangles, and a hint.
fn soft_note(softness: &Softness, reshaped: Option<&ReshapeDetails>) -> String {
    let psnr = softness.psnr;
    let pictures = counted(softness.pictures, "picture");
    let gain = reshaped.and_then(|details| Some(details.psnr_last? - details.psnr_first?));
    let fitted = match gain {
        Some(gain) => format!("fitting them to its pictures gained {gain:.1} dB"),
        None => "they were not fitted to its pictures (`reshape`)".to_owned(),
    };
    format!(
        "soft scene: its solid triangles match its soft pictures to {psnr:.1} dB ({pictures}); {fitted}; \
         --harden trains it solid, which takes longer and comes closer"
    )
}

// ---- The flags of `trisplat bake` ---------------------------------------------------------------

/// Files, layers and the options of every stage.
#[derive(Debug, clap::Args)]
pub struct BakeArgs {
    /// Files to bake, .ply .pt .off .obj .glb .gltf .html, or Gaussian splats, .ply .splat .spz
    /// .sog .glb. Several files are merged; "-" is standard input. Gaussian splats are drawn, and
    /// triangles are trained on the pictures: about two minutes of CPU time, less with --preset
    /// fast, more with --harden. The folder of a plan whose blocks are trained is baked into tiles,
    /// block by block.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// File to write: .glb .gltf .obj .ply .usdz .html .tileset.json; "-" is standard output.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Format to write, when the name of OUT does not tell it.
    #[arg(long, value_enum)]
    pub format: Option<OutputFormat>,
    /// Replace OUT if it exists.
    #[arg(short, long)]
    pub force: bool,
    /// Do everything but write.
    #[arg(long)]
    pub dry_run: bool,
    /// JSON file with options; --set and flags override it (schema: trisplat schema bake).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any option of the bake by its key, as in refit=flat; may be given often.
    ///
    /// `trisplat schema bake` and docs/bake.md describe all keys.
    #[arg(long = "set", value_name = "KEY=VALUE", allow_hyphen_values = true)]
    pub sets: Vec<String>,
    /// Write what every stage did as JSON (schema: trisplat schema report).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write at most this many bytes, all files together, as in 5MB.
    ///
    /// The scene keeps the most triangles that fit. A trial measures the size, then the scene is
    /// baked once or twice.
    #[arg(long, value_name = "SIZE")]
    pub max_bytes: Option<ByteSize>,
    /// Posed photos of the scene: removes triangles hidden in all of them, and fits colours to them
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Train a soft scene solid first: minutes, and twice the triangles, for a file that looks like
    /// the soft scene.
    ///
    /// It is trained on the photos of --dataset, or on its own soft pictures, in 2000 steps or N.
    /// Gaussian splats are always trained solid: with it in four times as many steps, on more and
    /// larger pictures.
    #[arg(long, value_name = "STEPS", num_args = 0..=1, require_equals = true, default_missing_value = "2000",
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub harden: Option<u64>,
    /// The options of the stages.
    #[command(flatten)]
    pub options: BakeOptions,
    /// Reading options of the data set.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

// ---- Sizes in bytes, as they are typed ----------------------------------------------------------

/// A size, written as `5000000`, `5MB` or `5M` (millions), `500kB` or `4MiB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ByteSize(pub u64);

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit = match &text[digits.len()..] {
            "" | "B" => 1.0,
            "k" | "K" | "kB" | "KB" => 1e3,
            "M" | "MB" => 1e6,
            "G" | "GB" => 1e9,
            "KiB" => 1024.0,
            "MiB" => f64::from(1 << 20),
            "GiB" => f64::from(1 << 30),
            _ => 0.0,
        };
        let bytes = digits.parse::<f64>().map_or(0.0, |number| number * unit);
        // NaN is in no range.
        if (1.0..=1e15).contains(&bytes) {
            Ok(Self(bytes as u64))
        } else {
            Err("expected a size of 1 byte or more, as in 5MB, 500kB, 4MiB or 5000000".to_owned())
        }
    }
}

// ---- `trisplat bake CITY -o OUT.tileset.json`: the blocks of a plan, one after the other --------

/// Bakes the blocks of `plan`.
fn bake_blocks(
    args: &BakeArgs,
    plan: &Path,
    mut options: BakeOptions,
    global: &GlobalArgs,
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
        let out = args.output.display();
        let folder = done.folder.display();
        let triangles = many(done.triangles, "triangle");
        let bytes = thousands(done.bytes);
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
        (
            args.dataset.is_some(),
            "dataset",
            "a merged scene: blocks are baked one by one, without photos",
        ),
        (args.harden.is_some(), "harden", "a merged scene"),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        for (text, bytes) in [
            ("5000000", 5_000_000),
            ("5MB", 5_000_000),
            ("1.5kB", 1500),
            ("500k", 500_000),
            ("5M", 5_000_000),
            ("4MiB", 4 << 20),
            ("1GB", 1_000_000_000),
            ("7B", 7),
        ] {
            assert_eq!(text.parse(), Ok(ByteSize(bytes)), "{text}");
        }
        for bad in ["", "0", "-1", "nan", "inf", "5 MB", "MB", "5TB", "5mb", "1e16"] {
            assert!(bad.parse::<ByteSize>().is_err(), "{bad}");
        }
    }
}
