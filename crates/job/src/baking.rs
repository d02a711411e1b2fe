//! A bake job, from its inputs and options to files: photos, hardening, a limit on bytes, stages,
//! report.

use super::event::{Observer, add, stages};
use super::fitted::{BakeStart, fitted};
use super::gaussians::{self, Effort};
use super::harden::{self, Hardened};
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_bake::{BackgroundDetails, Bake, BakeOptions, TeacherWhen, Views, background, merge};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats as formats;
use trisplat_formats::Content;
use trisplat_formats::output::{self, Output, OutputFiles};
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Error, ImportedScene, ImportedSplats, Result};

/// An input of a bake.
#[derive(Debug, Clone)]
pub enum BakeInput {
    /// A file, read when the job runs; "-" is standard input.
    File(PathBuf),
    /// A scene in memory.
    Scene(Box<ImportedScene>),
}

impl BakeInput {
    /// A scene in memory.
    pub fn scene(scene: impl Into<ImportedScene>) -> Self {
        Self::Scene(Box::new(scene.into()))
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

/// What the inputs hold.
enum Inputs {
    Scenes(Vec<ImportedScene>),
    Splats(Box<ImportedSplats>),
}

/// The scene to bake, and the photos or pictures that the bake may use.
struct Scenes {
    scenes: Vec<ImportedScene>,
    views: Option<Views>,
    /// The background that hardening has looked for.
    background: Option<BackgroundDetails>,
}

/// A baked scene and its report.
#[derive(Debug, Clone)]
pub struct BakeDone {
    /// The asset that an engine draws.
    pub asset: Asset,
    /// Inputs, options, stages, files and warnings.
    pub report: Report,
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
    pub fn run(self, observer: Observer<'_>) -> Result<BakeDone> {
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
    /// Those of [`BakeJob::run`], of the format and of the operating system.
    pub fn save(mut self, path: &Path, observer: Observer<'_>) -> Result<BakeDone> {
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
        files: OutputFiles,
        observer: Observer<'_>,
    ) -> Result<BakeDone> {
        self.run_to(Some((output, files)), observer)
    }

    fn run_to(
        self,
        to: Option<(&Output, OutputFiles)>,
        observer: Observer<'_>,
    ) -> Result<BakeDone> {
        let began = self.began.unwrap_or_else(Instant::now);
        let mut report = Report::new("bake");
        report.inputs = self.names();
        report
            .warnings
            .extend(self.photos.iter().flat_map(|photos| photos.warnings.iter().cloned()));
        let Scenes { scenes, mut views, background } = self.scenes(&mut report, observer)?;
        let mut options = self.options;
        let asset = match (self.max_bytes, &to) {
            (Some(limit), Some((output, _))) => {
                let start = BakeStart { scenes: &scenes, background: &background, report: &report };
                let found = fitted(limit, start, views.as_mut(), &options, output, observer)?;
                drop(scenes);
                options = found.options;
                report = found.report;
                found.asset
            }
            _ => {
                let bake = Bake::new(&options).photos(views.as_mut()).report(&mut report);
                bake.background(background).observer(&mut stages(observer)).run(scenes)?
            }
        };
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
        Ok(BakeDone { asset, report })
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

    /// The scene to bake: the inputs, hardened if asked. Hardening is a stage of `report`.
    fn scenes(&self, report: &mut Report, observer: Observer<'_>) -> Result<Scenes> {
        let how = &self.dataset_options;
        let views = self.photos.as_ref().map(|photos| Views::new(photos, how));
        let inputs = match self.read()? {
            Inputs::Scenes(scenes) => scenes,
            Inputs::Splats(splats) => return self.solid_of(*splats, views, report, observer),
        };
        let Some(steps) = self.harden else {
            return Ok(Scenes { scenes: inputs, views, background: None });
        };
        let soft = merge(inputs)?;
        let mut background_details = None;
        let hardened = match harden::needless(&soft) {
            Some(why) => Hardened::needless(soft, why),
            None => {
                let most = self.options.prune.max_triangles;
                let training = harden::training(steps, soft.scene.triangle_count(), most);
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
                harden::harden((self.path(), soft), behind, photos, how, &training, observer)?
            }
        };
        add(hardened.stage, report, observer);
        Ok(Scenes {
            scenes: vec![hardened.scene],
            views: views.or(hardened.pictures),
            background: background_details,
        })
    }

    /// The solid scene of Gaussians. Making it is a stage of `report`.
    fn solid_of(
        &self,
        splats: ImportedSplats,
        views: Option<Views>,
        report: &mut Report,
        observer: Observer<'_>,
    ) -> Result<Scenes> {
        let effort = Effort::of(self.options.preset, self.harden);
        let amount = (effort, self.options.prune.max_triangles);
        let photos = self.photos.as_ref();
        let how = &self.dataset_options;
        let solid = gaussians::solid((self.path(), splats), photos, how, amount, report, observer)?;
        add(solid.stage, report, observer);
        Ok(Scenes { scenes: vec![solid.scene], views: views.or(solid.pictures), background: None })
    }

    /// The first file, for messages.
    fn path(&self) -> &Path {
        match self.inputs.first() {
            Some(BakeInput::File(path)) => path,
            _ => Path::new("scene"),
        }
    }

    /// Reads every input. Readers run one after the other, so that memory holds one file's spare
    /// buffers at a time.
    fn read(&self) -> Result<Inputs> {
        let is_stream =
            |input: &&BakeInput| matches!(input, BakeInput::File(p) if p.as_os_str() == "-");
        if self.inputs.iter().filter(is_stream).count() > 1 {
            return Err(Error::invalid("inputs", "- -", "standard input once"));
        }
        let options = self.dataset_options.read_options(self.sh_degree());
        let mut scenes = Vec::new();
        for input in &self.inputs {
            scenes.push(match input {
                BakeInput::Scene(scene) => ImportedScene::clone(scene),
                BakeInput::File(path) => match formats::read_content(path, &options)? {
                    Content::Scene(scene) => scene,
                    Content::Splats(splats) if self.inputs.len() == 1 => {
                        return Ok(Inputs::Splats(Box::new(splats)));
                    }
                    Content::Splats(_) => {
                        let reason =
                            "holds 3D Gaussians, which are baked alone: bake it to a .glb, then merge that";
                        return Err(Error::unsupported(path, reason));
                    }
                },
            });
        }
        Ok(Inputs::Scenes(scenes))
    }

    /// The SH degree to read: only the teacher draws more than degree 0.
    fn sh_degree(&self) -> u8 {
        let teaches = self.photos.is_none() && self.options.teacher.teacher == TeacherWhen::Auto;
        if teaches || self.harden.is_some() { 3 } else { 0 }
    }
}
