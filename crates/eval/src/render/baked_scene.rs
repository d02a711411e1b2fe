//! A file as an engine would draw it, baked in memory.

use glam::DVec3;
use trisplat_bake::{BakeOptions, TeacherOptions, bake};
use trisplat_scene::{Asset, ImportedScene, Placement, Result, Scene, Soup, camera::Camera, placed};

/// A scene baked in memory, ready for drawing.
#[derive(Debug)]
pub struct BakedScene {
    /// Y-up, in chunks, in order.
    pub asset: Asset,
    /// The input, if it was a soup.
    pub soup: Option<Soup>,
    /// The bake's placement, in the file's frame.
    pub bake_placement: Placement,
}

impl BakedScene {
    /// Bakes with the default preset and unchanged colours. Errors: see [`bake()`].
    pub fn new(loaded: ImportedScene) -> Result<Self> {
        let file_placement = loaded.provenance.placement;
        let soup = match &loaded.scene {
            Scene::Soup(soup) => Some(soup.clone()),
            Scene::Mesh(_) => None,
        };
        let options = BakeOptions { teacher: TeacherOptions::OFF, ..BakeOptions::DEFAULT };
        let asset = bake(loaded, &options)?;
        let bake_placement = file_placement.inverse().then(&asset.provenance.placement);
        Ok(Self { asset, soup, bake_placement })
    }

    /// A camera of the source's world, given relative to its point `origin`, in the frame of the asset.
    pub fn place(&self, camera: &Camera, origin: DVec3) -> Camera {
        placed::to_file(camera, &self.asset.provenance.placement, origin)
    }
}
