//! One update of all parameters: chain rules, regularisers of single triangles, Adam.

use super::params::{OptimizerState, Params};
use super::schedule::StepParams;
use glam::Vec3;
use trisplat_raster::kernel::{Rate, adam};
use trisplat_raster::soft::SoupGrad;
use trisplat_scene::parallel;
use trisplat_scene::sh_count;

/// Triangles per parallel job.
const CHUNK: usize = 512;

/// Minimum and maximum size that counts for the step of a triangle's corners, scene units: for
/// slivers and for triangles around everything. Corners move in proportion to the size, so a step
/// is the same share of every triangle, whatever the unit of the scene.
pub(crate) const SIZES: [f32; 2] = [0.001, 0.3];

/// Largest size that counts, times the root of the number of triangles:
/// about six times the median of a trained capture. Triangles that grow far beyond it hide whole
/// walls before a photo is drawn that shows the harm.
pub(crate) const SIZE_OF_ALL: f32 = 15.0;

/// Gradients that bypass the pixels (Held et al. 2025, eq. 3: β1 and β4).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Regularisers {
    /// ∂(β1 · mean opacity)/∂opacity.
    d_opacity: f32,
    /// ∂(β4 / mean area)/∂area.
    d_area: f32,
}

impl Regularisers {
    /// The gradients at these parameters.
    pub(crate) fn new(state: &OptimizerState, rates: &StepParams) -> Self {
        // Pinned triangles do not change: they do not count.
        let params = &state.params;
        let pinned = state.pinned;
        let n = (params.len() - pinned).max(1) as f64;
        let d_area = if rates.beta_size > 0.0 {
            let area = |v: &[Vec3; 3]| f64::from(0.5 * cross(v).length());
            let mean = (sum_of(&params.vertices[pinned..], area) / n).max(1e-12);
            -rates.beta_size / (mean * mean * n)
        } else {
            0.0
        };
        Self { d_opacity: (rates.beta_opacity / n) as f32, d_area: d_area as f32 }
    }
}

/// The sum of one number per triangle, in an order that does not depend on the number of threads.
fn sum_of<T: Sync>(values: &[T], number: impl Fn(&T) -> f64 + Sync) -> f64 {
    let sums =
        parallel::map(values.chunks(CHUNK), |_, chunk| chunk.iter().map(&number).sum::<f64>());
    sums.iter().sum()
}

/// The root of a triangle's area, from the smaller of [`SIZES`] to `max_size`.
fn size(v: &[Vec3; 3], max_size: f32) -> f32 {
    (0.5 * cross(v).length()).sqrt().clamp(SIZES[0], max_size)
}

/// The largest size that counts in a scene of `triangles`.
fn max_size(triangles: usize) -> f32 {
    (SIZE_OF_ALL / (triangles.max(1) as f32).sqrt()).clamp(SIZES[0], SIZES[1])
}

fn cross(v: &[Vec3; 3]) -> Vec3 {
    (v[1] - v[0]).cross(v[2] - v[0])
}

/// ∂area/∂corners, area = |cross| / 2; zero for a triangle without area.
fn area_grad(v: &[Vec3; 3], d_area: f32) -> [Vec3; 3] {
    let normal = cross(v).normalize_or_zero() * (0.5 * d_area);
    let d1 = (v[2] - v[0]).cross(normal);
    let d2 = normal.cross(v[1] - v[0]);
    [-(d1 + d2), d1, d2]
}

/// Updates `state` by `gradient`. Returns how many triangles had a gradient, and how many of these
/// were not finite; such triangles keep their parameters in this step.
pub(crate) fn update(
    state: &mut OptimizerState,
    gradient: &SoupGrad,
    rates: &StepParams,
    regularisers: &Regularisers,
) -> (u64, u64) {
    let k = state.params.sh_count();
    let step = UpdateStep {
        k,
        pinned: state.pinned,
        frozen: state.frozen,
        used: sh_count(rates.sh_degree.min(state.params.sh_degree)),
        rates,
        regularisers,
        max_size: max_size(state.params.len()),
        corners: Rate::new(rates.corners, rates.time),
        opacity: Rate::new(rates.opacity, rates.time),
        sigma: Rate::new(rates.sigma, rates.time),
        sh: Rate::new(rates.sh, rates.time),
        sh_rest: Rate::new(rates.sh_rest, rates.time),
    };
    let d = gradient
        .vertices
        .chunks(CHUNK)
        .zip(gradient.opacity.chunks(CHUNK))
        .zip(gradient.sigma.chunks(CHUNK))
        .zip(gradient.sh.chunks(CHUNK * k))
        .map(|(((vertices, opacity), sigma), sh)| GradChunk { vertices, opacity, sigma, sh });
    let work = chunks(&mut state.params, k)
        .zip(chunks(&mut state.first, k))
        .zip(chunks(&mut state.second, k))
        .zip(d);
    let counts: Vec<(u64, u64)> = parallel::map(work, |at, (((x, m), v), d)| {
        let first = at * CHUNK;
        if rates.sparse {
            // All other rows are zero.
            let visible = gradient.visible_in(first..first + CHUNK).iter();
            return step.chunk(first, visible.map(|&i| i as usize - first), x, m, v, d);
        }
        step.chunk(first, 0..x.0.len(), x, m, v, d)
    });
    counts.iter().fold((0, 0), |sum, c| (sum.0 + c.0, sum.1 + c.1))
}

/// Corners, opacities, σ and SH of consecutive triangles.
type ParamChunk<'a> = (&'a mut [[Vec3; 3]], &'a mut [f32], &'a mut [f32], &'a mut [[f32; 3]]);

fn chunks(params: &mut Params, k: usize) -> impl Iterator<Item = ParamChunk<'_>> {
    let vertices = params.vertices.chunks_mut(CHUNK);
    let opacity = params.opacity.chunks_mut(CHUNK);
    let sigma = params.sigma.chunks_mut(CHUNK);
    let sh = params.sh.chunks_mut(CHUNK * k);
    vertices.zip(opacity).zip(sigma).zip(sh).map(|(((v, o), s), sh)| (v, o, s, sh))
}

/// The gradient of consecutive triangles.
struct GradChunk<'a> {
    vertices: &'a [[Vec3; 3]],
    opacity: &'a [f32],
    sigma: &'a [f32],
    sh: &'a [[f32; 3]],
}

/// One step's constants.
struct UpdateStep<'a> {
    k: usize,
    pinned: usize,
    frozen: usize,
    used: usize,
    rates: &'a StepParams,
    regularisers: &'a Regularisers,
    /// The largest size of a triangle that counts.
    max_size: f32,
    corners: Rate,
    opacity: Rate,
    sigma: Rate,
    sh: Rate,
    sh_rest: Rate,
}

impl UpdateStep<'_> {
    /// Updates `rows` of the triangles from `from` on.
    fn chunk(
        &self,
        from: usize,
        rows: impl Iterator<Item = usize>,
        x: ParamChunk<'_>,
        m: ParamChunk<'_>,
        v: ParamChunk<'_>,
        d: GradChunk<'_>,
    ) -> (u64, u64) {
        let mut touched = 0;
        let mut dropped = 0;
        for i in rows.filter(|i| from + i >= self.frozen) {
            let sh = i * self.k..i * self.k + self.used;
            let d_sh = d.sh[sh.clone()].as_flattened();
            let d_vertices: &[f32; 9] = bytemuck::cast_ref(&d.vertices[i]);
            let mut sum = d.opacity[i].abs() + d.sigma[i].abs();
            sum += d_vertices.iter().chain(d_sh).map(|g| g.abs()).sum::<f32>();
            if !sum.is_finite() {
                dropped += 1;
                touched += 1;
                continue;
            }
            if sum == 0.0 && self.rates.sparse {
                continue;
            }
            touched += 1;
            if from + i < self.pinned {
                let x = &mut x.3[sh.start];
                let m = &mut m.3[sh.start];
                let v = &mut v.3[sh.start];
                adam(self.sh, x, &d_sh[..3], m, v);
                continue;
            }
            self.corners(&mut x.0[i], d_vertices, &mut m.0[i], &mut v.0[i]);
            let anneal = self.rates.anneal;
            let d_opacity = anneal.opacity_grad(x.1[i], d.opacity[i] + self.regularisers.d_opacity);
            let d_sigma = anneal.sigma_grad(x.2[i], d.sigma[i]);
            let one = std::slice::from_mut;
            adam(self.opacity, one(&mut x.1[i]), &[d_opacity], one(&mut m.1[i]), one(&mut v.1[i]));
            adam(self.sigma, one(&mut x.2[i]), &[d_sigma], one(&mut m.2[i]), one(&mut v.2[i]));
            let x = &mut x.3[sh.clone()];
            let m = &mut m.3[sh.clone()];
            let v = &mut v.3[sh];
            let x = x.as_flattened_mut();
            let m = m.as_flattened_mut();
            let v = v.as_flattened_mut();
            adam(self.sh, &mut x[..3], &d_sh[..3], &mut m[..3], &mut v[..3]);
            adam(self.sh_rest, &mut x[3..], &d_sh[3..], &mut m[3..], &mut v[3..]);
        }
        (touched, dropped)
    }

    fn corners(&self, x: &mut [Vec3; 3], d: &[f32; 9], m: &mut [Vec3; 3], v: &mut [Vec3; 3]) {
        let mut d = *d;
        if self.regularisers.d_area != 0.0 {
            let by_area = area_grad(x, self.regularisers.d_area);
            let by_area: &[f32; 9] = bytemuck::cast_ref(&by_area);
            for (d, by_area) in d.iter_mut().zip(by_area) {
                *d += by_area;
            }
        }
        let flat = |a| bytemuck::cast_mut::<[Vec3; 3], [f32; 9]>(a).as_mut_slice();
        adam(self.corners.times(size(x, self.max_size)), flat(x), &d, flat(m), flat(v));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TrainOptions, TrainPreset};

    #[test]
    fn area_grad_is_the_derivative() {
        let v = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(1.0, -0.3, 0.2), Vec3::new(0.4, 0.9, -0.5)];
        let area = |v: &[Vec3; 3]| 0.5 * cross(v).length();
        let grad = area_grad(&v, 1.0);
        for corner in 0..3 {
            for axis in 0..3 {
                let moved = |h: f32| {
                    let mut w = v;
                    w[corner][axis] += h;
                    area(&w)
                };
                let difference = (moved(1e-2) - moved(-1e-2)) / 2e-2;
                assert!(
                    (difference - grad[corner][axis]).abs() < 1e-3,
                    "{difference} {}",
                    grad[corner][axis]
                );
            }
        }
    }

    /// Four equal triangles of SH degree 1, a gradient for each of their numbers, and the rates of
    /// a first step.
    fn four_triangles() -> (OptimizerState, SoupGrad, StepParams) {
        let params = Params {
            vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 4],
            opacity: vec![0.0; 4],
            sigma: vec![0.0; 4],
            sh: vec![[0.0; 3]; 16],
            sh_degree: 1,
        };
        let gradient = SoupGrad {
            vertices: vec![[Vec3::ONE; 3]; 4],
            opacity: vec![1.0; 4],
            sigma: vec![1.0; 4],
            sh: vec![[1.0; 3]; 16],
            visible: vec![0, 1, 2, 3],
            ..SoupGrad::default()
        };
        let options = TrainOptions::preset(TrainPreset::Outdoor);
        let rates = crate::schedule::Schedule::new(&options).rates(0);
        (OptimizerState::new(params), gradient, StepParams { sh_degree: 1, ..rates })
    }

    #[test]
    fn pinned_triangles_change_their_colour_alone() {
        let (mut state, gradient, rates) = four_triangles();
        state.pinned = 2;
        let before = state.params.clone();
        let regularisers = Regularisers::new(&state, &rates);
        assert_eq!(update(&mut state, &gradient, &rates, &regularisers), (4, 0));
        let now = &state.params;
        let k = before.sh_count();
        for i in 0..2 {
            assert_eq!(now.vertices[i], before.vertices[i]);
            assert_eq!((now.opacity[i], now.sigma[i]), (before.opacity[i], before.sigma[i]));
            assert_ne!(now.sh[i * k], before.sh[i * k]);
            assert_eq!(
                now.sh[i * k + 1..(i + 1) * k],
                before.sh[i * k + 1..(i + 1) * k],
                "from all sides the same"
            );
        }
        assert_ne!(now.vertices[2], before.vertices[2]);
        assert_ne!(now.sh[2 * k + 1], before.sh[2 * k + 1]);
    }

    #[test]
    fn corners_move_in_proportion_to_the_triangle() {
        let sides = [0.001f32, 0.01, 0.02, 100.0];
        let (mut state, gradient, rates) = four_triangles();
        state.params.vertices =
            sides.map(|side| [Vec3::ZERO, side * Vec3::X, side * Vec3::Y]).to_vec();
        let regularisers = Regularisers::new(&state, &rates);
        update(&mut state, &gradient, &rates, &regularisers);
        let moved = [0, 1, 2, 3].map(|i| -state.params.vertices[i][0].x / rates.corners as f32);
        let [least, most] = SIZES;
        let sizes = [least, 0.01 * 0.5f32.sqrt(), 0.02 * 0.5f32.sqrt(), most];
        assert!((0..4).all(|i| (moved[i] / sizes[i] - 1.0).abs() < 1e-4), "{moved:?}");
    }

    #[test]
    fn the_largest_size_falls_with_the_number_of_triangles() {
        assert_eq!([0, 1, 2500].map(max_size), [0.3; 3]);
        assert_eq!([22_500, 1_000_000].map(max_size), [0.1, 0.015]);
        assert_eq!(max_size(usize::MAX), SIZES[0]);
    }

    #[test]
    fn a_gradient_that_is_not_finite_is_dropped_and_counted() {
        let (mut state, mut gradient, rates) = four_triangles();
        gradient.vertices[0][2].y = f32::NAN;
        gradient.sh[4][0] = f32::INFINITY;
        gradient.vertices[2] = [Vec3::ZERO; 3];
        gradient.opacity[2] = 0.0;
        gradient.sigma[2] = 0.0;
        gradient.sh[8..12].fill([0.0; 3]);
        let regularisers = Regularisers::new(&state, &rates);
        let before = state.clone();
        assert_eq!(update(&mut state, &gradient, &rates, &regularisers), (3, 2));
        for still in 0..3 {
            assert_eq!(state.params.vertices[still], before.params.vertices[still]);
            assert_eq!(state.first.vertices[still], before.first.vertices[still]);
        }
        assert_ne!(state.params.vertices[3], before.params.vertices[3]);
    }
}
