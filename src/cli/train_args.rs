//! The flags of `trisplat train`.

use super::teacher_args::TeacherArgs;
use clap::builder::ArgPredicate;
use std::path::PathBuf;
use std::str::FromStr;
use trisplat_dataset::DatasetOptions;
use trisplat_train::budget::Seconds;
use trisplat_train::{BackendOptions, TrainOptions};

/// Options that a plan sets for all its blocks.
const BLOCK_FIXES: [&str; 16] = [
    "output",
    "config",
    "sets",
    "from",
    "teacher",
    "resume",
    "checkpoint",
    "keep",
    "eval_every",
    "curve",
    "budget",
    "budget_wall",
    "preset",
    "steps",
    "max_triangles",
    "seed",
];

/// A block of a plan.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockAddress {
    /// The plan's file or folder.
    pub plan: PathBuf,
    /// The block.
    pub index: usize,
}

impl FromStr for BlockAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.rsplit_once(':').and_then(|(plan, index)| Some((plan, index.parse().ok()?)));
        match parts.filter(|(plan, _)| !plan.is_empty()) {
            Some((plan, index)) => Ok(Self { plan: plan.into(), index }),
            None => Err("expected a plan and the number of a block, as in city/manifest.json:17".to_owned()),
        }
    }
}

/// Files, outputs, and the options of the training.
#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    /// Folder of posed photos (COLMAP model or transforms.json). Without it the scene of --from teaches
    /// itself: it is drawn from its stored cameras and from between them, or from chosen places.
    #[arg(value_name = "DATASET", required_unless_present_any = ["from", "block"])]
    pub dataset: Option<PathBuf>,
    /// Soup to write, .ply.
    #[arg(
        short,
        long,
        value_name = "OUT",
        required = false,
        required_unless_present = "block",
        default_value_if("block", ArgPredicate::IsPresent, "block.ply"),
        hide_default_value = true
    )]
    pub output: PathBuf,
    /// Train one block of a plan that `trisplat plan` wrote, as in city/manifest.json:17. Its result goes
    /// beside the plan, under a name with a hash of its inputs. An existing result is kept, and a stopped
    /// training continues. DATASET, if given, is the present place of the photos.
    #[arg(long, value_name = "PLAN:BLOCK", conflicts_with_all = BLOCK_FIXES)]
    pub block: Option<BlockAddress>,
    /// Replace files that are there.
    #[arg(short, long)]
    pub force: bool,
    /// JSON file with training options; --set and flags override it.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any training option by its key, as in densify.every=500; may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Start from a scene instead of points: a soup (.ply .pt), soft or not, or a mesh (.glb .gltf .obj .ply
    /// .off); --preset solid hardens it.
    #[arg(long, value_name = "SCENE")]
    pub from: Option<PathBuf>,
    /// A soft scene beside the photos.
    #[command(flatten)]
    pub teacher: TeacherArgs,
    /// Resume from a checkpoint, or from the newest whole one of a folder, with its options. Photos, cameras
    /// and --background must be unchanged.
    #[arg(long, value_name = "FILE|FOLDER")]
    pub resume: Option<PathBuf>,
    /// Resume even if photos, cameras or --background have changed.
    #[arg(long, requires = "resume")]
    pub force_resume: bool,
    /// File or folder for checkpoints; OUT with the ending .checkpoint unless given.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Write a checkpoint every N steps; 0: only when stopped with Ctrl-C or SIGTERM.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub checkpoint_every: u64,
    /// Keep the last K checkpoints; above 1 their names contain the number of steps, as in
    /// OUT.step-00000500.checkpoint.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub keep: u32,
    /// Write one JSON line per sample of the curve; "-" is standard output.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// Steps between samples; 0: a hundred samples per run.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub log_every: u64,
    /// Evaluate on the held-out photos every N steps, not counted as training; 0: only at the end.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub eval_every: u64,
    /// Write the results of the run as JSON (schema: trisplat schema report).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Draw PSNR and triangles over CPU seconds, as SVG.
    #[arg(long, value_name = "FILE")]
    pub curve: Option<PathBuf>,
    /// Folder for pictures of the first held-out photo while training.
    #[arg(long, value_name = "FOLDER")]
    pub preview: Option<PathBuf>,
    /// Seconds between preview pictures.
    #[arg(long, value_name = "SECS", default_value_t = 10.0, value_parser = seconds)]
    pub preview_every: f64,
    /// Watch the scene in a window while it trains, baked as it is or soft. Closing the window does not end
    /// the training.
    #[arg(long, conflicts_with = "block")]
    pub view: bool,
    /// Stop like Ctrl-C after this many CPU seconds; 0: never.
    #[arg(long, value_name = "SECS", default_value_t = 0.0, value_parser = seconds)]
    pub max_cpu_secs: f64,
    /// Choose steps, triangles and the size of photos so that the command takes this much CPU time, on all
    /// cores together: 90, 30s, 2m or 1.5h. Given values of --max-triangles and --max-size are kept.
    #[arg(long, value_name = "TIME", conflicts_with_all = ["steps", "budget_wall"])]
    pub budget: Option<Seconds>,
    /// Like --budget, in wall-clock time.
    #[arg(long, value_name = "TIME", conflicts_with = "steps")]
    pub budget_wall: Option<Seconds>,
    /// Where to train.
    #[command(flatten, next_help_heading = "Backend")]
    pub backend_options: BackendOptions,
    /// The photos.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
    /// The training.
    #[command(flatten)]
    pub options: TrainOptions,
}

/// The longest permitted time, in seconds: thirty years.
const LONGEST: f64 = 1e9;

fn seconds(text: &str) -> Result<f64, String> {
    let wants = || format!("expected seconds, 0 to {LONGEST:.0}");
    text.parse().ok().filter(|secs| (0.0..=LONGEST).contains(secs)).ok_or_else(wants)
}
