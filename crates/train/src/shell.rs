//! A closed shell around the scene, for surfaces without points: walls, windows, the sky.
//!
//! In each direction it lies a little behind the farthest points there. It begins with the colour
//! of the photos in its place, or with interpolated colours where no photo shows it. Its distance
//! rises gently towards far places, without spikes. It is closed, and pinned: only its colour is
//! trained. Without it, training paints such surfaces by large triangles close to each camera,
//! which float before a black background in other views. Not in the paper; its code has a white
//! dome of ordinary triangles for outdoor scenes.

use super::options::TrainOptions;
use super::pyramid::{MIN_PX, Pyramid};
use glam::Vec3;
use std::collections::HashMap;
use trisplat_dataset::View;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::geometry::{centroid, face_count, octasphere};
use trisplat_scene::math::lists::median;
use trisplat_scene::{Result, SceneNormalization, Soup, sh0_from_rgb};

/// Minimum number of triangles of a run per triangle of its shell.
const PER_SHELL_TRIANGLE: u64 = 10;
/// Photos are used at a quarter of their size, because single pixels are noisy.
const LEVEL: u32 = 2;
/// Cosine of the half angle of a cone whose points give the scene's extent in a direction: 20
/// degrees.
const CONE: f32 = 0.94;
/// Minimum points in such a cone.
const CONE_POINTS: usize = 4;
/// Share of the points in a cone that are in front of the shell.
const INSIDE: f32 = 0.95;
/// Distance of the shell, in distances of the last point of that share.
const BEHIND: f32 = 1.05;
/// Minimum distance of the shell, in distances of the farthest camera: no camera is outside.
const AROUND_CAMERAS: f32 = 1.5;
/// Rounds in which directions without points take the mean distance of their neighbours.
const ROUNDS: usize = 200;
/// Largest slope of the logarithm of the distance, per radian of direction.
const STEEPEST: f32 = 2.0;
/// Rounds in which every direction moves half way to the mean of its neighbours.
const SMOOTHING: usize = 3;
/// Rounds in which faces without photos take the mean colour of their neighbours.
const COLOR_ROUNDS: usize = 1000;
/// σ of the shell: nearly solid, so that it has no seams.
const SIGMA: f32 = 0.02;
/// Opacity of the shell: high, but below 1, where the logit has no slope.
const OPACITY: f32 = 0.98;

/// Subdivisions of the shell in a run with these options; `None` when it has none.
pub(super) fn subdivisions(options: &TrainOptions) -> Option<u32> {
    let fits = |s: &u32| face_count(*s) * PER_SHELL_TRIANGLE <= options.max_triangles;
    (2..=options.init.shell_subdivisions).rev().find(fits)
}

/// The shell around a scene with its middles at `points`, as `views` show it, in their world: for a
/// run from triangles that lack one. Empty where `options` or masks exclude it. `photo_bytes` is
/// the memory for photos.
///
/// # Errors
///
/// Photos that cannot be decoded.
pub fn shell_around(
    points: &[Vec3],
    views: &[&View],
    options: &TrainOptions,
    photo_bytes: u64,
) -> Result<Soup> {
    let Some(subdivisions) = subdivisions(options) else { return Ok(Soup::default()) };
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let space = SceneNormalization::new(&cameras, points);
    let cameras: Vec<Camera> =
        cameras.iter().map(|camera| space.camera_to_training(camera)).collect();
    let points: Vec<Vec3> = points.iter().map(|point| space.to_training(*point)).collect();
    let mut soup =
        shell(&points, &cameras, &mut Pyramid::new(views, photo_bytes, MIN_PX), subdivisions)?;
    space.soup_to_world(&mut soup);
    soup.set_shell(0..soup.len());
    Ok(soup)
}

/// The shell around `points` as seen by `cameras`, those of the photos, in training space; SH
/// degree 0. Empty when the photos have masks, because these exclude the background, and when no
/// photo shows it.
///
/// # Errors
///
/// Photos that cannot be decoded.
pub(super) fn shell(
    points: &[Vec3],
    cameras: &[Camera],
    photos: &mut Pyramid,
    subdivisions: u32,
) -> Result<Soup> {
    let (directions, faces) = octasphere(subdivisions);
    let radii = radii(&directions, &faces, points, cameras);
    let corner = |i: u32| directions[i as usize] * radii[i as usize];
    let corners: Vec<[Vec3; 3]> = faces.iter().map(|face| face.map(corner)).collect();
    let Some(colors) = colors(&corners, cameras, photos)? else { return Ok(Soup::default()) };
    let Some(colors) = extended(colors, &faces) else { return Ok(Soup::default()) };
    Ok(Soup {
        opacity: vec![OPACITY; corners.len()],
        sigma: vec![SIGMA; corners.len()],
        sh: colors.into_iter().map(|rgb| rgb.map(sh0_from_rgb)).collect(),
        vertices: corners,
        ..Soup::default()
    })
}

/// Distance of the shell from the origin in each direction. `[V]`
fn radii(directions: &[Vec3], faces: &[[u32; 3]], points: &[Vec3], cameras: &[Camera]) -> Vec<f32> {
    let finite = points.iter().filter(|p| p.is_finite() && p.length() > 0.0);
    let rays: Vec<(Vec3, f32)> = finite.map(|p| (p.normalize(), p.length())).collect();
    let reach = cameras.iter().map(|c| c.position().length()).fold(0.0, f32::max);
    let measured: Vec<Option<f32>> = directions.iter().map(|d| far_distance(*d, &rays)).collect();
    let typical = median(measured.iter().flatten().copied().collect(), f32::total_cmp)
        .or_else(|| far(rays.iter().map(|(_, length)| *length).collect()))
        .unwrap_or(1.0);

    let neighbours = neighbours(directions.len(), faces);
    // In logarithms, so that twice and half the distance count equally.
    let mut logs: Vec<f32> = measured
        .iter()
        .map(|distance| distance.unwrap_or(typical).max(f32::MIN_POSITIVE).ln())
        .collect();
    for _ in 0..ROUNDS {
        let before = logs.clone();
        for (i, around) in neighbours.iter().enumerate().filter(|(i, _)| measured[*i].is_none()) {
            logs[i] = mean(around.iter().map(|j| before[*j as usize]));
        }
    }
    raise(&mut logs, directions, &neighbours);
    for _ in 0..SMOOTHING {
        let before = logs.clone();
        for (log, around) in logs.iter_mut().zip(&neighbours) {
            *log = (*log + mean(around.iter().map(|j| before[*j as usize]))) / 2.0;
        }
    }
    logs.iter().map(|log| (BEHIND * log.exp()).max(AROUND_CAMERAS * reach)).collect()
}

/// Neighbours of each direction. `[V]`
fn neighbours(count: usize, faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); count];
    for [a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            neighbours[*from as usize].push(*to);
        }
    }
    neighbours
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len().max(1) as f32;
    values.sum::<f32>() / count
}

/// Raises the logarithms of distances around far places until no slope exceeds [`STEEPEST`]. None
/// is lowered, so the shell stays behind the scene.
fn raise(logs: &mut [f32], directions: &[Vec3], neighbours: &[Vec<u32>]) {
    let mut rises = true;
    while rises {
        rises = false;
        for (i, around) in neighbours.iter().enumerate() {
            for j in around {
                let turn = directions[i].angle_between(directions[*j as usize]);
                let lowest = logs[*j as usize] - STEEPEST * turn;
                // Far above rounding, so that it ends.
                rises |= lowest > logs[i] + 1e-4;
                logs[i] = logs[i].max(lowest);
            }
        }
    }
}

/// Distance at which the points around a direction end, if there are enough.
fn far_distance(direction: Vec3, rays: &[(Vec3, f32)]) -> Option<f32> {
    let around = rays.iter().filter(|(ray, _)| ray.dot(direction) > CONE);
    let lengths: Vec<f32> = around.map(|(_, length)| *length).collect();
    if lengths.len() < CONE_POINTS { None } else { far(lengths) }
}

/// The length below which all except a few lengths stay.
fn far(mut lengths: Vec<f32>) -> Option<f32> {
    let at = ((lengths.len() as f32 * INSIDE) as usize).min(lengths.len().checked_sub(1)?);
    Some(*lengths.select_nth_unstable_by(at, f32::total_cmp).1)
}

/// The median colour of the photos at the middle of each face; `None` where no photo shows it. The
/// whole result is `None` when photos have masks. `[F]`
fn colors(
    corners: &[[Vec3; 3]],
    cameras: &[Camera],
    photos: &mut Pyramid,
) -> Result<Option<Vec<Option<[f32; 3]>>>> {
    let mut shown: Vec<Vec<[u8; 3]>> = vec![Vec::new(); corners.len()];
    photos.prefetch(&(0..cameras.len()).collect::<Vec<_>>(), LEVEL);
    for (i, camera) in cameras.iter().enumerate() {
        let photo = photos.take(i, LEVEL)?;
        if photo.alpha.is_some() {
            return Ok(None);
        }
        let camera = camera.resized(photo.size);
        for (shown, corners) in shown.iter_mut().zip(corners) {
            shown.extend(pixel(&camera, &photo, centroid(*corners)));
        }
    }
    let channel = |shown: &[[u8; 3]], c: usize| {
        median(shown.iter().map(|rgb| rgb[c]).collect(), u8::cmp)
            .map(|code| f32::from(code) / 255.0)
    };
    let color =
        |shown: Vec<[u8; 3]>| Some([channel(&shown, 0)?, channel(&shown, 1)?, channel(&shown, 2)?]);
    Ok(Some(shown.into_iter().map(color).collect()))
}

/// The colour of a photo at a place, if visible.
fn pixel(camera: &Camera, photo: &RgbImage, place: Vec3) -> Option<[u8; 3]> {
    let (at, _) = camera.project(place)?;
    Some(photo.rgb[(at.y as u32 * camera.size.x + at.x as u32) as usize])
}

/// The colours, smoothly extended to all faces; `None` if no face has one. `[F]`
fn extended(colors: Vec<Option<[f32; 3]>>, faces: &[[u32; 3]]) -> Option<Vec<[f32; 3]>> {
    let adjacent = adjacent_faces(faces);
    let has_color: Vec<bool> = colors.iter().map(Option::is_some).collect();
    if !has_color.contains(&true) {
        return None;
    }
    let mut colors: Vec<Option<Vec3>> = colors.into_iter().map(|rgb| rgb.map(Vec3::from)).collect();
    // First from ring to ring, which saves rounds of smoothing.
    while colors.contains(&None) {
        let before = colors.clone();
        for (i, color) in colors.iter_mut().enumerate().filter(|(_, color)| color.is_none()) {
            let around: Vec<Vec3> = adjacent[i].iter().filter_map(|j| before[*j]).collect();
            *color =
                (!around.is_empty()).then(|| around.iter().sum::<Vec3>() / around.len() as f32);
        }
    }
    let mut colors: Vec<Vec3> = colors.into_iter().flatten().collect();
    for _ in 0..COLOR_ROUNDS {
        for i in (0..colors.len()).filter(|i| !has_color[*i]) {
            colors[i] = adjacent[i].iter().map(|j| colors[*j]).sum::<Vec3>() / 3.0;
        }
    }
    Some(colors.into_iter().map(|rgb| rgb.to_array()).collect())
}

/// The three faces adjacent to each face of a closed surface. `[F]`
fn adjacent_faces(faces: &[[u32; 3]]) -> Vec<[usize; 3]> {
    let mut sides: HashMap<(u32, u32), usize> = HashMap::new();
    for (i, [a, b, c]) in faces.iter().enumerate() {
        for side in [(*a, *b), (*b, *c), (*c, *a)] {
            sides.insert(side, i);
        }
    }
    faces.iter().map(|[a, b, c]| [(*b, *a), (*c, *b), (*a, *c)].map(|side| sides[&side])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::{Dataset, DatasetOptions};
    use trisplat_synthetic::SyntheticOptions;

    /// Points on a wall 4 units ahead, and cameras in front of it.
    fn wall() -> Vec<Vec3> {
        (0..400)
            .map(|i| Vec3::new((i % 20) as f32 / 5.0 - 2.0, (i / 20) as f32 / 5.0 - 2.0, 4.0))
            .collect()
    }

    #[test]
    fn it_stands_behind_the_points_and_the_cameras() {
        let (directions, faces) = octasphere(3);
        let radii = radii(&directions, &faces, &wall(), &[]);
        for (direction, radius) in directions.iter().zip(&radii) {
            assert!((3.9..8.0).contains(radius), "{direction} {radius}");
            // Along the axis the wall is 4 away, at the rim of a cone 4.3; beside it there is a
            // little more.
            assert!(direction.z < 0.999 || (4.4..4.9).contains(radius), "{direction} {radius}");
        }
        let nothing = super::radii(&directions, &faces, &[], &[]);
        assert!(nothing.iter().all(|r| *r == BEHIND));
        let broken = super::radii(&directions, &faces, &[Vec3::NAN, Vec3::ZERO], &[]);
        assert_eq!(broken, nothing);
    }

    #[test]
    fn a_view_through_a_window_is_a_hill() {
        let (directions, faces) = octasphere(4);
        // A room of points at distance 2, and a street that is seen through a small window, 60
        // away.
        let room = directions.iter().map(|d| *d * 2.0);
        let street =
            (0..400).map(|i| Vec3::new((i % 20) as f32 - 10.0, (i / 20) as f32 - 10.0, 60.0));
        let points: Vec<Vec3> = room.chain(street).collect();
        let radii = radii(&directions, &faces, &points, &[]);
        let (near, far) = radii.iter().fold((f32::MAX, 0.0f32), |(a, b), r| (a.min(*r), b.max(*r)));
        assert!((1.9..3.0).contains(&near) && far > 40.0, "{near} to {far}");
        for [a, b, c] in &faces {
            for (i, j) in [(a, b), (b, c), (c, a)].map(|(i, j)| (*i as usize, *j as usize)) {
                let rise = (radii[i] / radii[j]).ln() / directions[i].angle_between(directions[j]);
                // Smoothing adds a little at the edges of the octahedron; a spike would rise by 35.
                assert!(rise < 1.3 * STEEPEST, "{rise}");
            }
        }
    }

    #[test]
    fn colours_are_continued_all_around_without_stripes() {
        let (corners, faces) = octasphere(4);
        assert_eq!(extended(vec![None; faces.len()], &faces), None);
        // Blue above, brown below, with a red face among the blue ones: nothing is known between.
        let height =
            |face: &[u32; 3]| face.iter().map(|i| corners[*i as usize].y).sum::<f32>() / 3.0;
        let colors: Vec<_> = faces
            .iter()
            .enumerate()
            .map(|(i, face)| match height(face) {
                h if h > 0.6 && i % 97 == 0 => Some([0.9, 0.1, 0.1]),
                h if h > 0.6 => Some([0.2, 0.4, 0.9]),
                h if h < -0.6 => Some([0.5, 0.3, 0.1]),
                _ => None,
            })
            .collect();
        let all = extended(colors.clone(), &faces).unwrap();
        assert!(
            colors.iter().zip(&all).all(|(given, color)| given.is_none_or(|given| given == *color))
        );
        let adjacent = adjacent_faces(&faces);
        for i in (0..faces.len()).filter(|i| height(&faces[*i]).abs() < 0.5) {
            let steps = adjacent[i].map(|j| Vec3::from(all[i]).distance(Vec3::from(all[j])));
            assert!(steps.iter().all(|step| *step < 0.12), "{i}: {steps:?}");
            let [_, _, blue] = all[i];
            let h = height(&faces[i]);
            assert!(
                (0.1..=0.9).contains(&blue) && (h < 0.4 || blue > 0.5) && (h > -0.4 || blue < 0.5),
                "{h} {blue}"
            );
        }
    }

    #[test]
    fn small_runs_have_a_small_shell_or_none() {
        let with = |max_triangles, shell_subdivisions| {
            let mut options = TrainOptions { max_triangles, ..TrainOptions::default() };
            options.init.shell_subdivisions = shell_subdivisions;
            subdivisions(&options)
        };
        assert_eq!(with(60_000, 4), Some(4));
        assert_eq!(with(20_000, 4), Some(3));
        assert_eq!(with(2000, 4), Some(2));
        assert_eq!((with(1000, 4), with(60_000, 0)), (None, None));
    }

    #[test]
    fn it_has_the_colours_of_the_photos() {
        let folder = tempfile::tempdir().unwrap();
        trisplat_synthetic::write(
            folder.path(),
            &SyntheticOptions {
                views: 12,
                width: 48,
                points: 300,
                seed: 0,
                ..SyntheticOptions::default()
            },
        )
        .unwrap();
        let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        let views: Vec<&View> = dataset.train().collect();
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let points: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
        let space = SceneNormalization::new(&cameras, &points);
        let cameras: Vec<Camera> =
            cameras.iter().map(|camera| space.camera_to_training(camera)).collect();
        let points: Vec<Vec3> = points.iter().map(|point| space.to_training(*point)).collect();
        let mut photos = Pyramid::new(&views, 1 << 24, 8);
        let soup = shell(&points, &cameras, &mut photos, 3).unwrap();
        soup.validate().unwrap();
        let mut same = 0;
        let mut seen = 0;
        for i in 0..soup.len() {
            for (k, camera) in cameras.iter().enumerate() {
                let photo = photos.take(k, LEVEL).unwrap();
                if let Some(rgb) =
                    pixel(&camera.resized(photo.size), &photo, centroid(soup.vertices[i]))
                {
                    let near = |c: usize| (soup.rgb(i)[c] - f32::from(rgb[c]) / 255.0).abs() < 0.2;
                    same += usize::from((0..3).all(near));
                    seen += 1;
                }
            }
        }
        assert!(seen > 100 && same > seen / 2, "{same} of {seen}");
    }
}
