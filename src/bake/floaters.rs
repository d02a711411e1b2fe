//! Drops triangles that hang in the air before a camera.
//!
//! Nobody photographs with something a tenth of the scene's depth before the lens and nowhere else in the photos. A trainer that
//! does not clip so near puts triangles there to paint one photo; from beside it they are shards that hide the scene. A thing that
//! was really there is in other photos too, so what enough of them see stays.

use super::views;
use crate::camera::Camera;
use crate::math::median::median;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid};
use crate::report::{Outcome, StageDetails};
use crate::teacher;
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// A triangle hangs before a camera when it is nearer than this share of the scene's depth.
const NEAR: f32 = 0.1;
/// What so many photos see was there.
const LEAST_VIEWS: u32 = 3;
/// With fewer cameras nothing can be said.
const FEWEST_CAMERAS: usize = 4;
/// Cameras between more than these add little, and finding them takes long.
const MOST_BETWEEN: usize = 500;
/// Cameras that the scene's depth is measured with.
const DEPTH_VIEWS: usize = 8;
/// Longer side of the pictures that are drawn, px.
const SIDE: u32 = 256;
/// A corner of a picture is at most so many times as far from the camera as it is deep.
const CORNER: f32 = 2.0;

/// Whether triangles that hang before cameras stay.
#[derive(
    Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct FloatersOptions {
    /// Keep triangles that hang right before a camera and that hardly any other camera sees
    #[cfg_attr(feature = "cli", arg(long))]
    pub keep_floaters: bool,
}

impl FloatersOptions {
    /// They are dropped.
    pub const DEFAULT: Self = Self { keep_floaters: false };
    /// Nothing is drawn to find any.
    pub const OFF: Self = Self { keep_floaters: true };
}

/// What was found before the cameras.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct FloatersDetails {
    /// Median depth of what the cameras see, in units of the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_depth: Option<f32>,
    /// Triangles nearer to a camera, or to a place between two, than a tenth of that.
    pub near: u64,
    /// How many of those stay because three photos or more see them.
    pub seen: u64,
}

impl StageDetails for FloatersDetails {
    const STAGE: &'static str = "floaters";
}

/// Drops the triangles of `mesh` that hang before one of `cameras`.
pub fn floaters(
    mesh: &mut Mesh,
    cameras: &[Camera],
    options: &FloatersOptions,
    details: &mut FloatersDetails,
) -> Outcome<()> {
    if options.keep_floaters {
        return Outcome::Unneeded("`keep_floaters`");
    }
    if cameras.len() < FEWEST_CAMERAS {
        return Outcome::Unneeded("it needs four cameras: of photos (`dataset`), or in a soup we trained");
    }
    let Some(depth) = scene_depth(mesh, cameras) else {
        return Outcome::Unneeded("the cameras see nothing");
    };
    details.scene_depth = Some(depth);
    let near = hanging_before(mesh, cameras, NEAR * depth);
    details.near = near.len() as u64;
    if near.is_empty() {
        return Outcome::Unneeded("nothing hangs before a camera");
    }
    let views = times_seen(mesh, cameras, &near);
    let (seen, hanging): (Vec<u32>, Vec<u32>) =
        near.into_iter().partition(|&face| views[face as usize] >= LEAST_VIEWS);
    details.seen = seen.len() as u64;
    if hanging.is_empty() || hanging.len() == mesh.face_count() {
        return Outcome::Unneeded("what is before a camera is in other photos too");
    }
    let mut stays = vec![true; mesh.face_count()];
    hanging.iter().for_each(|&face| stays[face as usize] = false);
    let kept: Vec<u32> = (0..).zip(&stays).filter(|(_, stays)| **stays).map(|(face, _)| face).collect();
    mesh.keep(&kept);
    Outcome::Changed(())
}

/// The median over some cameras of the median depth of what each sees.
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

/// The faces whose middle one of `cameras`, or one between two of them, has in its picture and not as deep as `depth`.
fn hanging_before(mesh: &Mesh, cameras: &[Camera], depth: f32) -> Vec<u32> {
    let between = match cameras.len() <= MOST_BETWEEN {
        true => teacher::viewpoints::between(cameras),
        false => Vec::new(),
    };
    let lenses = [cameras, &between].concat();
    // Of a scene's many triangles hardly any is near a camera, so cameras are looked up by where they are.
    let side = CORNER * depth;
    let cell = |point: Vec3| (point / side).floor().as_ivec3();
    let mut around: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for (i, lens) in lenses.iter().enumerate() {
        let middle = cell(lens.position());
        for step in 0..27 {
            let offset = IVec3::new(step % 3, step / 3 % 3, step / 9) - 1;
            around.entry(middle + offset).or_default().push(i);
        }
    }
    let hangs = |face: &u32| {
        let middle = mesh.centroid(*face as usize);
        let before = |&i: &usize| {
            let z = (lenses[i].rotation * middle + lenses[i].translation).z;
            z < depth && lenses[i].frames(middle)
        };
        around.get(&cell(middle)).is_some_and(|near| near.iter().any(before))
    };
    (0..mesh.face_count() as u32).into_par_iter().filter(hangs).collect()
}

/// How many of `cameras` see each face, as far as they have one of `faces` in their picture. `[F]`
fn times_seen(mesh: &Mesh, cameras: &[Camera], faces: &[u32]) -> Vec<u32> {
    let (options, mut solid) = (views::drawing(cameras, mesh, 1), Solid::new());
    let mut times = vec![0; mesh.face_count()];
    let mut last = vec![usize::MAX; mesh.face_count()];
    for (i, camera) in cameras.iter().enumerate() {
        let camera = camera.within(SIDE);
        let frames_any =
            |face: &u32| mesh.corners(*face as usize).iter().any(|corner| camera.frames(*corner));
        if !faces.iter().any(frames_any) {
            continue;
        }
        for &face in solid.visibility(mesh, &camera, &options).face.iter().filter(|face| **face != NO_FACE) {
            let face = face as usize;
            times[face] += u32::from(last[face] != i);
            last[face] = i;
        }
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Colors;
    use glam::{Mat3, UVec2, Vec2};

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
        (floaters(mesh, cameras, &FloatersOptions::DEFAULT, &mut details), details)
    }

    #[test]
    fn a_shard_before_one_camera_goes_and_what_many_see_stays() {
        // Two shards: before camera 2 and between cameras 3 and 4. A post that three cameras see, and a thing far from all of them.
        let shards = [(Vec3::new(0.98, 0.0, 0.2), 0.05), (Vec3::new(1.75, 0.0, 0.2), 0.02)];
        let stays = [(Vec3::new(1.0, 0.0, 0.95), 0.5), (Vec3::new(1.0, 0.0, 5.0), 1.0)];
        let mut mesh = scene(&[shards, stays].concat());
        let (outcome, details) = run(&mut mesh, &cameras(6));
        assert!(matches!(outcome, Outcome::Changed(())));
        assert_eq!(mesh.positions, scene(&stays).positions);
        assert_eq!((details.near, details.seen), (3, 1));
        assert!(matches!(run(&mut mesh, &cameras(6)).0, Outcome::Unneeded(_)), "the second time");
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
