//! A backend that is some steps behind changes nothing of a run, and one that gets lost leaves a
//! checkpoint.

use super::{options, scene, small};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::ops::ControlFlow::Continue;
use trisplat_scene::{Error, Result};
use trisplat_train::{
    BackendVisibility, CpuBackend, OptimizerState, Params, StepParams, StepPhoto, StepStats,
    TrainBackend, TrainEvent, TrainInputs, TrainOutputs, TrainSample, checkpoint,
};

/// The CPU's backend, which keeps figures of the last steps to itself, and is lost after some of
/// them.
#[derive(Debug)]
struct Late {
    cpu: CpuBackend,
    figures: VecDeque<StepStats>,
    steps_left: u64,
    loaded: Option<OptimizerState>,
}

/// Steps whose figures are not known yet.
const BEHIND: usize = 3;

impl Late {
    fn new(run: &TrainInputs<'_>, steps_left: u64) -> Self {
        let cpu = CpuBackend::new(run.drawing());
        Self { cpu, figures: VecDeque::new(), steps_left, loaded: None }
    }

    fn check(&self) -> Result<()> {
        if self.steps_left > 0 { Ok(()) } else { Err(Error::Gpu("lost".into())) }
    }
}

impl TrainBackend for Late {
    fn load(&mut self, state: OptimizerState) -> Result<()> {
        self.loaded = Some(state.clone());
        self.cpu.load(state)
    }

    fn step(&mut self, photo: &StepPhoto<'_>, rates: &StepParams) -> Result<()> {
        self.check()?;
        self.steps_left -= 1;
        self.cpu.step(photo, rates)
    }

    fn figures(&mut self, all: bool) -> Result<Vec<StepStats>> {
        self.check()?;
        self.figures.extend(self.cpu.figures(true)?);
        let known =
            if all { self.figures.len() } else { self.figures.len().saturating_sub(BEHIND) };
        Ok(self.figures.drain(..known).collect())
    }

    fn take_visibility(&mut self) -> Result<BackendVisibility> {
        self.check()?;
        self.cpu.take_visibility()
    }

    fn store(&mut self) -> Result<OptimizerState> {
        self.check()?;
        self.loaded = None;
        self.cpu.store()
    }

    fn params(&mut self) -> Result<Cow<'_, Params>> {
        self.check()?;
        self.cpu.params()
    }

    fn can_be_lost(&self) -> bool {
        true
    }

    fn rescued(&mut self) -> Option<OptimizerState> {
        self.loaded.take()
    }

    fn len(&self) -> usize {
        self.cpu.len()
    }
}

/// Without times.
fn plain(curve: &[TrainSample]) -> Vec<TrainSample> {
    curve.iter().map(|sample| TrainSample { cpu_secs: 0.0, wall_secs: 0.0, ..*sample }).collect()
}

#[test]
fn figures_that_come_late_are_all_in_the_curve() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &small());
    let options = options(60);
    let run = |name: &str| {
        let checkpoint = Some(folder.path().join(name));
        let outputs = TrainOutputs {
            checkpoint,
            checkpoint_every: 25,
            sample_every: 7,
            ..TrainOutputs::default()
        };
        TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) }
    };
    let waiting = run("a.checkpoint").run(&mut |_| Continue(())).unwrap();
    let late = run("b.checkpoint");
    let backend = Late::new(&late, u64::MAX);
    let late = late.start_with(Box::new(backend)).unwrap().finish(&mut |_| Continue(())).unwrap();
    assert_eq!(plain(&late.curve), plain(&waiting.curve));
    assert_eq!((late.soup, late.scores), (waiting.soup, waiting.scores));
    let [a, b] = ["a", "b"]
        .map(|name| checkpoint::read(&folder.path().join(format!("{name}.checkpoint"))).unwrap());
    assert_eq!(
        (a.state, a.visibility, plain(&a.meta.curve)),
        (b.state, b.visibility, plain(&b.meta.curve))
    );
}

#[test]
fn backend_lost_leaves_the_scene_of_the_last_refinement() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &small());
    let options = options(60);
    let straight = TrainInputs::new(&dataset, &options).run(&mut |_| Continue(())).unwrap();
    let path = folder.path().join("a.checkpoint");
    let outputs =
        TrainOutputs { checkpoint: Some(path.clone()), sample_every: 1, ..TrainOutputs::default() };
    let run = TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) };
    let backend = Late::new(&run, 40);
    let mut seen = Vec::new();
    let error = run.start_with(Box::new(backend)).unwrap().finish(&mut |event| {
        if let TrainEvent::Densified(step, _) = event {
            seen.push(step);
        }
        Continue(())
    });
    let error = error.unwrap_err();
    let step = *seen.last().unwrap();
    let remedy = format!(
        "gpu: lost; to continue from step {step}: `backend` cpu `resume` {}",
        path.display()
    );
    assert_eq!(error.to_string(), remedy);
    let checkpoint = checkpoint::read(&path).unwrap();
    assert!(step > 0 && step < 40 && checkpoint.meta.step == step);
    assert_eq!(checkpoint.meta.curve.last().map(|sample| sample.step), Some(step));
    let rest =
        TrainInputs::from_checkpoint(&dataset, checkpoint).run(&mut |_| Continue(())).unwrap();
    assert_eq!(rest.soup, straight.soup);
}
