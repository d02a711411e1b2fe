//! The hint of an unknown flag that is a setting: `--contour 0.3` is typed `--set contour=0.3`.

use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use serde_json::Value;
use trisplat_bake::{BakeOptions, MeshOptions};
use trisplat_train::TrainOptions;

/// `error` of the arguments `words`, with a hint if an unknown flag is a key of `--set`.
pub(super) fn with_hint(mut error: Error, words: &[String]) -> Error {
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return error };
    let field = flag.trim_start_matches('-').split('=').next().unwrap_or_default().replace('-', "_");
    if !words.iter().find_map(|word| options_of(word)).is_some_and(|options| has(&options, &field)) {
        return error;
    }
    let hint = format!("`{field}` is a setting: --set {field}=VALUE");
    error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint.into()]));
    error.remove(ContextKind::SuggestedArg);
    error
}

/// The options that the command `word` sets.
fn options_of(word: &str) -> Option<Value> {
    match word {
        "bake" => serde_json::to_value(BakeOptions::DEFAULT).ok(),
        "mesh" => serde_json::to_value(MeshOptions::default()).ok(),
        "train" | "plan" => serde_json::to_value(TrainOptions::default()).ok(),
        _ => None,
    }
}

/// Whether an option, or an option of a group, has this name.
fn has(options: &Value, field: &str) -> bool {
    let own = options.get(field).is_some_and(|value| !value.is_object());
    own || options.as_object().into_iter().flatten().any(|(_, group)| group.get(field).is_some())
}
