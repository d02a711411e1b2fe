//! Room for growth in a scene that has all the triangles it may have: those that the photos show least go.
//!
//! Pruning removes only useless triangles: slivers and hidden ones. Once a scene is full, that is too little for growth to go on
//! where the picture is wrong. How much is seen of a triangle is the sum of its blending weights over all pixels of all
//! photos: a triangle that fills one pixel and no other has the largest weight there is.

use super::visibility::VisibilityStats;

/// A scene has all its triangles when it has this share of them: pruning has just taken some.
const FULL: f64 = 0.9;

/// How much room a refinement makes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relocation {
    /// This share of the triangles goes.
    pub(super) share: f64,
    /// Triangles a refinement adds at most, as a share of those there.
    pub(super) growth: f64,
    /// The most triangles that are trained.
    pub(super) max_triangles: usize,
}

/// Removes a share of the triangles of a full scene, those of the least summed weight, and no more than grow back; returns
/// how many. The first `frozen` are in no budget; the first `pinned`, at least as many, stay.
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
    let goes = (count as f64 * room.share.min(room.growth / (1.0 + room.growth))) as usize;
    // What is younger than the statistics has not been seen by all photos.
    let candidates = (pinned..alive.len()).filter(|&i| alive[i] && !visibility.exempt[i]);
    let mut least: Vec<(f32, usize)> = candidates.map(|i| (visibility.sum_weight[i], i)).collect();
    least.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    least.truncate(goes);
    least.iter().for_each(|&(_, i)| alive[i] = false);
    least.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 100 triangles, the later, the less is seen of them; the first five are pinned, the last one is young.
    fn scene() -> (Vec<bool>, VisibilityStats) {
        let mut visibility = VisibilityStats::new(100, 3);
        visibility.sum_weight = (0..100).map(|i| if i < 5 { 0.0 } else { 200.0 - i as f32 }).collect();
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
        assert!(removed(&Relocation { max_triangles: 112, ..RELOCATION }, 0).is_empty(), "there is room");
        assert!(removed(&Relocation { share: 0.0, ..RELOCATION }, 0).is_empty());
        // Those that are not trained are not in the budget.
        assert_eq!(
            removed(&Relocation { max_triangles: 107, ..RELOCATION }, 3),
            (90..99).collect::<Vec<_>>()
        );
        assert!(removed(&Relocation { max_triangles: 108, ..RELOCATION }, 3).is_empty());
    }

    #[test]
    fn no_more_go_than_grow_back() {
        assert_eq!(removed(&Relocation { share: 1.0, growth: 0.25, ..RELOCATION }, 0).len(), 20);
        assert!(removed(&Relocation { growth: 0.0, ..RELOCATION }, 0).is_empty());
        let (mut alive, visibility) = (vec![true], VisibilityStats::new(1, 1));
        let all = Relocation { share: 1.0, growth: 1e9, max_triangles: 1 };
        assert_eq!(make_room(&mut alive, &visibility, (0, 0), &all), 0, "a scene keeps its last triangle");
    }
}
