//! `asset.extras` of files of this program: provenance and storage of a scene.

use super::options::{ColorEncoding, PositionEncoding};
use gltf_json::Asset;
use serde::{Deserialize, Serialize};
use trisplat_scene::{Provenance, UpAxis};

/// Prefix of this program's versions.
const PROGRAM: &str = "trisplat";

/// Data for undoing the bake's placement and encoding.
#[derive(Debug, Serialize)]
pub(crate) struct SceneExtras<'a> {
    #[serde(flatten)]
    pub(crate) provenance: &'a Provenance,
    pub(crate) color_encoding: ColorEncoding,
    pub(crate) position_encoding: PositionEncoding,
    /// The file of the panorama: who asks a server for one that is not there is told of an error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) sky: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) note: Option<&'static str>,
}

/// The part of [`SceneExtras`] that decides how colours are read.
#[derive(Debug, Default, Deserialize)]
struct StoredColors {
    #[serde(default)]
    color_encoding: ColorEncoding,
}

/// True when a file of this program says that its COLOR_0 is sRGB-encoded.
pub(crate) fn has_srgb_colors(asset: &Asset) -> bool {
    !own_extras::<StoredColors>(asset).color_encoding.is_linear()
}

/// The file's provenance. glTF is Y-up.
pub(crate) fn provenance(asset: &Asset) -> Provenance {
    let mut provenance = own_extras::<Provenance>(asset).possible();
    provenance.generator = provenance.generator.or_else(|| asset.generator.clone());
    provenance.up = Some(UpAxis::Y);
    provenance
}

/// The extras, if this program wrote the file and can read them.
fn own_extras<T: Default + for<'de> Deserialize<'de>>(asset: &Asset) -> T {
    let is_own = asset.generator.as_deref().is_some_and(|generator| generator.starts_with(PROGRAM));
    let extras = asset.extras.as_ref().filter(|_| is_own);
    extras.and_then(|extras| serde_json::from_str(extras.get()).ok()).unwrap_or_default()
}
