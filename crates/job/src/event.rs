//! One stream of events for a program that shows a training and may stop it.

use super::observer::TrainJobObserver;
use super::training::TrainJob;
use std::ops::ControlFlow;
use trisplat_dataset::Dataset;
use trisplat_scene::{Error, Result};
use trisplat_train::{TrainObserver, TrainOptions, TrainSample, Trained};

/// The part of a training that a step belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainPart {
    /// A short training on some of the photos; the others decide how the scene is trained.
    Trial,
    /// A soft scene whose pictures the scene is trained on too.
    Teacher,
    /// The scene.
    Scene,
}

/// What happens while a scene is trained.
#[derive(Debug)]
pub enum Event<'a> {
    /// A step was made.
    Step {
        /// The part that it belongs to.
        part: TrainPart,
        /// Step, triangles, loss and PSNR.
        sample: &'a TrainSample,
    },
    /// A checkpoint or a picture could not be written; the training goes on.
    Lost(&'a Error),
}

/// Trains a soup on the photos of `dataset` that are not held out, as the command `train` does. `on_event` is called after every
/// step; `ControlFlow::Break` stops the training, whose result is then the scene so far, with `stopped` set.
/// [`TrainJob`] has everything that can be asked for beside the options.
///
/// Errors: options out of range, no training photos, photos that cannot be decoded; a stop before the scene's first step.
///
/// ```no_run
/// use std::ops::ControlFlow;
/// use trisplat_dataset::{Dataset, DatasetOptions};
/// use trisplat_job::train;
/// use trisplat_train::TrainOptions;
///
/// let photos = Dataset::load("photos", &DatasetOptions::default())?;
/// let trained = train(&photos, &TrainOptions::default(), |_| ControlFlow::Continue(()))?;
/// trained.save("scene.ply")?;
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
pub fn train(
    dataset: &Dataset,
    options: &TrainOptions,
    on_event: impl FnMut(Event) -> ControlFlow<()>,
) -> Result<Trained> {
    let mut stream = Stream { on_event, stopped: false };
    Ok(TrainJob::new(dataset.clone(), options.clone()).run(&mut stream)?.trained)
}

/// Turns the calls of an observer into events.
struct Stream<F> {
    on_event: F,
    stopped: bool,
}

impl<F: FnMut(Event) -> ControlFlow<()>> Stream<F> {
    fn emit(&mut self, event: Event) {
        self.stopped |= (self.on_event)(event).is_break();
    }

    /// The observer of a part.
    fn part(&mut self, part: TrainPart) -> Box<dyn TrainObserver + '_> {
        Box::new(Steps { part, stream: self })
    }
}

/// The steps of one part.
struct Steps<'a, F> {
    part: TrainPart,
    stream: &'a mut Stream<F>,
}

impl<F: FnMut(Event) -> ControlFlow<()>> TrainObserver for Steps<'_, F> {
    fn stepped(&mut self, sample: &TrainSample) {
        self.stream.emit(Event::Step { part: self.part, sample });
    }

    fn lost(&mut self, error: &Error) {
        self.stream.emit(Event::Lost(error));
    }

    fn wants_to_stop(&mut self) -> bool {
        self.stream.stopped
    }
}

impl<F: FnMut(Event) -> ControlFlow<()>> TrainObserver for Stream<F> {
    fn stepped(&mut self, sample: &TrainSample) {
        self.part(TrainPart::Scene).stepped(sample);
    }

    fn lost(&mut self, error: &Error) {
        self.emit(Event::Lost(error));
    }

    fn wants_to_stop(&mut self) -> bool {
        self.stopped
    }
}

impl<F: FnMut(Event) -> ControlFlow<()>> TrainJobObserver for Stream<F> {
    fn watching_begins(&mut self, _options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(self.part(TrainPart::Trial))
    }

    fn teacher_begins(
        &mut self,
        _options: &TrainOptions,
        _asked: bool,
    ) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(self.part(TrainPart::Teacher))
    }
}
