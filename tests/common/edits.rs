//! Random changes to a file, as a damaged disk, a careless program or an attacker would make them.

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use std::time::Instant;

/// One change to a file; places are shares of its length, so that they shrink well.
#[derive(Debug, Clone)]
enum Edit {
    Flip { at: f64, bit: u8 },
    Put { at: f64, bytes: Vec<u8> },
    Insert { at: f64, bytes: Vec<u8> },
    Remove { at: f64, count: usize },
    Repeat { at: f64, count: usize },
    Cut { at: f64 },
    Number { which: f64, with: &'static str },
}

/// Numbers and words that have broken readers before.
const NASTY: [&str; 24] = [
    "0",
    "-1",
    "1",
    "2",
    "4",
    "255",
    "256",
    "65536",
    "2147483647",
    "-2147483648",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "18446744073709551616",
    "nan",
    "inf",
    "-inf",
    "1e38",
    "1e99",
    "1e-45",
    "",
    "x",
];

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let at = || 0.0..1.0f64;
    let bytes = || {
        let poison =
            [f32::NAN, f32::INFINITY, f32::MAX, -1.0, 1e-45].map(|x| x.to_le_bytes().to_vec());
        let counts = [u32::MAX, i32::MAX as u32, 0, 3].map(|x| x.to_le_bytes().to_vec());
        prop_oneof![
            prop::sample::select([&poison[..], &counts[..]].concat()),
            prop::collection::vec(any::<u8>(), 1..9),
            "[ \n\r#/.e+-]{1,3}".prop_map(String::into_bytes),
        ]
    };
    let edit = prop_oneof![
        (at(), 0..8u8).prop_map(|(at, bit)| Edit::Flip { at, bit }),
        (at(), bytes()).prop_map(|(at, bytes)| Edit::Put { at, bytes }),
        (at(), bytes()).prop_map(|(at, bytes)| Edit::Insert { at, bytes }),
        (at(), 1..40usize).prop_map(|(at, count)| Edit::Remove { at, count }),
        (at(), 1..80usize).prop_map(|(at, count)| Edit::Repeat { at, count }),
        at().prop_map(|at| Edit::Cut { at }),
        (at(), prop::sample::select(&NASTY[..]))
            .prop_map(|(which, with)| Edit::Number { which, with }),
    ];
    prop::collection::vec(edit, 1..5)
}

fn apply(edit: &Edit, bytes: &mut Vec<u8>) {
    let place = |at: f64| ((at * bytes.len() as f64) as usize).min(bytes.len().saturating_sub(1));
    let range = |at: f64, count: usize| place(at)..(place(at) + count).min(bytes.len());
    if bytes.is_empty() {
        return;
    }
    match edit {
        Edit::Flip { at, bit } => {
            let at = place(*at);
            bytes[at] ^= 1 << bit;
        }
        Edit::Put { at, bytes: new } => {
            let range = range(*at, new.len());
            let count = range.len();
            bytes[range].copy_from_slice(&new[..count]);
        }
        Edit::Insert { at, bytes: new } => {
            let at = place(*at);
            bytes.splice(at..at, new.iter().copied());
        }
        Edit::Remove { at, count } => drop(bytes.drain(range(*at, *count))),
        Edit::Repeat { at, count } => {
            let range = range(*at, *count);
            let again = bytes[range.clone()].to_vec();
            bytes.splice(range.end..range.end, again);
        }
        Edit::Cut { at } => bytes.truncate(place(*at)),
        Edit::Number { which, with } => {
            let starts: Vec<usize> = (0..bytes.len())
                .filter(|&i| {
                    bytes[i].is_ascii_digit() && (i == 0 || !bytes[i - 1].is_ascii_alphanumeric())
                })
                .collect();
            let Some(&start) = starts.get((which * starts.len() as f64) as usize) else { return };
            let digits = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
            bytes.splice(start..start + digits, with.bytes());
        }
    }
}

/// Gives `count` mutants of `seed`, unless TRISPLAT_FUZZ_CASES says how many, to `survive`, which
/// panics when one is not survived; and again as many until the time of TRISPLAT_FUZZ_SECONDS is
/// over. A failure is shrunk to the fewest edits and named by them.
pub(crate) fn mutate(name: &str, seed: &[u8], count: u32, survive: impl Fn(&[u8])) {
    let cases =
        std::env::var("TRISPLAT_FUZZ_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(count);
    let mut runner =
        TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
    let began = Instant::now();
    loop {
        let result = runner.run(&edits(), |edits| {
            let mut bytes = seed.to_vec();
            edits.iter().for_each(|edit| apply(edit, &mut bytes));
            survive(&bytes);
            Ok(())
        });
        if let Err(failure) = result {
            panic!("{name}: {failure}");
        }
        if began.elapsed() >= super::night::duration() {
            return;
        }
    }
}
