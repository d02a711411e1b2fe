//! The command that continues a training that was stopped.

use super::train_args::TrainArgs;
use clap::{ArgMatches, Args, Command};
use std::path::Path;
use trisplat_train::TrainOptions;

/// Flags that apply only to this part of the run.
const ONCE: [&str; 4] = ["resume", "force_resume", "force", "max_cpu_secs"];

/// Names of the options that a checkpoint holds: a resumed run keeps them.
pub(super) fn fixed() -> Vec<String> {
    let options = TrainOptions::augment_args(Command::new("options"));
    let named = options.get_arguments().map(|arg| arg.get_id().to_string());
    named.chain(["config", "sets", "budget", "budget_wall"].map(String::from)).collect()
}

/// The command to type: all typed flags, without options that the checkpoint stores.
pub(super) fn command(matches: &ArgMatches, args: &TrainArgs, checkpoint: &Path) -> String {
    let fixed = fixed();
    let mut words = vec!["trisplat train".to_owned()];
    words.extend(args.dataset.iter().map(|path| quoted(&path.to_string_lossy())));
    for arg in TrainArgs::augment_args(Command::new("train")).get_arguments() {
        let id = arg.get_id().as_str();
        let kept = !ONCE.contains(&id) && !fixed.iter().any(|name| name == id);
        let (true, Some(long)) = (kept && super::layers::is_typed(matches, id), arg.get_long()) else {
            continue;
        };
        let values = matches.get_raw(id).into_iter().flatten().map(|v| quoted(&v.to_string_lossy()));
        match arg.get_action().takes_values() {
            true => values.for_each(|value| words.push(format!("--{long} {value}"))),
            false => words.push(format!("--{long}")),
        }
    }
    words.push(format!("--force --resume {}", quoted(&checkpoint.to_string_lossy())));
    words.join(" ")
}

/// A word quoted for the shells of this system.
fn quoted(word: &str) -> String {
    if cfg!(windows) { quoted_for_windows(word) } else { quoted_for_posix(word) }
}

/// True for a word that no shell changes; `more` are characters that are plain on one system only.
fn is_plain(word: &str, more: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=+".contains(c) || more.contains(c);
    !word.is_empty() && word.chars().all(plain)
}

fn quoted_for_posix(word: &str) -> String {
    match is_plain(word, ",@%") {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// For `cmd` and PowerShell, which both understand double quotes; names of files contain none.
fn quoted_for_windows(word: &str) -> String {
    if is_plain(word, "\\") { word.to_owned() } else { format!("\"{word}\"") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::FromArgMatches;

    fn after(typed: &[&str]) -> String {
        let words = [&["train", "photos", "-o", "x.ply"], typed].concat();
        let matches = TrainArgs::augment_args(Command::new("train")).get_matches_from(words);
        let args = TrainArgs::from_arg_matches(&matches).expect("parsed");
        command(&matches, &args, Path::new("x.checkpoint"))
    }

    #[cfg(unix)]
    #[test]
    fn the_command_repeats_what_the_checkpoint_does_not_hold() {
        assert_eq!(after(&[]), "trisplat train photos --output x.ply --force --resume x.checkpoint");
        let typed = [
            "--steps",
            "70",
            "--set",
            "densify.every=5",
            "--max-size",
            "300",
            "--test-every=4",
            "--skip-broken",
        ];
        let more =
            ["--background", "#ffffff", "--log", "a log.jsonl", "--max-cpu-secs", "3", "--images", "it's"];
        assert_eq!(
            after(&[&typed[..], &more].concat()),
            "trisplat train photos --output x.ply --log 'a log.jsonl' --max-size 300 --test-every 4 --skip-broken \
             --images 'it'\\''s' --background '#ffffff' --force --resume x.checkpoint"
        );
    }

    #[test]
    fn words_for_windows_are_in_double_quotes() {
        assert_eq!(quoted_for_windows(r"C:\scans\a.log"), r"C:\scans\a.log");
        assert_eq!(quoted_for_windows(r"C:\my scans\it's.log"), r#""C:\my scans\it's.log""#);
        assert_eq!(quoted_for_windows(""), r#""""#);
    }

    #[test]
    fn what_a_checkpoint_holds_is_named_by_the_options_themselves() {
        let fixed = fixed();
        for id in ["preset", "steps", "max_triangles", "sh_degree", "seed", "config", "sets"] {
            assert!(fixed.iter().any(|name| name == id), "{id}");
        }
        assert!(!fixed.iter().any(|name| name == "max_size"));
    }
}
