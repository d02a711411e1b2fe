//! A run that starts from a scene instead of points: a soft soup to be hardened, or any mesh.

use glam::{DVec3, Vec3};
use trisplat_scene::{Error, ImportedScene, Placement, Result, SceneNormalization, Soup};

/// The triangles of `scene` in training space. Undoes the `placement` of its file, and moves it like the data
/// set: `origin` is the world point at (0, 0, 0) of the data set.
///
/// Errors: more triangles than `most`, if given, or none at all.
pub(super) fn first_soup(
    scene: &ImportedScene,
    placement: &Placement,
    origin: DVec3,
    space: &SceneNormalization,
    most: Option<u64>,
) -> Result<Soup> {
    let mut soup = scene.scene.to_soup();
    if soup.is_empty() {
        return Err(Error::invalid("from", "a scene without triangles", "one or more triangles"));
    }
    if let Some(most) = most.filter(|most| soup.len() as u64 > *most) {
        let wants = format!("{} or more, as many as the scene to start from has", soup.len());
        return Err(Error::invalid("max_triangles", most, wants));
    }
    for corner in soup.vertices.iter_mut().flatten() {
        let world: Vec3 = (placement.to_world_f64(*corner) - origin).as_vec3();
        *corner = space.to_training(world);
    }
    Ok(soup)
}

/// Replaces the points of a data set without points: places of the triangles of `scene`, in its world.
pub(super) fn centers(scene: &ImportedScene, placement: &Placement, origin: DVec3) -> Vec<Vec3> {
    let center = |i: usize| {
        let sum: DVec3 = scene.scene.corners(i).iter().map(|corner| placement.to_world_f64(*corner)).sum();
        (sum / 3.0 - origin).as_vec3()
    };
    (0..scene.scene.triangle_count()).map(center).collect()
}
