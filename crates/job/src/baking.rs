//! A bake job, from its inputs and options to files: photos, hardening, a limit on bytes, stages,
//! report.

use super::any_scene::AnyScene;
use super::event::{Observer, add, stages};
use super::gaussians::{self, SplatTraining, TrainingEffort};
use super::harden::{self, Hardened};
use super::size_limit::{self, BakeStart};
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_bake::{
    BackgroundDetails, Bake, BakeOptions, BakeOutcome, CropDetails, TeacherWhen, ViewpointDetails,
    Views, background, merge,
};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats as formats;
use trisplat_formats::output::{self, Output, WriteDetails};
use trisplat_formats::{Content, WrittenFiles, gltf};
use trisplat_scene::atomic::StartedFiles;
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Bounds, Error, Hit, ImportedScene, ImportedSplats, Result};

/// An input of a bake.
#[derive(Debug, Clone)]
pub enum BakeInput {
    /// A file, read when the job runs; "-" is standard input.
    File(PathBuf),
    /// A scene in memory.
    Scene(Box<Content>),
}

impl BakeInput {
    /// A scene in memory.
    pub fn scene(scene: impl Into<AnyScene>) -> Self {
        Self::Scene(Box::new(scene.into().into()))
    }

    /// The file, for messages.
    fn path(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Scene(_) => Path::new("scene"),
        }
    }
}

/// A bake job. [`BakeJob::new`] fills in the defaults; set any field before running it.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_bake::BakePreset;
/// use trisplat_formats::OutputTarget;
/// use trisplat_job::BakeInput;
/// use trisplat_job::BakeJob;
/// use trisplat_bake::BakeOptions;
///
/// let folder = tempfile::tempdir().unwrap();
/// let mut options = BakeOptions::preset(BakePreset::Fast);
/// options.output.target = OutputTarget::Godot;
/// let scene = BakeInput::File("../../samples/soups/studio.ply".into());
/// let done = BakeJob::new([scene], options).save(&folder.path().join("studio.glb"), &mut |_| Continue(()))?;
/// assert_eq!(done.report.outputs.len(), 2, "the GLB, and what Godot wants beside it");
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct BakeJob {
    /// Inputs; several are merged.
    pub inputs: Vec<BakeInput>,
    /// The options of the stages.
    pub options: BakeOptions,
    /// Photos of the scene, if there are any.
    pub photos: Option<Dataset>,
    /// Options for reading photos and input files.
    pub dataset_options: DatasetOptions,
    /// Steps of a training that makes a soft scene solid before the bake;
    /// [`HARDEN_STEPS`](super::HARDEN_STEPS) suit most.
    pub harden: Option<u64>,
    /// Limit on the bytes of all files together.
    pub max_bytes: Option<u64>,
    /// Start of the report's clock; `None`: the moment the job runs.
    pub began: Option<Instant>,
}

/// Content of the inputs.
struct InputContent {
    scenes: Vec<ImportedScene>,
    /// Gaussians, of one input at most.
    splats: Option<ImportedSplats>,
}

/// The scene to bake, and the photos or pictures that the bake may use.
struct Scenes {
    scenes: Vec<ImportedScene>,
    views: Option<Views>,
    /// Background of the object, if hardening has estimated it.
    background: Option<BackgroundDetails>,
}

/// A baked scene and its report.
#[derive(Debug, Clone)]
pub struct Baked {
    /// The asset that an engine draws.
    pub asset: Asset,
    /// Inputs, options, stages, files and warnings.
    pub report: Report,
    options: BakeOptions,
    /// Share of the subject, if the scene was cropped.
    pub(super) crop: CropDetails,
    /// Choice of the first viewpoint.
    pub(super) viewpoint: ViewpointDetails,
}

impl Baked {
    /// Writes the scene as the options of its bake say. The ending of `path` chooses the format;
    /// existing files are replaced.
    ///
    /// # Errors
    ///
    /// An unknown ending; a tileset, which [`BakeJob::save`] writes; refusals of the operating
    /// system.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<WrittenFiles> {
        let path = path.as_ref();
        if self.options.tiles.tiles {
            let wants = "`BakeJob::save`, which writes tiles";
            return Err(Error::invalid("output", path.display(), wants));
        }
        formats::write(&self.asset, path, &self.options.output)
    }

    /// The bytes of a GLB as the options of its bake say, without the files beside it.
    ///
    /// # Errors
    ///
    /// Nothing to draw, or more than a GLB holds.
    pub fn to_glb(&self) -> Result<Vec<u8>> {
        let encoding = self.options.output.encoding(&mut WriteDetails::default());
        gltf::to_glb_bytes(&self.asset, &encoding)
    }

    /// The first face on a ray: see [`Asset::raycast`].
    pub fn raycast(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        self.asset.raycast(origin, direction)
    }

    /// The box around the scene, without its backdrop.
    pub fn bounds(&self) -> Bounds {
        let faces = 0..self.asset.scene_faces();
        Bounds::of(faces.flat_map(|face| self.asset.mesh.corners(face)))
    }
}

impl BakeJob {
    /// A bake of `inputs` without photos.
    pub fn new(inputs: impl IntoIterator<Item = BakeInput>, options: BakeOptions) -> Self {
        Self {
            inputs: inputs.into_iter().collect(),
            options,
            photos: None,
            dataset_options: DatasetOptions::default(),
            harden: None,
            max_bytes: None,
            began: None,
        }
    }

    /// Bakes without writing files.
    ///
    /// # Errors
    ///
    /// Unreadable inputs; errors of the bake; `max_bytes`, which only counts written files.
    pub fn run(self, observer: Observer<'_>) -> Result<Baked> {
        match self.max_bytes {
            Some(bytes) => Err(Error::invalid("max_bytes", bytes, "files to write")),
            None => self.run_to(None, observer),
        }
    }

    /// Bakes and writes the files that [`BakeOptions::plan_output`] names for `path`. Existing
    /// files are replaced.
    ///
    /// # Errors
    ///
    /// Errors of [`BakeJob::run`], of the format and of the operating system.
    pub fn save(mut self, path: &Path, observer: Observer<'_>) -> Result<Baked> {
        let output = self.options.plan_output(path, None)?;
        let files = output.start()?;
        self.write(&output, files, observer)
    }

    /// Bakes and writes the files of `output`: planned by [`BakeOptions::plan_output`], already
    /// started.
    ///
    /// # Errors
    ///
    /// As for [`BakeJob::save`].
    pub fn write(
        self,
        output: &Output,
        files: StartedFiles,
        observer: Observer<'_>,
    ) -> Result<Baked> {
        self.run_to(Some((output, files)), observer)
    }

    fn run_to(self, to: Option<(&Output, StartedFiles)>, observer: Observer<'_>) -> Result<Baked> {
        let began = self.began.unwrap_or_else(Instant::now);
        let mut report = Report::new("bake");
        report.inputs = self.names();
        report
            .warnings
            .extend(self.photos.iter().flat_map(|photos| photos.warnings.iter().cloned()));
        let Scenes { scenes, mut views, background } = self.scenes(&mut report, observer)?;
        let mut options = self.options;
        let outcome = match (self.max_bytes, &to) {
            (Some(limit), Some((output, _))) => {
                let start = BakeStart { scenes: &scenes, background: &background, report: &report };
                let sized = size_limit::search_triangle_count(
                    limit,
                    start,
                    views.as_mut(),
                    &options,
                    output,
                    observer,
                )?;
                drop(scenes);
                options = sized.options;
                report = sized.report;
                sized.outcome
            }
            _ => {
                let bake = Bake::new(&options).photos(views.as_mut()).report(&mut report);
                bake.background(background)
                    .observer(&mut stages(observer))
                    .run_with_details(scenes)?
            }
        };
        let BakeOutcome { asset, crop, viewpoint } = outcome;
        report.options = serde_json::to_value(&options).unwrap_or_default();
        if let Some((output, files)) = to {
            output::write(
                &asset,
                output,
                files,
                &options.output,
                &mut report,
                &mut stages(observer),
            )?;
        }
        report.seconds = began.elapsed().as_secs_f64();
        Ok(Baked { asset, report, options, crop, viewpoint })
    }

    /// The input files and the data set.
    fn names(&self) -> Vec<String> {
        let files = self.inputs.iter().filter_map(|input| match input {
            BakeInput::File(path) => Some(path),
            BakeInput::Scene(_) => None,
        });
        let photos = self.photos.iter().map(|photos| &photos.path);
        files.chain(photos).map(|path| path.display().to_string()).collect()
    }

    /// The scene to bake: the inputs, hardened on request. Hardening is a stage of `report`.
    fn scenes(&self, report: &mut Report, observer: Observer<'_>) -> Result<Scenes> {
        let reading = &self.dataset_options;
        let views = self.photos.as_ref().map(|photos| Views::new(photos, reading));
        let InputContent { scenes: inputs, splats } = self.read()?;
        if let Some(splats) = splats {
            return self.solid_of(splats, inputs, views, report, observer);
        }
        let Some(steps) = self.harden else {
            return Ok(Scenes { scenes: inputs, views, background: None });
        };
        let soft = merge(inputs)?;
        let mut background_details = None;
        let hardened = match harden::reason_to_skip(&soft) {
            Some(why) => Hardened::unneeded(soft, why),
            None => {
                let max_triangles = self.options.prune.max_triangles;
                let training = harden::training(steps, soft.scene.triangle_count(), max_triangles);
                let photos = self.photos.as_ref();
                let options = &self.options.background;
                let has_photos = photos.is_some();
                let (soft, found) = report.stage(
                    &mut stages(observer),
                    soft,
                    |soft| soft.scene.counts(),
                    |soft, details| Ok(background(soft, has_photos, options, details)),
                )?;
                let behind = found.object_color();
                background_details = Some(found);
                harden::harden((self.path(), soft), behind, photos, reading, &training, observer)?
            }
        };
        add(hardened.stage, report, observer);
        Ok(Scenes {
            scenes: vec![hardened.scene],
            views: views.or(hardened.pictures),
            background: background_details,
        })
    }

    /// The solid scene of Gaussians, and the other inputs. Making it is a stage of `report`.
    fn solid_of(
        &self,
        splats: ImportedSplats,
        others: Vec<ImportedScene>,
        views: Option<Views>,
        report: &mut Report,
        observer: Observer<'_>,
    ) -> Result<Scenes> {
        let training = SplatTraining {
            effort: TrainingEffort::of(self.options.preset, self.harden),
            max_triangles: self.options.prune.max_triangles,
            sh_degree: self.options.sh.sh.asked(),
        };
        let photos = self.photos.as_ref();
        let reading = &self.dataset_options;
        let solid =
            gaussians::solid((self.path(), splats), photos, reading, training, report, observer)?;
        add(solid.stage, report, observer);
        // Pictures of the Gaussians do not show what stands beside them.
        let pictures = solid.pictures.filter(|_| others.is_empty());
        let scenes = std::iter::once(solid.scene).chain(others).collect();
        Ok(Scenes { scenes, views: views.or(pictures), background: None })
    }

    /// The first file, for messages.
    fn path(&self) -> &Path {
        self.inputs.first().map_or(Path::new("scene"), BakeInput::path)
    }

    /// Reads every input. Readers run one after the other, so that memory holds one file's spare
    /// buffers at a time.
    fn read(&self) -> Result<InputContent> {
        let is_stream =
            |input: &&BakeInput| matches!(input, BakeInput::File(p) if p.as_os_str() == "-");
        if self.inputs.iter().filter(is_stream).count() > 1 {
            return Err(Error::invalid("inputs", "- -", "standard input once"));
        }
        let options = self.dataset_options.read_options(self.sh_degree());
        let mut scenes = Vec::new();
        let mut splats = None;
        for input in &self.inputs {
            let contents = match input {
                BakeInput::Scene(content) => vec![Content::clone(content)],
                BakeInput::File(path) => formats::read_contents(path, &options)?,
            };
            for content in contents {
                match content {
                    Content::Scene(scene) => scenes.push(scene),
                    Content::Splats(own) if splats.is_none() => splats = Some(own),
                    Content::Splats(_) => {
                        let reason = "holds 3D Gaussians like an input before it: bake each to a .glb, then merge these";
                        return Err(Error::unsupported(input.path(), reason));
                    }
                }
            }
        }
        Ok(InputContent { scenes, splats })
    }

    /// The SH degree to read: the teacher draws more than degree 0, and without photos a scene may
    /// keep it.
    fn sh_degree(&self) -> u8 {
        let draws_teacher = self.options.teacher.teacher == TeacherWhen::Auto;
        let keeps_sh = self.options.sh.sh.max_degree() > 0;
        let is_used = self.photos.is_none() && (draws_teacher || keeps_sh);
        if is_used || self.harden.is_some() { 3 } else { 0 }
    }
}

impl From<&Baked> for AnyScene {
    /// The mesh of a bake, as a reader returns it.
    fn from(baked: &Baked) -> Self {
        let provenance = baked.asset.provenance.clone();
        ImportedScene { provenance, ..ImportedScene::from(baked.asset.mesh.clone()) }.into()
    }
}
