//! A scene that was read, parted into what it is about and what closes it far away.

use super::far_shell::far_shell;
use super::viewpoint::{Scenery, viewpoint};
use crate::asset::Provenance;
use crate::camera::{Camera, Viewpoint};
use crate::scene::Scene;
use glam::Vec3;

/// A scene and which of its triangles are far behind it.
#[derive(Debug)]
pub struct Surroundings<'a> {
    scene: &'a Scene,
    /// The triangles of the scene itself.
    before: Vec<usize>,
    behind: Vec<usize>,
}

impl<'a> Surroundings<'a> {
    /// By what its file says, or by its shape.
    pub fn of(scene: &'a Scene, provenance: &Provenance) -> Self {
        let count = scene.triangle_count();
        let backdrop = match scene {
            Scene::Mesh(_) => count - (provenance.backdrop as usize).min(count)..count,
            Scene::Soup(_) => count..count,
        };
        let corners = |triangle: usize| scene.corners(triangle);
        let said = !backdrop.is_empty() || scene.shell_count() > 0;
        let found = if said { None } else { far_shell(&corners, count) };
        let is_behind = |triangle: &usize| match &found {
            Some(far) => far[*triangle],
            None => backdrop.contains(triangle) || scene.is_shell(*triangle),
        };
        let (behind, before) = (0..count).partition::<Vec<usize>, _>(is_behind);
        Self { scene, before, behind }
    }

    /// Where to look at the scene from first, with `up` upwards; of places where `cameras` of its photos stood, if there are any.
    /// `None` when there is nothing to be seen.
    pub fn viewpoint(&self, cameras: &[Camera], up: Vec3) -> Option<Viewpoint> {
        let corners = |i: usize| self.scene.corners(self.before[i]);
        let room = |from: Vec3| self.room(from);
        let scenery = Scenery { corners: &corners, count: self.before.len(), cameras, up, room: &room };
        viewpoint(&scenery).map(|chosen| chosen.viewpoint)
    }

    /// How far from a place the scene is closed; infinite when it is open.
    pub fn room(&self, from: Vec3) -> f32 {
        let corners = self.behind.iter().flat_map(|triangle| self.scene.corners(*triangle));
        corners.map(|corner| corner.distance_squared(from)).fold(f32::INFINITY, f32::min).sqrt()
    }
}

/// The direction that points up in the pictures of `cameras`; `otherwise` when there are none.
pub fn up_of(cameras: &[Camera], otherwise: Vec3) -> Vec3 {
    let sum = cameras.iter().map(|camera| -camera.rotation.row(1)).sum::<Vec3>();
    sum.try_normalize().unwrap_or(otherwise)
}
