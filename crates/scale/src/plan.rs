//! The plan: cuts a scene into blocks by its coarse scene, gives them photos, and writes what each
//! starts from.

use super::cover::{Coverage, assign, middles, owners, visible};
use super::manifest::{Block, BlockPhoto, Expected, FORMAT, Manifest, PlannedPhoto};
use super::region::{BlockRegion, ContractedSpace, cut_space, extent};
use crate::manifest::{self, PlanFile, PlanOptions, digits, hash_of, hash_of_file};
use glam::{UVec2, Vec3};
use std::path::{Component, Path, PathBuf};
use trisplat_dataset::{Dataset, DatasetOptions, View};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, ImportedScene, Result, Scene, SceneNormalization, Soup, parallel};
use trisplat_train::{REFERENCE_STEPS, RunIdentity, Schedule, TrainOptions, Trained};

/// Step at which the coarse scene ends and the blocks continue, of a 30,000-step run: late, as all
/// photos together show more than those of a block, but before triangles become opaque.
const GOES_ON_AT: f64 = 18_000.0;
/// Default share of a plain run's triangles that the coarse scene has: one in this many.
const COARSE_TRIANGLES: u64 = 2;
/// By default blocks together draw this many times the pixels of a plain run, because each step has
/// fewer triangles.
const PIXELS: f64 = 1.5;
/// Bytes of an idle process. This and the following were fitted to blocks of a town.
const IDLE_BYTES: f64 = 15e6;
/// Bytes per optimised parameter of a trained triangle,
const PER_NUMBER: f64 = 75.0;
/// plus fixed overhead per triangle, bytes.
const PER_TRIANGLE: f64 = 250.0;
/// Parameters per triangle, without colour.
const GEOMETRY: f64 = 11.0;
/// Bytes per pixel of the largest photo, for the forward and backward pass.
const PER_PIXEL: f64 = 450.0;
/// CPU seconds of a step: a constant, per pixel, per trained triangle, and per triangle that is
/// only drawn.
const STEP_SECS: [f64; 4] = [1.1e-3, 0.1e-6, 0.6e-6, 0.2e-6];
/// Triangles around a core may grow by this factor relative to the coarse scene, compared with
/// those in the core.
const HALO_ROOM: f64 = 2.0;

/// Makes a plan of a data set.
#[derive(Debug, Clone)]
pub struct Planner<'a> {
    /// All its photos; those held out are not planned with.
    pub dataset: &'a Dataset,
    /// Options it was read with.
    pub dataset_options: &'a DatasetOptions,
    /// Options of the cut.
    pub options: &'a PlanOptions,
    /// Options of a plain training of the whole scene.
    pub whole: &'a TrainOptions,
}

/// Refuses what no photo is needed to refuse: options out of range, and blocks that would take more
/// than `max_bytes` were they all alike and had no photos. Returns the number of blocks.
///
/// # Errors
///
/// A number that is out of range or contradicts another.
pub fn check(options: &PlanOptions, whole: &TrainOptions, max_bytes: Option<u64>) -> Result<usize> {
    options.validate()?;
    whole.validate()?;
    let count = options.count()?;
    let triangles = whole.max_triangles.div_ceil(count as u64);
    let block = Block { max_triangles: triangles, ..Block::default() };
    let min_memory = expected(&block, whole, 0);
    check_memory("the largest block, even without photos,", min_memory, max_bytes)?;
    Ok(count)
}

impl Planner<'_> {
    /// Options and last step of the coarse scene's training: the first part of a plain run
    /// with fewer triangles; `None` when there is one block, which needs none.
    pub fn coarse_options(&self) -> Result<Option<(TrainOptions, u64)>> {
        if self.options.count()? == 1 {
            return Ok(None);
        }
        let or_default = |option: u64, default: u64| if option > 0 { option } else { default };
        let share = GOES_ON_AT / REFERENCE_STEPS;
        let steps =
            or_default(self.options.coarse_steps, (share * self.whole.steps as f64).ceil() as u64);
        let max_triangles = or_default(
            self.options.coarse_triangles,
            self.whole.max_triangles.div_ceil(COARSE_TRIANGLES),
        );
        let whole = (steps as f64 / share).round() as u64;
        Ok(Some((TrainOptions { steps: whole, max_triangles, ..self.whole.clone() }, steps)))
    }

    /// The name of the coarse scene's file while it is made, with a hash of what it is made of. The
    /// finished file has a hash of its bytes behind that: [`keep_coarse`],
    /// [`find_coarse`](super::find_coarse).
    ///
    /// # Errors
    ///
    /// Photos that cannot be read.
    pub fn coarse_name(
        &self,
        coarse: &(TrainOptions, u64),
        photos: &[PlannedPhoto],
    ) -> Result<String> {
        let generator = trisplat_scene::report::generator();
        let parts = (generator, self.dataset_options, coarse, photos, self.points());
        Ok(format!("coarse-{}.ply", hash_of(&parts)?))
    }

    /// The data set as a plan in `folder` names it.
    ///
    /// # Errors
    ///
    /// A path that is not UTF-8; one that does not exist.
    pub fn address(&self, folder: &Path) -> Result<String> {
        relative(folder, &self.dataset.path)
    }

    /// The photos to train on, with the hashes of their files.
    ///
    /// # Errors
    ///
    /// Photos that cannot be read.
    pub fn photos(&self) -> Result<Vec<PlannedPhoto>> {
        planned_photos(self.dataset, self.dataset_options)
    }

    fn points(&self) -> String {
        digits(RunIdentity::of(self.dataset, self.dataset_options.background.to_f32(), None).points)
    }

    /// The plan, for the folder of `file`, its own; what blocks start from is written there.
    /// `coarse` is the file, in this folder, and the content of the coarse scene.
    ///
    /// Blocks that no photo shows are left out: there may be fewer than the options ask for.
    ///
    /// # Errors
    ///
    /// No photo shows any block; one that is expected to take more than `max_bytes`; what the
    /// operating system refuses.
    pub fn plan(
        &self,
        file: &mut AtomicFile,
        photos: Vec<PlannedPhoto>,
        coarse: Option<(&Path, &ImportedScene)>,
        max_bytes: Option<u64>,
    ) -> Result<Manifest> {
        let folder = &file.path().parent().unwrap_or(Path::new("")).to_owned();
        let dataset = self.address(folder)?;
        // Some blocks have too few photos or points to decide alike.
        let masks = self.dataset.masks(self.dataset_options.masks);
        let dataset_options = DatasetOptions { masks, ..self.dataset_options.clone() };
        let views: Vec<&View> = self.dataset.train().collect();
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let (points, coarse, space, blocks) = match coarse {
            None => (Some(self.points()), None, ([0.0; 3], 1.0), vec![self.only_block(&views)]),
            Some((path, scene)) => {
                let cutter = Cutter::new(self, scene, &views, &cameras)?;
                let hash = hash_of_file(path, &self.dataset_options.limits)?;
                let file_name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let coarse =
                    PlanFile { file: file_name, hash, triangles: cutter.soup.len() as u64 };
                let space = (cutter.space.center.to_array(), cutter.space.scale);
                (None, Some(coarse), space, cutter.blocks(file, max_bytes)?)
            }
        };
        let mut manifest = Manifest {
            format: FORMAT,
            generator: trisplat_scene::report::generator(),
            dataset,
            dataset_options,
            origin: self.dataset.origin.to_array(),
            space,
            coarse,
            points,
            options: self.whole.clone(),
            photos,
            blocks,
        };
        for index in 0..manifest.blocks.len() {
            manifest.blocks[index].key = manifest.key_of(index)?;
            let expected = manifest.blocks[index].expected;
            check_memory(&format!("block {index}"), expected, max_bytes)?;
        }
        Ok(manifest)
    }

    /// The block of a scene that is not cut: a plain run.
    fn only_block(&self, views: &[&View]) -> Block {
        let whole = |(i, view): (usize, &&View)| {
            let [width, height] = view.camera.size.to_array();
            BlockPhoto { photo: i as u32, part: [0, 0, width, height], cover: 1.0 }
        };
        let TrainOptions { steps, max_triangles, seed, .. } = *self.whole;
        let photos = views.iter().enumerate().map(whole).collect();
        let block = Block {
            photos,
            steps,
            max_triangles,
            core_triangles: max_triangles,
            seed,
            ..Block::default()
        };
        Block {
            expected: expected(&block, self.whole, self.dataset_options.photo_bytes()),
            ..block
        }
    }
}

/// Writes the coarse scene that was begun as `path`; returns the path of the finished file.
///
/// # Errors
///
/// A file of that name with other bytes; what the operating system refuses.
pub fn keep_coarse(path: &Path, trained: &Trained) -> Result<PathBuf> {
    let parts = (&trained.soup, &trained.provenance, &trained.cameras[..]);
    manifest::write(path, parts, None).map(|(path, _)| path)
}

/// The photos of `dataset` that are not held out, with the hashes of their files.
pub(super) fn planned_photos(
    dataset: &Dataset,
    options: &DatasetOptions,
) -> Result<Vec<PlannedPhoto>> {
    let identity = RunIdentity::of(dataset, options.background.to_f32(), None);
    let views: Vec<&View> = dataset.train().collect();
    let planned = |_, (view, photo): (&&View, &trisplat_train::PhotoIdentity)| {
        let mut hash = hash_of_file(&view.photo.path, &options.limits)?;
        if let Some(mask) = &view.photo.mask {
            hash += &hash_of_file(mask, &options.limits)?;
        }
        Ok(PlannedPhoto { name: view.name.clone(), hash, camera: digits(photo.pose) })
    };
    parallel::map(views.iter().zip(&identity.photos), planned).into_iter().collect()
}

/// Estimated cost of training a block, by formulas: a plan is a function of its inputs.
fn expected(block: &Block, options: &TrainOptions, photo_bytes: u64) -> Expected {
    let areas: Vec<f64> = block
        .photos
        .iter()
        .map(|photo| photo.corner_and_size().1.as_dvec2().element_product())
        .collect();
    let pixels = areas.iter().sum::<f64>();
    let largest = areas.iter().copied().fold(0.0, f64::max);
    let coefficients = (f64::from(options.sh_degree) + 1.0).powi(2);
    let per_triangle = PER_TRIANGLE + PER_NUMBER * (GEOMETRY + 3.0 * coefficients);
    let trained = block.max_triangles as f64;
    let frozen = block.frozen as f64;
    let photos = (4.0 * pixels).min(photo_bytes as f64);
    let bytes = IDLE_BYTES + photos + per_triangle * (trained + frozen) + PER_PIXEL * largest;
    let [constant, per_pixel, per_trained, per_frozen] = STEP_SECS;
    let mean = pixels / areas.len().max(1) as f64;
    let step = constant + per_pixel * mean + per_trained * trained + per_frozen * frozen;
    let cpu_secs = step * (block.steps - block.first_step) as f64;
    Expected { bytes: bytes as u64, cpu_secs: (cpu_secs * 10.0).round() / 10.0 }
}

fn check_memory(what: &str, expected: Expected, max_bytes: Option<u64>) -> Result<()> {
    match max_bytes.filter(|limit| expected.bytes > *limit) {
        Some(limit) => Err(Error::TooLarge {
            what: format!("what {what} is expected to take"),
            bytes: expected.bytes,
            limit,
            remedy:
                "plan more blocks, fewer triangles or smaller photos (`blocks`, `max_triangles`, `max_size`)"
                    .into(),
        }),
        None => Ok(()),
    }
}

/// Cuts a coarse scene.
struct Cutter<'a> {
    planner: &'a Planner<'a>,
    scene: &'a ImportedScene,
    soup: &'a Soup,
    space: SceneNormalization,
    views: &'a [&'a View],
    cameras: &'a [Camera],
    middles: Vec<Vec3>,
}

impl<'a> Cutter<'a> {
    fn new(
        planner: &'a Planner<'a>,
        scene: &'a ImportedScene,
        views: &'a [&'a View],
        cameras: &'a [Camera],
    ) -> Result<Self> {
        let Scene::Soup(soup) = &scene.scene else {
            return Err(Error::invalid(
                "coarse scene",
                "a mesh",
                "a soup, as `trisplat train` writes it",
            ));
        };
        let middles = middles(soup);
        let points = &planner.dataset.points;
        let space = if points.is_empty() {
            SceneNormalization::new(cameras, &middles)
        } else {
            SceneNormalization::of(cameras, points.len(), |i| points[i].position)
        };
        Ok(Self { planner, scene, soup, space, views, cameras, middles })
    }

    /// The blocks; what they start from is written beside `file`, the plan.
    fn blocks(&self, file: &mut AtomicFile, max_bytes: Option<u64>) -> Result<Vec<Block>> {
        let positions: Vec<Vec3> = self.cameras.iter().map(Camera::position).collect();
        let inner: Vec<Vec3> = self.inner().map(|i| self.middles[i]).collect();
        let cores =
            cut_space(&inner, self.planner.options.count()?, &ContractedSpace::of(&positions));
        let owners = owners(&self.middles, &cores);
        let mut middles = vec![Vec::new(); cores.len()];
        for i in self.inner() {
            middles[owners[i] as usize].push(self.middles[i]);
        }
        let seed = self.planner.whole.seed;
        let block = |(i, core): (usize, &BlockRegion)| {
            let halo = core.grown(extent(&middles[i]) * self.planner.options.halo as f32);
            Block { core: *core, halo, seed: seed.wrapping_add(i as u64), ..Block::default() }
        };
        let mut blocks: Vec<Block> = cores.iter().enumerate().map(block).collect();
        let drawing = self.planner.whole.drawing([0.0; 3]);
        let coverage = Coverage::new(self.soup, &self.middles, &owners, self.space, &drawing);
        assign(&mut blocks, self.views, &coverage, self.planner.options)?;
        let passes = self.passes(&blocks);
        let core_triangles = self.core_triangles(&owners, &blocks);
        let mut shown_blocks = Vec::with_capacity(blocks.len());
        for (owner, mut block) in blocks.into_iter().enumerate() {
            // A block that no photo shows cannot be trained, and nobody misses it.
            if block.photos.is_empty() {
                continue;
            }
            let visible = visible(&block, self.views, &coverage)?;
            let photos = block.photos.len() as f64 / self.views.len() as f64;
            block.steps =
                ((passes * self.planner.whole.steps as f64 * photos).ceil() as u64).max(1);
            block.first_step =
                Schedule::new(&TrainOptions { steps: block.steps, ..self.planner.whole.clone() })
                    .scaled(GOES_ON_AT)
                    .min(block.steps - 1);
            block.core_triangles = core_triangles[owner];
            self.fill(shown_blocks.len(), &mut block, &visible, file, max_bytes)?;
            shown_blocks.push(block);
        }
        Ok(shown_blocks)
    }

    /// The triangles that are not the shell.
    fn inner(&self) -> impl Iterator<Item = usize> {
        (0..self.soup.len()).filter(|i| !self.soup.is_shell(*i))
    }

    /// Passes of blocks over their photos, as a share of those of a plain run. By default
    /// all of them together draw 1.5 times as many pixels.
    fn passes(&self, blocks: &[Block]) -> f64 {
        let pixels = |size: UVec2| size.as_dvec2().element_product();
        let whole: f64 = self.cameras.iter().map(|camera| pixels(camera.size)).sum();
        let parts = blocks
            .iter()
            .flat_map(|block| &block.photos)
            .map(|photo| pixels(photo.corner_and_size().1));
        match self.planner.options.passes {
            0.0 => (PIXELS * whole / parts.sum::<f64>().max(1.0)).min(1.0),
            passes => passes,
        }
    }

    /// The triangles of the whole scene, shared out among the cores that photos show as those of
    /// the coarse scene are. `[blocks]`
    fn core_triangles(&self, owners: &[u32], blocks: &[Block]) -> Vec<u64> {
        let mut counts = vec![0u128; blocks.len()];
        for owner in owners {
            counts[*owner as usize] += 1;
        }
        for (count, _) in counts.iter_mut().zip(blocks).filter(|(_, block)| block.photos.is_empty())
        {
            *count = 0;
        }
        let all = counts.iter().sum::<u128>().max(1);
        let mut below = 0;
        let up_to =
            |count: u128| (u128::from(self.planner.whole.max_triangles) * count / all) as u64;
        let part = |count: &u128| {
            let from = up_to(below);
            below += count;
            up_to(below) - from
        };
        counts.iter().map(part).collect()
    }

    /// Everything of a block that follows from its boxes and photos, and the file it starts from.
    fn fill(
        &self,
        index: usize,
        block: &mut Block,
        visible: &[bool],
        file: &mut AtomicFile,
        max_bytes: Option<u64>,
    ) -> Result<()> {
        let is_shell = |i: usize| self.soup.is_shell(i);
        // None that is only drawn may reach into the halo: what it hides would be missing once it
        // is gone.
        let is_trained = |i: usize| {
            if is_shell(i) {
                block.core.contains(self.middles[i])
            } else {
                block.halo.touches(&self.soup.vertices[i])
            }
        };
        let all = 0..self.soup.len();
        let frozen: Vec<usize> = all.clone().filter(|&i| visible[i] && !is_trained(i)).collect();
        let (shell, trained): (Vec<usize>, Vec<usize>) =
            all.filter(|&i| is_trained(i)).partition(|&i| is_shell(i));
        let own = shell.len() + trained.len();
        let around =
            trained.iter().filter(|&&i| !block.core.contains(self.middles[i])).count() as f64;
        let per_coarse = self.planner.whole.max_triangles as f64 / self.soup.len() as f64;
        block.max_triangles = (block.core_triangles
            + (HALO_ROOM * per_coarse * around).ceil() as u64)
            .max(own as u64);
        block.frozen = frozen.len() as u64;
        block.shell = shell.len() as u64;
        block.expected =
            expected(block, self.planner.whole, self.planner.dataset_options.photo_bytes());
        check_memory(&format!("block {index}"), block.expected, max_bytes)?;
        let order: Vec<usize> = [frozen, shell, trained].concat();
        block.start = Some(self.write_start(index, &order, file)?);
        Ok(())
    }

    /// Writes triangles of the coarse scene, in this order, as the start of block `index`. Its name
    /// holds the hash of its bytes, so that it replaces nothing; `manifest` names it.
    fn write_start(
        &self,
        index: usize,
        order: &[usize],
        manifest: &mut AtomicFile,
    ) -> Result<PlanFile> {
        let begun = manifest.path().with_file_name(format!("start-{index:04}.ply"));
        let mut soup = self.soup.subset(order);
        // The plan says which of these are the block's part of it.
        soup.shell.clear();
        let parts = (&soup, &self.scene.provenance, &[][..]);
        crate::manifest::write(&begun, parts, Some(manifest)).map(|(_, source)| source)
    }
}

/// `to` relative to `folder`, so that both can be mounted elsewhere together.
fn relative(folder: &Path, to: &Path) -> Result<String> {
    let full = |path: &Path| std::fs::canonicalize(path).map_err(|e| Error::io(path, e));
    let from = full(folder)?;
    let to = full(to)?;
    let (a, b): (Vec<Component>, Vec<Component>) =
        (from.components().collect(), to.components().collect());
    let common = a.iter().zip(&b).take_while(|(a, b)| a == b).count();
    let path: PathBuf = match common {
        0 => to,
        _ => a[common..]
            .iter()
            .map(|_| Component::ParentDir)
            .chain(b[common..].iter().copied())
            .collect(),
    };
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { &path };
    match path.to_str() {
        Some(text) => Ok(text.replace('\\', "/")),
        None => Err(Error::invalid(
            "DATASET",
            path.display(),
            "a path in UTF-8, because the plan names it",
        )),
    }
}
