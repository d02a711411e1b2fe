//! Keeps a region of the scene: a box, a sphere, or what cameras have in view.
//!
//! It comes first, so that a budget of triangles is spent on what stays.

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::report::{Outcome, StageDetails};
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::fmt;
use std::str::FromStr;

/// Which part of the scene is kept.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct CropOptions {
    /// Keep only triangles whose centroid is in a region, in the coordinates of the input: a box
    /// X0,Y0,Z0,X1,Y1,Z1, a sphere X,Y,Z,RADIUS, or seen:K, what at least K cameras (of `--dataset` or the file) have in
    /// view. Given several times: in all of them
    #[cfg_attr(feature = "cli", arg(long, value_name = "REGION", allow_hyphen_values = true))]
    #[schemars(with = "Vec<String>")]
    pub crop: Vec<Region>,
}

impl CropOptions {
    /// Keeps everything.
    pub const DEFAULT: Self = Self { crop: Vec::new() };
}

/// A part of space.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Region {
    /// Between two corners, the lower one first.
    Box([f64; 3], [f64; 3]),
    /// Around a point, so far.
    Sphere([f64; 3], f64),
    /// In the pictures of at least so many cameras, whether something hides it or not.
    Seen(u32),
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wants = "wants a box x0,y0,z0,x1,y1,z1, a sphere x,y,z,radius, or seen:K";
        if let Some(count) = text.strip_prefix("seen:") {
            let count = count.parse().ok().filter(|k| *k > 0);
            return count.map(Self::Seen).ok_or_else(|| format!("has no number of cameras; {wants}"));
        }
        let number = |word: &str| word.trim().parse().ok().filter(|x: &f64| x.is_finite());
        match text.split(',').map(number).collect::<Option<Vec<f64>>>().as_deref() {
            Some(&[a, b, c, x, y, z]) if a <= x && b <= y && c <= z => Ok(Self::Box([a, b, c], [x, y, z])),
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
        }
    }
}

impl TryFrom<String> for Region {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse().map_err(|reason| format!("{text:?} {reason}"))
    }
}

impl From<Region> for String {
    fn from(region: Region) -> Self {
        region.to_string()
    }
}

impl Region {
    fn holds(&self, point: DVec3, cameras: &[Camera]) -> bool {
        match *self {
            Self::Box(low, high) => {
                point.cmpge(DVec3::from(low)).all() && point.cmple(DVec3::from(high)).all()
            }
            Self::Sphere(center, radius) => point.distance(DVec3::from(center)) <= radius,
            Self::Seen(count) => {
                let seen = cameras.iter().filter(|camera| is_in_picture(camera, point.as_vec3()));
                seen.take(count as usize).count() == count as usize
            }
        }
    }
}

fn is_in_picture(camera: &Camera, point: Vec3) -> bool {
    let q = camera.rotation * point + camera.translation;
    let pixel = q.truncate() / q.z * camera.focal + camera.center;
    q.z > 0.0 && pixel.cmpge(glam::Vec2::ZERO).all() && pixel.cmplt(camera.size.as_vec2()).all()
}

/// What cropping dropped.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct CropDetails {
    /// Triangles outside the region.
    pub outside: u64,
}

impl StageDetails for CropDetails {
    const STAGE: &'static str = "crop";
}

/// Drops the triangles of `scene` outside the region. `cameras` look at it, in its frame.
///
/// Errors: a region by cameras without cameras; nothing left.
pub fn crop(
    scene: &mut Scene,
    cameras: &[Camera],
    options: &CropOptions,
    details: &mut CropDetails,
) -> Result<Outcome<()>> {
    let words = || options.crop.iter().map(Region::to_string).collect::<Vec<_>>().join(" and ");
    if options.crop.is_empty() {
        return Ok(Outcome::Unneeded("`crop` was not given"));
    }
    if cameras.is_empty() && options.crop.iter().any(|region| matches!(region, Region::Seen(_))) {
        let wants = "a box or a sphere, or photos: `dataset`, as the file stores no cameras";
        return Err(Error::invalid("crop", words(), wants));
    }
    let total = scene.triangle_count();
    let inside = |i: usize| is_inside(scene, i, cameras, options);
    let keep: Vec<bool> = (0..total).into_par_iter().with_min_len(1 << 12).map(inside).collect();
    let kept = keep.iter().filter(|keep| **keep).count();
    if kept == 0 {
        let wants = format!("a region that overlaps the scene: none of {total} triangles is inside");
        return Err(Error::invalid("crop", words(), wants));
    }
    if kept == total {
        return Ok(Outcome::Unneeded("every triangle is inside"));
    }
    match scene {
        Scene::Soup(soup) => soup.retain(|i| keep[i]),
        Scene::Mesh(mesh) => mesh.retain(|i| keep[i]),
    }
    details.outside = (total - kept) as u64;
    Ok(Outcome::Changed(()))
}

/// How many of the first `count` triangles [`crop`] keeps.
pub(super) fn count_inside(scene: &Scene, count: usize, cameras: &[Camera], options: &CropOptions) -> usize {
    (0..count.min(scene.triangle_count())).filter(|i| is_inside(scene, *i, cameras, options)).count()
}

fn is_inside(scene: &Scene, triangle: usize, cameras: &[Camera], options: &CropOptions) -> bool {
    let centroid = scene.corners(triangle).map(|v| v.as_dvec3()).into_iter().sum::<DVec3>() / 3.0;
    options.crop.iter().all(|region| region.holds(centroid, cameras))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Colors, Mesh};
    use glam::{Mat3, UVec2, Vec2};

    /// A row of small triangles along x, the i-th at x = i.
    fn row(count: usize) -> Scene {
        let at = |i: usize| [Vec3::ZERO, Vec3::Y * 0.01, Vec3::Z * 0.01].map(|v| v + Vec3::X * i as f32);
        let positions = (0..count).flat_map(at).collect();
        Scene::Mesh(Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; count]), ..Mesh::default() })
    }

    fn left(regions: &[&str], cameras: &[Camera]) -> Result<usize> {
        let crops = regions.iter().map(|text| text.parse().expect(text)).collect();
        let options = CropOptions { crop: crops };
        let (mut scene, mut details) = (row(10), CropDetails::default());
        let first = crop(&mut scene, cameras, &options, &mut details)?;
        let dropped = 10 - scene.triangle_count() as u64;
        assert_eq!((first == Outcome::Changed(()), details.outside), (dropped > 0, dropped));
        let again = crop(&mut scene, cameras, &options, &mut CropDetails::default())?;
        assert!(matches!(again, Outcome::Unneeded(_)));
        Ok(scene.triangle_count())
    }

    #[test]
    fn what_is_outside_goes() {
        assert_eq!(left(&["2.5,-1,-1,6.5,1,1"], &[]).ok(), Some(4));
        assert_eq!(left(&["3,0,0,1.5"], &[]).ok(), Some(3));
        assert_eq!(left(&["2.5,-1,-1,6.5,1,1", "3,0,0,1.5"], &[]).ok(), Some(2));
        assert_eq!(left(&["-1,-1,-1,20,1,1"], &[]).ok(), Some(10));
        // Ahead of a camera at x = 4 with a right angle of view that looks along x, and of one at x = 6.
        let camera = |x: f32| {
            let lens = Camera {
                rotation: Mat3::IDENTITY,
                translation: Vec3::ZERO,
                focal: Vec2::splat(50.0),
                center: Vec2::splat(50.0),
                size: UVec2::splat(100),
            };
            lens.looking(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 0.0, 0.0), Vec3::Y)
        };
        let cameras = [camera(3.9), camera(5.9)];
        assert_eq!(left(&["seen:1"], &cameras).ok(), Some(6));
        assert_eq!(left(&["seen:2"], &cameras).ok(), Some(4));
        let nothing = left(&["seen:3"], &cameras).expect_err("there are two").to_string();
        assert!(nothing.starts_with("crop ") && nothing.contains("none of 10"), "{nothing}");
        let blind = left(&["seen:1"], &[]).expect_err("no cameras").to_string();
        assert!(blind.contains("`dataset`"), "{blind}");
    }

    #[test]
    fn regions_are_read_as_they_are_written() {
        for text in ["0,-1,2,3,4.5,6", "1,2,3,0.5", "seen:4"] {
            assert_eq!(text.parse::<Region>().map(|region| region.to_string()), Ok(text.to_owned()));
        }
        for wrong in ["1,0,0,0,1,1", "1,2,3", "1,2,3,0", "seen:0", "seen:x", "a,b,c,d", "1,2,3,nan", ""] {
            assert!(wrong.parse::<Region>().is_err(), "{wrong}");
        }
    }
}
