//! The photometric loss of a frame, with any number of samples per pixel, encoded or in linear light.

use trisplat_raster::kernel::loss::{Photometric, Scratch, photometric_grad};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::encode;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::parallel;

/// How the frame was drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Supersampling {
    /// Samples per pixel and axis.
    pub(super) samples: u32,
    /// The frame is in linear light.
    pub(super) linear: bool,
}

/// Working memory.
#[derive(Debug, Default)]
pub(super) struct FrameLoss {
    scratch: Scratch<f32>,
    photo: FloatPhoto,
    /// The picture, sRGB-encoded. `[H * W]`
    picture: Vec<[f32; 3]>,
    /// ∂picture/∂mean of the samples; empty when it is 1.
    slope: Vec<[f32; 3]>,
    d_picture: Vec<[f32; 3]>,
}

impl FrameLoss {
    /// Returns the mean losses over the photo's pixels, and writes ∂loss/∂sample. A pixel of the picture is
    /// the mean of its samples in `frame`. `[H * samples * W * samples]`
    pub(super) fn photometric_grad(
        &mut self,
        photo: &RgbImage,
        dssim: f64,
        sampling: Supersampling,
        frame: &[[f32; 3]],
        d_rgb: &mut Vec<[f32; 3]>,
    ) -> Photometric {
        let width = photo.size.x as usize;
        let n = sampling.samples as usize;
        self.photo.read(photo);
        average(width, n, frame, &mut self.picture);
        self.slope.clear();
        if sampling.linear {
            self.slope.resize(self.picture.len(), [0.0; 3]);
            let rows = self.picture.chunks_mut(ROW).zip(self.slope.chunks_mut(ROW));
            parallel::for_each(rows, |_, (picture, slope)| {
                dispatch(Encode { values: picture.as_flattened_mut(), slope: slope.as_flattened_mut() });
            });
        }
        let Self { scratch, photo, picture, d_picture, slope } = self;
        d_picture.resize(photo.rgb.len(), [0.0; 3]);
        let (rgb, weight) = (&photo.rgb, photo.weight());
        let means = photometric_grad(width, picture, rgb, weight, dssim, scratch, d_picture);
        for (d, slope) in d_picture.as_flattened_mut().iter_mut().zip(slope.as_flattened()) {
            *d *= slope;
        }
        spread(width, n, d_picture, d_rgb);
        means
    }

    /// Squared error of each sample's pixel, divided by the number of samples per pixel, for the last frame
    /// and photo of [`Self::photometric_grad`]; `width` is in px.
    pub(super) fn errors(&self, width: u32, sampling: Supersampling, out: &mut Vec<f32>) {
        let (width, n, photo) = (width as usize, sampling.samples as usize, &self.photo);
        let weights = photo.weight();
        let scale = 1.0 / (n * n) as f32;
        out.resize(self.picture.len() * n * n, 0.0);
        parallel::for_each(out.chunks_mut(width.max(1) * n), |y, row| {
            let from = y / n * width;
            for (x, out) in row.iter_mut().enumerate() {
                let i = from + x / n;
                let weight = weights.map_or(1.0, |w| w[i]);
                let d: [f32; 3] = std::array::from_fn(|c| self.picture[i][c] - photo.rgb[i][c]);
                *out = weight * scale * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            }
        });
    }
}

/// A photo in numbers from 0 to 1.
#[derive(Debug, Default)]
struct FloatPhoto {
    /// sRGB-encoded. `[H * W]`
    rgb: Vec<[f32; 3]>,
    /// Weight of each pixel; empty when all are 1. `[H * W]`
    weight: Vec<f32>,
}

impl FloatPhoto {
    fn read(&mut self, pixels: &RgbImage) {
        self.rgb.clear();
        self.rgb.extend(pixels.rgb.iter().map(|p| p.map(|c| f32::from(c) * (1.0 / 255.0))));
        self.weight.clear();
        self.weight.extend(pixels.alpha.iter().flatten().map(|&a| f32::from(a) * (1.0 / 255.0)));
    }

    fn weight(&self) -> Option<&[f32]> {
        (!self.weight.is_empty()).then_some(&self.weight)
    }
}

/// Pixels that one job encodes.
const ROW: usize = 4096;

/// Encodes channels in place and writes the slopes.
struct Encode<'a> {
    values: &'a mut [f32],
    slope: &'a mut [f32],
}

impl Work for Encode<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (mut x, mut d) = ([0.0; LANES], [0.0; LANES]);
        for (values, slope) in self.values.chunks_mut(LANES).zip(self.slope.chunks_mut(LANES)) {
            x[..values.len()].copy_from_slice(values);
            let (encoded, by) = encode(L::load(&x));
            encoded.store(&mut x);
            by.store(&mut d);
            values.copy_from_slice(&x[..values.len()]);
            slope.copy_from_slice(&d[..slope.len()]);
        }
    }
}

/// The mean of every `n` x `n` samples; `width` is that of the picture, px.
fn average(width: usize, n: usize, samples: &[[f32; 3]], out: &mut Vec<[f32; 3]>) {
    if n == 1 {
        out.clear();
        out.extend_from_slice(samples);
        return;
    }
    let (scale, width) = (1.0 / (n * n) as f32, width.max(1));
    out.resize(samples.len() / (n * n), [0.0; 3]);
    let rows = out.chunks_mut(width).zip(samples.chunks(width * n * n));
    parallel::for_each(rows, |_, (row, rows)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = [0.0; 3];
            for line in rows.chunks(width * n) {
                for sample in &line[x * n..(x + 1) * n] {
                    (0..3).for_each(|c| pixel[c] += sample[c]);
                }
            }
            *pixel = pixel.map(|c| c * scale);
        }
    });
}

/// The gradient of [`average`].
fn spread(width: usize, n: usize, d: &[[f32; 3]], out: &mut Vec<[f32; 3]>) {
    let (scale, width) = (1.0 / (n * n) as f32, width.max(1));
    out.resize(d.len() * n * n, [0.0; 3]);
    parallel::for_each(out.chunks_mut(width * n), |y, row| {
        let from = &d[y / n * width..][..width];
        for (x, sample) in row.iter_mut().enumerate() {
            *sample = from[x / n].map(|c| c * scale);
        }
    });
}
