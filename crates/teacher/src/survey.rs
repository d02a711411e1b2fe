//! Measures the view of a scene from a place, on a small picture of fewer, larger triangles.

use glam::{DVec3, UVec2, Vec3};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, SoupRef};
use trisplat_scene::Soup;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::along_curve;

/// Width and height of the survey's pictures, px.
const SIDE: u32 = 32;
/// Largest soup that is not thinned.
const MAX_TRIANGLES: usize = 20_000;
/// Maximum number of triangles whose middles are tested for visibility.
const MAX_MIDDLES: usize = 8000;
/// A triangle is hidden if it is this many times farther than the surface in front of it.
const BEHIND: f32 = 1.1;
/// Minimum coverage of a pixel with a depth.
const MIN_COVER: f32 = 0.1;
/// Near plane in units of the scene.
const NEAR: f32 = 0.01;

/// Takes small pictures of a soup whose unit is the scene's.
#[derive(Debug)]
pub(super) struct Survey {
    soup: Soup,
    middles: Vec<Vec3>,
    soft: SoftRasterizer,
}

/// Coverage of a camera's picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ViewCoverage {
    /// Share of the picture that triangles cover.
    pub(super) covered: f32,
    /// Share of the picture with depths below `clearance`.
    pub(super) crowded: f32,
}

impl Survey {
    /// A survey of `soup`, which is thinned if it is large.
    pub(super) fn new(mut soup: Soup) -> Self {
        soup.truncate_sh(0);
        let order = CurveOrder::of(&soup);
        Self {
            middles: order.middles(MAX_MIDDLES),
            soup: order.thinned(&soup, MAX_TRIANGLES),
            soft: SoftRasterizer::new(),
        }
    }

    /// Middles of some of the triangles, spread over all of them.
    pub(super) fn middles(&self) -> &[Vec3] {
        &self.middles
    }

    /// Flags the [`Self::middles`] that the camera of the last look sees.
    pub(super) fn visible_middles(&self, camera: &Camera) -> Vec<bool> {
        let camera = camera.resized(UVec2::splat(SIDE));
        let frame = self.soft.frame();
        let is_visible = |middle: &Vec3| {
            let shown = camera.project(*middle).filter(|(_, z)| *z > NEAR);
            shown.is_some_and(|(at, z)| {
                let depth = frame.median_depth[at.y as usize * SIDE as usize + at.x as usize];
                depth == 0.0 || z < depth * BEHIND
            })
        };
        self.middles.iter().map(is_visible).collect()
    }

    /// The view of `camera`, for any size of its picture; surfaces nearer than `clearance` are
    /// obstacles.
    pub(super) fn look(&mut self, camera: &Camera, clearance: f32) -> ViewCoverage {
        let camera = camera.resized(UVec2::splat(SIDE));
        let options = SoftOptions {
            near: NEAR,
            // A thinned triangle of one pixel still counts.
            fade_px: 0.0,
            geometry: true,
            ..SoftOptions::default()
        };
        let frame = self.soft.render(&SoupRef::from(&self.soup), &camera, &options);
        let mut covered = 0.0;
        let mut crowded = 0.0;
        for (transmittance, depth) in frame.transmittance.iter().zip(&frame.depth) {
            let cover = 1.0 - transmittance;
            covered += cover;
            if cover > MIN_COVER && depth / cover < clearance {
                crowded += cover;
            }
        }
        let pixels = frame.transmittance.len() as f32;
        ViewCoverage { covered: covered / pixels, crowded: crowded / pixels }
    }
}

/// A square camera at `eye` that looks at `target`.
pub(super) fn camera(eye: Vec3, target: Vec3, up: Vec3, fov_degrees: f32, side: u32) -> Camera {
    Camera::look_at(eye, target, up, fov_degrees.to_radians(), UVec2::splat(side))
}

/// One of `count` directions that are spread evenly over the sphere.
pub(super) fn direction(i: usize, count: usize) -> Vec3 {
    const GOLDEN_ANGLE: f32 = 2.399_963;
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
    let (sin, cos) = (i as f32 * GOLDEN_ANGLE).sin_cos();
    let radius = (1.0 - y * y).sqrt();
    Vec3::new(radius * cos, y, radius * sin)
}

/// Middles of triangles along a curve through space, so that every k-th one gives an even selection
/// for any order of the file.
#[derive(Debug)]
pub(super) struct CurveOrder {
    /// The i-th triangle along the curve. `[N]`
    order: Vec<u32>,
    /// Of the triangles in the order of the soup. `[N]`
    middles: Vec<Vec3>,
}

impl CurveOrder {
    pub(super) fn of(soup: &Soup) -> Self {
        let middles: Vec<Vec3> =
            soup.vertices.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0).collect();
        let points: Vec<DVec3> = middles.iter().map(|m| m.as_dvec3()).collect();
        Self { order: along_curve(&points), middles }
    }

    /// At most `max_count` of the middles.
    pub(super) fn middles(&self, max_count: usize) -> Vec<Vec3> {
        let step = self.order.len().div_ceil(max_count).max(1);
        self.order.iter().step_by(step).map(|&i| self.middles[i as usize]).collect()
    }

    /// About `max_count` triangles instead of all. Large ones stay; smaller ones are selected with a
    /// chance in proportion to their area, and enlarged to replace the others.
    pub(super) fn thinned(&self, soup: &Soup, max_count: usize) -> Soup {
        if soup.len() <= max_count {
            return soup.clone();
        }
        let areas: Vec<f64> = soup.vertices.iter().map(|[a, b, c]| area(*a, *b, *c)).collect();
        let threshold = full_area(&areas, max_count);
        let mut sum = 0.5;
        let mut picked = Vec::new();
        for &i in &self.order {
            let before = f64::floor(sum);
            sum += (areas[i as usize] / threshold).min(1.0);
            if sum.floor() > before {
                picked.push(i as usize);
            }
        }
        let mut thinned = soup.subset(&picked);
        // Large ones stay bitwise unchanged.
        let small =
            thinned.vertices.iter_mut().zip(&picked).filter(|(_, i)| areas[**i] < threshold);
        for (corners, &i) in small {
            let scale = (threshold / areas[i]).sqrt() as f32;
            let middle = self.middles[i];
            *corners = corners.map(|v| middle + (v - middle) * scale);
        }
        thinned
    }
}

fn area(a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let [a, b, c] = [a, b, c].map(|v| v.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// The area A with which the sum of min(1, area / A) is `max_count`; infinite without any area.
fn full_area(areas: &[f64], max_count: usize) -> f64 {
    let mut falling: Vec<f64> = areas.to_vec();
    falling.sort_unstable_by(|a, b| b.total_cmp(a));
    let mut rest: f64 = falling.iter().sum();
    for (kept, largest) in falling.iter().take(max_count).enumerate() {
        let share = rest / (max_count - kept) as f64;
        if *largest <= share {
            return if share > 0.0 { share } else { f64::INFINITY };
        }
        rest -= largest;
    }
    f64::INFINITY
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    /// Nine of ten are small, one of ten is ten times as long.
    fn soup(count: usize) -> Soup {
        let rng = Rng::new(5, "thin", 0);
        let at = |i: usize| Vec3::from([0, 1, 2].map(|k| rng.uniform((3 * i + k) as u64)));
        let size = |i: usize| if i.is_multiple_of(10) { 0.1 } else { 0.01 };
        Soup {
            vertices: (0..count)
                .map(|i| [at(i), at(i) + size(i) * Vec3::X, at(i) + size(i) * Vec3::Y])
                .collect(),
            opacity: (0..count).map(|i| i as f32).collect(),
            sigma: vec![1.0; count],
            sh: vec![[0.0; 3]; count],
            sh_degree: 0,
            ..Soup::default()
        }
    }

    fn total_area(soup: &Soup) -> f64 {
        soup.vertices.iter().map(|[a, b, c]| area(*a, *b, *c)).sum()
    }

    #[test]
    fn area_stays_and_large_ones_stay_as_they_are() {
        let all = soup(5000);
        let thinned = CurveOrder::of(&all).thinned(&all, 1000);
        assert!(thinned.len().abs_diff(1000) <= 1, "{}", thinned.len());
        assert!((total_area(&thinned) / total_area(&all) - 1.0).abs() < 0.01);
        let large = |i: &&usize| i.is_multiple_of(10);
        let kept: Vec<usize> = thinned.opacity.iter().map(|o| *o as usize).collect();
        assert_eq!(kept.iter().filter(large).count(), 500);
        for (corners, &i) in
            thinned.vertices.iter().zip(&kept).filter(|(_, i)| i.is_multiple_of(10))
        {
            assert_eq!(*corners, all.vertices[i]);
        }
    }

    #[test]
    fn the_order_of_the_file_does_not_matter() {
        let all = soup(5000);
        let shuffled: Vec<usize> = (0..5000).map(|i| i * 1777 % 5000).collect();
        let other = all.subset(&shuffled);
        let a = CurveOrder::of(&all);
        let b = CurveOrder::of(&other);
        assert_eq!(a.thinned(&all, 700).opacity, b.thinned(&other, 700).opacity);
        assert_eq!(a.middles(300), b.middles(300));
    }

    #[test]
    fn points_are_not_kept() {
        let points = Soup { vertices: vec![[Vec3::ONE; 3]; 50], ..soup(50) };
        assert_eq!(CurveOrder::of(&points).thinned(&points, 20).len(), 0);
        assert_eq!(CurveOrder::of(&points).thinned(&points, 50).len(), 50);
    }
}
