//! The other jobs of the program: photos to files in one call, camera poses, connected surfaces.

use crate::{arrays, exists, options, raised};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use trisplat::{
    BakeOptions, Capture, Dataset, DatasetOptions, Error, MakeJob, MeshJob, MeshOptions, Report,
    Seconds,
};
use trisplat_formats::output::OutputFormat;

/// Makes files for an engine from photos, a video or folders of them, or from photos with poses:
/// poses, training, bake. Returns the report.
///
/// `page` is a page to write beside `output`; `work` the folder from which a stopped call goes on.
/// `budget` is in CPU seconds; with `steps` instead, equal calls make equal bytes. `anyway` trains
/// on photos that can hardly make a scene. All other keywords are options of the bake, as in
/// `bake`.
///
/// Raises FileExistsError for a file that exists, unless `force`; OSError, ValueError;
/// KeyboardInterrupt.
#[pyfunction]
#[pyo3(signature = (inputs, output, *, page=None, work=None, force=false, anyway=false, budget=600.0, steps=None, dataset_options=None, **options))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn make<'py>(
    py: Python<'py>,
    inputs: &Bound<'py, PyAny>,
    output: PathBuf,
    page: Option<PathBuf>,
    work: Option<PathBuf>,
    force: bool,
    anyway: bool,
    budget: f64,
    steps: Option<u64>,
    dataset_options: Option<&Bound<'py, PyDict>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut job = MakeJob::new(paths(inputs)?, output);
    job.bake = options::resolve(py, options, BakeOptions::preset_for_photos)?.options;
    job.dataset_options = options::plain(py, dataset_options)?;
    job.page = page;
    job.force = force;
    job.anyway = anyway;
    if let Some(work) = work {
        job.work = work;
    }
    job.budget = Some(Seconds(budget));
    if let Some(steps) = steps {
        job.train.steps = steps;
        job.budget = None;
    }
    let planned = job.bake.clone().plan_output(&job.output, None).map_err(raised)?;
    let unfinished = job.unfinished();
    let mut files = planned.paths().map(Path::to_owned).chain(job.page.clone());
    let is_kept = |path: &PathBuf| !force && path.exists() && !unfinished.contains(path);
    if let Some(path) = files.find(is_kept) {
        return Err(exists(&path));
    }
    let mut signals = Signals::default();
    let done = py.detach(|| job.run(&mut |_| signals.check()));
    signals.result()?;
    to_python(py, &done.map_err(raised)?.report)
}

/// Finds the camera poses of photos, a video or folders of them, and writes a data set into the
/// folder `output`. Returns the report.
///
/// `force` sets a capture of other inputs in that folder aside. All other keywords are options of
/// the capture: frames=150, mapper="global".
///
/// Raises OSError, ValueError; KeyboardInterrupt.
#[pyfunction]
#[pyo3(signature = (inputs, output, *, force=false, **options))]
pub fn capture<'py>(
    py: Python<'py>,
    inputs: &Bound<'py, PyAny>,
    output: PathBuf,
    force: bool,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut job = Capture::new(paths(inputs)?, output);
    job.options = options::plain(py, options)?;
    job.force = force;
    let mut report = Report::new("capture");
    let mut signals = Signals::default();
    let done = py.detach(|| job.run(&mut report, &mut |_| signals.check()));
    signals.result()?;
    done.map_err(raised)?;
    to_python(py, &report)
}

/// Makes one connected surface of a scene, of Gaussian splats, or of a folder of photos with poses,
/// on which a scene is trained first.
///
/// With `output`, it writes the file and returns the report. Without, it returns the arrays of the
/// mesh, like `read`. `dataset` is a folder of photos of the scene, whose cameras decide what the
/// surface is. All other keywords are options of the surface: texture="on", max_triangles=2000.
///
/// Raises FileExistsError for a file that exists, unless `force`; OSError, ValueError;
/// KeyboardInterrupt.
#[pyfunction]
#[pyo3(signature = (source, output=None, *, dataset=None, force=false, dataset_options=None, **options))]
pub fn mesh<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    output: Option<PathBuf>,
    dataset: Option<PathBuf>,
    force: bool,
    dataset_options: Option<&Bound<'py, PyDict>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = options::resolve(py, options, |()| MeshOptions::default())?.options;
    let reading: DatasetOptions = options::plain(py, dataset_options)?;
    let arrays = source.cast::<PyDict>().ok().map(arrays::to_scene).transpose()?;
    let path: Option<PathBuf> = arrays.is_none().then(|| source.extract()).transpose()?;
    if let Some(path) = &output {
        OutputFormat::of(path).map_err(raised)?;
        if path.exists() && !force {
            return Err(exists(path));
        }
    }
    let output_options = options.output.clone();
    let mut report = Report::new("mesh");
    report.inputs.extend(path.iter().chain(&dataset).map(|path| path.display().to_string()));
    report.options = serde_json::to_value(&options).unwrap_or_default();
    let mut signals = Signals::default();
    let work = || {
        let mut job = MeshJob::new(None, None, options);
        let mut photos = dataset;
        match (arrays, path) {
            (Some(scene), _) => {
                job.scene = Some(trisplat::AnyScene::from(scene).into());
            }
            (None, Some(path)) if Dataset::is_posed(&path) => photos = Some(path),
            (None, Some(path)) => {
                let read = trisplat_formats::read_content(&path, &reading.read_options(3))?;
                job.scene = Some(read);
            }
            (None, None) => {}
        }
        job.photos = photos.map(|path| Dataset::load(&path, &reading)).transpose()?;
        job.dataset_options = reading;
        let surface = job.run(&mut report, &mut |_| signals.check())?;
        if let (Some(surface), Some(path)) = (&surface, &output) {
            let written = trisplat_formats::write(surface, path, &output_options)?;
            report.outputs.extend(written.files);
            report.warnings.extend(written.warnings);
        }
        Ok::<_, Error>(surface)
    };
    let surface = py.detach(work);
    signals.result()?;
    match (output, surface.map_err(raised)?) {
        (None, Some(surface)) => Ok(arrays::of_mesh(py, surface.mesh)?.into_any()),
        _ => to_python(py, &report),
    }
}

fn to_python<'py>(py: Python<'py>, report: &Report) -> PyResult<Bound<'py, PyAny>> {
    options::to_python(py, &serde_json::to_value(report).unwrap_or_default())
}

/// One path, or a list of paths.
fn paths(inputs: &Bound<'_, PyAny>) -> PyResult<Vec<PathBuf>> {
    if inputs.is_instance_of::<PyList>() || inputs.is_instance_of::<PyTuple>() {
        return inputs.try_iter()?.map(|one| one?.extract()).collect();
    }
    Ok(vec![inputs.extract()?])
}

/// Stops a job when a signal handler of Python raises, as after Ctrl-C.
#[derive(Default)]
struct Signals {
    error: Option<PyErr>,
}

impl Signals {
    fn check(&mut self) -> ControlFlow<()> {
        if self.error.is_none() {
            self.error = Python::attach(|py| py.check_signals()).err();
        }
        if self.error.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn result(self) -> PyResult<()> {
        self.error.map_or(Ok(()), Err)
    }
}
