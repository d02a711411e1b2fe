//! `trisplat train --budget`: what is chosen, before the run begins.

use super::layers;
use super::train_args::TrainArgs;
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::scene::Loaded;
use crate::train::TrainOptions;
use crate::train::budget::{Budget, Pace, Paced, PlanInput, Spending, calibrate, plan};
use clap::ArgMatches;
use std::time::Instant;

/// A run as its budget wants it.
pub(super) struct Planned {
    /// The photos, in the size that was chosen.
    pub dataset: Dataset,
    /// The options, with what was chosen.
    pub options: TrainOptions,
    /// What keeps the run to its budget.
    pub paced: Option<Paced>,
}

/// The budget that was given.
pub(super) fn given(args: &TrainArgs) -> Option<Budget> {
    args.budget.map(Budget::cpu).or_else(|| args.budget_wall.map(Budget::wall))
}

/// Refuses settings that a budget chooses.
pub(super) fn check(args: &TrainArgs) -> Result<()> {
    let chosen = |set: &&String| ["steps=", "milestones="].iter().any(|key| set.starts_with(key));
    match given(args).and(args.sets.iter().find(chosen)) {
        Some(set) => Err(Error::invalid("--set", set, "to be without `budget`, which chooses the steps")),
        None => Ok(()),
    }
}

/// What a run with a budget is planned with.
#[derive(Clone, Copy)]
pub(super) struct Planning<'a> {
    pub args: &'a TrainArgs,
    pub matches: &'a ArgMatches,
    /// The budget, if there is one.
    pub budget: Option<Budget>,
    /// The scene that the run starts from.
    pub from: Option<&'a Loaded>,
    /// When the command began: the budget counts from here.
    pub began: Instant,
}

impl Planning<'_> {
    /// Measures, and chooses steps, triangles and the size of photos. `how` is how `dataset` was read; it gets the size.
    ///
    /// Errors: those of the first steps, photos that cannot be decoded, a budget that is too small.
    pub(super) fn plan(
        self,
        dataset: Dataset,
        options: TrainOptions,
        how: &mut DatasetOptions,
    ) -> Result<Planned> {
        let Self { args, matches, budget, from, began } = self;
        let Some(budget) = budget else { return Ok(Planned { dataset, options, paced: None }) };
        let spending = Spending::of_process(budget.clock, began);
        let (background, secs) = (how.background.to_f32(), budget.seconds.0);
        let calibration = calibrate(&dataset, from, &options, background, &spending, secs)?;
        let preset = TrainOptions::preset(options.preset);
        let input = PlanInput {
            triangles_given: layers::is_typed(matches, "max_triangles")
                || options.max_triangles != preset.max_triangles,
            size_given: how.max_size.is_some() || args.dataset.is_none(),
            from_scene: from.is_some(),
            ..PlanInput::new(&dataset, &options, budget, spending.seconds(), calibration)
        };
        let plan = plan(&input)?;
        let pace = Pace::new(&input, &plan, spending.seconds());
        let options = plan.apply(&options);
        let dataset = match (plan.max_size, &args.dataset) {
            (Some(_), Some(path)) => {
                how.max_size = plan.max_size;
                // Nothing of it was decoded but a few photos.
                Dataset::load(path, how)?
            }
            _ => dataset,
        };
        Ok(Planned { dataset, options, paced: Some(Paced { pace, spending }) })
    }
}
