//! Texels from the differences of photos from the mesh.
//!
//! ```text
//! t = t0 + Σ_pixels b (photo - drawn) / (Σ_pixels b + λ),   drawn = Σ_k b_k t0_k
//! ```
//!
//! with t the sRGB-encoded texels, t0 the colours that they had, and b the bilinear weights of the
//! four texels around the point that a pixel sees. The more pixels see a texel, the less it stays
//! what it was. The fewer photos there are, the more often all of them see it from the same side,
//! and a residual is an error of the shape: λ is larger for them.
//!
//! Not kept, as held-out photos of four scenes showed no difference: more passes, less weight for
//! pixels that are larger than texels, exposure solved first, less trust where pixels disagree.
//!
//! Sums are whole numbers: their order, and with it the number of threads, does not matter.

use super::atlas::Layout;
use super::best_photos::{BestPhotos, PhotoCandidates};
use crate::views::Views;
use glam::{UVec2, Vec2};
use std::sync::atomic::{AtomicI32, Ordering};
use trisplat_raster::solid::{Barycentrics, NO_FACE, SolidRasterizer, Visibility};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::StageProgress;
use trisplat_scene::{Result, parallel};

/// One in the sums.
const UNIT: f32 = 4096.0;

/// The texels and the sums of the photos.
pub(super) struct Texels {
    size: UVec2,
    /// True for texels that triangles show. `[H * W]`
    owned: Vec<bool>,
    /// Before photos were added: sRGB-encoded, 0 to 255. `[H * W]`
    values: Vec<[f32; 3]>,
    /// Residuals of three channels, sRGB-encoded, and weights, in 4096ths. `[H * W]`
    sums: Vec<[AtomicI32; 4]>,
}

/// Pixels to add.
pub(super) enum PixelSelection<'a> {
    /// All; photos become candidates for the faces that they show best.
    All(&'a mut PhotoCandidates),
    /// Of every face those of its best photo.
    Best(&'a BestPhotos),
}

impl Texels {
    /// The colours of the mesh.
    pub(super) fn new(mesh: &Mesh, layout: &impl Layout) -> Self {
        let size = layout.size();
        let count = size.element_product() as usize;
        let mut texels = Self {
            size,
            owned: vec![false; count],
            values: vec![[0.0; 3]; count],
            sums: Vec::new(),
        };
        texels.sums.resize_with(count, Default::default);
        for face in 0..layout.face_count() {
            let corners =
                mesh.corner_colors(face).map(|corner| corner.map(|c| 255.0 * srgb_from_linear(c)));
            layout.for_each_texel(face, &mut |at, weights| {
                let at = (at.y * size.x + at.x) as usize;
                texels.owned[at] = true;
                texels.values[at] =
                    [0, 1, 2].map(|c| (0..3).map(|k| weights[k] * corners[k][c]).sum::<f32>());
            });
        }
        texels
    }

    /// Number of texels that triangles show.
    pub(super) fn shown_texels(&self) -> u64 {
        self.owned.iter().filter(|owned| **owned).count() as u64
    }

    /// Adds the photos `chosen` to the sums.
    ///
    /// # Errors
    ///
    /// A photo that cannot be decoded.
    pub(super) fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        layout: &impl Layout,
        chosen: &[usize],
        mut adding: PixelSelection<'_>,
        mut progress: StageProgress<'_>,
    ) -> Result<()> {
        let drawing = views.drawing(mesh, 1);
        views.prefetch(chosen);
        let mut solid = SolidRasterizer::new();
        for (done, &view) in chosen.iter().enumerate() {
            progress.set(done, chosen.len());
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = solid.visibility(mesh, camera, &drawing);
            let best = match &mut adding {
                PixelSelection::All(candidates) => {
                    candidates.add(view, &photo, visibility);
                    None
                }
                PixelSelection::Best(best) => Some((*best, view as u32)),
            };
            let observation = TexelObservation {
                texels: self,
                layout,
                mesh,
                camera,
                photo: &photo,
                visibility,
                best,
            };
            parallel::for_each(0..photo.size.y, |_, y| observation.add_row(y));
        }
        Ok(())
    }

    /// Change of a texel by the sums, pulled to its old value by `flatness` pixels.
    #[inline(always)]
    fn step(&self, texel: usize, flatness: f32) -> [f32; 3] {
        let [r, g, b, weight] =
            [0, 1, 2, 3].map(|k| self.sums[texel][k].load(Ordering::Relaxed) as f32 / UNIT);
        [r, g, b].map(|sum| if weight > 0.0 { 255.0 * sum / (weight + flatness) } else { 0.0 })
    }

    /// The texels that explain the photos added.
    fn solved(&self, flatness: f32) -> Vec<[f32; 3]> {
        let solved = |texel: usize| {
            let first = self.values[texel];
            let step = self.step(texel, flatness);
            [0, 1, 2].map(|c| (first[c] + step[c]).clamp(0.0, 255.0))
        };
        parallel::collect(self.values.len(), 1 << 14, solved)
    }

    /// The picture of the texture that explains the photos added; `flatness` is λ, px.
    pub(super) fn picture(&self, flatness: f32) -> RgbImage {
        Page { size: self.size, owned: self.owned.clone(), values: self.solved(flatness) }.picture()
    }

    /// Sets the texels to the values that fit the photos added, and forgets the photos.
    pub(super) fn settle(&mut self, flatness: f32) {
        self.values = self.solved(flatness);
        self.forget();
    }

    fn forget(&mut self) {
        parallel::for_each_mut(&mut self.sums, 1 << 14, |_, sums| *sums = Default::default());
    }

    /// Adds the detail of each face's best photo to what texels are: what its pixels, which were
    /// added, show more than them, without what is the same all over. So photos of other exposure,
    /// or of other colour from their side, meet without seams.
    pub(super) fn sharpen(&mut self, layout: &impl Layout, best: &BestPhotos, flatness: f32) {
        let slot_of = best.slots();
        let width = self.size.x as usize;
        let number = |at: UVec2| at.y as usize * width + at.x as usize;
        let of_face = |face: usize| {
            let mut sums = [[0.0f32; 4]; 3];
            layout.for_each_texel(face, &mut |at, weights| {
                let step = self.step(number(at), flatness);
                for (sums, weight) in sums.iter_mut().zip(weights) {
                    for channel in 0..3 {
                        sums[channel] += weight * step[channel];
                    }
                    sums[3] += weight;
                }
            });
            sums
        };
        let of_faces: Vec<[[f32; 4]; 3]> = parallel::collect(layout.face_count(), 1, of_face);
        let mut slots =
            vec![[0.0f32; 4]; slot_of.iter().max().map_or(0, |last| *last as usize + 1)];
        for (slot, sums) in slot_of.iter().zip(of_faces.as_flattened()) {
            for (total, sum) in slots[*slot as usize].iter_mut().zip(sums) {
                *total += sum;
            }
        }
        drop(of_faces);
        for face in 0..layout.face_count() {
            let same = [0, 1, 2].map(|k| {
                let sums = slots[slot_of[3 * face + k] as usize];
                [0, 1, 2].map(|c| sums[c] / sums[3].max(1e-6))
            });
            layout.for_each_texel(face, &mut |at, weights| {
                let at = number(at);
                let step = self.step(at, flatness);
                for c in 0..3 {
                    let same: f32 = (0..3).map(|k| weights[k] * same[k][c]).sum();
                    self.values[at][c] = (self.values[at][c] + step[c] - same).clamp(0.0, 255.0);
                }
            });
        }
        self.forget();
    }
}

/// A photo and its visible faces.
struct TexelObservation<'a, L> {
    texels: &'a Texels,
    layout: &'a L,
    mesh: &'a Mesh,
    camera: &'a Camera,
    photo: &'a RgbImage,
    visibility: &'a Visibility,
    /// Only pixels of faces whose best view is this one.
    best: Option<(&'a BestPhotos, u32)>,
}

impl<L: Layout> TexelObservation<'_, L> {
    /// Adds a row of pixels to the sums.
    fn add_row(&self, y: u32) {
        let barycentrics = Barycentrics::new(self.mesh, self.camera, 1);
        let mut last = None;
        for x in 0..self.photo.size.x {
            let at = (y * self.photo.size.x + x) as usize;
            let face = self.visibility.face[at];
            let counts =
                self.photo.alpha.as_ref().map_or(1.0, |alpha| f32::from(alpha[at]) / 255.0);
            if face == NO_FACE
                || counts == 0.0
                || self.best.is_some_and(|(best, view)| best.view(face) != view)
            {
                continue;
            }
            let of_face = match last {
                Some((seen, of_face)) if seen == face => of_face,
                _ => barycentrics.face(face),
            };
            last = Some((face, of_face));
            let place = self.layout.place(face as usize, &barycentrics.weights(&of_face, x, y));
            self.add(face as usize, place, self.photo.rgb[at], counts);
        }
    }

    /// Adds the difference of a photo from the texels around a place.
    fn add(&self, face: usize, place: Vec2, photo: [u8; 3], counts: f32) {
        let four = self.layout.around(face, place);
        let residual = [0, 1, 2].map(|c| {
            let drawn: f32 =
                four.iter().map(|(texel, share)| share * self.texels.values[*texel][c]).sum();
            (f32::from(photo[c]) - drawn) / 255.0
        });
        for (texel, share) in four {
            let weight = share * counts;
            let sums = &self.texels.sums[texel];
            let add = |sum: &AtomicI32, x: f32| {
                sum.fetch_add((x * UNIT).round_ties_even() as i32, Ordering::Relaxed);
            };
            for (residual, sum) in residual.iter().zip(sums) {
                add(sum, residual * weight);
            }
            add(&sums[3], weight);
        }
    }
}

// ---- The picture of the texels, filled where no triangle shows it -------------------------------

/// Texels around those of triangles that get their colour.
const DILATION: usize = 4;

/// The texels of a picture.
pub(super) struct Page {
    pub(super) size: UVec2,
    /// True for texels that have a colour. `[H * W]`
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
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += f64::from(*value);
            }
        }
        let mean = sum.map(|s| (s / shown.max(1) as f64) as f32);
        for _ in 0..DILATION {
            self.dilate();
        }
        let code = |texel: usize| {
            (if self.owned[texel] { self.values[texel] } else { mean })
                .map(|c: f32| (c + 0.5) as u8)
        };
        let rgb = parallel::collect(self.values.len(), 1 << 14, code);
        RgbImage { size: self.size, rgb, alpha: None }
    }

    /// Gives texels beside those that have a colour the mean of theirs.
    fn dilate(&mut self) {
        let width = self.size.x as usize;
        let height = self.size.y as usize;
        let grown = |at: usize| {
            if self.owned[at] {
                return None;
            }
            let x = at % width;
            let y = at / width;
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            let mut sum = [0.0f32; 4];
            for at in beside.into_iter().flatten().filter(|at| self.owned[*at]) {
                for (sum, value) in sum.iter_mut().zip(&self.values[at]) {
                    *sum += value;
                }
                sum[3] += 1.0;
            }
            (sum[3] > 0.0).then(|| (at, [0, 1, 2].map(|c| sum[c] / sum[3])))
        };
        let grown: Vec<(usize, [f32; 3])> = parallel::filter_map(self.owned.len(), 1 << 14, grown);
        for (at, value) in grown {
            self.owned[at] = true;
            self.values[at] = value;
        }
    }
}
