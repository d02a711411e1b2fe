//! `trisplat train --view`: a window that shows the scene while it trains.
//!
//! ```text
//! thread that trains ── messages: photos, scenes, the end ──► thread that follows ──► window
//!         ▲                                                       │
//!         └───────────────── a scene is wanted ───────────────────┘
//! ```
//!
//! Showing a scene costs a copy, a bake and an upload, and this work slows the training. So each is
//! followed by a pause of many times its duration.

use super::inputs::Inputs;
use super::train::{self, Watcher};
use super::train_args::TrainArgs;
use super::view::{self, PosedPhotos};
use super::{GlobalArgs, messages, signals};
use clap::ArgMatches;
use glam::UVec2;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::{Error, ImportedScene, Result};
use trisplat_train::TrainSample;
use trisplat_view::window::{
    self, SceneChange, SceneFiles, SceneLoader, SoupSource, WindowOptions, WindowScene,
};

/// Pause after showing a scene, and after a soft picture, as a multiple of its duration. Both use a
/// core that trains: together less than a twentieth of the time of two cores.
const REST: f64 = 20.0;
/// The shortest pause between two scenes.
const SHORTEST: Duration = Duration::from_millis(200);
/// Width and height of the window, px.
const SIZE: UVec2 = UVec2::new(1280, 720);
/// Samples per pixel at edges.
const MSAA: u32 = 4;

/// A message of the training.
enum WatchMessage {
    /// Photos of the training.
    Photos(PosedPhotos),
    /// The present scene, its metadata, and the duration of the copy.
    Scene(Box<ImportedScene>, String, Duration),
    /// The written scene, and the result of the run.
    Ended(Box<ImportedScene>, String),
}

/// Trains on another thread, because the window needs this one.
///
/// # Errors
///
/// No window can be opened; those of the training.
pub(super) fn run(
    args: &TrainArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let (sender, received) = mpsc::channel();
    let (start, started) = mpsc::channel();
    let wanted = Arc::new(AtomicBool::new(true));
    let watcher = Box::new(SceneWatcher { wanted: wanted.clone(), sender, asked: Instant::now() });
    let follower = Follower::new(args, received, wanted);
    std::thread::scope(|scope| {
        let training = scope.spawn(move || {
            // Without a window the training does not begin.
            started.recv().ok().map(|()| train::run(args, matches, global, inputs, Some(watcher)))
        });
        let files = SceneFiles { file: args.output.clone(), dataset: args.dataset.clone() };
        let shown = window::open(window_options(args), files, loader(args, follower, start));
        let trained = training.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        match (trained, shown) {
            (None, Err(no_window)) => Err(no_window),
            (None, Ok(())) => Ok(ExitCode::SUCCESS),
            (Some(trained), Ok(())) => trained,
            (Some(trained), Err(error)) => {
                // Errors of the window do not affect the training.
                trained.inspect(|_| messages::print(&format!("warning: {error}")))
            }
        }
    })
}

fn window_options(args: &TrainArgs) -> WindowOptions {
    WindowOptions {
        size: SIZE,
        background: args.dataset_options.background.to_f32(),
        msaa: MSAA,
        vsync: true,
        screenshots: folder(args),
        remedy: "--preview writes pictures without a window",
        adapter: args.backend_options.adapter.clone(),
    }
}

/// The folder of the scene and of screenshots.
fn folder(args: &TrainArgs) -> PathBuf {
    args.output.parent().unwrap_or(Path::new("")).to_owned()
}

/// Starts the training when the window is open, and waits for its first scene; also reads files
/// dropped on the window.
fn loader(args: &TrainArgs, follower: Follower, start: Sender<()>) -> SceneLoader {
    let follower = Arc::new(Mutex::new(follower));
    let start = Mutex::new(Some(start));
    let first = follower.clone();
    let how = args.dataset_options.clone();
    let folder = folder(args);
    let load = move |files: &SceneFiles, progress: &dyn Fn(&str)| {
        let start = start.lock().unwrap_or_else(PoisonError::into_inner).take();
        match start.map(|start| start.send(())) {
            Some(_) => {
                progress("waiting for the first triangles");
                first.lock().unwrap_or_else(PoisonError::into_inner).first()
            }
            None => view::load(files, &how, &folder, progress),
        }
    };
    let follow = move || follower.lock().unwrap_or_else(PoisonError::into_inner).next();
    SceneLoader { load: Arc::new(load), follow: Some(Arc::new(follow)) }
}

/// Passes scenes to the window during training.
struct SceneWatcher {
    wanted: Arc<AtomicBool>,
    sender: Sender<WatchMessage>,
    /// Time of the last request for a copy.
    asked: Instant,
}

impl SceneWatcher {
    fn send(&self, message: WatchMessage) {
        // The receiver no longer exists after the window is closed.
        let _ = self.sender.send(message);
    }
}

impl Watcher for SceneWatcher {
    fn wants_scene(&mut self) -> bool {
        self.asked = Instant::now();
        self.wanted.swap(false, Ordering::Relaxed)
    }

    fn scene(&mut self, sample: &TrainSample, scene: Box<ImportedScene>) {
        let TrainSample { step, psnr, .. } = sample;
        let status = format!("step {step}, {psnr:.2} dB on the photos");
        self.send(WatchMessage::Scene(scene, status, self.asked.elapsed()));
    }

    fn begin(&mut self, dataset: &Dataset) {
        let views = dataset.views.clone();
        let origin = dataset.origin;
        self.send(WatchMessage::Photos(PosedPhotos { views, origin }));
    }

    fn end(&mut self, what: &str, scene: ImportedScene) {
        // A user who ended the program has closed the window too.
        if signals::exit_code().is_none() {
            self.send(WatchMessage::Ended(Box::new(scene), what.to_owned()));
        }
    }
}

/// Turns messages of the training into content of the window.
struct Follower {
    receiver: Receiver<WatchMessage>,
    wanted: Arc<AtomicBool>,
    photos: PosedPhotos,
    how: DatasetOptions,
    file: PathBuf,
    folder: PathBuf,
    /// Arrival of the shown scene, and the duration of its copy.
    last: (Instant, Duration),
    /// The result of the run, when its last scene is shown.
    ended: Option<String>,
}

impl Follower {
    fn new(args: &TrainArgs, receiver: Receiver<WatchMessage>, wanted: Arc<AtomicBool>) -> Self {
        Self {
            receiver,
            wanted,
            photos: PosedPhotos::default(),
            how: args.dataset_options.clone(),
            file: args.output.clone(),
            folder: folder(args),
            last: (Instant::now(), Duration::ZERO),
            ended: None,
        }
    }

    /// The first scene. An error when the training ends without any.
    fn first(&mut self) -> Result<WindowScene> {
        match self.receive()? {
            SceneChange::Changed(scene) => Ok(*scene),
            SceneChange::Final(_) | SceneChange::Gone => Err(Error::Incomplete(
                "the training ended before there was anything to show".into(),
            )),
        }
    }

    /// Follows up the shown scene, which is on the card by now.
    fn next(&mut self) -> Result<SceneChange> {
        if let Some(what) = self.ended.take() {
            return Ok(SceneChange::Final(what));
        }
        let (there, copied) = self.last;
        match self.receiver.recv_timeout((there.elapsed() + copied).mul_f64(REST).max(SHORTEST)) {
            // The last scene comes without a request.
            Ok(message) => self.shown(message),
            Err(RecvTimeoutError::Disconnected) => Ok(SceneChange::Gone),
            Err(RecvTimeoutError::Timeout) => {
                self.wanted.store(true, Ordering::Relaxed);
                self.receive()
            }
        }
    }

    /// Waits for a message of the training.
    fn receive(&mut self) -> Result<SceneChange> {
        self.receiver.recv().map_or(Ok(SceneChange::Gone), |message| self.shown(message))
    }

    fn shown(&mut self, message: WatchMessage) -> Result<SceneChange> {
        let (scene, status) = match message {
            WatchMessage::Photos(photos) => {
                self.photos = photos;
                return self.receive();
            }
            WatchMessage::Scene(scene, status, copied) => {
                self.last = (Instant::now(), copied);
                (scene, status)
            }
            WatchMessage::Ended(scene, what) => {
                self.ended = Some(what.clone());
                (scene, what)
            }
        };
        let mut scene =
            view::window_scene((*scene, None), &self.photos, &self.how, &self.file, &self.folder)?;
        scene.status = Some(status);
        if let Some(SoupSource { rest, .. }) = &mut scene.source
            && self.ended.is_none()
        {
            *rest = REST;
        }
        Ok(SceneChange::Changed(Box::new(scene)))
    }
}
