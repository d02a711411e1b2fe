//! The plain cases, one call each: read, bake, draw, score.

use super::baking::{BakeInput, BakeJob};
use super::evaluate::EvalJob;
use super::renderer::{BakedScene, SceneRenderer};
use super::scores::Scores;
use glam::DVec3;
use std::ops::{ControlFlow, Deref};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use trisplat_bake::BakeOptions;
use trisplat_dataset::Dataset;
use trisplat_formats::output::{OutputOptions, WriteDetails};
use trisplat_formats::{self as formats, Format, ReadOptions, WrittenFiles, gltf};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Error, ImportedScene, Limits, Placement, Result, Scene, frames};
use trisplat_train::SOLID_SAMPLES;

const BLACK: [f32; 3] = [0.0; 3];

/// Reads a scene of any format, with all of its colours.
///
/// # Errors
///
/// A file that is missing, damaged, above the default limits, or of another kind.
pub fn read(path: impl AsRef<Path>) -> Result<ImportedScene> {
    formats::read(path.as_ref(), &ReadOptions::default())
}

/// Reads a scene from the bytes of a file.
///
/// # Errors
///
/// As of [`read`].
pub fn read_bytes(bytes: &[u8], format: Format) -> Result<ImportedScene> {
    formats::read_bytes(bytes, format, &ReadOptions::default())
}

/// A baked scene, and the files that it was baked for.
#[derive(Debug, Clone)]
pub struct Baked {
    /// What an engine draws.
    pub asset: Asset,
    /// Options and stages.
    pub report: Report,
    output: OutputOptions,
    has_tiles: bool,
}

impl Baked {
    /// Writes the scene as the options of its bake say. The ending of `path` chooses the format;
    /// existing files are replaced.
    ///
    /// # Errors
    ///
    /// An unknown ending; a tileset, which [`BakeJob::save`] writes; what the operating system
    /// refuses.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<WrittenFiles> {
        let path = path.as_ref();
        if self.has_tiles {
            return Err(Error::invalid(
                "output",
                path.display(),
                "`BakeJob::save`, which writes tiles",
            ));
        }
        formats::write(&self.asset, path, &self.output)
    }

    /// The bytes of a GLB as the options of its bake say, without the files beside it.
    ///
    /// # Errors
    ///
    /// Nothing to draw, or more than a GLB holds.
    pub fn to_glb(&self) -> Result<Vec<u8>> {
        gltf::to_glb_bytes(&self.asset, &self.output.encoding(&mut WriteDetails::default()))
    }
}

impl Deref for Baked {
    type Target = Asset;

    fn deref(&self) -> &Asset {
        &self.asset
    }
}

/// Bakes a scene for an engine, without photos; [`BakeJob`] takes photos, files and an observer.
///
/// # Errors
///
/// Options out of range, nothing left to draw.
pub fn bake(scene: impl Into<ImportedScene>, options: &BakeOptions) -> Result<Baked> {
    let done = BakeJob::new([BakeInput::scene(scene)], options.clone())
        .run(&mut |_| ControlFlow::Continue(()))?;
    let output = options.output.clone();
    let has_tiles = options.tiles.tiles;
    Ok(Baked { asset: done.asset, report: done.report, output, has_tiles })
}

/// Draws one scene for many cameras, over black; [`RenderJob`](super::RenderJob) writes pictures of
/// photos.
#[derive(Debug)]
pub struct Renderer {
    scene: Mutex<SceneRenderer>,
    /// The frame of what is drawn, in the frame of the scene.
    placement: Placement,
}

impl Renderer {
    /// Draws as an engine does: opaque triangles and a depth buffer. A soup is baked first, once.
    ///
    /// # Errors
    ///
    /// Nothing to draw.
    pub fn new(scene: &ImportedScene) -> Result<Self> {
        let (mesh, placement) = match &scene.scene {
            Scene::Mesh(mesh) => (mesh.clone(), Placement::IDENTITY),
            Scene::Soup(_) => {
                // The bake turns the scene upright, and the cameras with it.
                let baked = BakedScene::new(scene.clone())?;
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
    /// A mesh, whose triangles are solid.
    pub fn soft(scene: &ImportedScene) -> Result<Self> {
        let placement = Placement::IDENTITY;
        match &scene.scene {
            Scene::Soup(soup) => {
                let scene = SceneRenderer::soft(soup.clone(), &placement, None, BLACK);
                Ok(Self { scene: Mutex::new(scene), placement })
            }
            Scene::Mesh(_) => {
                Err(Error::invalid("scene", "a mesh", "a soup; `Renderer::new` draws meshes"))
            }
        }
    }

    /// What a camera in the coordinates of the scene sees.
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

/// How close the file at `path` comes to the held-out photos, drawn as an engine draws it: means
/// over the photos.
///
/// # Errors
///
/// An unreadable file; no held-out photos.
pub fn score(path: impl AsRef<Path>, photos: &Dataset) -> Result<Scores> {
    let report = EvalJob::new(path.as_ref()).run(photos)?;
    let file = report.steps.last().map(|step| step.mean);
    file.ok_or_else(|| {
        Error::invalid("scene", path.as_ref().display(), "a scene that can be drawn")
    })
}
