//! The map between the steps of a run and positions in a schedule of 30,000 steps.
//!
//! Without milestones both are proportional. With milestones, each part between two of them is
//! stretched separately. So a run can change its remaining steps without changing earlier ones:
//! nothing before a milestone depends on a later one.

use super::options::{REFERENCE_STEPS, TrainOptions};

/// The positions, steps of a 30,000-step run, at which a run may change its remaining steps: when
/// photos change from a quarter to half their size, when engine shading begins, when photos have
/// their full size, and once more before the end.
pub(crate) const MILESTONES: [f64; 4] = [12_000.0, 20_000.0, 24_000.0, 27_000.0];

/// The distribution of a run's steps over its schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Timeline {
    steps: u64,
    /// Steps at which [`MILESTONES`] are reached; `None`: in proportion.
    milestones: Option<[u64; 4]>,
}

/// A part of a schedule between two milestones.
#[derive(Clone, Copy)]
struct TimelinePart {
    /// First and last position.
    positions: [f64; 2],
    /// First and last step.
    steps: [u64; 2],
}

impl Timeline {
    /// The timeline of these options.
    pub(crate) fn new(options: &TrainOptions) -> Self {
        let milestones = Some(options.milestones).filter(|milestones| *milestones != [0; 4]);
        Self { steps: options.steps, milestones }
    }

    /// The milestones of a proportional run of `steps` steps.
    pub(crate) fn proportional(steps: u64) -> [u64; 4] {
        let plain = Self { steps, milestones: None };
        MILESTONES.map(|position| plain.step_at(position))
    }

    /// True when its milestones are steps of its own.
    pub(crate) fn has_milestones(&self) -> bool {
        self.milestones.is_some()
    }

    /// The step at which `position`, of a 30,000-step run, is reached.
    pub(crate) fn step_at(&self, position: f64) -> u64 {
        let in_proportion = |steps: u64| (position * steps as f64 / REFERENCE_STEPS).round() as u64;
        if position > REFERENCE_STEPS {
            return in_proportion(self.steps).max(self.steps + 1);
        }
        match self.parts().into_iter().flatten().find(|part| position <= part.positions[1]) {
            Some(TimelinePart { positions: [from, until], steps: [first, last] }) => {
                let steps = (position - from) / (until - from) * (last - first) as f64;
                // A position after a milestone must stay after it when the next part is shortened.
                let begun = u64::from(position > from && last > first);
                first + (steps.round() as u64).max(begun)
            }
            None => in_proportion(self.steps),
        }
    }

    /// The position, of a 30,000-step run, that is reached after `step` steps.
    pub(crate) fn position(&self, step: u64) -> f64 {
        let in_proportion = step as f64 * REFERENCE_STEPS / self.steps.max(1) as f64;
        match self.part_of(step) {
            Some(TimelinePart { positions: [from, until], steps: [first, last] })
                if last > first =>
            {
                from + (step - first) as f64 * (until - from) / (last - first) as f64
            }
            Some(part) => part.positions[1],
            None => in_proportion,
        }
    }

    /// The part of step `step`; `None` for a proportional run.
    fn part_of(&self, step: u64) -> Option<TimelinePart> {
        let parts = self.parts()?;
        parts.iter().find(|part| step < part.steps[1]).or(parts.last()).copied()
    }

    fn parts(&self) -> Option<[TimelinePart; 5]> {
        let [a, b, c, d] = MILESTONES;
        let positions = [[0.0, a], [a, b], [b, c], [c, d], [d, REFERENCE_STEPS]];
        let [a, b, c, d] = self.milestones?;
        let steps = [[0, a], [a, b], [b, c], [c, d], [d, self.steps]];
        Some(std::array::from_fn(|i| TimelinePart { positions: positions[i], steps: steps[i] }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timeline(steps: u64, milestones: [u64; 4]) -> Timeline {
        Timeline::new(&TrainOptions { steps, milestones, ..TrainOptions::default() })
    }

    #[test]
    fn without_milestones_positions_are_in_proportion() {
        let plain = timeline(3000, [0; 4]);
        assert_eq!(plain.step_at(12_000.0), 1200);
        assert_eq!(plain.position(1500), 15_000.0);
        assert_eq!(Timeline::proportional(1000), [400, 667, 800, 900]);
    }

    #[test]
    fn each_part_is_stretched_by_itself() {
        let line = timeline(1000, [100, 500, 600, 800]);
        assert_eq!(MILESTONES.map(|position| line.step_at(position)), [100, 500, 600, 800]);
        assert_eq!(
            [100, 500, 600, 800, 1000].map(|step| line.position(step)),
            [12e3, 20e3, 24e3, 27e3, 30e3]
        );
        assert_eq!((line.step_at(6000.0), line.position(50)), (50, 6000.0));
        assert_eq!((line.step_at(30_000.0), line.step_at(16_000.0)), (1000, 300));
        assert!(line.step_at(40_000.0) > 1000);
    }

    #[test]
    fn nothing_before_a_milestone_depends_on_a_later_one() {
        let before = timeline(1003, [401, 669, 802, 903]);
        let after = timeline(77, [401, 669, 670, 680]);
        for step in 0..669 {
            assert_eq!(before.position(step), after.position(step));
        }
        for position in 0..20_000 {
            assert_eq!(before.step_at(position.into()), after.step_at(position.into()));
        }
        // At the milestone itself neither: all of the next part is still to come, if it is one
        // step.
        for position in 20_001..24_000 {
            assert!(before.step_at(position.into()) > 669 && after.step_at(position.into()) > 669);
        }
    }

    #[test]
    fn parts_without_steps_are_passed() {
        let line = timeline(10, [3, 3, 3, 10]);
        assert_eq!(line.position(3), 24_000.0);
        assert_eq!(line.position(10), 30_000.0);
        assert_eq!(line.step_at(20_000.0), 3);
    }
}
