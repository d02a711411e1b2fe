//! Keyword arguments as options of the bake: each is the field of that name, or a whole group.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value};
use trisplat::BakeOptions;
use trisplat::layered::Layers;

/// The options over those of the preset that they name.
pub fn resolve(py: Python<'_>, typed: Option<&Bound<'_, PyDict>>) -> PyResult<BakeOptions> {
    let named = typed.map(|typed| from_python(py, typed)).transpose()?.unwrap_or_default();
    let layered = Layers::default().named(named).resolve(BakeOptions::preset);
    layered.map(|layered| layered.options).map_err(|error| PyValueError::new_err(error.to_string()))
}

fn refused(error: serde_json::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Through JSON, as both sides speak it.
fn from_python(py: Python<'_>, dict: &Bound<'_, PyDict>) -> PyResult<Map<String, Value>> {
    let text: String = py.import("json")?.call_method1("dumps", (dict,))?.extract()?;
    serde_json::from_str(&text).map_err(refused)
}

/// A value as Python's own types.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (value.to_string(),))
}
