//! The plain cases, one call each: read, write, bake, draw, score.

use super::any_scene::AnyScene;
use super::baking::{BakeInput, BakeJob, Baked};
use super::evaluate::EvalJob;
use super::renderer::{BakedScene, SceneRenderer};
use super::scores::Scores;
use glam::DVec3;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use trisplat_bake::BakeOptions;
use trisplat_dataset::Dataset;
use trisplat_formats::{
    self as formats, Content, Format, OutputOptions, ReadOptions, WrittenFiles, ply,
};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::report::OutputReport;
use trisplat_scene::{
    Asset, Error, ImportedScene, ImportedSplats, Limits, Placement, Result, Scene, frames,
};
use trisplat_train::SOLID_SAMPLES;

const BLACK: [f32; 3] = [0.0; 3];

/// Reads a scene of any format, with all of its colours.
///
/// # Errors
///
/// A file that is missing, damaged, above the default limits, or of another kind.
pub fn read(path: impl AsRef<Path>) -> Result<AnyScene> {
    formats::read_content(path.as_ref(), &ReadOptions::default()).map(AnyScene::from)
}

/// Reads a scene from the bytes of a file.
///
/// # Errors
///
/// As of [`read`].
pub fn read_bytes(bytes: &[u8], format: Format) -> Result<AnyScene> {
    formats::read_content_bytes(bytes, format, &ReadOptions::default()).map(AnyScene::from)
}

/// Writes a scene without baking it: a mesh in the format of the ending of `path`, a soup as .ply.
/// Existing files are replaced.
///
/// # Errors
///
/// An unknown ending; a soup in another format than .ply; Gaussians, which have no writer; refusals
/// of the operating system.
pub fn write(scene: &AnyScene, path: impl AsRef<Path>) -> Result<WrittenFiles> {
    let path = path.as_ref();
    let loaded = match &scene.content {
        Content::Scene(loaded) => loaded,
        Content::Splats(_) => {
            return Err(Error::unsupported(
                path,
                "cannot hold Gaussians: `bake` makes a mesh of them",
            ));
        }
    };
    match &loaded.scene {
        Scene::Mesh(mesh) => {
            let provenance = loaded.provenance.clone();
            let asset = Asset { provenance, ..Asset::from(mesh.clone()) };
            formats::write(&asset, path, &OutputOptions::default())
        }
        Scene::Soup(soup) => {
            if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("ply")) {
                let reason = "cannot hold a soup: write it as .ply, or `bake` it";
                return Err(Error::unsupported(path, reason));
            }
            let mut file = AtomicFile::create(path)?;
            ply::write_soup(&mut file, soup, &loaded.provenance, &loaded.cameras)
                .map_err(|e| Error::io(path, e))?;
            let bytes = file.commit()?;
            let files = vec![OutputReport { path: path.display().to_string(), bytes }];
            Ok(WrittenFiles { files, warnings: Vec::new() })
        }
    }
}

/// Bakes a scene for an engine, without photos; [`BakeJob`] takes photos, files and an observer.
///
/// # Errors
///
/// Options out of range, nothing left to draw.
pub fn bake(scene: impl Into<AnyScene>, options: &BakeOptions) -> Result<Baked> {
    BakeJob::new([BakeInput::scene(scene)], options.clone()).run(&mut |_| ControlFlow::Continue(()))
}

/// Draws one scene for many cameras, over black; [`RenderJob`](super::RenderJob) writes pictures of
/// photos.
#[derive(Debug)]
pub struct Renderer {
    scene: Mutex<SceneRenderer>,
    /// The frame of the drawn mesh, in the frame of the scene.
    placement: Placement,
}

impl Renderer {
    /// Draws as an engine does: opaque triangles and a depth buffer. A soup is baked first, once.
    /// Gaussians are drawn as their trainers draw them.
    ///
    /// # Errors
    ///
    /// Nothing to draw.
    pub fn new(scene: impl Into<AnyScene>) -> Result<Self> {
        let loaded = match scene.into().content {
            Content::Scene(loaded) => loaded,
            Content::Splats(ImportedSplats { splats, .. }) => {
                let placement = Placement::IDENTITY;
                let scene = SceneRenderer::splats(splats, &placement, None, BLACK);
                return Ok(Self { scene: Mutex::new(scene), placement });
            }
        };
        let (mesh, placement) = match loaded.scene {
            Scene::Mesh(mesh) => (mesh, Placement::IDENTITY),
            Scene::Soup(_) => {
                // The bake turns the scene upright, and the cameras with it.
                let baked = BakedScene::new(loaded)?;
                (baked.asset.mesh, baked.bake_placement)
            }
        };
        let scene = SceneRenderer::solid(mesh, &Placement::IDENTITY, None, BLACK, SOLID_SAMPLES);
        Ok(Self { scene: Mutex::new(scene), placement })
    }

    /// Draws a soup as it was trained: soft windows, blended by depth (Held et al. 2025, eq. 2 to
    /// 6).
    ///
    /// # Errors
    ///
    /// A mesh, whose triangles are solid; Gaussians.
    pub fn soft(scene: impl Into<AnyScene>) -> Result<Self> {
        let placement = Placement::IDENTITY;
        match scene.into().content {
            Content::Scene(ImportedScene { scene: Scene::Soup(soup), .. }) => {
                let scene = SceneRenderer::soft(soup, &placement, None, BLACK);
                Ok(Self { scene: Mutex::new(scene), placement })
            }
            Content::Scene(_) => {
                Err(Error::invalid("scene", "a mesh", "a soup; `Renderer::new` draws meshes"))
            }
            Content::Splats(_) => {
                Err(Error::invalid("scene", "Gaussians", "a soup; `Renderer::new` draws Gaussians"))
            }
        }
    }

    /// Draws the view of a camera in the coordinates of the scene.
    ///
    /// # Errors
    ///
    /// Numbers of the camera that are not finite; a picture above the default limits.
    pub fn draw(&self, camera: &Camera) -> Result<RgbImage> {
        camera.validate(&Limits::DEFAULT)?;
        let mut scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner);
        scene.validate(camera.size, &Limits::DEFAULT)?;
        Ok(scene.color(&frames::to_file(camera, &self.placement, DVec3::ZERO)))
    }
}

/// Scores a scene on the held-out photos, drawn as an engine draws it: means over the photos.
///
/// # Errors
///
/// No held-out photos; photos that cannot be decoded.
pub fn score(scene: impl Into<AnyScene>, photos: &Dataset) -> Result<Scores> {
    let mut job = EvalJob::new("scene");
    job.extrapolation = false;
    let ready = job.prepare_content(scene.into().into(), photos)?;
    let report = ready.run(|_, _| Ok(()))?;
    let last = report.steps.last().map(|step| step.mean);
    last.ok_or_else(|| Error::invalid("scene", "empty", "a scene that can be drawn"))
}
