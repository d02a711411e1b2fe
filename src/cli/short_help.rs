//! The short help (`-h`) of a command with many flags: the dozen that people use, each with the first clause
//! of its help. `--help` shows all.

use clap::{Arg, Command};

/// Commands whose flags do not fit one screen, and the fields that `-h` shows.
const SHOWN: &[(&str, &str)] = &[
    (
        "make",
        "output force budget work page target max_triangles crop backdrop frames poses report max_size masks",
    ),
    (
        "bake",
        "output force target preset dataset harden max_triangles max_bytes texture collision lod crop up scale_by config sets",
    ),
    ("mesh", "output force resolution max_triangles texture crop up scale_by sets max_size masks"),
    (
        "train",
        "output force preset budget steps max_triangles max_size masks from teacher resume backend view report config sets",
    ),
    ("eval", "as split save_renders sheet report json force max_size"),
    ("render", "output dataset split orbit width show as force max_size"),
    ("plan", "output force status blocks memory steps max_triangles preset config sets max_size"),
    ("merge", "output force"),
    ("view", "dataset size screenshots max_size"),
    ("info", "json max_size masks"),
];

/// Longest help of a flag that `-h` shows whole, characters.
const WHOLE: usize = 90;
/// A clause ends no earlier than after this many bytes.
const CLAUSE: usize = 24;

/// `program` with a `-h` of one screen for each command.
pub(super) fn shorten(program: Command) -> Command {
    SHOWN.iter().fold(program, |program, (name, fields)| {
        let shown = |arg: &Arg| arg.is_positional() || fields.split(' ').any(|field| arg.get_id() == field);
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
    use super::super::program::Cli;
    use super::*;
    use clap::CommandFactory;

    /// Lines of a screen.
    const SCREEN: usize = 50;
    /// The most flags of `trisplat bake`, without global flags.
    const MOST_FLAGS: usize = 30;

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
                assert!(command.get_arguments().any(|arg| arg.get_id() == field), "{name} has no {field}");
            }
        }
    }

    #[test]
    fn the_bake_has_at_most_thirty_flags() {
        let program = program();
        let bake = program.find_subcommand("bake").expect("a command");
        let own = bake.get_arguments().filter(|arg| !arg.is_global_set() && arg.get_id() != "help");
        let flags: Vec<&str> = own.filter_map(Arg::get_long).collect();
        assert!(flags.len() <= MOST_FLAGS, "{} flags: {}", flags.len(), flags.join(" "));
    }
}
