//! Puts faces that are near in space near in the file, each within its chunk: compresses better and
//! keeps an engine's caches warm.

use glam::{DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::geometry::along_curve;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Chunk, Result, Scene};

/// The order of faces within a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FaceOrder {
    /// Along a space-filling curve
    Spatial,
    /// In the order of the input
    None,
}

/// The order of faces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OrderOptions {
    /// Order of the triangles within a chunk
    pub order: FaceOrder,
}

impl OrderOptions {
    /// Near faces stay near.
    pub const DEFAULT: Self = Self { order: FaceOrder::Spatial };
    /// In the order of the input.
    pub const FAST: Self = Self { order: FaceOrder::None };
}

trisplat_scene::default!(OrderOptions);

/// Effect of ordering.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OrderDetails {
    /// Faces that changed their place in the file.
    pub moved: u64,
}

trisplat_scene::stage!(OrderDetails, "order");

/// Orders the faces of every chunk.
pub fn order(
    asset: &mut Asset,
    options: &OrderOptions,
    details: &mut OrderDetails,
) -> Result<Outcome<()>> {
    if options.order == FaceOrder::None {
        return Ok(Outcome::Skipped("it was not asked for"));
    }
    let mesh = &asset.mesh;
    let faces_of = |chunk: &Chunk| (chunk.first..chunk.first + chunk.count).collect::<Vec<_>>();
    let order =
        parallel::map(&asset.chunks, |_, chunk| faces_along_curve(mesh, &faces_of(chunk))).concat();
    let moved = order.iter().zip(0..).filter(|&(&from, to)| from != to).count();
    if moved == 0 {
        return Ok(Outcome::Skipped("near faces are near in the file already"));
    }
    asset.mesh.select(&order);
    details.moved = moved as u64;
    Ok(Outcome::Changed(()))
}

/// Faces along a curve through their centroids.
pub(super) fn faces_along_curve(mesh: &Mesh, faces: &[u32]) -> Vec<u32> {
    let corners = |face: &u32| mesh.corners(*face as usize).map(|v| v.as_dvec3());
    let centroids: Vec<DVec3> =
        faces.iter().map(|face| corners(face).into_iter().sum::<DVec3>() / 3.0).collect();
    along_curve(&centroids).into_iter().map(|place| faces[place as usize]).collect()
}

// ---- Triangles that are near in space become near in memory -------------------------------------

/// Minimum number of triangles to arrange: the caches of a CPU hold them in any order.
const MIN_ARRANGED: usize = 16_384;

/// Effect of arranging.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ArrangeDetails {
    /// Triangles that changed their place.
    pub moved: u64,
}

trisplat_scene::stage!(ArrangeDetails, "arrange");

/// Arranges the triangles. `is_drawn`: a later stage draws the scene. `order`: the order in which
/// triangles are written.
pub(crate) fn arrange(
    scene: &mut Scene,
    is_drawn: bool,
    order: FaceOrder,
    details: &mut ArrangeDetails,
) -> Outcome<()> {
    if !is_drawn {
        return Outcome::Skipped("no stage draws the scene");
    }
    if order == FaceOrder::None {
        return Outcome::Skipped("the order of the input is kept");
    }
    if scene.triangle_count() < MIN_ARRANGED {
        return Outcome::Skipped("there are few triangles");
    }
    let centroid = |i: usize| scene.corners(i).map(Vec3::as_dvec3).into_iter().sum::<DVec3>() / 3.0;
    let centroids: Vec<DVec3> = parallel::collect(scene.triangle_count(), GRAIN, centroid);
    let places: Vec<usize> = along_curve(&centroids).into_iter().map(|i| i as usize).collect();
    details.moved = places.iter().enumerate().filter(|&(to, &from)| from != to).count() as u64;
    if details.moved == 0 {
        return Outcome::Skipped("near triangles are near in the file already");
    }
    match scene {
        Scene::Soup(soup) => *soup = soup.subset(&places),
        Scene::Mesh(mesh) => mesh.select(&places.iter().map(|&i| i as u32).collect::<Vec<_>>()),
    }
    Outcome::Changed(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::Soup;

    /// Triangles at random places; the opacity of each names it.
    fn soup(count: usize) -> Soup {
        let rng = Rng::new(1, "arrange", 0);
        let at = |i: usize| Vec3::from([0, 1, 2].map(|k| rng.uniform((3 * i + k) as u64)));
        Soup {
            vertices: (0..count)
                .map(|i| [at(i), at(i) + 1e-3 * Vec3::X, at(i) + 1e-3 * Vec3::Y])
                .collect(),
            opacity: (0..count).map(|i| i as f32).collect(),
            sigma: (0..count).map(|i| -(i as f32)).collect(),
            sh: (0..4 * count).map(|i| [i as f32; 3]).collect(),
            sh_degree: 1,
            ..Soup::default()
        }
    }

    fn steps(soup: &Soup) -> f32 {
        soup.vertices.windows(2).map(|pair| pair[0][0].distance(pair[1][0])).sum()
    }

    #[test]
    fn near_triangles_are_near_and_keep_all_they_have() {
        let before = soup(MIN_ARRANGED);
        let mut scene = Scene::Soup(before.clone());
        let mut details = ArrangeDetails::default();
        let outcome = arrange(&mut scene, true, FaceOrder::Spatial, &mut details);
        assert!(matches!(outcome, Outcome::Changed(())) && details.moved > 10_000, "{details:?}");
        let Scene::Soup(after) = scene else { unreachable!("a soup stays one") };
        assert!(steps(&after) < 0.1 * steps(&before), "{} {}", steps(&after), steps(&before));
        for i in 0..after.len() {
            let was = after.opacity[i] as usize;
            assert_eq!(after.vertices[i], before.vertices[was]);
            assert_eq!(after.sigma[i], before.sigma[was]);
            assert_eq!(after.sh[4 * i..4 * i + 4], before.sh[4 * was..4 * was + 4]);
        }
    }

    #[test]
    fn what_nobody_needs_is_not_done() {
        let why = |count, is_drawn, order| {
            let mut scene = Scene::Soup(soup(count));
            match arrange(&mut scene, is_drawn, order, &mut ArrangeDetails::default()) {
                Outcome::Skipped(why) => why,
                Outcome::Changed(()) => "changed",
            }
        };
        assert_eq!(why(MIN_ARRANGED, false, FaceOrder::Spatial), "no stage draws the scene");
        assert_eq!(why(MIN_ARRANGED, true, FaceOrder::None), "the order of the input is kept");
        assert_eq!(why(MIN_ARRANGED - 1, true, FaceOrder::Spatial), "there are few triangles");
    }
}
