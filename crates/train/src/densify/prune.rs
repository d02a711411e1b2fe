//! Removal of useless triangles, repairs at depth anchors, and room in a full scene.

use super::plan::{Densified, DensifyPlan};
use crate::params::{OptimizerState, Params};
use crate::relocate::{Relocation, evict_lowest_contribution};
use crate::stereo::DepthRepair;
use crate::visibility::VisibilityStats;
use glam::Vec3;
use trisplat_scene::math::geometry::centroid;

/// Triangles visible in fewer photos than this are pruned (2, Held et al. 2025, section 3.2).
const MIN_VIEWS: u32 = 2;
/// Triangles of a solid scene that fewer photos than this show need one that is near.
const FIRM_VIEWS: u32 = 6;
/// Largest distance of the nearest photo that shows such a triangle, in distances of the nearest
/// camera: a triangle close to a camera that does not show it, and shown by far photos only, fits
/// some of their pixels and no surface.
const FARTHEST_VIEW: f32 = 2.5;

/// Flags the triangles that stay, by the rules in their order. `[N]`
pub(super) fn prune(
    state: &OptimizerState,
    visibility: &VisibilityStats,
    complete: bool,
    plan: &DensifyPlan<'_>,
    done: &mut Densified,
) -> Vec<bool> {
    let params = &state.params;
    let mut alive = vec![true; params.len()];
    for (i, alive) in alive.iter_mut().enumerate().skip(state.pinned) {
        let observed = complete && !visibility.exempt[i];
        let cause = if !params.is_finite(i) {
            &mut done.broken
        } else if f64::from(plan.anneal.opacity(params.opacity[i])) < plan.prune_opacity {
            &mut done.faint
        } else if observed && visibility.max_weight[i] < plan.prune_weight {
            &mut done.unimportant
        } else if observed && visibility.views[i] < MIN_VIEWS.min(visibility.drawn.len() as u32) {
            &mut done.unseen
        } else if observed && plan.bisect && is_unsupported(params, visibility, i, plan.eyes) {
            &mut done.unsupported
        } else {
            continue;
        };
        *cause += 1;
        *alive = false;
    }
    if !alive.iter().skip(state.frozen).any(|a| *a) {
        let finite = (state.frozen..alive.len()).filter(|&i| params.is_finite(i));
        if let Some(best) =
            finite.max_by(|&a, &b| visibility.max_weight[a].total_cmp(&visibility.max_weight[b]))
        {
            alive[best] = true;
        }
    }
    alive
}

/// True for a triangle near a camera that only a few photos show, from much farther away.
fn is_unsupported(params: &Params, visibility: &VisibilityStats, i: usize, eyes: &[Vec3]) -> bool {
    let middle = centroid(params.vertices[i]);
    let near = |eye: &Vec3| middle.distance(*eye) * visibility.nearness[i] * FARTHEST_VIEW < 1.0;
    visibility.views[i] < FIRM_VIEWS && eyes.iter().any(near)
}

/// Removes triangles before depth anchors, and moves others towards theirs; returns the anchors
/// that photos see through, while triangles may be added.
pub(super) fn repair(
    state: &mut OptimizerState,
    visibility: &VisibilityStats,
    alive: &mut [bool],
    plan: &DensifyPlan<'_>,
    done: &mut Densified,
) -> Vec<u32> {
    let Some(anchors) = plan.anchors else { return Vec::new() };
    let DepthRepair { occludes, holes, shifts } =
        anchors.repair(state, alive, visibility, plan.eyes, plan.pull);
    let stays = |i: usize| alive[i] && !occludes[i];
    if (state.frozen..alive.len()).any(stays) {
        let removed = |(alive, occludes): &(&mut bool, bool)| **alive && *occludes;
        for (alive, _) in alive.iter_mut().zip(occludes).filter(removed) {
            *alive = false;
            done.blocking += 1;
        }
    }
    for (corners, by) in state.params.vertices.iter_mut().zip(shifts) {
        *corners = corners.map(|corner| corner + by);
    }
    if plan.grow { holes } else { Vec::new() }
}

/// Evicts triangles of the lowest contribution; returns their number.
pub(super) fn relocate(
    state: &OptimizerState,
    visibility: &VisibilityStats,
    alive: &mut [bool],
    plan: &DensifyPlan<'_>,
) -> usize {
    let relocation = Relocation {
        share: plan.options.relocate,
        growth: plan.options.growth,
        max_triangles: plan.max_triangles,
        frozen: state.frozen,
        pinned: state.pinned,
    };
    evict_lowest_contribution(alive, visibility, &relocation)
}
