//! What the settings of a sweep are changes of: the defaults of the options, and the sizes that stand for some of them.

use super::draw::DrawSettings;
use super::knobs::{CostStage, KnobValue};
use crate::bake::BakeOptions;
use crate::train::TrainOptions;
use serde_json::Value;

/// The defaults of a sweep.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Base {
    /// Steps of a training.
    pub(super) steps: u64,
    /// Most triangles of a training.
    pub(super) max_triangles: u64,
    /// Longer side of the largest photo, px.
    pub(super) long_side: u32,
    /// Triangles of the soup that is baked.
    pub(super) soup_triangles: u64,
}

impl Base {
    /// The options of a default training.
    pub(super) fn training(&self) -> TrainOptions {
        TrainOptions { steps: self.steps, max_triangles: self.max_triangles, ..TrainOptions::default() }
    }

    /// The default of an option as it is typed; `None` when the stage has no such option.
    pub(super) fn default_of(&self, stage: CostStage, name: &str) -> Option<String> {
        let value = match stage {
            CostStage::Train => {
                // Photos are as large as they are.
                let whole = (name == "max_size").then(|| self.long_side.into());
                let path = format!("/{}", name.replace('.', "/"));
                whole.or_else(|| to_json(&self.training()).pointer(&path).cloned())
            }
            CostStage::Bake => field_of_groups(&to_json(&BakeOptions::DEFAULT), name),
            CostStage::Draw => to_json(&DrawSettings::default()).get(name).cloned(),
            CostStage::Chain => None,
        };
        value.filter(|value| !value.is_object()).map(|value| typed(&value))
    }

    /// A value of an option as it is typed.
    pub(super) fn value_of(&self, stage: CostStage, name: &str, value: KnobValue) -> String {
        match value {
            KnobValue::Is(text) => text.to_owned(),
            KnobValue::Times(factor) => {
                let one = match (stage, name) {
                    (_, "steps") => self.steps,
                    (_, "max_size") => self.long_side.into(),
                    (CostStage::Train, _) => self.max_triangles,
                    _ => self.soup_triangles,
                };
                ((one as f64 * factor).round().max(1.0) as u64).to_string()
            }
        }
    }
}

fn to_json(value: &impl serde::Serialize) -> Value {
    serde_json::to_value(value).unwrap_or_default()
}

/// A field of the options, or of one of their groups; names are unique over all of them.
fn field_of_groups(options: &Value, name: &str) -> Option<Value> {
    let groups = options.as_object()?;
    let own = groups.get(name).filter(|value| !value.is_object()).cloned();
    own.or_else(|| groups.values().find_map(|group| group.get(name).cloned()))
}

/// A JSON value as it is typed.
fn typed(value: &Value) -> String {
    match value {
        Value::Null => "none".into(),
        Value::String(text) => text.clone(),
        Value::Array(all) if all.is_empty() => "none".into(),
        other => other.to_string(),
    }
}
