//! A closed shell around the scene, for what no point stands for: walls, windows, the sky.
//!
//! In each direction it lies a little behind the farthest points there, and begins with the colour that the photos show
//! in its place. It is pinned: only its colour is trained. Without it such surfaces are painted by large triangles
//! close to each camera, which hang in the air when seen from beside it, before a black background.
//! Not in the paper; its code has a white dome of ordinary triangles for outdoor scenes.

use super::options::TrainOptions;
use super::pyramid::Pyramid;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::Pixels;
use crate::math::median::median;
use crate::math::octasphere::{face_count, octasphere};
use crate::soup::{Soup, sh0_from_rgb};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// A run has this many triangles for each of its shell, or more.
const PER_SHELL_TRIANGLE: u64 = 10;
/// Photos are looked at at a quarter of their size: single pixels are noise.
const LEVEL: u32 = 2;
/// Cosine of the half angle around a direction in which points tell how far away the scene ends: 20 degrees.
const CONE: f32 = 0.94;
/// Fewest points in a cone that tell it.
const CONE_POINTS: usize = 4;
/// This share of the points in a cone is in front of the shell.
const INSIDE: f32 = 0.95;
/// The shell's distance, in that of the point that ends this share.
const BEHIND: f32 = 1.05;
/// The shell's least distance, in that of the farthest camera: no camera is outside.
const AROUND_CAMERAS: f32 = 1.5;
/// Rounds in which directions without points take the mean distance of their neighbours.
const ROUNDS: usize = 200;
/// Colours extend this many faces beyond what photos show; farther out there is no shell.
const RINGS: usize = 12;
/// σ of the shell: nearly solid, so that it has no seams.
const SIGMA: f32 = 0.02;
/// Opacity of the shell: high, but below 1, where the logit has no slope.
const OPACITY: f32 = 0.98;

/// Subdivisions of the shell in a run with these options; `None` when it has none.
pub(super) fn subdivisions(options: &TrainOptions) -> Option<u32> {
    let fits = |s: &u32| face_count(*s) * PER_SHELL_TRIANGLE <= options.max_triangles;
    (2..=options.init.shell_subdivisions).rev().find(fits)
}

/// The shell around `points` as seen by `cameras`, those of the photos, in training space; SH degree 0. Empty when the
/// photos have masks: then what is behind the scene is not wanted.
///
/// Errors: photos that cannot be decoded.
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
    let mut soup = Soup::default();
    for (corners, rgb) in corners.into_iter().zip(continued(colors, &faces)) {
        if let Some(rgb) = rgb {
            soup.vertices.push(corners);
            soup.opacity.push(OPACITY);
            soup.sigma.push(SIGMA);
            soup.sh.push(rgb.map(sh0_from_rgb));
        }
    }
    Ok(soup)
}

/// How far the shell is from the origin in each direction. `[V]`
fn radii(directions: &[Vec3], faces: &[[u32; 3]], points: &[Vec3], cameras: &[Camera]) -> Vec<f32> {
    let finite = points.iter().filter(|p| p.is_finite() && p.length() > 0.0);
    let rays: Vec<(Vec3, f32)> = finite.map(|p| (p.normalize(), p.length())).collect();
    let reach = cameras.iter().map(|c| c.position().length()).fold(0.0, f32::max);
    let known: Vec<Option<f32>> = directions.iter().map(|d| far_end(*d, &rays)).collect();
    let typical = median(known.iter().flatten().copied().collect(), f32::total_cmp)
        .or_else(|| far(rays.iter().map(|(_, length)| *length).collect()))
        .unwrap_or(1.0);

    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); directions.len()];
    for [a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            neighbours[*from as usize].push(*to);
        }
    }
    // In logarithms: twice as far counts as much as half as far.
    let mut logs: Vec<f32> = known.iter().map(|k| k.unwrap_or(typical).max(f32::MIN_POSITIVE).ln()).collect();
    for _ in 0..ROUNDS {
        let before = logs.clone();
        for (i, around) in neighbours.iter().enumerate().filter(|(i, _)| known[*i].is_none()) {
            logs[i] = around.iter().map(|j| before[*j as usize]).sum::<f32>() / around.len().max(1) as f32;
        }
    }
    logs.iter().map(|log| (BEHIND * log.exp()).max(AROUND_CAMERAS * reach)).collect()
}

/// How far away the points around a direction end, if there are enough.
fn far_end(direction: Vec3, rays: &[(Vec3, f32)]) -> Option<f32> {
    let around = rays.iter().filter(|(ray, _)| ray.dot(direction) > CONE);
    let lengths: Vec<f32> = around.map(|(_, length)| *length).collect();
    if lengths.len() < CONE_POINTS { None } else { far(lengths) }
}

/// The length that all but the longest few stay below.
fn far(mut lengths: Vec<f32>) -> Option<f32> {
    let at = ((lengths.len() as f32 * INSIDE) as usize).min(lengths.len().checked_sub(1)?);
    Some(*lengths.select_nth_unstable_by(at, f32::total_cmp).1)
}

/// The colour that the photos show at the middle of each face, the median over them; `None` where none does.
/// `None` altogether when photos have masks. `[F]`
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
        for (shown, [a, b, c]) in shown.iter_mut().zip(corners) {
            shown.extend(pixel(&camera, &photo, (a + b + c) / 3.0));
        }
    }
    let channel = |shown: &[[u8; 3]], c: usize| {
        median(shown.iter().map(|rgb| rgb[c]).collect(), u8::cmp).map(|code| f32::from(code) / 255.0)
    };
    let color = |shown: Vec<[u8; 3]>| Some([channel(&shown, 0)?, channel(&shown, 1)?, channel(&shown, 2)?]);
    Ok(Some(shown.into_iter().map(color).collect()))
}

/// What a photo shows at a place, if it does.
fn pixel(camera: &Camera, photo: &Pixels, place: Vec3) -> Option<[u8; 3]> {
    let seen = camera.rotation * place + camera.translation;
    let at = seen.truncate() / seen.z * camera.focal + camera.center;
    let size = camera.size;
    let inside = seen.z > 0.0 && at.cmpge(Vec2::ZERO).all() && at.cmplt(size.as_vec2()).all();
    inside.then(|| photo.rgb[(at.y as u32 * size.x + at.x as u32) as usize])
}

/// Colours, and beyond them the means of the faces beside, some rings far. `[F]`
fn continued(mut colors: Vec<Option<[f32; 3]>>, faces: &[[u32; 3]]) -> Vec<Option<[f32; 3]>> {
    let mut sides: HashMap<(u32, u32), usize> = HashMap::new();
    for (i, [a, b, c]) in faces.iter().enumerate() {
        for side in [(*a, *b), (*b, *c), (*c, *a)] {
            sides.insert(side, i);
        }
    }
    let beside = |[a, b, c]: [u32; 3]| [(b, a), (c, b), (a, c)].map(|side| sides[&side]);
    for _ in 0..RINGS {
        let before = colors.clone();
        for (i, face) in faces.iter().enumerate().filter(|(i, _)| before[*i].is_none()) {
            let known: Vec<Vec3> = beside(*face).iter().filter_map(|j| before[*j]).map(Vec3::from).collect();
            if !known.is_empty() {
                colors[i] = Some((known.iter().sum::<Vec3>() / known.len() as f32).to_array());
            }
        }
    }
    colors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{self, SyntheticOptions};
    use crate::dataset::{Dataset, DatasetOptions, View};
    use crate::space::Space;

    /// Points on a wall 4 units ahead, and cameras before it.
    fn wall() -> Vec<Vec3> {
        (0..400).map(|i| Vec3::new((i % 20) as f32 / 5.0 - 2.0, (i / 20) as f32 / 5.0 - 2.0, 4.0)).collect()
    }

    #[test]
    fn it_stands_behind_the_points_and_the_cameras() {
        let (directions, faces) = octasphere(3);
        let radii = radii(&directions, &faces, &wall(), &[]);
        for (direction, radius) in directions.iter().zip(&radii) {
            assert!((3.9..8.0).contains(radius), "{direction} {radius}");
            // Along the axis the wall is 4 away, at the rim of a cone 4.3.
            assert!(direction.z < 0.999 || (4.2..4.6).contains(radius), "{direction} {radius}");
        }
        let nothing = super::radii(&directions, &faces, &[], &[]);
        assert!(nothing.iter().all(|r| *r == BEHIND));
        let broken = super::radii(&directions, &faces, &[Vec3::NAN, Vec3::ZERO], &[]);
        assert_eq!(broken, nothing);
    }

    #[test]
    fn colours_are_continued_and_end() {
        let (_, faces) = octasphere(4);
        let mut colors = vec![None; faces.len()];
        colors[0] = Some([0.25, 0.5, 1.0]);
        let all = continued(colors, &faces);
        let there = all.iter().flatten().count();
        assert!(all.iter().flatten().all(|c| *c == [0.25, 0.5, 1.0]));
        assert!((RINGS * RINGS..faces.len() / 4).contains(&there), "{there}");
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
        synthetic::write(
            folder.path(),
            &SyntheticOptions { views: 12, width: 48, points: 300, seed: 0, ..SyntheticOptions::default() },
        )
        .unwrap();
        let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        let views: Vec<&View> = dataset.train().collect();
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let points: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
        let space = Space::new(&cameras, &points);
        let cameras: Vec<Camera> = cameras.iter().map(|camera| space.camera_to_training(camera)).collect();
        let points: Vec<Vec3> = points.iter().map(|point| space.to_training(*point)).collect();
        let mut photos = Pyramid::new(&views, 1 << 24, 8);
        let soup = shell(&points, &cameras, &mut photos, 3).unwrap();
        soup.validate().unwrap();
        let (mut same, mut seen) = (0, 0);
        for i in 0..soup.len() {
            let [a, b, c] = soup.vertices[i];
            for (k, camera) in cameras.iter().enumerate() {
                let photo = photos.take(k, LEVEL).unwrap();
                if let Some(rgb) = pixel(&camera.resized(photo.size), &photo, (a + b + c) / 3.0) {
                    let near = |c: usize| (soup.rgb(i)[c] - f32::from(rgb[c]) / 255.0).abs() < 0.2;
                    (same, seen) = (same + usize::from((0..3).all(near)), seen + 1);
                }
            }
        }
        assert!(seen > 100 && same > seen / 2, "{same} of {seen}");
    }
}
