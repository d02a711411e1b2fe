//! The flags of `trisplat train`.

use clap::builder::ArgPredicate;
use clap::{ArgMatches, Args, Command};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use trisplat_dataset::DatasetOptions;
use trisplat_job::{MAX_TEACHER_SHARE, TEACHER_FILE, TeacherSource};
use trisplat_scene::Error;
use trisplat_train::budget::Seconds;
use trisplat_train::{BackendOptions, TrainOptions};

/// Options that a plan sets for all its blocks.
const BLOCK_FIXES: [&str; 15] = [
    "output",
    "config",
    "sets",
    "from",
    "teacher",
    "resume",
    "checkpoint",
    "keep",
    "eval_every",
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
        let parts =
            text.rsplit_once(':').and_then(|(plan, index)| Some((plan, index.parse().ok()?)));
        match parts.filter(|(plan, _)| !plan.is_empty()) {
            Some((plan, index)) => Ok(Self { plan: plan.into(), index }),
            None => {
                Err("expected a plan and the number of a block, as in city/manifest.json:17"
                    .to_owned())
            }
        }
    }
}

/// Files, outputs, and the options of the training.
#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    /// Folder of posed photos (COLMAP model or transforms.json). Without it the scene of --from
    /// teaches itself: it is drawn from its stored cameras and from between them, or from chosen
    /// places.
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
    /// Train one block of a plan that `trisplat plan` wrote, as in city/manifest.json:17. Its
    /// result goes beside the plan, under a name with a hash of its inputs. An existing result is
    /// kept, and a stopped training continues. DATASET, if given, is the present place of the
    /// photos.
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
    /// Start from a scene instead of points: a soup (.ply .pt), soft or not, or a mesh (.glb .gltf
    /// .obj .ply .off); --preset solid hardens it.
    #[arg(long, value_name = "SCENE")]
    pub from: Option<PathBuf>,
    /// A soft scene beside the photos.
    #[command(flatten)]
    pub teacher: TeacherArgs,
    /// Resume from a checkpoint, or from the newest whole one of a folder, with its options.
    /// Photos, cameras and --background must be unchanged.
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
    /// Folder for pictures of the first held-out photo while training.
    #[arg(long, value_name = "FOLDER")]
    pub preview: Option<PathBuf>,
    /// Seconds between preview pictures.
    #[arg(long, value_name = "SECS", default_value_t = 10.0, value_parser = seconds)]
    pub preview_every: f64,
    /// Watch the scene in a window while it trains, baked as it is or soft. Closing the window does
    /// not end the training.
    #[arg(long, conflicts_with = "block")]
    #[cfg_attr(
        not(feature = "view"),
        arg(help = "Watch the scene in a window while it trains (not in this build)")
    )]
    pub view: bool,
    /// Stop like Ctrl-C after this many CPU seconds of this run; 0: never.
    #[arg(long, value_name = "SECS", default_value_t = 0.0, value_parser = seconds)]
    pub max_cpu_secs: f64,
    /// Choose steps, triangles and the size of photos so that the command takes this much CPU time,
    /// on all cores together: 90, 30s, 2m or 1.5h. Given values of --max-triangles and --max-size
    /// are kept.
    #[arg(long, value_name = "TIME", conflicts_with_all = ["steps", "budget_wall"])]
    pub budget: Option<Seconds>,
    /// Like --budget, in wall-clock time.
    #[arg(long, value_name = "TIME", conflicts_with = "steps")]
    pub budget_wall: Option<Seconds>,
    /// Training backend.
    #[command(flatten, next_help_heading = "Backend")]
    pub backend_options: BackendOptions,
    /// The photos.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
    /// The training.
    #[command(flatten)]
    pub options: TrainOptions,
}

/// A share below 1, which leaves some steps to the photos.
fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=MAX_TEACHER_SHARE).contains(share));
    share.ok_or_else(|| format!("a number from 0 to {MAX_TEACHER_SHARE}"))
}

/// The longest permitted time, in seconds: thirty years.
const LONGEST: f64 = 1e9;

fn seconds(text: &str) -> Result<f64, String> {
    let wants = || format!("expected seconds, 0 to {LONGEST:.0}");
    text.parse().ok().filter(|secs| (0.0..=LONGEST).contains(secs)).ok_or_else(wants)
}

// ---- The flags of a training's teacher ----------------------------------------------------------

/// The teacher: a soft scene beside the photos.
#[derive(Debug, clap::Args)]
pub struct TeacherArgs {
    /// Also train on pictures of this soft scene, drawn from half way between neighbouring photos.
    /// auto: train one first and keep it as OUT.teacher.ply. off: no teacher, as by default. It may
    /// help a room of few photos; most captures lose by it, so compare both with eval.
    #[arg(long, value_name = "SCENE|auto|off", requires = "dataset")]
    pub teacher: Option<TeacherSource>,
    /// Share of the steps that use these pictures, 0 to 0.9, at most one picture per place between
    /// the photos. Two thirds by default.
    #[arg(long, value_name = "SHARE", requires = "teacher", value_parser = share)]
    pub teacher_share: Option<f64>,
}

/// Refuses a name that is not a soup's.
pub(super) fn check_ply(output: &Path) -> trisplat_scene::Result<()> {
    if output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        let wants = "a name that ends with .ply; bake turns it into .glb";
        return Err(Error::invalid("--output", output.display(), wants));
    }
    Ok(())
}

/// The path of a teacher that is trained for `output`.
pub(super) fn teacher_path(output: &Path) -> PathBuf {
    output.with_extension(TEACHER_FILE)
}

// ---- The command that continues a training that was stopped -------------------------------------

/// Flags that apply only to this part of the run.
const ONCE: [&str; 4] = ["resume", "force_resume", "force", "max_cpu_secs"];

/// Names of the options that a checkpoint holds: a resumed run keeps them.
pub(super) fn fixed() -> Vec<String> {
    let options = TrainOptions::augment_args(Command::new("options"));
    let named = options.get_arguments().map(|arg| arg.get_id().to_string());
    named.chain(["config", "sets", "budget", "budget_wall"].map(String::from)).collect()
}

/// The command to type: all typed flags, without options that the checkpoint stores.
pub(super) fn command(matches: &ArgMatches, args: &TrainArgs, checkpoint: &Path) -> String {
    let fixed = fixed();
    let mut words = vec!["trisplat train".to_owned()];
    words.extend(args.dataset.iter().map(|path| quoted(&path.to_string_lossy())));
    for arg in TrainArgs::augment_args(Command::new("train")).get_arguments() {
        let id = arg.get_id().as_str();
        let is_repeated = !ONCE.contains(&id) && !fixed.iter().any(|name| name == id);
        let Some(long) = arg.get_long() else { continue };
        if !is_repeated || !super::flags::is_typed(matches, id) {
            continue;
        }
        let values =
            matches.get_raw(id).into_iter().flatten().map(|v| quoted(&v.to_string_lossy()));
        if arg.get_action().takes_values() {
            words.extend(values.map(|value| format!("--{long} {value}")));
        } else {
            words.push(format!("--{long}"));
        }
    }
    words.push(format!("--force --resume {}", quoted(&checkpoint.to_string_lossy())));
    words.join(" ")
}

/// A word quoted for the shells of this system.
pub(super) fn quoted(word: &str) -> String {
    if cfg!(windows) { quoted_for_windows(word) } else { quoted_for_posix(word) }
}

/// True for a word that no shell changes; `more` are characters that are plain on one system only.
fn is_plain(word: &str, more: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=+".contains(c) || more.contains(c);
    !word.is_empty() && word.chars().all(plain)
}

fn quoted_for_posix(word: &str) -> String {
    if is_plain(word, ",@%") {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// For `cmd` and PowerShell, which both understand double quotes; names of files contain none.
fn quoted_for_windows(word: &str) -> String {
    if is_plain(word, "\\") { word.to_owned() } else { format!("\"{word}\"") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::FromArgMatches;

    fn after(typed: &[&str]) -> String {
        let words = [&["train", "photos", "-o", "x.ply"], typed].concat();
        let matches = TrainArgs::augment_args(Command::new("train")).get_matches_from(words);
        let args = TrainArgs::from_arg_matches(&matches).expect("parsed");
        command(&matches, &args, Path::new("x.checkpoint"))
    }

    #[cfg(unix)]
    #[test]
    fn the_command_repeats_what_the_checkpoint_does_not_hold() {
        assert_eq!(
            after(&[]),
            "trisplat train photos --output x.ply --force --resume x.checkpoint"
        );
        let typed = [
            "--steps",
            "70",
            "--set",
            "densify.every=5",
            "--max-size",
            "300",
            "--test-every=4",
            "--skip-broken",
        ];
        let more = [
            "--background",
            "#ffffff",
            "--log",
            "a log.jsonl",
            "--max-cpu-secs",
            "3",
            "--images",
            "it's",
        ];
        assert_eq!(
            after(&[&typed[..], &more].concat()),
            "trisplat train photos --output x.ply --log 'a log.jsonl' --max-size 300 --test-every 4 --skip-broken \
             --images 'it'\\''s' --background '#ffffff' --force --resume x.checkpoint"
        );
    }

    #[test]
    fn words_for_windows_are_in_double_quotes() {
        assert_eq!(quoted_for_windows(r"C:\scans\a.log"), r"C:\scans\a.log");
        assert_eq!(quoted_for_windows(r"C:\my scans\it's.log"), r#""C:\my scans\it's.log""#);
        assert_eq!(quoted_for_windows(""), r#""""#);
    }

    #[test]
    fn what_a_checkpoint_holds_is_named_by_the_options_themselves() {
        let fixed = fixed();
        for id in ["preset", "steps", "max_triangles", "sh_degree", "seed", "config", "sets"] {
            assert!(fixed.iter().any(|name| name == id), "{id}");
        }
        assert!(!fixed.iter().any(|name| name == "max_size"));
    }
}
