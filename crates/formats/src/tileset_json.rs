//! The JSON types of a tileset (3D Tiles 1.1).

use serde::Deserialize;

/// The document.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Tileset {
    pub(super) asset: Asset,
    pub(super) geometric_error: f64,
    pub(super) root: Tile,
}

#[derive(Deserialize)]
pub(super) struct Asset {
    pub(super) version: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Tile {
    pub(super) bounding_volume: Volume,
    pub(super) geometric_error: f64,
    pub(super) refine: Option<String>,
    pub(super) transform: Option<[f64; 16]>,
    pub(super) content: Option<Content>,
    #[serde(default)]
    pub(super) contents: Vec<Content>,
    #[serde(default)]
    pub(super) children: Vec<Tile>,
}

#[derive(Deserialize)]
pub(super) struct Volume {
    #[serde(rename = "box")]
    pub(super) around: Option<[f64; 12]>,
}

#[derive(Deserialize)]
pub(super) struct Content {
    pub(super) uri: String,
}

/// Whether a file of this name is a tileset instead of a tile.
pub(super) fn is_json(name: &str) -> bool {
    name.rsplit_once('.').is_some_and(|(_, ending)| ending.eq_ignore_ascii_case("json"))
}
