//! Closes holes, pixels of photos that no triangle covers, by a far sphere behind everything. The
//! next stage takes its colours from the photos.
//!
//! A soft scene hides its holes under haze; a solid one shows the engine's background through them.
//! The sphere does not belong to the scene: its triangles come last, [`Provenance::backdrop_faces`]
//! counts them, and files store them separately. They are visible from inside only, so a viewer
//! outside looks through the near side.
//!
//! [`Provenance::backdrop_faces`]: trisplat_scene::Provenance::backdrop_faces

use super::closed_surface::{MAX_SUBDIVISIONS, MIN_COVERED, RADIUS_FACTOR, closed_surface};
use crate::budget::TriangleBudget;
use crate::views::Views;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::geometry::face_count;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::Outcome;

/// Photos that are searched for holes.
const VIEWS: usize = 16;
/// Holes below this share of the photos are not closed.
const MIN_HOLES: f64 = 0.001;
/// The sphere has at most one triangle per this many of the scene, or 8 · 4² if that is more; a
/// budget may leave it fewer.
const SCENE_PER_BACKDROP: usize = 20;

/// Condition for a backdrop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum BackdropWhen {
    /// When photos show something where no triangle is, as the node `backdrop` of the output
    Auto,
    /// Always with photos, as the node `backdrop` of the output
    Sphere,
    /// Always with photos, in a file of its own: OUT.backdrop.glb
    File,
    /// Always with photos, as a panorama for the sky of an engine: OUT.sky.jpg
    Sky,
    /// Never; a backdrop of the input is removed
    Off,
}

/// The backdrop of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct BackdropOptions {
    /// When a far sphere is put behind the scene, with the photos' colours where they see it
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = BackdropOptions::DEFAULT.backdrop, value_name = "WHEN"))]
    pub backdrop: BackdropWhen,
}

impl BackdropOptions {
    /// Closes holes if there are any.
    pub const DEFAULT: Self = Self { backdrop: BackdropWhen::Auto };

    /// The triangles of a budget that are left for the scene itself.
    pub fn scene_budget(&self, budget: Option<u64>) -> Option<u64> {
        let total = budget?;
        if self.backdrop == BackdropWhen::Off {
            return budget;
        }
        let sphere = subdivisions(total as usize, TriangleBudget::new(budget).surroundings);
        Some(total - sphere.map_or(0, face_count))
    }
}

trisplat_scene::default!(BackdropOptions);

/// Measurements of holes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackdropDetails {
    /// Share of the photos' pixels without a triangle; absent when photos were not searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holes: Option<f64>,
    /// True when the backdrop is that of the input.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub kept: bool,
}

trisplat_scene::stage!(BackdropDetails, "backdrop");

/// Puts a sphere behind `mesh` when `views` see holes in it, and the `budget` of surroundings
/// leaves room for it.
///
/// # Errors
///
/// A photo that cannot be decoded.
pub fn backdrop(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &BackdropOptions,
    budget: Option<u64>,
    details: &mut BackdropDetails,
) -> Result<Outcome<()>> {
    let Some(views) = views.filter(|v| !v.is_empty()) else {
        return Ok(Outcome::Skipped("it needs photos (`dataset`) or a soft scene (`teacher`)"));
    };
    if options.backdrop == BackdropWhen::Off {
        return Ok(Outcome::Skipped("`backdrop` off"));
    }
    if !mesh.indices.is_empty() {
        return Ok(Outcome::Skipped("a mesh with shared vertices is left as it is"));
    }
    if views.covered() < MIN_COVERED {
        return Ok(Outcome::Skipped("the scene is an object: there is nothing behind it"));
    }
    let holes = find_holes(mesh, views)?;
    details.holes = Some(holes.share);
    if options.backdrop == BackdropWhen::Auto && views.are_cut() && holes.unmasked < 1.0 {
        return Ok(Outcome::Skipped(
            "photos show an object without background: there is nothing behind it",
        ));
    }
    if options.backdrop == BackdropWhen::Auto && holes.unmasked < MIN_COVERED {
        return Ok(Outcome::Skipped("masks leave an object: there is nothing behind it"));
    }
    if options.backdrop == BackdropWhen::Auto && holes.share < MIN_HOLES {
        return Ok(Outcome::Skipped("triangles cover the photos"));
    }
    let Some(subdivisions) = subdivisions(mesh.face_count(), budget) else {
        return Ok(Outcome::Skipped("`max_triangles` leaves no room for what is behind"));
    };
    let center = views.center();
    let far = mesh.positions.iter().map(|v| v.distance_squared(center)).fold(0.0, f32::max).sqrt();
    let radius = far.max(views.radius()) * RADIUS_FACTOR;
    let (mut sphere, _) = closed_surface(center, subdivisions, None, radius);
    sphere.colors = Colors::Face(vec![holes.color; sphere.face_count()]);
    sphere.single_sided = vec![true; sphere.face_count()];
    mesh.append(sphere)?;
    Ok(Outcome::Changed(()))
}

/// Puts the backdrop of the input behind `mesh` again, unless none is wanted.
///
/// # Errors
///
/// More vertices than 32 bits count.
pub(crate) fn keep_backdrop(
    mesh: &mut Mesh,
    mut input_backdrop: Mesh,
    options: &BackdropOptions,
    details: &mut BackdropDetails,
) -> Result<Outcome<()>> {
    if options.backdrop == BackdropWhen::Off {
        return Ok(Outcome::Skipped("`backdrop` off: that of the input is left out"));
    }
    input_backdrop.single_sided = vec![true; input_backdrop.face_count()];
    mesh.append(input_backdrop)?;
    details.kept = true;
    Ok(Outcome::Changed(()))
}

/// Pixels of photos that no triangle covers.
struct BackdropHoles {
    /// Share of holes among the pixels outside masks.
    share: f64,
    /// Share of pixels outside masks.
    unmasked: f64,
    /// Mean colour, linear.
    color: [f32; 3],
}

fn find_holes(mesh: &Mesh, views: &mut Views) -> Result<BackdropHoles> {
    let drawing = views.drawing(mesh, 1);
    let mut solid = SolidRasterizer::new();
    let mut open = 0.0;
    let mut all = 0.0;
    let mut color = [0.0f64; 3];
    let mut pixels = 0;
    let chosen = views.evenly_spaced(VIEWS);
    views.prefetch(&chosen);
    for view in chosen {
        let photo = views.photo(view)?;
        let seen = solid.visibility(mesh, views.camera(view), &drawing);
        pixels += seen.face.len();
        for (pixel, face) in seen.face.iter().enumerate() {
            let weight = photo.alpha.as_ref().map_or(1.0, |a| f64::from(a[pixel]) / 255.0);
            all += weight;
            if *face == NO_FACE {
                open += weight;
                for (sum, code) in color.iter_mut().zip(photo.rgb[pixel]) {
                    *sum += weight * f64::from(linear_from_srgb(f32::from(code) / 255.0));
                }
            }
        }
    }
    let mean = color.map(|sum| (sum / f64::max(open, 1e-9)) as f32);
    let unmasked = all / pixels.max(1) as f64;
    Ok(BackdropHoles { share: open / f64::max(all, 1e-9), unmasked, color: mean })
}

/// Subdivisions of the octahedron for a scene of `faces`; `None` where the budget of surroundings
/// leaves no room for it.
fn subdivisions(faces: usize, budget: Option<u64>) -> Option<u32> {
    let fits = |l: &u32| face_count(*l) as usize * SCENE_PER_BACKDROP <= faces;
    let finest = (3..=MAX_SUBDIVISIONS).rev().find(fits).unwrap_or(2);
    (1..=finest).rev().find(|l| budget.is_none_or(|budget| face_count(*l) <= budget))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_sphere_is_closed_and_of_the_promised_size() {
        for levels in 0..4 {
            let (mesh, _) = closed_surface(Vec3::ZERO, levels, None, 1.0);
            let faces: Vec<[Vec3; 3]> =
                (0..mesh.face_count()).map(|face| mesh.corners(face)).collect();
            assert_eq!(faces.len(), 8 << (2 * levels));
            // Solid angles of a closed sphere seen from its middle add up to 4π; flat faces
            // approach it by area.
            let area: f32 =
                faces.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
            let exact = 4.0 * std::f32::consts::PI;
            assert!(area < exact && (levels < 3 || area > 0.98 * exact), "{levels}: {area}");
            assert!(faces.iter().flatten().all(|v| (v.length() - 1.0).abs() < 1e-5));
            let inward = |[a, b, c]: &[Vec3; 3]| (*b - *a).cross(*c - *a).dot(*a + *b + *c) < 0.0;
            assert!(faces.iter().all(inward), "every front is inside");
        }
    }

    #[test]
    fn a_budget_is_never_exceeded() {
        for most in [1, 5, 300, 5000, 100_000, 2_000_000] {
            let scene = BackdropOptions::DEFAULT.scene_budget(Some(most)).unwrap_or(0);
            let behind = subdivisions(scene as usize, Some(most / 8)).map_or(0, face_count);
            assert!(scene + behind <= most && behind <= most / 8, "{most}: {scene} + {behind}");
            assert!(scene > 0 && (behind > 0 || most < 256), "{most}: {scene} + {behind}");
        }
    }
}
