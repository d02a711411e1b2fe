//! Drops triangles that float right in front of a camera.
//!
//! Real objects are rarely a tenth of the scene's depth in front of the lens of only one photo. A trainer
//! without a near clip puts triangles there to paint that photo; from other places they are shards that hide
//! the scene. Real objects appear in other photos too, so triangles seen by enough photos stay. A photo with
//! another colour at that place does not count as seeing it.

use super::right_before::{self, right_before};
use super::views::{self, Views};
use crate::camera::Camera;
use crate::error::Result;
use crate::image::Pixels;
use crate::math::color::srgb_from_linear;
use crate::math::median::median;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid};
use crate::report::{Outcome, StageDetails};
use crate::teacher;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// A triangle is a candidate when it is nearer to a camera than this share of the scene's depth.
const NEAR: f32 = 0.1;
/// A triangle that this many photos see is real.
const LEAST_VIEWS: u32 = 3;
/// A photo shows a triangle when their colours differ by at most this, mean over channels and pixels; colours
/// are 0 to 1, sRGB-encoded.
const LIKE: f32 = 0.15;
/// Fewer cameras do not suffice for a decision.
const FEWEST_CAMERAS: usize = 4;
/// Places between more cameras than these add little and take long.
const MOST_BETWEEN: usize = 500;
/// Cameras that the scene's depth is measured with.
const DEPTH_VIEWS: usize = 8;
/// Longer side of the pictures that are drawn, px.
const SIDE: u32 = 256;

/// Whether triangles right in front of cameras stay.
#[derive(
    Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(deny_unknown_fields, default)]
pub struct FloatersOptions {
    /// Keep triangles right before a camera that hardly any other camera sees
    pub keep_floaters: bool,
}

impl FloatersOptions {
    /// They are dropped.
    pub const DEFAULT: Self = Self { keep_floaters: false };
    /// Keeps all, and draws nothing.
    pub const OFF: Self = Self { keep_floaters: true };
}

/// Triangles found in front of the cameras.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct FloatersDetails {
    /// Median depth in the cameras' views, in units of the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_depth: Option<f32>,
    /// Triangles with a part in a photo, or in a picture from between two, that is nearer than a tenth of that.
    pub near: u64,
    /// Those that stay because three photos or more show them.
    pub seen: u64,
}

impl StageDetails for FloatersDetails {
    const STAGE: &'static str = "floaters";
}

/// Drops the triangles of `mesh` that float in front of one of `cameras`, which are those of `photos` if
/// there are any.
///
/// Errors: a photo that cannot be decoded.
pub fn floaters(
    mesh: &mut Mesh,
    cameras: &[Camera],
    photos: Option<&mut Views>,
    options: &FloatersOptions,
    details: &mut FloatersDetails,
) -> Result<Outcome<()>> {
    if options.keep_floaters {
        return Ok(Outcome::Unneeded("`keep_floaters`"));
    }
    if cameras.len() < FEWEST_CAMERAS {
        return Ok(Outcome::Unneeded(
            "it needs four cameras: from photos (`dataset`), or stored in the soup",
        ));
    }
    let Some(depth) = scene_depth(mesh, cameras) else {
        return Ok(Outcome::Unneeded("the cameras see nothing"));
    };
    details.scene_depth = Some(depth);
    let near = hanging_before(mesh, cameras, NEAR * depth);
    details.near = near.len() as u64;
    if near.is_empty() {
        return Ok(Outcome::Unneeded("nothing hangs before a camera"));
    }
    let times = times_seen(mesh, cameras, &near, photos)?;
    let hanging = near.iter().zip(&times).filter(|(_, times)| **times < LEAST_VIEWS);
    let hanging: Vec<u32> = hanging.map(|(face, _)| *face).collect();
    details.seen = (near.len() - hanging.len()) as u64;
    if hanging.is_empty() || hanging.len() == mesh.face_count() {
        return Ok(Outcome::Unneeded("what is before a camera shows in other photos too"));
    }
    let mut stays = vec![true; mesh.face_count()];
    hanging.iter().for_each(|&face| stays[face as usize] = false);
    let kept: Vec<u32> = (0..).zip(&stays).filter(|(_, stays)| **stays).map(|(face, _)| face).collect();
    mesh.keep(&kept);
    Ok(Outcome::Changed(()))
}

/// The median over some cameras of the median depth in each view.
fn scene_depth(mesh: &Mesh, cameras: &[Camera]) -> Option<f32> {
    let (options, mut solid) = (views::drawing(cameras, mesh, 1), Solid::new());
    let count = cameras.len().min(DEPTH_VIEWS);
    let depths = (0..count).filter_map(|i| {
        let camera = cameras[i * cameras.len() / count].within(SIDE);
        let seen = solid.visibility(mesh, &camera, &options);
        let depths = seen.face.iter().zip(&seen.depth).filter(|(face, _)| **face != NO_FACE);
        median(depths.map(|(_, depth)| *depth).collect(), f32::total_cmp)
    });
    median(depths.collect(), f32::total_cmp)
}

/// The faces with a part nearer than `depth` in the picture of one of `cameras`, or of one between two of them.
fn hanging_before(mesh: &Mesh, cameras: &[Camera], depth: f32) -> Vec<u32> {
    let between = match cameras.len() <= MOST_BETWEEN {
        true => teacher::viewpoints::between(cameras),
        false => Vec::new(),
    };
    right_before(mesh, &[cameras, &between].concat(), depth)
}

/// How many of `cameras` see each of `faces`; with photos, how many show its colour there. In the order of
/// `faces`.
fn times_seen(
    mesh: &Mesh,
    cameras: &[Camera],
    faces: &[u32],
    mut photos: Option<&mut Views>,
) -> Result<Vec<u32>> {
    let (options, mut solid) = (views::drawing(cameras, mesh, 1), Solid::new());
    let place: HashMap<u32, usize> = faces.iter().copied().zip(0..).collect();
    let colors: Vec<Vec3> = faces.iter().map(|&face| encoded_color(mesh, face as usize)).collect();
    let mut times = vec![0; faces.len()];
    for (i, camera) in cameras.iter().enumerate() {
        let framed = |face: &u32| right_before::shows(camera, mesh.corners(*face as usize), f32::INFINITY);
        if !faces.iter().any(framed) {
            continue;
        }
        let camera = camera.within(SIDE);
        let photo = photos.as_deref_mut().map(|photos| photos.photo(i)).transpose()?;
        // Sum of the differences between its pixels and the photo's, and number of pixels.
        let mut shown = vec![(0.0, 0u32); faces.len()];
        for (pixel, face) in (0..).zip(&solid.visibility(mesh, &camera, &options).face) {
            let Some(&at) = place.get(face) else { continue };
            let off = photo.as_ref().map_or(0.0, |photo| {
                let middle = Vec2::new((pixel % camera.size.x) as f32, (pixel / camera.size.x) as f32) + 0.5;
                let there = color_at(photo, middle / camera.size.as_vec2());
                (there - colors[at]).abs().element_sum() / 3.0
            });
            shown[at] = (shown[at].0 + off, shown[at].1 + 1);
        }
        let agrees = |(off, pixels): (f32, u32)| pixels > 0 && off <= LIKE * pixels as f32;
        times.iter_mut().zip(shown).for_each(|(times, shown)| *times += u32::from(agrees(shown)));
    }
    Ok(times)
}

/// The mean colour of a face, sRGB-encoded.
fn encoded_color(mesh: &Mesh, face: usize) -> Vec3 {
    let corners = mesh.corner_colors(face);
    corners.iter().map(|corner| Vec3::from(corner.map(srgb_from_linear))).sum::<Vec3>() / 3.0
}

/// The colour of a photo at `place`, (0, 0) to (1, 1), sRGB-encoded.
fn color_at(photo: &Pixels, place: Vec2) -> Vec3 {
    let pixel = (place * photo.size.as_vec2()).as_uvec2().min(photo.size - 1);
    let rgb = photo.rgb[(pixel.y * photo.size.x + pixel.x) as usize];
    Vec3::from(rgb.map(f32::from)) / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Colors;
    use glam::{Mat3, UVec2};

    /// Cameras in a row along x, half a unit apart, that look along z.
    fn cameras(count: usize) -> Vec<Camera> {
        let camera = |i: usize| Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::X * -(i as f32) / 2.0,
            focal: Vec2::splat(100.0),
            center: Vec2::splat(50.0),
            size: UVec2::splat(100),
        };
        (0..count).map(camera).collect()
    }

    /// A wall ten units away, and triangles of this size at these places.
    fn scene(things: &[(Vec3, f32)]) -> Mesh {
        let wall = [(Vec3::new(-40.0, -40.0, 10.0), 100.0), (Vec3::new(40.0, 40.0, 10.0), -100.0)];
        let all = wall.iter().chain(things);
        let positions: Vec<Vec3> =
            all.flat_map(|(at, size)| [*at, *at + *size * Vec3::X, *at + *size * Vec3::Y]).collect();
        let faces = positions.len() / 3;
        Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; faces]), ..Mesh::default() }
    }

    fn run(mesh: &mut Mesh, cameras: &[Camera]) -> (Outcome<()>, FloatersDetails) {
        let mut details = FloatersDetails::default();
        let outcome = floaters(mesh, cameras, None, &FloatersOptions::DEFAULT, &mut details);
        (outcome.unwrap(), details)
    }

    #[test]
    fn photos_of_another_colour_do_not_show_it() {
        let mesh = scene(&[(Vec3::new(0.8, 0.0, 0.95), 0.9)]);
        let grey = Vec3::splat(srgb_from_linear(0.5));
        for (level, times) in [((255.0 * grey.x) as u8, 4), (20, 0)] {
            let picture = || Pixels { size: UVec2::splat(50), rgb: vec![[level; 3]; 2500], alpha: None };
            let mut photos = Views::drawn(cameras(6), (0..6).map(|_| picture()).collect());
            assert_eq!(times_seen(&mesh, &cameras(6), &[2], Some(&mut photos)).unwrap(), [times]);
        }
    }

    #[test]
    fn a_shard_before_one_camera_goes_and_what_many_see_stays() {
        // Two shards: before camera 2 and between cameras 3 and 4. A post that three cameras see, and a thing far from all of them.
        let shards = [(Vec3::new(0.98, 0.0, 0.2), 0.05), (Vec3::new(1.75, 0.0, 0.2), 0.02)];
        let stays = [(Vec3::new(0.8, 0.0, 0.95), 0.9), (Vec3::new(1.0, 0.0, 5.0), 1.0)];
        let mut mesh = scene(&[shards, stays].concat());
        let (outcome, details) = run(&mut mesh, &cameras(6));
        assert!(matches!(outcome, Outcome::Changed(())));
        assert_eq!(mesh.positions, scene(&stays).positions);
        assert_eq!((details.near, details.seen), (3, 1));
        assert!(matches!(run(&mut mesh, &cameras(6)).0, Outcome::Unneeded(_)), "the second time");
    }

    #[test]
    fn a_large_shard_whose_middle_is_beside_the_picture_goes() {
        // It hides all that camera 2 sees; its middle is far to the right, behind every other camera.
        let shard = (Vec3::new(0.9, -0.1, 0.1), 12.0);
        let mut mesh = scene(&[shard]);
        let turn = 2;
        let mut lenses = cameras(6);
        for (i, lens) in lenses.iter_mut().enumerate().filter(|(i, _)| *i != turn) {
            let eye = lens.position() - 5.0 * Vec3::Z - Vec3::X * i as f32;
            *lens = lens.looking(eye, Vec3::new(-20.0, 0.0, 10.0), -Vec3::Y);
        }
        assert!(!lenses.iter().any(|lens| lens.frames(mesh.centroid(2))));
        let (outcome, details) = run(&mut mesh, &lenses);
        assert!(matches!(outcome, Outcome::Changed(())), "{outcome:?}");
        assert_eq!(mesh.positions, scene(&[]).positions);
        assert_eq!((details.near, details.seen), (1, 0));
    }

    #[test]
    fn nothing_to_do_is_said() {
        let why = |mesh: &mut Mesh, cameras: &[Camera]| match run(mesh, cameras).0 {
            Outcome::Unneeded(why) => why,
            Outcome::Changed(()) => "changed",
        };
        assert_eq!(why(&mut scene(&[]), &cameras(6)), "nothing hangs before a camera");
        assert!(why(&mut scene(&[]), &cameras(3)).starts_with("it needs four cameras"));
        assert_eq!(why(&mut Mesh::default(), &cameras(4)), "the cameras see nothing");
    }
}
