//! Errors of the command line suggest a flag only when it is close to the typed one, and never a file named like a flag; of a target they
//! suggest the one for the engine that was named.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Error, ValueEnum};
use trisplat_formats::OutputTarget;

/// Fewer letters are the beginning of too many names.
const SHORTEST_NAME: usize = 4;

/// The error without suggestions that are far from the typed flag, and with a target for the name of an engine.
pub(super) fn plausible(mut error: Error) -> Error {
    if error.kind() == ErrorKind::InvalidValue && error.get(ContextKind::SuggestedValue).is_none() {
        if let Some(target) = meant_target(&error) {
            error.insert(ContextKind::SuggestedValue, ContextValue::String(target));
        }
        return error;
    }
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(texts)) => texts.first().cloned().unwrap_or_default(),
        _ => String::new(),
    };
    let (typed, suggested) = (text(ContextKind::InvalidArg), text(ContextKind::SuggestedArg));
    if !suggested.is_empty() && !near(&typed, &suggested) {
        error.remove(ContextKind::SuggestedArg);
    }
    // No file is called like a flag: clap says how to name one.
    let value = |tip: &str| tip.contains("as a value");
    if let Some(ContextValue::StyledStrs(tips)) = error.get(ContextKind::Suggested)
        && tips.iter().all(|tip| value(&tip.to_string()))
    {
        error.remove(ContextKind::Suggested);
    }
    error
}

/// The target whose description names the engine that was typed as `--target`.
fn meant_target(error: &Error) -> Option<String> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.to_lowercase(),
        _ => String::new(),
    };
    let letters = |word: &str| word.to_lowercase().replace(|c: char| !c.is_alphanumeric(), "");
    let typed = letters(&text(ContextKind::InvalidValue));
    if !text(ContextKind::InvalidArg).starts_with("--target") || typed.len() < SHORTEST_NAME {
        return None;
    }
    let targets = OutputTarget::value_variants().iter().filter_map(ValueEnum::to_possible_value);
    let names_it = |help: String| help.split_whitespace().any(|word| letters(word).starts_with(&typed));
    let mut named = targets.filter(|target| target.get_help().is_some_and(|help| names_it(help.to_string())));
    named.next().map(|target| target.get_name().to_owned())
}

/// Whether one is the other with at most a third of its letters changed, or its beginning.
fn near(typed: &str, suggested: &str) -> bool {
    let letters = |flag: &str| -> Vec<char> {
        let name = flag.trim_start_matches('-').split([' ', '=']).next().unwrap_or_default();
        name.chars().collect()
    };
    let (a, b) = (letters(typed), letters(suggested));
    let begins = a.len() >= 3 && (b.starts_with(&a) || a.starts_with(&b));
    begins || 3 * distance(&a, &b) <= a.len().max(b.len())
}

/// Number of letters to insert, delete, change or swap.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            rows[i][j] = match (i, j) {
                (0, _) => j,
                (_, 0) => i,
                _ => {
                    let same = usize::from(a[i - 1] != b[j - 1]);
                    let plain = (rows[i - 1][j - 1] + same).min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
                    let swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
                    if swapped { plain.min(rows[i - 2][j - 2] + 1) } else { plain }
                }
            };
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_flag_that_is_nearly_what_was_typed_is_suggested() {
        for (typed, suggested, wants) in [
            ("--nope", "--compress", false),
            ("--max-triangle", "--max-triangles", true),
            ("--dateset", "--dataset", true),
            ("--tagret", "--target", true),
            ("--out", "--output <OUT>", true),
            ("--lights", "--limit", false),
        ] {
            assert_eq!(near(typed, suggested), wants, "{typed} {suggested}");
        }
    }
}
