//! The dashes of flags. The library names options by their fields (`max_triangles`); a user types `--max-triangles`.

use crate::error::Error;
use clap::{ArgMatches, Command};

/// The command that was typed: the subcommand of a subcommand, where there is one.
pub fn innermost<'a>(command: &'a Command, matches: &ArgMatches) -> &'a Command {
    let typed = matches.subcommand().and_then(|(name, inner)| Some((command.find_subcommand(name)?, inner)));
    typed.map_or(command, |(command, inner)| innermost(command, inner))
}

/// The message of `error` with the flags of `command` spelt as they are typed.
pub fn message(error: &Error, command: &Command) -> String {
    let text = error.to_string();
    match error {
        Error::Invalid { option, .. } if is_flag(command, option) => {
            format!("{}{}", typed(option), spell(&text[option.len()..], command))
        }
        _ => spell(&text, command),
    }
}

/// `text` with every field in backticks that is a flag of `command` spelt as it is typed.
pub fn spell(text: &str, command: &Command) -> String {
    let mut parts = text.split('`').peekable();
    let mut out = parts.next().unwrap_or_default().to_owned();
    // Between an odd backtick and the next stands a quoted word, if there is a next.
    while let Some(word) = parts.next() {
        match parts.next() {
            Some(rest) if is_flag(command, word) => out += &(typed(word) + rest),
            Some(rest) => out += &format!("`{word}`{rest}"),
            None => out += &format!("`{word}"),
        }
    }
    out
}

fn is_flag(command: &Command, field: &str) -> bool {
    command.get_arguments().any(|a| a.get_long().is_some() && a.get_id() == field)
}

fn typed(field: &str) -> String {
    format!("--{}", field.replace('_', "-"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command() -> Command {
        Command::new("bake").arg(clap::Arg::new("max_edge").long("max-edge"))
    }

    #[test]
    fn fields_become_flags_and_other_words_stay() {
        let error = Error::invalid("max_edge", -1, "0 or more; see `max_edge`, `photo` and `trisplat bake`");
        let wants = "--max-edge is -1: wants 0 or more; see --max-edge, `photo` and `trisplat bake`";
        assert_eq!(message(&error, &command()), wants);
        assert_eq!(message(&Error::invalid("draw.near", 0, "> 0"), &command()), "draw.near is 0: wants > 0");
        assert_eq!(spell("a lone ` stays, `max_edge` too", &command()), "a lone ` stays, `max_edge` too");
    }
}
