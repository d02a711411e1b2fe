//! 3D Tiles 1.1: one JSON file that names all levels of detail of a scene, each replacing the coarser one.

use crate::mesh::Mesh;
use serde_json::{Value, json};

/// One level, the finest first.
#[derive(Debug, Clone)]
pub struct TilesetLevel<'a> {
    /// Name of its file, beside the tileset.
    pub uri: String,
    /// Its triangles, a backdrop behind them.
    pub mesh: &'a Mesh,
    /// Number of triangles that are no backdrop.
    pub faces: usize,
    /// The size of what it leaves out, in units of the file; 0 for the scene itself.
    pub error: f64,
}

/// The text of the file: the coarsest level is the root, every finer one the only child of the next.
pub fn json(levels: &[TilesetLevel], generator: &str) -> String {
    let mut tile = Value::Null;
    let (mut error, mut bounds) = (0.0f64, None);
    for level in levels {
        // What is drawn when a finer level is not has at least its error and encloses it.
        error = error.max(level.error);
        bounds = extend(bounds, level);
        let mut coarser = json!({
            "boundingVolume": { "box": volume(bounds) },
            "geometricError": error,
            "refine": "REPLACE",
            "content": { "uri": level.uri },
        });
        if !tile.is_null() {
            coarser["children"] = json!([tile]);
        }
        tile = coarser;
    }
    let extent = bounds.map_or(0.0, |[low, high]| (high - low).length());
    let set = json!({
        "asset": { "version": "1.1", "generator": generator },
        "geometricError": extent.max(error),
        "root": tile,
    });
    // Plain strings and numbers always serialize.
    serde_json::to_string_pretty(&set).unwrap_or_default() + "\n"
}

/// Lowest and highest corner of a box; none when it is empty.
type BoxCorners = Option<[glam::DVec3; 2]>;

fn extend(bounds: BoxCorners, level: &TilesetLevel) -> BoxCorners {
    let corners = (0..level.faces).flat_map(|face| level.mesh.corners(face));
    corners.map(|p| p.as_dvec3()).fold(bounds, |bounds, p| match bounds {
        Some([low, high]) => Some([low.min(p), high.max(p)]),
        None => Some([p, p]),
    })
}

/// Middle and half axes of a box. Tiles are Z-up, glTF in them is Y-up: (x, y, z) becomes (x, -z, y).
fn volume(bounds: BoxCorners) -> [f64; 12] {
    let [low, high] = bounds.unwrap_or_default();
    let (middle, half) = ((low + high) / 2.0, ((high - low) / 2.0).max(glam::DVec3::splat(1e-9)));
    [middle.x, -middle.z, middle.y, half.x, 0.0, 0.0, 0.0, half.z, 0.0, 0.0, 0.0, half.y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn every_level_is_the_child_of_the_coarser_one() {
        let mesh = |k: f32| Mesh {
            positions: vec![Vec3::ZERO, Vec3::new(1.0, 2.0, 4.0) * k, Vec3::X],
            ..Mesh::default()
        };
        let (fine, coarse) = (mesh(2.0), mesh(1.0));
        let level = |uri: &str, mesh, error| TilesetLevel { uri: uri.into(), mesh, faces: 1, error };
        let text = json(&[level("a.glb", &fine, 0.0), level("a.lod1.glb", &coarse, 0.25)], "me");
        let set: Value = serde_json::from_str(&text).unwrap();
        let (root, child) = (&set["root"], &set["root"]["children"][0]);
        assert_eq!(
            (&root["content"]["uri"], &child["content"]["uri"]),
            (&json!("a.lod1.glb"), &json!("a.glb"))
        );
        assert_eq!((&root["geometricError"], &child["geometricError"]), (&json!(0.25), &json!(0.0)));
        assert!(set["geometricError"].as_f64().unwrap() > 0.25 && child.get("children").is_none());
        let inner = json!([1.0, -4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 2.0]);
        assert_eq!((&root["boundingVolume"]["box"], &child["boundingVolume"]["box"]), (&inner, &inner));
    }
}
