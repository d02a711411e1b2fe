//! Options in layers: preset < config file < settings < given options. Each value knows its layer.

use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::Path;

/// The key of a config file that names its schema for editors; it is not an option.
const SCHEMA_KEY: &str = "\"$schema\"";
/// The key of the preset, where options have one.
const PRESET_KEY: &str = "preset";

/// The layer of a value: the last one that has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Origin {
    /// The preset.
    Preset,
    /// The config file.
    File,
    /// A setting, `KEY=VALUE`.
    Setting,
    /// Given directly: a typed flag, an argument.
    Given,
}

/// The layers over a preset, each with only the options that it names.
#[derive(Debug, Clone)]
pub struct Layers<T> {
    file: Value,
    sets: Vec<String>,
    given_options: Value,
    named_options: Map<String, Value>,
    options: std::marker::PhantomData<T>,
}

impl<T> Default for Layers<T> {
    fn default() -> Self {
        let empty = || Value::Object(Map::new());
        Self {
            file: empty(),
            sets: Vec::new(),
            given_options: empty(),
            named_options: Map::new(),
            options: std::marker::PhantomData,
        }
    }
}

/// Options, and the layer of each.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Layered<T> {
    /// The options.
    pub options: T,
    /// From the last layer to the first above the preset.
    layers: [(Origin, Value); 3],
}

impl<T> Layered<T> {
    /// The layer of the option `key`, groups joined by dots: `refine.every`.
    pub fn origin(&self, key: &str) -> Origin {
        let names =
            |layer: &Value| key.split('.').try_fold(layer, |level, part| level.get(part)).is_some();
        self.layers
            .iter()
            .find(|(_, layer)| names(layer))
            .map_or(Origin::Preset, |(origin, _)| *origin)
    }

    /// True when a layer above the preset has the option `key`.
    pub fn is_given(&self, key: &str) -> bool {
        self.origin(key) > Origin::Preset
    }

    /// Marks `keys` as given, also where their values are the preset's.
    pub fn mark_given(mut self, keys: &[&str]) -> Self
    where
        T: Serialize,
    {
        let all = serde_json::to_value(&self.options).unwrap_or_default();
        let given = keys.iter().filter_map(|key| Some(((*key).to_owned(), all.get(key)?.clone())));
        overlay(&mut self.layers[0].1, &Value::Object(given.collect()));
        self
    }
}

impl<T: Serialize> Layered<T> {
    /// Options from a program: values that differ from `preset` count as given.
    pub fn over(preset: &T, options: T) -> Self {
        let json = |options: &T| serde_json::to_value(options).unwrap_or_default();
        let given = difference(&json(preset), &json(&options)).unwrap_or_default();
        let empty = || Value::Object(Map::new());
        let layers = [(Origin::Given, given), (Origin::Setting, empty()), (Origin::File, empty())];
        Self { options, layers }
    }
}

impl<T: Serialize + DeserializeOwned> Layers<T> {
    /// Adds the config file at `path`; `limits` bounds its size. Its key `$schema` is ignored.
    ///
    /// # Errors
    ///
    /// A file that cannot be read; an unknown key or wrong type, with its place in the file.
    pub fn with_file(self, path: &Path, limits: &Limits) -> Result<Self> {
        let text = input::read_text(path, limits)?;
        let broken = |e: serde_json::Error| {
            let reason = e.to_string();
            // Keys of the file are not flags: two backticks stand for a printed one.
            let reason = reason.split(" at line ").next().unwrap_or(&reason).replace('`', "``");
            Error::malformed(path, format!("line {} column {}", e.line(), e.column()), reason)
        };
        let text = without_schema(&text);
        serde_json::from_str::<T>(&text).map_err(broken)?;
        let file = Value::Object(serde_json::from_str(&text).map_err(broken)?);
        Ok(Self { file, ..self })
    }

    /// Adds settings, `KEY=VALUE` each, groups joined by dots; the group may be omitted if no other
    /// group has the key.
    pub fn with_settings(self, sets: &[String]) -> Self {
        Self { sets: sets.to_vec(), ..self }
    }

    /// Adds the options in `given`, a JSON object with some keys of `T`.
    pub fn with_options(self, given: Value) -> Self {
        Self { given_options: given, ..self }
    }

    /// Adds options by the names of their fields, which are unique over all groups, or of groups;
    /// they count as given.
    pub fn with_named_options(self, named: Map<String, Value>) -> Self {
        Self { named_options: named, ..self }
    }

    /// The options, laid over the preset's. The last layer that names a preset decides it.
    ///
    /// # Errors
    ///
    /// An unknown setting or option; a value of another type.
    pub fn resolve<P: DeserializeOwned + Default>(
        self,
        options_of: impl Fn(P) -> T,
    ) -> Result<Layered<T>> {
        let json = |options: &T| serde_json::to_value(options).map_err(unrepresentable);
        let defaults = json(&options_of(P::default()))?;
        let settings = settings::<T>(&defaults, &self.sets)?;
        let mut given_options = self.given_options;
        for (name, value) in &self.named_options {
            let nested = in_group(&defaults, name, value)?;
            let mut tried = defaults.clone();
            overlay(&mut tried, &nested);
            serde_json::from_value::<T>(tried).map_err(|e| refused_value(name, value, &e))?;
            overlay(&mut given_options, &nested);
        }
        let layers = [
            (Origin::Given, given_options),
            (Origin::Setting, settings),
            (Origin::File, self.file),
        ];
        let preset = layers.iter().find_map(|(_, layer)| layer.get(PRESET_KEY));
        let preset = match preset {
            Some(name) => serde_json::from_value(name.clone())
                .map_err(|e| refused_value(PRESET_KEY, name, &e))?,
            None => P::default(),
        };
        let mut value = json(&options_of(preset))?;
        for (_, layer) in layers.iter().rev() {
            overlay(&mut value, layer);
        }
        let options = serde_json::from_value(value).map_err(unrepresentable)?;
        Ok(Layered { options, layers })
    }
}

/// Settings as an object of the shape of `defaults`, with groups joined by dots. An unknown key is
/// an error that lists the right ones.
fn settings<T: DeserializeOwned>(defaults: &Value, sets: &[String]) -> Result<Value> {
    let mut value = Value::Object(Map::new());
    for set in sets {
        let Some((key, text)) = set.split_once('=') else {
            return Err(Error::invalid("sets", set, "KEY=VALUE, as in refine.every=500"));
        };
        let key = &full_key(defaults, key)?;
        let new = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()));
        let nested = key.rsplit('.').fold(new, |inner, part| serde_json::json!({ part: inner }));
        let mut tried = defaults.clone();
        overlay(&mut tried, &nested);
        serde_json::from_value::<T>(tried).map_err(|e| refused_value("sets", set, &e))?;
        overlay(&mut value, &nested);
    }
    Ok(value)
}

/// `key` with its group: `contour` is `solid.contour`, if no other group has a key of that name.
///
/// # Errors
///
/// An unknown key; the message lists the right ones.
fn full_key(defaults: &Value, key: &str) -> Result<String> {
    if let Some(groups) = defaults.as_object().filter(|_| !key.contains('.')) {
        let own = groups.get(key).is_some_and(|value| !value.is_object());
        let mut of_groups = groups.iter().filter(|(_, group)| group.get(key).is_some());
        if !own
            && let Some((group, _)) = of_groups.next()
            && of_groups.next().is_none()
        {
            return Ok(format!("{group}.{key}"));
        }
    }
    let mut level = defaults;
    for part in key.split('.') {
        level = level.get(part).ok_or_else(|| Error::invalid("sets", key, names(level)))?;
    }
    if level.is_object() {
        return Err(Error::invalid("sets", key, names(level)));
    }
    Ok(key.to_owned())
}

/// An option by the name of its field, as an object of the shape of `defaults`.
fn in_group(defaults: &Value, name: &str, value: &Value) -> Result<Value> {
    // A group and a field in it may have the same name: only an object is a group.
    if defaults.get(name).is_some_and(|own| own.is_object() == value.is_object()) {
        return Ok(serde_json::json!({ name: value }));
    }
    let mut groups = defaults.as_object().into_iter().flatten();
    match groups.find(|(_, group)| group.get(name).is_some()) {
        Some((group, _)) => Ok(serde_json::json!({ group.as_str(): { name: value } })),
        None => Err(Error::invalid_data(format!(
            "{name} is not the name of an option; the schema of the config file lists them"
        ))),
    }
}

/// The error of a value that serde refuses.
fn refused_value(option: &str, value: impl ToString, error: &serde_json::Error) -> Error {
    Error::invalid(option, value, expected(&error.to_string()))
}

/// The type that serde expected, in plain words: "a whole number, 0 or more".
fn expected(error: &str) -> String {
    match error.rsplit_once("expected ").map_or(error, |(_, expected)| expected) {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        // The names are values, not options.
        other => other.replace('`', ""),
    }
}

/// "one of a, b, c": the keys of a group.
fn names(group: &Value) -> String {
    let keys: Vec<&str> =
        group.as_object().into_iter().flatten().map(|(key, _)| key.as_str()).collect();
    format!("one of {}", keys.join(", "))
}

fn unrepresentable(error: serde_json::Error) -> Error {
    Error::invalid_data(format!("the options must be finite numbers and text: {error}"))
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

/// The values of `top` that differ from `base`.
fn difference(base: &Value, top: &Value) -> Option<Value> {
    match (base, top) {
        (Value::Object(base), Value::Object(top)) => {
            let differs = |(key, value): (&String, &Value)| {
                Some((key.clone(), difference(base.get(key).unwrap_or(&Value::Null), value)?))
            };
            let differing: Map<String, Value> = top.iter().filter_map(differs).collect();
            (!differing.is_empty()).then_some(Value::Object(differing))
        }
        (base, top) => (base != top).then(|| top.clone()),
    }
}

/// `text` of a JSON object with spaces in place of its key `$schema`: types of options refuse
/// unknown keys, and errors must keep their place in the text.
fn without_schema(text: &str) -> String {
    // In a group the key is refused like any unknown one.
    let is_own = |key: &usize| {
        let [opened, closed] = ['{', '}'].map(|brace| text[..*key].matches(brace).count());
        opened == closed + 1 && text[key + SCHEMA_KEY.len()..].trim_start().starts_with(':')
    };
    let is_json = serde_json::from_str::<IgnoredAny>(text).is_ok();
    let position = text.find(SCHEMA_KEY).filter(|key| is_json && is_own(key));
    let Some((key, value)) = position.and_then(|key| Some((key, key + text[key..].find(':')? + 1)))
    else {
        return text.to_owned();
    };
    let mut values = serde_json::Deserializer::from_str(&text[value..]).into_iter::<IgnoredAny>();
    if !matches!(values.next(), Some(Ok(_))) {
        return text.to_owned();
    }
    let end = value + values.byte_offset();
    let comma = text[end..].find(|c: char| !c.is_whitespace()).map(|at| end + at);
    // The comma after the value goes with it, or the one before a last value.
    let comma = comma.filter(|at| text[*at..].starts_with(','));
    let start = if comma.is_some() { key } else { text[..key].rfind(',').unwrap_or(key) };
    let end = comma.map_or(end, |comma| comma + 1);
    let blank: String =
        text[start..end].bytes().map(|byte| if byte == b'\n' { '\n' } else { ' ' }).collect();
    [&text[..start], &blank, &text[end..]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Options {
        preset: Preset,
        steps: u64,
        refine: Refine,
    }

    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Refine {
        every: u64,
        growth: f64,
        refine: bool,
    }

    #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Preset {
        #[default]
        Solid,
        Indoor,
    }

    impl Options {
        fn of(preset: Preset) -> Self {
            let steps = if preset == Preset::Solid { 8000 } else { 5000 };
            Self { preset, steps, refine: Refine::default() }
        }
    }

    impl Default for Options {
        fn default() -> Self {
            Self::of(Preset::default())
        }
    }

    fn file(text: &str) -> Result<Layers<Options>> {
        let folder = tempfile::tempdir().map_err(|e| Error::io("tempdir", e))?;
        let path = folder.path().join("config.json");
        std::fs::write(&path, text).map_err(|e| Error::io(&path, e))?;
        Layers::default().with_file(&path, &Limits::DEFAULT)
    }

    fn sets(sets: &[&str]) -> Vec<String> {
        sets.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn each_value_knows_its_layer() -> Result<()> {
        let layers = file(r#"{ "steps": 1, "refine": { "every": 1, "growth": 1 } }"#)?
            .with_settings(&sets(&["refine.every=2", "refine.growth=2"]))
            .with_options(serde_json::json!({ "refine": { "growth": 3.0 } }));
        let layered = layers.resolve(Options::of)?;
        let refine = Refine { every: 2, growth: 3.0, refine: false };
        assert_eq!(layered.options, Options { preset: Preset::Solid, steps: 1, refine });
        let origins =
            ["preset", "steps", "refine.every", "refine.growth"].map(|key| layered.origin(key));
        assert_eq!(origins, [Origin::Preset, Origin::File, Origin::Setting, Origin::Given]);
        assert!(layered.is_given("steps") && !layered.is_given("preset"));
        Ok(())
    }

    #[test]
    fn a_value_that_equals_the_presets_is_given_all_the_same() -> Result<()> {
        let layered = file(r#"{ "steps": 8000 }"#)?.resolve(Options::of)?;
        assert_eq!((layered.origin("steps"), layered.options), (Origin::File, Options::default()));
        let written = Options { steps: 7, ..Options::default() };
        let layered = Layered::over(&Options::default(), written);
        assert!(layered.is_given("steps") && !layered.is_given("refine.every"));
        let same = Layered::over(&Options::default(), Options::default());
        assert!(!same.is_given("steps") && same.mark_given(&["steps"]).is_given("steps"));
        Ok(())
    }

    #[test]
    fn the_base_is_the_preset_of_the_last_layer_that_names_one() -> Result<()> {
        let indoor = Options::of(Preset::Indoor);
        let set = || sets(&["preset=indoor"]);
        assert_eq!(Layers::default().with_settings(&set()).resolve(Options::of)?.options, indoor);
        assert_eq!(file(r#"{ "preset": "indoor" }"#)?.resolve(Options::of)?.options, indoor);
        let solid = serde_json::json!({ "preset": "solid" });
        let layers = file(r#"{ "preset": "indoor" }"#)?.with_settings(&set()).with_options(solid);
        assert_eq!(layers.resolve(Options::of)?.options, Options::default());
        Ok(())
    }

    #[test]
    fn a_config_names_its_schema_and_errors_keep_their_place() -> Result<()> {
        let layered = file(r#"{ "$schema": "a.json", "steps": 5, "refine": { "every": 2 } }"#)?;
        let layered = layered.resolve(Options::of)?;
        assert_eq!((layered.options.steps, layered.options.refine.every), (5, 2));
        let place = |text: &str| match file(text) {
            Err(error) => error.to_string(),
            Ok(_) => "taken".to_owned(),
        };
        let wrong = place("{\n  \"$schema\": \"a.json\",\n  \"refine\": { \"evry\": 2 }\n}");
        assert!(wrong.contains("line 3 column 20") && wrong.contains("evry"), "{wrong}");
        let wrong = place("{\n  \"$schema\": \"a.json\",\n  \"stps\": 5\n}");
        assert!(wrong.contains("line 3 column 8") && wrong.contains("stps"), "{wrong}");
        let wrong = place("{ \"refine\": { \"$schema\": \"a.json\" } }");
        assert!(wrong.contains("$schema"), "{wrong}");
        assert!(place("[]").contains("line 1"), "{}", place("[]"));
        Ok(())
    }

    #[test]
    fn fields_are_found_in_their_groups() -> Result<()> {
        let named = |value: Value| {
            let Value::Object(named) = value else { return Layers::default() };
            Layers::<Options>::default().with_named_options(named)
        };
        let layered = named(
            serde_json::json!({ "preset": "indoor", "every": 5, "refine": { "growth": 2.0 } }),
        );
        let layered = layered.resolve(Options::of)?;
        let refine = Refine { every: 5, growth: 2.0, refine: false };
        assert_eq!(layered.options, Options { refine, ..Options::of(Preset::Indoor) });
        assert_eq!(layered.origin("refine.every"), Origin::Given);
        assert!(
            named(serde_json::json!({ "refine": true }))
                .resolve(Options::of)?
                .options
                .refine
                .refine
        );
        for (wrong, needle) in [
            (serde_json::json!({ "stps": 1 }), "stps is not"),
            (serde_json::json!({ "refine": { "evry": 1 } }), "evry"),
            (serde_json::json!({ "every": "often" }), "a whole number, 0 or more"),
        ] {
            let text =
                named(wrong).resolve(Options::of).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains(needle), "{needle}: {text}");
        }
        Ok(())
    }

    #[test]
    fn a_setting_that_is_none_lists_the_right_ones() {
        for (set, wants) in [
            ("steps", "KEY=VALUE"),
            ("stps=5", "one of preset, steps, refine"),
            ("refine.evry=5", "one of every, growth, refine"),
            ("refine=5", "true or false"),
            ("steps=many", "a whole number, 0 or more"),
            ("preset=best", "solid or indoor"),
        ] {
            let error = Layers::default().with_settings(&sets(&[set])).resolve(Options::of);
            let text = error.err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.starts_with("sets is ") && text.contains(wants), "{set}: {text}");
        }
    }
}
