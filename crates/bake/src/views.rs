//! The photos of a bake, or pictures that replace them: they decide the importance and the colour
//! of a triangle.

use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;
use trisplat_dataset::exposure::{Exposures, compared_points};
use trisplat_dataset::{Dataset, DatasetOptions, Photo, Photos};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer, Visibility};
use trisplat_scene::camera::{Camera, PhotoDepths};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::{evenly_spaced, median};
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Placement, Result, frames};

/// Near plane as a share of the median distance from the cameras to the middle of the scene, as in
/// training.
const NEAR: f32 = 0.01;
/// Samples per pixel along each axis when a choice depends on the picture.
pub const SAMPLES: u32 = 2;
/// Pictures covered to this share show surroundings, not an object.
const MIN_SURROUNDINGS_COVER: f64 = 0.9;
/// One photo in this many is held out when a stage evaluates its fit.
const EVALUATION_EVERY: usize = 8;
/// Maximum number of held-out photos.
const MAX_EVALUATION_VIEWS: usize = 24;

/// Similarity of a scene to photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewScores {
    /// Mean PSNR, dB.
    pub psnr: f64,
    /// Mean SSIM.
    pub ssim: f64,
}

/// Training photos of a data set, or drawn pictures, with their cameras in the frame of the scene
/// that is baked.
#[derive(Debug)]
pub struct Views {
    cameras: Vec<Camera>,
    points: Vec<Vec3>,
    /// Cameras and points as they were read, in the world of the photos minus `origin`.
    read: (Vec<Camera>, Vec<Vec3>),
    origin: DVec3,
    photos: Photos,
    background: [f32; 3],
    /// Share of the pictures that shows the scene, when they are not photos.
    drawn: Option<f64>,
    /// Some photos have masked pixels.
    masked: bool,
    /// Photos of an object without background. `[views]`
    cut: Vec<bool>,
    /// The points that photos track, to compare their light: see [`compared_points`]. `[views]`
    pub(crate) tracked: Option<Vec<Vec<(u32, Vec2)>>>,
    /// The photos' corrections; empty for none.
    exposures: Exposures,
    /// Depths measured in the photos, in the world of the photos minus `origin`; empty for none.
    depths: Vec<PhotoDepths>,
    /// The scene is a part of what the photos show.
    part: bool,
    /// The cameras were chosen for the pictures, and nobody held them.
    pub(crate) are_chosen: bool,
}

impl Views {
    /// The training photos of `dataset`, which was read with `options`; held-out ones are never
    /// used.
    pub fn new(dataset: &Dataset, options: &DatasetOptions) -> Self {
        let cameras: Vec<Camera> = dataset.train().map(|v| v.camera).collect();
        let points: Vec<Vec3> = dataset.points.iter().map(|p| p.position).collect();
        Self {
            read: (cameras.clone(), points.clone()),
            cameras,
            points,
            origin: dataset.origin,
            photos: Photos::new(
                dataset.train().map(|v| v.photo.clone()).collect(),
                options.photo_bytes(),
            ),
            background: options.background.to_f32(),
            drawn: None,
            masked: dataset.train().any(|v| v.photo.mask.is_some() || v.photo.is_cut()),
            cut: dataset.train().map(|v| v.photo.is_cut()).collect(),
            tracked: compared_points(dataset),
            exposures: Exposures::default(),
            depths: Vec::new(),
            part: false,
            are_chosen: false,
        }
    }

    /// The training pictures of `dataset`, which was drawn in the frame of the scene; it covers a
    /// share `covered` of them. Where that is nearly all, the rest is a gap in surroundings and has
    /// no weight; else it is the background of an object.
    pub fn of_pictures(dataset: &Dataset, options: &DatasetOptions, covered: f64) -> Self {
        let views = Self { drawn: Some(covered), ..Self::new(dataset, options) };
        if covered >= MIN_SURROUNDINGS_COVER {
            Self { cut: Vec::new(), masked: false, ..views }
        } else {
            views
        }
    }

    /// The same pictures; with `are_chosen`, the program has chosen their cameras, so they tell
    /// nothing of what is up.
    #[must_use]
    pub fn of_chosen_cameras(self, are_chosen: bool) -> Self {
        Self { are_chosen, ..self }
    }

    /// Pictures drawn for `cameras` in the frame of the scene, over black; their alpha is the
    /// covered share of each pixel.
    pub fn drawn(cameras: Vec<Camera>, pictures: Vec<RgbImage>) -> Self {
        let mut covered = 0;
        let mut all = 0;
        for picture in &pictures {
            all += 255 * picture.rgb.len() as u64;
            covered += match &picture.alpha {
                Some(alpha) => alpha.iter().map(|a| u64::from(*a)).sum(),
                None => 255 * picture.rgb.len() as u64,
            };
        }
        Self {
            cameras,
            points: Vec::new(),
            read: (Vec::new(), Vec::new()),
            origin: DVec3::ZERO,
            photos: Photos::new(pictures.into_iter().map(Photo::drawn).collect(), 0),
            background: [0.0; 3],
            drawn: Some(covered as f64 / (all as f64).max(1.0)),
            masked: false,
            cut: Vec::new(),
            tracked: None,
            exposures: Exposures::default(),
            depths: Vec::new(),
            part: false,
            are_chosen: false,
        }
    }

    /// The same pictures, which show an object without background.
    pub fn of_object(self) -> Self {
        Self { masked: true, cut: vec![true; self.len()], ..self }
    }

    /// True when some photos have masked pixels.
    pub fn are_masked(&self) -> bool {
        self.masked
    }

    /// True when a photo shows an object without background: see [`Photo::is_cut`].
    pub fn is_cut(&self, view: usize) -> bool {
        self.cut.get(view).is_some_and(|cut| *cut)
    }

    /// True when any of them does.
    pub fn are_cut(&self) -> bool {
        self.cut.contains(&true)
    }

    /// True when these are drawn pictures, not photos.
    pub fn is_drawn(&self) -> bool {
        self.drawn.is_some()
    }

    /// Share of the pictures that shows the scene, 0 to 1; 1 for photos.
    pub fn covered(&self) -> f64 {
        self.drawn.unwrap_or(1.0)
    }

    /// Number of photos.
    pub fn len(&self) -> usize {
        self.cameras.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    /// The photos that stages hold out at first, to evaluate on, and the others. The same for every
    /// stage: what was fitted to the others by one is unseen by all. Fewer than five photos are all
    /// fitted to.
    pub fn held_out(&self) -> (Vec<usize>, Vec<usize>) {
        let every = EVALUATION_EVERY.max(self.len().div_ceil(MAX_EVALUATION_VIEWS));
        (0..self.len()).partition(|view| view % every == every / 2)
    }

    /// The cameras of all photos.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The points of the photos' reconstruction, if the data set has any.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Options by which the photos' cameras draw `mesh`: see `drawing`.
    pub fn drawing(&self, mesh: &Mesh, samples: u32) -> SolidRasterOptions {
        SolidRasterOptions { background: self.background, ..drawing(&self.cameras, mesh, samples) }
    }

    /// The mean of the places the photos were taken from.
    pub fn center(&self) -> Vec3 {
        let sum: DVec3 = self.cameras.iter().map(|c| c.position().as_dvec3()).sum();
        (sum / self.len().max(1) as f64).as_vec3()
    }

    /// The largest distance of a camera from [`Views::center`].
    pub fn radius(&self) -> f32 {
        let center = self.center();
        self.cameras.iter().map(|c| c.position().distance(center)).fold(0.0, f32::max)
    }

    /// Transforms cameras and points from the world of the photos into the frame of a file that was
    /// placed in it. Those of drawn pictures are in that frame already. The views may serve several
    /// bakes, one after the other.
    pub fn transform(&mut self, placement: &Placement) {
        if self.drawn.is_some() {
            return;
        }
        let (cameras, points) = &self.read;
        self.cameras =
            cameras.iter().map(|camera| frames::to_file(camera, placement, self.origin)).collect();
        let transform = placement.transform();
        let origin = self.origin;
        self.points = points.iter().map(|p| transform((p.as_dvec3() + origin).as_vec3())).collect();
    }

    /// The same photos with depths measured in them, in the world that they were read in.
    #[must_use]
    pub fn with_depths(self, depths: Vec<PhotoDepths>) -> Self {
        Self { depths, ..self }
    }

    /// The depths measured in the photos, in the frame of a file that was placed in their world.
    pub fn depths(&self, placement: &Placement) -> Vec<PhotoDepths> {
        let scale = placement.scale as f32;
        let transformed = |map: &PhotoDepths| PhotoDepths {
            camera: frames::to_file(&map.camera, placement, self.origin),
            depth: map.depth.iter().map(|depth| depth * scale).collect(),
            rgb: map.rgb.clone(),
        };
        self.depths.iter().map(transformed).collect()
    }

    /// The camera of a photo.
    pub fn camera(&self, view: usize) -> &Camera {
        &self.cameras[view]
    }

    /// Starts decoding photos that are needed next, in this order.
    pub fn prefetch(&mut self, views: &[usize]) {
        self.photos.prefetch(views.iter().copied());
    }

    /// A photo. Its alpha is the weight of each pixel or, for a photo that is cut, the share
    /// covered by the object. Fails when its file cannot be decoded.
    pub fn photo(&mut self, view: usize) -> Result<Arc<RgbImage>> {
        let photo = self.corrected_photo(view)?;
        Ok(if self.is_cut(view) && photo.alpha.is_some() {
            Arc::new(photo.unpremultiplied())
        } else {
            photo
        })
    }

    /// A photo with its exposure corrected.
    fn corrected_photo(&mut self, view: usize) -> Result<Arc<RgbImage>> {
        let photo = self.photos.take(view)?;
        Ok(self.exposures.correct(view, &photo).map_or(photo, Arc::new))
    }

    /// Corrects photos from now on.
    pub fn correct_by(&mut self, exposures: Exposures) {
        self.exposures = exposures;
    }

    /// At most `count` photos, evenly spaced in their order.
    pub fn evenly_spaced(&self, count: usize) -> Vec<usize> {
        evenly_spaced(self.len(), count).collect()
    }

    /// Scores from now on are of the pixels that the scene covers, if it is a `part` of what the
    /// photos show.
    pub fn show_part(&mut self, part: bool) {
        self.part = part;
    }

    /// Mean PSNR of `mesh`, drawn solid, against the photos `chosen`, dB. Fails when a photo cannot
    /// be decoded.
    pub fn mean_psnr(&mut self, mesh: &Mesh, chosen: &[usize]) -> Result<f64> {
        let [psnr] = self.mean(mesh, chosen, |photo, drawn| {
            [metric::psnr(&photo.rgb, &drawn.rgb, photo.alpha.as_deref())]
        })?;
        Ok(psnr)
    }

    /// Mean PSNR and SSIM, likewise.
    pub(crate) fn mean_scores(&mut self, mesh: &Mesh, chosen: &[usize]) -> Result<ViewScores> {
        let [psnr, ssim] = self.mean(mesh, chosen, |photo, drawn| {
            let weights = photo.alpha.as_deref();
            [
                metric::psnr(&photo.rgb, &drawn.rgb, weights),
                metric::ssim(photo.size, &photo.rgb, &drawn.rgb, weights),
            ]
        })?;
        Ok(ViewScores { psnr, ssim })
    }

    /// Mean of `measure` over the photos `chosen` and drawings of `mesh` from their cameras.
    fn mean<const N: usize>(
        &mut self,
        mesh: &Mesh,
        chosen: &[usize],
        measure: impl Fn(&RgbImage, &RgbImage) -> [f64; N],
    ) -> Result<[f64; N]> {
        let options = self.drawing(mesh, SAMPLES);
        let mut solid = SolidRasterizer::new();
        let mut sums = [0.0; N];
        self.prefetch(chosen);
        let mut count = 0;
        for &view in chosen {
            let mut photo = self.corrected_photo(view)?;
            if self.part && !self.is_cut(view) {
                let one = SolidRasterOptions { samples: 1, ..options };
                let Some(covered) =
                    without_uncovered(&photo, solid.visibility(mesh, self.camera(view), &one))
                else {
                    continue;
                };
                photo = Arc::new(covered);
            }
            count += 1;
            let cut = self.is_cut(view) && photo.alpha.is_some();
            let mut scores = |photo: &RgbImage, background: [f32; 3]| {
                let options = SolidRasterOptions { background, ..options };
                measure(photo, &solid.render(mesh, self.camera(view), &options))
            };
            let of_view = if !cut {
                scores(&photo, options.background)
            } else {
                let of = |code: u8| (photo.recomposited([code; 3]), [f32::from(code) / 255.0; 3]);
                let [black, white] = [of(0), of(255)];
                let [black, white] = [scores(&black.0, black.1), scores(&white.0, white.1)];
                std::array::from_fn(|i| (black[i] + white[i]) / 2.0)
            };
            for (sum, score) in sums.iter_mut().zip(of_view) {
                *sum += score;
            }
        }
        Ok(sums.map(|sum| sum / f64::from(count.max(1))))
    }
}

/// A photo without the pixels that show no face; `None` when none do.
fn without_uncovered(photo: &RgbImage, visibility: &Visibility) -> Option<RgbImage> {
    let mut alpha = photo.alpha.clone().unwrap_or_else(|| vec![u8::MAX; photo.rgb.len()]);
    for (alpha, face) in alpha.iter_mut().zip(&visibility.face) {
        if *face == NO_FACE {
            *alpha = 0;
        }
    }
    alpha.iter().any(|alpha| *alpha > 0).then(|| RgbImage { alpha: Some(alpha), ..photo.clone() })
}

/// Options by which `cameras` draw `mesh`: with the near plane a hundredth of the way to its
/// middle, and a black background.
pub(crate) fn drawing(cameras: &[Camera], mesh: &Mesh, samples: u32) -> SolidRasterOptions {
    let count = mesh.vertex_count().max(1);
    let middle = mesh.positions.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / count as f64;
    let away = cameras.iter().map(|c| c.position().distance(middle.as_vec3())).collect();
    let near = median(away, f32::total_cmp).unwrap_or(1.0) * NEAR;
    let near = if near > 0.0 && near.is_finite() { near } else { NEAR };
    SolidRasterOptions { background: [0.0; 3], samples, near }
}
