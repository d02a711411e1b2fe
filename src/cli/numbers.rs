//! Numbers as people write them: `--max-triangles 10k` is 10000, `1.5M` is 1500000.
//!
//! This happens before the command line is parsed, and only after flags with whole numbers, because a folder
//! may be called 10k.

use clap::builder::ValueParser;
use clap::{Arg, Command};
use std::ffi::OsString;

/// The arguments with such numbers written out.
pub(super) fn written_out(command: &Command, arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut innermost = command;
    let mut out: Vec<OsString> = Vec::new();
    let mut wants_number = false;
    for argument in arguments {
        let text = argument.to_str().unwrap_or_default();
        if let Some(inner) = innermost.find_subcommand(text) {
            innermost = inner;
        }
        let number = match text.split_once('=').filter(|_| text.starts_with("--")) {
            Some((flag, value)) if counts([command, innermost], flag) => {
                plain(value).map(|value| format!("{flag}={value}"))
            }
            _ if wants_number => plain(text),
            _ => None,
        };
        wants_number = text.starts_with('-') && counts([command, innermost], text);
        out.push(number.map_or(argument, OsString::from));
    }
    out
}

/// Whether a flag of one of `commands` takes a whole number.
fn counts(commands: [&Command; 2], flag: &str) -> bool {
    let is = |arg: &&Arg| {
        let long = arg.get_long().is_some_and(|long| flag.strip_prefix("--") == Some(long));
        let short = arg.get_short().is_some_and(|short| flag == format!("-{short}"));
        long || short
    };
    let argument = commands.iter().find_map(|command| command.get_arguments().find(is));
    let types = [ValueParser::from(clap::value_parser!(u64)), ValueParser::from(clap::value_parser!(u32))];
    let types = types.map(|parser| parser.type_id());
    argument.is_some_and(|arg| {
        arg.get_action().takes_values() && types.contains(&arg.get_value_parser().type_id())
    })
}

/// 10k as 10000, 1.5M as 1500000; `None` for other text, which the parser checks.
fn plain(text: &str) -> Option<String> {
    let (digits, zeros) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 3),
        None => (text.strip_suffix('M')?, 6),
    };
    let (whole, part) = digits.split_once('.').unwrap_or((digits, ""));
    let decimal = |digits: &str| digits.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() || whole.len() > 12 || part.len() > zeros || !decimal(whole) || !decimal(part) {
        return None;
    }
    let all = format!("{whole}{part:0<zeros$}");
    Some(all.trim_start_matches('0').to_owned()).map(|n| if n.is_empty() { "0".to_owned() } else { n })
}

#[cfg(test)]
mod tests {
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
            assert_eq!(plain(text).as_deref(), wants, "{text}");
        }
        let bake = Command::new("bake")
            .arg(Arg::new("most").long("max-triangles").short('m').value_parser(clap::value_parser!(u64)))
            .arg(Arg::new("dataset").long("dataset"))
            .arg(Arg::new("output").long("output"));
        let command = Command::new("trisplat").subcommand(bake);
        let of = |typed: &str| {
            let all = written_out(&command, typed.split(' ').map(OsString::from));
            all.iter().map(|a| a.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(of("trisplat bake 10k --max-triangles 10k"), "trisplat bake 10k --max-triangles 10000");
        assert_eq!(
            of("trisplat bake --max-triangles=2M -m 3k"),
            "trisplat bake --max-triangles=2000000 -m 3000"
        );
        assert_eq!(of("trisplat bake --dataset 10k --output=5k"), "trisplat bake --dataset 10k --output=5k");
    }
}
