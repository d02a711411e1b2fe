//! `trisplat train --block PLAN:BLOCK`: one block of a scene that is trained in blocks.

use super::inputs::Inputs;
use super::messages::{self, many};
use super::outputs::Outputs;
use super::train_args::{BlockAddress, TrainArgs};
use super::train_progress::Bar;
use super::{Global, signals};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use trisplat_scale::Task;
use trisplat_scene::Result;
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::report::counted;
use trisplat_train::{PREVIEW, Preview};

/// Trains the block, unless its result exists.
pub(super) fn run(
    args: &TrainArgs,
    block: &BlockAddress,
    global: &Global,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let clock = Instant::now();
    let task = Task::open(&block.plan, block.index, &args.dataset_options.limits)?;
    let done = task.output();
    if done.is_file() && !args.force {
        // A run that was killed after its last rename leaves it.
        let _ = std::fs::remove_file(task.checkpoint());
        if !global.quiet {
            messages::print(&format!("{} already exists", done.display()));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let mut guard = guard(args, block, &task, inputs)?;
    // Tried before any work, because another process may train this block.
    let mut file = AtomicFile::create(&done)?;
    let (dataset, cameras) = task.dataset(args.dataset.as_deref())?;
    guard.spare_photos(&dataset)?;
    let preview = args
        .preview
        .clone()
        .map(|folder| Preview { folder, pause: Duration::from_secs_f64(args.preview_every) });
    let outputs = task.outputs(args.checkpoint_every, preview, args.max_cpu_secs);
    let (run, broken) = task.run(&dataset, outputs)?;
    let run = run.start_at(&args.backend_options)?;
    let mut bar = Bar::new(global, task.block().steps, run.steps(), args.log.as_deref(), run.curve())?;
    bar.begun(run.card.as_deref(), broken.iter().chain(&run.warnings).chain(&dataset.warnings));
    let trained = run.finish(&mut |event| bar.tell(event))?;
    if bar.is_stopped("the block", &trained)? {
        return Ok(signals::ended());
    }
    let trained = task.finished(trained, cameras);
    trained.write_to(&mut file)?;
    file.commit()?;
    // The result exists, so the checkpoint is useless.
    let _ = std::fs::remove_file(task.checkpoint());
    bar.line(&format!(
        "wrote {}: {}, {}, {:.1} CPU s, {:.1} s",
        done.display(),
        many(trained.soup.len() as u64, "triangle"),
        counted(trained.steps.saturating_sub(task.block().first_step), "step"),
        trained.cpu_secs,
        clock.elapsed().as_secs_f64()
    ));
    Ok(ExitCode::SUCCESS)
}

/// Refuses a log and previews that cannot or must not be written; the block's own files have names with a hash. A block that
/// goes on from its checkpoint goes on with them, too.
fn guard<'a>(args: &TrainArgs, block: &BlockAddress, task: &Task, inputs: &'a Inputs) -> Result<Outputs<'a>> {
    let mut files = Outputs::new(inputs, args.force || task.checkpoint().is_file());
    files.add_input(&block.plan);
    args.log.as_deref().map_or(Ok(()), |path| files.probe("--log", path))?;
    args.preview.as_deref().map_or(Ok(()), |folder| files.plan_pictures("--preview", folder, PREVIEW))?;
    Ok(files)
}
