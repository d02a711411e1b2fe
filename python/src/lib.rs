//! `import trisplat`: scenes and pictures as numpy arrays, and the jobs of the program. Options
//! are the library's own, by the names of their fields. `trisplat.pyi` has the types; tests compare
//! it with this module.

mod arrays;
mod jobs;
mod objects;
mod options;
mod training;

use pyo3::exceptions::{PyFileExistsError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::ops::ControlFlow::Continue;
use std::path::PathBuf;
use std::str::FromStr;
use trisplat::{BakeJob, BakeOptions, Dataset, EvalJob, ReadOptions, RenderJob};
use trisplat_formats::output::Output;
use trisplat_job::{BakeInput, HARDEN_STEPS};
use trisplat_scene::{Budget, Seconds};

/// A scene of any format as arrays.
///
/// A soup: triangles (N, 3, 3), opacity (N,), sigma (N,) and sh (N, K, 3), spherical harmonics. A
/// mesh: positions (V, 3), faces (F, 3), and colors in linear light, (F, 3) for faces or (V, 3) for
/// vertices; opacity (F,) unless opaque. Arrays own what was read: nothing is copied.
///
/// Raises OSError for errors of the system, ValueError for an unknown or broken file.
#[pyfunction]
fn read<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let loaded =
        py.detach(|| trisplat_formats::read(&path, &ReadOptions::default())).map_err(raised)?;
    arrays::of_scene(py, loaded.scene)
}

/// Bakes a scene for a game engine, from a file, from arrays of `read`, or from a list of these,
/// merged.
///
/// With `output`, a name that ends in .glb, .gltf, .obj, .ply, .usdz, .html or .tileset.json, it
/// writes the file and returns the report. Without, it returns the arrays of the mesh, like `read`.
/// `dataset` is a folder of photos with poses. `harden` trains a soft scene solid first;
/// `max_bytes` is for all files together. All other keywords are options of the bake, as in a
/// config file: max_triangles=1000, target="godot", lod=[0.5, 0.25].
///
/// Raises FileExistsError for a file that exists, unless `force`; OSError, ValueError.
#[pyfunction]
#[pyo3(signature = (source, output=None, *, dataset=None, force=false, harden=false, max_bytes=None, **options))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
fn bake<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    output: Option<PathBuf>,
    dataset: Option<PathBuf>,
    force: bool,
    harden: bool,
    max_bytes: Option<u64>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut job =
        BakeJob::new(sources(source)?, options::resolve(py, options, BakeOptions::preset)?.options);
    job.harden = harden.then_some(HARDEN_STEPS);
    job.max_bytes = max_bytes;
    let output =
        output.map(|path| job.options.plan_output(&path, None)).transpose().map_err(raised)?;
    let there = output.iter().flat_map(Output::paths).find(|path| !force && path.exists());
    if let Some(path) = there {
        return Err(exists(path));
    }
    let work = || {
        job.photos = dataset.map(|path| Dataset::load(&path, &job.dataset_options)).transpose()?;
        match &output {
            Some(output) => job.write(output, output.start()?, &mut |_| Continue(())),
            None => job.run(&mut |_| Continue(())),
        }
    };
    let done = py.detach(work).map_err(raised)?;
    match output {
        Some(_) => options::to_python(py, &serde_json::to_value(&done.report).unwrap_or_default()),
        None => Ok(arrays::of_mesh(py, done.asset.mesh)?.into_any()),
    }
}

/// Scores a soft or baked scene on photos: the report of `trisplat eval`, with PSNR, SSIM and FLIP
/// of every photo and means.
///
/// `split` is "test", the photos held out, "train" or "all"; `mode` "soft" or "solid" for a soup;
/// `ssaa` 1, 2 or 4 samples along each axis of a pixel; `dataset_options` as in `train`.
///
/// Raises OSError, ValueError.
#[pyfunction]
#[pyo3(signature = (file, dataset, *, split="test", mode=None, ssaa=4, dataset_options=None))]
fn eval<'py>(
    py: Python<'py>,
    file: PathBuf,
    dataset: PathBuf,
    split: &str,
    mode: Option<&str>,
    ssaa: u32,
    dataset_options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut job = EvalJob::new(file);
    job.dataset_options = options::plain(py, dataset_options)?;
    job.split = options::named("split", split)?;
    job.render.mode = mode.map(|mode| options::named("mode", mode)).transpose()?;
    job.render.ssaa = options::samples(ssaa)?;
    let work = || job.clone().run(&Dataset::load(&dataset, &job.dataset_options)?);
    let report = py.detach(work).map_err(raised)?;
    options::to_python(py, &serde_json::to_value(&report).unwrap_or_default())
}

/// Pictures of a scene as arrays (H, W, 3), uint8, by their names: from a circle of `orbit` places
/// around its subject, or from the cameras of `dataset`.
///
/// `width` is that of an orbit without a data set, px. `show` is "color", "depth", "normal" or
/// "wires"; `split`, `mode`, `ssaa` and `dataset_options` as in `eval`.
///
/// Raises OSError, ValueError.
#[pyfunction]
#[pyo3(signature = (file, *, orbit=None, dataset=None, split="test", width=960, show="color", mode=None, ssaa=4, dataset_options=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
fn render<'py>(
    py: Python<'py>,
    file: PathBuf,
    orbit: Option<u32>,
    dataset: Option<PathBuf>,
    split: &str,
    width: u32,
    show: &str,
    mode: Option<&str>,
    ssaa: u32,
    dataset_options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let mut job = RenderJob::new(file);
    job.dataset_options = options::plain(py, dataset_options)?;
    job.split = options::named("split", split)?;
    job.show = options::named("show", show)?;
    job.render.mode = mode.map(|mode| options::named("mode", mode)).transpose()?;
    job.render.ssaa = options::samples(ssaa)?;
    job.orbit = orbit;
    job.width = width;
    let work = || {
        let how = job.dataset_options.clone();
        let dataset = dataset.map(|path| Dataset::load(&path, &how)).transpose()?;
        let mut ready = job.prepare(dataset.as_ref())?;
        let names: Vec<String> = ready.cameras().iter().map(|(name, _)| name.clone()).collect();
        let drawn = |(i, name)| Ok((name, ready.draw(i)?));
        names.into_iter().enumerate().map(drawn).collect::<trisplat::Result<Vec<_>>>()
    };
    let out = PyDict::new(py);
    for (name, picture) in py.detach(work).map_err(raised)? {
        arrays::put_picture(&out, &name, &picture)?;
    }
    Ok(out)
}

/// A budget of CPU seconds.
fn cpu_budget(seconds: Option<f64>) -> PyResult<Option<Budget>> {
    let budget = seconds.map(|seconds| Seconds::from_str(&seconds.to_string())).transpose();
    Ok(budget.map_err(PyValueError::new_err)?.map(Budget::cpu))
}

/// The exception for an existing file.
fn exists(path: &std::path::Path) -> PyErr {
    PyFileExistsError::new_err(format!(
        "{} already exists; give force=True to replace it",
        path.display()
    ))
}

/// The input of a bake; files are read after releasing the interpreter.
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
        // FileNotFoundError, PermissionError, ... of the system.
        trisplat::Error::Io { source, .. } => {
            std::io::Error::new(source.kind(), error.to_string()).into()
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// Photos and trained triangle soups become meshes that game engines draw directly.
#[pymodule]
#[pyo3(name = "trisplat")]
fn python_module(whole: &Bound<'_, PyModule>) -> PyResult<()> {
    whole.add("__version__", env!("CARGO_PKG_VERSION"))?;
    whole.add_function(wrap_pyfunction!(read, whole)?)?;
    whole.add_function(wrap_pyfunction!(training::train, whole)?)?;
    whole.add_function(wrap_pyfunction!(bake, whole)?)?;
    whole.add_function(wrap_pyfunction!(jobs::make, whole)?)?;
    whole.add_function(wrap_pyfunction!(jobs::capture, whole)?)?;
    whole.add_function(wrap_pyfunction!(jobs::mesh, whole)?)?;
    whole.add_function(wrap_pyfunction!(eval, whole)?)?;
    whole.add_function(wrap_pyfunction!(render, whole)?)?;
    whole.add_function(wrap_pyfunction!(objects::to_trimesh, whole)?)?;
    whole.add_function(wrap_pyfunction!(objects::to_open3d, whole)?)
}
