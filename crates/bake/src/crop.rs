//! Keeps a region of the scene: a box, a sphere, the view of cameras, or the subject.
//!
//! The stage comes first, so that a budget of triangles is spent on the region.

mod subject;
mod volume;

use glam::{DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Error, Region, Result, Scene, Soup, UpAxis};

pub(crate) use volume::SubjectVolume;

/// Region of the scene to keep.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct CropOptions {
    /// Keep only triangles whose centroid is in a region, in the coordinates of the input: a box
    /// X0,Y0,Z0,X1,Y1,Z1, a sphere X,Y,Z,RADIUS, seen:K, the view of at least K cameras (of
    /// `--dataset` or the file), or subject, the object that the cameras look at, with the origin
    /// under it. Given several times: in all of them
    #[cfg_attr(feature = "cli", arg(long, value_name = "REGION", allow_hyphen_values = true))]
    #[schemars(with = "Vec<String>")]
    pub crop: Vec<Region>,
}

impl CropOptions {
    /// Keeps everything.
    pub const DEFAULT: Self = Self { crop: Vec::new() };

    /// True if a region is kept instead of everything.
    pub(crate) fn is_cropped(&self) -> bool {
        !self.crop.is_empty()
    }

    /// True if only the subject is kept.
    pub(crate) fn is_subject(&self) -> bool {
        self.crop.contains(&Region::Subject)
    }
}

/// Triangles dropped by cropping.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CropDetails {
    /// Triangles outside the region.
    pub outside: u64,
    /// Triangles of the subject, or of its support, that ended beyond the region and were cut
    /// there.
    pub cut: u64,
    /// Radius of the subject, as a share of the median distance of the cameras from it; absent
    /// without cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject_share: Option<f64>,
}

trisplat_scene::stage!(CropDetails, "crop");

/// Drops the triangles of `scene` outside the region; returns the volume of the subject, if only
/// that is kept. `cameras` look at the scene, in its frame; `up` is that of its file, if it names
/// one.
///
/// # Errors
///
/// A region by cameras without cameras; nothing left.
pub(crate) fn crop(
    scene: &mut Scene,
    cameras: &[Camera],
    up: Option<UpAxis>,
    options: &CropOptions,
    details: &mut CropDetails,
) -> Result<(Outcome<()>, Option<SubjectVolume>)> {
    if !options.is_cropped() {
        return Ok((Outcome::Skipped("`crop` was not given"), None));
    }
    let (keep, volume) = kept_triangles(scene, cameras, up, options)?;
    details.subject_share = volume.as_ref().and_then(|volume| volume.relative_radius(cameras));
    let kept = keep.iter().filter(|keep| **keep).count();
    let total = keep.len();
    if kept == total {
        return Ok((Outcome::Skipped("every triangle is inside"), volume));
    }
    match (scene, &volume) {
        (Scene::Soup(soup), Some(volume)) => details.cut = keep_parts(soup, &keep, volume),
        (Scene::Soup(soup), None) => soup.retain(|i| keep[i]),
        (Scene::Mesh(mesh), _) => mesh.retain(|i| keep[i]),
    }
    details.outside = (total - kept) as u64;
    Ok((Outcome::Changed(()), volume))
}

/// Keeps the parts in `volume` of the triangles that have `keep`. Returns the number of cut
/// triangles.
fn keep_parts(soup: &mut Soup, keep: &[bool], volume: &SubjectVolume) -> u64 {
    let mut order = Vec::new();
    let mut corners = Vec::new();
    let mut cut = 0;
    for i in (0..soup.len()).filter(|i| keep[*i]) {
        let parts = volume.parts(soup.vertices[i]);
        cut += u64::from(parts != [soup.vertices[i]]);
        order.extend(parts.iter().map(|_| i));
        corners.extend(parts);
    }
    *soup = Soup { vertices: corners, ..soup.subset(&order) };
    cut
}

/// True for triangles of `scene` in the region, at least one; and the volume of the subject, if it
/// is kept.
///
/// # Errors
///
/// As [`crop`].
fn kept_triangles(
    scene: &Scene,
    cameras: &[Camera],
    up: Option<UpAxis>,
    options: &CropOptions,
) -> Result<(Vec<bool>, Option<SubjectVolume>)> {
    let refuse = |wants: &str| Error::EmptyRegion {
        region: options.crop.iter().map(Region::to_string).collect::<Vec<_>>().join(" and "),
        wants: wants.to_owned(),
    };
    if cameras.is_empty() && options.crop.iter().any(|region| matches!(region, Region::Seen(_))) {
        let wants = "a box or a sphere, or photos: `dataset`, as the file stores no cameras";
        return Err(refuse(wants));
    }
    let (of_subject, volume) = if options.is_subject() {
        let wants = "a scene in which one thing stands out, or a box or a sphere";
        let found = subject::subject(scene, cameras, up);
        let (keep, volume) = found.ok_or_else(|| refuse(wants))?;
        (keep, Some(volume))
    } else {
        (Vec::new(), None)
    };
    let is_kept = |i: usize| {
        of_subject.get(i).is_none_or(|keep| *keep) && is_inside(scene.corners(i), cameras, options)
    };
    let keep: Vec<bool> = parallel::collect(scene.triangle_count(), GRAIN, is_kept);
    if !keep.contains(&true) {
        let wants =
            format!("a region that overlaps the scene: none of {} triangles is inside", keep.len());
        return Err(refuse(&wants));
    }
    Ok((keep, volume))
}

/// True for faces of a surface in the `volume` of the subject and the other regions. `[F]`
pub(crate) fn faces_within(
    mesh: &Mesh,
    volume: &SubjectVolume,
    cameras: &[Camera],
    options: &CropOptions,
) -> Vec<bool> {
    let mut keep = volume.faces(mesh.face_count(), |face| mesh.corners(face));
    for (face, keep) in keep.iter_mut().enumerate().filter(|(_, keep)| **keep) {
        *keep = is_inside(mesh.corners(face), cameras, options);
    }
    keep
}

/// True if the centroid of a triangle is in all regions.
fn is_inside(corners: [Vec3; 3], cameras: &[Camera], options: &CropOptions) -> bool {
    let centroid = corners.map(|v| v.as_dvec3()).into_iter().sum::<DVec3>() / 3.0;
    options.crop.iter().all(|region| region.holds(centroid, cameras))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};
    use trisplat_scene::mesh::Colors;

    /// A row of small triangles along x, the i-th at x = i.
    fn row(count: usize) -> Scene {
        let at =
            |i: usize| [Vec3::ZERO, Vec3::Y * 0.01, Vec3::Z * 0.01].map(|v| v + Vec3::X * i as f32);
        let positions = (0..count).flat_map(at).collect();
        Scene::Mesh(Mesh {
            positions,
            colors: Colors::Face(vec![[0.5; 3]; count]),
            ..Mesh::default()
        })
    }

    fn left(regions: &[&str], cameras: &[Camera]) -> Result<usize> {
        let crops = regions.iter().map(|text| text.parse().expect(text)).collect();
        let options = CropOptions { crop: crops };
        let mut scene = row(10);
        let mut details = CropDetails::default();
        let (first, _) = crop(&mut scene, cameras, None, &options, &mut details)?;
        let dropped = 10 - scene.triangle_count() as u64;
        assert_eq!((first == Outcome::Changed(()), details.outside), (dropped > 0, dropped));
        let (again, _) = crop(&mut scene, cameras, None, &options, &mut CropDetails::default())?;
        assert!(matches!(again, Outcome::Skipped(_)));
        Ok(scene.triangle_count())
    }

    #[test]
    fn what_is_outside_goes() {
        assert_eq!(left(&["2.5,-1,-1,6.5,1,1"], &[]).ok(), Some(4));
        assert_eq!(left(&["3,0,0,1.5"], &[]).ok(), Some(3));
        assert_eq!(left(&["2.5,-1,-1,6.5,1,1", "3,0,0,1.5"], &[]).ok(), Some(2));
        assert_eq!(left(&["-1,-1,-1,20,1,1"], &[]).ok(), Some(10));
        // Ahead of a camera at x = 4 with a right angle of view that looks along x, and of one at x
        // = 6.
        let camera = |x: f32| {
            let lens = Camera {
                rotation: Mat3::IDENTITY,
                translation: Vec3::ZERO,
                focal: Vec2::splat(50.0),
                center: Vec2::splat(50.0),
                size: UVec2::splat(100),
            };
            lens.with_look_at(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 0.0, 0.0), Vec3::Y)
        };
        let cameras = [camera(3.9), camera(5.9)];
        assert_eq!(left(&["seen:1"], &cameras).ok(), Some(6));
        assert_eq!(left(&["seen:2"], &cameras).ok(), Some(4));
        let nothing = left(&["seen:3"], &cameras).expect_err("there are two").to_string();
        assert!(nothing.starts_with("crop ") && nothing.contains("none of 10"), "{nothing}");
        let blind = left(&["seen:1"], &[]).expect_err("no cameras").to_string();
        assert!(blind.contains("`dataset`"), "{blind}");
    }
}
