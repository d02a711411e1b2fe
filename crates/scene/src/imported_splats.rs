//! Gaussian splats as a file holds them: with placement and cameras.

use crate::asset::Provenance;
use crate::camera::Camera;
use crate::floaters::MIN_OPACITY;
use crate::scene::{ImportedScene, Scene};
use crate::soup::Soup;
use crate::splats::Splats;

/// Gaussians as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedSplats {
    /// The Gaussians.
    pub splats: Splats,
    /// Their provenance and placement.
    pub provenance: Provenance,
    /// Repairs and omissions of reading, one sentence each.
    pub warnings: Vec<String>,
    /// Names and cameras of the photos they were trained on, in the frame of the file; empty when
    /// unknown.
    pub cameras: Vec<(String, Camera)>,
}

impl ImportedSplats {
    /// Triangles where the Gaussians are, except [`Floaters`](crate::Floaters), with the same
    /// placement and cameras, for choosing viewpoints.
    pub fn stand_in(&self) -> ImportedScene {
        let splats = &self.splats;
        let floaters = splats.floaters();
        let shows = |i: &usize| splats.opacity[*i] >= MIN_OPACITY && !floaters.is_floater[*i];
        let chosen = (0..splats.len()).filter(shows);
        self.with(splats.to_soup(chosen))
    }

    /// Removes [`Floaters`](crate::Floaters), with a warning.
    pub fn remove_floaters(&mut self) {
        let floaters = self.splats.floaters();
        let warning = floaters.warning(&self.splats);
        if warning.is_some() {
            self.splats.retain(|i| !floaters.is_floater[i]);
        }
        self.warnings.extend(warning);
    }

    /// `triangles` with the same placement and cameras.
    pub fn with(&self, triangles: Soup) -> ImportedScene {
        ImportedScene {
            scene: Scene::Soup(triangles),
            provenance: self.provenance.clone(),
            warnings: Vec::new(),
            cameras: self.cameras.iter().map(|(_, camera)| *camera).collect(),
        }
    }
}
