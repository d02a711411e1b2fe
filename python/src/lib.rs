//! `import trisplat`: scenes as numpy arrays, and the bake. Options are the library's own, by the names of their fields.

mod arrays;
mod options;

use pyo3::exceptions::{PyFileExistsError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::path::PathBuf;
use trisplat::budget::{Budget, Seconds};
use trisplat::formats::output::Output;
use trisplat::job::BakeInput;
use trisplat::job::harden::HardenOptions;
use trisplat::{BakeJob, Dataset, ReadOptions};

/// A scene of any format as arrays.
///
/// A soup: triangles (N, 3, 3), opacity (N,), sigma (N,) and sh (N, K, 3), spherical harmonics. A mesh: positions (V, 3), faces (F, 3) and
/// colors, linear light, (F, 3) for faces or (V, 3) for vertices; opacity (F,) if it has some.
///
/// Raises OSError for what the system refuses, ValueError for a file that is none or is broken.
#[pyfunction]
fn read<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let loaded = py.detach(|| trisplat::read(&path, &ReadOptions::default())).map_err(raised)?;
    arrays::of_scene(py, &loaded.scene)
}

/// What a game engine draws of a scene: of a file, of arrays as `read` returns them, or of a list of both, merged.
///
/// With `output`, a name that ends in .glb, .gltf, .obj, .ply, .html or .tileset.json, writes it, and returns the report. Without, returns the
/// arrays of the mesh, as `read` does. `dataset` is a folder of photos with poses. `harden` trains a soft scene solid first; `max_bytes` is for all
/// files together; `budget` is in CPU seconds. Everything else is an option of the bake, as in a config file: max_triangles=1000, target="godot",
/// lod=[0.5, 0.25].
///
/// Raises FileExistsError for a file that exists, unless `force`; OSError, ValueError.
#[pyfunction]
#[pyo3(signature = (source, output=None, *, dataset=None, force=false, harden=false, max_bytes=None, budget=None, **options))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
fn bake<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    output: Option<PathBuf>,
    dataset: Option<PathBuf>,
    force: bool,
    harden: bool,
    max_bytes: Option<u64>,
    budget: Option<f64>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut job = BakeJob::new(sources(source)?, options::resolve(py, options)?);
    job.harden = harden.then(HardenOptions::default);
    job.max_bytes = max_bytes;
    let budget = budget.map(|seconds| seconds.to_string().parse::<Seconds>()).transpose();
    job.budget = budget.map_err(PyValueError::new_err)?.map(Budget::cpu);
    let output = output.map(|path| job.options.plan_output(&path, None)).transpose().map_err(raised)?;
    let there = output.iter().flat_map(Output::paths).find(|path| !force && path.exists());
    if let Some(path) = there {
        let what = format!("{} already exists; give force=True to replace it", path.display());
        return Err(PyFileExistsError::new_err(what));
    }
    let work = || {
        job.photos = dataset.map(|path| Dataset::load(&path, &job.dataset_options)).transpose()?;
        match &output {
            Some(output) => job.write(output, output.start()?, &mut ()),
            None => job.run(&mut ()),
        }
    };
    let done = py.detach(work).map_err(raised)?;
    match output {
        Some(_) => options::to_python(py, &serde_json::to_value(&done.report).unwrap_or_default()),
        None => Ok(arrays::of_mesh(py, &done.asset.mesh)?.into_any()),
    }
}

/// What is baked: files are read when the interpreter is let go.
fn sources(source: &Bound<'_, PyAny>) -> PyResult<Vec<BakeInput>> {
    if source.is_instance_of::<PyList>() || source.is_instance_of::<PyTuple>() {
        return source.try_iter()?.map(|one| self::source(&one?)).collect();
    }
    Ok(vec![self::source(source)?])
}

fn source(source: &Bound<'_, PyAny>) -> PyResult<BakeInput> {
    match source.cast::<PyDict>() {
        Ok(dict) => Ok(BakeInput::scene(arrays::to_scene(dict)?)),
        Err(_) => Ok(BakeInput::File(source.extract()?)),
    }
}

/// The exception for an error.
fn raised(error: trisplat::Error) -> PyErr {
    match &error {
        // FileNotFoundError, PermissionError, ... as of the system.
        trisplat::Error::Io { source, .. } => std::io::Error::new(source.kind(), error.to_string()).into(),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// Photos and trained triangle soups to meshes that game engines draw as they are.
#[pymodule]
#[pyo3(name = "trisplat")]
fn python_module(whole: &Bound<'_, PyModule>) -> PyResult<()> {
    whole.add("__version__", env!("CARGO_PKG_VERSION"))?;
    whole.add_function(wrap_pyfunction!(read, whole)?)?;
    whole.add_function(wrap_pyfunction!(bake, whole)?)
}
