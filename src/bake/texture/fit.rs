//! Texels from what photos show more than the mesh.
//!
//! ```text
//! t = t0 + Σ_pixels b (photo - drawn) / (Σ_pixels b + λ),   drawn = Σ_k b_k t0_k
//! ```
//!
//! with t the sRGB-encoded texels, t0 the colours that the mesh has there, and b the bilinear weights of the four texels around the point
//! that a pixel sees. The more pixels see a texel, the less it stays what it was. The fewer photos there are, the more often all of them
//! see it from the same side, and a residual is an error of the shape: λ is larger for them.
//!
//! Not kept, as held-out photos of four scenes showed no difference (docs/benchmarks/texture.md): more passes, less weight for pixels
//! that are larger than texels, exposure solved first, less trust where pixels disagree.
//!
//! Sums are whole numbers: their order, and with it the number of threads, does not matter.

use super::atlas::{Atlas, Patch};
use crate::bake::views::Views;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::Pixels;
use crate::math::color::srgb_from_linear;
use crate::mesh::Mesh;
use crate::raster::solid::{Barycentrics, NO_FACE, Solid, Visibility};
use crate::report::StageProgress;
use glam::{UVec2, Vec2};
use rayon::prelude::*;
use std::sync::atomic::{AtomicI32, Ordering};

/// One in the sums.
const UNIT: f32 = 4096.0;
/// Number of photos for which λ is what the options say; half as many double it.
const USUAL_PHOTOS: f32 = 40.0;
/// Texels around those of triangles that get their colour.
const DILATION: usize = 4;

/// The texels and what photos say of them.
pub(super) struct Texels {
    size: UVec2,
    /// Those that triangles show. `[H * W]`
    owned: Vec<bool>,
    /// The colours of the mesh, sRGB-encoded, 0 to 255. `[H * W]`
    values: Vec<[f32; 3]>,
    /// Residuals of three channels, sRGB-encoded, and weights, in 4096ths. `[H * W]`
    sums: Vec<[AtomicI32; 4]>,
}

impl Texels {
    /// The colours of the mesh.
    pub(super) fn new(mesh: &Mesh, atlas: &Atlas) -> Self {
        let count = atlas.size.element_product() as usize;
        let mut texels = Self {
            size: atlas.size,
            owned: vec![false; count],
            values: vec![[0.0; 3]; count],
            sums: Vec::new(),
        };
        texels.sums.resize_with(count, Default::default);
        for (face, patch) in atlas.patches.iter().enumerate() {
            let corners = mesh.corner_colors(face).map(|corner| corner.map(|c| 255.0 * srgb_from_linear(c)));
            for (at, weights) in patch.texels() {
                let at = (at.y * texels.size.x + at.x) as usize;
                texels.owned[at] = true;
                texels.values[at] =
                    [0, 1, 2].map(|c| (0..3).map(|k| weights[k] * corners[k][c]).sum::<f32>());
            }
        }
        texels
    }

    /// Number of texels that triangles show.
    pub(super) fn shown(&self) -> u64 {
        self.owned.iter().filter(|owned| **owned).count() as u64
    }

    /// Adds what the photos `chosen` show to the sums.
    ///
    /// Errors: a photo that cannot be decoded.
    pub(super) fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        atlas: &Atlas,
        chosen: &[usize],
        mut progress: StageProgress<'_>,
    ) -> Result<()> {
        let drawing = views.drawing(mesh, 1);
        views.prefetch(chosen);
        let mut solid = Solid::new();
        for (done, &view) in chosen.iter().enumerate() {
            progress.set(done, chosen.len());
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = solid.visibility(mesh, camera, &drawing);
            let observation = Observation { texels: self, atlas, mesh, camera, photo: &photo, visibility };
            (0..photo.size.y).into_par_iter().for_each(|y| observation.add_row(y));
        }
        Ok(())
    }

    /// The picture of the texture that explains `photos` photos, which were added. `flatness` is λ for the usual number of them, px.
    pub(super) fn picture(&self, flatness: f32, photos: usize) -> Pixels {
        let flatness = flatness * USUAL_PHOTOS / photos.max(1) as f32;
        let texels = self.values.par_iter().zip(&self.sums).with_min_len(1 << 14);
        let solved = |(first, sums): (&[f32; 3], &[AtomicI32; 4])| {
            let [r, g, b, weight] = [0, 1, 2, 3].map(|k| sums[k].load(Ordering::Relaxed) as f32 / UNIT);
            let step =
                [r, g, b].map(|sum| if weight > 0.0 { 255.0 * sum / (weight + flatness) } else { 0.0 });
            [0, 1, 2].map(|c| (first[c] + step[c]).clamp(0.0, 255.0))
        };
        let (values, owned) = (texels.map(solved).collect(), self.owned.clone());
        Page { size: self.size, owned, values }.picture()
    }
}

/// The texels of a picture.
struct Page {
    size: UVec2,
    /// Those that have a colour. `[H * W]`
    owned: Vec<bool>,
    /// sRGB-encoded, 0 to 255. `[H * W]`
    values: Vec<[f32; 3]>,
}

impl Page {
    /// Around triangles their colours go on; elsewhere the picture has their mean.
    fn picture(mut self) -> Pixels {
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
        Pixels { size: self.size, rgb: texels.map(code).collect(), alpha: None }
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

/// A photo and what it sees.
struct Observation<'a> {
    texels: &'a Texels,
    atlas: &'a Atlas,
    mesh: &'a Mesh,
    camera: &'a Camera,
    photo: &'a Pixels,
    visibility: &'a Visibility,
}

impl Observation<'_> {
    /// Adds a row of pixels to the sums.
    fn add_row(&self, y: u32) {
        let barycentrics = Barycentrics::new(self.mesh, self.camera, 1);
        let mut last = None;
        for x in 0..self.photo.size.x {
            let at = (y * self.photo.size.x + x) as usize;
            let face = self.visibility.face[at];
            let counts = self.photo.alpha.as_ref().map_or(1.0, |alpha| f32::from(alpha[at]) / 255.0);
            if face == NO_FACE || counts == 0.0 {
                continue;
            }
            let of_face = match last {
                Some((seen, of_face)) if seen == face => of_face,
                _ => barycentrics.face(face),
            };
            last = Some((face, of_face));
            let patch = &self.atlas.patches[face as usize];
            let place = patch.place(&barycentrics.weights(&of_face, x, y));
            self.add(patch, place, self.photo.rgb[at], counts);
        }
    }

    /// Adds what a photo shows at a place more than the texels around it do.
    fn add(&self, patch: &Patch, place: Vec2, photo: [u8; 3], counts: f32) {
        let four = around(patch, place, self.texels.size);
        let residual = [0, 1, 2].map(|c| {
            let drawn: f32 = four.iter().map(|(texel, share)| share * self.texels.values[*texel][c]).sum();
            (f32::from(photo[c]) - drawn) / 255.0
        });
        for (texel, share) in four {
            let weight = share * counts;
            let sums = &self.texels.sums[texel];
            let add = |sum: &AtomicI32, x: f32| {
                sum.fetch_add((x * UNIT).round_ties_even() as i32, Ordering::Relaxed);
            };
            residual.iter().zip(sums).for_each(|(r, sum)| add(sum, r * weight));
            add(&sums[3], weight);
        }
    }
}

/// Numbers and weights of the four texels around a place on a texture of `size`.
fn around(patch: &Patch, place: Vec2, size: UVec2) -> [(usize, f32); 4] {
    // Rounding may lead a little over the border.
    let place = place.clamp(Vec2::ZERO, (size - 1).as_vec2());
    let (corner, part) = (place.as_uvec2(), place.fract());
    // A line of texels, or one, is not interpolated across.
    let across = UVec2::new(u32::from(patch.size.x > 1), u32::from(patch.size.y > 1));
    let next = (corner + across).min(size - 1);
    let number = |x: u32, y: u32| (y * size.x + x) as usize;
    [
        (number(corner.x, corner.y), (1.0 - part.x) * (1.0 - part.y)),
        (number(next.x, corner.y), part.x * (1.0 - part.y)),
        (number(corner.x, next.y), (1.0 - part.x) * part.y),
        (number(next.x, next.y), part.x * part.y),
    ]
}
