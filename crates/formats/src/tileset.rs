//! 3D Tiles 1.1: a JSON file that names tiles of a scene, or its levels of detail, each replacing a coarser
//! one.

use glam::DVec3;
use serde_json::{Value, json};
use trisplat_scene::{Result, mesh::Mesh};

/// A tile: drawn as long as a viewer does not need more detail.
#[derive(Debug, Clone, PartialEq)]
pub struct TilesetTile {
    /// Its file, relative to the tileset; none for a tile without triangles.
    pub uri: Option<String>,
    /// Lowest and highest corner of its file's content, Y-up; none when it is empty.
    pub bounds: Option<[DVec3; 2]>,
    /// The size of detail that it leaves out, in units of the file; 0 for full detail.
    pub error: f64,
    /// Whether the tiles below replace it, or are drawn beside it.
    pub replaced: bool,
    /// The tiles below it.
    pub children: Vec<TilesetTile>,
}

impl TilesetTile {
    /// Levels of a whole scene, the finest first: the coarsest is the root, every finer one the only child of the next.
    pub fn chain(levels: impl IntoIterator<Item = TilesetTile>) -> Option<Self> {
        levels.into_iter().reduce(|finer, coarser| {
            // A coarser level has at least the error of the finer ones.
            let error = coarser.error.max(finer.error);
            TilesetTile { error, children: vec![finer], ..coarser }
        })
    }

    /// The same with subtrees in external tilesets, so that no file holds more than `most` tiles, unless one
    /// tile has more children. `save` writes a tileset for a place in the tree, and returns its address.
    ///
    /// Errors: those of `save`.
    pub fn split(self, most: usize, save: &mut dyn FnMut(&str, Self) -> Result<String>) -> Result<Self> {
        Ok(self.part("", most, save)?.0)
    }

    /// The tile with its subtree, and the number of tiles left in its file.
    fn part(
        mut self,
        place: &str,
        most: usize,
        save: &mut dyn FnMut(&str, Self) -> Result<String>,
    ) -> Result<(Self, usize)> {
        let below = |i: usize| if place.is_empty() { i.to_string() } else { format!("{place}.{i}") };
        let children = std::mem::take(&mut self.children).into_iter().enumerate();
        let parts: Vec<(Self, usize)> =
            children.map(|(i, child)| child.part(&below(i), most, save)).collect::<Result<_>>()?;
        let total = 1 + parts.iter().map(|(_, count)| count).sum::<usize>();
        if total <= most {
            self.children = parts.into_iter().map(|(child, _)| child).collect();
            return Ok((self, total));
        }
        let cut = |(i, (child, count)): (usize, (Self, usize))| match count {
            // A single tile is as long as a link to another file.
            1 => Ok(child),
            _ => child.apart(&below(i), save),
        };
        self.children = parts.into_iter().enumerate().map(cut).collect::<Result<_>>()?;
        let left = 1 + self.children.len();
        Ok((self, left))
    }

    /// The tile in an external tileset, and the tile that links to it.
    fn apart(self, place: &str, save: &mut dyn FnMut(&str, Self) -> Result<String>) -> Result<Self> {
        let (bounds, error) = (self.all_bounds(), self.error);
        let uri = Some(save(place, self)?);
        Ok(Self { uri, bounds, error, replaced: true, children: Vec::new() })
    }

    /// The same with addresses relative to a file in the folder of this address, which contains all its
    /// files.
    pub fn beside(mut self, folder: &str) -> Self {
        self.uri = self.uri.map(|uri| uri.strip_prefix(folder).map(str::to_owned).unwrap_or(uri));
        self.children = self.children.into_iter().map(|child| child.beside(folder)).collect();
        self
    }

    fn count(&self) -> usize {
        1 + self.children.iter().map(Self::count).sum::<usize>()
    }

    /// Bounds of the tile and everything below it.
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

/// Most tiles of an indented file; larger files are three times shorter without indentation.
const INDENTED: usize = 1000;

/// The text of the file.
pub(crate) fn json(root: &TilesetTile, generator: &str) -> String {
    let extent = root.all_bounds().map_or(0.0, |[low, high]| (high - low).length());
    let set = json!({
        "asset": { "version": "1.1", "generator": generator },
        "geometricError": extent.max(root.error),
        "root": root.json(),
    });
    // Plain strings and numbers always serialize.
    let text = if root.count() > INDENTED {
        set.to_string()
    } else {
        serde_json::to_string_pretty(&set).unwrap_or_default()
    };
    text + "\n"
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

    /// A tree of `levels`, four tiles below each.
    fn tree(levels: u32, place: &str) -> TilesetTile {
        let children =
            (0..4).filter(|_| levels > 1).map(|i| tree(levels - 1, &format!("{place}{i}"))).collect();
        TilesetTile { children, ..tile(&format!("s.tiles/r{place}.glb"), DVec3::ONE, f64::from(levels - 1)) }
    }

    #[test]
    fn a_large_tree_is_split_into_files_that_hold_every_tile_once() {
        for most in [5, 7, 30, 100, 341, 1000] {
            let mut files = Vec::new();
            let mut save = |place: &str, part: TilesetTile| {
                files.push((format!("s.tiles/set{place}.json"), part.beside("s.tiles/")));
                Ok(format!("s.tiles/set{place}.json"))
            };
            let root = tree(5, "").split(most, &mut save).unwrap();
            assert_eq!(files.is_empty(), most >= 341, "{most}");
            let all = || files.iter().map(|(_, part)| part).chain([&root]);
            assert!(all().all(|part| part.count() <= most), "{most}");
            // Every file is named once, every GLB is in one of them.
            let mut names = Vec::new();
            all().for_each(|part| visit(part, &mut |tile| names.extend(tile.uri.clone())));
            let short = |name: &str| name.strip_prefix("s.tiles/").unwrap_or(name).to_owned();
            let mut names: Vec<String> = names.iter().map(|name| short(name)).collect();
            let mut wanted: Vec<String> = files.iter().map(|(name, _)| short(name)).collect();
            visit(&tree(5, ""), &mut |tile| wanted.extend(tile.uri.as_deref().map(short)));
            names.sort();
            wanted.sort();
            assert_eq!(names, wanted, "{most}");
            visit(&root, &mut |tile| assert!(tile.uri.as_ref().unwrap().starts_with("s.tiles/")));
        }
    }

    fn visit(tile: &TilesetTile, what: &mut dyn FnMut(&TilesetTile)) {
        what(tile);
        tile.children.iter().for_each(|child| visit(child, what));
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
