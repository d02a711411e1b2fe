//! A render job: cameras, renderer, pictures.

use super::renderer::{RenderMode, RenderOptions, SceneRenderer};
use super::representations;
use glam::{DVec3, UVec2, Vec3};
use std::path::PathBuf;
use trisplat_dataset::{Dataset, DatasetOptions, Split};
use trisplat_formats::{self as formats, Content, read_cameras};
use trisplat_raster::framing::{SceneEnclosure, mean_up, orbit};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{
    Error, ImportedScene, ImportedSplats, Placement, Provenance, Result, Scene, UpAxis, frames,
};
use trisplat_train::BackendOptions;

/// Width of an orbit's pictures without a data set, px.
pub const WIDTH: u32 = 960;

/// A render job. [`RenderJob::new`] fills in the defaults; set any field before running it.
///
/// ```
/// use trisplat_job::RenderJob;
/// # use glam::Vec3;
/// # let scene = trisplat_scene::Soup { vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]], opacity: vec![1.0], sigma: vec![0.01],
/// #     sh: vec![[0.5, 0.0, -0.5]], ..trisplat_scene::Soup::default() };
/// # let folder = tempfile::tempdir().unwrap();
/// # let file = folder.path().join("scene.glb");
/// # trisplat_formats::write(&trisplat_bake::bake(scene, &Default::default())?, &file, &Default::default())?;
///
/// let mut job = RenderJob::new(file);
/// (job.orbit, job.width) = (Some(3), 64);
/// let mut ready = job.prepare(None)?;
/// let picture = ready.draw(0)?;
/// assert_eq!((ready.cameras().len(), picture.size.to_array()), (3, [64, 48]));
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct RenderJob {
    /// Trained soup (.ply .pt), drawn soft unless --as says otherwise, or mesh (.glb .gltf .obj
    /// .ply .off). Or Gaussian splats (.ply .splat .spz .sog .glb), drawn as their trainers draw
    /// them.
    #[cfg_attr(feature = "cli", arg(value_name = "FILE"))]
    pub file: PathBuf,
    /// Kind of drawing.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub render: RenderOptions,
    /// List of cameras to draw from, as trainers of Gaussians write it: a cameras.json. For
    /// Gaussians, one beside the file is found.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", conflicts_with = "dataset"))]
    pub cameras: Option<PathBuf>,
    /// Photos whose cameras are used.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t, conflicts_with = "orbit"))]
    pub split: Split,
    /// Draw N pictures on a circle around the subject of the scene instead. It begins at the photo
    /// that shows the subject best, or without a data set at the first viewpoint of the file.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000)))]
    pub orbit: Option<u32>,
    /// Width of an orbit's pictures when no data set is given, px; the height is three quarters of
    /// it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = WIDTH, value_parser = clap::value_parser!(u32).range(1..=16384)))]
    pub width: u32,
    /// Quantity that the pictures show.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub show: PictureKind,
    /// Device for soft pictures.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Backend"))]
    pub backend: BackendOptions,
    /// Reading options of the data set.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub dataset_options: DatasetOptions,
}

/// A render job with its scene in memory and its cameras chosen.
#[derive(Debug)]
pub struct ReadyRender {
    job: RenderJob,
    cameras: Vec<(String, Camera)>,
    renderer: SceneRenderer,
}

impl RenderJob {
    /// Draws from the held-out photos' cameras, for data sets read with
    /// [`DatasetOptions::default`].
    pub fn new(file: impl Into<PathBuf>) -> Self {
        Self {
            file: file.into(),
            render: RenderOptions::default(),
            split: Split::default(),
            cameras: None,
            orbit: None,
            width: WIDTH,
            show: PictureKind::default(),
            backend: BackendOptions::default(),
            dataset_options: DatasetOptions::default(),
        }
    }

    /// Reads the scene and chooses the cameras.
    ///
    /// # Errors
    ///
    /// An unreadable file; no cameras; pictures that are too large.
    pub fn prepare(self, dataset: Option<&Dataset>) -> Result<ReadyRender> {
        match formats::read_content(&self.file, &self.dataset_options.read_options(3))? {
            Content::Scene(loaded) => self.prepare_scene(loaded, dataset),
            Content::Splats(loaded) => self.prepare_splats(loaded, dataset),
        }
    }

    fn prepare_scene(
        self,
        loaded: ImportedScene,
        dataset: Option<&Dataset>,
    ) -> Result<ReadyRender> {
        let mut loaded = baked_for_solid(&self, loaded)?;
        let listed = self.listed_cameras(&loaded.provenance.placement)?;
        if !listed.is_empty() {
            loaded.cameras = listed.iter().map(|(_, camera)| *camera).collect();
        }
        let cameras = self.choose_cameras(&loaded, listed, dataset)?;
        let ImportedScene { scene, provenance, .. } = loaded;
        let placement = &provenance.placement;
        let background = self.dataset_options.background.to_f32();
        let renderer = match scene {
            Scene::Soup(soup) => SceneRenderer::soft(soup, placement, dataset, background),
            Scene::Mesh(mesh) => {
                SceneRenderer::solid(mesh, placement, dataset, background, self.render.ssaa)
            }
        };
        self.ready(cameras, renderer)
    }

    fn ready(self, cameras: Vec<(String, Camera)>, renderer: SceneRenderer) -> Result<ReadyRender> {
        let limits = &self.dataset_options.limits;
        for (_, camera) in &cameras {
            renderer.validate(camera.size, limits)?;
        }
        Ok(ReadyRender { job: self, cameras, renderer })
    }

    fn prepare_splats(
        self,
        mut loaded: ImportedSplats,
        dataset: Option<&Dataset>,
    ) -> Result<ReadyRender> {
        representations::check_splats(&self.render)?;
        if self.show != PictureKind::Color {
            return Err(SceneRenderer::no_surface());
        }
        let placement = loaded.provenance.placement;
        if self.cameras.is_some() {
            loaded.cameras = self.listed_cameras(&placement)?;
        }
        let cameras = self.choose_cameras(&loaded.stand_in(), loaded.cameras.clone(), dataset)?;
        let background = self.dataset_options.background.to_f32();
        let renderer = SceneRenderer::splats(loaded.splats, &placement, dataset, background);
        self.ready(cameras, renderer)
    }

    /// The cameras of the list that was given, in the frame of the file.
    fn listed_cameras(&self, placement: &Placement) -> Result<Vec<(String, Camera)>> {
        let Some(list) = &self.cameras else { return Ok(Vec::new()) };
        let origin = DVec3::from(placement.center);
        let listed = read_cameras(list, origin, &self.dataset_options.limits)?;
        Ok(listed
            .into_iter()
            .map(|(name, c)| (name, frames::to_file(&c, placement, origin)))
            .collect())
    }

    /// The cameras of the pictures: in the data set's world, or in the file's frame without one.
    fn choose_cameras(
        &self,
        loaded: &ImportedScene,
        listed: Vec<(String, Camera)>,
        dataset: Option<&Dataset>,
    ) -> Result<Vec<(String, Camera)>> {
        match (dataset, self.orbit) {
            (_, Some(count)) => orbit_cameras(self, loaded, dataset, count),
            (Some(dataset), None) => Ok(self
                .split
                .some_of(dataset)?
                .iter()
                .map(|v| (v.name.clone(), v.camera))
                .collect()),
            (None, None) if !listed.is_empty() => Ok(listed),
            (None, None) => {
                let wants = "cameras to draw from: `orbit` 24 for a circle around the scene, `dataset` for those of its photos, or a list in `cameras`";
                Err(Error::invalid("cameras", "none", wants))
            }
        }
    }
}

impl ReadyRender {
    /// Names and cameras of the pictures, in drawing order.
    pub fn cameras(&self) -> &[(String, Camera)] {
        &self.cameras
    }

    /// Moves drawing to a graphics card if the backend says so. Returns the card and warnings.
    ///
    /// # Errors
    ///
    /// A card that was asked for and is not there.
    pub fn draw_on(&mut self) -> Result<(Option<String>, Vec<String>)> {
        match self.job.show {
            PictureKind::Color => self.renderer.draw_on(&self.job.backend),
            _ => Ok((None, Vec::new())),
        }
    }

    /// Draws one picture.
    ///
    /// # Errors
    ///
    /// Wires of a soup; depth and normals of Gaussians.
    pub fn draw(&mut self, camera: usize) -> Result<RgbImage> {
        let camera = &self.cameras[camera].1;
        let renderer = &mut self.renderer;
        match self.job.show {
            PictureKind::Color => Ok(renderer.color(camera)),
            PictureKind::Depth => renderer.depth(camera),
            PictureKind::Normal => renderer.normal(camera),
            PictureKind::Wires => renderer.wires(camera),
        }
    }
}

/// The quantity that a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum PictureKind {
    /// Colour.
    #[default]
    Color,
    /// Expected depth, near bright.
    Depth,
    /// Normals in camera space.
    Normal,
    /// Edges of the triangles that are seen; baked files only.
    Wires,
}

/// Reads the scene; bakes a soup for a solid renderer.
fn baked_for_solid(job: &RenderJob, loaded: ImportedScene) -> Result<ImportedScene> {
    match (&loaded.scene, job.render.mode) {
        (Scene::Mesh(_), Some(RenderMode::Soft)) => Err(representations::no_soup(&job.file)),
        (Scene::Soup(_), Some(RenderMode::Solid)) => {
            let asset = representations::baked(loaded)?;
            Ok(ImportedScene {
                scene: Scene::Mesh(asset.mesh),
                provenance: asset.provenance,
                warnings: Vec::new(),
                cameras: Vec::new(),
            })
        }
        _ => Ok(loaded),
    }
}

/// A circle of cameras around the subject, in the data set's world, or in the file's frame without
/// one.
fn orbit_cameras(
    job: &RenderJob,
    loaded: &ImportedScene,
    dataset: Option<&Dataset>,
    count: u32,
) -> Result<Vec<(String, Camera)>> {
    let Provenance { placement, up, viewpoint, .. } = &loaded.provenance;
    let usual = loaded.provenance.up_axis();
    let origin = dataset.map_or(DVec3::ZERO, |dataset| dataset.origin);
    let cameras: Vec<Camera> = match dataset {
        Some(dataset) => {
            dataset.views.iter().map(|v| frames::to_file(&v.camera, placement, origin)).collect()
        }
        None => loaded.cameras.clone(),
    };
    let size = match (dataset, cameras.first()) {
        (Some(_), Some(camera)) => camera.size,
        _ => UVec2::new(job.width, (job.width * 3 / 4).max(1)),
    };
    // A file that names its up axis knows it better than the photos do.
    let axis = usual.vector().as_vec3();
    let up = if *up == Some(UpAxis::Y) { axis } else { mean_up(&cameras, axis) };
    let enclosure = SceneEnclosure::of(&loaded.scene, &loaded.provenance);
    let stored = viewpoint.filter(|_| dataset.is_none());
    let viewpoint = stored.or_else(|| enclosure.viewpoint(&cameras, up));
    let viewpoint = viewpoint.ok_or_else(|| {
        Error::invalid("orbit", job.file.display(), "a scene with triangles that have an extent")
    })?;
    let target = DVec3::from(viewpoint.target).as_vec3();
    let room = |direction: Vec3| enclosure.distance_along(target, direction);
    let cameras =
        orbit(&viewpoint, up, &room, size, count).into_iter().map(|camera| match dataset {
            Some(_) => frames::to_world(&camera, placement, origin),
            None => camera,
        });
    Ok(cameras.enumerate().map(|(i, camera)| (format!("orbit_{i:04}.png"), camera)).collect())
}
