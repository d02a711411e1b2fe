//! Measures the speed of this machine on this scene, by a few steps of a run that is discarded.

use super::cost::{Calibration, CostModel, StepLoad};
use crate::cpu::CpuBackend;
use crate::eval::Evaluator;
use crate::identity::RunIdentity;
use crate::options::{REFERENCE_STEPS, SolidifyOptions, TrainOptions, WarmupOptions};
use crate::pyramid::{MIN_PX, size_at};
use crate::start::FirstScene;
use crate::trainer::Trainer;
use trisplat_dataset::{Dataset, Photo, View};
use trisplat_raster::soft::{SoftOptions, Window};
use trisplat_scene::{Error, ImportedScene, Result, Spending};

/// Most photos to try.
const PHOTOS: usize = 4;

/// Share of the budget for decoding; when it is spent, fewer photos are used.
const MOST_SHARE: f64 = 0.02;

/// Steps are repeated until they take this long, because some clocks advance only every 16 ms.
const LEAST_SECS: f64 = 0.05;

/// Most repetitions.
const MOST_ROUNDS: u32 = 50;

/// Measures on a few photos of `dataset`, until `spending` reaches its share of `budget_secs`.
///
/// Errors: those of [`Trainer::start`], photos that cannot be decoded.
pub fn calibrate(
    dataset: &Dataset,
    from: Option<&ImportedScene>,
    options: &TrainOptions,
    background: [f32; 3],
    spending: &Spending,
    budget_secs: f64,
) -> Result<Calibration> {
    let (tried, decode_secs) = few_photos(dataset, spending, MOST_SHARE * budget_secs)?;
    let trial = Trial { dataset: &tried, from, background, spending };
    let (soft, triangles) = trial.run(options, false)?;
    let engine = match options.ends_solid() {
        true => trial.run(options, true)?.0,
        false => soft,
    };
    let evaluate_secs = trial.evaluate(dataset, options)?;
    let model = CostModel { scale: [soft, engine] };
    Ok(Calibration { model, triangles, decode_secs, evaluate_secs })
}

/// The data set with a few of its training photos in memory, and the seconds for decoding each.
fn few_photos(dataset: &Dataset, spending: &Spending, most_secs: f64) -> Result<(Dataset, f64)> {
    let views: Vec<&View> = dataset.train().collect();
    let clock = spending.seconds();
    let mut few = Vec::new();
    for i in 0..PHOTOS.min(views.len()) {
        let view = views[i * views.len() / PHOTOS.min(views.len())];
        few.push(View { photo: Photo::drawn(view.photo.decode()?), ..view.clone() });
        if spending.seconds() - clock > most_secs {
            break;
        }
    }
    let secs = (spending.seconds() - clock) / few.len().max(1) as f64;
    Ok((Dataset { views: few, ..dataset.clone() }, secs))
}

/// Steps that are thrown away.
struct Trial<'a> {
    dataset: &'a Dataset,
    from: Option<&'a ImportedScene>,
    background: [f32; 3],
    spending: &'a Spending,
}

impl Trial<'_> {
    fn start(&self, options: &TrainOptions) -> Result<Trainer<CpuBackend>> {
        let identity = RunIdentity::of(self.dataset, self.background, self.from);
        let backend = CpuBackend::new(options.drawing(self.background));
        Trainer::start(self.dataset, self.from.map(FirstScene::whole), options, identity, u64::MAX, backend)
    }

    /// Measured seconds of steps over those of the model, and the number of triangles. Photos have half their
    /// size; each gets one step after one that allocates.
    fn run(&self, options: &TrainOptions, engine_shading: bool) -> Result<(f64, u64)> {
        let opacity_until = if engine_shading { 0.0 } else { REFERENCE_STEPS };
        let trial = TrainOptions {
            // Positions of the schedule equal steps of this run, so its first few steps contain nothing else.
            steps: REFERENCE_STEPS as u64,
            milestones: [0; 4],
            warmup: WarmupOptions { quarter_until: 0.0, half_until: REFERENCE_STEPS },
            solid: SolidifyOptions { opacity_until, ..options.solid.clone() },
            ..options.clone()
        };
        let mut trainer = self.start(&trial)?;
        let triangles = trainer.triangles() as u64;
        trainer.step()?;
        let before = self.spending.seconds();
        let (mut expected, mut taken) = (0.0, 0.0);
        for _ in 0..MOST_ROUNDS {
            for view in &self.dataset.views {
                trainer.step()?;
                let pixels = size_at(view.photo.size, 1, MIN_PX).as_dvec2().element_product();
                let load = StepLoad { pixels, triangles: triangles as f64, engine_shading, geometry: false };
                expected += CostModel::FITTED.step_secs(&load);
            }
            taken = self.spending.seconds() - before;
            if taken >= LEAST_SECS {
                break;
            }
        }
        match taken > 0.0 {
            true => Ok((taken / expected, triangles)),
            false => Err(Error::invalid(
                "budget",
                "in CPU time",
                "a system that reports CPU time, or `budget_wall`",
            )),
        }
    }

    /// Seconds to draw the first scene for a held-out photo and to compare them; 0 when none is held out.
    fn evaluate(&self, dataset: &Dataset, options: &TrainOptions) -> Result<f64> {
        let Some(view) = dataset.test().next() else { return Ok(0.0) };
        let mut evaluator = Evaluator::new(&[view], u64::MAX)?;
        let mut trainer = self.start(options)?;
        let (soup, space) = (trainer.soup()?, trainer.space());
        let soft = options.drawing(self.background);
        let window = if options.ends_solid() { Window::Coverage { width_px: 1.0 } } else { soft.window };
        let before = self.spending.seconds();
        evaluator.scores(&soup, &space, &SoftOptions { window, ..soft })?;
        Ok(self.spending.seconds() - before)
    }
}
