//! A scene after reading, divided into the scene itself and its far shell.

use super::far_shell::far_shell;
use super::viewpoint::{Scenery, viewpoint};
use glam::Vec3;
use trisplat_scene::{
    Provenance, Scene,
    camera::{Camera, Viewpoint},
};

/// A scene, and flags of its far shell.
#[derive(Debug)]
pub struct Surroundings<'a> {
    scene: &'a Scene,
    /// The triangles of the scene itself.
    before: Vec<usize>,
    behind: Vec<usize>,
}

impl<'a> Surroundings<'a> {
    /// By flags in its file, or by its shape.
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

    /// The first viewpoint, with `up` upwards; one of the photos' `cameras`, if there are any. `None` without
    /// visible triangles.
    pub fn viewpoint(&self, cameras: &[Camera], up: Vec3) -> Option<Viewpoint> {
        let corners = |i: usize| self.scene.corners(self.before[i]);
        let room = |from: Vec3| self.room(from);
        let scenery = Scenery { corners: &corners, count: self.before.len(), cameras, up, room: &room };
        viewpoint(&scenery).map(|chosen| chosen.viewpoint)
    }

    /// Distance from a place at which the scene is closed; infinite when it is open.
    pub fn room(&self, from: Vec3) -> f32 {
        let corners = self.behind.iter().flat_map(|triangle| self.scene.corners(*triangle));
        corners.map(|corner| corner.distance_squared(from)).fold(f32::INFINITY, f32::min).sqrt()
    }

    /// How far in a direction of length one from a place the scene is closed; infinite when it is open there.
    pub fn room_towards(&self, from: Vec3, way: Vec3) -> f32 {
        let hits = self.behind.iter().filter_map(|triangle| hit(self.scene.corners(*triangle), from, way));
        hits.fold(f32::INFINITY, f32::min)
    }
}

/// How far along a ray a triangle is, whichever side of it the ray meets.
pub fn hit([a, b, c]: [Vec3; 3], from: Vec3, way: Vec3) -> Option<f32> {
    let (ab, ac, off) = (b - a, c - a, from - a);
    let (across, around) = (way.cross(ac), off.cross(ab));
    let volume = ab.dot(across);
    // Of a ray along the triangle's plane all of these are infinite or no numbers.
    let (u, v, t) = (off.dot(across) / volume, way.dot(around) / volume, ac.dot(around) / volume);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t.is_finite()).then_some(t)
}

/// The direction that points up in the pictures of `cameras`; `otherwise` when there are none.
pub fn up_of(cameras: &[Camera], otherwise: Vec3) -> Vec3 {
    let sum = cameras.iter().map(|camera| -camera.rotation.row(1)).sum::<Vec3>();
    sum.try_normalize().unwrap_or(otherwise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::mesh::{Colors, Mesh};

    #[test]
    fn room_towards_ends_at_what_closes_the_scene_there() {
        // A thing at the origin, a wall two units to the left, half a wall three units ahead.
        let thing = [Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1];
        let left = [Vec3::new(-2.0, -9.0, -9.0), Vec3::new(-2.0, 20.0, -9.0), Vec3::new(-2.0, -9.0, 20.0)];
        let ahead = [Vec3::new(-9.0, 0.5, 3.0), Vec3::new(9.0, 0.5, 3.0), Vec3::new(0.0, 9.0, 3.0)];
        let positions = [thing, left, ahead].concat();
        let mesh = Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; 3]), ..Mesh::default() };
        let provenance = Provenance { backdrop: 2, ..Provenance::default() };
        let scene = Scene::Mesh(mesh);
        let surroundings = Surroundings::of(&scene, &provenance);
        let room = |way: Vec3| surroundings.room_towards(Vec3::ZERO, way.normalize());
        assert!((room(-Vec3::X) - 2.0).abs() < 1e-6 && room(Vec3::X) == f32::INFINITY);
        assert!((room(Vec3::new(0.0, 1.0, 1.0)) - 3.0 * 2f32.sqrt()).abs() < 1e-5);
        assert_eq!((room(Vec3::Z), room(Vec3::Y)), (f32::INFINITY, f32::INFINITY));
    }
}
