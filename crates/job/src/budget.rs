//! Choices for a training with a budget, before it begins.

use trisplat_dataset::{Dataset, DatasetKind, DatasetOptions};
use trisplat_scene::{
    Budget, Error, ImportedScene, Result, Spending,
    layered::{Layered, Origin},
};
use trisplat_train::{
    TrainOptions,
    budget::{BudgetController, Paced, PlanInput, StepLimit, calibrate, plan},
};

/// Refuses options that a budget chooses, whichever layer sets them.
pub(crate) fn check(budget: Option<Budget>, options: &Layered<TrainOptions>) -> Result<()> {
    let Some(budget) = budget else { return Ok(()) };
    let TrainOptions { steps, milestones, .. } = &options.options;
    for (key, value) in [("steps", steps.to_string()), ("milestones", format!("{milestones:?}"))] {
        let layer = match options.origin(key) {
            Origin::Preset => continue,
            Origin::File => " of `config`",
            Origin::Setting => " of `sets`",
            Origin::Given => "",
        };
        let wants = format!("to be left out{layer}: `{}` chooses the steps", budget.option());
        return Err(Error::invalid(key, value, wants));
    }
    Ok(())
}

/// A training adapted to its budget.
pub(super) struct Budgeted {
    /// The photos in the chosen size.
    pub(super) dataset: Dataset,
    /// The options with all choices.
    pub(super) options: TrainOptions,
    /// The pace of the run.
    pub(super) paced: Option<Paced>,
}

/// Measures the machine and chooses steps, triangles and the size of photos. The run on `dataset` starts from the scene `from`, if
/// any, and gets at most `enough`. `spending` is the clock of its budget. `how`, the options that `dataset` was read with, receives the size.
///
/// Errors: those of the first steps; photos that cannot be decoded; a budget that is too small.
pub(super) fn budgeted(
    dataset: Dataset,
    options: Layered<TrainOptions>,
    from: Option<&ImportedScene>,
    budget: Option<Budget>,
    enough: StepLimit,
    spending: Spending,
    how: &mut DatasetOptions,
) -> Result<Budgeted> {
    let triangles_given = options.is_given("max_triangles");
    let Some(budget) = budget else {
        let options = with_fewer_steps(options.options, enough.steps, triangles_given);
        return Ok(Budgeted { dataset, options, paced: None });
    };
    let options = options.options;
    let (background, secs) = (how.background.to_f32(), budget.seconds.0);
    let calibration = calibrate(&dataset, from, &options, background, &spending, secs)?;
    let input = PlanInput {
        triangles_given,
        size_given: how.max_size.is_some() || dataset.kind == DatasetKind::Drawn,
        from_scene: from.is_some(),
        enough,
        ..PlanInput::new(&dataset, &options, budget, spending.seconds(), calibration)
    };
    let plan = plan(&input)?;
    let pace = BudgetController::new(&input, &plan, spending.seconds());
    let options = plan.apply(&options);
    let dataset = match plan.max_size {
        Some(_) => {
            how.max_size = plan.max_size;
            // Only a few photos were decoded so far.
            Dataset::load(&dataset.path, how)?
        }
        None => dataset,
    };
    Ok(Budgeted { dataset, options, paced: Some(Paced { pace, spending }) })
}

/// `options` with at most `most` steps, and proportionally fewer triangles unless they are given.
pub(super) fn with_fewer_steps(
    options: TrainOptions,
    most: Option<u64>,
    triangles_given: bool,
) -> TrainOptions {
    let Some(steps) = most.filter(|most| *most < options.steps) else { return options };
    let fewer = options.max_triangles as f64 * steps as f64 / options.steps as f64;
    let max_triangles = if triangles_given { options.max_triangles } else { (fewer as u64).max(1) };
    TrainOptions { steps: steps.max(1), max_triangles, ..options }
}
