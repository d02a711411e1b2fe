//! An evaluation job, from options to report: photos, forms of the scene, scores.

use super::extrapolation;
use super::grade::{Grade, Look};
use super::renderer::RenderOptions;
use super::representations::{self, Representation};
use super::scores::{self, EvalReport, ImageScore, RepresentationScore, ScoredPicture};
use super::shine::shine;
use glam::UVec2;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use trisplat_dataset::exposure::{
    Exposures, Light, Strengths, compared_points, own_exposures, points_of,
};
use trisplat_dataset::{Dataset, DatasetOptions, Photos, ShrunkSize, Split, View};
use trisplat_formats::{self as formats, Content};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::generator;
use trisplat_scene::{Result, parallel};
use trisplat_train::BackendOptions;

/// An evaluation job. [`EvalJob::new`] fills in the defaults; set any field before running it.
///
/// ```
/// use trisplat_synthetic::SyntheticOptions;
/// use trisplat_dataset::Dataset;
/// use trisplat_dataset::DatasetOptions;
/// use trisplat_job::EvalJob;
/// # use glam::Vec3;
/// # let scene = trisplat_scene::Soup { vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]], opacity: vec![1.0], sigma: vec![0.01],
/// #     sh: vec![[0.5, 0.0, -0.5]], ..trisplat_scene::Soup::default() };
///
/// let folder = tempfile::tempdir().unwrap();
/// trisplat_synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let file = folder.path().join("scene.glb");
/// trisplat_formats::write(&trisplat_bake::bake(scene, &Default::default())?, &file, &Default::default())?;
///
/// let report = EvalJob::new(file).run(&dataset)?;
/// assert_eq!(report.steps[0].images.len(), dataset.test().count());
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct EvalJob {
    /// Trained soup (.ply .pt), mesh (.glb .gltf .obj .ply .off) or Gaussian splats (.ply .splat
    /// .spz .sog .glb).
    ///
    /// A mesh is drawn as an engine draws it. A soup is drawn soft, as it was trained; solid, after
    /// a bake with default options; and from a quantised and compressed file. This shows the loss
    /// of each step. Gaussian splats are drawn as their trainers draw them.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub file: PathBuf,
    /// Kind of drawing.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub render: RenderOptions,
    /// Photos to score.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub split: Split,
    /// Device for soft drawings.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Backend"))]
    pub backend: BackendOptions,
    /// Reading options of the data set.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub dataset_options: DatasetOptions,
    /// Also measure depth at tracked points, and the coverage of views beside the cameras.
    #[cfg_attr(feature = "cli", arg(skip = true))]
    pub extrapolation: bool,
}

/// An evaluation with its scene in memory.
#[derive(Debug)]
pub struct ReadyEval<'a> {
    job: EvalJob,
    dataset: &'a Dataset,
    views: Vec<&'a View>,
    steps: Vec<Representation>,
    /// Shares of the photos' exposures that were corrected in training.
    corrected: Strengths,
    warnings: Vec<String>,
}

impl EvalJob {
    /// Evaluates on held-out photos, for data sets read with [`DatasetOptions::default`].
    pub fn new(file: impl Into<PathBuf>) -> Self {
        Self {
            file: file.into(),
            render: RenderOptions::default(),
            split: Split::default(),
            backend: BackendOptions::default(),
            dataset_options: DatasetOptions::default(),
            extrapolation: true,
        }
    }

    /// Reads, draws and measures the scene.
    ///
    /// # Errors
    ///
    /// Errors of [`EvalJob::prepare`] and of [`ReadyEval::run`].
    pub fn run(self, dataset: &Dataset) -> Result<EvalReport> {
        let mut ready = self.prepare(dataset)?;
        ready.draw_on(|_, _| {})?;
        ready.run(|_, _| Ok(()))
    }

    /// Reads the scene and prepares the forms to evaluate.
    ///
    /// # Errors
    ///
    /// A split without photos; an unreadable file; a mesh with a soft renderer; Gaussians with any.
    pub fn prepare(self, dataset: &Dataset) -> Result<ReadyEval<'_>> {
        // A split without photos is said before a file is read.
        self.split.some_of(dataset)?;
        let content = formats::read_content(&self.file, &self.dataset_options.read_options(3))?;
        self.prepare_content(content, dataset)
    }

    /// [`EvalJob::prepare`] with a scene in memory; the file is only a name for messages.
    pub(super) fn prepare_content(
        self,
        content: Content,
        dataset: &Dataset,
    ) -> Result<ReadyEval<'_>> {
        let views = self.split.some_of(dataset)?;
        let background = self.dataset_options.background.to_f32();
        let mut corrected = Strengths::NONE;
        let mut warnings = dataset.warnings.clone();
        let steps = match content {
            Content::Scene(loaded) => {
                corrected = loaded.provenance.exposure.map_or(Strengths::NONE, Strengths::from);
                warnings.extend(loaded.warnings.iter().cloned());
                representations::of_scene(&self.file, loaded, &self.render, dataset, background)?
            }
            Content::Splats(loaded) => {
                warnings.extend(loaded.warnings.iter().cloned());
                representations::of_splats(loaded, &self.render, dataset, background)?
            }
        };
        if views.iter().any(|view| view.photo.mask.is_some() && !view.photo.is_cut()) {
            warnings.push("masked pixels were left out of the scores".into());
        }
        Ok(ReadyEval { job: self, dataset, views, steps, corrected, warnings })
    }
}

impl<'a> ReadyEval<'a> {
    /// The photos, sorted by name.
    pub fn views(&self) -> &[&'a View] {
        &self.views
    }

    /// The last form's triangles and near plane, in the data set's frame, if it is drawn as a mesh.
    pub(super) fn surface(&self) -> Option<(&Mesh, f32)> {
        self.steps.last()?.renderer.surface()
    }

    /// Names of the forms that the scene is drawn in.
    pub fn steps(&self) -> Vec<&'static str> {
        self.steps.iter().map(|step| step.name).collect()
    }

    /// Moves soft drawing to a graphics card if the backend says so; `chosen` gets each form's card
    /// and warnings.
    ///
    /// # Errors
    ///
    /// A card that was asked for and is not there.
    pub fn draw_on(&mut self, mut chosen: impl FnMut(Option<&str>, &[String])) -> Result<()> {
        for step in &mut self.steps {
            let (card, warnings) = step.renderer.draw_on(&self.job.backend)?;
            chosen(card.as_deref(), &warnings);
        }
        Ok(())
    }

    /// Draws and measures every photo; `on_view` gets the number of each and its drawings.
    ///
    /// # Errors
    ///
    /// Photos that cannot be decoded; those of `on_view`.
    pub fn run(
        mut self,
        on_view: impl FnMut(usize, &[ScoredPicture]) -> Result<()>,
    ) -> Result<EvalReport> {
        let photo_bytes = self.job.dataset_options.photo_bytes();
        let steps = self.scores(photo_bytes, on_view)?;
        Ok(EvalReport {
            generator: generator(),
            file: self.job.file.display().to_string(),
            dataset: self.dataset.path.display().to_string(),
            split: self.job.split.name().to_owned(),
            ssaa: self.job.render.ssaa,
            photo_size: ShrunkSize::of(self.views.iter().copied()),
            steps,
            warnings: self.warnings,
        })
    }

    /// The scores, step by step.
    fn scores(
        &mut self,
        photo_bytes: u64,
        mut on_view: impl FnMut(usize, &[ScoredPicture]) -> Result<()>,
    ) -> Result<Vec<RepresentationScore>> {
        let views = &self.views;
        for step in &self.steps {
            views.iter().try_for_each(|view| {
                step.renderer.validate(view.camera.size, &view.photo.limits)
            })?;
        }
        let own = self.own_exposures()?;
        let views = &self.views;
        let mut photos = Photos::new(views.iter().map(|v| v.photo.clone()).collect(), photo_bytes);
        photos.prefetch(0..views.len());
        let mut images: Vec<Vec<ImageScore>> = vec![Vec::new(); self.steps.len()];
        let mut looks: Vec<Vec<Look>> = vec![Vec::new(); self.steps.len()];
        let mut at_own: Vec<Option<f64>> = vec![Some(0.0); self.steps.len()];
        let mut secs = vec![0.0; self.steps.len()];
        for (i, view) in views.iter().enumerate() {
            let photo = photos.take(i)?;
            let mut drawn = Vec::with_capacity(self.steps.len());
            for (step, secs) in self.steps.iter_mut().zip(&mut secs) {
                let clock = Instant::now();
                let measured = step.measure(view, &photo);
                drawn.push(ScoredPicture {
                    psnr_own_exposure: own[i].map(|own| psnr_at(&measured.picture, own, &photo)),
                    ..measured
                });
                *secs += clock.elapsed().as_secs_f64();
            }
            on_view(i, &drawn)?;
            for (sum, drawn) in at_own.iter_mut().zip(&drawn) {
                *sum = sum.zip(drawn.psnr_own_exposure).map(|(sum, psnr)| sum + psnr);
            }
            for ((images, looks), drawn) in images.iter_mut().zip(&mut looks).zip(drawn) {
                looks.push(Look::of(&drawn.picture, &photo));
                images.push(drawn.score);
            }
        }
        let mut scores: Vec<RepresentationScore> = Vec::with_capacity(self.steps.len());
        for ((((step, images), looks), at_own), draw_secs) in
            self.steps.iter().zip(images).zip(looks).zip(at_own).zip(secs)
        {
            let mean = scores::mean(images.iter().map(|image| &image.score));
            let beside = step
                .renderer
                .surface()
                .and_then(|(mesh, near)| extrapolation::coverage(mesh, near, self.dataset));
            let surface = step.renderer.surface().filter(|_| self.job.extrapolation);
            scores.push(RepresentationScore {
                depth: surface
                    .and_then(|(mesh, near)| extrapolation::depth(mesh, near, self.dataset)),
                beside: beside.filter(|_| self.job.extrapolation),
                grade: Some(Grade::of(Look::mean(&looks), beside)),
                shine: surface.and_then(|(mesh, near)| shine(mesh, near, self.dataset)),
                name: step.name.to_owned(),
                triangles: step.triangles,
                splats: step.renderer.splat_count(),
                bytes: step.bytes,
                mean,
                psnr_own_exposure: at_own.map(|sum| sum / images.len() as f64),
                change: scores.last().map(|before| mean.minus(&before.mean)),
                images,
                draw_secs,
            });
        }
        Ok(scores)
    }

    /// Exposure corrections of drawings to each evaluated photo, as logarithms; `None` for unknown
    /// ones. Nothing is read where no evaluated photo tracks points.
    fn own_exposures(&self) -> Result<Vec<Option<[f32; 3]>>> {
        let is_tracked = |view: &&View| !view.tracked.is_empty();
        let unknown = vec![None; self.views.len()];
        let has_points =
            compared_points(self.dataset).is_some() && self.views.iter().all(is_tracked);
        if !self.job.extrapolation
            || !has_points
            || self.views.iter().any(|view| view.photo.is_cut())
        {
            return Ok(unknown);
        }
        let all = &self.dataset.views;
        let lights = parallel::map(all, |_, view| {
            let photo = Arc::new(view.photo.decode()?);
            Ok(Light::of_photo(&photo, &points_of(self.dataset, view)))
        });
        let lights = lights.into_iter().collect::<Result<Vec<_>>>()?;
        let sizes: Vec<UVec2> = all.iter().map(|view| view.camera.size).collect();
        let is_trained: Vec<bool> = all.iter().map(|view| !view.test).collect();
        let own = own_exposures(&lights, &sizes, &is_trained, self.corrected);
        let of_view =
            |view: &&View| own[all.iter().position(|other| std::ptr::eq(other, *view))?];
        Ok(self.views.iter().map(of_view).collect())
    }
}

/// PSNR of `picture`, brightened by the logarithms `own`, against `photo`, dB.
fn psnr_at(picture: &RgbImage, own: [f32; 3], photo: &RgbImage) -> f64 {
    let brightening = Exposures { gains: vec![own.map(|gain| -gain)], falloff: vec![0.0] };
    let brightened = brightening.correct(0, picture);
    let drawn = brightened.as_ref().unwrap_or(picture);
    metric::psnr(&drawn.rgb, &photo.rgb, photo.alpha.as_deref())
}

impl Representation {
    /// Draws a view and measures it against its photo; objects over black and over white.
    fn measure(&mut self, view: &View, photo: &RgbImage) -> ScoredPicture {
        let mut draw = |background| self.renderer.color_over(&view.camera, background);
        if !(view.photo.is_cut() && photo.alpha.is_some()) {
            scores::measure(self.name, &view.name, photo, draw(None))
        } else {
            scores::measure_cut(self.name, &view.name, photo, |color| draw(Some(color)))
        }
    }
}
