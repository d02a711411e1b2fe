//! A whole run: steps, checkpoints, judgements on the held-out photos, previews and the curve.

use super::backend::Backend;
use super::checkpoint;
use super::clock::cpu_secs;
use super::eval::{self, Judge, Score};
use super::progress::{Sample, Watcher};
use super::trainer::{Stepped, Trainer};
use crate::dataset::Dataset;
use crate::error::{Error, Result};
use crate::raster::soft::SoftOptions;
use crate::soup::Soup;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What a run leaves behind on the way; nothing here changes the result.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Where checkpoints go.
    pub checkpoint: Option<PathBuf>,
    /// Steps between checkpoints; 0 writes one only when the run is stopped.
    pub checkpoint_every: u64,
    /// Steps between samples of the curve; 0 chooses 100 samples a run.
    pub sample_every: u64,
    /// Steps between judgements on the held-out photos; 0 judges once, at the end.
    pub test_every_steps: u64,
    /// Folder of preview pictures and the time between them.
    pub preview: Option<(PathBuf, Duration)>,
    /// Stop, as if asked to, after this many CPU seconds; 0 never.
    pub max_cpu_secs: f64,
}

/// What came out of a run.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The scene, in the data set's world.
    pub soup: Soup,
    /// Steps made; fewer than planned when the run was stopped.
    pub steps: u64,
    /// The curve.
    pub curve: Vec<Sample>,
    /// The held-out photos at the end.
    pub scores: Vec<Score>,
    /// Gradients dropped because they were not finite.
    pub dropped: u64,
    /// CPU seconds of the training, judgements excluded.
    pub cpu_secs: f64,
    /// The run was stopped before its last step.
    pub stopped: bool,
}

/// Runs `trainer` to its end or until `watcher` wants to stop.
/// `curve` and `cpu_secs_before` are those of the run this one resumes.
pub fn run<B: Backend>(
    mut trainer: Trainer<B>,
    dataset: &Dataset,
    drawing: &SoftOptions,
    options: &RunOptions,
    curve: Vec<Sample>,
    cpu_secs_before: f64,
    watcher: &mut dyn Watcher,
) -> Result<Trained> {
    let total = trainer.options().steps;
    let every = if options.sample_every == 0 { total.div_ceil(100) } else { options.sample_every };
    let mut run = Run {
        judge: Judge::new(dataset.test())?,
        drawing,
        curve,
        means: Means::default(),
        // Decoding the held-out photos is not training.
        cpu_start: cpu_secs() - cpu_secs_before,
        wall: Instant::now(),
        preview: Instant::now(),
    };
    let (mut stopped, mut last) = (false, None);
    while !trainer.is_done() {
        let stepped = trainer.step()?;
        let now = run.sample(&trainer, &stepped);
        watcher.stepped(&now);
        if let Some(refined) = &stepped.refined {
            watcher.refined(now.step, refined);
        }
        let spent = options.max_cpu_secs > 0.0 && now.cpu_secs >= options.max_cpu_secs;
        stopped = !trainer.is_done() && (spent || watcher.wants_to_stop());
        let due = |every: u64| every > 0 && now.step.is_multiple_of(every);
        // The last sample is kept by `finish`, which judges it.
        if !trainer.is_done() && (due(every) || due(options.test_every_steps)) {
            let kept = run.keep(now, &mut trainer, due(options.test_every_steps))?;
            if !stopped {
                watcher.sampled(&kept);
            }
        }
        if stopped || due(options.checkpoint_every) {
            run.checkpoint(&mut trainer, options)?;
        }
        run.preview(&mut trainer, options)?;
        last = Some(now);
        if stopped {
            break;
        }
    }
    run.finish(&mut trainer, last, stopped, watcher)
}

/// Averages since the last sample.
#[derive(Default)]
struct Means {
    loss: f64,
    mse: f64,
    steps: u64,
}

struct Run<'a> {
    judge: Judge,
    drawing: &'a SoftOptions,
    curve: Vec<Sample>,
    means: Means,
    cpu_start: f64,
    wall: Instant,
    preview: Instant,
}

impl Run<'_> {
    /// The state after a step, averaged since the last sample.
    fn sample<B: Backend>(&mut self, trainer: &Trainer<B>, stepped: &Stepped) -> Sample {
        self.means.loss += stepped.stats.loss;
        self.means.mse += stepped.stats.mse;
        self.means.steps += 1;
        let n = self.means.steps as f64;
        Sample {
            step: trainer.steps(),
            triangles: trainer.triangles() as u64,
            loss: self.means.loss / n,
            psnr: -10.0 * (self.means.mse / n).max(1e-12).log10(),
            test_psnr: None,
            width_px: stepped.width_px,
            cpu_secs: cpu_secs() - self.cpu_start,
            wall_secs: self.wall.elapsed().as_secs_f64(),
            dropped: trainer.dropped(),
        }
    }

    /// Runs `work` without counting its CPU time as training.
    fn aside<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let before = cpu_secs();
        let value = work(self);
        self.cpu_start += cpu_secs() - before;
        value
    }

    fn keep<B: Backend>(
        &mut self,
        mut now: Sample,
        trainer: &mut Trainer<B>,
        judged: bool,
    ) -> Result<Sample> {
        if judged {
            let scores = self.aside(|run| run.scores(trainer))?;
            now.test_psnr = eval::mean(&scores).map(|m| m.0);
        }
        self.means = Means::default();
        self.curve.push(now);
        Ok(now)
    }

    fn scores<B: Backend>(&mut self, trainer: &mut Trainer<B>) -> Result<Vec<Score>> {
        if self.judge.is_empty() {
            return Ok(Vec::new());
        }
        let (soup, space) = (trainer.soup()?, trainer.space());
        let pictures = self.judge.pictures(&soup, &space, &trainer.drawing(self.drawing));
        Ok(self.judge.scores(&pictures))
    }

    fn checkpoint<B: Backend>(&mut self, trainer: &mut Trainer<B>, options: &RunOptions) -> Result<()> {
        let Some(path) = &options.checkpoint else { return Ok(()) };
        let spent = cpu_secs() - self.cpu_start;
        let curve = std::mem::take(&mut self.curve);
        let checkpoint = trainer.checkpoint(&curve, spent)?;
        self.curve = curve;
        checkpoint::write(path, &checkpoint)
    }

    fn preview<B: Backend>(&mut self, trainer: &mut Trainer<B>, options: &RunOptions) -> Result<()> {
        let Some((folder, pause)) = &options.preview else { return Ok(()) };
        if self.preview.elapsed() < *pause || self.judge.is_empty() {
            return Ok(());
        }
        self.preview = Instant::now();
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let step = trainer.steps();
        self.aside(|run| {
            let (soup, space) = (trainer.soup()?, trainer.space());
            let pictures = run.judge.pictures(&soup, &space, &trainer.drawing(run.drawing));
            match pictures.first() {
                Some((_, picture)) => picture.save_png(&folder.join(format!("step-{step:06}.png"))),
                None => Ok(()),
            }
        })
    }

    /// Judges the scene as it is now; the curve ends with the `last` step made, whether a sample was due or not.
    fn finish<B: Backend>(
        mut self,
        trainer: &mut Trainer<B>,
        last: Option<Sample>,
        stopped: bool,
        watcher: &mut dyn Watcher,
    ) -> Result<Trained> {
        let spent = cpu_secs() - self.cpu_start;
        let scores = self.scores(trainer)?;
        if let Some(last) = last {
            let now = Sample { test_psnr: eval::mean(&scores).map(|mean| mean.0), ..last };
            let again = self.curve.last().is_some_and(|kept| kept.step == now.step);
            self.curve.truncate(self.curve.len() - usize::from(again));
            self.curve.push(now);
            watcher.sampled(&now);
        }
        Ok(Trained {
            soup: trainer.soup()?,
            steps: trainer.steps(),
            curve: self.curve,
            scores,
            dropped: trainer.dropped(),
            cpu_secs: spent,
            stopped,
        })
    }
}
