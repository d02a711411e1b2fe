//! Plans a bake's seconds for pictures, rounds of fitting and colours, by pure functions of measured costs.

/// With fewer pictures, triangles and colours would be fitted to a few places only.
pub(super) const FEWEST_PICTURES: usize = 6;
/// With fewer rounds, fitting gains less than it costs.
const FEWEST_ROUNDS: u32 = 3;
/// Cost of the colours of one picture, in solid pictures: it is compared with the triangles, and some
/// pictures are drawn four times more to evaluate.
const COLOR: f64 = 2.6;
/// Cost of the colours of one picture per triangle, seconds: reading its equations from memory.
const COLOR_TRIANGLE_SECS: f64 = 1e-7;
/// Cost of one picture of a round of fitting, in solid pictures, before a round was measured.
const ROUND: f64 = 2.5;
/// Pictures of a round, about.
const ROUND_PICTURES: usize = 12;
/// Pictures that decide at the end whether the fitted triangles are better than the original ones.
const EVALUATION_PICTURES: usize = 12;

/// Known costs, seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PictureCosts {
    /// One soft picture.
    pub soft: f64,
    /// One picture of solid triangles.
    pub solid: f64,
    /// Triangles of the scene.
    pub triangles: usize,
}

/// What remains to be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaceInput {
    /// Seconds for pictures, fitting and colours.
    pub left_secs: f64,
    /// What they cost.
    pub costs: PictureCosts,
    /// Pictures drawn already.
    pub drawn: usize,
    /// Most pictures.
    pub most_pictures: usize,
    /// Most rounds of fitting; 0: it is off.
    pub most_rounds: u32,
    /// Passes over the pictures for colours; 0: colours stay.
    pub color_passes: u32,
}

/// A plan for the seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PacePlan {
    /// Pictures in all.
    pub pictures: usize,
    /// Rounds of fitting.
    pub rounds: u32,
}

/// Seconds for the colours of `pictures`.
pub(super) fn color_secs(pictures: usize, passes: u32, costs: &PictureCosts) -> f64 {
    let one = COLOR * costs.solid + COLOR_TRIANGLE_SECS * costs.triangles as f64;
    pictures as f64 * f64::from(passes) * one
}

/// Seconds for the comparison after fitting.
pub(super) fn evaluation_secs(pictures: usize, costs: &PictureCosts) -> f64 {
    2.0 * pictures.min(EVALUATION_PICTURES) as f64 * costs.solid
}

/// Seconds for a round of fitting to at most `pictures`.
pub(super) fn round_secs(pictures: usize, costs: &PictureCosts) -> f64 {
    ROUND * pictures.min(ROUND_PICTURES) as f64 * costs.solid
}

/// The most rounds of `round_secs` that fit into `left_secs`; none if they are too few to gain anything.
pub(super) fn rounds(left_secs: f64, round_secs: f64, most: u32) -> u32 {
    let fit = whole_rounds(left_secs, round_secs, most);
    if fit < FEWEST_ROUNDS.min(most) { 0 } else { fit }
}

/// As many rounds as fit.
pub(super) fn whole_rounds(left_secs: f64, round_secs: f64, most: u32) -> u32 {
    (left_secs / round_secs.max(1e-9)).clamp(0.0, f64::from(most)) as u32
}

/// The most pictures that fit with their colours, then rounds for the rest: triangles fitted to only a few
/// pictures look wrong from other places (docs/benchmarks/bake-budget.md). `None` when there is no time to
/// use pictures.
pub fn plan(input: &PaceInput) -> Option<PacePlan> {
    let least = FEWEST_PICTURES.min(input.most_pictures).max(input.drawn);
    (least..=input.most_pictures).rev().find_map(|pictures| with_pictures(input, pictures))
}

/// Seconds left for fitting after `pictures` and their colours; `None` when even these do not fit.
fn with_pictures(input: &PaceInput, pictures: usize) -> Option<PacePlan> {
    let PaceInput { left_secs, costs, drawn, most_rounds, color_passes, .. } = *input;
    let drawing = (pictures - drawn) as f64 * costs.soft;
    let left = left_secs - drawing - color_secs(pictures, color_passes, &costs);
    let left_after = left - evaluation_secs(pictures, &costs);
    let rounds = rounds(left_after, round_secs(pictures, &costs), most_rounds);
    let useful = left >= 0.0 && (color_passes > 0 || rounds > 0);
    useful.then_some(PacePlan { pictures, rounds })
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUT: PaceInput = PaceInput {
        left_secs: 5.0,
        costs: PictureCosts { soft: 0.1, solid: 0.02, triangles: 0 },
        drawn: 1,
        most_pictures: 32,
        most_rounds: 16,
        color_passes: 1,
    };

    fn with(left_secs: f64) -> Option<PacePlan> {
        plan(&PaceInput { left_secs, ..INPUT })
    }

    fn secs(plan: PacePlan) -> f64 {
        let PaceInput { costs, drawn, color_passes, .. } = INPUT;
        let evaluation = if plan.rounds > 0 { evaluation_secs(plan.pictures, &costs) } else { 0.0 };
        (plan.pictures - drawn) as f64 * costs.soft
            + color_secs(plan.pictures, color_passes, &costs)
            + f64::from(plan.rounds) * round_secs(plan.pictures, &costs)
            + evaluation
    }

    #[test]
    fn plans_fit_and_more_time_buys_no_fewer_pictures() {
        let mut before = PacePlan::default();
        for tenths in 8..200 {
            let left = f64::from(tenths) / 10.0;
            let Some(plan) = with(left) else { continue };
            assert!(secs(plan) <= left + 1e-9, "{left}: {plan:?} takes {}", secs(plan));
            assert!(plan.pictures >= before.pictures, "{left}: {plan:?}");
            assert!(plan.rounds == 0 || plan.pictures == 32, "{left}: {plan:?}");
            before = plan;
        }
        assert_eq!(before, PacePlan { pictures: 32, rounds: 16 });
    }

    #[test]
    fn what_pictures_are_not_good_for_is_not_drawn() {
        assert_eq!(with(0.3), None, "no time for the colours of the fewest pictures");
        assert_eq!(with(-1.0), None);
        let unused = PaceInput { color_passes: 0, most_rounds: 0, left_secs: 1e9, ..INPUT };
        assert_eq!(plan(&unused), None);
        // Finished pictures are kept.
        let late = PaceInput { drawn: 20, left_secs: 3.0, ..INPUT };
        assert!(plan(&late).is_some_and(|plan| plan.pictures >= 20));
    }

    #[test]
    fn colours_of_many_triangles_take_longer() {
        let many = PictureCosts { triangles: 1_000_000, ..INPUT.costs };
        assert!((color_secs(10, 1, &many) - color_secs(10, 1, &INPUT.costs) - 1.0).abs() < 1e-9);
        let fewer = plan(&PaceInput { costs: many, ..INPUT }).map(|plan| plan.pictures);
        assert!(fewer < with(INPUT.left_secs).map(|plan| plan.pictures), "{fewer:?}");
    }

    #[test]
    fn a_scene_of_few_cameras_is_drawn_from_all() {
        let few = PaceInput { most_pictures: 3, left_secs: 9.0, ..INPUT };
        assert_eq!(plan(&few), Some(PacePlan { pictures: 3, rounds: 16 }));
    }

    #[test]
    fn too_few_rounds_are_none() {
        assert_eq!((rounds(1.0, 0.4, 16), rounds(1.3, 0.4, 16), rounds(99.0, 0.4, 16)), (0, 3, 16));
        assert_eq!((rounds(-1.0, 0.4, 16), rounds(1.0, 0.4, 2)), (0, 2));
    }
}
