//! Gaussians as a teacher: their pictures with gaps closed, and the first triangles of the solid
//! scene.

use glam::UVec2;
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_raster::soft::Frame;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::{Soup, Splats};

/// Minimum contribution of a Gaussian to a picture that shows it, px.
const MIN_CONTRIBUTION_PX: f32 = 0.5;
/// One viewpoint in this many must show a Gaussian that becomes a triangle.
const VIEWPOINTS_PER_SHOWING: usize = 50;
/// Minimum number of viewpoints that show it, unless there are fewer.
const MIN_VIEWPOINTS: usize = 2;

/// Minimum cover of a closed pixel, of 255.
const CLOSED: u8 = 240;

/// Minimum covered share of the pictures of surroundings.
const MIN_SURROUNDINGS_COVER: f32 = 0.9;
/// Number of small pictures that decide it.
const LOOKS: usize = 12;
/// Longer side of these pictures, px.
const LOOK_SIDE: u32 = 96;

/// Draws Gaussians for many cameras, and sums the contribution of each.
#[derive(Debug)]
pub struct GaussianTeacher<'a> {
    splats: &'a Splats,
    options: GaussianOptions,
    /// Contribution to the present picture. `[N]`
    weights: Vec<f32>,
    /// Contribution to all pictures. `[N]`
    sums: Vec<f32>,
    /// Number of viewpoints that show it. `[N]`
    showings: Vec<u32>,
    pictures: usize,
    /// Pixels that are covered, and all pixels.
    pixels: [f64; 2],
    /// Pictures are opaque: open pixels are gaps and no background.
    is_surrounded: bool,
}

impl<'a> GaussianTeacher<'a> {
    /// Draws `splats` for `cameras` in the frame of their file, and others near them.
    pub fn new(splats: &'a Splats, cameras: &[Camera]) -> Self {
        let n = splats.len();
        let options = GaussianOptions::suited_to(splats, [0.0; 3]);
        let weights = vec![0.0; n];
        let sums = vec![0.0; n];
        let showings = vec![0; n];
        let is_surrounded = shows_surroundings(splats, &options, cameras);
        Self {
            splats,
            options,
            weights,
            sums,
            showings,
            pictures: 0,
            pixels: [0.0; 2],
            is_surrounded,
        }
    }

    /// The picture of `camera`. Surroundings have their gaps closed. An object is over black, with
    /// the covered share of each pixel as alpha, so that it can be put over any background.
    pub fn picture(&mut self, camera: &Camera) -> RgbImage {
        self.weights.fill(0.0);
        let frame =
            gaussian::draw_and_weigh(self.splats, camera, &self.options, Some(&mut self.weights));
        self.pictures += 1;
        for ((sum, showings), weight) in
            self.sums.iter_mut().zip(&mut self.showings).zip(&self.weights)
        {
            *sum += weight;
            *showings += u32::from(*weight >= MIN_CONTRIBUTION_PX);
        }
        if self.is_surrounded {
            self.count(
                frame.transmittance.iter().map(|open| f64::from(*open)).sum(),
                frame.rgb.len(),
            );
            return filled(&frame);
        }
        let mut picture = frame.to_cut_pixels();
        // Between many faint layers a little of the background is always left; there is no gap.
        for alpha in picture.alpha.iter_mut().flatten().filter(|a| **a >= CLOSED) {
            *alpha = u8::MAX;
        }
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

    /// Triangles in place of the `count` Gaussians that contribute most to the pictures so far:
    /// opacity times visible area, over all viewpoints. Gaussians that very few viewpoints see
    /// float in front of one of them, and are left out.
    pub fn first_triangles(&self, count: usize) -> Soup {
        let min_showings =
            (self.pictures / VIEWPOINTS_PER_SHOWING).max(MIN_VIEWPOINTS.min(self.pictures));
        let mut chosen: Vec<usize> =
            (0..self.splats.len()).filter(|i| self.showings[*i] as usize >= min_showings).collect();
        chosen.sort_by(|a, b| self.sums[*b].total_cmp(&self.sums[*a]).then(a.cmp(b)));
        chosen.truncate(count);
        chosen.sort_unstable();
        self.splats.to_soup(chosen)
    }
}

/// True when `cameras` look at surroundings: the Gaussians cover nearly all of their pictures.
fn shows_surroundings(splats: &Splats, options: &GaussianOptions, cameras: &[Camera]) -> bool {
    let chosen = evenly_spaced(cameras.len(), LOOKS).map(|i| cameras[i].fit_within(LOOK_SIDE));
    let frames = chosen.map(|camera| gaussian::draw(splats, &camera, options));
    let (open, all) = frames.fold((0.0, 0), |(open, all), frame| {
        (open + frame.transmittance.iter().sum::<f32>(), all + frame.rgb.len())
    });
    all > 0 && open < (1.0 - MIN_SURROUNDINGS_COVER) * all as f32
}

/// The picture of `frame`, drawn over black, with its gaps closed: the colour behind a pixel is the
/// mean of the colours around it (pull-push, Gortler et al. 1996).
pub(super) fn filled(frame: &Frame) -> RgbImage {
    RgbImage::from_rgb(frame.size, &closed(frame.size, &frame.rgb, &frame.transmittance))
}

/// The same of colours over black, with the open share of each pixel.
fn closed(size: UVec2, rgb: &[[f32; 3]], open: &[f32]) -> Vec<[f32; 3]> {
    if size == UVec2::ONE {
        let cover = (1.0 - open[0]).max(f32::EPSILON);
        return vec![rgb[0].map(|c| c / cover)];
    }
    let coarse = (size / 2).max(UVec2::ONE);
    let cell = |i: usize| {
        let at = (UVec2::new(i as u32 % size.x, i as u32 / size.x) / 2).min(coarse - 1);
        (at.y * coarse.x + at.x) as usize
    };
    // Red, green, blue, open share and number of pixels.
    let mut sums = vec![[0.0; 5]; coarse.element_product() as usize];
    for (i, ([r, g, b], open)) in rgb.iter().zip(open).enumerate() {
        let sum = &mut sums[cell(i)];
        for (sum, value) in sum.iter_mut().zip([*r, *g, *b, *open, 1.0]) {
            *sum += value;
        }
    }
    let colors: Vec<[f32; 3]> = sums.iter().map(|[r, g, b, _, n]| [r / n, g / n, b / n]).collect();
    let gaps: Vec<f32> = sums.iter().map(|[.., open, n]| open / n).collect();
    let behind = closed(coarse, &colors, &gaps);
    let over = |(i, (rgb, open)): (usize, (&[f32; 3], &f32))| {
        let behind = behind[cell(i)];
        [0, 1, 2].map(|c| rgb[c] + open * behind[c])
    };
    rgb.iter().zip(open).enumerate().map(over).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_has_the_colour_of_the_pixels_around_it() {
        let size = UVec2::new(13, 7);
        let open: Vec<f32> =
            (0..91).map(|i| if (30..34).contains(&i) { 1.0 } else { 0.25 }).collect();
        let rgb: Vec<[f32; 3]> =
            open.iter().map(|open| [0.8, 0.4, 0.2].map(|c| c * (1.0 - open))).collect();
        let frame = Frame { size, rgb, transmittance: open, ..Frame::default() };
        let picture = filled(&frame);
        assert!(picture.alpha.is_none() && picture.rgb.iter().all(|rgb| *rgb == [204, 102, 51]));
        let nothing = Frame { rgb: vec![[0.0; 3]; 91], transmittance: vec![1.0; 91], ..frame };
        assert!(filled(&nothing).rgb.iter().all(|rgb| *rgb == [0; 3]));
    }
}
