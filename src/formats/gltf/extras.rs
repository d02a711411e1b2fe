//! `asset.extras` of the files this program writes: where a scene came from and how it is stored.

use super::options::{ColorEncoding, PositionEncoding};
use crate::asset::{Provenance, UpAxis};
use gltf_json::Asset;
use serde::{Deserialize, Serialize};

/// How the names of this program's versions begin.
const PROGRAM: &str = "trisplat";

/// What a reader needs to undo the bake.
#[derive(Debug, Serialize)]
pub(super) struct SceneExtras<'a> {
    #[serde(flatten)]
    pub(super) provenance: &'a Provenance,
    pub(super) color_encoding: ColorEncoding,
    pub(super) position_encoding: PositionEncoding,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) note: Option<&'static str>,
}

/// The part of [`SceneExtras`] that decides how colours are read.
#[derive(Debug, Default, Deserialize)]
struct StoredColors {
    #[serde(default)]
    color_encoding: ColorEncoding,
}

/// True when the file says that its COLOR_0 is sRGB-encoded. Only this program's own word is taken.
pub(super) fn has_srgb_colors(asset: &Asset) -> bool {
    !own_extras::<StoredColors>(asset).color_encoding.is_linear()
}

/// What the file says of its origin. glTF is Y up.
pub(super) fn provenance(asset: &Asset) -> Provenance {
    let mut provenance = own_extras::<Provenance>(asset).possible();
    provenance.generator = provenance.generator.or_else(|| asset.generator.clone());
    provenance.up = Some(UpAxis::Y);
    provenance
}

/// The extras when this program wrote the file and can read them.
fn own_extras<T: Default + for<'de> Deserialize<'de>>(asset: &Asset) -> T {
    let is_own = asset.generator.as_deref().is_some_and(|generator| generator.starts_with(PROGRAM));
    let extras = asset.extras.as_ref().filter(|_| is_own);
    extras.and_then(|extras| serde_json::from_str(extras.get()).ok()).unwrap_or_default()
}
