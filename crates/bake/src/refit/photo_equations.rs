//! The equations of one photo for every triangle that it sees.

use super::equations::{ColorFit, Equations, MAX_RESIDUAL};
use crate::views::{SAMPLES, Views};
use trisplat_raster::solid::{
    Barycentrics, FaceBarycentrics, NO_FACE, SolidRasterOptions, SolidRasterizer, Visibility,
};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{linear_from_srgb, srgb8_from_linear};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::StageProgress;
use trisplat_scene::{Result, parallel};

/// Bands of rows that are summed in parallel. Fixed, so that sums do not depend on the number of
/// threads.
const BANDS: usize = 8;
/// Maximum number of samples of a pixel.
const MAX_SAMPLES: usize = 16;
/// The slot of a face without sums.
const NO_SLOT: u32 = u32::MAX;

/// A photo, and the scene rasterised from its camera.
pub(crate) struct PhotoObservation<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) camera: &'a Camera,
    pub(crate) photo: &'a RgbImage,
    pub(crate) visibility: &'a Visibility,
    /// sRGB-encoded.
    pub(crate) background: [f32; 3],
    /// The share of a sample's residual that comes from its whole pixel; the rest comes from its
    /// own colour.
    pub(crate) coupling: f32,
    /// Larger residuals count as this, sRGB-encoded.
    pub(crate) max_residual: f32,
}

/// Equations of one band, kept from photo to photo.
#[derive(Debug, Clone)]
struct Band {
    /// The slot of a face in `sums` and `corners`. `[F]`
    slots: Vec<u32>,
    sums: Vec<(u32, Equations)>,
    corners: Vec<FaceBarycentrics>,
    error: [f64; 3],
    pixels: f64,
}

/// The buffers of [`Gatherer::gather`], reused from photo to photo.
#[derive(Debug, Clone)]
pub(crate) struct Gatherer {
    bands: Vec<Band>,
}

impl Gatherer {
    /// For meshes of `faces`.
    pub(crate) fn new(faces: usize) -> Self {
        let slots = vec![NO_SLOT; faces];
        let band =
            Band { slots, sums: Vec::new(), corners: Vec::new(), error: [0.0; 3], pixels: 0.0 };
        Self { bands: vec![band; BANDS] }
    }

    /// Adds a photo to the sums of `fit` with this sign: -1 takes it back. Returns its mean error,
    /// sRGB-encoded.
    pub(super) fn gather(
        &mut self,
        observation: &PhotoObservation<'_>,
        fit: &mut ColorFit,
        sign: f32,
    ) -> [f32; 3] {
        self.sum(observation, fit);
        let mut error = [0.0; 3];
        let mut pixels = 0.0;
        for band in &self.bands {
            fit.add(&band.sums, sign);
            for (sum, error) in error.iter_mut().zip(band.error) {
                *sum += error;
            }
            pixels += band.pixels;
        }
        error.map(|e| (e / f64::max(pixels, 1.0)) as f32)
    }

    /// Gives `on_sums` the sums of each face that a photo shows, whose colours are those of `fit`.
    /// A face at the border of two bands of rows has sums of each.
    pub(crate) fn for_each_face(
        &mut self,
        observation: &PhotoObservation<'_>,
        fit: &ColorFit,
        mut on_sums: impl FnMut(u32, &Equations),
    ) {
        self.sum(observation, fit);
        for (face, sums) in self.bands.iter().flat_map(|band| &band.sums) {
            on_sums(*face, sums);
        }
    }

    /// Sums up the rows of a photo, band by band.
    fn sum(&mut self, observation: &PhotoObservation<'_>, fit: &ColorFit) {
        let rows = observation.photo.size.y;
        let row = |band: usize| (u64::from(rows) * band as u64 / BANDS as u64) as u32;
        parallel::for_each(&mut self.bands, |i, band| {
            band.sums.clear();
            band.corners.clear();
            band.error = [0.0; 3];
            band.pixels = 0.0;
            let mut pass = PhotoPass::new(observation, fit, band);
            for y in row(i)..row(i + 1) {
                pass.row(y);
            }
            for (face, _) in &band.sums {
                band.slots[*face as usize] = NO_SLOT;
            }
        });
    }
}

/// A sample of the current pixel: the slot of its face and the barycentric weights of the face's
/// corners.
type PixelSample = (u32, [f32; 3]);

struct PhotoPass<'a> {
    observation: &'a PhotoObservation<'a>,
    fit: &'a ColorFit,
    band: &'a mut Band,
    barycentrics: Barycentrics<'a>,
    of_pixels: Barycentrics<'a>,
    samples: u32,
    background: [f32; 3],
}

impl<'a> PhotoPass<'a> {
    fn new(observation: &'a PhotoObservation<'a>, fit: &'a ColorFit, band: &'a mut Band) -> Self {
        let samples = observation.visibility.size.x / observation.camera.size.x;
        let barycentrics = Barycentrics::new(observation.mesh, observation.camera, samples);
        Self {
            observation,
            fit,
            band,
            barycentrics,
            of_pixels: Barycentrics::new(observation.mesh, observation.camera, 1),
            samples,
            background: observation.background.map(linear_from_srgb),
        }
    }

    fn row(&mut self, y: u32) {
        for x in 0..self.observation.photo.size.x {
            let pixel = (y * self.observation.photo.size.x + x) as usize;
            let weight = match &self.observation.photo.alpha {
                Some(alpha) => f32::from(alpha[pixel]) * (1.0 / 255.0),
                None => 1.0,
            };
            if weight > 0.0 {
                self.pixel(x, y, self.observation.photo.rgb[pixel], weight);
            }
        }
    }

    fn pixel(&mut self, x: u32, y: u32, photo: [u8; 3], weight: f32) {
        let n = self.samples;
        let faces =
            |i: u32| self.observation.visibility.face[self.sample(x * n + i % n, y * n + i / n)];
        let first = faces(0);
        if (1..n * n).all(|i| faces(i) == first) {
            if first != NO_FACE {
                // The colour in the middle is the mean of colours that change linearly.
                let slot = self.slot(first);
                let middle = self.of_pixels.weights(&self.band.corners[slot as usize], x, y);
                self.spread(&[(slot, middle)], photo, weight);
            }
            return;
        }
        let mut seen: [PixelSample; MAX_SAMPLES] = [(NO_SLOT, [0.0; 3]); MAX_SAMPLES];
        for i in 0..n * n {
            let sx = x * n + i % n;
            let sy = y * n + i / n;
            let face = self.observation.visibility.face[self.sample(sx, sy)];
            if face != NO_FACE {
                let slot = self.slot(face);
                let weights = self.barycentrics.weights(&self.band.corners[slot as usize], sx, sy);
                seen[i as usize] = (slot, weights);
            }
        }
        self.spread(&seen[..(n * n) as usize], photo, weight);
    }

    fn sample(&self, x: u32, y: u32) -> usize {
        (y * self.observation.visibility.size.x + x) as usize
    }

    /// Adds to the sums of the faces seen at a pixel's samples.
    fn spread(&mut self, seen: &[PixelSample], photo: [u8; 3], weight: f32) {
        let mut colors = [[0.0f32; 3]; MAX_SAMPLES];
        let mut mean = [0.0f32; 3];
        for (color, (slot, weights)) in colors.iter_mut().zip(seen) {
            *color = match *slot {
                NO_SLOT => self.background,
                slot => self.fit.linear(self.band.sums[slot as usize].0, weights),
            };
            for c in 0..3 {
                mean[c] += color[c] / seen.len() as f32;
            }
        }
        let of_pixel = residual(photo, mean);
        for (error, residual) in self.band.error.iter_mut().zip(of_pixel) {
            *error += f64::from(residual * weight);
        }
        self.band.pixels += f64::from(weight);
        let share = weight / seen.len() as f32;
        for (color, (slot, weights)) in
            colors.iter().zip(seen).filter(|(_, (slot, _))| *slot != NO_SLOT)
        {
            let own = if seen.len() > 1 { residual(photo, *color) } else { of_pixel };
            let (residual, beyond) = coupled(of_pixel, own, self.observation);
            self.band.sums[*slot as usize].1.add(weights, &residual, &beyond, share);
        }
    }

    /// The place of a face's sums.
    fn slot(&mut self, face: u32) -> u32 {
        let slot = &mut self.band.slots[face as usize];
        if *slot == NO_SLOT {
            *slot = self.band.sums.len() as u32;
            self.band.sums.push((face, Equations::default()));
            self.band.corners.push(self.barycentrics.face(face));
        }
        *slot
    }
}

/// The difference of a photo's colour from a linear colour, sRGB-encoded; the colour is rounded to
/// 8 bits, as an engine does.
#[inline(always)]
fn residual(photo: [u8; 3], linear: [f32; 3]) -> [f32; 3] {
    let mut residual = [0.0; 3];
    for c in 0..3 {
        residual[c] =
            f32::from(i16::from(photo[c]) - i16::from(srgb8_from_linear(linear[c]))) / 255.0;
    }
    residual
}

/// The residual for a sample: a mix of those of its pixel and of its own colour, each bounded; and
/// what the bounds leave out.
#[inline(always)]
fn coupled(
    pixel: [f32; 3],
    own: [f32; 3],
    observation: &PhotoObservation<'_>,
) -> ([f32; 3], [f32; 3]) {
    let most = observation.max_residual;
    let coupling = observation.coupling;
    let bounded = |error: f32| error.clamp(-most, most);
    let mut residual = [0.0; 3];
    let mut beyond = [0.0; 3];
    for c in 0..3 {
        residual[c] = coupling * bounded(pixel[c]) + (1.0 - coupling) * bounded(own[c]);
        beyond[c] = coupling * pixel[c] + (1.0 - coupling) * own[c] - residual[c];
    }
    (residual, beyond)
}

// ---- The scene as each photo sees it, and photos added to a fit ---------------------------------

/// Number of photos at which the first pass is half coupled. Coupled neighbours share the residual
/// of their pixel. With many photos this is sharper. With few photos one triangle corrects the
/// error of another, which looks wrong from other places.
const HALF_COUPLED: f32 = 40.0;

/// Renders the scene from the camera of each photo.
pub(crate) struct PhotoObserver {
    solid: SolidRasterizer,
    drawing: SolidRasterOptions,
    /// See [`PhotoObservation::max_residual`].
    max_residual: f32,
    /// See [`PhotoObservation::coupling`].
    pub(super) coupling: f32,
}

impl PhotoObserver {
    /// For photos of `views`, coupled as the first pass is.
    pub(crate) fn new(mesh: &Mesh, views: &Views, max_residual: f32) -> Self {
        Self {
            solid: SolidRasterizer::new(),
            drawing: views.drawing(mesh, SAMPLES),
            max_residual,
            coupling: views.len() as f32 / (views.len() as f32 + HALF_COUPLED),
        }
    }

    /// Gives `on_photo` the photos `chosen`, by number and in their order.
    ///
    /// # Errors
    ///
    /// A photo that cannot be decoded.
    pub(crate) fn for_each_photo(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        mut progress: StageProgress<'_>,
        mut on_photo: impl FnMut(usize, &PhotoObservation<'_>),
    ) -> Result<()> {
        views.prefetch(chosen);
        for (done, &view) in chosen.iter().enumerate() {
            progress.set(done, chosen.len());
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = self.solid.visibility(mesh, camera, &self.drawing);
            let observation = PhotoObservation {
                mesh,
                camera,
                photo: &photo,
                visibility,
                background: self.drawing.background,
                coupling: self.coupling,
                max_residual: self.max_residual,
            };
            on_photo(view, &observation);
        }
        Ok(())
    }
}

/// Adds the pixels of photos to the normal equations of the colours.
pub(super) struct Accumulator {
    pub(super) observer: PhotoObserver,
    gatherer: Gatherer,
    pub(super) fit: ColorFit,
    /// Mean error of each photo when it was last added, sRGB-encoded.
    pub(super) errors: Vec<[f32; 3]>,
}

impl Accumulator {
    /// Nothing added yet. `flatness` is λ, px.
    pub(super) fn new(mesh: &Mesh, views: &Views, flatness: f32) -> Self {
        Self {
            observer: PhotoObserver::new(mesh, views, MAX_RESIDUAL),
            gatherer: Gatherer::new(mesh.face_count()),
            fit: ColorFit::new(mesh, flatness),
            errors: vec![[0.0; 3]; views.len()],
        }
    }

    /// Adds the photos `chosen` to the sums of the fit, in their order, with this sign: -1 takes
    /// them back.
    pub(super) fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        sign: f32,
        progress: StageProgress<'_>,
    ) -> Result<()> {
        let Self { observer, gatherer, fit, errors } = self;
        observer.for_each_photo(mesh, views, chosen, progress, |view, observation| {
            errors[view] = gatherer.gather(observation, fit, sign);
        })
    }
}
