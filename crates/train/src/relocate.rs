//! Relocation: a scene at its limit of triangles gives up those of the lowest contribution, so that
//! others can grow; an overfull scene shrinks to its limit in the same way.
//!
//! Pruning removes only useless triangles: slivers and hidden ones. In a full scene this is too
//! little room for growth where the picture is wrong. The measure is the sum of a triangle's
//! blending weights over all pixels of all photos, because even a triangle of one pixel can have
//! the largest single weight.

use super::visibility::VisibilityStats;

/// A scene is full with this share of its limit, because pruning has just removed some triangles.
const FULL: f64 = 0.9;
/// Largest share of an overfull scene that goes at once, so that the others close the gaps before
/// more go.
const MAX_CUT: f64 = 0.1;

/// Limits of a relocation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relocation {
    /// Share of the triangles to remove.
    pub(super) share: f64,
    /// Maximum number of triangles that a densification adds, as a share of the present ones.
    pub(super) growth: f64,
    /// Maximum number of triangles that are trained.
    pub(super) max_triangles: usize,
    /// Number of first triangles that do not count against the limit.
    pub(super) frozen: usize,
    /// Number of first triangles that stay; frozen ones are among them.
    pub(super) pinned: usize,
}

/// Evicts a share of the triangles of a full scene, those of the least summed weight, but no more
/// than grow back; of an overfull scene also its surplus, step by step. Returns their number.
pub(super) fn evict_lowest_contribution(
    alive: &mut [bool],
    visibility: &VisibilityStats,
    relocation: &Relocation,
) -> usize {
    let Relocation { share, growth, max_triangles, frozen, pinned } = *relocation;
    let count = alive.iter().skip(frozen).filter(|a| **a).count();
    if (count as f64) < FULL * max_triangles as f64 {
        return 0;
    }
    let kept = count.min(max_triangles.max((count as f64 * (1.0 - MAX_CUT)) as usize));
    let relocated = (kept as f64 * share.min(growth / (1.0 + growth))) as usize;
    // Triangles younger than the statistics were not drawn for all photos.
    let candidates = (pinned..alive.len()).filter(|&i| alive[i] && !visibility.exempt[i]);
    let mut lowest: Vec<(f32, usize)> = candidates.map(|i| (visibility.sum_weight[i], i)).collect();
    lowest.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    lowest.truncate(count - kept + relocated);
    for &(_, i) in &lowest {
        alive[i] = false;
    }
    lowest.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 triangles with falling visibility; the first five are pinned, the last one is young.
    fn scene() -> (Vec<bool>, VisibilityStats) {
        let mut visibility = VisibilityStats::new(100, 3);
        visibility.sum_weight =
            (0..100).map(|i| if i < 5 { 0.0 } else { 200.0 - i as f32 }).collect();
        visibility.exempt[99] = true;
        (vec![true; 100], visibility)
    }

    fn removed(relocation: &Relocation, frozen: usize) -> Vec<usize> {
        let (mut alive, visibility) = scene();
        let relocation = Relocation { frozen, pinned: 5, ..*relocation };
        let count = evict_lowest_contribution(&mut alive, &visibility, &relocation);
        let removed: Vec<usize> = (0..100).filter(|&i| !alive[i]).collect();
        assert_eq!(removed.len(), count);
        removed
    }

    const RELOCATION: Relocation =
        Relocation { share: 0.1, growth: 0.3, max_triangles: 100, frozen: 0, pinned: 0 };

    #[test]
    fn the_least_seen_go_when_there_is_no_room() {
        assert_eq!(removed(&RELOCATION, 0), (89..99).collect::<Vec<_>>());
        assert_eq!(
            removed(&Relocation { max_triangles: 111, ..RELOCATION }, 0),
            (89..99).collect::<Vec<_>>()
        );
        assert!(
            removed(&Relocation { max_triangles: 112, ..RELOCATION }, 0).is_empty(),
            "there is room"
        );
        assert!(removed(&Relocation { share: 0.0, ..RELOCATION }, 0).is_empty());
        // Frozen triangles do not count against the limit.
        assert_eq!(
            removed(&Relocation { max_triangles: 107, ..RELOCATION }, 3),
            (90..99).collect::<Vec<_>>()
        );
        assert!(removed(&Relocation { max_triangles: 108, ..RELOCATION }, 3).is_empty());
    }

    #[test]
    fn an_overfull_scene_comes_down_to_its_limit_step_by_step() {
        let still = Relocation { share: 0.0, ..RELOCATION };
        assert_eq!(
            removed(&Relocation { max_triangles: 95, ..still }, 0),
            (94..99).collect::<Vec<_>>()
        );
        assert_eq!(
            removed(&Relocation { max_triangles: 10, ..still }, 0),
            (89..99).collect::<Vec<_>>()
        );
        assert_eq!(
            removed(&Relocation { max_triangles: 10, ..RELOCATION }, 0).len(),
            19,
            "and makes room"
        );
        let (mut alive, visibility) = scene();
        let relocation = Relocation { max_triangles: 1, pinned: 5, ..still };
        for _ in 0..200 {
            evict_lowest_contribution(&mut alive, &visibility, &relocation);
        }
        assert_eq!(alive.iter().filter(|a| **a).count(), 6, "the pinned and the young stay");
    }

    #[test]
    fn no_more_go_than_grow_back() {
        assert_eq!(removed(&Relocation { share: 1.0, growth: 0.25, ..RELOCATION }, 0).len(), 20);
        assert!(removed(&Relocation { growth: 0.0, ..RELOCATION }, 0).is_empty());
        let mut alive = vec![true];
        let visibility = VisibilityStats::new(1, 1);
        let all = Relocation { share: 1.0, growth: 1e9, max_triangles: 1, ..RELOCATION };
        assert_eq!(
            evict_lowest_contribution(&mut alive, &visibility, &all),
            0,
            "a scene keeps its last triangle"
        );
    }
}
