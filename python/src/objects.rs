//! Meshes as objects of other Python packages, which are imported when they are asked for.

use crate::{arrays, raised};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use trisplat::{Mesh, ReadOptions, Scene};
use trisplat_scene::{math::color::srgb_from_linear, mesh::Colors};

/// A mesh, a file or the arrays of `read` and `bake`, as a `trimesh.Trimesh` in sRGB colours.
/// Textures become colours.
///
/// Raises ImportError without the package trimesh; ValueError for a soup, which `bake` makes a
/// mesh; OSError.
#[pyfunction]
pub fn to_trimesh<'py>(source: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = source.py();
    let class = py.import("trimesh")?.getattr("Trimesh")?;
    let mut mesh = mesh(source)?;
    encode(&mut mesh);
    let at_faces = matches!(mesh.colors, Colors::Face(_));
    let made = arrays::of_mesh(py, mesh)?;
    let codes = made.as_any().get_item("colors")?.call_method1("__mul__", (255,))?;
    let codes = codes.call_method0("round")?.call_method1("astype", ("uint8",))?;
    let named = PyDict::new(py);
    named.set_item("vertices", made.get_item("positions")?)?;
    named.set_item("faces", made.get_item("faces")?)?;
    named.set_item(if at_faces { "face_colors" } else { "vertex_colors" }, codes)?;
    named.set_item("process", false)?;
    class.call((), Some(&named))
}

/// A mesh, a file or the arrays of `read` and `bake`, as an `open3d.geometry.TriangleMesh` in sRGB
/// colours. Textures become colours.
///
/// Its colours are at vertices, so faces with a colour of their own share none. Raises ImportError
/// without the package open3d; ValueError for a soup, which `bake` makes a mesh; OSError.
#[pyfunction]
pub fn to_open3d<'py>(source: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = source.py();
    let geometry = py.import("open3d")?.getattr("geometry")?;
    let utility = py.import("open3d")?.getattr("utility")?;
    let mut mesh = mesh(source)?;
    encode(&mut mesh);
    if let Colors::Face(colors) = &mesh.colors {
        let colors = Colors::Vertex(colors.iter().flat_map(|color| [*color; 3]).collect());
        let positions = (0..mesh.face_count()).flat_map(|face| mesh.corners(face)).collect();
        mesh = Mesh { positions, colors, ..Mesh::default() };
    }
    let made = arrays::of_mesh(py, mesh)?;
    let vectors = |class: &str, key: &str, kind: &str| {
        let values = made.as_any().get_item(key)?.call_method1("astype", (kind,))?;
        utility.getattr(class)?.call1((values,))
    };
    let places = vectors("Vector3dVector", "positions", "float64")?;
    let faces = vectors("Vector3iVector", "faces", "int32")?;
    let object = geometry.getattr("TriangleMesh")?.call1((places, faces))?;
    object.setattr("vertex_colors", vectors("Vector3dVector", "colors", "float64")?)?;
    Ok(object)
}

fn mesh(source: &Bound<'_, PyAny>) -> PyResult<Mesh> {
    let scene = match source.cast::<PyDict>() {
        Ok(dict) => arrays::to_scene(dict)?,
        Err(_) => {
            let path: PathBuf = source.extract()?;
            let read = || trisplat_formats::read(&path, &ReadOptions::default());
            source.py().detach(read).map_err(raised)?.scene
        }
    };
    match scene {
        Scene::Mesh(mesh) => Ok(mesh),
        Scene::Soup(_) => Err(PyValueError::new_err(
            "a soup is not a mesh yet: give what trisplat.bake(scene) returns",
        )),
    }
}

/// Linear colours to sRGB, which both packages show as they are.
fn encode(mesh: &mut Mesh) {
    let (Colors::Face(colors) | Colors::Vertex(colors)) = &mut mesh.colors;
    for channel in colors.as_flattened_mut() {
        *channel = srgb_from_linear(channel.clamp(0.0, 1.0));
    }
}
