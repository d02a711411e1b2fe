//! JSON files that are neither scenes nor lists of photos, recognised for a helpful message.

use super::gaussians;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::Path;
use trisplat_scene::Error;

/// The keys that make a JSON file a tileset.
#[derive(Deserialize)]
struct TilesetKeys {
    #[serde(rename = "geometricError")]
    _geometric_error: IgnoredAny,
    #[serde(rename = "root")]
    _root: IgnoredAny,
}

/// Whether a JSON text is a tileset (3D Tiles).
fn is_tileset_json(json: &[u8]) -> bool {
    serde_json::from_slice::<TilesetKeys>(json).is_ok()
}

/// The refusal of a JSON file in place of a scene or a list of photos; `None` for an unknown kind.
pub fn foreign_json(path: &Path, json: &[u8]) -> Option<Error> {
    if gaussians::is_sog_json(json) {
        return Some(gaussians::refusal(path, "SOG"));
    }
    is_tileset_json(json).then(|| {
        let reason = "is a tileset (3D Tiles), a list of files with tiles: give one of the files it names, or what it was baked from";
        Error::unsupported(path, reason)
    })
}
