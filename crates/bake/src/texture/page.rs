//! The picture that texels become: what no triangle shows is filled, so that samples and mip levels beside triangles have their colours.

use glam::UVec2;
use trisplat_scene::image::RgbImage;
use trisplat_scene::parallel;

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
        let code = |texel: usize| {
            (if self.owned[texel] { self.values[texel] } else { mean }).map(|c: f32| (c + 0.5) as u8)
        };
        let rgb = parallel::collect(self.values.len(), 1 << 14, code);
        RgbImage { size: self.size, rgb, alpha: None }
    }

    /// Gives texels beside those that have a colour the mean of theirs.
    fn dilate(&mut self) {
        let (width, height) = (self.size.x as usize, self.size.y as usize);
        let grown = |at: usize| {
            if self.owned[at] {
                return None;
            }
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
        let grown: Vec<(usize, [f32; 3])> = parallel::filter_map(self.owned.len(), 1 << 14, grown);
        for (at, value) in grown {
            (self.owned[at], self.values[at]) = (true, value);
        }
    }
}
