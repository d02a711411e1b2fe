//! How high the ground is.

use super::samples::{self, Foreground};
use glam::DVec3;
use trisplat_scene::camera::Camera;

/// Thickness of a layer as a share of the region's radius.
const LAYER: f64 = 0.02;
/// The ground is the lowest layer with at least this share of the largest layer's area. A floor beside a
/// larger table counts, stray triangles below it do not.
const LEAST_OF_LARGEST: f64 = 0.25;
/// Most of a subject's area that lies below what it stands on: a few triangles are astray.
const MOST_BELOW: f64 = 0.02;
/// A floor is above its lower end by less than this share of its height.
const MOST_ABOVE: f64 = 0.05;

/// The height along `up` of a scene's floor, its lowest large layer of triangles. `None` for a scene without
/// extent.
pub(crate) fn ground(scene: Foreground, cameras: &[Camera], up: DVec3) -> Option<f64> {
    let region = samples::region(scene, cameras)?;
    let faces = samples::faces(scene, &region);
    let mut heights: Vec<(f64, f64)> = faces.iter().map(|f| (f.position.dot(up), f.weight)).collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let layers = layers(&heights, LAYER * region.radius);
    let largest = layers.iter().map(|layer| layer.area).fold(0.0, f64::max);
    // The first large enough layer begins below the floor; the floor is the largest layer near it.
    let first = layers.iter().position(|layer| layer.area >= LEAST_OF_LARGEST * largest)?;
    let end = layers[first].height + 2.0 * LAYER * region.radius;
    let near = layers[first..].iter().take_while(|layer| layer.height <= end);
    near.max_by(|a, b| a.area.total_cmp(&b.area)).map(|layer| layer.height)
}

/// The height along `up` of what a subject stands on: the floor that `ground` found, unless the subject reaches far below. Where its support
/// was not kept, the lowest large layer may be its top. `None` for a scene without extent.
pub(crate) fn under(scene: Foreground, ground: Option<f64>, up: DVec3) -> Option<f64> {
    let mut heights = samples::lowest_corners(scene, up);
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (first, last) = (heights.first()?.0, heights.last()?.0);
    let mut left = MOST_BELOW * heights.iter().map(|one| one.1).sum::<f64>();
    let lowest = heights.iter().find_map(|(height, area)| {
        left -= area;
        (left <= 0.0).then_some(*height)
    })?;
    let near = ground.filter(|ground| ground - lowest < MOST_ABOVE * (last - first));
    Some(near.unwrap_or(lowest))
}

/// Area around a height.
struct Layer {
    /// Mean height by area.
    height: f64,
    area: f64,
}

/// The layer of `thickness` that begins at each of the heights, which are sorted. `[heights]`
fn layers(heights: &[(f64, f64)], thickness: f64) -> Vec<Layer> {
    let (mut end, mut area, mut moment) = (0, 0.0, 0.0);
    let mut layers = Vec::with_capacity(heights.len());
    for (first, weight) in heights {
        while end < heights.len() && heights[end].0 <= first + thickness {
            area += heights[end].1;
            moment += heights[end].0 * heights[end].1;
            end += 1;
        }
        layers.push(Layer { height: if area > 0.0 { moment / area } else { *first }, area });
        area -= weight;
        moment -= first * weight;
    }
    layers
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::{Colors, Mesh};

    /// Level squares of `side` at a height, in small triangles.
    fn level(mesh: &mut Mesh, height: f32, side: f32, count: u64) {
        let rng = Rng::new(height.to_bits().into(), "level", 0);
        for i in 0..count {
            let at = |k: u64| rng.uniform(4 * i + k);
            let corner = Vec3::new(side * (at(0) - 0.5), height + 0.002 * at(2), side * (at(1) - 0.5));
            mesh.positions.extend([corner, corner + Vec3::X * 0.05, corner + Vec3::Z * 0.05]);
        }
        mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
    }

    #[test]
    fn the_floor_is_found_below_a_larger_table() {
        let mut mesh = Mesh::default();
        level(&mut mesh, 0.8, 1.0, 3000);
        level(&mut mesh, -0.5, 3.0, 2400);
        level(&mut mesh, -2.0, 0.2, 20);
        let found = ground(Foreground::new(&mesh, 0), &[], DVec3::Y).expect("a floor");
        assert!((found + 0.5).abs() < 0.01, "{found}");
        let found = ground(Foreground::new(&mesh, 0), &[], DVec3::NEG_Y)
            .expect("the other way around the table is the lowest");
        assert!((found + 0.8).abs() < 0.01, "{found}");
    }

    #[test]
    fn without_a_floor_it_is_where_the_triangles_end() {
        let rng = Rng::new(3, "ball", 0);
        let at = |i: u64| Vec3::from([0, 1, 2].map(|k| rng.normal(3 * i + k))).normalize();
        let upright = |i: u64| [at(i), at(i) + Vec3::Y * 0.02, at(i) + Vec3::new(0.002, 0.01, 0.0)];
        let positions: Vec<Vec3> = (0..5000).flat_map(upright).collect();
        let colors = Colors::Face(vec![[0.5; 3]; 5000]);
        let found = ground(Foreground::new(&Mesh { positions, colors, ..Mesh::default() }, 0), &[], DVec3::Y)
            .expect("an end");
        assert!((-1.0..-0.93).contains(&found), "{found}");
        assert_eq!(ground(Foreground::new(&Mesh::default(), 0), &[], DVec3::Y), None);
    }
}
