//! Runs the job of this process.

use super::job::Job;
use super::lines::{Lines, say};
use glam::{DVec3, UVec2, Vec3};
use serde_json::{Map, Value};
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use trisplat_bake::{BakeOptions, TeacherOptions, bake, is_solid};
use trisplat_formats::{self as formats, ReadOptions, gltf, info};
use trisplat_job::{BakeInput, BakeJob, HARDEN_STEPS, SceneRenderer, describe};
use trisplat_scene::{
    Asset, Error, ImportedScene, Limits, Placement, Result, Scene,
    atomic::AtomicFile,
    input::{self, is_guarded},
    layered::Layers,
    placed,
    process::memory,
};

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
    let path = arguments.next().ok_or_else(|| Error::invalid("job", "nothing", "a file with a job"))?;
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
            let (loaded, splats) = formats::read_content(&input, &ReadOptions::default())?.stand_in();
            let file_placement = loaded.provenance.placement;
            let mut renderer = match (splats, &loaded.scene) {
                (Some(splats), _) => SceneRenderer::splats(splats, &file_placement, None, background),
                (None, Scene::Soup(soup)) => {
                    SceneRenderer::soft(soup.clone(), &file_placement, None, background)
                }
                (None, Scene::Mesh(_)) => {
                    return Err(Error::unsupported(input, "is a mesh: its triangles are solid"));
                }
            };
            let (_, placement) = shown(loaded, &quick(options)?)?;
            renderer.color(&placed::to_world(&camera, &placement, DVec3::ZERO)).save_png(&output)
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
    Ok(Layers::default().named(options).resolve(BakeOptions::preset)?.options)
}

/// The same for a bake that looks at no pictures.
fn quick(options: Map<String, Value>) -> Result<BakeOptions> {
    Ok(BakeOptions { teacher: TeacherOptions::OFF, ..resolved(options)? })
}

/// A scene as an engine draws it, and its placement in the frame of the scene's file.
fn shown(loaded: ImportedScene, options: &BakeOptions) -> Result<(Asset, Placement)> {
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
    let (asset, placement) = shown(loaded, options)?;
    say("to_view", matrix(&placement));
    let glb = gltf::to_glb_bytes(&asset, &gltf::GltfOptions::default())?;
    let mut file = AtomicFile::create(output)?;
    file.write_all(&glb).map_err(|e| Error::io(output, e))?;
    file.commit().map(drop)
}

/// The map from the frame of a file to that of its asset: three axes and an origin.
fn matrix(placement: &Placement) -> [[f32; 3]; 4] {
    let move_to = placement.transform();
    let origin = move_to(Vec3::ZERO);
    let axis = |axis: Vec3| (move_to(axis) - origin).to_array();
    [axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z), origin.to_array()]
}

/// From now on panics, which do not unwind here, and failed allocations print a line before they end the
/// process.
fn report_faults() {
    std::panic::set_hook(Box::new(|panic| {
        let message = input::text(panic.payload());
        let place = panic.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        match INPUT.get().filter(|_| is_guarded()) {
            Some(path) => say("error", input::failed(path, message).to_string()),
            None => {
                let fault = format!("trisplat has a fault: {message}{place}; please report it with the file");
                say("error", fault);
            }
        }
    }));
    memory::end_with(|bytes| {
        // There may be no memory for text either, so the line is composed on the stack.
        let mut line = [0u8; 200];
        let mut rest = &mut line[..];
        let remedy = "give fewer triangles, crop, or use the program, which may use more than 4 GB";
        let _ = writeln!(
            rest,
            "{{\"error\":\"out of memory: {bytes} bytes more could not be allocated; {remedy}\"}}"
        );
        let left = rest.len();
        let _ = std::io::stdout().write_all(&line[..line.len() - left]);
        std::process::exit(1)
    });
}
