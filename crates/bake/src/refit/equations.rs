//! The normal equations, 3 x 3 per triangle, and the colours that solve them.

use super::options::RefitColors;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};
use trisplat_scene::math::geometry::symmetric_minors;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};

/// Larger residuals, sRGB-encoded, count linearly (Huber): reflections and passers-by.
pub(super) const MAX_RESIDUAL: f32 = 0.15;
/// Mean residual of a channel at 0, in [`MAX_RESIDUAL`], from which the colour is wrong and not
/// the photos: most of them are that far from it. A training may have clamped it there.
const MIN_WRONG_RESIDUAL: f32 = 0.75;
/// Weight of the present colours, in pixels (damping).
const DAMPING_PX: f32 = 0.25;
/// A smaller area is a rounding error of photos that were subtracted again, px.
const MIN_PX: f32 = 1e-3;
/// On fewer pixels a channel at 0 stays.
const MIN_REVIVED_PX: f32 = 1.0;
/// Faces per task of the thread pool.
const TASK_FACES: usize = 1 << 12;

/// The normal equations of one triangle, summed over samples of photos.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Equations {
    /// Σ b_i b_j over samples, px: 00 01 02 11 12 22.
    matrix: [f32; 6],
    /// Σ b_k times the residual of the sample. `[corner][channel]`
    right: [[f32; 3]; 3],
    /// Σ of the parts of residuals beyond [`MAX_RESIDUAL`], px.
    beyond: [f32; 3],
}

impl Equations {
    /// Adds a sample with the weight `share` of a pixel; `beyond` is the part of its residual that
    /// is left out.
    #[inline(always)]
    pub(crate) fn add(
        &mut self,
        weights: &[f32; 3],
        residual: &[f32; 3],
        beyond: &[f32; 3],
        share: f32,
    ) {
        let [a, b, c] = *weights;
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        for (sum, product) in self.matrix.iter_mut().zip(products) {
            *sum += share * product;
        }
        for (sums, weight) in self.right.iter_mut().zip(weights) {
            for (sum, residual) in sums.iter_mut().zip(residual) {
                *sum += share * weight * residual;
            }
        }
        for (sum, beyond) in self.beyond.iter_mut().zip(beyond) {
            *sum += share * beyond;
        }
    }

    fn plus(&mut self, other: &Self, sign: f32) {
        let add = |sums: &mut [f32], others: &[f32]| {
            for (sum, other) in sums.iter_mut().zip(others) {
                *sum += sign * other;
            }
        };
        add(&mut self.matrix, &other.matrix);
        add(self.right.as_flattened_mut(), other.right.as_flattened());
        add(&mut self.beyond, &other.beyond);
    }

    /// Σ b_i b_j over samples, px: 00 01 02 11 12 22.
    pub(crate) fn matrix(&self) -> [f32; 6] {
        self.matrix
    }

    /// Σ b_k times the residual of the sample. `[corner][channel]`
    pub(crate) fn right(&self) -> &[[f32; 3]; 3] {
        &self.right
    }

    /// Pixels on which the triangle is visible: the weights of the corners sum to 1.
    fn area(&self) -> f32 {
        let [a, b, c, d, e, f] = self.matrix;
        a + d + f + 2.0 * (b + c + e)
    }

    /// Better colours of the corners, sRGB-encoded. `[corner][channel]`
    fn colors(&self, which: RefitColors, corners: &[[f32; 3]; 3], flatness: f32) -> [[f32; 3]; 3] {
        let mut better = [[0.0; 3]; 3];
        for channel in 0..3 {
            let improved =
                self.improved(which, corners.map(|corner| corner[channel]), channel, flatness);
            for (corner, value) in better.iter_mut().zip(improved) {
                corner[channel] = value.clamp(0.0, 1.0);
            }
        }
        better
    }

    /// Better colours of the corners in one channel.
    fn improved(
        &self,
        which: RefitColors,
        corners: [f32; 3],
        channel: usize,
        flatness: f32,
    ) -> [f32; 3] {
        let area = self.area();
        let mean = (corners[0] + corners[1] + corners[2]) / 3.0;
        let sum = self.right[0][channel] + self.right[1][channel] + self.right[2][channel];
        if corners == [0.0; 3] && sum > MIN_WRONG_RESIDUAL * MAX_RESIDUAL * area.max(MIN_PX) {
            return [(sum + self.beyond[channel]) / (area.max(0.0) + DAMPING_PX); 3];
        }
        if which != RefitColors::Corner {
            return [mean + sum / (area.max(0.0) + DAMPING_PX); 3];
        }
        if !(area > MIN_PX) {
            return corners;
        }
        let right = [0, 1, 2].map(|k| self.right[k][channel] + flatness * (mean - corners[k]));
        let step = self.solve(flatness, DAMPING_PX / 3.0, right);
        [0, 1, 2].map(|k| corners[k] + step[k])
    }

    /// Solves (matrix + λ (1 - J/3) + τ) x = right for the three corners, J all ones: λ pulls
    /// corners together, and the damping τ > 0 pulls them to their present values. Positive
    /// definite.
    fn solve(&self, flatness: f32, damping: f32, right: [f32; 3]) -> [f32; 3] {
        let [a, b, c, d, e, f] = self.matrix.map(f64::from);
        let own = f64::from(flatness * 2.0 / 3.0 + damping);
        let other = f64::from(flatness / 3.0);
        let a = a + own;
        let d = d + own;
        let f = f + own;
        let b = b - other;
        let c = c - other;
        let e = e - other;
        let ([m00, m01, m02, m11, m12, m22], per) = symmetric_minors([a, b, c, d, e, f]);
        let r = right.map(f64::from);
        [
            ((m00 * r[0] + m01 * r[1] + m02 * r[2]) * per) as f32,
            ((m01 * r[0] + m11 * r[1] + m12 * r[2]) * per) as f32,
            ((m02 * r[0] + m12 * r[1] + m22 * r[2]) * per) as f32,
        ]
    }
}

/// All systems and the colours they start from.
#[derive(Debug, Clone)]
pub(crate) struct ColorFit {
    sums: Vec<Equations>,
    /// λ, px.
    flatness: f32,
    /// Colours that photos are compared with, sRGB-encoded. `[F][corner][channel]`
    encoded: Vec<[[f32; 3]; 3]>,
    /// The same in linear light.
    linear: Vec<[[f32; 3]; 3]>,
}

impl ColorFit {
    /// Empty sums. `flatness` is λ, px.
    pub(crate) fn new(mesh: &Mesh, flatness: f32) -> Self {
        let encode = |f: usize| mesh.corner_colors(f).map(|corner| corner.map(srgb_from_linear));
        let encoded: Vec<[[f32; 3]; 3]> = parallel::collect(mesh.face_count(), GRAIN, encode);
        Self {
            sums: vec![Equations::default(); encoded.len()],
            flatness,
            encoded,
            linear: (0..mesh.face_count()).map(|f| mesh.corner_colors(f)).collect(),
        }
    }

    /// Linear colour of a face at these barycentric weights.
    #[inline(always)]
    pub(super) fn linear(&self, face: u32, weights: &[f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.linear[face as usize];
        let mut mixed = [0.0; 3];
        for i in 0..3 {
            mixed[i] = weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i];
        }
        mixed
    }

    /// Adds the sums of some faces, each listed once, with this sign: -1 takes them back.
    pub(super) fn add(&mut self, sums: &[(u32, Equations)], sign: f32) {
        for (face, sums) in sums {
            self.sums[*face as usize].plus(sums, sign);
        }
    }

    /// Number of triangles that photos see.
    pub(super) fn visible_triangles(&self) -> usize {
        self.sums.iter().filter(|s| s.area() > MIN_PX).count()
    }

    /// Starts again from better colours, with empty sums.
    pub(super) fn improve(&mut self, which: RefitColors) {
        let flatness = self.flatness;
        let parts = self.encoded.chunks_mut(TASK_FACES).zip(self.linear.chunks_mut(TASK_FACES));
        parallel::for_each(
            parts.zip(self.sums.chunks_mut(TASK_FACES)),
            |_, ((encoded, linear), sums)| {
                for ((encoded, linear), sums) in encoded.iter_mut().zip(linear).zip(sums) {
                    *encoded = sums.colors(which, encoded, flatness);
                    *linear = encoded.map(|corner| corner.map(linear_from_srgb));
                    *sums = Equations::default();
                }
            },
        );
    }

    /// The equations of the faces from `first` on. `[face]`
    pub(super) fn sums(&self, first: usize) -> &[Equations] {
        &self.sums[first..]
    }

    /// The colours that photos are compared with, of the same faces. `[face][corner][channel]`
    pub(super) fn encoded(&self, first: usize) -> &[[[f32; 3]; 3]] {
        &self.encoded[first..]
    }

    /// Gives the channels of `mesh` that are 0 on a whole face before `scene_faces` what photos
    /// show there, where this is farther than the residuals of good colours. A soft training may
    /// have clamped them, and then held them at 0. Returns the number of such faces.
    pub(super) fn revive(&self, mesh: &mut Mesh, scene_faces: usize) -> u64 {
        let mut revived = 0;
        for (face, sums) in self.sums[..scene_faces].iter().enumerate() {
            if sums.area() < MIN_REVIVED_PX {
                continue;
            }
            let corners = &self.encoded[face];
            let photo_color = sums.colors(RefitColors::Flat, corners, self.flatness)[0];
            let is_back = |c: usize| {
                photo_color[c] > MAX_RESIDUAL && corners.iter().all(|corner| corner[c] == 0.0)
            };
            let back = [0, 1, 2].map(is_back);
            let colors = match &mut mesh.colors {
                Colors::Face(colors) => &mut colors[face..=face],
                Colors::Vertex(colors) => &mut colors[3 * face..3 * face + 3],
            };
            for color in colors {
                for channel in (0..3).filter(|channel| back[*channel]) {
                    color[channel] = linear_from_srgb(photo_color[channel]);
                }
            }
            revived += u64::from(back.contains(&true));
        }
        revived
    }

    /// Better colours for the mesh of [`ColorFit::new`].
    pub(super) fn colors(&self, which: RefitColors) -> Colors {
        let solved = |face: usize| {
            let colors = self.sums[face].colors(which, &self.encoded[face], self.flatness);
            colors.map(|corner| corner.map(linear_from_srgb))
        };
        let count = self.sums.len();
        match which {
            RefitColors::Corner => {
                Colors::Vertex(parallel::collect(count, TASK_FACES, solved).into_flattened())
            }
            _ => Colors::Face(parallel::collect(count, TASK_FACES, |face| solved(face)[0])),
        }
    }
}
