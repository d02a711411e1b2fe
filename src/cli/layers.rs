//! Layers of options: preset < config file < `--set` < flags really typed.
//!
//! A flag typed with its default value still wins over the config file, because what counts is that
//! it was typed ([`clap::ArgMatches::value_source`]), not what it says.

use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use clap::ArgMatches;
use clap::parser::ValueSource;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::Path;

/// A config file: the options that it names, already checked.
#[derive(Debug)]
pub struct Config {
    value: Value,
}

impl Config {
    /// Reads `path` and checks that it holds only keys and types of `T`; a misspelt key is an error
    /// that lists the right ones. `$schema` is allowed and ignored.
    pub fn read<T: DeserializeOwned>(path: &Path, limits: &Limits) -> Result<Self> {
        let text = input::read_text(path, limits)?;
        let broken = |e: serde_json::Error| {
            let reason = e.to_string();
            // Keys of the file are no flags: see `flags::spell`.
            let reason = reason.split(" at line ").next().unwrap_or(&reason).replace('`', "``");
            Error::malformed(path, format!("line {} column {}", e.line(), e.column()), reason)
        };
        let mut value: Value = serde_json::from_str(&text).map_err(broken)?;
        if let Some(map) = value.as_object_mut() {
            map.remove("$schema");
        }
        serde_json::from_str::<T>(&text).map_err(broken)?;
        Ok(Self { value })
    }

    /// The value of a top-level key.
    pub fn field<V: DeserializeOwned>(&self, key: &str) -> Option<V> {
        self.value.get(key).and_then(|v| serde_json::from_value(v.clone()).ok())
    }
}

/// The layers of one command.
#[derive(Debug, Clone, Copy)]
pub struct Layers<'a, T> {
    /// The config file, if any.
    pub config: Option<&'a Path>,
    /// How much of it is read.
    pub limits: &'a Limits,
    /// `KEY=VALUE` settings, which win over the config file.
    pub sets: &'a [String],
    /// The options as clap parsed them; only those really typed count, and win over everything.
    pub typed: &'a T,
    /// Says what was typed.
    pub matches: &'a ArgMatches,
}

impl<T: Serialize + DeserializeOwned> Layers<'_, T> {
    /// The options over those of the preset, which comes from a typed `--preset` (its value is `typed_preset`), else
    /// from the config file, else is the default.
    ///
    /// Errors: the config file or a setting has a key or a value that `T` does not have.
    pub fn resolve<P: DeserializeOwned + Default>(
        &self,
        typed_preset: P,
        options_of: impl Fn(P) -> T,
    ) -> Result<T> {
        let config = self.config.map(|path| Config::read::<T>(path, self.limits)).transpose()?;
        let preset = if is_typed(self.matches, "preset") {
            typed_preset
        } else {
            config.as_ref().and_then(|c| c.field::<P>("preset")).unwrap_or_default()
        };
        let base = options_of(preset);
        let config = with_sets(&base, config, self.sets)?;
        layer(&base, config.as_ref(), self.typed, self.matches)
    }
}

/// `config` overlaid with `KEY=VALUE` settings; keys are those of `base`, groups joined by dots.
/// A key that does not exist is an error that lists the right ones.
fn with_sets<T: Serialize + DeserializeOwned>(
    base: &T,
    config: Option<Config>,
    sets: &[String],
) -> Result<Option<Config>> {
    if sets.is_empty() {
        return Ok(config);
    }
    let known = serde_json::to_value(base).map_err(unrepresentable)?;
    let mut value = config.map_or_else(|| Value::Object(Default::default()), |c| c.value);
    for set in sets {
        let Some((key, text)) = set.split_once('=') else {
            return Err(Error::invalid("--set", set, "KEY=VALUE, as in refine.every=500"));
        };
        let mut level = &known;
        for part in key.split('.') {
            level = level.get(part).ok_or_else(|| Error::invalid("--set", key, names(level)))?;
        }
        if level.is_object() {
            return Err(Error::invalid("--set", key, names(level)));
        }
        let new = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()));
        let nested = key.rsplit('.').fold(new, |inner, part| serde_json::json!({ part: inner }));
        let mut tried = known.clone();
        overlay(&mut tried, &nested);
        if let Err(error) = serde_json::from_value::<T>(tried) {
            return Err(Error::invalid("--set", set, expected(&error.to_string())));
        }
        overlay(&mut value, &nested);
    }
    Ok(Some(Config { value }))
}

/// What serde would have taken, as said to people: "a whole number, 0 or more".
fn expected(error: &str) -> String {
    match error.rsplit_once("expected ").map_or(error, |(_, expected)| expected) {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        // The names are values, not options: see `flags::spell`.
        other => other.replace('`', ""),
    }
}

/// "one of a, b, c": the keys of a group.
fn names(group: &Value) -> String {
    let keys: Vec<&str> = group.as_object().into_iter().flatten().map(|(key, _)| key.as_str()).collect();
    format!("one of {}", keys.join(", "))
}

/// `base` overlaid with `config`, then with the flags of `typed` that were really typed.
/// Flags are matched by the name of their field, which is unique over all option groups.
fn layer<T: Serialize + DeserializeOwned>(
    base: &T,
    config: Option<&Config>,
    typed: &T,
    matches: &ArgMatches,
) -> Result<T> {
    let json = |options: &T| serde_json::to_value(options).map_err(unrepresentable);
    let mut value = json(base)?;
    if let Some(config) = config {
        overlay(&mut value, &config.value);
    }
    overlay_typed(&mut value, &json(typed)?, matches)?;
    serde_json::from_value(value).map_err(unrepresentable)
}

fn unrepresentable(error: serde_json::Error) -> Error {
    Error::invalid("options", error, "values JSON can hold (finite numbers)")
}

/// True when the user typed the flag whose field is `name`.
pub fn is_typed(matches: &ArgMatches, name: &str) -> bool {
    matches.ids().any(|id| id.as_str() == name)
        && matches.value_source(name) == Some(ValueSource::CommandLine)
}

fn overlay(base: &mut Value, top: &Value) {
    match (base, top) {
        (Value::Object(base), Value::Object(top)) => {
            for (key, value) in top {
                overlay(base.entry(key.clone()).or_insert(Value::Null), value);
            }
        }
        (base, top) => *base = top.clone(),
    }
}

fn overlay_typed(base: &mut Value, typed: &Value, matches: &ArgMatches) -> Result<()> {
    let (Value::Object(base), Value::Object(typed)) = (base, typed) else { return Ok(()) };
    for (key, value) in typed {
        let slot = base.entry(key.clone()).or_insert(Value::Null);
        if value.is_object() {
            overlay_typed(slot, value, matches)?;
        } else if is_typed(matches, key) {
            if value.is_null() {
                // JSON has no NaN and no infinity: a flag that was typed and is null was one of them.
                return Err(Error::invalid(flag(key), "not a finite number", "a finite number"));
            }
            *slot = value.clone();
        }
    }
    Ok(())
}

/// The flag of a field: `min_opacity` is typed `--min-opacity`.
fn flag(field: &str) -> String {
    format!("--{}", field.replace('_', "-"))
}
