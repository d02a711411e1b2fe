//! The way of a scene down to its limit of triangles: those that the photos show least are removed.
//!
//! The measure is the sum of a triangle's blending weights over all pixels of all photos, because even a triangle of one pixel can
//! have the largest single weight.

use super::visibility::VisibilityStats;

/// Largest share of an overfull scene that goes at once, so that the others close the gaps before more go.
const MAX_CUT: f64 = 0.1;

/// Removes what is too much for `max_triangles`, those of the least summed weight, but at most a share of [`MAX_CUT`]. Returns how many.
/// The first `frozen` do not count against the limit; the first `pinned`, which include them, stay.
pub(super) fn remove_excess(
    alive: &mut [bool],
    visibility: &VisibilityStats,
    (frozen, pinned): (usize, usize),
    max_triangles: usize,
) -> usize {
    let count = alive.iter().skip(frozen).filter(|a| **a).count();
    let kept = count.min(max_triangles.max((count as f64 * (1.0 - MAX_CUT)) as usize));
    if kept == count {
        return 0;
    }
    // Triangles younger than the statistics were not drawn for all photos.
    let candidates = (pinned..alive.len()).filter(|&i| alive[i] && !visibility.exempt[i]);
    let mut least: Vec<(f32, usize)> = candidates.map(|i| (visibility.sum_weight[i], i)).collect();
    least.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    least.truncate(count - kept);
    least.iter().for_each(|&(_, i)| alive[i] = false);
    least.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 triangles with falling visibility; the first five are pinned, the last one is young.
    fn scene() -> (Vec<bool>, VisibilityStats) {
        let mut visibility = VisibilityStats::new(100, 3);
        visibility.sum_weight = (0..100).map(|i| if i < 5 { 0.0 } else { 200.0 - i as f32 }).collect();
        visibility.exempt[99] = true;
        (vec![true; 100], visibility)
    }

    fn removed(max_triangles: usize, frozen: usize) -> Vec<usize> {
        let (mut alive, visibility) = scene();
        let count = remove_excess(&mut alive, &visibility, (frozen, 5), max_triangles);
        let removed: Vec<usize> = (0..100).filter(|&i| !alive[i]).collect();
        assert_eq!(removed.len(), count);
        removed
    }

    #[test]
    fn an_overfull_scene_comes_down_to_its_limit_step_by_step() {
        assert!(removed(100, 0).is_empty() && removed(1000, 0).is_empty(), "it is not too large");
        assert_eq!(removed(95, 0), (94..99).collect::<Vec<_>>());
        assert_eq!(removed(10, 0), (89..99).collect::<Vec<_>>());
        assert_eq!(
            removed(95, 3),
            (97..99).collect::<Vec<_>>(),
            "frozen triangles do not count against the limit"
        );
        let (mut alive, visibility) = scene();
        for _ in 0..200 {
            remove_excess(&mut alive, &visibility, (0, 5), 1);
        }
        assert_eq!(alive.iter().filter(|a| **a).count(), 6, "the pinned and the young stay");
    }
}
