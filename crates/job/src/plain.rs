//! The plain cases, one call each, with paths as people have them: read, bake, draw, score.

use super::baking::{BakeInput, BakeJob};
use super::evaluate::EvalJob;
use super::renderer::{BakedScene, SceneRenderer};
use super::scores::Scores;
use glam::DVec3;
use std::ops::ControlFlow;
use std::ops::Deref;
use std::path::Path;
use trisplat_bake::BakeOptions;
use trisplat_dataset::Dataset;
use trisplat_formats::{self as formats, ReadOptions, WrittenFiles, output::OutputOptions};
use trisplat_scene::{
    Asset, Error, ImportedScene, Limits, Placement, Result, Scene, camera::Camera, image::RgbImage, placed,
    report::Report,
};

/// Reads a scene of any format, with all of its colours.
///
/// Errors: a file that is missing, damaged, above the default limits, or of another kind.
pub fn read(path: impl AsRef<Path>) -> Result<ImportedScene> {
    formats::read(path.as_ref(), &ReadOptions::default())
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
    /// Writes the scene as the options of its bake say. The ending of `path` chooses the format; existing files are replaced.
    ///
    /// Errors: an unknown ending; a tileset, which [`BakeJob::save`] writes; what the operating system refuses.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<WrittenFiles> {
        let path = path.as_ref();
        if self.has_tiles {
            return Err(Error::invalid("output", path.display(), "`BakeJob::save`, which writes tiles"));
        }
        formats::write(&self.asset, path, &self.output)
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
/// Errors: options out of range, nothing left to draw.
pub fn bake(scene: impl Into<ImportedScene>, options: &BakeOptions) -> Result<Baked> {
    let done =
        BakeJob::new([BakeInput::scene(scene)], options.clone()).run(&mut |_| ControlFlow::Continue(()))?;
    let (output, has_tiles) = (options.output.clone(), options.tiles.tiles);
    Ok(Baked { asset: done.asset, report: done.report, output, has_tiles })
}

/// How [`draw`] draws a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Draw {
    /// As it was trained: the window function of the paper, blended by depth (Held et al. 2025, eq. 2 to 6). Soups only.
    Soft,
    /// As an engine draws it: opaque triangles and a depth buffer, with this many samples per pixel along each axis: 1, 2 or 4.
    Solid {
        /// Samples along each axis.
        samples: u32,
    },
}

/// What `camera`, in the coordinates of the scene, sees of it over black. [`RenderJob`](super::RenderJob) draws many pictures.
///
/// Errors: a mesh drawn soft; samples other than 1, 2 or 4; a picture above the default limits; nothing to draw.
pub fn draw(scene: &ImportedScene, camera: &Camera, how: Draw) -> Result<RgbImage> {
    let (whole, black) = (&Placement::IDENTITY, [0.0; 3]);
    let (mut renderer, camera) = match (how, &scene.scene) {
        (Draw::Soft, Scene::Soup(soup)) => (SceneRenderer::soft(soup.clone(), whole, None, black), *camera),
        (Draw::Soft, Scene::Mesh(_)) => {
            return Err(Error::invalid("scene", "a mesh", "a soup; `Draw::Solid` draws meshes"));
        }
        (Draw::Solid { samples }, Scene::Mesh(mesh)) => {
            (SceneRenderer::solid(mesh.clone(), whole, None, black, samples), *camera)
        }
        (Draw::Solid { samples }, Scene::Soup(_)) => {
            // The bake turns the scene upright, and the camera with it.
            let baked = BakedScene::new(scene.clone())?;
            let camera = placed::to_file(camera, &baked.bake_placement, DVec3::ZERO);
            (SceneRenderer::solid(baked.asset.mesh, whole, None, black, samples), camera)
        }
    };
    renderer.validate(camera.size, &Limits::DEFAULT)?;
    Ok(renderer.color(&camera))
}

/// How close the file at `path` comes to the held-out photos, drawn as an engine draws it: means over the photos.
///
/// Errors: an unreadable file; no held-out photos.
pub fn score(path: impl AsRef<Path>, photos: &Dataset) -> Result<Scores> {
    let mut job = EvalJob::new(path.as_ref());
    job.coverage = false;
    let report = job.run(photos)?;
    let file = report.steps.last().map(|step| step.mean);
    file.ok_or_else(|| Error::invalid("scene", path.as_ref().display(), "a scene that can be drawn"))
}
