//! Lines on standard error. "error" and "warning" are coloured as clap colours its own: on a terminal, unless the
//! environment says otherwise (`NO_COLOR`, `CLICOLOR`, `CLICOLOR_FORCE`, `TERM=dumb`).

use anstyle::{AnsiColor, Style};
use std::io::Write;

const ERROR: Style = AnsiColor::Red.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();

/// Prints a line; a leading "error:" or "warning:" is coloured.
pub fn print(text: &str) {
    // Nobody may read it any more (`2>&1 | head`), and that is no reason to end the work.
    let _ = writeln!(anstream::stderr(), "{}", styled(text));
}

/// The line with its colours, whatever it is printed on.
fn styled(text: &str) -> String {
    for (word, style) in [("error:", ERROR), ("warning:", WARNING)] {
        if let Some(rest) = text.strip_prefix(word) {
            return format!("{style}{word}{style:#}{rest}");
        }
    }
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_word_is_coloured_and_nothing_else() {
        assert_eq!(styled("error: a warning: b"), "\u{1b}[1m\u{1b}[31merror:\u{1b}[0m a warning: b");
        assert_eq!(styled("warning: a"), "\u{1b}[1m\u{1b}[33mwarning:\u{1b}[0m a");
        assert_eq!(styled("wrote error: x"), "wrote error: x");
    }
}
