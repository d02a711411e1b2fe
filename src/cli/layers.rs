//! The layer of the typed flags: see [`trisplat_scene::layered`].
//!
//! A flag typed with its default value still overrides the config file, because only the typing counts
//! ([`clap::ArgMatches::value_source`]).

use clap::ArgMatches;
use clap::parser::ValueSource;
use serde::Serialize;
use serde_json::{Map, Value};
use trisplat_scene::{Error, Result};

/// The options of `parsed` that were typed, and no others. Flags are matched by the name of their field, which is unique over all option
/// groups.
pub(super) fn typed<T: Serialize>(parsed: &T, matches: &ArgMatches) -> Result<Value> {
    let parsed = serde_json::to_value(parsed)
        .map_err(|error| Error::invalid("options", error, "values JSON can hold (finite numbers)"))?;
    typed_of(&parsed, matches).map(Value::Object)
}

fn typed_of(parsed: &Value, matches: &ArgMatches) -> Result<Map<String, Value>> {
    let mut typed = Map::new();
    for (key, value) in parsed.as_object().into_iter().flatten() {
        if value.is_object() {
            let group = typed_of(value, matches)?;
            if !group.is_empty() {
                typed.insert(key.clone(), Value::Object(group));
            }
        } else if is_typed(matches, key) {
            if value.is_null() {
                // JSON has no NaN and no infinity, so a typed flag that is null had such a value.
                return Err(Error::invalid(key, "not a finite number", "a finite number"));
            }
            typed.insert(key.clone(), value.clone());
        }
    }
    Ok(typed)
}

/// True when the user typed the flag whose field is `name`.
pub fn is_typed(matches: &ArgMatches, name: &str) -> bool {
    matches.ids().any(|id| id.as_str() == name)
        && matches.value_source(name) == Some(ValueSource::CommandLine)
}
