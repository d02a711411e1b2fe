//! The dashes of flags. The library names options by their fields (`max_triangles`); a user types
//! `--max-triangles`.

use super::suggestions;
use clap::builder::ValueParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::ffi::OsString;
use std::path::Path;
use trisplat_scene::layered::{Layered, Layers};
use trisplat_scene::{Error, Limits, Result};

/// The innermost subcommand that was typed.
pub fn innermost<'a>(command: &'a Command, matches: &ArgMatches) -> &'a Command {
    let typed = matches
        .subcommand()
        .and_then(|(name, inner)| Some((command.find_subcommand(name)?, inner)));
    typed.map_or(command, |(command, inner)| innermost(command, inner))
}

/// Fails if a typed number is not finite, because options in layers are JSON, which cannot express
/// it.
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
    let mut text = error.to_string();
    // The way out, where this command lacks its flag.
    if let Some((_, clause)) = error.way_out().filter(|(field, _)| typed(command, field).is_none())
    {
        text.truncate(text.len() - clause.len());
    }
    match error.option() {
        Some(option) => {
            let name = typed(command, option).unwrap_or_else(|| option.to_owned());
            format!("{name}{}", as_flags(&text[option.len()..], command))
        }
        None => as_flags(&text, command),
    }
}

/// `text` with every field in backticks replaced by its flag in `command`, or its setting. Two
/// backticks stand for a printed one.
pub fn as_flags(text: &str, command: &Command) -> String {
    let mut parts = text.split('`').peekable();
    let mut out = parts.next().unwrap_or_default().to_owned();
    // A quoted word stands between an odd backtick and the next, if any.
    while let Some(word) = parts.next() {
        let spelt =
            || typed(command, word).or_else(|| suggestions::as_switch(command.get_name(), word));
        match (parts.next(), spelt()) {
            (Some(rest), _) if word.is_empty() => out += &format!("`{rest}"),
            (Some(rest), Some(typed)) => out += &(typed + rest),
            (Some(rest), None) => out += &format!("`{word}`{rest}"),
            (None, _) => out += &format!("`{word}"),
        }
    }
    out
}

/// Spelling of a field on the command line: `--max-triangles`, or `IN` when it has no flag; `None` when it is no
/// argument of `command`.
fn typed(command: &Command, field: &str) -> Option<String> {
    let argument = command.get_arguments().find(|a| a.get_id() == field)?;
    match argument.get_long() {
        Some(long) => Some(format!("--{long}")),
        None => argument.get_value_names()?.first().map(ToString::to_string),
    }
}

// ---- Flags of all commands ----------------------------------------------------------------------

/// Flags every command takes.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Everywhere")]
pub struct GlobalArgs {
    /// Print errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print every figure of every stage.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Worker threads, at most four per core; 0 = one per core. Any number gives the same bytes,
    /// except with a budget of time.
    #[arg(long, global = true, default_value_t = 0, value_name = "N", hide_short_help = true)]
    pub threads: u16,
    /// Raise or lower a limit on inputs, as in triangles=100000000; may be given often. The keys:
    /// picture_side, picture_pixels, camera_pixels, triangles, vertices, file_bytes,
    /// document_bytes, array_bytes, nodes, nesting, threads_per_core.
    #[arg(long, global = true, value_name = "KEY=VALUE", hide_short_help = true)]
    pub limit: Vec<String>,
    /// Permit a data set or a glTF document to name files outside its folder.
    #[arg(long, global = true, hide_short_help = true)]
    pub allow_outside: bool,
}

impl GlobalArgs {
    /// The limits with the changes of `--limit`.
    ///
    /// # Errors
    ///
    /// No such limit.
    pub fn limits(&self) -> Result<Limits> {
        let mut limits = Limits::DEFAULT;
        self.limit.iter().try_for_each(|setting| limits.set(setting))?;
        Ok(limits)
    }
}

// ---- The layers of options: see [`trisplat_scene::layered`] -------------------------------------

/// OptionSources of options beside their flags.
pub(super) struct OptionSources<'a> {
    /// The typed flags.
    pub(super) matches: &'a ArgMatches,
    /// `--set`.
    pub(super) sets: &'a [String],
    /// `--config`.
    pub(super) config: Option<&'a Path>,
}

impl OptionSources<'_> {
    /// Preset, then config file, then `--set`, then those of the flags in `parsed` that were really
    /// typed. Flags are matched by the name of their field, which is unique over all option groups.
    pub(super) fn resolve<T: Serialize + DeserializeOwned, P: DeserializeOwned + Default>(
        &self,
        parsed: &T,
        limits: &Limits,
        preset: impl Fn(P) -> T,
    ) -> Result<Layered<T>> {
        let parsed = serde_json::to_value(parsed).map_err(|error| {
            Error::invalid_data(format!("the options must be finite numbers and text: {error}"))
        })?;
        let typed = Value::Object(typed_of(&parsed, self.matches)?);
        let layers = Layers::default().with_settings(self.sets).with_options(typed);
        match self.config {
            Some(path) => layers.with_file(path, limits)?.resolve(preset),
            None => layers.resolve(preset),
        }
    }
}

/// The command of these arguments, for the names of its flags.
pub(super) fn command_of<A: clap::Args>(name: &'static str) -> Command {
    A::augment_args(Command::new(name))
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

// ---- Numbers as people write them: `--max-triangles 10k` is 10000, `1.5M` is 1500000 ------------

/// The arguments with such numbers written out.
pub(super) fn expand_numbers(
    command: &Command,
    arguments: impl Iterator<Item = OsString>,
) -> Vec<OsString> {
    let mut innermost = command;
    let mut out: Vec<OsString> = Vec::new();
    let mut wants_number = false;
    for argument in arguments {
        let text = argument.to_str().unwrap_or_default();
        if let Some(inner) = innermost.find_subcommand(text) {
            innermost = inner;
        }
        let number = match text.split_once('=').filter(|_| text.starts_with("--")) {
            Some((flag, value)) if takes_whole_number([command, innermost], flag) => {
                expand_suffix(value).map(|value| format!("{flag}={value}"))
            }
            _ if wants_number => expand_suffix(text),
            _ => None,
        };
        wants_number = text.starts_with('-') && takes_whole_number([command, innermost], text);
        out.push(number.map_or(argument, OsString::from));
    }
    out
}

/// True if a flag of one of `commands` takes a whole number.
fn takes_whole_number(commands: [&Command; 2], flag: &str) -> bool {
    let is = |arg: &&Arg| {
        let long = arg.get_long().is_some_and(|long| flag.strip_prefix("--") == Some(long));
        let short = arg.get_short().is_some_and(|short| flag == format!("-{short}"));
        long || short
    };
    let argument = commands.iter().find_map(|command| command.get_arguments().find(is));
    let types =
        [ValueParser::from(clap::value_parser!(u64)), ValueParser::from(clap::value_parser!(u32))];
    let types = types.map(|parser| parser.type_id());
    argument.is_some_and(|arg| {
        arg.get_action().takes_values() && types.contains(&arg.get_value_parser().type_id())
    })
}

/// 10k as 10000, 1.5M as 1500000; `None` for other text, which the parser checks.
fn expand_suffix(text: &str) -> Option<String> {
    let (digits, zeros) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 3),
        None => (text.strip_suffix('M')?, 6),
    };
    let (whole, part) = digits.split_once('.').unwrap_or((digits, ""));
    let decimal = |digits: &str| digits.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty()
        || whole.len() > 12
        || part.len() > zeros
        || !decimal(whole)
        || !decimal(part)
    {
        return None;
    }
    let all = format!("{whole}{part:0<zeros$}");
    Some(all.trim_start_matches('0').to_owned())
        .map(|n| if n.is_empty() { "0".to_owned() } else { n })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command() -> Command {
        let most = clap::Arg::new("max_triangles").long("max-triangles");
        Command::new("bake").arg(most).arg(clap::Arg::new("inputs").value_name("IN"))
    }

    #[test]
    fn fields_become_flags_and_other_words_stay() {
        let error = Error::invalid(
            "max_triangles",
            -1,
            "0 or more; see `max_triangles`, `photo` and `trisplat bake`",
        );
        let wants = "--max-triangles is -1: expected 0 or more; see --max-triangles, `photo` and `trisplat bake`";
        assert_eq!(message(&error, &command()), wants);
        assert_eq!(
            message(&Error::invalid("inputs", "-", "a file"), &command()),
            "IN is -: expected a file"
        );
        assert_eq!(
            message(&Error::invalid("draw.near", 0, "> 0"), &command()),
            "draw.near is 0: expected > 0"
        );
        assert_eq!(
            as_flags("a lone ` stays, `max_triangles` too", &command()),
            "a lone ` stays, `max_triangles` too"
        );
        assert_eq!(
            as_flags("the key ``max_triangles``, `max_triangles`", &command()),
            "the key `max_triangles`, --max-triangles"
        );
        let words = "the data set it was trained on, or `force_dataset`";
        assert_eq!(
            as_flags(words, &command()),
            "the data set it was trained on, or --set force_dataset=true"
        );
    }
}

#[cfg(test)]
mod global_tests {
    use super::*;
    use clap::Args;

    #[test]
    fn the_help_lists_every_limit() {
        let command = GlobalArgs::augment_args(clap::Command::new("trisplat"));
        let help =
            command.get_arguments().find(|a| a.get_id() == "limit").and_then(|a| a.get_help());
        let help = help.map(ToString::to_string).unwrap_or_default();
        let keys = serde_json::to_value(Limits::DEFAULT).unwrap();
        for key in keys.as_object().unwrap().keys() {
            assert!(help.contains(key.as_str()), "{key}: {help}");
        }
    }
}

#[cfg(test)]
mod numbers_tests {
    use super::*;

    #[test]
    fn ten_k_is_understood_where_a_whole_number_is_wanted() {
        for (text, wants) in [
            ("10k", Some("10000")),
            ("2K", Some("2000")),
            ("1.5M", Some("1500000")),
            ("0.5k", Some("500")),
            ("0k", Some("0")),
            ("k", None),
            ("1.2345k", None),
            ("-3k", None),
            ("10kb", None),
            ("10", None),
        ] {
            assert_eq!(expand_suffix(text).as_deref(), wants, "{text}");
        }
        let bake = Command::new("bake")
            .arg(
                Arg::new("most")
                    .long("max-triangles")
                    .short('m')
                    .value_parser(clap::value_parser!(u64)),
            )
            .arg(Arg::new("dataset").long("dataset"))
            .arg(Arg::new("output").long("output"));
        let command = Command::new("trisplat").subcommand(bake);
        let of = |typed: &str| {
            let all = expand_numbers(&command, typed.split(' ').map(OsString::from));
            all.iter().map(|a| a.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(
            of("trisplat bake 10k --max-triangles 10k"),
            "trisplat bake 10k --max-triangles 10000"
        );
        assert_eq!(
            of("trisplat bake --max-triangles=2M -m 3k"),
            "trisplat bake --max-triangles=2000000 -m 3000"
        );
        assert_eq!(
            of("trisplat bake --dataset 10k --output=5k"),
            "trisplat bake --dataset 10k --output=5k"
        );
    }
}
