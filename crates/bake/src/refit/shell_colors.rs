//! The colours of the backdrop, solved together: it is one closed surface, and few or no photos
//! show much of it.
//!
//! Colours fitted triangle by triangle jump from one to the next, and stay unchanged where no photo
//! looks. Here corners at one vertex pull each other, and so do those of one triangle. Photos
//! outweigh both pulls; without photos a colour lies between its neighbours:
//!
//! ```text
//! minimise Σ_pixels (photo - drawn(e))² + μ Σ_vertices Σ_k (e_k - ē_vertex)² + λ Σ_triangles Σ_k (e_k - ē_triangle)²
//! ```
//!
//! The matrix is symmetric and positive definite, so conjugate gradients solve it, one channel
//! after the other. Both weights were chosen on photos left out of captures (commit 5727e856).

use super::equations::{ColorFit, Equations};
use glam::Vec3;
use std::collections::HashMap;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};
use trisplat_scene::math::geometry::{place_bits, symmetric_minors};
use trisplat_scene::mesh::{Colors, Mesh};

/// μ: pull of the corners at a vertex towards their mean, px.
const SEAM_PX: f64 = 100.0;
/// λ: pull of the corners of a triangle towards their mean, px.
const FLATNESS_PX: f64 = 3.0;
/// Weight of a corner's present colour, in pixels: corners without any pull keep their colour.
const DAMPING_PX: f64 = 1e-3;
/// Weight of a triangle's own colour without photos, in pixels: enough to keep its mean, too little
/// to keep its edges.
const OWN_COLOR_PX: f64 = 300.0;
/// Maximum number of steps of conjugate gradients; the residual falls to a thousandth long before.
const STEPS: usize = 400;
const RESIDUAL: f64 = 1e-4;

/// Gives the backdrop of `mesh`, its faces from `scene_faces` on, the colours that are best for all
/// of them together; `fit` holds the sums of the photos.
pub(super) fn paint(mesh: &mut Mesh, scene_faces: usize, fit: &ColorFit) {
    if scene_faces < mesh.face_count() {
        let solved = solve(mesh, scene_faces, fit.sums(scene_faces), fit.encoded(scene_faces));
        let corners = solved.iter().flatten().map(|corner| corner.map(linear_from_srgb));
        for (color, solved) in mesh.vertex_colors()[3 * scene_faces..].iter_mut().zip(corners) {
            *color = solved;
        }
    }
}

/// Smooths a shell of one colour per triangle when there are no photos. A shell whose triangles
/// share no vertex stays as it is.
pub(crate) fn smooth_shell(shell: &mut Mesh) {
    let mut system = System::of(shell, 0);
    if system.counts.len() == system.vertices.len() {
        return;
    }
    let encoded = |face| shell.corner_colors(face).map(|corner| corner.map(srgb_from_linear));
    let encoded: Vec<_> = (0..shell.face_count()).map(encoded).collect();
    let smoothed = system.smoothed(&encoded);
    shell.colors = Colors::Vertex(system.joined(&smoothed));
}

/// Colours of the corners of some faces, sRGB-encoded. `[face][corner][channel]`
type CornerColors = Vec<[[f32; 3]; 3]>;

/// Better colours for the faces from `first` on, which have the colours `encoded`; `sums` are those
/// of the photos.
fn solve(mesh: &Mesh, first: usize, sums: &[Equations], encoded: &[[[f32; 3]; 3]]) -> CornerColors {
    let matrices = sums.iter().map(|sums| sums.matrix().map(f64::from)).collect();
    let system = System { matrices, ..System::of(mesh, first) };
    system.improved(encoded, |face, corner, channel| f64::from(sums[face].right()[corner][channel]))
}

/// The pulls on the colours of corners.
struct System {
    /// The matrix of the photos, 00 01 02 11 12 22. `[face]`
    matrices: Vec<[f64; 6]>,
    /// The vertex at each corner. `[3 face]`
    vertices: Vec<u32>,
    /// Corners at each vertex.
    counts: Vec<f64>,
}

impl System {
    /// Corners are at one vertex if their positions are bitwise equal.
    fn of(mesh: &Mesh, first: usize) -> Self {
        let mut known: HashMap<[u32; 3], u32> =
            HashMap::with_capacity(3 * (mesh.face_count() - first));
        let mut counts: Vec<f64> = Vec::new();
        let corners = (first..mesh.face_count()).flat_map(|face| mesh.corners(face));
        let vertices = corners.map(|position| {
            let vertex = *known.entry(place_bits(position)).or_insert_with(|| {
                counts.push(0.0);
                counts.len() as u32 - 1
            });
            counts[vertex as usize] += 1.0;
            vertex
        });
        let vertices = vertices.collect();
        Self { matrices: Vec::new(), vertices, counts }
    }

    /// The seamless colours of a backdrop without photos.
    fn smoothed(&mut self, encoded: &[[[f32; 3]; 3]]) -> CornerColors {
        // The mean over a triangle of the products of its barycentric weights.
        let [own, other] = [OWN_COLOR_PX / 6.0, OWN_COLOR_PX / 12.0];
        self.matrices = vec![[own, other, other, own, other, own]; encoded.len()];
        self.improved(encoded, |_, _, _| 0.0)
    }

    /// The colours of corners, linear; those at one vertex get their mean: no photo shows an edge
    /// there.
    fn joined(&self, encoded: &CornerColors) -> Vec<[f32; 3]> {
        let mut sums = vec![Vec3::ZERO; self.counts.len()];
        for (vertex, color) in self.vertices.iter().zip(encoded.iter().flatten()) {
            sums[*vertex as usize] += Vec3::from(*color);
        }
        let mean = |vertex: &u32| sums[*vertex as usize] / self.counts[*vertex as usize] as f32;
        self.vertices.iter().map(|vertex| mean(vertex).to_array().map(linear_from_srgb)).collect()
    }

    /// The colours at which all pulls balance; `right` is the residual of the photos with the
    /// present colours.
    fn improved(
        &self,
        encoded: &[[[f32; 3]; 3]],
        right: impl Fn(usize, usize, usize) -> f64,
    ) -> CornerColors {
        let mut better = encoded.to_vec();
        let alone = self.blocks();
        for channel in 0..3 {
            let now: Vec<f64> =
                encoded.iter().flatten().map(|corner| f64::from(corner[channel])).collect();
            // The present pulls between corners.
            let mut wanted = self.pull(&now, 0.0);
            for (i, wanted) in wanted.iter_mut().enumerate() {
                *wanted = right(i / 3, i % 3, channel) - *wanted;
            }
            let step = self.conjugate_gradients(&wanted, &alone);
            for (corner, (now, step)) in better.iter_mut().flatten().zip(now.iter().zip(step)) {
                corner[channel] = (now + step).clamp(0.0, 1.0) as f32;
            }
        }
        better
    }

    /// The matrix of all pulls except damping, times `x`; the photos have the weight `photos`.
    fn pull(&self, x: &[f64], photos: f64) -> Vec<f64> {
        let mut means = vec![0.0; self.counts.len()];
        for (x, vertex) in x.iter().zip(&self.vertices) {
            means[*vertex as usize] += x / self.counts[*vertex as usize];
        }
        let mut out = Vec::with_capacity(x.len());
        for (face, [a, b, c, d, e, f]) in self.matrices.iter().enumerate() {
            let [x0, x1, x2] = [x[3 * face], x[3 * face + 1], x[3 * face + 2]];
            let mean = (x0 + x1 + x2) / 3.0;
            let shown =
                [a * x0 + b * x1 + c * x2, b * x0 + d * x1 + e * x2, c * x0 + e * x1 + f * x2];
            for (k, x) in [x0, x1, x2].into_iter().enumerate() {
                let seam = SEAM_PX * (x - means[self.vertices[3 * face + k] as usize]);
                out.push(photos * shown[k] + seam + FLATNESS_PX * (x - mean));
            }
        }
        out
    }

    /// The solution of (all pulls + damping) x = `right`. Each triangle is solved for alone in
    /// every step: where no vertex is shared, that is the solution.
    fn conjugate_gradients(&self, right: &[f64], alone: &[[f64; 6]]) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut solution = vec![0.0; right.len()];
        let mut residual = right.to_vec();
        let mut direction = solved_alone(alone, &residual);
        let mut squared = dot(&residual, &direction);
        let enough = dot(right, right) * RESIDUAL * RESIDUAL;
        for _ in 0..STEPS {
            if !(dot(&residual, &residual) > enough) {
                break;
            }
            let mut pulled = self.pull(&direction, 1.0);
            for (pulled, step) in pulled.iter_mut().zip(&direction) {
                *pulled += DAMPING_PX * step;
            }
            let length = squared / dot(&direction, &pulled);
            for i in 0..right.len() {
                solution[i] += length * direction[i];
                residual[i] -= length * pulled[i];
            }
            let next_steps = solved_alone(alone, &residual);
            let next = dot(&residual, &next_steps);
            let share = next / squared;
            for (direction, step) in direction.iter_mut().zip(&next_steps) {
                *direction = step + share * *direction;
            }
            squared = next;
        }
        solution
    }

    /// The inverses of the blocks of the matrix that hold the corners of one triangle, 00 01 02 11
    /// 12 22. `[face]`
    fn blocks(&self) -> Vec<[f64; 6]> {
        let block = |(face, shown): (usize, &[f64; 6])| {
            let seam = |k: usize| {
                SEAM_PX * (1.0 - 1.0 / self.counts[self.vertices[3 * face + k] as usize])
            };
            let own = |k: usize| seam(k) + FLATNESS_PX * 2.0 / 3.0 + DAMPING_PX;
            let [a, b, c, d, e, f] = *shown;
            let a = a + own(0);
            let d = d + own(1);
            let f = f + own(2);
            let [b, c, e] = [b, c, e].map(|between| between - FLATNESS_PX / 3.0);
            let (minors, per) = symmetric_minors([a, b, c, d, e, f]);
            minors.map(|minor| minor * per)
        };
        self.matrices.iter().enumerate().map(block).collect()
    }
}

/// The inverse of each triangle's block times its part of `x`.
fn solved_alone(alone: &[[f64; 6]], x: &[f64]) -> Vec<f64> {
    let of_face = |([a, b, c, d, e, f], x): (&[f64; 6], &[f64])| {
        [
            a * x[0] + b * x[1] + c * x[2],
            b * x[0] + d * x[1] + e * x[2],
            c * x[0] + e * x[1] + f * x[2],
        ]
    };
    alone.iter().zip(x.chunks_exact(3)).flat_map(of_face).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::math::geometry::octasphere;

    /// A closed sphere.
    fn sphere() -> Mesh {
        let (corners, faces) = octasphere(3);
        let positions: Vec<_> =
            faces.iter().flat_map(|face| face.map(|i| 5.0 * corners[i as usize])).collect();
        let colors = Colors::Face(vec![[0.0; 3]; positions.len() / 3]);
        Mesh { positions, colors, ..Mesh::default() }
    }

    /// Photos that show `level` on this number of pixels of a black face.
    fn shows(level: f32, pixels: u32) -> Equations {
        let mut sums = Equations::default();
        for _ in 0..pixels {
            for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                sums.add(&weights, &[level; 3], &[0.0; 3], 1.0 / 3.0);
            }
        }
        sums
    }

    /// The largest step of a colour between two corners at one place.
    fn worst_seam(mesh: &Mesh, colors: &CornerColors) -> f32 {
        let system = System::of(mesh, 0);
        let mut range = vec![(f32::MAX, f32::MIN); system.counts.len()];
        for (corner, vertex) in colors.iter().flatten().zip(&system.vertices) {
            let (low, high) = range[*vertex as usize];
            range[*vertex as usize] = (low.min(corner[0]), high.max(corner[0]));
        }
        range.into_iter().map(|(low, high)| high - low).fold(0.0, f32::max)
    }

    #[test]
    fn texture_fills_unseen_parts_without_a_seam() {
        let mesh = sphere();
        let count = mesh.face_count();
        let height = |face: usize| mesh.centroid(face).y / 5.0;
        let sums: Vec<Equations> = (0..count)
            .map(|face| match height(face) {
                h if h > 0.5 => shows(0.8, 200),
                h if h < -0.5 => shows(0.2, 200),
                _ => Equations::default(),
            })
            .collect();
        let colors = solve(&mesh, 0, &sums, &vec![[[0.0; 3]; 3]; count]);
        for (face, corners) in colors.iter().enumerate() {
            let mean = corners.iter().map(|corner| corner[1]).sum::<f32>() / 3.0;
            match height(face) {
                h if h > 0.7 => assert!((mean - 0.8).abs() < 0.03, "{h}: {mean}"),
                h if h < -0.7 => assert!((mean - 0.2).abs() < 0.03, "{h}: {mean}"),
                h if h.abs() < 0.1 => assert!((mean - 0.5).abs() < 0.15, "{h}: {mean}"),
                _ => assert!((0.15..0.85).contains(&mean), "{mean}"),
            }
        }
        assert!(worst_seam(&mesh, &colors) < 0.03, "{}", worst_seam(&mesh, &colors));
    }

    #[test]
    fn triangles_that_share_no_vertex_are_solved_in_one_step() {
        let mesh = sphere().part(&[0, 9, 77]);
        let matrices = vec![[300.0, 20.0, 1.0, 2.0, 0.5, 9.0]; 3];
        let system = System { matrices, ..System::of(&mesh, 0) };
        let right: Vec<f64> = (0..9).map(|i| f64::from(i) - 3.0).collect();
        let solved = solved_alone(&system.blocks(), &right);
        let mut back = system.pull(&solved, 1.0);
        for (back, solved) in back.iter_mut().zip(&solved) {
            *back += DAMPING_PX * solved;
        }
        assert!(back.iter().zip(&right).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
        let found = system.conjugate_gradients(&right, &system.blocks());
        assert!(found.iter().zip(&solved).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn a_mosaic_is_smoothed_and_what_touches_nothing_stays() {
        let mesh = sphere();
        let level = |face: usize| if face.is_multiple_of(2) { 0.4 } else { 0.6 };
        let colors: CornerColors =
            (0..mesh.face_count()).map(|face| [[level(face); 3]; 3]).collect();
        let smoothed = System::of(&mesh, 0).smoothed(&colors);
        assert!(worst_seam(&mesh, &colors) > 0.19 && worst_seam(&mesh, &smoothed) < 0.12);
        let single = mesh.part(&[0, 9, 77]);
        assert_eq!(System::of(&single, 0).smoothed(&colors[..3]), colors[..3]);
    }
}
