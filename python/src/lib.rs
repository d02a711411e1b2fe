//! `import trisplat`: scenes as numpy arrays, and the bake. Options are the library's own, by the names of their fields.

mod arrays;
mod options;

use pyo3::exceptions::{PyFileExistsError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::path::PathBuf;
use trisplat::bake::backdrop::BackdropWhen;
use trisplat::formats::output::{self, Output, OutputFormat};
use trisplat::report::Report;
use trisplat::{Asset, Bake, BakeOptions, Dataset, DatasetOptions, Loaded, ReadOptions, Views};

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
/// arrays of the mesh, as `read` does. `dataset` is a folder of photos with poses. Everything else is an option of the bake, as in a config file:
/// max_triangles=1000, target="godot", lod=[0.5, 0.25].
///
/// Raises FileExistsError for a file that is there already, unless `force`; OSError, ValueError.
#[pyfunction]
#[pyo3(signature = (source, output=None, *, dataset=None, force=false, **options))]
fn bake<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    output: Option<PathBuf>,
    dataset: Option<PathBuf>,
    force: bool,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut options = options::resolve(py, options)?;
    let format = output.as_deref().map(OutputFormat::of).transpose().map_err(raised)?;
    options.tiles.tiles = format == Some(OutputFormat::Tiles);
    let output = output.map(|path| planned(path, &options)).transpose().map_err(raised)?;
    let there = output.iter().flat_map(Output::paths).find(|path| !force && path.exists());
    if let Some(path) = there {
        let what = format!("{} is there already; give force=True to replace it", path.display());
        return Err(PyFileExistsError::new_err(what));
    }
    let sources = sources(source)?;
    let mut report = Report::new("bake");
    let work = || {
        let asset = baked(sources, dataset, &options, &mut report)?;
        if let Some(output) = &output {
            output::write(&asset, output, output.start()?, &options.output, &mut report, &mut ())?;
        }
        Ok(asset)
    };
    let asset: Asset = py.detach(work).map_err(raised)?;
    match output {
        Some(_) => options::to_python(py, &serde_json::to_value(&report).unwrap_or_default()),
        None => Ok(arrays::of_mesh(py, &asset.mesh)?.into_any()),
    }
}

/// The files that options ask for, before any work is done.
fn planned(path: PathBuf, options: &BakeOptions) -> trisplat::Result<Output> {
    let mut output = Output::plan(&path, None, &options.output, options.bvh.bvh)?
        .with_levels(options.lod.lod.len(), &options.output)?;
    if options.backdrop.backdrop == BackdropWhen::File {
        output = output.with_backdrop_file(&options.output)?;
    }
    match options.collision.collision {
        true => output.with_collision(&options.output),
        false => Ok(output),
    }
}

/// What is baked: files are read when the interpreter is let go.
enum Source {
    File(PathBuf),
    Arrays(Loaded),
}

fn sources(source: &Bound<'_, PyAny>) -> PyResult<Vec<Source>> {
    if source.is_instance_of::<PyList>() || source.is_instance_of::<PyTuple>() {
        return source.try_iter()?.map(|one| self::source(&one?)).collect();
    }
    Ok(vec![self::source(source)?])
}

fn source(source: &Bound<'_, PyAny>) -> PyResult<Source> {
    match source.cast::<PyDict>() {
        Ok(dict) => Ok(Source::Arrays(arrays::to_scene(dict)?.into())),
        Err(_) => Ok(Source::File(source.extract()?)),
    }
}

fn baked(
    sources: Vec<Source>,
    dataset: Option<PathBuf>,
    options: &BakeOptions,
    report: &mut Report,
) -> trisplat::Result<Asset> {
    let how = DatasetOptions::default();
    let dataset = dataset.map(|path| Dataset::load(&path, &how)).transpose()?;
    let mut views = dataset.as_ref().map(|dataset| Views::new(dataset, &how));
    report.options = serde_json::to_value(options).unwrap_or_default();
    let loaded = |source| match source {
        Source::File(path) => trisplat::read(&path, &ReadOptions::default()),
        Source::Arrays(loaded) => Ok(loaded),
    };
    let scenes: Vec<Loaded> = sources.into_iter().map(loaded).collect::<trisplat::Result<_>>()?;
    Bake::new(options).photos(views.as_mut()).report(report).run(scenes)
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
