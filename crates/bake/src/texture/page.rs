//! The picture that texels become: what no triangle shows is filled, so that samples and mip levels beside triangles have their colours.

use glam::UVec2;
use rayon::prelude::*;
use trisplat_scene::image::RgbImage;

/// Texels around those of triangles that get their colour.
const DILATION: usize = 4;

/// The texels of a picture.
pub(super) struct Page {
    pub(super) size: UVec2,
    /// Those that have a colour. `[H * W]`
    pub(super) owned: Vec<bool>,
    /// sRGB-encoded, 0 to 255. `[H * W]`
    pub(super) values: Vec<[f32; 3]>,
}

impl Page {
    /// Around triangles their colours go on; elsewhere the picture has their mean.
    pub(super) fn picture(mut self) -> RgbImage {
        let shown = self.owned.iter().filter(|owned| **owned).count();
        let mut sum = [0.0f64; 3];
        for (value, _) in self.values.iter().zip(&self.owned).filter(|(_, owned)| **owned) {
            (0..3).for_each(|c| sum[c] += f64::from(value[c]));
        }
        let mean = sum.map(|s| (s / shown.max(1) as f64) as f32);
        (0..DILATION).for_each(|_| self.dilate());
        let texels = self.values.par_iter().zip(&self.owned).with_min_len(1 << 14);
        let code = |(value, owned): (&[f32; 3], &bool)| {
            (if *owned { value } else { &mean }).map(|c: f32| (c + 0.5) as u8)
        };
        RgbImage { size: self.size, rgb: texels.map(code).collect(), alpha: None }
    }

    /// Gives texels beside those that have a colour the mean of theirs.
    fn dilate(&mut self) {
        let (width, height) = (self.size.x as usize, self.size.y as usize);
        let grown = |at: usize| {
            let (x, y) = (at % width, at / width);
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            let mut sum = [0.0f32; 4];
            for at in beside.into_iter().flatten().filter(|at| self.owned[*at]) {
                (0..3).for_each(|c| sum[c] += self.values[at][c]);
                sum[3] += 1.0;
            }
            (sum[3] > 0.0).then(|| (at, [0, 1, 2].map(|c| sum[c] / sum[3])))
        };
        let free = (0..self.owned.len()).into_par_iter().with_min_len(1 << 14);
        let grown: Vec<(usize, [f32; 3])> = free.filter(|at| !self.owned[*at]).filter_map(grown).collect();
        for (at, value) in grown {
            (self.owned[at], self.values[at]) = (true, value);
        }
    }
}
