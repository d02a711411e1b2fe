//! Says that a test is skipped.

use std::io::Write as _;

/// Prints why a test is skipped, on standard error itself: what `eprintln!` prints of a test that
/// passes is not shown.
pub(crate) fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED ({why})");
}
