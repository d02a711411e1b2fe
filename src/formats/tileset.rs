//! 3D Tiles 1.1: one JSON file that names pieces of a scene, or all its levels of detail, each replacing a coarser one.

use crate::mesh::Mesh;
use glam::DVec3;
use serde_json::{Value, json};

/// What a viewer draws as long as it does not need more detail.
#[derive(Debug, Clone, PartialEq)]
pub struct TilesetTile {
    /// Its file, relative to the tileset; none for a tile without triangles.
    pub uri: Option<String>,
    /// Lowest and highest corner of what is in its file, Y-up; none when there is nothing in it.
    pub bounds: Option<[DVec3; 2]>,
    /// The size of what it leaves out, in units of the file; 0 for all there is.
    pub error: f64,
    /// Whether the tiles below are drawn in place of it, or beside it.
    pub replaced: bool,
    /// The tiles below it.
    pub children: Vec<TilesetTile>,
}

impl TilesetTile {
    /// Levels of a whole scene, the finest first: the coarsest is the root, every finer one the only child of the next.
    pub fn chain(levels: impl IntoIterator<Item = TilesetTile>) -> Option<Self> {
        levels.into_iter().reduce(|finer, coarser| {
            // What is drawn when a finer level is not has at least its error.
            let error = coarser.error.max(finer.error);
            TilesetTile { error, children: vec![finer], ..coarser }
        })
    }

    /// Bounds of the tile and of all below it, which it has to enclose.
    fn all_bounds(&self) -> Option<[DVec3; 2]> {
        let below = self.children.iter().filter_map(Self::all_bounds);
        self.bounds.into_iter().chain(below).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }

    fn json(&self) -> Value {
        let mut tile = json!({
            "boundingVolume": { "box": volume(self.all_bounds()) },
            "geometricError": self.error,
            "refine": if self.replaced { "REPLACE" } else { "ADD" },
        });
        if let Some(uri) = &self.uri {
            tile["content"] = json!({ "uri": uri });
        }
        if !self.children.is_empty() {
            tile["children"] = self.children.iter().map(Self::json).collect();
        }
        tile
    }
}

/// The text of the file.
pub fn json(root: &TilesetTile, generator: &str) -> String {
    let extent = root.all_bounds().map_or(0.0, |[low, high]| (high - low).length());
    let set = json!({
        "asset": { "version": "1.1", "generator": generator },
        "geometricError": extent.max(root.error),
        "root": root.json(),
    });
    // Plain strings and numbers always serialize.
    serde_json::to_string_pretty(&set).unwrap_or_default() + "\n"
}

/// Lowest and highest corner of the first `faces` of a mesh; none when there are none.
pub fn bounds(mesh: &Mesh, faces: usize) -> Option<[DVec3; 2]> {
    let corners = (0..faces).flat_map(|face| mesh.corners(face)).map(|p| p.as_dvec3());
    corners.map(|p| [p, p]).reduce(|[low, high], [p, _]| [low.min(p), high.max(p)])
}

/// Middle and half axes of a box. Tiles are Z-up, glTF in them is Y-up: (x, y, z) becomes (x, -z, y).
fn volume(bounds: Option<[DVec3; 2]>) -> [f64; 12] {
    let [low, high] = bounds.unwrap_or_default();
    let (middle, half) = ((low + high) / 2.0, ((high - low) / 2.0).max(DVec3::splat(1e-9)));
    [middle.x, -middle.z, middle.y, half.x, 0.0, 0.0, 0.0, half.z, 0.0, 0.0, 0.0, half.y]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(uri: &str, high: DVec3, error: f64) -> TilesetTile {
        let bounds = Some([DVec3::ZERO, high]);
        TilesetTile { uri: Some(uri.into()), bounds, error, replaced: true, children: Vec::new() }
    }

    #[test]
    fn every_level_is_the_child_of_the_coarser_one() {
        let (fine, coarse) = (DVec3::new(2.0, 4.0, 8.0), DVec3::new(1.0, 2.0, 4.0));
        let root = TilesetTile::chain([tile("a.glb", fine, 0.0), tile("a.lod1.glb", coarse, 0.25)]).unwrap();
        let set: Value = serde_json::from_str(&json(&root, "me")).unwrap();
        let (root, child) = (&set["root"], &set["root"]["children"][0]);
        assert_eq!(
            (&root["content"]["uri"], &child["content"]["uri"]),
            (&json!("a.lod1.glb"), &json!("a.glb"))
        );
        assert_eq!((&root["geometricError"], &child["geometricError"]), (&json!(0.25), &json!(0.0)));
        assert!(set["geometricError"].as_f64().unwrap() > 0.25 && child.get("children").is_none());
        let inner = json!([1.0, -4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 2.0]);
        assert_eq!((&root["boundingVolume"]["box"], &child["boundingVolume"]["box"]), (&inner, &inner));
        assert_eq!(root["refine"], "REPLACE");
    }

    #[test]
    fn a_tile_without_triangles_encloses_those_below() {
        let children = vec![tile("a.glb", DVec3::ONE, 0.0), tile("b.glb", DVec3::splat(3.0), 0.0)];
        let empty = TilesetTile { uri: None, bounds: None, error: 1.0, replaced: false, children };
        let set: Value = serde_json::from_str(&json(&empty, "me")).unwrap();
        assert!(set["root"].get("content").is_none() && set["root"]["refine"] == "ADD");
        assert_eq!(set["root"]["boundingVolume"]["box"][3], 1.5);
        assert_eq!(set["root"]["children"].as_array().unwrap().len(), 2);
    }
}
