//! The triangles while they are fitted.

use crate::trial::with_moved_corner;
use glam::Vec3;
use std::sync::atomic::AtomicI64;
use std::sync::atomic::Ordering::Relaxed;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};
use trisplat_scene::mesh::{Colors, Mesh};

/// Weight of a face's own colour, in samples.
const PRIOR_SAMPLES: f64 = 2.0;
/// Minimum samples of a face before it is cut, so that each half shows some.
const CUT_SAMPLES: f64 = 8.0;

/// Unconnected triangles, one colour each. The shell only gets colours, so it stays closed.
pub(super) struct ReshapedFaces {
    /// Permanent names of faces, for random sequences. `[F]`
    ids: Vec<u32>,
    next_id: u32,
    /// `[F]`
    pub(super) corners: Vec<[Vec3; 3]>,
    /// Linear. `[F]`
    colors: Vec<[f32; 3]>,
    /// See [`Mesh::shell`]. `[F]`
    shell: Vec<bool>,
    /// See [`Mesh::single_sided`]. `[F]`
    single_sided: Vec<bool>,
}

impl ReshapedFaces {
    /// Faces of a mesh without shared vertices, in their mean colours.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let count = mesh.face_count();
        let color = |face: usize| {
            let [a, b, c] = mesh.corner_colors(face);
            match &mesh.colors {
                Colors::Face(colors) => colors[face],
                Colors::Vertex(_) => [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0),
            }
        };
        Self {
            ids: (0..count as u32).collect(),
            next_id: count as u32,
            corners: (0..count).map(|face| mesh.corners(face)).collect(),
            colors: (0..count).map(color).collect(),
            shell: (0..count).map(|face| mesh.is_shell(face)).collect(),
            single_sided: (0..count).map(|face| mesh.is_single_sided(face)).collect(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.ids.len()
    }

    pub(super) fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// sRGB-encoded colours, in which errors are measured. `[F]`
    pub(super) fn encoded_colors(&self) -> Vec<[f32; 3]> {
        self.colors.iter().map(|rgb| rgb.map(srgb_from_linear)).collect()
    }

    /// All faces, each with one corner moved. `[F]`
    pub(super) fn with_moved_corners(&self, round: u32) -> Vec<[Vec3; 3]> {
        self.corners
            .iter()
            .zip(&self.ids)
            .map(|(corners, id)| with_moved_corner(*corners, *id, round))
            .collect()
    }

    /// Gives every visible face the mean colour of the pixels that show it.
    pub(super) fn recolor(&mut self, measures: &Measures) {
        for (i, color) in self.colors.iter_mut().enumerate() {
            let face = measures.face(i);
            if face.samples > 0.0 {
                let old = color.map(|c| f64::from(srgb_from_linear(c)));
                let mean = |k: usize| {
                    (face.rgb[k] + PRIOR_SAMPLES * old[k]) / (face.samples + PRIOR_SAMPLES)
                };
                *color = [0, 1, 2].map(|k| linear_from_srgb(mean(k) as f32));
            }
        }
    }

    /// Moves corners if this lowers the error; returns how many.
    pub(super) fn keep_moves(&mut self, measures: &Measures, candidates: Vec<[Vec3; 3]>) -> u64 {
        let mut moves = 0;
        for (i, candidate) in candidates.into_iter().enumerate() {
            if measures.face(i).moving < 0.0 && !self.shell[i] {
                self.corners[i] = candidate;
                moves += 1;
            }
        }
        moves
    }

    /// Drops faces if the error is lower without them; returns how many. Faces not in `found` stay.
    pub(super) fn drop_harmful(&mut self, measures: &Measures) -> u64 {
        let before = self.len();
        let stays =
            |i: usize| i >= measures.len() || self.shell[i] || !measures.face(i).is_harmful();
        let kept: Vec<usize> = (0..before).filter(|&i| stays(i)).collect();
        // At least one triangle must stay.
        if !kept.is_empty() {
            self.ids = kept.iter().map(|&i| self.ids[i]).collect();
            self.corners = kept.iter().map(|&i| self.corners[i]).collect();
            self.colors = kept.iter().map(|&i| self.colors[i]).collect();
            self.shell = kept.iter().map(|&i| self.shell[i]).collect();
            self.single_sided = kept.iter().map(|&i| self.single_sided[i]).collect();
        }
        (before - self.len()) as u64
    }

    /// Cuts faces in two across their longest edge, those with the largest error first: at most the
    /// share `most` of all, and at most `budget` faces afterwards. New faces come last. Returns how
    /// many.
    pub(super) fn cut(&mut self, measures: &Measures, budget: usize, max_share: f64) -> u64 {
        let is_good = |i: &usize| !self.shell[*i] && !measures.face(*i).is_harmful();
        let staying = (0..self.len()).filter(|i| self.shell[*i] || is_good(i)).count();
        let room = budget.saturating_sub(staying).min((max_share * staying as f64) as usize);
        let mut order: Vec<usize> = (0..self.len())
            .filter(is_good)
            .filter(|&i| measures.face(i).samples >= CUT_SAMPLES)
            .collect();
        order.sort_unstable_by(|&a, &b| {
            measures.face(b).error.total_cmp(&measures.face(a).error).then(a.cmp(&b))
        });
        order.truncate(room);
        for &i in &order {
            let [first, second] = halves(self.corners[i]);
            self.corners[i] = first;
            self.corners.push(second);
            self.colors.push(self.colors[i]);
            self.shell.push(false);
            self.single_sided.push(self.single_sided[i]);
            self.ids.push(self.next_id);
            self.next_id += 1;
        }
        order.len() as u64
    }

    /// Flags of the faces that are drawn from their front only; empty where all are drawn from both
    /// sides. `[F]`
    pub(super) fn single_sided(&self) -> Vec<bool> {
        flags(&self.single_sided)
    }

    /// As a mesh, one colour per face.
    pub(super) fn to_mesh(&self) -> Mesh {
        Mesh {
            positions: self.corners.as_flattened().to_vec(),
            colors: Colors::Face(self.colors.clone()),
            shell: flags(&self.shell),
            single_sided: self.single_sided(),
            ..Mesh::default()
        }
    }
}

/// The flags of a mesh, which has none where all are false.
fn flags(flags: &[bool]) -> Vec<bool> {
    if flags.contains(&true) { flags.to_vec() } else { Vec::new() }
}

/// The two halves of a triangle, cut along the median to its longest edge.
fn halves(corners: [Vec3; 3]) -> [[Vec3; 3]; 2] {
    let edge = |k: usize| corners[(k + 1) % 3].distance_squared(corners[(k + 2) % 3]);
    let opposite = (1..3).fold(0, |best, k| if edge(k) > edge(best) { k } else { best });
    let b = (opposite + 1) % 3;
    let c = (opposite + 2) % 3;
    let middle = (corners[b] + corners[c]) / 2.0;
    let mut halves = [corners; 2];
    halves[0][c] = middle;
    halves[1][b] = middle;
    halves
}

// ---- A round's measurements of every triangle, summed from many threads -------------------------

/// Units per squared difference in integer sums. Integers, because their sums do not depend on the
/// order.
pub(super) const UNITS: f64 = (1u64 << 24) as f64;

/// Measurements of all faces.
pub(super) struct Measures {
    pub(super) rows: Vec<FaceRow>,
    /// Squared error of all samples.
    pub(super) error: f64,
    /// Samples, by weight.
    pub(super) weight: f64,
}

/// Measurements of a face.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct MatchedFace {
    /// Samples that show it.
    pub(super) samples: f64,
    /// Sum of the pictures' sRGB-encoded colours there.
    pub(super) rgb: [f64; 3],
    /// Sum of the squared errors there.
    pub(super) error: f64,
    /// Change of the squared error without the face.
    pub(super) removing: f64,
    /// Change of the squared error when the face moves.
    pub(super) moving: f64,
}

impl MatchedFace {
    /// The pictures are matched better without the face.
    pub(super) fn is_harmful(&self) -> bool {
        self.removing < 0.0
    }
}

impl Measures {
    /// Nothing yet.
    pub(super) fn new(faces: usize) -> Self {
        Self { rows: (0..faces).map(|_| FaceRow::default()).collect(), error: 0.0, weight: 0.0 }
    }

    /// Faces it knows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// About one face.
    pub(super) fn face(&self, face: usize) -> MatchedFace {
        let [samples, r, g, b, error, removing, moving, _] =
            self.rows[face].0.each_ref().map(|sum| sum.load(Relaxed) as f64 / UNITS);
        MatchedFace { samples, rgb: [r, g, b], error, removing, moving }
    }

    /// PSNR of the scene as drawn, dB, if there were pictures.
    pub(super) fn psnr(&self) -> Option<f64> {
        let mse = self.error / (3.0 * self.weight);
        (self.weight > 0.0).then(|| -10.0 * mse.max(1e-10).log10())
    }
}

/// The sums of one face, a cache line.
#[derive(Debug, Default)]
#[repr(align(64))]
pub(super) struct FaceRow([AtomicI64; 8]);

pub(super) const COUNT: usize = 0;
pub(super) const RGB: usize = 1;
pub(super) const ERROR: usize = 4;
pub(super) const REMOVING: usize = 5;
pub(super) const MOVING: usize = 6;

impl FaceRow {
    #[inline(always)]
    pub(super) fn add(&self, which: usize, value: f32) {
        add(&self.0[which], value.into());
    }
}

#[inline(always)]
pub(super) fn add(sum: &AtomicI64, value: f64) {
    sum.fetch_add((value * UNITS) as i64, Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_cover_the_triangle_and_turn_the_same_way() {
        let corners = [Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(1.0, 2.0, 0.0)];
        let normal = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a);
        let [first, second] = halves(corners);
        assert_eq!(normal(first), normal(second));
        assert_eq!(normal(first) + normal(second), normal(corners));
        assert!(
            first.contains(&Vec3::new(2.0, 0.0, 0.0)) && second.contains(&Vec3::new(2.0, 0.0, 0.0))
        );
    }
}
