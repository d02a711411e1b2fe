//! Interruptible training from Python.

use crate::{arrays, cpu_budget, exists, options, raised};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::path::PathBuf;
use trisplat::{Dataset, DatasetOptions, Error, TrainJob, TrainOptions};
use trisplat_job::{Event, TeacherSource, TrainPart};
use trisplat_scene::{atomic::AtomicFile, report::OutputReport};

/// Trains a scene on a folder of photos with poses, as the program does.
///
/// With `output`, a name that ends in .ply, it writes the file and returns the report. Without, it
/// returns the arrays of the soup, like `read`. `teacher` is "auto", "off" or the file of a soft
/// scene; `budget` is in CPU seconds. `dataset_options` are those for reading the photos:
/// {"max_size": 800}. All other keywords are options of the training, as in a config file:
/// steps=3000, max_triangles=20_000, preset="solid".
///
/// `callback` is called after every step with a dict: part ("scene", or "trial" and "teacher"
/// before it), step, triangles, loss, psnr and more. Where it returns False, the training stops,
/// and the scene so far is the result; what it raises ends the training too.
///
/// Raises FileExistsError for a file that exists, unless `force`; OSError, ValueError;
/// KeyboardInterrupt between two steps.
#[pyfunction]
#[pyo3(signature = (dataset, output=None, *, force=false, teacher=None, budget=None, dataset_options=None, callback=None, **options))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn train<'py>(
    py: Python<'py>,
    dataset: PathBuf,
    output: Option<PathBuf>,
    force: bool,
    teacher: Option<String>,
    budget: Option<f64>,
    dataset_options: Option<&Bound<'py, PyDict>>,
    callback: Option<Py<PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let layered = options::resolve(py, options, TrainOptions::preset)?;
    let how: DatasetOptions = options::plain(py, dataset_options)?;
    let budget = cpu_budget(budget)?;
    if let Some(path) = &output {
        if path.extension().is_none_or(|end| !end.eq_ignore_ascii_case("ply")) {
            let what = format!(
                "{} is not a name that ends with .ply; bake turns it into .glb",
                path.display()
            );
            return Err(PyValueError::new_err(what));
        }
        if path.exists() && !force {
            return Err(exists(path));
        }
    }
    let mut watcher = Watcher { callback, stopped: false, raised: None };
    let work = || {
        // A folder that is not writable fails before the work.
        let file = output.as_deref().map(AtomicFile::create).transpose()?;
        let mut job = TrainJob::new(Dataset::load(&dataset, &how)?, layered.options.clone());
        job.options = layered;
        job.dataset_options = how;
        job.budget = budget;
        let Ok(teacher) = teacher.map(|teacher| teacher.parse::<TeacherSource>()).transpose();
        job.teacher = teacher;
        let mut done = job.run(&mut |event| watcher.watch(&event))?;
        if let (Some(file), Some(path), None) = (file, &output, &watcher.raised) {
            let bytes = done.trained.save_to(file)?;
            done.report.outputs.push(OutputReport { path: path.display().to_string(), bytes });
        }
        done.report.inputs = vec![dataset.display().to_string()];
        Ok::<_, Error>(done)
    };
    let done = py.detach(work);
    if let Some(raised) = watcher.raised {
        return Err(raised);
    }
    let done = done.map_err(raised)?;
    match output {
        Some(_) => options::to_python(py, &serde_json::to_value(&done.report).unwrap_or_default()),
        None => Ok(arrays::of_soup(py, done.trained.soup)?.into_any()),
    }
}

/// Tells Python of every step, and stops a training when Python wants to.
struct Watcher {
    callback: Option<Py<PyAny>>,
    stopped: bool,
    raised: Option<PyErr>,
}

impl Watcher {
    fn watch(&mut self, event: &Event<'_>) -> ControlFlow<()> {
        if self.raised.is_none() {
            match Python::attach(|py| self.tell(py, event)) {
                Ok(stops) => self.stopped |= stops,
                Err(error) => self.raised = Some(error),
            }
        }
        if self.stopped || self.raised.is_some() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// True when the callback asks to stop.
    fn tell(&self, py: Python<'_>, event: &Event<'_>) -> PyResult<bool> {
        py.check_signals()?;
        let (Event::Step { part, sample, .. }, Some(callback)) = (event, &self.callback) else {
            return Ok(false);
        };
        let mut step = serde_json::to_value(sample).unwrap_or_default();
        step["part"] = match part {
            TrainPart::Trial => "trial",
            TrainPart::Teacher => "teacher",
            TrainPart::Scene => "scene",
        }
        .into();
        let said = callback.bind(py).call1((options::to_python(py, &step)?,))?;
        Ok(said.extract().is_ok_and(|goes_on: bool| !goes_on))
    }
}
