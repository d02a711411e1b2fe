//! The dashes of flags. The library names options by their fields (`max_triangles`); a user types `--max-triangles`.

use clap::{ArgMatches, Command};
use trisplat_scene::{Error, Result};

/// The innermost subcommand that was typed.
pub fn innermost<'a>(command: &'a Command, matches: &ArgMatches) -> &'a Command {
    let typed = matches.subcommand().and_then(|(name, inner)| Some((command.find_subcommand(name)?, inner)));
    typed.map_or(command, |(command, inner)| innermost(command, inner))
}

/// Fails if a typed number is not finite, because options in layers are JSON, which cannot express it.
pub fn check_finite(matches: &ArgMatches) -> Result<()> {
    for id in matches.ids().map(clap::Id::as_str) {
        let numbers = matches.try_get_many::<f64>(id).ok().flatten();
        if let Some(number) = numbers.into_iter().flatten().find(|number| !number.is_finite()) {
            return Err(Error::invalid(id, number, "a finite number"));
        }
    }
    matches.subcommand().map_or(Ok(()), |(_, inner)| check_finite(inner))
}

/// The message of `error` with the flags of `command` spelt as they are typed.
pub fn message(error: &Error, command: &Command) -> String {
    let text = error.to_string();
    match error {
        Error::Invalid { option, .. } => {
            let name = typed(command, option).unwrap_or_else(|| option.clone());
            format!("{name}{}", spell(&text[option.len()..], command))
        }
        _ => spell(&text, command),
    }
}

/// `text` with every field in backticks replaced by its flag in `command`. Two backticks stand for a printed
/// one.
pub fn spell(text: &str, command: &Command) -> String {
    let mut parts = text.split('`').peekable();
    let mut out = parts.next().unwrap_or_default().to_owned();
    // A quoted word stands between an odd backtick and the next, if any.
    while let Some(word) = parts.next() {
        match (parts.next(), typed(command, word)) {
            (Some(rest), _) if word.is_empty() => out += &format!("`{rest}"),
            (Some(rest), Some(typed)) => out += &(typed + rest),
            (Some(rest), None) => out += &format!("`{word}`{rest}"),
            (None, _) => out += &format!("`{word}"),
        }
    }
    out
}

/// How a field is typed: `--max-edge`, or `IN` when it has no flag; `None` when it is no argument of `command`.
fn typed(command: &Command, field: &str) -> Option<String> {
    let argument = command.get_arguments().find(|a| a.get_id() == field)?;
    match argument.get_long() {
        Some(long) => Some(format!("--{long}")),
        None => argument.get_value_names()?.first().map(ToString::to_string),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command() -> Command {
        let edge = clap::Arg::new("max_edge").long("max-edge");
        Command::new("bake").arg(edge).arg(clap::Arg::new("inputs").value_name("IN"))
    }

    #[test]
    fn fields_become_flags_and_other_words_stay() {
        let error = Error::invalid("max_edge", -1, "0 or more; see `max_edge`, `photo` and `trisplat bake`");
        let wants = "--max-edge is -1: expected 0 or more; see --max-edge, `photo` and `trisplat bake`";
        assert_eq!(message(&error, &command()), wants);
        assert_eq!(message(&Error::invalid("inputs", "-", "a file"), &command()), "IN is -: expected a file");
        assert_eq!(
            message(&Error::invalid("draw.near", 0, "> 0"), &command()),
            "draw.near is 0: expected > 0"
        );
        assert_eq!(spell("a lone ` stays, `max_edge` too", &command()), "a lone ` stays, `max_edge` too");
        assert_eq!(spell("the key ``max_edge``, `max_edge`", &command()), "the key `max_edge`, --max-edge");
    }
}
