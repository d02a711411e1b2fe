//! Points of the surfaces in depth maps, each once.

use super::depth_map::DepthMap;
use glam::Vec3;

/// Largest relative difference between two maps' depths of one surface.
const SAME_DEPTH: f32 = 0.01;

/// A point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Position in the world of the maps.
    pub position: Vec3,
    /// Unit normal towards the photos that show it.
    pub normal: Vec3,
    /// sRGB-encoded colour.
    pub rgb: [u8; 3],
    /// Half the distance between neighbouring pixels on the surface, units of the data set.
    pub radius: f32,
    /// Confidence, from 0 to 1.
    pub confidence: f32,
}

/// The points of all maps, each the mean over the maps that show it.
pub fn fuse(maps: &[DepthMap]) -> Vec<SurfacePoint> {
    let mut used: Vec<Vec<bool>> = maps.iter().map(|map| vec![false; map.depth.len()]).collect();
    let mut points = Vec::new();
    for first in 0..maps.len() {
        // Distant maps show nothing of this one, so they are tested once instead of for each pixel.
        let others: Vec<usize> =
            (0..maps.len()).filter(|k| *k != first && overlap(&maps[first], &maps[*k])).collect();
        for pixel in 0..maps[first].depth.len() {
            let Some(point) = maps[first].point(pixel) else { continue };
            if used[first][pixel] {
                continue;
            }
            let mut sum = Sum::default();
            sum.add(&maps[first], pixel, point);
            for k in &others {
                let Some((at, depth)) = maps[*k].pixel(point) else { continue };
                let near = (maps[*k].depth[at] - depth).abs() < SAME_DEPTH * depth;
                if near && maps[*k].normal[at].dot(maps[first].normal[pixel]) > 0.0 {
                    used[*k][at] = true;
                    sum.add(&maps[*k], at, maps[*k].unproject(at, maps[*k].depth[at]));
                }
            }
            points.push(sum.mean(point));
        }
    }
    points
}

/// Whether some of what a map shows is in another's picture.
fn overlap(map: &DepthMap, other: &DepthMap) -> bool {
    let known = (0..map.depth.len()).step_by(97).filter_map(|pixel| map.point(pixel));
    known.into_iter().any(|point| other.camera.frames(point))
}

/// Weighted sums over maps.
#[derive(Debug, Default)]
struct Sum {
    weight: f32,
    position: Vec3,
    normal: Vec3,
    rgb: Vec3,
    radius: f32,
    confidence: f32,
}

impl Sum {
    fn add(&mut self, map: &DepthMap, pixel: usize, point: Vec3) {
        let weight = map.confidence[pixel].max(1e-3);
        self.weight += weight;
        self.position += weight * point;
        self.normal += weight * map.normal[pixel];
        self.rgb += weight * Vec3::from(map.rgb[pixel].map(f32::from));
        self.radius += weight * 0.5 * map.depth[pixel] / map.camera.focal.x;
        self.confidence = self.confidence.max(map.confidence[pixel]);
    }

    fn mean(&self, first: Vec3) -> SurfacePoint {
        let share = 1.0 / self.weight;
        let position = self.position * share;
        SurfacePoint {
            position: if position.is_finite() { position } else { first },
            normal: self.normal.normalize_or_zero(),
            rgb: (self.rgb * share).round().to_array().map(|c| c as u8),
            radius: self.radius * share,
            confidence: self.confidence,
        }
    }
}
