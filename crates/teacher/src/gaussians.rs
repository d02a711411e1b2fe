//! Gaussians as a teacher: their pictures, and the first triangles of the solid scene.

use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::{Soup, Splats, camera::Camera, image::RgbImage};

/// A viewpoint sees a Gaussian that contributes this much to its picture, px.
const LEAST_SEEN_PX: f32 = 0.5;
/// One viewpoint in this many must see a Gaussian that becomes a triangle, ...
const SEEN_BY_ONE_IN: usize = 50;
/// ... and at least this many, unless there are fewer.
const LEAST_VIEWPOINTS: usize = 2;

/// A pixel covered to this share of 255 is covered.
const CLOSED: u8 = 240;

/// Draws Gaussians for many cameras, and sums what each of them contributes.
#[derive(Debug)]
pub struct GaussianTeacher<'a> {
    splats: &'a Splats,
    options: GaussianOptions,
    /// Of the present picture. `[N]`
    weights: Vec<f32>,
    /// Over all pictures. `[N]`
    sums: Vec<f32>,
    /// Viewpoints that see it. `[N]`
    seen: Vec<u32>,
    pictures: usize,
    /// Pixels that are covered, and all pixels.
    pixels: [f64; 2],
}

impl<'a> GaussianTeacher<'a> {
    /// Draws `splats` for cameras in the frame of their file.
    pub fn new(splats: &'a Splats) -> Self {
        let n = splats.len();
        let options = GaussianOptions::suited_to(splats, [0.0; 3]);
        let (weights, sums, seen) = (vec![0.0; n], vec![0.0; n], vec![0; n]);
        Self { splats, options, weights, sums, seen, pictures: 0, pixels: [0.0; 2] }
    }

    /// The picture of `camera` over black. Its alpha is the covered share of each pixel, so that it can be put over any background.
    pub fn picture(&mut self, camera: &Camera) -> RgbImage {
        self.weights.fill(0.0);
        let frame = gaussian::draw_and_weigh(self.splats, camera, &self.options, Some(&mut self.weights));
        self.pictures += 1;
        for ((sum, seen), weight) in self.sums.iter_mut().zip(&mut self.seen).zip(&self.weights) {
            *sum += weight;
            *seen += u32::from(*weight >= LEAST_SEEN_PX);
        }
        let mut picture = frame.to_cut_pixels();
        // Between many faint layers a little of the background is always left; there is no gap.
        picture.alpha.iter_mut().flatten().filter(|a| **a >= CLOSED).for_each(|a| *a = u8::MAX);
        let open: f64 = picture.alpha.iter().flatten().map(|a| 1.0 - f64::from(*a) / 255.0).sum();
        let all = picture.rgb.len() as f64;
        self.pixels = [self.pixels[0] + all - open, self.pixels[1] + all];
        picture
    }

    /// Share of the pictures so far that Gaussians cover.
    pub fn covered(&self) -> f64 {
        self.pixels[0] / self.pixels[1].max(1.0)
    }

    /// Triangles in place of the `most` Gaussians that contribute most to the pictures so far: opacity times visible area, over all
    /// viewpoints. Gaussians that very few viewpoints see float in front of one of them, and are left out.
    pub fn first_triangles(&self, most: usize) -> Soup {
        let least = (self.pictures / SEEN_BY_ONE_IN).max(LEAST_VIEWPOINTS.min(self.pictures));
        let mut chosen: Vec<usize> =
            (0..self.splats.len()).filter(|i| self.seen[*i] as usize >= least).collect();
        chosen.sort_by(|a, b| self.sums[*b].total_cmp(&self.sums[*a]).then(a.cmp(b)));
        chosen.truncate(most);
        chosen.sort_unstable();
        self.splats.to_soup(chosen)
    }
}
