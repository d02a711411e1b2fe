//! The sides of triangles: those that photos show from one side are drawn from that side only.
//!
//! Training never compared the other side with a photo. Drawn from there, such triangles are shards
//! in front of what photos do show, and walls that hide a room from outside. Triangles that no
//! photo shows keep both sides, because nothing says which is seen.

use crate::views;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};

/// From which sides triangles are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Sides {
    /// From the side that at least 90% of the photos' pixels show; else from both
    Auto,
    /// From both, unless a mesh says otherwise
    Both,
}

/// Options of the sides of triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SidesOptions {
    /// From which sides triangles are drawn
    pub sides: Sides,
}

impl SidesOptions {
    /// As photos saw them.
    pub const DEFAULT: Self = Self { sides: Sides::Auto };
    /// From both sides: one material, and no pass over the cameras.
    pub const FAST: Self = Self { sides: Sides::Both };
}

trisplat_scene::default!(SidesOptions);

/// Sides of triangles that cameras see.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SidesDetails {
    /// Triangles that are drawn from one side from now on.
    pub single_sided: u64,
    /// Triangles that cameras see from both sides.
    pub two_sided: u64,
    /// Triangles that no camera sees.
    pub unseen: u64,
}

trisplat_scene::stage!(SidesDetails, "sides");

/// Minimum share of a triangle's pixels that show one side, for it to be drawn from there only: at
/// the outline of a surface a few pixels show the backs of triangles that lie across it.
const MIN_SHARE: f64 = 0.9;

/// Turns each face of `mesh` that `cameras` see from one side so that its front is there, and draws
/// it from its front only from now on. A mesh with single-sided faces keeps its sides.
pub fn sides(
    mesh: &mut Mesh,
    cameras: &[Camera],
    options: &SidesOptions,
    details: &mut SidesDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    if options.sides == Sides::Both {
        return Ok(Outcome::Skipped("`sides` both"));
    }
    if cameras.is_empty() {
        return Ok(Outcome::Skipped(
            "it needs cameras of photos: from a data set (`dataset`), or stored in the soup",
        ));
    }
    if mesh.single_sided.contains(&true) {
        return Ok(Outcome::Skipped("the input says from which sides triangles are drawn"));
    }
    let pixels = visible_sides(mesh, cameras, progress);
    let mut single_sided = vec![false; mesh.face_count()];
    for (face, [front, back]) in pixels.into_iter().enumerate() {
        if front + back == 0 {
            details.unseen += 1;
        } else if (front.max(back) as f64) < MIN_SHARE * (front + back) as f64 {
            details.two_sided += 1;
        } else {
            details.single_sided += 1;
            single_sided[face] = true;
            if back > front {
                mesh.flip(face);
            }
        }
    }
    if details.single_sided == 0 {
        return Ok(Outcome::Skipped("cameras see every triangle from both sides, or not at all"));
    }
    mesh.single_sided = single_sided;
    Ok(Outcome::Changed(()))
}

/// The pixels of all cameras together that show the front and the back of each face. `[F]`
fn visible_sides(
    mesh: &Mesh,
    cameras: &[Camera],
    progress: &mut StageProgress<'_>,
) -> Vec<[u64; 2]> {
    let options = views::drawing(cameras, mesh, 1);
    let mut solid = SolidRasterizer::new();
    let mut pixels = vec![[0; 2]; mesh.face_count()];
    let mut camera_pixels = vec![0u32; mesh.face_count()];
    for (done, camera) in cameras.iter().enumerate() {
        progress.set(done, cameras.len());
        for face in
            solid.visibility(mesh, camera, &options).face.iter().filter(|face| **face != NO_FACE)
        {
            camera_pixels[*face as usize] += 1;
        }
        let eye = camera.position();
        for (face, count) in camera_pixels.iter_mut().enumerate().filter(|(_, count)| **count > 0) {
            let [a, b, c] = mesh.corners(face).map(|corner| (corner - eye).as_dvec3());
            let is_back = (b - a).cross(c - a).dot(a) > 0.0;
            pixels[face][usize::from(is_back)] += u64::from(std::mem::take(count));
        }
    }
    pixels
}
