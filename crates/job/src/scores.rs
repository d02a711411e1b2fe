//! Scores of pictures against photos: PSNR, SSIM and FLIP. PSNR and SSIM are given twice: for the
//! drawing itself, and after the affine map of its colours that fits the photo best.

use super::extrapolation::{CoverageScores, DepthScores};
use super::grade::Grade;
use super::shine::ShineScores;
use glam::Vec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Dataset, Photos, ShrunkSize, View};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::ColorMap;
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Result, parallel};
use trisplat_train::Quality;

/// Report of `trisplat eval --report`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat eval report")]
pub struct EvalReport {
    /// Program and version.
    pub generator: String,
    /// The soup, mesh or Gaussians, as given.
    pub file: String,
    /// The data set, as given.
    pub dataset: String,
    /// The photos: "test", "train" or "all".
    pub split: String,
    /// Samples per pixel along each axis of solid drawings.
    pub ssaa: u32,
    /// The size that photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// The scores at each step from scene to file, in order. A mesh has one, "solid", and Gaussians
    /// "splats".
    pub steps: Vec<RepresentationScore>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// The scores of a scene at one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RepresentationScore {
    /// "soft": the soup as trained. "solid": the scene, or the given mesh, as an engine draws it.
    /// "file": the same, written quantised and compressed, and read back. "splats": Gaussians as
    /// their trainers draw them.
    pub name: String,
    /// Number of triangles.
    pub triangles: u64,
    /// Number of Gaussians; absent for triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub splats: Option<u64>,
    /// Size of the file, if one was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Means over the photos, each photo counting once.
    pub mean: Scores,
    /// The mean minus that of the previous step: the loss of this step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Scores>,
    /// Depth at the points that photos track; absent without tracks or a solid surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthScores>,
    /// Coverage of views beside the cameras; absent without a solid surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<CoverageScores>,
    /// Its look in one word; absent in older reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grade: Option<Grade>,
    /// Change of view-dependent colours in views 60° beside the cameras; absent without any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shine: Option<ShineScores>,
    /// Mean PSNR of drawings that are brought to the estimated exposure and white balance of each
    /// photo, dB: an estimate from tracked points, never fitted to the picture. Absent where a
    /// photo has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_own_exposure: Option<f64>,
    /// Photo by photo, in order of name.
    pub images: Vec<ImageScore>,
    /// Seconds spent drawing.
    pub draw_secs: f64,
}

/// Scores of a picture against a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scores {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
    /// Mean FLIP error; lower is better.
    pub flip: f64,
    /// PSNR after an affine map of the drawing's colours that is fitted to the photo, dB: without
    /// the error of the photo's exposure and white balance.
    #[serde(default)]
    pub psnr_corrected: f64,
    /// SSIM after the same map.
    #[serde(default)]
    pub ssim_corrected: f64,
}

/// One photo's score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImageScore {
    /// The photo's name.
    pub name: String,
    /// Width and height, px.
    pub size: [u32; 2],
    /// Scores of the drawing.
    #[serde(flatten)]
    pub score: Scores,
}

/// The drawing of a view at one step, and its scores.
#[derive(Debug)]
pub struct ScoredPicture {
    /// Name of the step.
    pub step: &'static str,
    /// The drawing.
    pub picture: RgbImage,
    /// Scores of the drawing.
    pub score: ImageScore,
    /// PSNR at the photo's own exposure, dB, if that is known.
    pub(super) psnr_own_exposure: Option<f64>,
}

/// Scores a drawing of a photo.
pub(super) fn measure(
    step: &'static str,
    name: &str,
    photo: &RgbImage,
    picture: RgbImage,
) -> ScoredPicture {
    let weights = photo.alpha.as_deref();
    let map = ColorMap::fit(&picture.rgb, &photo.rgb, weights);
    measure_with(step, name, photo, picture, |picture| map.of(&picture.rgb))
}

/// The same after correcting the picture's colours with `corrected`.
fn measure_with(
    step: &'static str,
    name: &str,
    photo: &RgbImage,
    picture: RgbImage,
    corrected: impl FnOnce(&RgbImage) -> Vec<[u8; 3]>,
) -> ScoredPicture {
    let Quality { psnr, ssim } = Quality::of(&picture, photo);
    let corrected = RgbImage { size: picture.size, rgb: corrected(&picture), alpha: None };
    let Quality { psnr: psnr_corrected, ssim: ssim_corrected } = Quality::of(&corrected, photo);
    let flip = metric::flip(photo.size, &photo.rgb, &picture.rgb, photo.alpha.as_deref());
    let score = Scores { psnr, ssim, flip, psnr_corrected, ssim_corrected };
    let name = name.to_owned();
    let size = photo.size.to_array();
    ScoredPicture {
        step,
        picture,
        score: ImageScore { name, size, score },
        psnr_own_exposure: None,
    }
}

/// The same for a photo of an object: over black and over white, as in [`Quality::over_two`]. The
/// picture is that over black. Colours are corrected on the object, not on the background.
pub(super) fn measure_cut(
    step: &'static str,
    name: &str,
    photo: &RgbImage,
    mut draw: impl FnMut([f32; 3]) -> RgbImage,
) -> ScoredPicture {
    let [black, white] = [0, 255].map(|code: u8| draw([f32::from(code) / 255.0; 3]));
    let straight = straight(&black, &white);
    let map = ColorMap::fit(&straight.rgb, &photo.unpremultiplied().rgb, photo.alpha.as_deref());
    let corrected = RgbImage { rgb: map.of(&straight.rgb), ..straight };
    let over = |code: u8, picture: RgbImage| {
        let photo = photo.recomposited([code; 3]);
        measure_with(step, name, &photo, picture, |_| corrected.clone().over([code; 3]).rgb)
    };
    let black = over(0, black);
    let white = over(255, white);
    let mean = mean([&black.score.score, &white.score.score].into_iter());
    ScoredPicture { score: ImageScore { score: mean, ..black.score }, ..black }
}

/// Colours and opacity, from drawings over black and over white.
fn straight(black: &RgbImage, white: &RgbImage) -> RgbImage {
    let opacity = |(black, white): (&[u8; 3], &[u8; 3])| {
        let through: u32 = (0..3).map(|c| u32::from(white[c].saturating_sub(black[c]))).sum();
        255 - ((through + 1) / 3) as u8
    };
    let alpha = black.rgb.iter().zip(&white.rgb).map(opacity).collect();
    RgbImage { alpha: Some(alpha), ..black.clone() }.unpremultiplied()
}

/// Scores drawings of held-out photos only in pixels that at least two training photos show,
/// because fewer leave depth unknown.
pub(super) struct SharedPixels<'a> {
    mesh: Mesh,
    options: SolidRasterOptions,
    cameras: Vec<Camera>,
    views: Vec<&'a View>,
    photos: Photos,
    solid: SolidRasterizer,
}

impl<'a> SharedPixels<'a> {
    /// Of a `surface` in the data set's frame with its near plane, for the `views` of the data set;
    /// `photo_bytes` is the memory for photos. `None` of photos of objects before nothing.
    pub(super) fn new(
        (mesh, near): (&Mesh, f32),
        dataset: &Dataset,
        views: &[&'a View],
        photo_bytes: u64,
    ) -> Option<Self> {
        if views.iter().any(|view| view.photo.is_cut()) {
            return None;
        }
        Some(Self {
            mesh: mesh.clone(),
            options: SolidRasterOptions { near, ..SolidRasterOptions::default() },
            cameras: dataset.train().map(|view| view.camera).collect(),
            views: views.to_vec(),
            photos: Photos::new(views.iter().map(|view| view.photo.clone()).collect(), photo_bytes),
            solid: SolidRasterizer::new(),
        })
    }

    /// The name of view `i`, and the PSNR of its drawing, dB; `None` of one that shows nothing of
    /// the kind.
    pub(super) fn psnr(&mut self, i: usize, picture: &RgbImage) -> Result<Option<(String, f64)>> {
        let View { name, camera, .. } = self.views[i];
        let photo = self.photos.take(i)?;
        let drawn = self.solid.visibility(&self.mesh, camera, &self.options);
        let back = camera.rotation.transpose();
        let weight = |pixel: usize| {
            let at = Vec2::new(
                (pixel as u32 % camera.size.x) as f32,
                (pixel as u32 / camera.size.x) as f32,
            );
            let depth = drawn.depth[pixel];
            let ray = ((at + 0.5 - camera.center) / camera.focal).extend(1.0);
            let place = camera.position() + back * ray * depth;
            let shown =
                || self.cameras.iter().filter(|other| other.is_in_frustum(place)).nth(1).is_some();
            let of_photo = photo.alpha.as_ref().map_or(u8::MAX, |alpha| alpha[pixel]);
            if depth.is_finite() && shown() { of_photo } else { 0 }
        };
        let weights = parallel::collect(drawn.depth.len(), parallel::GRAIN, weight);
        let is_any = weights.iter().any(|weight| *weight > 0);
        let psnr = || metric::psnr(&photo.rgb, &picture.rgb, Some(&weights));
        Ok(is_any.then(|| (name.clone(), psnr())))
    }
}

/// The mean of some scores; zeros without any.
pub(super) fn mean<'a>(scores: impl ExactSizeIterator<Item = &'a Scores> + Clone) -> Scores {
    let count = scores.len().max(1) as f64;
    Scores::each(|of| scores.clone().map(of).sum::<f64>() / count)
}

impl Scores {
    pub(super) fn minus(&self, before: &Self) -> Self {
        Self::each(|of| of(self) - of(before))
    }

    /// Scores whose every number is `number` of its getter.
    fn each(number: impl Fn(fn(&Self) -> f64) -> f64) -> Self {
        Self {
            psnr: number(|s| s.psnr),
            ssim: number(|s| s.ssim),
            flip: number(|s| s.flip),
            psnr_corrected: number(|s| s.psnr_corrected),
            ssim_corrected: number(|s| s.ssim_corrected),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{UVec2, Vec3};
    use trisplat_dataset::DatasetOptions;
    use trisplat_synthetic::SyntheticOptions;

    #[test]
    fn what_one_photo_shows_is_not_judged() {
        let folder = tempfile::tempdir().unwrap();
        let options =
            SyntheticOptions { views: 6, width: 64, points: 50, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &options).unwrap();
        let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        let view = &dataset.views[0];
        let camera = view.camera;
        let back = view.camera.rotation.transpose();
        let corner = |x: f32, y: f32| camera.position() + back * Vec3::new(9.0 * x, 9.0 * y, 2.0);
        let wall = [[corner(-1.0, -1.0), corner(3.0, -1.0), corner(-1.0, 3.0)]];
        // The left half of what the camera sees.
        let left = Camera { size: UVec2::new(camera.size.x / 2, camera.size.y), ..camera };
        let mut twice = SharedPixels {
            mesh: Mesh::from_triangles(&wall, &[[0.5; 3]]).unwrap(),
            cameras: vec![left, left, camera],
            options: SolidRasterOptions::default(),
            views: vec![view],
            photos: Photos::new(vec![view.photo.clone()], 0),
            solid: SolidRasterizer::new(),
        };
        let photo = twice.photos.take(0).unwrap();
        let mut picture = (*photo).clone();
        let width = camera.size.x as usize;
        let right = |(i, _): &(usize, &mut [u8; 3])| i % width > width / 2;
        for (_, pixel) in picture.rgb.iter_mut().enumerate().filter(right) {
            *pixel = pixel.map(|c| !c);
        }
        let equal = Some((view.name.clone(), 120.0));
        assert_eq!(twice.psnr(0, &picture).unwrap(), equal, "only one photo shows the right half");
        twice.cameras.push(camera);
        assert!(twice.psnr(0, &picture).unwrap().unwrap().1 < 20.0);
        twice.cameras.truncate(1);
        assert_eq!(twice.psnr(0, &picture).unwrap(), None);
    }
}
