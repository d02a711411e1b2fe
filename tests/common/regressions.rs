//! Inputs that once failed a property are stored beside its source and tried first.

use proptest::test_runner::{Config, FileFailurePersistence};

/// The runner's defaults, with failures stored in `NAME.regressions` beside `NAME.rs`.
pub(crate) fn stored() -> Config {
    let beside = FileFailurePersistence::WithSource("regressions");
    Config { failure_persistence: Some(Box::new(beside)), ..Config::default() }
}
