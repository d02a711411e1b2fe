//! The first viewpoint of the file: the camera of the photo that shows the subject best or, without
//! photos, a place around it.
//!
//! Runs late, because it needs the final triangles, upright as placed.

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::framing::{ViewpointInput, viewpoint as best_viewpoint};
use trisplat_scene::Asset;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_surface::connected_faces;

/// Maximum number of triangles that tell whether a scene is a modelled mesh.
const MAX_EXAMINED: usize = 1 << 16;

/// The chosen viewpoint.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ViewpointDetails {
    /// Number of the photo taken there, counted from 0; absent for other viewpoints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo: Option<u64>,
    /// Share of the picture that shows the subject; absent when nothing was chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filled: Option<f64>,
}

trisplat_scene::stage!(ViewpointDetails, "viewpoint");

/// Chooses the viewpoint of `asset`, which is placed with +y up. `cameras` are those of photos in
/// its frame. Without any, the input's viewpoint is kept.
pub(crate) fn viewpoint(
    asset: &mut Asset,
    cameras: &[Camera],
    details: &mut ViewpointDetails,
) -> Outcome<()> {
    if cameras.is_empty() && asset.provenance.viewpoint.is_some() {
        return Outcome::Skipped(
            "the input says where to look from, and no camera is known that could do better",
        );
    }
    let mesh = &asset.mesh;
    let faces = asset.scene_faces();
    let room = |from: Vec3| asset.distance_to_backdrop(from);
    let corners = |face: usize| mesh.corners(face);
    let is_single_sided = |face: usize| asset.mesh.is_single_sided(face);
    let scenery = ViewpointInput {
        corners: &corners,
        is_single_sided: &is_single_sided,
        count: faces,
        is_surface: cameras.is_empty() && is_connected(&asset.mesh, faces),
        cameras,
        up: Vec3::Y,
        enclosure_distance: &room,
    };
    let chosen = best_viewpoint(&scenery).filter(|chosen| chosen.viewpoint.is_possible());
    let Some(chosen) = chosen else {
        return Outcome::Skipped("there is nothing to be seen");
    };
    details.photo = chosen.photo.map(|photo| photo as u64);
    details.filled = Some(chosen.coverage);
    asset.provenance.viewpoint = Some(chosen.viewpoint);
    Outcome::Changed(())
}

/// True if most triangles are of parts that share edges, as modelled ones do. The first of the
/// `faces` tell: the order of a file keeps neighbours together.
fn is_connected(mesh: &Mesh, faces: usize) -> bool {
    let faces = faces.min(MAX_EXAMINED);
    let positions = (0..faces).flat_map(|face| mesh.corners(face)).collect();
    let connected = connected_faces(&Mesh { positions, ..Mesh::default() });
    2 * connected.iter().filter(|is_connected| **is_connected).count() > faces
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::camera::Viewpoint;
    use trisplat_scene::math::geometry::octasphere;
    use trisplat_scene::mesh::{Colors, Mesh};

    fn spheres() -> Asset {
        let (corners, faces) = octasphere(2);
        let sphere = |radius: f32| {
            let corner = |i: u32| corners[i as usize] * radius;
            faces.iter().flat_map(|face| face.map(corner)).collect::<Vec<Vec3>>()
        };
        let positions = [sphere(1.0), sphere(3.0)].concat();
        let colors = Colors::Face(vec![[0.5; 3]; positions.len() / 3]);
        let mut asset = Asset::from(Mesh { positions, colors, ..Mesh::default() });
        asset.provenance.backdrop_faces = faces.len() as u32;
        asset
    }

    #[test]
    fn it_is_inside_the_backdrop_and_found_once() {
        let mut asset = spheres();
        let mut details = ViewpointDetails::default();
        assert_eq!(viewpoint(&mut asset, &[], &mut details), Outcome::Changed(()));
        let chosen = asset.provenance.viewpoint.expect("it was chosen");
        assert!(Vec3::from(chosen.eye.map(|x| x as f32)).length() < 3.0, "{chosen:?}");
        assert!(
            details.photo.is_none() && details.filled.is_some_and(|share| share > 0.1),
            "{details:?}"
        );
        let again = viewpoint(&mut asset, &[], &mut ViewpointDetails::default());
        assert!(matches!(again, Outcome::Skipped(_)));
        assert_eq!(asset.provenance.viewpoint, Some(chosen));
    }

    #[test]
    fn what_the_input_says_is_kept_unless_photos_know_better() {
        let stored = Viewpoint {
            eye: [0.0; 3],
            target: [1.0; 3],
            up: [0.0, 1.0, 0.0],
            fov: 50.0,
            radius: None,
            orbit: None,
        };
        let mut asset = spheres();
        asset.provenance.viewpoint = Some(stored);
        viewpoint(&mut asset, &[], &mut ViewpointDetails::default());
        assert_eq!(asset.provenance.viewpoint, Some(stored));
        let size = glam::UVec2::splat(100);
        let camera =
            stored.camera(size).with_look_at(Vec3::new(0.5, 1.0, 2.5), Vec3::ZERO, Vec3::Y);
        viewpoint(&mut asset, &[camera], &mut ViewpointDetails::default());
        assert_ne!(asset.provenance.viewpoint, Some(stored));
    }
}
