//! Keyword arguments as options of the bake: each is the field of that name, or a whole group.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value};
use trisplat::{BakeOptions, BakePreset};

/// The options over those of the preset that they name.
pub fn resolve(py: Python<'_>, typed: Option<&Bound<'_, PyDict>>) -> PyResult<BakeOptions> {
    let typed = match typed {
        Some(typed) => from_python(py, typed)?,
        None => Map::new(),
    };
    let preset = typed.get("preset").cloned().unwrap_or_default();
    let preset = match preset {
        Value::Null => BakePreset::default(),
        name => serde_json::from_value(name).map_err(refused)?,
    };
    let mut options = serde_json::to_value(BakeOptions::preset(preset)).map_err(refused)?;
    for (name, value) in typed {
        lay(&mut options, &name, value)?;
    }
    serde_json::from_value(options).map_err(refused)
}

/// Lays one option, or a group of them, over `options`. Names of fields are unique over all groups.
fn lay(options: &mut Value, name: &str, value: Value) -> PyResult<()> {
    if let (Some(Value::Object(group)), Value::Object(given)) = (options.get_mut(name), &value) {
        // What there is not is refused by the types.
        group.extend(given.clone());
        return Ok(());
    }
    let Value::Object(options) = options else { return Err(unknown(name)) };
    if options.get(name).is_some_and(|old| !old.is_object()) {
        options.insert(name.to_owned(), value);
        return Ok(());
    }
    let groups = options.values_mut().filter_map(Value::as_object_mut);
    let field = groups.filter_map(|group| group.get_mut(name)).next().ok_or_else(|| unknown(name))?;
    *field = value;
    Ok(())
}

fn unknown(name: &str) -> PyErr {
    PyValueError::new_err(format!("{name} is no option of the bake: schemas/bake.schema.json lists them"))
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
