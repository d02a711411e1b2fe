//! Commands that this build lacks.

use std::ffi::OsString;
use trisplat_scene::Error;

/// Any arguments; they are ignored.
#[derive(Debug, clap::Args)]
#[command(disable_help_flag = true)]
pub struct MissingArgs {
    /// The arguments of a build with the feature.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    pub rest: Vec<OsString>,
}

/// The one error of a command whose feature is missing.
pub fn error(feature: &str) -> Error {
    Error::invalid(
        "this trisplat",
        format!("built without the feature `{feature}`"),
        format!("a build with it: cargo install --path . --features {feature}, in the folder of its sources"),
    )
}
