//! What one photo says about the colours of the triangles it sees.

use super::fit::{Fit, Sums};
use crate::camera::Camera;
use crate::image::Pixels;
use crate::math::color::{linear_from_srgb, srgb_from_linear};
use crate::mesh::Mesh;
use crate::raster::solid::{Corners, NO_FACE, Visibility, Weigher};
use rayon::prelude::*;

/// Bands of rows that are summed side by side. Fixed, so that sums do not depend on the number of threads.
const BANDS: usize = 8;
/// Most samples of a pixel.
const MOST_SAMPLES: usize = 16;
/// Errors above this, sRGB-encoded, pull no harder: reflections and passers-by (Huber).
const MOST_ERROR: f32 = 0.15;
/// "This face has no sums yet."
const NO_SLOT: u32 = u32::MAX;

/// What the colours are pulled to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// Each sample to its pixel of the photo.
    Photo,
    /// Each sample by what its pixel still lacks.
    Rest,
}

/// A photo and what the rasteriser sees from its place.
pub(super) struct Shot<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) camera: &'a Camera,
    pub(super) photo: &'a Pixels,
    pub(super) visibility: &'a Visibility,
    /// sRGB-encoded.
    pub(super) background: [f32; 3],
}

/// Sums of one band, kept from photo to photo.
#[derive(Debug, Clone)]
struct Band {
    /// Where in `sums` and `corners` a face is. `[F]`
    slots: Vec<u32>,
    sums: Vec<(u32, Sums)>,
    corners: Vec<Corners>,
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

    /// Adds a photo to the sums of `fit`. Returns its mean error, sRGB-encoded; zero for [`Goal::Photo`].
    pub(super) fn gather(&mut self, shot: &Shot<'_>, goal: Goal, fit: &mut Fit) -> [f32; 3] {
        let rows = shot.photo.size.y;
        let row = |band: usize| (u64::from(rows) * band as u64 / BANDS as u64) as u32;
        let seen: &Fit = fit;
        self.bands.par_iter_mut().enumerate().for_each(|(i, band)| {
            band.sums.clear();
            band.corners.clear();
            (band.error, band.pixels) = ([0.0; 3], 0.0);
            let mut pass = Pass::new(shot, goal, seen, band);
            (row(i)..row(i + 1)).for_each(|y| pass.row(y));
            for (face, _) in &band.sums {
                band.slots[*face as usize] = NO_SLOT;
            }
        });
        let (mut error, mut pixels) = ([0.0; 3], 0.0);
        for band in &self.bands {
            fit.add(&band.sums);
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
    goal: Goal,
    fit: &'a Fit,
    band: &'a mut Band,
    weigher: Weigher<'a>,
    samples: u32,
    background: [f32; 3],
}

impl<'a> Pass<'a> {
    fn new(shot: &'a Shot<'a>, goal: Goal, fit: &'a Fit, band: &'a mut Band) -> Self {
        let samples = shot.visibility.size.x / shot.camera.size.x;
        let weigher = Weigher::new(shot.mesh, shot.camera, samples);
        Self { shot, goal, fit, band, weigher, samples, background: shot.background.map(linear_from_srgb) }
    }

    fn row(&mut self, y: u32) {
        for x in 0..self.shot.photo.size.x {
            let pixel = (y * self.shot.photo.size.x + x) as usize;
            let weight = match &self.shot.photo.alpha {
                Some(alpha) => f32::from(alpha[pixel]) * (1.0 / 255.0),
                None => 1.0,
            };
            if weight > 0.0 {
                let [r, g, b] = self.shot.photo.rgb[pixel];
                let photo = [f32::from(r), f32::from(g), f32::from(b)];
                self.pixel(x, y, [photo[0] / 255.0, photo[1] / 255.0, photo[2] / 255.0], weight);
            }
        }
    }

    fn pixel(&mut self, x: u32, y: u32, photo: [f32; 3], weight: f32) {
        let n = self.samples;
        let mut seen: [Sample; MOST_SAMPLES] = [(NO_SLOT, [0.0; 3]); MOST_SAMPLES];
        let seen = &mut seen[..(n * n) as usize];
        let mut any = false;
        for (i, sample) in (0..).zip(seen.iter_mut()) {
            let (sx, sy) = (x * n + i % n, y * n + i / n);
            let face = self.shot.visibility.face[(sy * self.shot.visibility.size.x + sx) as usize];
            if face != NO_FACE {
                let slot = self.slot(face);
                *sample = (slot, self.weigher.weights(&self.band.corners[slot as usize], sx, sy));
                any = true;
            }
        }
        if !any {
            return;
        }
        let pull = match self.goal {
            Goal::Photo => photo,
            Goal::Rest => self.rest(seen, photo, weight),
        };
        let share = weight / (n * n) as f32;
        for (slot, weights) in seen.iter().filter(|(slot, _)| *slot != NO_SLOT) {
            self.band.sums[*slot as usize].1.add(weights, &pull, share);
        }
    }

    /// What a pixel lacks of the photo, bounded; drawn as an engine does, in linear light.
    fn rest(&mut self, seen: &[Sample], photo: [f32; 3], weight: f32) -> [f32; 3] {
        let mut linear = [0.0f32; 3];
        for (slot, weights) in seen {
            let color = match *slot {
                NO_SLOT => self.background,
                slot => self.fit.linear(self.band.sums[slot as usize].0, weights),
            };
            for c in 0..3 {
                linear[c] += color[c];
            }
        }
        let per = 1.0 / seen.len() as f32;
        let mut rest = [0.0; 3];
        for c in 0..3 {
            let error = photo[c] - srgb_from_linear(linear[c] * per);
            self.band.error[c] += f64::from(error * weight);
            rest[c] = error.clamp(-MOST_ERROR, MOST_ERROR);
        }
        self.band.pixels += f64::from(weight);
        rest
    }

    /// Where the sums of a face are.
    fn slot(&mut self, face: u32) -> u32 {
        let slot = &mut self.band.slots[face as usize];
        if *slot == NO_SLOT {
            *slot = self.band.sums.len() as u32;
            self.band.sums.push((face, Sums::default()));
            self.band.corners.push(self.weigher.corners(face));
        }
        *slot
    }
}
