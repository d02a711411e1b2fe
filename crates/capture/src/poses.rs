//! The steps that a pose program performs: features, matches, model. Matching continues where an earlier run stopped; others begin again.

use super::logged::{Ended, Log};
use super::options::{CaptureOptions, Mapper};
use super::program::{Cameras, Pairing, Places, Program};
use super::step::{Step, tell};
use super::stored::StoredPhotos;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_dataset::{DatasetOptions, Tracks, tracks};
use trisplat_scene::{
    Error, Result,
    atomic::MadeFolders,
    report::{StageDetails, StageEvent, StageObserver},
};

/// Most photos that are compared exhaustively if there is another way.
const MOST_EXHAUSTIVE: usize = 150;
/// Number of following frames that a frame is compared with, besides those 16, 32, 64, ... frames later.
const NEIGHBOURS: usize = 10;
/// Number of video frames that are all compared with each other, to close loops.
const LANDMARKS: usize = 40;
/// Share of registered photos below which the other mapper is tried too.
const ENOUGH: f64 = 0.9;

/// Details of feature detection.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FeaturesDetails {
    /// The program and its version.
    pub program: String,
    /// Initial focal length from EXIF, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
}

/// Details of feature matching.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct MatchesDetails {
    /// "exhaustive", "sequence" or "vocabulary tree".
    pub how: String,
    /// Number of compared pairs; absent if the program chose them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pairs: Option<u64>,
}

/// Details of the reconstruction.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ModelDetails {
    /// "incremental" or "global".
    pub mapper: String,
    /// Photos with a pose.
    pub registered: u64,
    /// Number of photos.
    pub photos: u64,
    /// Number of separate models; the largest is kept.
    pub models: u64,
}

impl StageDetails for FeaturesDetails {
    const STAGE: &'static str = "features";
}

impl StageDetails for MatchesDetails {
    const STAGE: &'static str = "matches";
}

impl StageDetails for ModelDetails {
    const STAGE: &'static str = "model";
}

/// A pose program and the capture that it works on.
pub(super) struct Poses<'a> {
    pub(super) program: Program,
    pub(super) places: Places,
    pub(super) photos: &'a StoredPhotos,
    pub(super) options: &'a CaptureOptions,
    pub(super) log: Log,
}

/// What each step depends on: with the same key it is not repeated.
pub(super) struct StepKeys {
    pub(super) features: String,
    pub(super) matches: String,
    pub(super) model: String,
}

impl StepKeys {
    pub(super) fn of(program: &Program, photos: &StoredPhotos, options: &CaptureOptions) -> Self {
        let features = format!("{} {}", photos.key, program.version);
        let matches = format!("{features} {:?}", pairing(photos, options).0);
        let model = format!("{matches} {}", options.mapper.name());
        Self { features, matches, model }
    }
}

/// A model and its details.
pub(super) struct FoundModel {
    pub(super) folder: PathBuf,
    pub(super) details: ModelDetails,
}

impl Poses<'_> {
    /// Finds features in every photo, in an empty database.
    pub(super) fn features(
        &mut self,
        details: &mut FeaturesDetails,
        observer: StageObserver<'_>,
    ) -> Step<()> {
        let known = self.photos.focal_px.zip(self.photos.size);
        let known = known.map(|(f, [w, h])| [f, f64::from(w) / 2.0, f64::from(h) / 2.0]);
        let cameras = Cameras { by_folder: self.photos.by_folder, known };
        *details = FeaturesDetails { program: self.program.version.clone(), focal_px: self.photos.focal_px };
        let places = self.places.clone();
        self.on_card_or_cpu(observer, |program| program.features(&places, &cameras))
    }

    /// Compares photos that have not been compared yet.
    pub(super) fn matches(&mut self, details: &mut MatchesDetails, observer: StageObserver<'_>) -> Step<()> {
        let (pairing, pairs) = pairing(self.photos, self.options);
        if let Some(pairs) = &pairs {
            self.write_pairs(pairs)?;
        }
        let photos = self.photos.photos.len() as u64;
        *details = match &pairing {
            Pairing::Exhaustive => MatchesDetails {
                how: "exhaustive".into(),
                pairs: Some(photos * photos.saturating_sub(1) / 2),
            },
            Pairing::Listed => {
                MatchesDetails { how: "sequence".into(), pairs: pairs.map(|pairs| pairs.len() as u64) }
            }
            Pairing::Tree(_) => MatchesDetails { how: "vocabulary tree".into(), pairs: None },
        };
        let places = self.places.clone();
        self.on_card_or_cpu(observer, |program| program.matches(&places, &pairing))
    }

    fn write_pairs(&self, pairs: &BTreeSet<(usize, usize)>) -> Result<()> {
        let name = |i: usize| &self.photos.photos[i].name;
        let text: String = pairs.iter().map(|&(a, b)| format!("{} {}\n", name(a), name(b))).collect();
        std::fs::write(&self.places.pairs, text).map_err(|e| Error::io(&self.places.pairs, e))
    }

    /// Runs a command that may use a graphics card. If it fails, runs it again without one.
    fn on_card_or_cpu(
        &mut self,
        observer: StageObserver<'_>,
        command: impl Fn(&Program) -> Command,
    ) -> Step<()> {
        let photos = self.photos.photos.len();
        let hear = |line: &str, observer: StageObserver<'_>| {
            let Some((done, all)) = counted(line) else { return Ok(()) };
            tell(observer, StageEvent::Progressed(done as f64 / all.max(1) as f64))?;
            tell(observer, StageEvent::Noted(&format!("{done} of {all}")))
        };
        let mut first = command(&self.program);
        let ended = self.log.run(&mut first, observer, hear)?;
        if ended.status.success() {
            return Ok(());
        }
        if !self.program.has_gpu {
            return Err(self.log.failure(&first, &ended).into());
        }
        tell(observer, StageEvent::Noted(&format!("again without the graphics card: {photos} photos")))?;
        self.program = self.program.on_cpu();
        self.log.run_well(&mut command(&self.program), observer, hear)
    }

    /// Reconstructs poses and chooses the best model.
    pub(super) fn model(&mut self, observer: StageObserver<'_>) -> Step<FoundModel> {
        let can = self.program.has_global();
        let mut found = Vec::new();
        let mut failed = None;
        for at_once in [false, true] {
            let wanted = match self.options.mapper {
                Mapper::Incremental => !at_once,
                Mapper::Global => at_once,
                Mapper::Auto => !at_once || (can && !self.is_enough(found.first())),
            };
            if wanted && at_once && !can {
                let wants =
                    "incremental: this program has no global mapper (COLMAP 4, pycolmap 4 and glomap have)";
                return Err(Error::invalid("mapper", "global", wants).into());
            }
            if wanted {
                let (model, error) = self.mapped(at_once, observer)?;
                found.extend(model);
                failed = failed.or(error);
            }
        }
        // Ties: the first.
        let best = found.into_iter().rev().max_by_key(|model: &FoundModel| model.details.registered);
        best.ok_or_else(|| failed.unwrap_or_else(|| self.no_model()).into())
    }

    fn is_enough(&self, found: Option<&FoundModel>) -> bool {
        found.is_some_and(|model| model.details.registered as f64 >= ENOUGH * self.photos.photos.len() as f64)
    }

    /// The best model of one mapper; otherwise none, and the error if there was one.
    fn mapped(
        &mut self,
        at_once: bool,
        observer: StageObserver<'_>,
    ) -> Step<(Option<FoundModel>, Option<Error>)> {
        let mapper = if at_once { Mapper::Global } else { Mapper::Incremental };
        let output = self.places.models.join(mapper.name());
        if output.exists() {
            std::fs::remove_dir_all(&output).map_err(|e| Error::io(&output, e))?;
        }
        // Removed if it stays empty.
        let _made = MadeFolders::make(&output)?;
        let photos = self.photos.photos.len();
        let mut command = self.program.model(&self.places, &output, at_once);
        let ended: Ended = self.log.run(&mut command, observer, |line, observer| {
            let Some(registered) = registered(line) else { return Ok(()) };
            tell(observer, StageEvent::Progressed(registered as f64 / photos.max(1) as f64))?;
            tell(observer, StageEvent::Noted(&format!("{registered} of {photos} photos have a pose")))
        })?;
        let models = models(&output)?;
        let count = models.len() as u64;
        let best = models.into_iter().rev().max_by_key(|(_, tracks)| tracks.photos.len());
        let model = best.map(|(folder, tracks)| FoundModel {
            folder,
            details: ModelDetails {
                mapper: mapper.name().to_owned(),
                registered: tracks.photos.len() as u64,
                photos: photos as u64,
                models: count,
            },
        });
        // COLMAP exits with an error if photos do not fit together.
        let no_model = ["failed to create", "No good initial image pair", "no model"];
        let says = ended.said.iter().any(|line| no_model.iter().any(|words| line.contains(words)));
        let failed = !ended.status.success() && !says;
        let error = (model.is_none() && failed).then(|| self.log.failure(&command, &ended));
        Ok((model, error))
    }

    fn no_model(&self) -> Error {
        let reason = "no two of these photos fit together: they need texture and overlap, and a camera that moves sideways and does not \
                      only turn (docs/from-photos.md says how to take them)";
        Error::unsupported(&self.places.images, reason)
    }
}

/// The pairing, and its list of pairs if it has one.
fn pairing(photos: &StoredPhotos, options: &CaptureOptions) -> (Pairing, Option<BTreeSet<(usize, usize)>>) {
    let photos = &photos.photos;
    let tree = options.vocab_tree.clone();
    if photos.iter().all(|photo| photo.frame) {
        return (Pairing::Listed, Some(sequence_pairs(photos.len())));
    }
    match tree.filter(|_| photos.len() > MOST_EXHAUSTIVE) {
        Some(tree) => (Pairing::Tree(tree), None),
        None => (Pairing::Exhaustive, None),
    }
}

/// The models in `output`, the program's first one first.
fn models(output: &Path) -> Result<Vec<(PathBuf, Tracks)>> {
    let entries = std::fs::read_dir(output).map_err(|e| Error::io(output, e))?;
    let mut folders: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| p.is_dir()).collect();
    folders.sort();
    let is_model =
        |folder: &PathBuf| ["bin", "txt"].iter().any(|e| folder.join(format!("images.{e}")).is_file());
    folders.retain(is_model);
    let how = DatasetOptions::default();
    folders.into_iter().map(|folder| tracks(&folder, &how).map(|found| (folder, found))).collect()
}

/// Pairs of `count` video frames to compare: neighbours, powers of two apart, and all pairs of landmarks.
fn sequence_pairs(count: usize) -> BTreeSet<(usize, usize)> {
    let near = |a: usize| (1..=NEIGHBOURS).chain((4..20).map(|power| 1 << power)).map(move |by| (a, a + by));
    let stride = count.div_ceil(LANDMARKS).max(1);
    let landmarks = move || (0..count).step_by(stride);
    let far = landmarks().flat_map(|a| landmarks().filter(move |b| *b > a).map(move |b| (a, b)));
    (0..count).flat_map(near).filter(|(_, b)| *b < count).chain(far).collect()
}

/// Progress from a line like "Processed file [12/50]" or "Matching block [2/4, 1/4]": done and total.
fn counted(line: &str) -> Option<(u64, u64)> {
    let starts = ["Processed file [", "Matching block [", "Matching image ["];
    let (_, rest) = starts.iter().find_map(|start| line.split_once(start))?;
    let parts: Vec<(u64, u64)> = rest
        .split_once(']')?
        .0
        .split(',')
        .map(|part| {
            let (done, all) = part.trim().split_once('/')?;
            Some((done.parse().ok()?, all.parse().ok()?))
        })
        .collect::<Option<_>>()?;
    match parts[..] {
        [(done, all)] => Some((done, all)),
        [(row, rows), (column, columns)] => Some(((row.max(1) - 1) * columns + column, rows * columns)),
        _ => None,
    }
}

/// Number of registered photos from a line like "Registering image #29 (num_reg_frames=34)" or "Registering image #29 (34)".
fn registered(line: &str) -> Option<u64> {
    let (_, rest) = line.split_once("Registering image #")?;
    let digits = rest.split_once('(')?.1.trim_start_matches("num_reg_frames=");
    digits.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_several_versions_say_how_far_it_is() {
        assert_eq!(counted("I2026 feature_extraction.cc:270] Processed file [3/50]"), Some((3, 50)));
        assert_eq!(counted("Matching block [2/4, 1/4] in 2.6s"), Some((5, 16)));
        assert_eq!(counted("Matching block [7/9]"), Some((7, 9)));
        assert_eq!(counted("Name: [1/2]"), None);
        assert_eq!(registered("x] Registering image #29 (num_reg_frames=34)"), Some(34));
        assert_eq!(registered("Registering image #29 (34)"), Some(34));
        assert_eq!(registered("Registering nothing"), None);
    }

    #[test]
    fn frames_are_compared_with_their_neighbours_and_with_landmarks() {
        let few = sequence_pairs(30);
        assert_eq!(few.len(), 30 * 29 / 2, "all of a few");
        let many = sequence_pairs(400);
        assert!(many.contains(&(7, 17)) && many.contains(&(7, 7 + 64)) && many.contains(&(0, 390)));
        assert!(!many.contains(&(7, 390)) && many.len() < 400 * 20, "{}", many.len());
        assert!(many.iter().all(|&(a, b)| a < b && b < 400));
        assert!(sequence_pairs(1).is_empty());
    }
}
