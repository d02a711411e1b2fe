//! Gaussians as a teacher: their pictures, and the first triangles of the solid scene.

use super::filled::filled;
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::math::evenly_spaced::evenly_spaced;
use trisplat_scene::{Soup, Splats, camera::Camera, image::RgbImage};

/// A viewpoint sees a Gaussian that contributes this much to its picture, px.
const LEAST_SEEN_PX: f32 = 0.5;
/// One viewpoint in this many must see a Gaussian that becomes a triangle, ...
const SEEN_BY_ONE_IN: usize = 50;
/// ... and at least this many, unless there are fewer.
const LEAST_VIEWPOINTS: usize = 2;

/// A pixel covered to this share of 255 is covered.
const CLOSED: u8 = 240;

/// Least covered share of the pictures of surroundings.
const SURROUNDED: f32 = 0.9;
/// Small pictures that tell, and their longer side, px.
const LOOKS: usize = 12;
const LOOK_SIDE: u32 = 96;

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
    /// Pictures are opaque, because what is open is a gap and no background.
    is_surrounded: bool,
}

impl<'a> GaussianTeacher<'a> {
    /// Draws `splats` for `cameras` in the frame of their file, and others near them.
    pub fn new(splats: &'a Splats, cameras: &[Camera]) -> Self {
        let n = splats.len();
        let options = GaussianOptions::suited_to(splats, [0.0; 3]);
        let (weights, sums, seen) = (vec![0.0; n], vec![0.0; n], vec![0; n]);
        let is_surrounded = shows_surroundings(splats, &options, cameras);
        Self { splats, options, weights, sums, seen, pictures: 0, pixels: [0.0; 2], is_surrounded }
    }

    /// The picture of `camera`. Surroundings have their gaps closed. An object is over black, with the covered share of each pixel as alpha,
    /// so that it can be put over any background.
    pub fn picture(&mut self, camera: &Camera) -> RgbImage {
        self.weights.fill(0.0);
        let frame = gaussian::draw_and_weigh(self.splats, camera, &self.options, Some(&mut self.weights));
        self.pictures += 1;
        for ((sum, seen), weight) in self.sums.iter_mut().zip(&mut self.seen).zip(&self.weights) {
            *sum += weight;
            *seen += u32::from(*weight >= LEAST_SEEN_PX);
        }
        if self.is_surrounded {
            self.count(frame.transmittance.iter().map(|open| f64::from(*open)).sum(), frame.rgb.len());
            return filled(&frame);
        }
        let mut picture = frame.to_cut_pixels();
        // Between many faint layers a little of the background is always left; there is no gap.
        picture.alpha.iter_mut().flatten().filter(|a| **a >= CLOSED).for_each(|a| *a = u8::MAX);
        let open: f64 = picture.alpha.iter().flatten().map(|a| 1.0 - f64::from(*a) / 255.0).sum();
        self.count(open, picture.rgb.len());
        picture
    }

    fn count(&mut self, open: f64, all: usize) {
        self.pixels = [self.pixels[0] + all as f64 - open, self.pixels[1] + all as f64];
    }

    /// True when the cameras look at surroundings, not at an object.
    pub fn shows_surroundings(&self) -> bool {
        self.is_surrounded
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

/// True when `cameras` look at surroundings: the Gaussians cover nearly all of their pictures.
fn shows_surroundings(splats: &Splats, options: &GaussianOptions, cameras: &[Camera]) -> bool {
    let chosen = evenly_spaced(cameras.len(), LOOKS).map(|i| cameras[i].within(LOOK_SIDE));
    let frames = chosen.map(|camera| gaussian::draw(splats, &camera, options));
    let (open, all) = frames.fold((0.0, 0), |(open, all), frame| {
        (open + frame.transmittance.iter().sum::<f32>(), all + frame.rgb.len())
    });
    all > 0 && open < (1.0 - SURROUNDED) * all as f32
}
