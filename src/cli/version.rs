//! What `--version` says.

/// Version, commit of a release, and features: "0.1.0 (1a2b3c4d; gpu, view)".
///
/// Builds of releases and containers set `TRISPLAT_COMMIT`: asking git here would compile the program again after every commit.
pub(super) fn version() -> String {
    let features = [("gpu", cfg!(feature = "gpu")), ("view", cfg!(feature = "view"))];
    let on: Vec<&str> = features.iter().filter(|(_, on)| *on).map(|(name, _)| *name).collect();
    let features = if on.is_empty() { "default features".to_owned() } else { on.join(", ") };
    let commit = option_env!("TRISPLAT_COMMIT").unwrap_or("built from source");
    format!("{} ({commit}; {features})", env!("CARGO_PKG_VERSION"))
}
