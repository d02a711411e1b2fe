//! Keyword arguments as options: each names a field or a group.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use trisplat_scene::layered::{Layered, Layers};

/// The options over those of their preset.
pub fn resolve<T: Serialize + DeserializeOwned, P: DeserializeOwned + Default>(
    py: Python<'_>,
    typed: Option<&Bound<'_, PyDict>>,
    preset: impl Fn(P) -> T,
) -> PyResult<Layered<T>> {
    let named = typed.map(|typed| from_python(py, typed)).transpose()?.unwrap_or_default();
    let layered = Layers::default().with_named_options(named).resolve(preset);
    layered.map_err(|error| PyValueError::new_err(error.to_string()))
}

/// Options without presets; missing ones have default values.
pub fn plain<T: DeserializeOwned + Default>(
    py: Python<'_>,
    typed: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    match typed {
        Some(typed) => {
            serde_json::from_value(Value::Object(from_python(py, typed)?)).map_err(refused)
        }
        None => Ok(T::default()),
    }
}

/// The value of that name.
pub fn named<T: DeserializeOwned>(option: &str, name: &str) -> PyResult<T> {
    let value = serde_json::from_value(Value::String(name.to_owned()));
    value.map_err(|error| PyValueError::new_err(format!("`{option}` is {name:?}: {error}")))
}

/// Samples along each axis of a pixel.
pub fn samples(count: u32) -> PyResult<u32> {
    match count {
        1 | 2 | 4 => Ok(count),
        _ => Err(PyValueError::new_err(format!("`ssaa` is {count}: expected 1, 2 or 4"))),
    }
}

fn refused(error: serde_json::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Through JSON, which both sides support.
fn from_python(py: Python<'_>, dict: &Bound<'_, PyDict>) -> PyResult<Map<String, Value>> {
    let text: String = py.import("json")?.call_method1("dumps", (dict,))?.extract()?;
    serde_json::from_str(&text).map_err(refused)
}

/// A value as Python's own types.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (value.to_string(),))
}
