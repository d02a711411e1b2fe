//! Scenes to arrays and back.

use bytemuck::allocation::cast_vec;
use glam::Vec3;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArrayLikeDyn, PyArrayMethods, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trisplat::{Mesh, Scene, Soup};
use trisplat_scene::{image::RgbImage, mesh::Colors};

/// The arrays of a scene: its own memory, handed on.
pub fn of_scene(py: Python<'_>, scene: Scene) -> PyResult<Bound<'_, PyDict>> {
    match scene {
        Scene::Soup(soup) => of_soup(py, soup),
        Scene::Mesh(mesh) => of_mesh(py, mesh),
    }
}

/// The arrays of a soup.
pub fn of_soup(py: Python<'_>, soup: Soup) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    let count = soup.len();
    let coefficients = soup.sh_count();
    put(
        &out,
        "triangles",
        cast_vec::<_, [f32; 9]>(soup.vertices).into_flattened(),
        &[count, 3, 3],
    )?;
    put(&out, "opacity", soup.opacity, &[count])?;
    put(&out, "sigma", soup.sigma, &[count])?;
    put(&out, "sh", soup.sh.into_flattened(), &[count, coefficients, 3])?;
    Ok(out)
}

/// The arrays of a mesh; faces without shared vertices get running numbers.
pub fn of_mesh(py: Python<'_>, mesh: Mesh) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    let faces = mesh.face_count();
    let vertices = mesh.vertex_count();
    put(
        &out,
        "positions",
        cast_vec::<_, [f32; 3]>(mesh.positions).into_flattened(),
        &[vertices, 3],
    )?;
    let running = || (0..vertices as u32).collect();
    put(
        &out,
        "faces",
        if mesh.indices.is_empty() { running() } else { mesh.indices },
        &[faces, 3],
    )?;
    let (Colors::Face(colors) | Colors::Vertex(colors)) = mesh.colors;
    let count = colors.len();
    put(&out, "colors", colors.into_flattened(), &[count, 3])?;
    if !mesh.opacity.is_empty() {
        put(&out, "opacity", mesh.opacity, &[faces])?;
    }
    Ok(out)
}

/// The picture as rows from the top.
pub fn put_picture(out: &Bound<'_, PyDict>, name: &str, picture: &RgbImage) -> PyResult<()> {
    let [width, height] = picture.size.to_array().map(|n| n as usize);
    put(out, name, picture.rgb.as_flattened().to_vec(), &[height, width, 3])
}

/// Adds an array that owns the values.
fn put<T: Element>(
    out: &Bound<'_, PyDict>,
    key: &str,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<()> {
    out.set_item(key, PyArray1::from_vec(out.py(), values).reshape(shape)?)
}

/// The scene of some arrays.
pub fn to_scene(dict: &Bound<'_, PyDict>) -> PyResult<Scene> {
    let keys: &[&str] = match (dict.contains("triangles")?, dict.contains("positions")?) {
        (true, false) => &["triangles", "opacity", "sigma", "sh"],
        (false, true) => &["positions", "faces", "colors", "opacity"],
        _ => {
            return Err(PyValueError::new_err(
                "expected either `triangles`, a soup, or `positions`, a mesh",
            ));
        }
    };
    for key in dict.keys() {
        let key: String = key.extract()?;
        if !keys.contains(&key.as_str()) {
            return Err(PyValueError::new_err(format!("`{key}` is none of {}", keys.join(", "))));
        }
    }
    let scene = match keys[0] {
        "triangles" => Scene::Soup(to_soup(dict)?),
        _ => Scene::Mesh(to_mesh(dict)?),
    };
    scene.validate().map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(scene)
}

/// Missing values are opacity 1, σ 0.01 and white.
fn to_soup(dict: &Bound<'_, PyDict>) -> PyResult<Soup> {
    let Array { values, rows } = wanted(dict, "triangles", &[3, 3])?;
    let corners: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
    let one = |key, default: f32| match array(dict, key, &[])? {
        Some(Array { values, .. }) => Ok::<_, PyErr>(values),
        None => Ok(vec![default; rows]),
    };
    let (sh, degree) = match dict.get_item("sh")? {
        Some(given) => sh(&given)?,
        // C0 times this is one half, white.
        None => (vec![[0.5 / trisplat_scene::SH_C0; 3]; rows], 0),
    };
    Ok(Soup {
        vertices: corners
            .chunks_exact(3)
            .map(|corners| [corners[0], corners[1], corners[2]])
            .collect(),
        opacity: one("opacity", 1.0)?,
        sigma: one("sigma", 0.01)?,
        sh,
        sh_degree: degree,
        ..Soup::default()
    })
}

/// Coefficients of spherical harmonics and their degree.
fn sh(given: &Bound<'_, PyAny>) -> PyResult<(Vec<[f32; 3]>, u8)> {
    let given: PyArrayLikeDyn<'_, f32, AllowTypeChange> = given.extract()?;
    let degree = match given.shape() {
        [_, k @ (1 | 4 | 9 | 16), 3] => k.isqrt() as u8 - 1,
        other => return Err(shape_of("sh", other, "(N, K, 3) with K = 1, 4, 9 or 16")),
    };
    let values: Vec<f32> = given.as_array().iter().copied().collect();
    Ok((values.as_chunks::<3>().0.to_vec(), degree))
}

fn to_mesh(dict: &Bound<'_, PyDict>) -> PyResult<Mesh> {
    let Array { values, rows } = wanted(dict, "positions", &[3])?;
    let indices = match dict.get_item("faces")? {
        Some(faces) => {
            let faces: PyArrayLikeDyn<'_, u32, AllowTypeChange> = faces.extract()?;
            match faces.shape() {
                [_, 3] => faces.as_array().iter().copied().collect(),
                other => return Err(shape_of("faces", other, "(F, 3)")),
            }
        }
        None => Vec::new(),
    };
    let faces = if indices.is_empty() { rows / 3 } else { indices.len() / 3 };
    let Array { values: colors, rows: colored } = wanted(dict, "colors", &[3])?;
    let colors = colors.as_chunks::<3>().0.to_vec();
    let colors = match colored == faces {
        true => Colors::Face(colors),
        false => Colors::Vertex(colors),
    };
    let opacity = array(dict, "opacity", &[])?.map_or(Vec::new(), |array| array.values);
    let positions = values.chunks_exact(3).map(Vec3::from_slice).collect();
    Ok(Mesh { positions, colors, indices, opacity, ..Mesh::default() })
}

/// An array's values in order, and its length along the first axis.
struct Array {
    values: Vec<f32>,
    rows: usize,
}

fn wanted(dict: &Bound<'_, PyDict>, key: &str, rest: &[usize]) -> PyResult<Array> {
    array(dict, key, rest)?.ok_or_else(|| PyValueError::new_err(format!("`{key}` is missing")))
}

/// An array of that name whose shape is (N, ...rest).
fn array(dict: &Bound<'_, PyDict>, key: &str, rest: &[usize]) -> PyResult<Option<Array>> {
    let Some(given) = dict.get_item(key)? else { return Ok(None) };
    let given: PyArrayLikeDyn<'_, f32, AllowTypeChange> = given.extract()?;
    match given.shape() {
        [rows, others @ ..] if others == rest => {
            Ok(Some(Array { values: given.as_array().iter().copied().collect(), rows: *rows }))
        }
        other => {
            let rest: String = rest.iter().map(|n| format!(", {n}")).collect();
            Err(shape_of(key, other, &format!("(N{rest})")))
        }
    }
}

fn shape_of(key: &str, shape: &[usize], wants: &str) -> PyErr {
    PyValueError::new_err(format!("`{key}` has the shape {shape:?}: expected {wants}"))
}
