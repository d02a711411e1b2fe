//! The steps that a pose program performs: features, matches, model. Matching continues where an
//! earlier run stopped.

use super::collect::{TakenPhotos, WORK};
use super::log::{Ended, Log, full_path, tell};
use super::program::{Cameras, CaptureOptions, Mapper, Pairing, Places, Program};
use crate::colmap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_scene::atomic::{AtomicFolder, MadeFolders, folder_of};
use trisplat_scene::report::{StageEvent, StageObserver};
use trisplat_scene::{Error, Limits, Result, input};

/// Files of a model.
const MODEL_FILES: [&str; 5] = ["cameras", "images", "points3D", "rigs", "frames"];
/// Database while features are extracted; renamed when all are.
const UNFINISHED: [&str; 4] =
    ["features.db", "features.db-shm", "features.db-wal", "features.db-journal"];
/// Maximum number of photos that are compared exhaustively if there is another way.
const MAX_EXHAUSTIVE_PHOTOS: usize = 150;
/// Number of following frames that a frame is compared with, besides those 16, 32, 64, ... frames
/// later.
const NEIGHBOURS: usize = 10;
/// Number of video frames that are all compared with each other, to close loops.
const LANDMARKS: usize = 40;
/// Maximum number of models whose photos are counted in the report.
const MAX_PARTS: usize = 8;
/// Folder of the models whose lens has no distortion.
const STRAIGHT: &str = "straight";
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
    /// Photos of each of several models, most first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<u64>,
    /// True for a lens of one focal length without distortion: the distortion that was found first
    /// folds over inside the photos.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub straight: bool,
}

trisplat_scene::stage!(FeaturesDetails, "features");

trisplat_scene::stage!(MatchesDetails, "matches");

trisplat_scene::stage!(ModelDetails, "model");

/// A pose program and the capture that it works on.
pub(super) struct Poses<'a> {
    program: Program,
    /// The folder of the capture.
    folder: &'a Path,
    places: Places,
    photos: &'a TakenPhotos,
    options: &'a CaptureOptions,
    log: Log,
}

/// The largest model of one mapper.
struct FoundModel {
    folder: PathBuf,
    details: ModelDetails,
}

/// True if the model is in its place, and its lens can be right.
pub(super) fn has_model(folder: &Path) -> bool {
    colmap::locate(&folder.join("sparse").join("0"))
        .is_some_and(|model| !model.has_folded_lens(&Limits::DEFAULT).is_ok_and(|folds| folds))
}

/// Details of the model that an earlier run has put in its place.
///
/// # Errors
///
/// Another mapper is asked for.
pub(super) fn model_before(
    folder: &Path,
    photos: &TakenPhotos,
    options: &CaptureOptions,
) -> Result<ModelDetails> {
    let models = folder.join(WORK).join("models");
    let asked = options.mapper;
    if asked != Mapper::Auto && models.exists() && !models.join(asked.name()).exists() {
        let wants = "a new folder, as this one has a model already";
        return Err(Error::invalid("mapper", asked.name(), wants));
    }
    let mut best = ModelDetails { photos: photos.photos.len() as u64, ..ModelDetails::default() };
    for mapper in [Mapper::Incremental, Mapper::Global] {
        let found = largest(&models.join(mapper.name()), mapper, photos)?;
        best = found
            .map(|model| model.details)
            .filter(|d| d.registered > best.registered)
            .unwrap_or(best);
    }
    let straight = largest(&models.join(STRAIGHT), Mapper::Incremental, photos)?;
    Ok(straight.map_or(best, |model| ModelDetails { straight: true, ..model.details }))
}

impl<'a> Poses<'a> {
    /// Work on `photos` in `folder`.
    ///
    /// # Errors
    ///
    /// A program that an earlier run has started still works there.
    pub(super) fn begin(
        program: Program,
        folder: &'a Path,
        photos: &'a TakenPhotos,
        options: &'a CaptureOptions,
    ) -> Result<Self> {
        let work = folder.join(WORK);
        let log = Log::open(&work.join("poses.log"))?;
        let full = full_path(&work)?;
        let places = Places {
            images: full_path(&folder.join("images"))?,
            database: full.join("database.db"),
            pairs: full.join("pairs.txt"),
            models: full.join("models"),
        };
        Ok(Self { program, folder, places, photos, options, log })
    }

    /// Finds features in every photo, unless they are there: then false.
    pub(super) fn features(
        &mut self,
        details: &mut FeaturesDetails,
        observer: StageObserver<'_>,
    ) -> Result<bool> {
        let known = self.photos.focal_px.zip(self.photos.size);
        let known = known.map(|(f, [w, h])| [f, f64::from(w) / 2.0, f64::from(h) / 2.0]);
        let cameras = Cameras { by_folder: self.photos.by_folder, known };
        *details = FeaturesDetails {
            program: self.program.version.clone(),
            focal_px: self.photos.focal_px,
        };
        if self.places.database.is_file() {
            return Ok(false);
        }
        // Photos that a second process adds to a database would get a camera of their own: its
        // lens, found from a few photos, may be absurd.
        let work = folder_of(&self.places.database).to_owned();
        for path in UNFINISHED.map(|name| work.join(name)).iter().filter(|path| path.exists()) {
            std::fs::remove_file(path).map_err(|e| Error::io(path, e))?;
        }
        let places = Places { database: work.join(UNFINISHED[0]), ..self.places.clone() };
        self.on_card_or_cpu(observer, |program| program.features(&places, &cameras))?;
        // The database last: it tells that all are found.
        for name in UNFINISHED.iter().rev().filter(|name| work.join(name).exists()) {
            let from = work.join(name);
            let to = work.join(name.replace("features", "database"));
            std::fs::rename(&from, to).map_err(|e| Error::io(from, e))?;
        }
        Ok(true)
    }

    /// Compares photos that have not been compared yet.
    pub(super) fn matches(
        &mut self,
        details: &mut MatchesDetails,
        observer: StageObserver<'_>,
    ) -> Result<()> {
        let tree = self.options.vocab_tree.as_deref().map(full_path).transpose()?;
        let (pairing, pairs) = pairing(self.photos, tree);
        if let Some(pairs) = &pairs {
            self.write_pairs(pairs)?;
        }
        let photos = self.photos.photos.len() as u64;
        let (how, pairs) = match &pairing {
            Pairing::Exhaustive => ("exhaustive", Some(photos * photos.saturating_sub(1) / 2)),
            Pairing::Listed => ("sequence", pairs.map(|pairs| pairs.len() as u64)),
            Pairing::Tree(_) => ("vocabulary tree", None),
        };
        *details = MatchesDetails { how: how.into(), pairs };
        let places = self.places.clone();
        self.on_card_or_cpu(observer, |program| program.matches(&places, &pairing))
    }

    fn write_pairs(&self, pairs: &BTreeSet<(usize, usize)>) -> Result<()> {
        let name = |i: usize| &self.photos.photos[i].name;
        let text: String =
            pairs.iter().map(|&(a, b)| format!("{} {}\n", name(a), name(b))).collect();
        std::fs::write(&self.places.pairs, text).map_err(|e| Error::io(&self.places.pairs, e))
    }

    /// Runs a command that may use a graphics card. If it fails, runs it again without one.
    fn on_card_or_cpu(
        &mut self,
        observer: StageObserver<'_>,
        command: impl Fn(&Program) -> Command,
    ) -> Result<()> {
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
            return Err(self.log.failure(&first, &ended));
        }
        tell(
            observer,
            StageEvent::Noted(&format!("again without the graphics card: {photos} photos")),
        )?;
        self.program.has_gpu = false;
        self.log.run_well(&mut command(&self.program), observer, hear)
    }

    /// Reconstructs poses and puts the best model in its place.
    pub(super) fn model(&mut self, observer: StageObserver<'_>) -> Result<ModelDetails> {
        let can = self.program.global.is_some();
        let asked = self.options.mapper;
        if asked == Mapper::Global && !can {
            let wants = "incremental: this program has no global mapper (COLMAP 4, pycolmap 4 and glomap have)";
            return Err(Error::invalid("mapper", "global", wants));
        }
        let mut best = None;
        let mut failed = None;
        for mapper in [Mapper::Incremental, Mapper::Global] {
            if asked == mapper || (asked == Mapper::Auto && (mapper == Mapper::Incremental || can))
            {
                let (model, error) = self.mapped(mapper, false, observer)?;
                let registered =
                    |found: &Option<FoundModel>| found.as_ref().map(|m| m.details.registered);
                // Ties: the first.
                if registered(&model) > registered(&best) {
                    best = model;
                }
                failed = failed.or(error);
                if registered(&best).unwrap_or(0) as f64 >= ENOUGH * self.photos.photos.len() as f64
                {
                    break;
                }
            }
        }
        let mut best = best.ok_or_else(|| failed.unwrap_or_else(|| self.no_model()))?;
        let files = colmap::locate(&best.folder);
        if files.is_some_and(|files| files.has_folded_lens(&Limits::DEFAULT).unwrap_or(false)) {
            best = self.mapped(Mapper::Incremental, true, observer)?.0.unwrap_or(best);
        }
        self.publish(&best.folder)?;
        Ok(best.details)
    }

    /// Copies a model to the place where data sets have it.
    fn publish(&self, from: &Path) -> Result<()> {
        let made = AtomicFolder::create(self.folder)?;
        for name in
            MODEL_FILES.iter().flat_map(|name| ["bin", "txt"].map(|e| format!("{name}.{e}")))
        {
            let from = from.join(&name);
            if from.is_file() {
                input::copy(&from, &made.place(Path::new("sparse/0").join(name))?)?;
            }
        }
        made.publish("sparse")
    }

    /// The best model of one mapper, of a `straight` lens or any; otherwise none, and the error if
    /// there was one.
    fn mapped(
        &mut self,
        mapper: Mapper,
        straight: bool,
        observer: StageObserver<'_>,
    ) -> Result<(Option<FoundModel>, Option<Error>)> {
        let output = self.places.models.join(if straight { STRAIGHT } else { mapper.name() });
        if output.exists() {
            std::fs::remove_dir_all(&output).map_err(|e| Error::io(&output, e))?;
        }
        // Removed if it stays empty.
        let _made = MadeFolders::make(&output)?;
        let photos = self.photos.photos.len();
        let at_once = mapper == Mapper::Global;
        let mut command = self.program.model(&self.places, &output, at_once, straight);
        let ended: Ended = self.log.run(&mut command, observer, |line, observer| {
            let Some(registered) = registered(line) else { return Ok(()) };
            tell(observer, StageEvent::Progressed(registered as f64 / photos.max(1) as f64))?;
            tell(
                observer,
                StageEvent::Noted(&format!("{registered} of {photos} photos have a pose")),
            )
        })?;
        let mut model = largest(&output, mapper, self.photos)?;
        if let Some(model) = &mut model {
            model.details.straight = straight;
        }
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
        Error::unsupported(self.folder.join("images"), reason)
    }
}

/// The pairing, and its list of pairs if it has one.
fn pairing(
    photos: &TakenPhotos,
    tree: Option<PathBuf>,
) -> (Pairing, Option<BTreeSet<(usize, usize)>>) {
    let photos = &photos.photos;
    if photos.iter().all(|photo| photo.frame) {
        return (Pairing::Listed, Some(sequence_pairs(photos.len())));
    }
    match tree.filter(|_| photos.len() > MAX_EXHAUSTIVE_PHOTOS) {
        Some(tree) => (Pairing::Tree(tree), None),
        None => (Pairing::Exhaustive, None),
    }
}

/// The largest of the models that `mapper` has written to `output`; the program's first one of
/// equals.
fn largest(output: &Path, mapper: Mapper, photos: &TakenPhotos) -> Result<Option<FoundModel>> {
    let mut folders: Vec<PathBuf> = input::entries(output).collect();
    folders.sort();
    let models = folders.into_iter().filter_map(|folder| Some((colmap::locate(&folder)?, folder)));
    let registered = |(files, folder): (colmap::ModelFiles, _)| {
        Ok((files.model(&Limits::DEFAULT, false)?.images.len(), folder))
    };
    let models = models.map(registered).collect::<Result<Vec<(usize, PathBuf)>>>()?;
    let count = models.len() as u64;
    let mut parts: Vec<u64> = models.iter().map(|(registered, _)| *registered as u64).collect();
    parts.sort_unstable_by(|a, b| b.cmp(a));
    parts.truncate(if count > 1 { MAX_PARTS } else { 0 });
    let photos = photos.photos.len() as u64;
    let best = models.into_iter().rev().max_by_key(|(registered, _)| *registered);
    Ok(best.map(|(registered, folder)| {
        let mapper = mapper.name().to_owned();
        FoundModel {
            folder,
            details: ModelDetails {
                mapper,
                registered: registered as u64,
                photos,
                models: count,
                parts,
                straight: false,
            },
        }
    }))
}

/// Pairs of `count` video frames to compare: neighbours, powers of two apart, and all pairs of
/// landmarks.
fn sequence_pairs(count: usize) -> BTreeSet<(usize, usize)> {
    let near = |a: usize| {
        (1..=NEIGHBOURS).chain((4..20).map(|power| 1 << power)).map(move |by| (a, a + by))
    };
    let stride = count.div_ceil(LANDMARKS).max(1);
    let landmarks = move || (0..count).step_by(stride);
    let far = landmarks().flat_map(|a| landmarks().filter(move |b| *b > a).map(move |b| (a, b)));
    (0..count).flat_map(near).filter(|(_, b)| *b < count).chain(far).collect()
}

/// Progress from a line like "Processed file [12/50]" or "Matching block [2/4, 1/4]": done and
/// total.
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
        [(row, rows), (column, columns)] => {
            Some(((row.max(1) - 1) * columns + column, rows * columns))
        }
        _ => None,
    }
}

/// Number of registered photos from a line like "Registering image #29 (num_reg_frames=34)" or
/// "Registering image #29 (34)".
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
        assert_eq!(
            counted("I2026 feature_extraction.cc:270] Processed file [3/50]"),
            Some((3, 50))
        );
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
