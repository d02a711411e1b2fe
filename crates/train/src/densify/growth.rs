//! Growth: weighted sampling of triangles, and the children that take their places.

use super::plan::DensifyPlan;
use crate::options::SampleWeight;
use crate::params::{OptimizerState, Params};
use crate::visibility::VisibilityStats;
use glam::Vec3;
use rayon::prelude::*;
use trisplat_scene::Rng;
use trisplat_scene::parallel::{self, GRAIN};

/// Largest shift of a clone, in halves of the triangle's box (1.5, supplement: max_noise_factor).
const CLONE_SHIFT: f32 = 1.5;

/// Samples triangles by weight, without replacement, until the growth is spent: a split adds three,
/// a clone one.
pub(super) fn sample_growth(
    state: &OptimizerState,
    alive: &[bool],
    visibility: &VisibilityStats,
    plan: &DensifyPlan<'_>,
) -> Vec<bool> {
    // Frozen triangles do not count against a budget.
    let count = alive.iter().skip(state.frozen).filter(|a| **a).count();
    let target = ((count as f64 * (1.0 + plan.options.growth)) as usize).min(plan.max_triangles);
    let mut budget = target.saturating_sub(count);
    let in_core = |i: usize| plan.core.is_some_and(|core| core.holds(&state.params, i));
    let mut core_budget = plan.core.map_or(usize::MAX, |core| {
        let in_core_count = (state.frozen..alive.len()).filter(|&i| alive[i] && in_core(i)).count();
        usize::try_from(core.triangles).unwrap_or(usize::MAX).saturating_sub(in_core_count)
    });
    let mut grown = vec![false; alive.len()];
    // Efraimidis and Spirakis 2006: the smallest of -ln(u) / weight is a sample in proportion to
    // the weights. The purpose's name is part of the random numbers.
    let rng = Rng::new(plan.seed, "lottery", plan.step);
    let opacity = |i: usize| f64::from(plan.anneal.opacity(state.params.opacity[i]));
    let softness = |i: usize| f64::from(plan.anneal.sigma(state.params.sigma[i]));
    let rule = if plan.bisect { SampleWeight::Error } else { plan.options.sample_by };
    let weight = |i: usize| match rule {
        SampleWeight::Alternating if plan.densification % 2 == 1 => opacity(i),
        SampleWeight::Alternating => 1.0 / softness(i),
        SampleWeight::Error => visibility.error[i] as f64,
    };
    let key = |i: usize| {
        (i >= state.pinned && alive[i] && weight(i) > 0.0)
            .then(|| (-(1.0 - rng.uniform_f64(i as u64)).ln() / weight(i), i as u32))
    };
    let mut keys: Vec<(f64, u32)> = parallel::filter_map(alive.len(), GRAIN, key);
    keys.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for &(_, i) in &keys {
        // The surroundings of a full core do not grow alone.
        if budget == 0 || core_budget == 0 {
            break;
        }
        let cost = if is_large(visibility, i as usize, plan) && !plan.bisect { 3 } else { 1 };
        let core_cost = if in_core(i as usize) { cost } else { 0 };
        if cost <= budget && core_cost <= core_budget {
            budget -= cost;
            core_budget -= core_cost;
            grown[i as usize] = true;
        }
    }
    grown
}

pub(super) fn is_large(visibility: &VisibilityStats, i: usize, plan: &DensifyPlan<'_>) -> bool {
    f64::from(visibility.radius_px[i]) > plan.options.split_px
}

/// Triangles with these corners, and the opacity, σ and colour of their parent `i`.
fn children(params: &Params, i: usize, corners: impl IntoIterator<Item = [Vec3; 3]>) -> Params {
    let mut children = Params { sh_degree: params.sh_degree, ..Params::default() };
    for corners in corners {
        children.push(params, i);
        children.vertices.pop();
        children.vertices.push(corners);
    }
    children
}

/// The four triangles of the midpoint subdivision.
pub(super) fn split(params: &Params, i: usize) -> Params {
    let [a, b, c] = params.vertices[i];
    let ab = a.midpoint(b);
    let bc = b.midpoint(c);
    let ca = c.midpoint(a);
    children(params, i, [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
}

/// The two halves of a triangle, cut from the middle of its longest side.
pub(super) fn bisect(params: &Params, i: usize) -> Params {
    let corners = params.vertices[i];
    let length = |c: usize| corners[c].distance_squared(corners[(c + 1) % 3]);
    let from = (1..3).fold(0, |best, c| if length(c) > length(best) { c } else { best });
    let [a, b, c] = [0, 1, 2].map(|k| corners[(from + k) % 3]);
    let middle = a.midpoint(b);
    children(params, i, [[a, middle, c], [middle, b, c]])
}

/// The triangle and a copy shifted within its plane.
pub(super) fn clone(params: &Params, i: usize, plan: &DensifyPlan<'_>, rng: Rng) -> Params {
    let corners = params.vertices[i];
    let size =
        corners[0].max(corners[1]).max(corners[2]) - corners[0].min(corners[1]).min(corners[2]);
    let at = |axis: u64| rng.uniform(3 * i as u64 + axis) - 0.5;
    let noise = Vec3::new(at(0), at(1), at(2)) * size * CLONE_SHIFT;
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    let shift = noise - normal * normal.dot(noise);
    let mut children =
        children(params, i, [Vec3::ZERO, shift].map(|offset| corners.map(|v| v + offset)));
    let opacity = plan.anneal.opacity(params.opacity[i]).min(1.0);
    let half = 1.0 - (1.0 - opacity).sqrt();
    if let Some(raw) = plan.anneal.opacity_raw(half) {
        children.opacity.fill(raw);
    }
    children
}
