//! Errors of the command line suggest a flag only when it is close to the typed one, and never a
//! file named like a flag; of a target they suggest the one for the engine that was named.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, Error, ValueEnum};
use serde_json::Value;
use std::path::{Path, PathBuf};
use trisplat_bake::{BakeOptions, MeshOptions};
use trisplat_dataset::capture::is_camera_file;
use trisplat_formats::{OutputTarget, unzipped_sog};
use trisplat_scene::input;
use trisplat_train::TrainOptions;

/// Fewer letters are the beginning of too many names.
const SHORTEST_NAME: usize = 4;

/// The error without suggestions that are far from the typed flag, and with a target for the name
/// of an engine.
pub(super) fn plausible(mut error: Error) -> Error {
    if error.kind() == ErrorKind::InvalidValue && error.get(ContextKind::SuggestedValue).is_none() {
        if let Some(target) = meant_target(&error) {
            error.insert(ContextKind::SuggestedValue, ContextValue::String(target));
        }
        return error;
    }
    if let (ErrorKind::InvalidSubcommand, Some(ContextValue::String(typed))) =
        (error.kind(), error.get(ContextKind::InvalidSubcommand))
        && let Some(hint) = command_for(typed)
    {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint.into()]));
        error.remove(ContextKind::SuggestedSubcommand);
    }
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(texts)) => texts.first().cloned().unwrap_or_default(),
        _ => String::new(),
    };
    let typed = text(ContextKind::InvalidArg);
    let suggested = text(ContextKind::SuggestedArg);
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

/// The command for a file or folder that was typed in place of one.
fn command_for(typed: &str) -> Option<String> {
    let path = Path::new(typed);
    if path.extension().is_none() && !path.exists() {
        return None;
    }
    let shown =
        if typed.contains(char::is_whitespace) { format!("'{typed}'") } else { typed.to_owned() };
    let makes = path.is_dir() && unzipped_sog(path).is_none() || is_camera_file(path);
    Some(if makes {
        format!("a command comes first: trisplat make {shown} -o scene.glb")
    } else {
        format!("a command comes first: trisplat bake {shown} -o OUT.glb, or trisplat info {shown}")
    })
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
    let names_it =
        |help: String| help.split_whitespace().any(|word| letters(word).starts_with(&typed));
    let mut named =
        targets.filter(|target| target.get_help().is_some_and(|help| names_it(help.to_string())));
    named.next().map(|target| target.get_name().to_owned())
}

/// True if one word is the other with at most a third of its letters changed, or its beginning.
fn near(typed: &str, suggested: &str) -> bool {
    let [a, b] = [typed, suggested]
        .map(|flag| flag.trim_start_matches('-').split([' ', '=']).next().unwrap_or_default());
    let begins = a.len() >= 3 && (b.starts_with(a) || a.starts_with(b));
    begins || 3 * strsim::osa_distance(a, b) <= a.len().max(b.len())
}

/// The end of the message about a file or folder that does not exist, with one of a similar name
/// beside it.
pub(super) fn similar_file(error: &trisplat_scene::Error) -> Option<String> {
    let trisplat_scene::Error::Io { path, source } = error else { return None };
    let is_missing = source.kind() == std::io::ErrorKind::NotFound && !path.exists();
    let name = path.file_name().filter(|_| is_missing)?.to_str()?.to_lowercase();
    let folder = path.parent()?;
    let distance = |other: &PathBuf| {
        let other = other.file_name()?.to_str()?.to_lowercase();
        let distance = strsim::osa_distance(&name, &other);
        (3 * distance <= name.len().max(other.len())).then_some(distance)
    };
    let similar = input::entries(folder).filter_map(|other| Some((distance(&other)?, other)));
    similar.min().map(|(_, other)| format!("; did you mean {}?", other.display()))
}

/// The end of the message about an unknown key of `--set` of a command, with one of a similar name.
pub(super) fn similar_setting(error: &trisplat_scene::Error, command: &str) -> Option<String> {
    let trisplat_scene::Error::Invalid { option, value: key, .. } = error else { return None };
    // A known key stands before its value.
    if option != "sets" || key.contains('=') {
        return None;
    }
    let options = options_of(command)?;
    let distance = |name: &&String| strsim::osa_distance(key, name);
    let nearest = names(&options).min_by_key(distance).filter(|name| near(key, name))?;
    Some(format!("; did you mean {nearest}?"))
}

/// A switch that only `--set` of a command turns on, as it is typed.
pub(super) fn as_switch(command: &str, field: &str) -> Option<String> {
    let options = options_of(command)?;
    let is_switch = options.get(field).is_some_and(Value::is_boolean);
    is_switch.then(|| format!("--set {field}=true"))
}

// ---- The hint of an unknown flag that is a setting: `--contour 0.3` is typed `--set contour=0.3`

/// `error` of the arguments `words`, with a hint if an unknown flag is a key of `--set`.
pub(super) fn with_hint(mut error: Error, words: &[String]) -> Error {
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return error };
    let field =
        flag.trim_start_matches('-').split('=').next().unwrap_or_default().replace('-', "_");
    if !words
        .iter()
        .find_map(|word| options_of(word))
        .is_some_and(|options| names(&options).any(|name| *name == field))
    {
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

/// The names of options, and of options of groups.
fn names(options: &Value) -> impl Iterator<Item = &String> {
    let own = options.as_object().into_iter().flatten();
    own.flat_map(|(name, value)| match value {
        Value::Object(group) => group.keys().collect(),
        _ => vec![name],
    })
}

// ---- The short help (`-h`) of a command with many flags: those that people use, in a clause each

/// Commands whose flags do not fit one screen, and the fields that `-h` shows.
const SHOWN: &[(&str, &str)] = &[
    (
        "make",
        "output force budget work page target max_triangles crop backdrop frames poses report max_size masks",
    ),
    (
        "bake",
        "output force target preset dataset harden max_triangles max_bytes texture collision backdrop lod crop up scale_by config sets",
    ),
    ("mesh", "output force resolution max_triangles texture crop up scale_by sets max_size masks"),
    (
        "train",
        "output force preset budget steps max_triangles max_size masks from teacher resume backend view report config sets",
    ),
    ("eval", "as split save_renders report json force max_size"),
    ("render", "output dataset split orbit width show as force max_size"),
    ("plan", "output force status blocks memory steps max_triangles preset config sets max_size"),
    ("merge", "output force"),
    ("view", "dataset size screenshots max_size"),
    ("info", "json max_size masks"),
];

/// Two commands as one would type them, which end the help of a command.
const EXAMPLES: &[(&str, [&str; 2])] = &[
    (
        "make",
        ["trisplat make photos -o scene.glb", "trisplat make walk.mp4 -o scene.glb --budget 20m"],
    ),
    (
        "capture",
        ["trisplat capture photos -o set", "trisplat capture walk.mp4 -o set --frames 200"],
    ),
    (
        "bake",
        [
            "trisplat bake scene.ply --dataset photos -o scene.glb --target godot",
            "trisplat bake splats.ply -o scene.glb",
        ],
    ),
    (
        "mesh",
        [
            "trisplat mesh scene.ply photos -o surface.glb",
            "trisplat mesh photos --texture --max-triangles 4000 --crop subject -o object.glb",
        ],
    ),
    (
        "train",
        ["trisplat train photos -o scene.ply", "trisplat train photos -o scene.ply --budget 2m"],
    ),
    (
        "eval",
        [
            "trisplat eval scene.glb photos",
            "trisplat eval scene.glb photos --save-renders drawings",
        ],
    ),
    (
        "render",
        [
            "trisplat render scene.glb --dataset photos -o pictures",
            "trisplat render scene.glb --orbit 12 -o pictures",
        ],
    ),
    ("info", ["trisplat info scene.glb", "trisplat info photos"]),
    ("validate", ["trisplat validate scene.glb", "trisplat validate scene.glb --json"]),
];

/// Longest help of a flag that `-h` shows whole, characters.
const WHOLE: usize = 90;
/// A clause ends no earlier than after this many bytes.
const CLAUSE: usize = 24;

/// `program` with a `-h` of one screen for each command.
pub(super) fn shorten(program: Command) -> Command {
    let program = EXAMPLES.iter().fold(program, |program, (name, [first, second])| {
        let text = format!("Examples:\n  {first}\n  {second}");
        program.mut_subcommand(name, |command| command.after_help(text))
    });
    SHOWN.iter().fold(program, |program, (name, fields)| {
        let shown =
            |arg: &Arg| arg.is_positional() || fields.split(' ').any(|field| arg.get_id() == field);
        let short = |arg: Arg| {
            let hidden = !shown(&arg) || arg.is_hide_short_help_set();
            with_first_clause(arg).hide_short_help(hidden)
        };
        program.mut_subcommand(name, |command| command.mut_args(short))
    })
}

/// `arg` with the first clause of its help for `-h`, and all of it for `--help`.
fn with_first_clause(arg: Arg) -> Arg {
    match arg.get_help().map(ToString::to_string) {
        Some(help) if arg.get_long_help().is_none() => {
            let short = first_clause(&help).to_owned();
            arg.help(short).long_help(help)
        }
        _ => arg,
    }
}

fn first_clause(help: &str) -> &str {
    let end = |separator| help.match_indices(separator).map(|(at, _)| at).find(|at| *at >= CLAUSE);
    let clause = [". ", "; ", ": "].into_iter().filter_map(end).min();
    clause.filter(|_| help.chars().count() > WHOLE).map_or(help, |end| &help[..end])
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

#[cfg(test)]
mod short_help_tests {
    use super::*;
    use crate::cli::program::Cli;
    use clap::CommandFactory;

    /// Lines of a screen.
    const SCREEN: usize = 50;
    /// Maximum number of flags of `trisplat bake`, without global flags.
    const MAX_FLAGS: usize = 31;

    fn program() -> Command {
        let mut program = shorten(Cli::command());
        program.build();
        program
    }

    #[test]
    fn the_short_help_of_every_command_fits_a_screen() {
        for command in program().get_subcommands() {
            let help = command.clone().max_term_width(100).render_help().to_string();
            let lines = help.lines().count();
            assert!(lines <= SCREEN, "{} -h has {lines} lines:\n{help}", command.get_name());
        }
    }

    #[test]
    fn every_field_that_is_shown_is_a_flag() {
        let program = program();
        for (name, fields) in SHOWN {
            let Some(command) = program.find_subcommand(name) else { panic!("no command {name}") };
            let missing = cfg!(not(feature = "view")) && *name == "view";
            for field in fields.split(' ').filter(|_| !missing) {
                assert!(
                    command.get_arguments().any(|arg| arg.get_id() == field),
                    "{name} has no {field}"
                );
            }
        }
    }

    #[test]
    fn the_bake_has_few_flags() {
        let program = program();
        let bake = program.find_subcommand("bake").expect("a command");
        let own = bake.get_arguments().filter(|arg| !arg.is_global_set() && arg.get_id() != "help");
        let flags: Vec<&str> = own.filter_map(Arg::get_long).collect();
        assert!(flags.len() <= MAX_FLAGS, "{} flags: {}", flags.len(), flags.join(" "));
    }
}
