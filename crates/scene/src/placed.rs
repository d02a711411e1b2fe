//! Frames of a scene: cameras in that of a file, training space, and a region of the world.

use crate::asset::{Placement, Provenance};
use crate::camera::Camera;
use crate::limits::Limits;
use crate::math::lists::{evenly_spaced, median};
use crate::rng::Rng;
use crate::soup::Soup;
use glam::{DQuat, DVec2, DVec3, Vec3};
use std::fmt;
use std::str::FromStr;

/// A camera of a world whose coordinates are relative to `origin`, in the frame of a file placed by
/// `placement`. Depths are in the file's units.
///
/// ```text
/// q = R (w - origin) + t,   f = U s (w - center)   gives   s q = R U^T f + s (R (center - origin) + t)
/// ```
pub fn to_file(camera: &Camera, placement: &Placement, origin: DVec3) -> Camera {
    let rotation = camera.rotation.as_dmat3();
    let moved = rotation * (DVec3::from(placement.center) - origin) + camera.translation.as_dvec3();
    Camera {
        rotation: (rotation * placement.rotation().transpose()).as_mat3(),
        translation: (moved * placement.scale).as_vec3(),
        ..*camera
    }
}

/// Undoes [`to_file`].
pub fn to_world(camera: &Camera, placement: &Placement, origin: DVec3) -> Camera {
    let rotation = camera.rotation.as_dmat3() * placement.rotation();
    let moved = camera.translation.as_dvec3() / placement.scale;
    Camera {
        rotation: rotation.as_mat3(),
        translation: (moved - rotation * (DVec3::from(placement.center) - origin)).as_vec3(),
        ..*camera
    }
}

// ---- The cameras of photos that a file names ----------------------------------------------------

/// Most of them: 60 bytes each.
const MAX_CAMERAS: usize = 32;
/// Pixels of a picture by one of them.
const PIXELS: f64 = 230_000.0;
/// Digits of their numbers: thousandths of what they are apart, or of a turn.
const DIGITS: f64 = 1e4;

/// Some of `cameras` as [`Provenance::cameras`] has them.
pub fn named(cameras: &[Camera]) -> Vec<[f64; 8]> {
    let chosen: Vec<Camera> =
        evenly_spaced(cameras.len(), MAX_CAMERAS).map(|i| cameras[i]).collect();
    let apart =
        chosen.iter().map(|c| c.position().distance(chosen[0].position())).fold(0.0, f32::max);
    let unit = libm::pow(10.0, libm::floor(libm::log10(f64::from(apart).max(1e-9))));
    let rounded = |number: f64, digits: f64| (number * digits).round() / digits;
    let numbers = |camera: &Camera| {
        let turn = DQuat::from_mat3(&camera.rotation.as_dmat3().transpose());
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let half = (camera.size.as_vec2() / camera.focal / 2.0).as_dvec2();
        let at = camera.position().as_dvec3().to_array().map(|x| rounded(x, DIGITS / unit));
        let [x, y, z] = (turn.xyz() / (1.0 + turn.w)).to_array();
        let rest = [x, y, z, half.x, half.y].map(|x| rounded(x, DIGITS));
        std::array::from_fn(|i| if i < 3 { at[i] } else { rest[i - 3] })
    };
    chosen.iter().map(numbers).collect()
}

/// The cameras that a file names, as far as they are possible.
pub fn named_cameras(provenance: &Provenance) -> Vec<Camera> {
    let camera = |&[px, py, pz, x, y, z, wide, high]: &[f64; 8]| {
        let eye = DVec3::new(px, py, pz).as_vec3();
        let square = x * x + y * y + z * z;
        let turn = DQuat::from_xyzw(2.0 * x, 2.0 * y, 2.0 * z, 1.0 - square).normalize();
        let half = DVec2::new(wide, high);
        let size = (half * (PIXELS / (wide * high)).sqrt()).round();
        let rotation = glam::DMat3::from_quat(turn).transpose().as_mat3();
        let center = (size / 2.0).as_vec2();
        let focal = (size / half / 2.0).as_vec2();
        let camera = Camera {
            rotation,
            translation: -(rotation * eye),
            focal,
            center,
            size: size.as_uvec2(),
        };
        camera.validate(&Limits::DEFAULT).ok().map(|()| camera)
    };
    provenance.cameras.iter().take(MAX_CAMERAS).filter_map(camera).collect()
}

// ---- Training space, in which rates and epsilons mean the same for every scene ------------------

/// Maximum number of pairs of a camera and a point for the unit; with more, a random selection is used.
const PAIRS: usize = 200_000;
/// One seed for all scenes: runs on parts of a scene, with seeds of their own, share its space.
const SEED: u64 = 0;

/// x_training = (x_world - center) * scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneNormalization {
    /// The world point that is the origin of training space.
    pub center: Vec3,
    /// Training units per world unit, > 0.
    pub scale: f32,
}

impl SceneNormalization {
    /// The space of these cameras and points. Without a point in front of a camera the unit is the
    /// cameras' spread; without that it is the world's.
    pub fn new(cameras: &[Camera], points: &[Vec3]) -> Self {
        Self::of(cameras, points.len(), |i| points[i])
    }

    /// Like [`SceneNormalization::new`], for `count` points that are not in a list, because only
    /// few are used.
    pub fn of(cameras: &[Camera], count: usize, point: impl Fn(usize) -> Vec3) -> Self {
        let positions: Vec<_> = cameras.iter().map(|c| c.position().as_dvec3()).collect();
        let center = positions.iter().sum::<glam::DVec3>() / positions.len().max(1) as f64;
        let depths: Vec<f32> = pairs(cameras.len(), count)
            .filter_map(|(c, p)| Some(cameras[c].shows(point(p))?.1))
            .collect();
        let spread = positions.iter().map(|p| p.distance(center)).fold(0.0, f64::max) as f32;
        let unit = median(depths, f32::total_cmp).unwrap_or(spread);
        let scale = if unit > 0.0 && unit.is_finite() { 1.0 / unit } else { 1.0 };
        Self { center: center.as_vec3(), scale }
    }

    /// A world point in training space.
    pub fn to_training(&self, world: Vec3) -> Vec3 {
        (world - self.center) * self.scale
    }

    /// A camera in training space, with the same picture of the moved scene.
    pub fn camera_to_training(&self, camera: &Camera) -> Camera {
        let translation = (camera.rotation * self.center + camera.translation) * self.scale;
        Camera { translation, ..*camera }
    }

    /// Moves a soup of training space back into the world.
    pub fn soup_to_world(&self, soup: &mut Soup) {
        let inverse = 1.0 / self.scale;
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = *corner * inverse + self.center;
        }
    }

    /// Moves a soup of the world into training space.
    pub fn soup_to_training(&self, soup: &mut Soup) {
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = self.to_training(*corner);
        }
    }
}

/// Pairs of a camera and a point: all of them, or [`PAIRS`] in which both are drawn independently.
/// A stride through the numbered pairs would meet only few cameras if it shared a factor with their
/// number.
fn pairs(cameras: usize, points: usize) -> impl Iterator<Item = (usize, usize)> {
    let all = cameras.saturating_mul(points);
    let camera = Rng::new(SEED, "space camera", 0);
    let point = Rng::new(SEED, "space point", 0);
    let below = |random: u64, count: usize| (random % count as u64) as usize;
    (0..all.min(PAIRS)).map(move |i| {
        if all <= PAIRS {
            (i % cameras, i / cameras)
        } else {
            (below(camera.bits(i as u64), cameras), below(point.bits(i as u64), points))
        }
    })
}

// ---- A part of space: a box, a sphere, the view of cameras, or the subject of a scene -----------

/// A part of space.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Region {
    /// Between two corners, the lower one first.
    Box([f64; 3], [f64; 3]),
    /// Around a point, so far.
    Sphere([f64; 3], f64),
    /// In the pictures of at least this many cameras, hidden or not.
    Seen(u32),
    /// The object that the cameras look at, with what it stands on near it.
    Subject,
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wants = "expected a box x0,y0,z0,x1,y1,z1, a sphere x,y,z,radius, seen:K, or subject";
        if text == "subject" {
            return Ok(Self::Subject);
        }
        if let Some(count) = text.strip_prefix("seen:") {
            let count = count.parse().ok().filter(|k| *k > 0);
            return count
                .map(Self::Seen)
                .ok_or_else(|| format!("has no number of cameras; {wants}"));
        }
        let number = |word: &str| word.trim().parse().ok().filter(|x: &f64| x.is_finite());
        match text.split(',').map(number).collect::<Option<Vec<f64>>>().as_deref() {
            Some(&[a, b, c, x, y, z]) if a <= x && b <= y && c <= z => {
                Ok(Self::Box([a, b, c], [x, y, z]))
            }
            Some(&[_, _, _, _, _, _]) => Err("is a box with x0 > x1, y0 > y1 or z0 > z1".into()),
            Some(&[x, y, z, radius]) if radius > 0.0 => Ok(Self::Sphere([x, y, z], radius)),
            _ => Err(wants.into()),
        }
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Box([a, b, c], [x, y, z]) => write!(f, "{a},{b},{c},{x},{y},{z}"),
            Self::Sphere([x, y, z], radius) => write!(f, "{x},{y},{z},{radius}"),
            Self::Seen(count) => write!(f, "seen:{count}"),
            Self::Subject => write!(f, "subject"),
        }
    }
}

crate::as_text!(Region);

impl Region {
    /// Whether a point is in it; `cameras` look at the scene. A subject needs the whole scene to be
    /// found: every point may be in it.
    pub fn holds(&self, point: DVec3, cameras: &[Camera]) -> bool {
        match *self {
            Self::Box(low, high) => {
                point.cmpge(DVec3::from(low)).all() && point.cmple(DVec3::from(high)).all()
            }
            Self::Sphere(center, radius) => point.distance(DVec3::from(center)) <= radius,
            Self::Seen(count) => {
                let seen = cameras.iter().filter(|camera| camera.shows(point.as_vec3()).is_some());
                seen.take(count as usize).count() == count as usize
            }
            Self::Subject => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::UpAxis;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    #[test]
    fn named_cameras_see_what_the_photos_see() {
        let size = UVec2::new(640, 480);
        let focal = Vec2::new(400.0, 410.0);
        let center = size.as_vec2() / 2.0;
        let lens =
            Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, focal, center, size };
        let eye =
            |i: usize| Vec3::new(3.0 * (i as f32).cos(), 0.2 * i as f32, 3.0 * (i as f32).sin());
        for scale in [1.0, 3e4, 2e-3] {
            let camera =
                |i| lens.looking(scale * eye(i), Vec3::ZERO, Vec3::new(0.1 * i as f32, 1.0, 0.0));
            let cameras: Vec<Camera> = (0..40).map(camera).collect();
            let mut provenance = Provenance { cameras: named(&cameras), ..Provenance::default() };
            let back = named_cameras(&provenance);
            assert_eq!(back.len(), MAX_CAMERAS);
            let chosen = evenly_spaced(cameras.len(), MAX_CAMERAS);
            for (i, back) in chosen.zip(&back) {
                let camera = cameras[i];
                let point = scale * Vec3::new(0.3, -0.4, 0.2);
                let seen = |camera: &Camera| {
                    camera.shows(point).expect("in view").0 / camera.size.as_vec2()
                };
                let off = seen(&camera).distance(seen(back));
                assert!(off < 2e-3, "{scale} {i} {off}");
            }
            // Numbers of a damaged file.
            provenance.cameras[0][3] = 7.0;
            provenance.cameras[1][7] = 0.0;
            provenance.cameras[2][0] = 1e300;
            assert_eq!(named_cameras(&provenance).len(), MAX_CAMERAS - 2);
        }
        assert!(named(&[]).is_empty());
    }

    #[test]
    fn a_placed_camera_sees_placed_points_where_it_saw_them() {
        let camera = Camera {
            rotation: Mat3::from_rotation_x(0.4) * Mat3::from_rotation_z(1.1),
            translation: Vec3::new(0.3, -2.0, 4.0),
            focal: Vec2::new(400.0, 410.0),
            center: Vec2::new(330.0, 220.0),
            size: UVec2::new(640, 480),
        };
        let origin = DVec3::new(1000.0, -50.0, 3.0);
        let pixel = |c: &Camera, p: Vec3| {
            let q = c.rotation * p + c.translation;
            (q.truncate() / q.z * c.focal + c.center, q.z)
        };
        for up in [UpAxis::Y, UpAxis::NegY, UpAxis::Z, UpAxis::NegZ, UpAxis::X, UpAxis::NegX] {
            let placement =
                Placement { up: up.into(), rotate: 33.0, scale: 2.5, center: [999.0, -49.0, 5.0] };
            let placed = to_file(&camera, &placement, origin);
            assert!((placed.rotation.determinant() - 1.0).abs() < 1e-5);
            for point in [Vec3::new(0.5, 1.0, 2.0), Vec3::new(-1.0, 0.25, 0.0)] {
                let world = (point.as_dvec3() + origin).as_vec3();
                let wants = pixel(&camera, point);
                let got = pixel(&placed, placement.to_file(world));
                assert!(
                    wants.0.distance(got.0) < 0.1 && (got.1 / wants.1 - 2.5).abs() < 1e-3,
                    "{up:?}"
                );
            }
            let back = to_world(&placed, &placement, origin);
            assert!(back.rotation.abs_diff_eq(camera.rotation, 1e-5));
            assert!(back.translation.abs_diff_eq(camera.translation, 1e-3));
        }
    }
}

#[cfg(test)]
mod normalization_tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};

    fn camera(position: Vec3) -> Camera {
        Camera {
            rotation: Mat3::IDENTITY,
            translation: -position,
            focal: Vec2::splat(100.0),
            center: Vec2::splat(50.0),
            size: UVec2::splat(100),
        }
    }

    #[test]
    fn a_moved_and_scaled_scene_trains_in_the_same_space() {
        let points: Vec<Vec3> = (0..50)
            .map(|i| Vec3::new((i % 5) as f32 * 0.1, (i % 7) as f32 * 0.1, 3.0 + i as f32 * 0.01))
            .collect();
        let base = SceneNormalization::new(&[camera(Vec3::ZERO), camera(Vec3::X)], &points);
        for (shift, scale) in
            [(Vec3::ZERO, 1e4f32), (Vec3::new(100.0, -50.0, 20.0), 1e-4), (Vec3::Y * 7.0, 3.0)]
        {
            let shift = shift * scale;
            let place = |p: Vec3| p * scale + shift;
            let moved: Vec<Vec3> = points.iter().map(|&p| place(p)).collect();
            let space = SceneNormalization::new(
                &[camera(place(Vec3::ZERO)), camera(place(Vec3::X))],
                &moved,
            );
            for (a, b) in points.iter().zip(&moved) {
                assert!(base.to_training(*a).distance(space.to_training(*b)) < 2e-4);
            }
        }
    }

    #[test]
    fn the_unit_is_taken_from_all_cameras() {
        // Sizes at which a stride through the pairs met 2, 1, 2 and 4 of the cameras.
        for (cameras, points) in [(90, 100_000), (15, 200_000), (34, 100_000), (300, 20_000)] {
            let mut times = vec![0u32; cameras];
            pairs(cameras, points).for_each(|(camera, _)| times[camera] += 1);
            let even = PAIRS as u32 / cameras as u32;
            assert!(
                times.iter().all(|&n| n > even / 2 && n < 2 * even),
                "{cameras} cameras: {times:?}"
            );
        }
        // One camera in three stands three times as far away: the median is that of the others.
        let cameras: Vec<Camera> =
            (0..90).map(|i| camera(Vec3::Z * if i % 3 == 0 { -2.0 } else { 0.0 })).collect();
        let space = SceneNormalization::new(&cameras, &vec![Vec3::Z; 100_000]);
        assert_eq!(space.scale, 1.0);
        assert_eq!(pairs(7, 3).collect::<std::collections::HashSet<_>>().len(), 21);
        assert_eq!(pairs(0, 5).count() + pairs(5, 0).count(), 0);
    }

    #[test]
    fn a_lone_camera_without_points_keeps_the_worlds_unit() {
        let space = SceneNormalization::new(&[camera(Vec3::new(5.0, 0.0, 0.0))], &[]);
        assert_eq!(space, SceneNormalization { center: Vec3::new(5.0, 0.0, 0.0), scale: 1.0 });
    }

    #[test]
    fn leaving_undoes_entering() {
        let space = SceneNormalization { center: Vec3::new(1.0, 2.0, 3.0), scale: 0.25 };
        let corners = [Vec3::X, Vec3::Y, Vec3::new(9.0, -4.0, 2.0)];
        let mut soup = Soup { vertices: vec![corners], ..Soup::default() };
        space.soup_to_training(&mut soup);
        space.soup_to_world(&mut soup);
        assert!(soup.vertices[0].iter().zip(&corners).all(|(a, b)| a.distance(*b) < 1e-6));
    }
}

#[cfg(test)]
mod region_tests {
    use super::*;

    #[test]
    fn regions_are_read_as_they_are_written() {
        for text in ["0,-1,2,3,4.5,6", "1,2,3,0.5", "seen:4", "subject"] {
            assert_eq!(
                text.parse::<Region>().map(|region| region.to_string()),
                Ok(text.to_owned())
            );
        }
        for wrong in
            ["1,0,0,0,1,1", "1,2,3", "1,2,3,0", "seen:0", "seen:x", "a,b,c,d", "1,2,3,nan", ""]
        {
            assert!(wrong.parse::<Region>().is_err(), "{wrong}");
        }
    }
}
