//! Options of a capture. Pose programs: finds an installed one and builds its commands.

use super::log::{program, said};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_scene::{Error, Result, parallel};

/// Environment variable that names the program if the option `poses` does not.
const VARIABLE: &str = "TRISPLAT_POSES";
/// Script that drives pycolmap.
const SCRIPT: &str = include_str!("poses.py");
/// Longer side of pictures for feature detection, px. Twice this costs four times as much.
const FEATURE_SIDE: u32 = 2000;

/// An installed program that finds poses.
#[derive(Debug, Clone)]
pub(super) struct Program {
    kind: ProgramKind,
    path: PathBuf,
    /// "COLMAP 3.8", "pycolmap 4.2.1".
    pub(super) version: String,
    /// True when it can use a graphics card.
    pub(super) has_gpu: bool,
    /// Its global mapper, which finds all poses at once.
    pub(super) global: Option<GlobalMapper>,
    /// CPU threads that it may use.
    pub(super) threads: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ProgramKind {
    Colmap,
    Pycolmap,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum GlobalMapper {
    /// A command of the program itself.
    Own,
    /// A separate program, [`GLOMAP`].
    Glomap,
}

/// Paths that the program reads and writes.
#[derive(Debug, Clone)]
pub(super) struct Places {
    pub(super) images: PathBuf,
    pub(super) database: PathBuf,
    /// A list of the pairs to compare.
    pub(super) pairs: PathBuf,
    /// Folder of the models.
    pub(super) models: PathBuf,
}

/// The cameras of the photos.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cameras {
    /// One camera per folder; otherwise one for all.
    pub(super) by_folder: bool,
    /// Focal length and principal point of the one camera, px.
    pub(super) known: Option<[f64; 3]>,
}

/// The pairs of photos to compare.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Pairing {
    /// All pairs.
    Exhaustive,
    /// Pairs from a list.
    Listed,
    /// Similar photos, by a vocabulary tree.
    Tree(PathBuf),
}

impl Program {
    /// The requested program, or the first installed one. `input` is named in the error.
    ///
    /// # Errors
    ///
    /// No program is installed.
    pub(super) fn find(options: &CaptureOptions, input: &Path) -> Result<Self> {
        if let Some(path) = named(options) {
            let found = if is_python(&path) { Self::pycolmap(&path) } else { Self::colmap(&path) };
            let wants = "a colmap program, or a Python that has pycolmap";
            return found.ok_or_else(|| Error::invalid("poses", path.display(), wants));
        }
        let found = Self::colmap(Path::new("colmap"))
            .or_else(|| PYTHONS.iter().find_map(|python| Self::pycolmap(Path::new(python))));
        found.ok_or_else(|| {
            let reason = "needs camera poses, and no program that finds them is installed (neither colmap, nor pycolmap in the Python of \
                          this shell). Install one: `pip install pycolmap` (any system with Python), `sudo apt install colmap` (Debian, \
                          Ubuntu), `brew install colmap` (macOS), or the archive from https://github.com/colmap/colmap/releases \
                          (Windows). One that is elsewhere is named with `poses`";
            Error::unsupported(input, reason)
        })
    }

    fn colmap(path: &Path) -> Option<Self> {
        let text = said(program(path).arg("help"))?;
        let first = text.lines().find(|line| line.starts_with("COLMAP"))?;
        let version = first.split(['-', '(']).next().unwrap_or(first).trim().to_owned();
        let own = text.contains("global_mapper").then_some(GlobalMapper::Own);
        let glomap = || said(program(GLOMAP.as_ref()).arg("-h")).map(|_| GlobalMapper::Glomap);
        let threads = parallel::threads();
        let global = own.or_else(glomap);
        let has_gpu = !text.contains("without CUDA");
        Some(Self {
            kind: ProgramKind::Colmap,
            path: path.to_owned(),
            version,
            has_gpu,
            global,
            threads,
        })
    }

    fn pycolmap(path: &Path) -> Option<Self> {
        let job = r#"{"step": "probe"}"#;
        let text = said(program(path).args(["-c", &python_script(SCRIPT), job]))?;
        let line = text.lines().find(|line| line.starts_with("pycolmap "))?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let version = format!("{} {}", words[0], words.get(1).unwrap_or(&""));
        let global = words.contains(&"global").then_some(GlobalMapper::Own);
        let threads = parallel::threads();
        Some(Self {
            kind: ProgramKind::Pycolmap,
            path: path.to_owned(),
            version,
            has_gpu: false,
            global,
            threads,
        })
    }

    /// The command that finds features in the photos.
    pub(super) fn features(&self, places: &Places, cameras: &Cameras) -> Command {
        let [f, x, y] = cameras.known.unwrap_or_default();
        let params =
            if cameras.known.is_some() { format!("{f:.3},{x},{y},0") } else { String::new() };
        if self.kind == ProgramKind::Pycolmap {
            return self.script(json!({
                "step": "features", "database": places.database, "images": places.images, "params": params,
                "folders": cameras.by_folder, "max_size": FEATURE_SIDE, "threads": self.threads,
            }));
        }
        let mut words = HelpText::of(&self.path, "feature_extractor");
        words.path("--database_path", &places.database).path("--image_path", &places.images);
        words.add("--ImageReader.camera_model", "SIMPLE_RADIAL");
        let shared = if cameras.by_folder { "single_camera_per_folder" } else { "single_camera" };
        words.add(&format!("--ImageReader.{shared}"), "1");
        if cameras.known.is_some() {
            words.add("--ImageReader.camera_params", &params);
        }
        let extraction = ["FeatureExtraction", "SiftExtraction"];
        words.known(&extraction, "max_image_size", &FEATURE_SIDE.to_string());
        words.known(&extraction, "num_threads", &self.threads.to_string());
        words.known(&extraction, "use_gpu", if self.has_gpu { "1" } else { "0" });
        words.command
    }

    /// The command that compares photos.
    pub(super) fn matches(&self, places: &Places, pairing: &Pairing) -> Command {
        if self.kind == ProgramKind::Pycolmap {
            let tree = if let Pairing::Tree(tree) = pairing { Some(tree) } else { None };
            let pairs = (*pairing == Pairing::Listed).then_some(&places.pairs);
            return self.script(json!({
                "step": "matches", "database": places.database, "pairs": pairs, "tree": tree, "threads": self.threads,
            }));
        }
        let name = match pairing {
            Pairing::Exhaustive => "exhaustive_matcher",
            Pairing::Listed => "matches_importer",
            Pairing::Tree(_) => "vocab_tree_matcher",
        };
        let mut words = HelpText::of(&self.path, name);
        words.path("--database_path", &places.database);
        match pairing {
            Pairing::Exhaustive => {}
            Pairing::Listed => {
                words.path("--match_list_path", &places.pairs).add("--match_type", "pairs");
            }
            Pairing::Tree(tree) => {
                words.path("--VocabTreeMatching.vocab_tree_path", tree);
            }
        }
        let matching = ["FeatureMatching", "SiftMatching"];
        words.known(&matching, "num_threads", &self.threads.to_string());
        words.known(&matching, "use_gpu", if self.has_gpu { "1" } else { "0" });
        words.command
    }

    /// The command that puts poses together, all at once or photo by photo; with `straight` the
    /// lens keeps straight lines straight.
    pub(super) fn model(
        &self,
        places: &Places,
        output: &Path,
        at_once: bool,
        straight: bool,
    ) -> Command {
        if self.kind == ProgramKind::Pycolmap {
            return self.script(json!({
                "step": "model", "database": places.database, "images": places.images, "output": output,
                "global": at_once, "straight": straight, "threads": self.threads,
            }));
        }
        let glomap = at_once && self.global == Some(GlobalMapper::Glomap);
        let program = if glomap { Path::new(GLOMAP) } else { &self.path };
        let name = if at_once && !glomap { "global_mapper" } else { "mapper" };
        let mut words = HelpText::of(program, name);
        words.path("--database_path", &places.database).path("--image_path", &places.images);
        words.path("--output_path", output);
        if !at_once {
            words.known(&["Mapper"], "num_threads", &self.threads.to_string());
        }
        if straight {
            words.known(&["Mapper"], "ba_refine_extra_params", "0");
        }
        words.command
    }

    fn script(&self, job: serde_json::Value) -> Command {
        let mut command = program(&self.path);
        command.args(["-c", &python_script(SCRIPT), &job.to_string()]);
        command
    }
}

/// A COLMAP command and its help text: option names differ between versions.
struct HelpText {
    command: Command,
    help: String,
}

impl HelpText {
    fn of(path: &Path, name: &str) -> Self {
        let help = said(program(path).args([name, "-h"])).unwrap_or_default();
        let mut command = program(path);
        command.arg(name);
        // Without a display, Qt would abort.
        command.env("QT_QPA_PLATFORM", "offscreen");
        Self { command, help }
    }

    fn add(&mut self, option: &str, value: &str) -> &mut Self {
        self.command.args([option, value]);
        self
    }

    fn path(&mut self, option: &str, value: &Path) -> &mut Self {
        self.command.arg(option).arg(value);
        self
    }

    /// The option in the first of these groups that has it.
    fn known(&mut self, groups: &[&str], option: &str, value: &str) {
        let names = groups.iter().map(|group| format!("--{group}.{option}"));
        if let Some(name) = names.into_iter().find(|name| self.help.contains(name.as_str())) {
            self.add(&name, value);
        }
    }
}

/// A separate global mapper.
const GLOMAP: &str = "glomap";
const PYTHONS: [&str; 2] = if cfg!(windows) { ["python", "py"] } else { ["python3", "python"] };

/// The program that the option or the variable names.
fn named(options: &CaptureOptions) -> Option<PathBuf> {
    let path = options.poses.clone().or_else(|| std::env::var_os(VARIABLE).map(PathBuf::from));
    path.filter(|path| !path.as_os_str().is_empty())
}

fn is_python(path: &Path) -> bool {
    path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase().starts_with("py")
}

/// The Python that was named, and those of this shell.
pub(super) fn pythons(options: &CaptureOptions) -> Vec<PathBuf> {
    named(options)
        .filter(|path| is_python(path))
        .into_iter()
        .chain(PYTHONS.map(PathBuf::from))
        .collect()
}

/// Complete a script so that it imports nothing from the folder where Python runs.
pub(super) fn python_script(script: &str) -> String {
    format!("import sys\nsys.path[:] = filter(None, sys.path)\n{script}")
}

/// Options for frames of videos and for poses.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[cfg_attr(feature = "cli", command(next_help_heading = "Capture"))]
#[serde(default, deny_unknown_fields)]
pub struct CaptureOptions {
    /// Maximum number of frames of each video; fewer if the camera moves little.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 150, value_parser = clap::value_parser!(u32).range(2..=10_000)))]
    pub frames: u32,
    /// Pose program: a colmap, or a Python with pycolmap; by default the one in TRISPLAT_POSES, or
    /// the first that is installed.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PROGRAM"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<PathBuf>,
    /// Order in which poses are reconstructed.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub mapper: Mapper,
    /// A vocabulary tree of COLMAP. It chooses the pairs to compare if there are more than 150
    /// photos.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vocab_tree: Option<PathBuf>,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self { frames: 150, poses: None, mapper: Mapper::default(), vocab_tree: None }
    }
}

/// Order in which poses are reconstructed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Mapper {
    /// Photo by photo; if many stay without a pose, also all at once, and the better of the two.
    #[default]
    Auto,
    /// Photo by photo.
    Incremental,
    /// All at once (GLOMAP).
    Global,
}

impl Mapper {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Incremental => "incremental",
            Self::Global => "global",
        }
    }
}
