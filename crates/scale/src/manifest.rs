//! The plan of a scene that is trained in blocks: `manifest.json`, which every task reads and none
//! writes.

use crate::region::BlockRegion;
use glam::{UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};
use trisplat_dataset::DatasetOptions;
use trisplat_formats::{self as formats, ReadOptions, ply};
use trisplat_scene::atomic::{AtomicFile, folder_of, put, sweep_folder};
use trisplat_scene::camera::Camera;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, SceneNormalization, Soup, input,
};
use trisplat_train::{Core, TrainOptions};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// The layout written and read; it changes whenever a key does.
pub(super) const FORMAT: u32 = 6;
/// The name of the plan in its folder.
pub const NAME: &str = "manifest.json";

/// True for a plan of a scene in blocks, or its folder.
pub fn is_plan(path: &Path) -> bool {
    path.join(NAME).is_file() || path.file_name().is_some_and(|name| name == NAME)
}

/// A scene in blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trisplat plan of a scene in blocks")]
pub struct Manifest {
    /// The layout of this file.
    pub format: u32,
    /// Program and version; tasks of another version refuse the plan, as their bytes may be others.
    pub generator: String,
    /// The data set, relative to the folder of this file: the one thing here that says where photos
    /// lie.
    pub dataset: String,
    /// Options for reading it.
    pub dataset_options: DatasetOptions,
    /// The world point that is (0, 0, 0) in this file and in all soups beside it.
    pub origin: [f64; 3],
    /// Centre and scale of training space, the same for all blocks.
    pub space: ([f32; 3], f32),
    /// The coarse scene that blocks start from; none of a single block, which is a plain run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coarse: Option<PlanFile>,
    /// The hash of the data set's points, where a block starts from them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<String>,
    /// Training options of blocks, without the steps, triangles and seed that are set per block.
    pub options: TrainOptions,
    /// The photos to train on, in order of name.
    pub photos: Vec<PlannedPhoto>,
    /// The blocks. Those that one cut made follow each other: the first half of them, rounded up,
    /// is below the first cut.
    pub blocks: Vec<Block>,
}

/// A photo to train on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedPhoto {
    /// Its name in the data set.
    pub name: String,
    /// The hash of its file, and of its mask's if it has one.
    pub hash: String,
    /// The hash of its camera.
    pub camera: String,
}

/// A part of the scene that is trained on its own.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Region of the triangles it owns, by their middles.
    pub core: BlockRegion,
    /// Region that it trains: the core and a margin around it.
    pub halo: BlockRegion,
    /// The photos that show it.
    pub photos: Vec<BlockPhoto>,
    /// Initial soup: first triangles that are only drawn, then its part of the shell, then
    /// those it trains. None of a plain run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<PlanFile>,
    /// Number of triangles at the front of `start` that are drawn but not trained.
    pub frozen: u64,
    /// Number of triangles after those that belong to the shell.
    pub shell: u64,
    /// Its steps, counted from the beginning of its schedule.
    pub steps: u64,
    /// Number of these that the coarse scene made for all blocks; the block continues from there.
    pub first_step: u64,
    /// Maximum number of triangles in training.
    pub max_triangles: u64,
    /// ... and never more in its core: its part of those of the whole scene.
    pub core_triangles: u64,
    /// The seed of its random choices.
    pub seed: u64,
    /// Estimated cost.
    pub expected: Expected,
    /// The hash of all that its result depends on; part of the name of that.
    pub key: String,
}

/// A photo of a block.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlockPhoto {
    /// Its index among the plan's photos.
    pub photo: u32,
    /// The part of it that is trained on: left, upper, width and height, px.
    pub part: [u32; 4],
    /// Share of the photo that shows the block's core.
    pub cover: f32,
}

/// Estimated cost of training a block.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Memory, bytes.
    pub bytes: u64,
    /// CPU seconds on the machine of docs/benchmarks/history.md.
    pub cpu_secs: f64,
}

impl Manifest {
    /// Training space.
    pub fn space(&self) -> SceneNormalization {
        SceneNormalization { center: Vec3::from_array(self.space.0), scale: self.space.1 }
    }

    /// Training options of block `index`.
    pub fn options_of(&self, index: usize) -> TrainOptions {
        let Block { steps, max_triangles, seed, .. } = self.blocks[index];
        let mut options = TrainOptions { steps, max_triangles, seed, ..self.options.clone() };
        // These are means over all triangles: each has the part in them that it has in a plain run.
        if let (Some(coarse), Some(start)) = (&self.coarse, &self.blocks[index].start) {
            let own = start.triangles.saturating_sub(self.blocks[index].frozen);
            let share = own as f64 / coarse.triangles.max(1) as f64;
            options.loss.opacity *= share;
            options.loss.size *= share;
        }
        options
    }

    /// The hash of all that the result of block `index` depends on.
    pub(super) fn key_of(&self, index: usize) -> Result<String> {
        let block = &self.blocks[index];
        let photo = |p: &BlockPhoto| (&self.photos[p.photo as usize], p.part);
        let photos: Vec<_> = block.photos.iter().map(photo).collect();
        let start = block.start.as_ref().map(|start| &start.hash);
        let counts =
            [block.frozen, block.shell, block.max_triangles, block.steps, block.first_step];
        let settings = (
            &self.generator,
            &self.dataset_options,
            self.origin,
            self.space,
            self.options_of(index),
        );
        hash_of(&(settings, photos, start, &self.points, counts, &block.core, block.core_triangles))
    }

    /// Reads the plan at `path`, its file or its folder; returns it and its folder.
    ///
    /// # Errors
    ///
    /// A file that is broken or no plan, or of another version of trisplat.
    pub fn read(path: &Path, limits: &Limits) -> Result<(Self, PathBuf)> {
        let path = if path.is_dir() { path.join(NAME) } else { path.to_owned() };
        let text = input::read_text(&path, limits)?;
        let manifest: Self = serde_json::from_str(&text).map_err(|e| {
            let at = format!("line {} column {}", e.line(), e.column());
            let reason = format!("{e}; a plan is what `trisplat plan` writes");
            Error::malformed(&path, at, reason)
        })?;
        manifest.validate(&path)?;
        let folder = folder_of(&path).to_owned();
        Ok((manifest, folder))
    }

    /// Fails unless a plan could be so.
    fn validate(&self, path: &Path) -> Result<()> {
        let ours = trisplat_scene::report::generator();
        if self.format != FORMAT || self.generator != ours {
            let reason = format!(
                "is a plan by {}, this is {ours}: use that version, or plan again",
                self.generator
            );
            return Err(Error::unsupported(path, reason));
        }
        let bad = |at: String, reason: &str| Err(Error::malformed(path, at, reason));
        if self.blocks.is_empty() {
            return bad("blocks".into(), "there are none");
        }
        for (i, block) in self.blocks.iter().enumerate() {
            if block.photos.iter().any(|p| p.photo as usize >= self.photos.len()) {
                return bad(format!("block {i}"), "names a photo that does not exist");
            }
            let triangles = block.start.as_ref().map_or(u64::MAX, |start| start.triangles);
            if block.frozen.checked_add(block.shell).is_none_or(|first| first > triangles) {
                return bad(format!("block {i}"), "counts more triangles than its start has");
            }
            if block.first_step >= block.steps {
                return bad(format!("block {i}"), "has no steps of its own");
            }
            if self.key_of(i)? != block.key {
                return bad(
                    format!("block {i}"),
                    "was changed by hand: its key does not fit; plan again",
                );
            }
            self.options_of(i)
                .validate()
                .map_err(|e| Error::malformed(path, format!("block {i}"), e.to_string()))?;
        }
        Ok(())
    }

    /// Writes the plan into `file`, which then names all others, and removes those of an earlier
    /// plan in its folder.
    ///
    /// # Errors
    ///
    /// A refusal of the operating system.
    pub fn write(&self, file: AtomicFile) -> Result<()> {
        let path = file.path().to_owned();
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::invalid("manifest", e, "numbers JSON can hold"))?;
        file.commit_with(text + "\n")?;
        let used_names: Vec<&str> = self.sources().map(|source| source.file.as_str()).collect();
        sweep_folder(folder_of(&path), |name| is_of_a_plan(name) && !used_names.contains(&name));
        Ok(())
    }

    /// Initial soups of the blocks, and the coarse scene.
    fn sources(&self) -> impl Iterator<Item = &PlanFile> {
        self.blocks.iter().filter_map(|block| block.start.as_ref()).chain(&self.coarse)
    }

    /// All files that belong to this plan in `folder`: what it names, and the results of its
    /// blocks, which may be missing.
    pub fn files(&self, folder: &Path) -> Vec<PathBuf> {
        let sources = self.sources().map(|source| source.file.clone());
        let endings = ["ply", "checkpoint"];
        let results = self.blocks.iter().enumerate();
        let results = results.flat_map(|(i, block)| endings.map(|ending| block.file(i, ending)));
        let names = std::iter::once(NAME.to_owned()).chain(sources).chain(results);
        names.map(|name| folder.join(name)).collect()
    }

    /// The folder or file of the data set of a plan in `folder`.
    pub fn dataset_path(&self, folder: &Path) -> PathBuf {
        folder.join(&self.dataset)
    }
}

/// True for the name of a block's initial soup or of a coarse scene, finished or while it
/// is made. The hash at the end of a finished one is that of its bytes, which [`sweep_folder`]
/// compares.
fn is_of_a_plan(name: &str) -> bool {
    let Some(stem) = name.strip_suffix(".ply") else { return false };
    let is_hex = |text: &str| text.len() >= 4 && text.bytes().all(|b| b.is_ascii_hexdigit());
    let rest = stem.strip_prefix("coarse-").or_else(|| stem.strip_prefix("start-"));
    rest.is_some_and(|rest| rest.split('-').count() <= 2 && rest.split('-').all(is_hex))
}

impl Block {
    /// The core, in training space, with its budget.
    pub(super) fn training_core(&self, space: &SceneNormalization) -> Core {
        let axes = [0, 1, 2];
        let to = |side: Option<f32>, a: usize| Some((side? - space.center[a]) * space.scale);
        let BlockRegion { low, high } = self.core;
        Core {
            low: axes.map(|a| to(low[a], a)),
            high: axes.map(|a| to(high[a], a)),
            triangles: self.core_triangles,
        }
    }

    /// The name of its result beside the plan, with some ending.
    pub fn file(&self, index: usize, ending: &str) -> String {
        format!("block-{index:04}-{}.{ending}", self.key)
    }
}

impl BlockPhoto {
    /// Upper left corner and size of the part, px.
    pub(super) fn corner_and_size(&self) -> (UVec2, UVec2) {
        let [x, y, width, height] = self.part;
        (UVec2::new(x, y), UVec2::new(width, height))
    }
}

// ---- How a scene is cut into blocks, declared once ----------------------------------------------

/// Options for cutting a scene into blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Blocks"))]
pub struct PlanOptions {
    /// Number of blocks; one is a plain run.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536)))]
    #[schemars(range(min = 1, max = 65_536))]
    pub blocks: Option<u32>,
    /// Width of the margin around a block that is trained with it, as a share of the block's
    /// extent.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.halo))]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub halo: f64,
    /// A block gets the photos that show it on at least this share of their pixels.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.min_cover))]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub min_cover: f64,
    /// Maximum number of photos per block, those that show most of it; 0: no limit.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.block_photos))]
    #[schemars(range(max = 1_000_000))]
    pub block_photos: u32,
    /// Passes of a block over its photos, as a share of the passes of a plain run. 0:
    /// all blocks together draw 1.5 times the pixels of a plain run, which takes about as long, and
    /// no block looks more often than that run.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.passes))]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub passes: f64,
    /// Steps of the coarse scene, the first three fifths of the schedule; 0: three fifths of
    /// --steps.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.coarse_steps))]
    #[schemars(range(max = 1_000_000_000))]
    pub coarse_steps: u64,
    /// Triangles of the coarse scene; 0: half of --max-triangles.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.coarse_triangles))]
    #[schemars(range(max = 1_000_000_000))]
    pub coarse_triangles: u64,
}

impl PlanOptions {
    /// No number of blocks set.
    pub const DEFAULT: Self = Self {
        blocks: None,
        halo: 0.05,
        min_cover: 0.1,
        block_photos: 0,
        passes: 0.0,
        coarse_steps: 0,
        coarse_triangles: 0,
    };

    /// Checks ranges.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }

    /// Number of blocks.
    ///
    /// # Errors
    ///
    /// None is set.
    pub(super) fn count(&self) -> Result<usize> {
        let count = self
            .blocks
            .ok_or_else(|| Error::invalid("blocks", "not given", "a number of blocks"))?;
        Ok(count as usize)
    }
}

trisplat_scene::default!(PlanOptions);

// ---- Soups of a plan: their names end with the hash of their bytes, so that they replace nothing

/// Bytes read at a time.
const BUFFER: usize = 1 << 20;

/// A file of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// Its name in the folder of the plan.
    pub file: String,
    /// The hash of its bytes (XXH3).
    pub hash: String,
    /// Triangles in it.
    pub triangles: u64,
}

/// The hash of a file's bytes.
///
/// # Errors
///
/// A refusal of the operating system; no regular file.
pub(super) fn hash_of_file(path: &Path, limits: &Limits) -> Result<String> {
    let (mut file, _) = input::open(path, limits)?;
    let mut hash = Xxh3Default::new();
    let mut buffer = vec![0; BUFFER];
    loop {
        match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
            0 => return Ok(digits(hash.digest())),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// The hash of a value as JSON.
pub(super) fn hash_of(value: &impl Serialize) -> Result<String> {
    let bytes = serde_json::to_vec(value)
        .map_err(|e| Error::invalid("manifest", e, "numbers JSON can hold"))?;
    Ok(digits(xxh3_64(&bytes)))
}

/// A hash as sixteen hexadecimal digits.
pub(super) fn digits(hash: u64) -> String {
    format!("{hash:016x}")
}

/// Writes a soup as `NAME-HASH.ply` where `path` is `NAME.ply`, for the file `naming` that names
/// it.
///
/// # Errors
///
/// A file of that name with other bytes; what the operating system refuses.
pub(super) fn write(
    path: &Path,
    (soup, provenance, cameras): (&Soup, &Provenance, &[Camera]),
    naming: Option<&mut AtomicFile>,
) -> Result<(PathBuf, PlanFile)> {
    let mut bytes = Vec::new();
    ply::write_soup(&mut bytes, soup, provenance, cameras).map_err(|e| Error::io(path, e))?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let (written_path, hash) = put(folder_of(path), (&stem, "ply"), &bytes, naming)?;
    let file = format!("{stem}-{hash}.ply");
    Ok((written_path, PlanFile { file, hash, triangles: soup.len() as u64 }))
}

/// The finished coarse scene that was begun as `path`, if it is there and unchanged.
pub fn find_coarse(path: &Path, limits: &Limits) -> Option<PathBuf> {
    let begin = format!("{}-", path.file_stem().unwrap_or_default().to_string_lossy());
    let is_it = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let hash_in_name = name.strip_prefix(&begin).and_then(|rest| rest.strip_suffix(".ply"));
        hash_in_name
            .is_some_and(|expected| hash_of_file(path, limits).is_ok_and(|hash| hash == expected))
    };
    input::entries(folder_of(path)).filter(is_it).min()
}

/// Reads a soup of the plan, which must be as it was written.
pub(super) fn read(folder: &Path, source: &PlanFile, limits: &Limits) -> Result<ImportedScene> {
    let path = folder.join(&source.file);
    if hash_of_file(&path, limits)? != source.hash {
        return Err(Error::unsupported(&path, "has changed since it was planned; plan again"));
    }
    let options = ReadOptions { sh_degree: 3, limits: *limits, ..ReadOptions::default() };
    let loaded = formats::read(&path, &options)?;
    if loaded.scene.triangle_count() as u64 == source.triangles {
        Ok(loaded)
    } else {
        Err(Error::unsupported(&path, "has other triangles than were planned; plan again"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_plans_are_swept() {
        let hash = "0123456789abcdef";
        for ours in [
            format!("start-0001-{hash}.ply"),
            format!("coarse-{hash}-{hash}.ply"),
            format!("coarse-{hash}.ply"),
            "start-0012.ply".into(),
        ] {
            assert!(is_of_a_plan(&ours), "{ours}");
        }
        for other in [
            format!("block-0001-{hash}.ply"),
            format!("coarse-{hash}.checkpoint"),
            "start-mine.ply".into(),
            "coarse.ply".into(),
            NAME.into(),
        ] {
            assert!(!is_of_a_plan(&other), "{other}");
        }
    }
}
