//! Room for growth in a scene at its limit of triangles, and the way down to it: those that the
//! photos show least are removed.
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

/// The room that a densification makes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relocation {
    /// Share of the triangles to remove.
    pub(super) share: f64,
    /// Maximum number of triangles that a densification adds, as a share of the present ones.
    pub(super) growth: f64,
    /// Maximum number of triangles that are trained.
    pub(super) max_triangles: usize,
}

/// Removes a share of the triangles of a full scene, those of the least summed weight, but no more
/// than grow back; of an overfull one also what is too much, step by step. Returns how many. The
/// first `frozen` do not count against the limit; the first `pinned`, which include them, stay.
pub(super) fn make_room(
    alive: &mut [bool],
    visibility: &VisibilityStats,
    (frozen, pinned): (usize, usize),
    room: &Relocation,
) -> usize {
    let count = alive.iter().skip(frozen).filter(|a| **a).count();
    if (count as f64) < FULL * room.max_triangles as f64 {
        return 0;
    }
    let kept = count.min(room.max_triangles.max((count as f64 * (1.0 - MAX_CUT)) as usize));
    let moves = (kept as f64 * room.share.min(room.growth / (1.0 + room.growth))) as usize;
    // Triangles younger than the statistics were not drawn for all photos.
    let candidates = (pinned..alive.len()).filter(|&i| alive[i] && !visibility.exempt[i]);
    let mut least: Vec<(f32, usize)> = candidates.map(|i| (visibility.sum_weight[i], i)).collect();
    least.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    least.truncate(count - kept + moves);
    least.iter().for_each(|&(_, i)| alive[i] = false);
    least.len()
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

    fn removed(room: &Relocation, frozen: usize) -> Vec<usize> {
        let (mut alive, visibility) = scene();
        let count = make_room(&mut alive, &visibility, (frozen, 5), room);
        let removed: Vec<usize> = (0..100).filter(|&i| !alive[i]).collect();
        assert_eq!(removed.len(), count);
        removed
    }

    const RELOCATION: Relocation = Relocation { share: 0.1, growth: 0.3, max_triangles: 100 };

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
        let room = Relocation { max_triangles: 1, ..still };
        for _ in 0..200 {
            make_room(&mut alive, &visibility, (0, 5), &room);
        }
        assert_eq!(alive.iter().filter(|a| **a).count(), 6, "the pinned and the young stay");
    }

    #[test]
    fn no_more_go_than_grow_back() {
        assert_eq!(removed(&Relocation { share: 1.0, growth: 0.25, ..RELOCATION }, 0).len(), 20);
        assert!(removed(&Relocation { growth: 0.0, ..RELOCATION }, 0).is_empty());
        let mut alive = vec![true];
        let visibility = VisibilityStats::new(1, 1);
        let all = Relocation { share: 1.0, growth: 1e9, max_triangles: 1 };
        assert_eq!(
            make_room(&mut alive, &visibility, (0, 0), &all),
            0,
            "a scene keeps its last triangle"
        );
    }
}
