//! The short trainings of [`super::watched`].

use super::event::{Observer, TrainBegins, TrainPart, begin};
use super::preparation::{PreparationPart, Storing, stopped};
use super::watched::{LONGEST_PX, SOLID_STEPS, TRIANGLES, TrialRun, WatchedTraining, is_left_out};
use std::time::Instant;
use trisplat_dataset::{Dataset, DatasetOptions, Photo, View};
use trisplat_scene::Result;
use trisplat_train::{Checkpoint, RunOptions, TrainOptions, TrainRun};

/// Fewest pixels of a photo per triangle.
const PIXELS_PER_TRIANGLE: u64 = 4;

/// Short trainings on the photos of a run.
pub(super) struct Watching<'a> {
    /// The training photos, small and in memory; watched ones are marked as held out.
    photos: Dataset,
    how: &'a DatasetOptions,
    seed: u64,
    storing: Storing,
    /// Results of an earlier process, which are not repeated, and the training that it was stopped in.
    earlier: std::vec::IntoIter<WatchedTraining>,
    resume: Option<Checkpoint>,
    /// Results so far.
    done: Vec<WatchedTraining>,
    began: Instant,
}

impl<'a> Watching<'a> {
    /// Short trainings on `photos`, read with `how`; after those of an `earlier` process.
    ///
    /// Errors: photos that cannot be decoded.
    pub(super) fn new(
        photos: &Dataset,
        how: &'a DatasetOptions,
        seed: u64,
        storing: Storing,
        earlier: (Vec<WatchedTraining>, Option<Checkpoint>),
    ) -> Result<Self> {
        let began = Instant::now();
        let count = photos.train().count();
        let view = |(i, view): (usize, &View)| {
            let camera = view.camera.within(LONGEST_PX);
            let photo = Photo::drawn(view.photo.decode()?.downscaled(camera.size));
            Ok(View { camera, photo, test: is_left_out(i, count), ..view.clone() })
        };
        let views = photos.train().enumerate().map(view).collect::<Result<_>>()?;
        let photos = Dataset { views, ..photos.clone() };
        let (earlier, resume) = (earlier.0.into_iter(), earlier.1);
        Ok(Self { photos, how, seed, storing, earlier, resume, done: Vec::new(), began })
    }

    /// Seconds since this began.
    pub(super) fn seconds(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Trains both scenes.
    ///
    /// Errors: a training that was stopped.
    pub(super) fn run(&mut self, observer: Observer<'_>) -> Result<TrialRun> {
        let photos = self.photos.test().map(|view| view.name.clone()).collect();
        let [few, many] = SOLID_STEPS;
        Ok(TrialRun { photos, solid: [self.training(few, observer)?, self.training(many, observer)?] })
    }

    /// The result of the next training, unless an earlier process has it.
    fn training(&mut self, steps_per_photo: u64, observer: Observer<'_>) -> Result<WatchedTraining> {
        let result = match self.earlier.next() {
            Some(known) => known,
            None => self.train(steps_per_photo, observer)?,
        };
        self.done.push(result);
        Ok(result)
    }

    fn train(&mut self, steps_per_photo: u64, observer: Observer<'_>) -> Result<WatchedTraining> {
        let steps = steps_per_photo * self.photos.views.len() as u64;
        let pixels = self.photos.views.iter().map(|view| u64::from(view.camera.size.element_product())).max();
        let max_triangles = (pixels.unwrap_or(0) / PIXELS_PER_TRIANGLE).clamp(1, TRIANGLES);
        let options = TrainOptions { steps, max_triangles, seed: self.seed, ..TrainOptions::default() };
        let run = TrainRun::new(&self.photos, &options).with_dataset_options(self.how);
        let run =
            self.storing.stored(run, PreparationPart::Watching(self.done.clone()), self.resume.take())?;
        // Short trainings do not obey the run's limit.
        let run = TrainRun { outputs: RunOptions { max_cpu_secs: 0.0, ..run.outputs.clone() }, ..run };
        let begins = TrainBegins { part: TrainPart::Trial, steps, ..TrainBegins::default() };
        // A graphics card gains nothing on small photos.
        let trained = run.run(&mut begin(observer, &begins)?)?;
        if trained.stopped {
            return Err(stopped("a short training that leaves some photos out", &trained));
        }
        let psnr = trained.quality().map_or(f64::NAN, |quality| quality.psnr);
        Ok(WatchedTraining { steps, psnr })
    }
}
