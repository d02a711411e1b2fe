//! A file as an engine would draw it, baked in memory.

use crate::asset::{Asset, Placement, UpAxis};
use crate::bake::{BakeOptions, bake};
use crate::camera::Camera;
use crate::error::Result;
use crate::placed;
use crate::scene::{Loaded, Scene};
use crate::soup::Soup;
use glam::DVec3;

/// A file made ready to be drawn.
#[derive(Debug)]
pub struct Baked {
    /// Y-up, in chunks, in order.
    pub asset: Asset,
    /// What was read, when it was a soup.
    pub soup: Option<Soup>,
    /// How the file had been placed in its source's world.
    pub first: Placement,
    /// How the bake placed the asset in the file's frame.
    pub step: Placement,
}

impl Baked {
    /// Bakes with the default preset. Errors: see [`bake()`].
    pub fn new(loaded: Loaded) -> Result<Self> {
        let first = loaded.provenance.placement;
        let is_y_up = loaded.provenance.up.unwrap_or_default() == UpAxis::Y;
        let soup = match &loaded.scene {
            Scene::Soup(soup) => Some(soup.clone()),
            Scene::Mesh(_) => None,
        };
        let asset = bake(loaded, &BakeOptions::DEFAULT)?;
        let step = if is_y_up { Placement::IDENTITY } else { asset.provenance.placement };
        Ok(Self { asset, soup, first, step })
    }

    /// A camera of the source's world, whose point `origin` is its zero, in the frame of the asset.
    pub fn place(&self, camera: &Camera, origin: DVec3) -> Camera {
        placed::to_file(&placed::to_file(camera, &self.first, origin), &self.step, DVec3::ZERO)
    }
}
