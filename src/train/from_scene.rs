//! A run that starts from a scene in place of points: a soft soup to be hardened, or any mesh.

use super::space::Space;
use crate::asset::Placement;
use crate::error::{Error, Result};
use crate::math::color::srgb_from_linear;
use crate::mesh::Mesh;
use crate::scene::{Loaded, Scene};
use crate::soup::{Soup, sh0_from_rgb};
use glam::{DVec3, Vec3};

/// σ of a mesh's triangles: solid, but with a slope that gradients pass.
const MESH_SIGMA: f32 = 0.05;
/// Opacity of a mesh's triangles: high, but below 1, where the logit has no slope.
const MESH_OPACITY: f32 = 0.95;

/// The triangles of `scene` in training space. Its file may have been placed anew, by `placement`, and the data set moved
/// near its origin: both are undone, `origin` is the world point that is (0, 0, 0) in the data set.
///
/// Errors: more triangles than `max_triangles`, none at all.
pub(super) fn first_soup(
    scene: &Loaded,
    placement: &Placement,
    origin: DVec3,
    space: &Space,
    max_triangles: u64,
) -> Result<Soup> {
    let mut soup = match &scene.scene {
        Scene::Soup(soup) => soup.clone(),
        Scene::Mesh(mesh) => solid_soup(mesh),
    };
    if soup.is_empty() {
        return Err(Error::invalid("from", "a scene without triangles", "one or more triangles"));
    }
    if soup.len() as u64 > max_triangles {
        let wants = format!("{} or more, as many as the scene to start from has", soup.len());
        return Err(Error::invalid("max_triangles", max_triangles, wants));
    }
    for corner in soup.vertices.iter_mut().flatten() {
        let world: Vec3 = (placement.to_world_f64(*corner) - origin).as_vec3();
        *corner = space.to_training(world);
    }
    Ok(soup)
}

/// What stands for the points of a data set that has none: where the triangles of `scene` are, in its world.
pub(super) fn centers(scene: &Loaded, placement: &Placement, origin: DVec3) -> Vec<Vec3> {
    let center = |corners: [Vec3; 3]| {
        let sum: DVec3 = corners.iter().map(|corner| placement.to_world_f64(*corner)).sum();
        (sum / 3.0 - origin).as_vec3()
    };
    match &scene.scene {
        Scene::Soup(soup) => soup.vertices.iter().map(|corners| center(*corners)).collect(),
        Scene::Mesh(mesh) => (0..mesh.face_count()).map(|face| center(mesh.corners(face))).collect(),
    }
}

/// A mesh as nearly solid triangles, each of the mean colour of its corners.
fn solid_soup(mesh: &Mesh) -> Soup {
    let count = mesh.face_count();
    let sh = |face: usize| {
        let corners = mesh.corner_colors(face).map(Vec3::from);
        let mean = (corners[0] + corners[1] + corners[2]) / 3.0;
        mean.to_array().map(|channel| sh0_from_rgb(srgb_from_linear(channel)))
    };
    let opacity = |face: usize| mesh.opacity.get(face).map_or(MESH_OPACITY, |o| o.min(MESH_OPACITY));
    Soup {
        vertices: (0..count).map(|face| mesh.corners(face)).collect(),
        opacity: (0..count).map(opacity).collect(),
        sigma: vec![MESH_SIGMA; count],
        sh: (0..count).map(sh).collect(),
        sh_degree: 0,
    }
}
