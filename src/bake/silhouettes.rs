//! What masks say about an object's outline: a triangle that photos frame beside the object is not part of it.

use crate::camera::Camera;
use crate::image::Pixels;
use crate::mesh::Mesh;
use glam::UVec2;
use rayon::prelude::*;

/// Masks show an object when they leave less than this share of all pixels.
const MOST_COUNTED: f64 = 0.8;
/// A pixel belongs to the object from this weight on.
const INSIDE: u8 = 128;
/// Masks are widened by this, px: outlines and poses are not exact, and thin parts must stay.
const WIDENED: usize = 2;
/// A triangle stays when at most this share of the photos that frame it show it outside. Masks of some photos are wrong.
const MOST_OUTSIDE: f64 = 0.2;

/// How often photos frame each face, and how often beside the object.
pub(super) struct Silhouettes {
    /// Photos that frame the centre of a face, and those that show it outside. `[F]`
    seen_of: Vec<(u32, u32)>,
    counted: f64,
    pixels: u64,
}

impl Silhouettes {
    /// Of a mesh of `faces`, before any photo.
    pub(super) fn new(faces: usize) -> Self {
        Self { seen_of: vec![(0, 0); faces], counted: 0.0, pixels: 0 }
    }

    /// Counts one photo of `mesh`, whether triangles are hidden in it or not.
    pub(super) fn add(&mut self, mesh: &Mesh, camera: &Camera, photo: &Pixels) {
        self.pixels += photo.rgb.len() as u64;
        let Some(alpha) = &photo.alpha else {
            self.counted += photo.rgb.len() as f64;
            return;
        };
        self.counted += alpha.iter().map(|a| f64::from(*a)).sum::<f64>() / 255.0;
        let object = widened(alpha, photo.size);
        let camera = camera.resized(photo.size);
        self.seen_of.par_iter_mut().enumerate().for_each(|(face, (framed, outside))| {
            let center = mesh.centroid(face);
            if camera.frames(center) {
                let seen = camera.rotation * center + camera.translation;
                let at = camera.focal * seen.truncate() / seen.z + camera.center;
                let [x, y] = at.as_uvec2().min(photo.size - 1).to_array();
                *framed += 1;
                *outside += u32::from(!object[(y * photo.size.x + x) as usize]);
            }
        });
    }

    /// Whether masks leave an object.
    pub(super) fn show_an_object(&self) -> bool {
        self.counted < MOST_COUNTED * self.pixels as f64
    }

    /// Whether a face may be part of the object. Photos may crop the object, so what none frames may be.
    pub(super) fn contain(&self, face: usize) -> bool {
        let (framed, outside) = self.seen_of[face];
        f64::from(outside) <= MOST_OUTSIDE * f64::from(framed)
    }
}

/// True within [`WIDENED`] pixels of the object, along rows and columns. `[H * W]`
fn widened(alpha: &[u8], size: UVec2) -> Vec<bool> {
    let (width, height) = (size.x as usize, size.y as usize);
    let reach = |at: usize, len: usize| at.saturating_sub(WIDENED)..(at + WIDENED + 1).min(len);
    let mut rows = vec![false; alpha.len()];
    rows.par_chunks_mut(width).zip(alpha.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = row[reach(x, width)].iter().any(|a| *a >= INSIDE);
        }
    });
    let mut all = vec![false; alpha.len()];
    all.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = reach(y, height).any(|y| rows[y * width + x]);
        }
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_widened_by_two_pixels_and_not_around_the_edge_of_the_picture() {
        let size = UVec2::new(7, 4);
        let mut alpha = vec![0; 28];
        alpha[0] = 255;
        alpha[6] = 127;
        let inside = widened(&alpha, size);
        let expected: Vec<bool> = (0..28).map(|pixel| pixel % 7 <= 2 && pixel / 7 <= 2).collect();
        assert_eq!(inside, expected);
    }
}
