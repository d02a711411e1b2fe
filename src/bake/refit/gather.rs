//! What one photo says about the colours of the triangles it sees.

use super::fit::{Fit, Sums};
use crate::camera::Camera;
use crate::image::Pixels;
use crate::math::color::linear_from_srgb;
use crate::math::srgb8::srgb8_from_linear;
use crate::mesh::Mesh;
use crate::raster::solid::{Barycentrics, FaceBarycentrics, NO_FACE, Visibility};
use rayon::prelude::*;

/// Bands of rows that are summed side by side. Fixed, so that sums do not depend on the number of threads.
const BANDS: usize = 8;
/// Most samples of a pixel.
const MOST_SAMPLES: usize = 16;
/// Errors above this, sRGB-encoded, pull no harder: reflections and passers-by (Huber).
const MOST_ERROR: f32 = 0.15;
/// "This face has no sums yet."
const NO_SLOT: u32 = u32::MAX;

/// A photo and what the rasteriser sees from its place.
pub(super) struct Shot<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) camera: &'a Camera,
    pub(super) photo: &'a Pixels,
    pub(super) visibility: &'a Visibility,
    /// sRGB-encoded.
    pub(super) background: [f32; 3],
    /// How much of a sample's pull is what its whole pixel lacks; the rest is what its own colour lacks.
    pub(super) coupling: f32,
}

/// Sums of one band, kept from photo to photo.
#[derive(Debug, Clone)]
struct Band {
    /// Where in `sums` and `corners` a face is. `[F]`
    slots: Vec<u32>,
    sums: Vec<(u32, Sums)>,
    corners: Vec<FaceBarycentrics>,
    error: [f64; 3],
    pixels: f64,
}

/// Memory of [`Gatherer::gather`].
#[derive(Debug, Clone)]
pub(super) struct Gatherer {
    bands: Vec<Band>,
}

impl Gatherer {
    /// For meshes of so many faces.
    pub(super) fn new(faces: usize) -> Self {
        let slots = vec![NO_SLOT; faces];
        let band = Band { slots, sums: Vec::new(), corners: Vec::new(), error: [0.0; 3], pixels: 0.0 };
        Self { bands: vec![band; BANDS] }
    }

    /// Adds a photo to the sums of `fit` so many times: -1 takes it back. Returns its mean error, sRGB-encoded.
    pub(super) fn gather(&mut self, shot: &Shot<'_>, fit: &mut Fit, times: f32) -> [f32; 3] {
        let rows = shot.photo.size.y;
        let row = |band: usize| (u64::from(rows) * band as u64 / BANDS as u64) as u32;
        let seen: &Fit = fit;
        self.bands.par_iter_mut().enumerate().for_each(|(i, band)| {
            band.sums.clear();
            band.corners.clear();
            (band.error, band.pixels) = ([0.0; 3], 0.0);
            let mut pass = Pass::new(shot, seen, band);
            (row(i)..row(i + 1)).for_each(|y| pass.row(y));
            for (face, _) in &band.sums {
                band.slots[*face as usize] = NO_SLOT;
            }
        });
        let (mut error, mut pixels) = ([0.0; 3], 0.0);
        for band in &self.bands {
            fit.add(&band.sums, times);
            (0..3).for_each(|c| error[c] += band.error[c]);
            pixels += band.pixels;
        }
        error.map(|e| (e / f64::max(pixels, 1.0)) as f32)
    }
}

/// A sample of the pixel at hand: the slot of its face and the weights of the face's corners.
type Sample = (u32, [f32; 3]);

struct Pass<'a> {
    shot: &'a Shot<'a>,
    fit: &'a Fit,
    band: &'a mut Band,
    barycentrics: Barycentrics<'a>,
    samples: u32,
    background: [f32; 3],
}

impl<'a> Pass<'a> {
    fn new(shot: &'a Shot<'a>, fit: &'a Fit, band: &'a mut Band) -> Self {
        let samples = shot.visibility.size.x / shot.camera.size.x;
        let barycentrics = Barycentrics::new(shot.mesh, shot.camera, samples);
        Self { shot, fit, band, barycentrics, samples, background: shot.background.map(linear_from_srgb) }
    }

    fn row(&mut self, y: u32) {
        for x in 0..self.shot.photo.size.x {
            let pixel = (y * self.shot.photo.size.x + x) as usize;
            let weight = match &self.shot.photo.alpha {
                Some(alpha) => f32::from(alpha[pixel]) * (1.0 / 255.0),
                None => 1.0,
            };
            if weight > 0.0 {
                self.pixel(x, y, self.shot.photo.rgb[pixel], weight);
            }
        }
    }

    fn pixel(&mut self, x: u32, y: u32, photo: [u8; 3], weight: f32) {
        let n = self.samples;
        let faces = |i: u32| self.shot.visibility.face[self.sample(x * n + i % n, y * n + i / n)];
        let first = faces(0);
        if (1..n * n).all(|i| faces(i) == first) {
            if first != NO_FACE {
                // What is seen is the colour in the middle: the mean of colours that change evenly.
                let slot = self.slot(first);
                let middle = self.barycentrics.weights_in_pixel(&self.band.corners[slot as usize], x, y);
                self.spread(&[(slot, middle)], photo, weight);
            }
            return;
        }
        let mut seen: [Sample; MOST_SAMPLES] = [(NO_SLOT, [0.0; 3]); MOST_SAMPLES];
        for i in 0..n * n {
            let (sx, sy) = (x * n + i % n, y * n + i / n);
            let face = self.shot.visibility.face[self.sample(sx, sy)];
            if face != NO_FACE {
                let slot = self.slot(face);
                let weights = self.barycentrics.weights(&self.band.corners[slot as usize], sx, sy);
                seen[i as usize] = (slot, weights);
            }
        }
        self.spread(&seen[..(n * n) as usize], photo, weight);
    }

    fn sample(&self, x: u32, y: u32) -> usize {
        (y * self.shot.visibility.size.x + x) as usize
    }

    /// Adds to the sums of the faces seen at a pixel's samples.
    fn spread(&mut self, seen: &[Sample], photo: [u8; 3], weight: f32) {
        let mut colors = [[0.0f32; 3]; MOST_SAMPLES];
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
        let lack = lack(photo, mean);
        for (error, lack) in self.band.error.iter_mut().zip(lack) {
            *error += f64::from(lack * weight);
        }
        self.band.pixels += f64::from(weight);
        let share = weight / seen.len() as f32;
        for (color, (slot, weights)) in colors.iter().zip(seen).filter(|(_, (slot, _))| *slot != NO_SLOT) {
            let own = if seen.len() > 1 { self::lack(photo, *color) } else { lack };
            let pull = pull(lack, own, self.shot.coupling);
            self.band.sums[*slot as usize].1.add(weights, &pull, share);
        }
    }

    /// Where the sums of a face are.
    fn slot(&mut self, face: u32) -> u32 {
        let slot = &mut self.band.slots[face as usize];
        if *slot == NO_SLOT {
            *slot = self.band.sums.len() as u32;
            self.band.sums.push((face, Sums::default()));
            self.band.corners.push(self.barycentrics.face(face));
        }
        *slot
    }
}

/// What a linear colour lacks of a photo's, sRGB-encoded; drawn as an engine does, in 8 bits.
#[inline(always)]
fn lack(photo: [u8; 3], linear: [f32; 3]) -> [f32; 3] {
    let mut lack = [0.0; 3];
    for c in 0..3 {
        lack[c] = f32::from(i16::from(photo[c]) - i16::from(srgb8_from_linear(linear[c]))) / 255.0;
    }
    lack
}

/// What a sample is pulled by when its pixel and its own colour lack so much, each bounded.
#[inline(always)]
fn pull(pixel: [f32; 3], own: [f32; 3], coupling: f32) -> [f32; 3] {
    let bounded = |error: f32| error.clamp(-MOST_ERROR, MOST_ERROR);
    let mut pull = [0.0; 3];
    for c in 0..3 {
        pull[c] = coupling * bounded(pixel[c]) + (1.0 - coupling) * bounded(own[c]);
    }
    pull
}
