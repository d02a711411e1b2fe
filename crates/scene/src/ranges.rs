//! The ranges of numeric options. They stand at the fields, `#[schemars(range(…))]`; each number is
//! checked before any work.

use crate::error::{Error, Result};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::Serialize;
use serde_json::Value;

/// Maximum of counts that are practically unbounded.
const MAX_COUNT: f64 = 1e9;
/// Lower bound of a range that excludes 0.
pub const ABOVE_ZERO: f64 = f64::MIN_POSITIVE;

/// The name of a number in errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionNaming {
    /// By its flag, the last part of its key: `max_sigma`.
    Flag,
    /// By its whole key: `loss.opacity`.
    Key,
}

/// Checks every number of `options` against the range at its field. Dependencies between options
/// are checked at their use.
///
/// # Errors
///
/// The first number out of its range.
pub fn check<T: Serialize + JsonSchema>(options: &T, naming: OptionNaming) -> Result<()> {
    each(options, &mut |key, number, range| check_range(key, number, range, naming))
}

/// Checks an optional number, because JSON cannot tell a missing number from one that is not
/// finite.
pub fn check_finite(name: &str, value: Option<f64>) -> Result<()> {
    match value {
        Some(value) if !value.is_finite() => Err(Error::invalid(name, value, "a finite number")),
        _ => Ok(()),
    }
}

/// A count on the command line.
pub fn count(text: &str) -> std::result::Result<usize, String> {
    let number: Option<usize> = text.parse().ok();
    number
        .filter(|count| (1..=MAX_COUNT as usize).contains(count))
        .ok_or_else(|| "expected 1 to 1e9".to_owned())
}

/// Receives the key, the value and the range of a number.
pub type Visit<'a> = &'a mut dyn FnMut(&str, f64, (f64, f64)) -> Result<()>;

/// Calls `visit` with the key, as in `loss.opacity`, the value and the range of each number of
/// `options`; with NaN for one that is not finite, which JSON cannot express.
pub fn each<T: Serialize + JsonSchema>(options: &T, visit: Visit<'_>) -> Result<()> {
    let value = serde_json::to_value(options)
        .map_err(|e| Error::invalid_data(format!("the options cannot be checked: {e}")))?;
    let settings = SchemaSettings::default().with(|settings| settings.inline_subschemas = true);
    let schema = settings.into_generator().into_root_schema_for::<T>();
    each_below(&value, schema.as_value(), "", visit)
}

fn each_below(value: &Value, schema: &Value, key: &str, visit: Visit<'_>) -> Result<()> {
    match value {
        Value::Number(number) => visit(key, number.as_f64().unwrap_or(f64::NAN), range(schema)),
        Value::Null if may_be_null(schema) => Ok(()),
        Value::Null => visit(key, f64::NAN, range(schema)),
        Value::Array(items) => {
            items.iter().try_for_each(|item| each_below(item, &schema["items"], key, visit))
        }
        Value::Object(fields) => fields.iter().try_for_each(|(name, field)| {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            each_below(field, &schema["properties"][name], &key, visit)
        }),
        Value::Bool(_) | Value::String(_) => Ok(()),
    }
}

/// The lowest and highest value of a field.
fn range(schema: &Value) -> (f64, f64) {
    let above = schema["exclusiveMinimum"].as_f64().map(|_| ABOVE_ZERO);
    let low = above.or(schema["minimum"].as_f64()).unwrap_or(f64::MIN);
    (low, schema["maximum"].as_f64().unwrap_or(f64::MAX))
}

fn may_be_null(schema: &Value) -> bool {
    let is_null = |kind: &Value| kind == "null" || kind["type"] == "null";
    [&schema["type"], &schema["anyOf"]]
        .into_iter()
        .filter_map(Value::as_array)
        .flatten()
        .any(is_null)
}

fn check_range(key: &str, value: f64, (low, high): (f64, f64), naming: OptionNaming) -> Result<()> {
    let option = match naming {
        OptionNaming::Key => key,
        OptionNaming::Flag => key.rsplit('.').next().unwrap_or(key),
    };
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(Error::invalid(option, value, range_text(low, high)))
    }
}

fn range_text(low: f64, high: f64) -> String {
    // 1e9 is easier to read than 1000000000.
    let short = |x: f64| {
        if x >= 1e6 && x.log10().fract() == 0.0 { format!("{x:e}") } else { x.to_string() }
    };
    match low {
        ABOVE_ZERO => format!("> 0, at most {}", short(high)),
        _ if high >= MAX_COUNT => format!("{} or more, at most {}", short(low), short(high)),
        _ => format!("{} to {}", short(low), short(high)),
    }
}

/// Values that configs and reports hold as the text of their `FromStr` and `Display`.
#[macro_export]
macro_rules! as_text {
    ($($type:ty),*) => {$(
        impl TryFrom<String> for $type {
            type Error = String;

            fn try_from(text: String) -> std::result::Result<Self, String> {
                text.parse().map_err(|reason| format!("{text:?} {reason}"))
            }
        }

        impl From<$type> for String {
            fn from(value: $type) -> Self {
                value.to_string()
            }
        }
    )*};
}
