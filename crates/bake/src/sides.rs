//! The sides of triangles: a side is drawn where photos look better with it.
//!
//! The front of a triangle is the side that most pixels of photos show. Its back, drawn, is often a
//! shard in front of what photos do show, or a wall that hides a room from outside; elsewhere it
//! closes a gap. Photos tell which: the error of their pixels that show the back is compared with
//! the error of what stands behind it. Backs that no photo shows are judged by those that a single
//! photo shows: without that photo, they would be such backs. They are drawn only where these speak
//! for it clearly, since they hide rooms.
//!
//! Triangles that no photo shows keep both sides, because nothing says which is seen. Without
//! photos, cameras alone tell which sides are seen, and a back that one of them sees stays.

use crate::views::{self, Views};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};

/// From which sides triangles are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Sides {
    /// From the side that most pixels of photos show, and from the other where photos look better
    /// with it
    Auto,
    /// From both, unless a mesh says otherwise
    Both,
}

/// Options of the sides of triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SidesOptions {
    /// From which sides triangles are drawn
    pub sides: Sides,
}

impl SidesOptions {
    /// As photos saw them.
    pub const DEFAULT: Self = Self { sides: Sides::Auto };
    /// From both sides: one material, and no pass over the cameras.
    pub const FAST: Self = Self { sides: Sides::Both };
}

trisplat_scene::default!(SidesOptions);

/// Sides of triangles that cameras see.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SidesDetails {
    /// Triangles that are drawn from one side from now on.
    pub single_sided: u64,
    /// Triangles whose back is drawn too: photos look better with it or, without photos, a camera
    /// sees it.
    pub two_sided: u64,
    /// Triangles that no camera sees.
    pub unseen: u64,
}

trisplat_scene::stage!(SidesDetails, "sides");

/// Draws each face of `mesh` that `cameras` see from its front only from now on, the side that most
/// of their pixels show, where `photos`, or without them the cameras, do not speak for its back; it
/// is turned so that its front is there. `backdrop` stands behind the mesh. A mesh with single-sided
/// faces keeps its sides.
///
/// # Errors
///
/// A photo that cannot be decoded.
pub fn sides(
    mesh: &mut Mesh,
    backdrop: Option<&Mesh>,
    cameras: &[Camera],
    photos: Option<&mut Views>,
    options: &SidesOptions,
    details: &mut SidesDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    if options.sides == Sides::Both {
        return Ok(Outcome::Skipped("`sides` both"));
    }
    if cameras.is_empty() {
        return Ok(Outcome::Skipped(
            "it needs cameras of photos: from a data set (`dataset`), or stored in the soup",
        ));
    }
    if mesh.single_sided.contains(&true) {
        return Ok(Outcome::Skipped("the input says from which sides triangles are drawn"));
    }
    let pixels = visible_sides(mesh, cameras, &mut progress.part(0.0, 0.4));
    let has_back: Vec<bool> = match photos {
        Some(photos) => {
            let fronts = fronts(mesh, &pixels);
            let evidence =
                back_evidence(mesh, fronts, backdrop, photos, &mut progress.part(0.4, 1.0))?;
            judge_backs(&evidence, photos.len())
        }
        None => pixels.iter().map(|[front, back]| *front.min(back) > 0).collect(),
    };
    let mut single_sided = vec![false; mesh.face_count()];
    for (face, [front, back]) in pixels.into_iter().enumerate() {
        if front + back == 0 {
            details.unseen += 1;
        } else if has_back[face] {
            details.two_sided += 1;
        } else {
            details.single_sided += 1;
            single_sided[face] = true;
            if back > front {
                mesh.flip(face);
            }
        }
    }
    if details.single_sided == 0 {
        return Ok(Outcome::Skipped("the backs of all triangles are wanted, or nobody sees any"));
    }
    mesh.single_sided = single_sided;
    Ok(Outcome::Changed(()))
}

/// The pixels of all cameras together that show the front and the back of each face. `[F]`
fn visible_sides(
    mesh: &Mesh,
    cameras: &[Camera],
    progress: &mut StageProgress<'_>,
) -> Vec<[u64; 2]> {
    let options = views::drawing(cameras, mesh, 1);
    let mut solid = SolidRasterizer::new();
    let mut pixels = vec![[0; 2]; mesh.face_count()];
    let mut camera_pixels = vec![0u32; mesh.face_count()];
    for (done, camera) in cameras.iter().enumerate() {
        progress.set(done, cameras.len());
        for face in
            solid.visibility(mesh, camera, &options).face.iter().filter(|face| **face != NO_FACE)
        {
            camera_pixels[*face as usize] += 1;
        }
        let eye = camera.position();
        for (face, count) in camera_pixels.iter_mut().enumerate().filter(|(_, count)| **count > 0) {
            let [a, b, c] = mesh.corners(face).map(|corner| (corner - eye).as_dvec3());
            let is_back = (b - a).cross(c - a).dot(a) > 0.0;
            pixels[face][usize::from(is_back)] += u64::from(std::mem::take(count));
        }
    }
    pixels
}

/// Evidence of the photos for and against the back of a face.
#[derive(Debug, Clone, Copy, Default)]
struct BackEvidence {
    /// Squared error of the pixels that show the back, less that of what stands behind it, sRGB in
    /// 0 to 1. Negative where photos look better with the back.
    excess: f64,
    /// Number of photos that show the back.
    photos: u32,
    /// The last of them.
    last_photo: usize,
}

/// Standard errors by which the backs of single photos must speak for backs that no photo shows:
/// chance alone does so once in forty times.
const CLEAR_ERRORS: f64 = 2.0;

/// True for the backs with which photos look better; `photo_count` is the number of all photos.
/// `[F]`
fn judge_backs(evidence: &[BackEvidence], photo_count: usize) -> Vec<bool> {
    let mut by_photo = vec![0.0; photo_count];
    for of in evidence.iter().filter(|of| of.photos == 1) {
        by_photo[of.last_photo] += of.excess;
    }
    let count = photo_count as f64;
    let mean = by_photo.iter().sum::<f64>() / count;
    let squares: f64 = by_photo.iter().map(|excess| (excess - mean).powi(2)).sum();
    let standard_error = (squares / (count * (count - 1.0))).sqrt();
    let are_unseen_wanted = mean < -CLEAR_ERRORS * standard_error;
    let is_wanted = |of: &BackEvidence| {
        if of.photos == 0 { are_unseen_wanted } else { of.excess < 0.0 }
    };
    evidence.iter().map(is_wanted).collect()
}

/// The scene with faces that are seen turned to the pixels that show them, and without their backs;
/// `pixels` show the front and the back of each face.
fn fronts(mesh: &Mesh, pixels: &[[u64; 2]]) -> Mesh {
    let mut fronts = mesh.clone();
    fronts.single_sided = pixels.iter().map(|[front, back]| front + back > 0).collect();
    for (face, [front, back]) in pixels.iter().enumerate() {
        if back > front {
            fronts.flip(face);
        }
    }
    fronts
}

/// Compares each photo with the scene and with its `fronts`, both before the backdrop. `[F]`
fn back_evidence(
    mesh: &Mesh,
    mut fronts: Mesh,
    backdrop: Option<&Mesh>,
    photos: &mut Views,
    progress: &mut StageProgress<'_>,
) -> Result<Vec<BackEvidence>> {
    let faces = mesh.face_count();
    let options = photos.drawing(mesh, 1);
    let mut with_backs = mesh.clone();
    if let Some(backdrop) = backdrop {
        with_backs.append(backdrop.clone())?;
        fronts.append(backdrop.clone())?;
    }
    let colors: Vec<[f32; 3]> =
        (0..with_backs.face_count()).map(|face| face_srgb(&with_backs, face)).collect();
    // The background shows beside all faces.
    let color = |face: u32| colors.get(face as usize).copied().unwrap_or(options.background);
    let mut solid = SolidRasterizer::new();
    let mut evidence = vec![BackEvidence::default(); faces];
    let mut photo_excess: Vec<Option<f64>> = vec![None; faces];
    let chosen: Vec<usize> = (0..photos.len()).collect();
    photos.prefetch(&chosen);
    for view in chosen {
        progress.set(view, photos.len());
        let photo = photos.photo(view)?;
        let is_cut = photos.is_cut(view);
        let camera = photos.camera(view);
        let shown = solid.visibility(&with_backs, camera, &options).face.clone();
        let behind = solid.visibility(&fronts, camera, &options);
        for (pixel, (&face, &behind)) in shown.iter().zip(&behind.face).enumerate() {
            if face == behind || face as usize >= faces {
                continue;
            }
            let pixel = PhotoPixel::new(&photo, pixel, is_cut, options.background);
            let excess = pixel.squared_error(color(face)) - pixel.squared_error(color(behind));
            *photo_excess[face as usize].get_or_insert(0.0) += excess;
        }
        for (of, excess) in evidence.iter_mut().zip(&mut photo_excess) {
            if let Some(excess) = excess.take() {
                of.excess += excess;
                of.photos += 1;
                of.last_photo = view;
            }
        }
    }
    Ok(evidence)
}

/// Mean colour of the corners of a face, sRGB in 0 to 1.
fn face_srgb(mesh: &Mesh, face: usize) -> [f32; 3] {
    let [a, b, c] = mesh.corner_colors(face);
    std::array::from_fn(|channel| srgb_from_linear((a[channel] + b[channel] + c[channel]) / 3.0))
}

/// A pixel of a photo.
struct PhotoPixel {
    /// sRGB in 0 to 1.
    srgb: [f32; 3],
    weight: f32,
}

impl PhotoPixel {
    /// Alpha of a photo that is cut is the share that the object covers of the pixel; else it is
    /// the weight of the pixel.
    fn new(photo: &RgbImage, pixel: usize, is_cut: bool, background: [f32; 3]) -> Self {
        let alpha = photo.alpha.as_ref().map_or(1.0, |alpha| f32::from(alpha[pixel]) / 255.0);
        let srgb = photo.rgb[pixel].map(|code| f32::from(code) / 255.0);
        if !is_cut {
            return Self { srgb, weight: alpha };
        }
        let over = |channel: usize| alpha * srgb[channel] + (1.0 - alpha) * background[channel];
        Self { srgb: std::array::from_fn(over), weight: 1.0 }
    }

    /// Weighted squared distance from a colour, sRGB in 0 to 1.
    fn squared_error(&self, color: [f32; 3]) -> f64 {
        let squares = self.srgb.iter().zip(color).map(|(a, b)| f64::from(a - b).powi(2));
        f64::from(self.weight) * squares.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backs_no_photo_shows_are_judged_by_those_of_one_photo() {
        // A back of no photo, one of three photos each, and one of many photos.
        let judge = |single: [f64; 3]| {
            let mut evidence = vec![BackEvidence::default()];
            for (last_photo, excess) in single.into_iter().enumerate() {
                evidence.push(BackEvidence { excess, photos: 1, last_photo });
            }
            evidence.push(BackEvidence { excess: 99.0, photos: 3, last_photo: 2 });
            judge_backs(&evidence, 3)
        };
        assert_eq!(judge([-3.0, -2.0, -2.5]), [true, true, true, true, false]);
        // Not clearly better; worse; a single photo has no standard error.
        assert_eq!(judge([-3.0, 1.0, -1.0]), [false, true, false, true, false]);
        assert_eq!(judge([3.0, 2.0, 2.5]), [false; 5]);
        let one = BackEvidence { excess: -1.0, photos: 1, last_photo: 0 };
        assert_eq!(judge_backs(&[BackEvidence::default(), one], 1), [false, true]);
    }
}
