//! The command lines of the settings: this program, with the flags that differ.

use super::draw::DrawArgs;
use super::knobs::CostStage;
use super::setting::Setting;
use crate::bake::BakeOptions;
use crate::dataset::DatasetOptions;
use crate::error::{Error, Result};
use crate::report::Report;
use crate::train::TrainOptions;
use clap::{Args, Command};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What the commands of all settings have in common.
#[derive(Debug, Clone)]
pub(super) struct Child {
    program: PathBuf,
    dataset: PathBuf,
    dataset_options: DatasetOptions,
    threads: u16,
}

impl Child {
    /// Commands of this program on a data set.
    pub(super) fn new(dataset: &Path, dataset_options: &DatasetOptions, threads: u16) -> Result<Self> {
        let program = std::env::current_exe().map_err(|e| Error::io("trisplat", e))?;
        Ok(Self { program, dataset: dataset.into(), dataset_options: dataset_options.clone(), threads })
    }

    /// Trains with the options of `setting` over `steps` and `max_triangles`, and with more flags; the report is beside the output.
    pub(super) fn train(&self, output: &Path, setting: &Setting, more: &[(&str, String)]) -> Vec<OsString> {
        let mut words = self.words(&["train"]);
        words.push(self.dataset.clone().into());
        words.extend(self.photos(setting));
        words.extend(["-o".into(), output.into(), "--report".into(), output.with_extension("json").into()]);
        // A teacher would be trained as well, and judged with what is changed.
        words.extend(["--teacher".into(), "off".into()]);
        let of_setting = |name: &str| setting.changes.iter().any(|(changed, _)| *changed == name);
        let more = more.iter().filter(|(name, _)| !of_setting(name)).cloned();
        let changes = more.chain(setting.changes.iter().cloned());
        words.extend(flags(&arguments(CostStage::Train), changes));
        words
    }

    /// Bakes `soup` with the options of `setting`, with the photos if wanted.
    pub(super) fn bake(
        &self,
        soup: &Path,
        output: &Path,
        report: &Path,
        setting: &Setting,
        photos: bool,
    ) -> Vec<OsString> {
        let mut words = self.words(&["bake"]);
        words.extend([soup.into(), "-o".into(), output.into(), "--report".into(), report.into()]);
        if photos {
            words.extend(["--dataset".into(), self.dataset.clone().into()]);
            // A scene of few steps may be farther from its own photos than no scene is.
            words.extend(["--set".into(), "force_dataset=true".into()]);
            words.extend(self.photos(setting));
        }
        words.extend(flags(&arguments(CostStage::Bake), setting.changes.iter().cloned()));
        words
    }

    /// Draws `scene` from the held-out photos' cameras for `seconds`.
    pub(super) fn draw(
        &self,
        scene: &Path,
        figures: &Path,
        seconds: f64,
        setting: &Setting,
    ) -> Vec<OsString> {
        let mut words = self.words(&["bench", "draw"]);
        words.retain(|word| word != "--force");
        words.extend([scene.into(), self.dataset.clone().into(), "--figures".into(), figures.into()]);
        words.push(format!("--seconds={seconds}").into());
        words.extend(self.photos(setting));
        words.extend(flags(&arguments(CostStage::Draw), setting.changes.iter().cloned()));
        words
    }

    fn words(&self, command: &[&str]) -> Vec<OsString> {
        let mut words = vec![self.program.clone().into_os_string()];
        words.extend(command.iter().map(OsString::from));
        words.extend(["--quiet".into(), "--force".into()]);
        if self.threads > 0 {
            words.push(format!("--threads={}", self.threads).into());
        }
        words
    }

    /// How the data set is read: what differs from the defaults and is not changed by `setting`.
    fn photos(&self, setting: &Setting) -> Vec<OsString> {
        let as_json = |options: &DatasetOptions| serde_json::to_value(options).unwrap_or_default();
        let (own, default) = (as_json(&self.dataset_options), as_json(&DatasetOptions::default()));
        let fields = own.as_object().into_iter().flatten();
        let differ = fields.filter(|(name, value)| {
            default.get(name.as_str()) != Some(value) && !setting.changes.iter().any(|(k, _)| k == name)
        });
        let changes = differ.map(|(name, value)| {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            (name.as_str(), text)
        });
        flags(&DatasetOptions::augment_args(Command::new("photos")), changes)
    }
}

/// What a child reported.
pub(super) fn read_report(path: &Path) -> Result<Report> {
    let text = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    serde_json::from_slice(&text).map_err(|e| Error::malformed(path, "report", e.to_string()))
}

/// The arguments that a stage's command has.
fn arguments(stage: CostStage) -> Command {
    let command = Command::new(stage.name()).no_binary_name(true);
    match stage {
        CostStage::Train | CostStage::Chain => {
            TrainOptions::augment_args(DatasetOptions::augment_args(command)).arg(sets())
        }
        CostStage::Bake => BakeOptions::augment_args(DatasetOptions::augment_args(command)).arg(sets()),
        CostStage::Draw => DrawArgs::augment_args(command),
    }
}

fn sets() -> clap::Arg {
    clap::Arg::new("sets").long("set").action(clap::ArgAction::Append)
}

/// Flags for changes: `--max-triangles=2000`, and for what is no argument `--set refine.every=500`.
fn flags<'a>(arguments: &Command, changes: impl Iterator<Item = (&'a str, String)>) -> Vec<OsString> {
    let mut words = Vec::new();
    for (name, value) in changes {
        match arguments.get_arguments().find(|a| a.get_id() == name).and_then(|a| Some((a, a.get_long()?))) {
            Some((argument, long)) if argument.get_action().takes_values() => {
                words.push(format!("--{long}={value}").into());
            }
            Some((_, long)) if value == "true" => words.push(format!("--{long}").into()),
            Some(_) => (),
            None => words.extend(["--set".into(), format!("{name}={value}").into()]),
        }
    }
    words
}

/// Why the command of a setting would refuse its options, if it would.
#[cfg(test)]
pub(super) fn refused(setting: &Setting) -> Option<String> {
    use crate::layered::Layers;

    let arguments = arguments(setting.stage);
    let mut words = flags(&arguments, setting.changes.iter().cloned());
    if setting.stage == CostStage::Draw {
        words.extend(["scene.glb", "photos", "--figures", "f.json"].map(OsString::from));
    }
    let matches = match arguments.try_get_matches_from(words) {
        Ok(matches) => matches,
        Err(error) => return Some(error.to_string()),
    };
    let sets = |matches: &clap::ArgMatches| -> Vec<String> {
        matches.get_many("sets").into_iter().flatten().cloned().collect()
    };
    let checked = match setting.stage {
        CostStage::Train => Layers::default()
            .settings(&sets(&matches))
            .resolve(TrainOptions::preset)
            .and_then(|layered| layered.options.validate()),
        CostStage::Bake => Layers::default()
            .settings(&sets(&matches))
            .resolve(BakeOptions::preset)
            .and_then(|layered| layered.options.validate()),
        CostStage::Draw | CostStage::Chain => Ok(()),
    };
    checked.err().map(|error| error.to_string())
}
