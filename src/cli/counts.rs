//! Numbers as a person reads them.

use indicatif::HumanCount;

/// 1234567 as "1,234,567", to be padded like any text.
pub(super) fn thousands(number: u64) -> String {
    HumanCount(number).to_string()
}

/// The same with a noun: "1 triangle", "1,234 triangles".
pub(super) fn many(number: u64, noun: &str) -> String {
    let (text, end) = (thousands(number), if number == 1 { "" } else { "s" });
    format!("{text} {noun}{end}")
}
