//! The program for pages and scripts: one job, read from a file, per process.
//!
//! Built for `wasm32-wasip1-threads` and run by `web/` in the repository, which gives it its
//! files from memory. The library does the work; this module has the job's types, and prints
//! progress as lines of JSON.

#[cfg(target_arch = "wasm32")]
mod new;

use glam::{DVec3, UVec2, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use trisplat_bake::{BakeOptions, TeacherOptions, bake, is_solid};
use trisplat_formats::{self as formats, ReadOptions, gltf, info};
use trisplat_job::{BakeInput, BakeJob, Event, HARDEN_STEPS, SceneRenderer, describe};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Viewpoint;
use trisplat_scene::input::{self, is_guarded};
use trisplat_scene::layered::Layers;
use trisplat_scene::{Asset, Error, ImportedScene, Limits, Placement, Result, Scene, frames};

/// The folder for temporary files, because this target names none.
const TEMPORARY: &str = "/tmp";

/// The file of the job, for messages without an error.
static INPUT: OnceLock<PathBuf> = OnceLock::new();

/// Runs the job in the file of the first argument, with the number of threads of the second.
pub fn main() -> ExitCode {
    report_faults();
    // Kept by whoever was first.
    let _ = tempfile::env::override_temp_dir(Path::new(TEMPORARY));
    match job().and_then(run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say("error", error.to_string());
            ExitCode::FAILURE
        }
    }
}

/// Runs the job of the arguments, after its threads are started.
fn job() -> Result<Job> {
    let mut arguments = std::env::args().skip(1);
    let path =
        arguments.next().ok_or_else(|| Error::invalid("job", "nothing", "a file with a job"))?;
    let threads = arguments.next().and_then(|count| count.parse().ok()).unwrap_or(1);
    // This thread is one of them, so with one thread no other is started.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread();
    pool.build_global().map_err(|e| {
        Error::invalid("threads", threads, format!("a number that this place can start ({e})"))
    })?;
    let text = input::read_text(path.as_ref(), &Limits::DEFAULT)?;
    serde_json::from_str(&text).map_err(|e| Error::malformed(path, "job", e.to_string()))
}

fn run(job: Job) -> Result<()> {
    if let Some(input) = job.input() {
        let _ = INPUT.set(input.clone());
    }
    match job {
        Job::Info { input } => {
            say("info", describe(&input, &ReadOptions::default())?);
            Ok(())
        }
        Job::Look { input, output, options } => look(&input, &output, &quick(options)?),
        Job::Picture { input, output, view, size, background, options } => {
            let camera = view.camera(UVec2::from(size));
            camera.validate(&Limits::DEFAULT)?;
            let (loaded, splats) =
                formats::read_content(&input, &ReadOptions::default())?.stand_in();
            let file_placement = loaded.provenance.placement;
            let mut renderer = match (splats, &loaded.scene) {
                (Some(splats), _) => {
                    SceneRenderer::splats(splats, &file_placement, None, background)
                }
                (None, Scene::Soup(soup)) => {
                    SceneRenderer::soft(soup.clone(), &file_placement, None, background)
                }
                (None, Scene::Mesh(_)) => {
                    return Err(Error::unsupported(input, "is a mesh: its triangles are solid"));
                }
            };
            let (_, placement) = bake_placed(loaded, &quick(options)?)?;
            renderer.color(&frames::to_world(&camera, &placement, DVec3::ZERO)).save_png(&output)
        }
        Job::Bake { inputs, output, options, harden, max_bytes } => {
            let mut job = BakeJob::new(inputs.into_iter().map(BakeInput::File), resolved(options)?);
            job.harden = harden.then_some(HARDEN_STEPS);
            job.max_bytes = max_bytes;
            let mut lines = Lines::default();
            let done = job.save(&output, &mut |event| {
                lines.tell(&event);
                ControlFlow::Continue(())
            })?;
            say("report", done.report);
            Ok(())
        }
    }
}

/// The options over those of the preset that they name.
fn resolved(options: Map<String, Value>) -> Result<BakeOptions> {
    Ok(Layers::default().with_named_options(options).resolve(BakeOptions::preset)?.options)
}

/// The same for a bake that looks at no pictures.
fn quick(options: Map<String, Value>) -> Result<BakeOptions> {
    Ok(BakeOptions { teacher: TeacherOptions::OFF, ..resolved(options)? })
}

/// A scene as an engine draws it, and its placement in the frame of the scene's file.
fn bake_placed(loaded: ImportedScene, options: &BakeOptions) -> Result<(Asset, Placement)> {
    let in_world = loaded.provenance.placement;
    let asset = bake(loaded, options)?;
    let placement = in_world.inverse().then(&asset.provenance.placement);
    Ok((asset, placement))
}

/// Reports the content of `input` and its rotation, and writes a scene for display.
fn look(input: &Path, output: &Path, options: &BakeOptions) -> Result<()> {
    let (info, content) = info::info_of_content(input, &ReadOptions::with_degree(0))?;
    say("info", info);
    let (loaded, _) = content.stand_in();
    say("soft", matches!(&loaded.scene, Scene::Soup(soup) if !is_solid(soup)));
    let (asset, placement) = bake_placed(loaded, options)?;
    say("to_view", matrix(&placement));
    let glb = gltf::to_glb_bytes(&asset, &gltf::GltfOptions::default())?;
    AtomicFile::create(output)?.commit_with(glb).map(drop)
}

/// The map from the frame of a file to that of its asset: three axes and an origin.
fn matrix(placement: &Placement) -> [[f32; 3]; 4] {
    let move_to = placement.transform();
    let origin = move_to(Vec3::ZERO);
    let axis = |axis: Vec3| (move_to(axis) - origin).to_array();
    [axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z), origin.to_array()]
}

/// From now on panics, which do not unwind here, print a line before they end the process.
fn report_faults() {
    std::panic::set_hook(Box::new(|panic| {
        let message = input::panic_message(panic.payload());
        let place = panic
            .location()
            .map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        match INPUT.get().filter(|_| is_guarded()) {
            Some(path) => say("error", input::decoder_panic(path, message).to_string()),
            None => {
                let fault = format!(
                    "trisplat has a fault: {message}{place}; please report it with the file"
                );
                say("error", fault);
            }
        }
    }));
}

// ---- The progress of a job: lines of JSON on standard output, one object each, with one key that names it

/// Smallest reported change of a fraction.
const STEP: f64 = 0.01;

/// Prints one line; failures are ignored.
fn say(key: &str, value: impl Serialize) {
    let line = json!({ key: value }).to_string() + "\n";
    let mut out = io::stdout().lock();
    let _ = out.write_all(line.as_bytes()).and_then(|()| out.flush());
}

/// Reports stages and their progress.
#[derive(Debug, Default)]
struct Lines {
    told: f64,
    /// Steps of the training.
    steps: u64,
}

impl Lines {
    fn at(&mut self, fraction: f64) {
        if fraction < self.told || fraction >= self.told + STEP {
            self.told = fraction;
            say("fraction", fraction);
        }
    }

    /// Prints what is new.
    fn tell(&mut self, event: &Event<'_>) {
        match event {
            Event::StageStarted(name) => self.start(name),
            Event::StageProgress(fraction) => self.at(*fraction),
            Event::StageFinished(stage) => say("finished", stage),
            Event::TrainingStarted(begins) => {
                self.start("train");
                self.steps = begins.steps;
            }
            Event::Step { sample, .. } => {
                self.at(sample.step as f64 / self.steps.max(1) as f64);
            }
            Event::PicturesDrawn { done, all } => self.at(*done as f64 / (*all).max(1) as f64),
            _ => {}
        }
    }

    fn start(&mut self, name: &str) {
        self.told = 0.0;
        say("stage", name);
    }
}

// ---- The jobs, as JSON --------------------------------------------------------------------------

/// One job. Names of files are those of the caller.
#[derive(Debug, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
enum Job {
    /// Describe a file.
    Info {
        /// The file.
        input: PathBuf,
    },
    /// A scene for immediate display, baked as fast as possible.
    Look {
        /// The scene.
        input: PathBuf,
        /// The GLB to show.
        output: PathBuf,
        /// Options of the bake: the part of the scene, and its rotation.
        #[serde(default)]
        options: Map<String, Value>,
    },
    /// A picture of a soft scene or of Gaussians as they were trained.
    Picture {
        /// The scene.
        input: PathBuf,
        /// The PNG.
        output: PathBuf,
        /// The viewpoint, in the frame of [`Job::Look`] with these options.
        view: Viewpoint,
        /// Options of the bake.
        #[serde(default)]
        options: Map<String, Value>,
        /// Width and height, px.
        size: [u32; 2],
        /// The background, sRGB from 0 to 1.
        #[serde(default)]
        background: [f32; 3],
    },
    /// The bake.
    Bake {
        /// The inputs; several are merged.
        inputs: Vec<PathBuf>,
        /// The output, whose ending decides the format; other files come beside it.
        output: PathBuf,
        /// Options by the names of their fields or groups.
        #[serde(default)]
        options: Map<String, Value>,
        /// Train a soft scene solid first.
        #[serde(default)]
        harden: bool,
        /// Limit on the bytes of all files together.
        max_bytes: Option<u64>,
    },
}

impl Job {
    /// The first file that is read, for messages.
    fn input(&self) -> Option<&PathBuf> {
        match self {
            Self::Info { input } | Self::Look { input, .. } | Self::Picture { input, .. } => {
                Some(input)
            }
            Self::Bake { inputs, .. } => inputs.first(),
        }
    }
}
