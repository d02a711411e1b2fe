//! Sparse clouds: from a PLY file beside a `transforms.json`, or at random in the cameras' views.

use super::colmap_model::ListedPoint;
use super::dataset::{Point, View};
use glam::{DVec3, Vec2, Vec3};
use std::path::Path;
use trisplat_formats::Source;
use trisplat_formats::ply::{self, Column};
use trisplat_scene::camera::{self, Camera};
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Limits, Result, Rng};

/// The colour of a point without one.
const GREY: [u8; 3] = [128; 3];

/// The points of a PLY file: x, y, z and, if they are bytes, red, green, blue of the element
/// `vertex`.
pub(super) fn read_ply(path: &Path, limits: &Limits) -> Result<Vec<ListedPoint>> {
    let mut source = Source::open(path, limits)?;
    let header = ply::header::read(&mut source)?;
    let table = ply::points(&source, &header, limits)?;
    let position = [table.column("x")?, table.column("y")?, table.column("z")?];
    let byte = |name| table.find(name).filter(|column| column.is_byte());
    let rgb = match ["red", "green", "blue"].map(byte) {
        [Some(r), Some(g), Some(b)] => Some([r, g, b]),
        _ => None,
    };
    let mut points = Vec::new();
    table.each_row(|_, row| {
        let position = DVec3::from(position.map(|column| column.f64(row)));
        let rgb = rgb.map_or(GREY, |columns: [Column; 3]| columns.map(|c| c.int(row) as u8));
        points.push(ListedPoint { id: 0, position, rgb, error: None });
        Ok(())
    })?;
    Ok(points)
}

/// Brings points at infinity to the horizon: the distance from which a point has a parallax of one
/// pixel between the outermost cameras. Beyond it no photo tells distances apart, and a scene a
/// million times as large as what the photos show has no exact numbers. Returns how many were
/// beyond, and the horizon, in world units.
pub(super) fn bring_to_horizon(points: &mut [Point], cameras: &[Camera]) -> (usize, f64) {
    let Some([low, high]) = bounds(cameras.iter().map(Camera::position)) else { return (0, 0.0) };
    let middle = low.midpoint(high).as_dvec3();
    let focal = cameras.iter().map(|camera| camera.focal.max_element()).fold(0.0, f32::max);
    let horizon = f64::from(low.distance(high)) * f64::from(focal);
    let mut count = 0;
    if horizon > 0.0 {
        for point in points {
            let from_middle = point.position.as_dvec3() - middle;
            if from_middle.length() > horizon {
                point.position = (middle + from_middle.normalize() * horizon).as_vec3();
                count += 1;
            }
        }
    }
    (count, horizon)
}

/// Attempts to place a point in a second camera's view, too.
const TRIES: u64 = 16;

/// `count` grey points inside the views' frusta, the same ones for the same seed.
///
/// Each is on a random ray of one camera, log-uniformly between 0.3 and 3 times the viewing
/// distance, and if possible inside another camera's frustum, because a point in only one photo has
/// no certain place.
pub fn random_points(views: &[&View], count: usize, seed: u64) -> Vec<Point> {
    if views.is_empty() {
        return Vec::new();
    }
    let distance = looking_distance(views);
    let point = |index: usize| {
        let view = views[index % views.len()];
        let place = |attempt: u64| {
            on_ray(view, distance, Rng::new(seed, "random cloud", attempt), index as u64)
        };
        let is_shared = |at: &Vec3| {
            views
                .iter()
                .any(|other| !std::ptr::eq(*other, view) && other.camera.project(*at).is_some())
        };
        let position = (0..TRIES).map(place).find(is_shared).unwrap_or_else(|| place(0));
        Point { position, rgb: [128; 3], error: None }
    };
    (0..count).map(point).collect()
}

/// A random point in front of one camera.
fn on_ray(view: &View, distance: f32, rng: Rng, index: u64) -> Vec3 {
    let camera = &view.camera;
    let draw = |k: u64| rng.uniform(3 * index + k);
    let pixel = Vec2::new(draw(0), draw(1)) * camera.size.as_vec2();
    let depth = distance * 0.3 * 10f32.powf(draw(2));
    let camera_point = ((pixel - camera.center) / camera.focal).extend(1.0) * depth;
    camera.rotation.transpose() * (camera_point - camera.translation)
}

/// The viewing distance: the median distance of the cameras to their common focus; without one or
/// far beyond the cameras, twice their spread; 1 for a single place.
pub fn looking_distance(views: &[&View]) -> f32 {
    let count = views.len() as f32;
    let centers: Vec<Vec3> = views.iter().map(|v| v.camera.position()).collect();
    let middle = centers.iter().sum::<Vec3>() / count;
    let spread = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f32>() / count).sqrt();
    let fallback = if spread > 0.0 { 2.0 * spread } else { 1.0 };
    let Some(focus) = camera::focus(views.iter().map(|v| &v.camera)) else { return fallback };
    let distances = centers.iter().map(|c| c.distance(focus)).collect();
    let median_distance = median(distances, f32::total_cmp).unwrap_or(0.0);
    // Axes that are nearly parallel, as those of a drone that looks down, meet anywhere.
    let is_sure = median_distance > 1e-3 * spread && median_distance < 10.0 * spread;
    if is_sure && median_distance > 0.0 { median_distance } else { fallback }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    fn read_bytes(bytes: &[u8]) -> Result<Vec<ListedPoint>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        std::fs::write(&path, bytes).unwrap();
        read_ply(&path, &Limits::DEFAULT)
    }

    fn header(format: &str) -> String {
        format!(
            "ply\nformat {format} 1.0\ncomment x\nelement vertex 2\nproperty double x\nproperty float y\n\
             property short z\nproperty uchar red\nproperty uint8 green\nproperty uchar blue\n\
             element face 0\nproperty list uchar int vertex_indices\nend_header\n"
        )
    }

    fn body(big: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (x, y, z, rgb) in [(1.25f64, -2.5f32, -3i16, [1u8, 2, 255]), (1e6, 0.0, 4, [9, 8, 7])] {
            let mut push = |b: &[u8]| bytes.extend_from_slice(b);
            if big {
                push(&x.to_be_bytes());
                push(&y.to_be_bytes());
                push(&z.to_be_bytes());
            } else {
                push(&x.to_le_bytes());
                push(&y.to_le_bytes());
                push(&z.to_le_bytes());
            }
            push(&rgb);
        }
        bytes
    }

    #[test]
    fn all_three_encodings_say_the_same() {
        let little = [header("binary_little_endian").into_bytes(), body(false)].concat();
        let big = [header("binary_big_endian").into_bytes(), body(true)].concat();
        let ascii = format!("{}1.25 -2.5 -3 1 2 255\n1e6 0 4 9 8 7\n", header("ascii"));
        for bytes in [little.as_slice(), &big, ascii.as_bytes()] {
            let points = read_bytes(bytes).unwrap();
            assert_eq!(points.len(), 2);
            assert_eq!(points[0].position, DVec3::new(1.25, -2.5, -3.0));
            assert_eq!(points[0].rgb, [1, 2, 255]);
            assert_eq!(points[1].position, DVec3::new(1e6, 0.0, 4.0));
        }
    }

    #[test]
    fn points_may_follow_other_elements_and_have_lists_or_no_color() {
        let text = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\nelement vertex 2\n\
                    property float x\nproperty list uchar int views\nproperty float y\nproperty float z\n\
                    property uchar red\nproperty uchar green\nproperty float blue\nend_header\n\
                    3 0 1 0\n4 0 1 0 1\n1 2 7 8 2 3 9 9 9\n4 0 5 6 9 9 9\n";
        let points = read_bytes(text.as_bytes()).unwrap();
        assert_eq!(points.iter().map(|p| p.rgb).collect::<Vec<_>>(), [GREY; 2]);
        assert_eq!(points[0].position, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(points[1].position, DVec3::new(4.0, 5.0, 6.0));
        let whole = text.replace("float blue", "uchar blue").replace("9 9 9", "255.0 0 17");
        assert_eq!(
            read_bytes(whole.as_bytes()).unwrap()[1].rgb,
            [255, 0, 17],
            "bytes may be written with a point"
        );
        let error =
            read_bytes(text.replace("float z", "float w").as_bytes()).err().unwrap().to_string();
        assert!(error.contains("element vertex") && error.contains("no property z"), "{error}");
    }

    #[test]
    fn points_at_infinity_move_to_the_horizon() {
        let turn = |i: usize| Vec3::new((i as f32).cos(), 0.3, (i as f32).sin());
        let camera =
            |i| Camera::look_at(4.0 * turn(i), Vec3::ZERO, Vec3::Y, 0.8, UVec2::splat(300));
        let cameras: Vec<Camera> = (0..6).map(camera).collect();
        let point = |i: usize| Point { position: -turn(7 * i), rgb: [0; 3], error: None };
        let mut points: Vec<Point> = (0..90).map(point).collect();
        let as_found = points.clone();
        assert_eq!(bring_to_horizon(&mut points, &cameras).0, 0);
        assert_eq!(points, as_found);
        for far in [1e6, 1e30] {
            let away = |i: usize| if i.is_multiple_of(9) { far } else { 1.0 };
            points.clone_from(&as_found);
            for (i, point) in points.iter_mut().enumerate() {
                point.position *= away(i);
            }
            let mut near = points.clone();
            let (count, horizon) = bring_to_horizon(&mut near, &cameras);
            assert_eq!(count, 10);
            let mut seen = 0;
            for (point, near) in points.iter().zip(&near) {
                assert!(f64::from(near.position.length()) < 1.01 * horizon);
                for camera in &cameras {
                    let shown = [point, near].map(|point| camera.project(point.position));
                    if let [Some((a, _)), Some((b, _))] = shown {
                        assert!(a.distance(b) < 1.0, "{a} {b}");
                        seen += usize::from(point.position != near.position);
                    }
                }
            }
            assert!(seen > 0, "no camera shows a far point");
        }
        assert_eq!(
            bring_to_horizon(&mut points, &cameras[..1]).0,
            0,
            "one camera tells no distance"
        );
    }

    #[test]
    fn every_prefix_fails_cleanly() {
        let whole = [header("binary_little_endian").into_bytes(), body(false)].concat();
        for len in 0..whole.len() {
            assert!(read_bytes(&whole[..len]).is_err(), "{len}");
        }
        let greedy = header("ascii").replace("vertex 2", "vertex 18446744073709551615");
        assert!(read_bytes(greedy.as_bytes()).is_err());
    }
}
