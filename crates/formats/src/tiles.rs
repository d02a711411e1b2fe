//! The files of a scene in tiles: OUT.tileset.json, and a folder OUT.tiles with one GLB per tile,
//! and with external tilesets if the tree is too large for one.
//!
//! A file's name in the folder holds a hash of its bytes. So an old tileset keeps its tiles until
//! the new one is published, an unchanged tile keeps its name, and a cache may keep tiles for ever.

use crate::gltf::{GltfOptions, from_file_name, to_glb_bytes};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::{AtomicFile, MadeFolders, put, sweep_folder};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Asset, Error, Provenance, Result, Tile};

/// Maximum side of a tile's texture, texels: the limit of today's phones.
const MAX_TEXTURE_SIDE: u32 = 4096;

/// The ending of a tileset's name.
pub(crate) const ENDING: &str = "tileset.json";

/// True for the name of a tileset.
pub(crate) fn is_tileset(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    name == ENDING || name.ends_with(&format!(".{ENDING}"))
}

/// The folder of the tiles: OUT.tiles beside OUT.tileset.json, or "tiles".
pub(super) fn folder_of(tileset: &Path) -> PathBuf {
    let name = tileset.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let stem = name.len().saturating_sub(ENDING.len());
    tileset.with_file_name(format!("{}tiles", &name[..stem]))
}

/// The files of a tileset, with one tile in memory at a time. They are removed unless it is
/// published.
#[derive(Debug)]
pub struct TilesetWriter {
    /// The tileset itself.
    file: AtomicFile,
    folder: PathBuf,
    options: GltfOptions,
    /// Maximum number of tiles in one tileset.
    max_tiles: u32,
    /// Names of all files in the folder.
    names: BTreeSet<String>,
    bytes: u64,
}

impl TilesetWriter {
    /// Begins the tileset `path` with at most `max_tiles` tiles per file; `options` are
    /// the encoding of the tiles.
    ///
    /// # Errors
    ///
    /// A name that is not of a tileset; I/O.
    pub fn start(path: &Path, options: GltfOptions, max_tiles: u32) -> Result<Self> {
        if !is_tileset(path) {
            return Err(Error::invalid("output", path.display(), "a name ending in tileset.json"));
        }
        Self::of(AtomicFile::create(path)?, options, max_tiles)
    }

    /// The same in a file that was created. Bytes are only counted if it is dry.
    pub(super) fn of(mut file: AtomicFile, options: GltfOptions, max_tiles: u32) -> Result<Self> {
        let folder = folder_of(file.path());
        if !file.is_dry() {
            file.keeps(MadeFolders::make(&folder)?);
        }
        Ok(Self { file, folder, options, max_tiles, names: BTreeSet::new(), bytes: 0 })
    }

    /// Writes the tiles of block `index`.
    ///
    /// # Errors
    ///
    /// An asset that was not cut into tiles; I/O.
    pub fn block(&mut self, index: usize, asset: &Asset) -> Result<TilesetTile> {
        self.tiles(&format!("b{index}r"), asset, &asset.provenance)
    }

    /// Writes all tiles of an asset, and its backdrop beside them.
    ///
    /// # Errors
    ///
    /// As [`Self::block`].
    pub(super) fn scene(&mut self, asset: &Asset) -> Result<TilesetTile> {
        let root =
            self.tiles("r", asset, &Provenance { backdrop_faces: 0, ..asset.provenance.clone() })?;
        let Some((_, backdrop)) = asset.split_backdrop() else { return Ok(root) };
        // Always beside the scene: its box contains everything, so it would be replaced first.
        let extent = bounds(&backdrop.mesh, backdrop.mesh.face_count());
        let error = extent.map_or(0.0, |[low, high]| (high - low).length());
        self.above("backdrop", &backdrop, error, false, vec![root])
    }

    fn tiles(&mut self, name: &str, asset: &Asset, provenance: &Provenance) -> Result<TilesetTile> {
        let wants = "a scene cut into tiles: the option `tiles`";
        let not_cut = || Error::invalid("output", self.file.path().display(), wants);
        let root = asset.tiles.as_ref().ok_or_else(not_cut)?;
        // A tile alone needs no viewpoint.
        self.tile(name, root, &provenance.clone().without_views())
    }

    /// Writes a tile that is drawn instead of `children`, or beside them if it is not `replaced`.
    ///
    /// # Errors
    ///
    /// I/O.
    pub fn above(
        &mut self,
        name: &str,
        asset: &Asset,
        error: f64,
        replaced: bool,
        children: Vec<TilesetTile>,
    ) -> Result<TilesetTile> {
        let bounds = bounds(&asset.mesh, asset.mesh.face_count());
        let uri = bounds.map(|_| self.save(name, asset)).transpose()?;
        Ok(TilesetTile { uri, bounds, error, replaced, children })
    }

    /// Writes the tileset itself; returns the folder of the tiles and their bytes.
    ///
    /// # Errors
    ///
    /// I/O.
    pub fn finish(self, root: TilesetTile) -> Result<(PathBuf, u64)> {
        let (file, keep) = self.write_tileset(root)?;
        file.commit()?;
        Ok(keep())
    }

    /// Writes the text of the tileset; subtrees go to external tilesets, so that no file holds more
    /// than `max_tiles` tiles. Returns its file, and a function to call once that is published: it
    /// removes the tiles of an earlier tileset, and returns the folder of the tiles and their
    /// bytes.
    pub(super) fn write_tileset(
        mut self,
        root: TilesetTile,
    ) -> Result<(AtomicFile, impl FnOnce() -> (PathBuf, u64))> {
        let generator = trisplat_scene::report::generator();
        let folder = self.address("");
        let max_tiles = self.max_tiles as usize;
        let mut save = |place: &str, part: TilesetTile| {
            let text = json(&part.relative_to(&folder), &generator);
            self.put(&format!("set{place}"), "json", text.as_bytes())
        };
        let text = json(&root.split(max_tiles, &mut save)?, &generator);
        let Self { mut file, folder, names, bytes, .. } = self;
        file.write_all(text.as_bytes()).map_err(|e| Error::io(file.path(), e))?;
        let dry = file.is_dry();
        let keep = move || {
            if !dry {
                sweep_folder(&folder, |name| is_tile(name) && !names.contains(name));
            }
            (folder, bytes)
        };
        Ok((file, keep))
    }

    /// Writes a tile and those below it; children have their parent's name with one more digit.
    fn tile(&mut self, name: &str, tile: &Tile, provenance: &Provenance) -> Result<TilesetTile> {
        let asset =
            Asset { provenance: provenance.clone(), ..Asset::from(Mesh::clone(&tile.mesh)) };
        let own = self.above(name, &asset, tile.error, true, Vec::new())?;
        let below = tile.children.iter().enumerate();
        let children = below.map(|(i, child)| self.tile(&format!("{name}{i}"), child, provenance));
        Ok(TilesetTile { children: children.collect::<Result<_>>()?, ..own })
    }

    /// Writes one file; returns its name relative to the tileset.
    fn save(&mut self, name: &str, asset: &Asset) -> Result<String> {
        let bytes = match &asset.mesh.texture {
            None => to_glb_bytes(asset, &self.options)?,
            // A file shows a part of the scene: it has only that part's texels.
            Some(texture) => {
                let mut own = asset.clone();
                own.mesh.texture = Some(texture.excerpt(0, MAX_TEXTURE_SIDE));
                to_glb_bytes(&own, &self.options)?
            }
        };
        self.put(name, "glb", &bytes)
    }

    /// Writes one file, unless it exists with these bytes; returns its name relative to the
    /// tileset.
    fn put(&mut self, name: &str, ending: &str, bytes: &[u8]) -> Result<String> {
        self.bytes += bytes.len() as u64;
        let (_, hash) = put(&self.folder, (name, ending), bytes, Some(&mut self.file))?;
        let name = format!("{name}-{hash}.{ending}");
        let uri = self.address(&name);
        self.names.insert(name);
        Ok(uri)
    }

    /// A file of the folder relative to the tileset.
    fn address(&self, name: &str) -> String {
        let folder = self.folder.file_name().unwrap_or_default().to_string_lossy();
        format!("{}/{name}", from_file_name(&folder))
    }
}

/// True for the file name of one of our tiles: a path in the tree and a hash.
fn is_tile(name: &str) -> bool {
    let Some((place, hash)) = name.rsplit_once('-') else { return false };
    let Some((hash, ending)) = hash.split_once('.') else { return false };
    let hashed = hash.len() == 16 && hash.bytes().all(|b| b.is_ascii_hexdigit());
    let in_tree = || {
        let block = place
            .strip_prefix('b')
            .map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit()));
        let digits = block.unwrap_or(place).strip_prefix('r');
        digits.is_some_and(|digits| digits.bytes().all(|b| (b'0'..b'4').contains(&b)))
    };
    hashed
        && match ending {
            "glb" => in_tree() || place == "backdrop" || place == "shell",
            "json" => {
                let part = place.strip_prefix("set");
                part.is_some_and(|part| part.bytes().all(|b| b == b'.' || b.is_ascii_digit()))
            }
            _ => false,
        }
}

// ---- The JSON of a tileset (3D Tiles 1.1) -------------------------------------------------------

/// A tile: drawn as long as a viewer does not need more detail.
#[derive(Debug, Clone, PartialEq)]
pub struct TilesetTile {
    /// Its file, relative to the tileset; none for a tile without triangles.
    pub uri: Option<String>,
    /// Lowest and highest corner of its file's content, Y-up; none when it is empty.
    pub bounds: Option<[DVec3; 2]>,
    /// The size of detail that it leaves out, in units of the file; 0 for full detail.
    pub error: f64,
    /// True when the tiles below replace it, false when they are drawn beside it.
    pub replaced: bool,
    /// The tiles below it.
    pub children: Vec<TilesetTile>,
}

impl TilesetTile {
    /// Levels of a whole scene, the finest first: the coarsest is the root, every finer one the
    /// only child of the next.
    pub(crate) fn chain(levels: impl IntoIterator<Item = TilesetTile>) -> Option<Self> {
        levels.into_iter().reduce(|finer, coarser| {
            // A coarser level has at least the error of the finer ones.
            let error = coarser.error.max(finer.error);
            TilesetTile { error, children: vec![finer], ..coarser }
        })
    }

    /// The same with subtrees in external tilesets, so that no file holds more than `max_tiles`
    /// tiles, unless one tile has more children. `save` writes a tileset for a place in the tree,
    /// and returns its address.
    ///
    /// # Errors
    ///
    /// As `save`.
    fn split(
        self,
        max_tiles: usize,
        save: &mut dyn FnMut(&str, Self) -> Result<String>,
    ) -> Result<Self> {
        Ok(self.part("", max_tiles, save)?.0)
    }

    /// The tile with its subtree, and the number of tiles left in its file.
    fn part(
        mut self,
        place: &str,
        max_tiles: usize,
        save: &mut dyn FnMut(&str, Self) -> Result<String>,
    ) -> Result<(Self, usize)> {
        let below =
            |i: usize| if place.is_empty() { i.to_string() } else { format!("{place}.{i}") };
        let children = std::mem::take(&mut self.children).into_iter().enumerate();
        let parts: Vec<(Self, usize)> = children
            .map(|(i, child)| child.part(&below(i), max_tiles, save))
            .collect::<Result<_>>()?;
        let total = 1 + parts.iter().map(|(_, count)| count).sum::<usize>();
        if total <= max_tiles {
            self.children = parts.into_iter().map(|(child, _)| child).collect();
            return Ok((self, total));
        }
        let cut = |(i, (child, count)): (usize, (Self, usize))| match count {
            // A single tile is as long as a link to another file.
            1 => Ok(child),
            _ => child.into_external(&below(i), save),
        };
        self.children = parts.into_iter().enumerate().map(cut).collect::<Result<_>>()?;
        let left = 1 + self.children.len();
        Ok((self, left))
    }

    /// The tile in an external tileset, and the tile that links to it.
    fn into_external(
        self,
        place: &str,
        save: &mut dyn FnMut(&str, Self) -> Result<String>,
    ) -> Result<Self> {
        let bounds = self.all_bounds();
        let error = self.error;
        let uri = Some(save(place, self)?);
        Ok(Self { uri, bounds, error, replaced: true, children: Vec::new() })
    }

    /// The same with addresses relative to a file in the folder of this address, which contains all
    /// its files.
    fn relative_to(mut self, folder: &str) -> Self {
        self.uri = self.uri.map(|uri| uri.strip_prefix(folder).map(str::to_owned).unwrap_or(uri));
        self.children = self.children.into_iter().map(|child| child.relative_to(folder)).collect();
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

/// Maximum number of tiles of an indented file; larger files are three times shorter without
/// indentation.
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

/// Middle and half axes of a box. Tiles are Z-up, glTF in them is Y-up: (x, y, z) becomes (x, -z,
/// y).
fn volume(bounds: Option<[DVec3; 2]>) -> [f64; 12] {
    let [low, high] = bounds.unwrap_or_default();
    let middle = (low + high) / 2.0;
    let half = ((high - low) / 2.0).max(DVec3::splat(1e-9));
    [middle.x, -middle.z, middle.y, half.x, 0.0, 0.0, 0.0, half.z, 0.0, 0.0, 0.0, half.y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_a_tileset_and_what_a_tile() {
        for (path, folder) in [
            ("a/tileset.json", "a/tiles"),
            ("b.tileset.json", "b.tiles"),
            ("C.TILESET.JSON", "C.tiles"),
        ] {
            assert!(is_tileset(Path::new(path)), "{path}");
            assert_eq!(folder_of(Path::new(path)), Path::new(folder));
        }
        assert!(!is_tileset(Path::new("a.json")) && !is_tileset(Path::new("mytileset.json")));
        assert!(is_tile("r-0123456789abcdef.glb") && is_tile("r0123-0123456789abcdef.glb"));
        assert!(is_tile("backdrop-0123456789abcdef.glb") && is_tile("b17r02-0123456789abcdef.glb"));
        assert!(
            is_tile("set0.12-0123456789abcdef.json") && !is_tile("settings-0123456789abcdef.json")
        );
        for other in [
            "r-0123.glb",
            "r4-0123456789abcdef.glb",
            "robot.glb",
            "r0-0123456789abcdeg.glb",
            "r0.bin",
        ] {
            assert!(!is_tile(other), "{other}");
        }
    }
}

#[cfg(test)]
mod tileset_tests {
    use super::*;

    fn tile(uri: &str, high: DVec3, error: f64) -> TilesetTile {
        let bounds = Some([DVec3::ZERO, high]);
        TilesetTile { uri: Some(uri.into()), bounds, error, replaced: true, children: Vec::new() }
    }

    #[test]
    fn every_level_is_the_child_of_the_coarser_one() {
        let fine = DVec3::new(2.0, 4.0, 8.0);
        let coarse = DVec3::new(1.0, 2.0, 4.0);
        let root = TilesetTile::chain([tile("a.glb", fine, 0.0), tile("a.lod1.glb", coarse, 0.25)])
            .unwrap();
        let set: Value = serde_json::from_str(&json(&root, "me")).unwrap();
        let root = &set["root"];
        let child = &set["root"]["children"][0];
        assert_eq!(
            (&root["content"]["uri"], &child["content"]["uri"]),
            (&json!("a.lod1.glb"), &json!("a.glb"))
        );
        assert_eq!(
            (&root["geometricError"], &child["geometricError"]),
            (&json!(0.25), &json!(0.0))
        );
        assert!(set["geometricError"].as_f64().unwrap() > 0.25 && child.get("children").is_none());
        let inner = json!([1.0, -4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 2.0]);
        assert_eq!(
            (&root["boundingVolume"]["box"], &child["boundingVolume"]["box"]),
            (&inner, &inner)
        );
        assert_eq!(root["refine"], "REPLACE");
    }

    /// A tree of `levels`, four tiles below each.
    fn tree(levels: u32, place: &str) -> TilesetTile {
        let children = (0..4)
            .filter(|_| levels > 1)
            .map(|i| tree(levels - 1, &format!("{place}{i}")))
            .collect();
        TilesetTile {
            children,
            ..tile(&format!("s.tiles/r{place}.glb"), DVec3::ONE, f64::from(levels - 1))
        }
    }

    #[test]
    fn a_large_tree_is_split_into_files_that_hold_every_tile_once() {
        for most in [5, 7, 30, 100, 341, 1000] {
            let mut files = Vec::new();
            let mut save = |place: &str, part: TilesetTile| {
                files.push((format!("s.tiles/set{place}.json"), part.relative_to("s.tiles/")));
                Ok(format!("s.tiles/set{place}.json"))
            };
            let root = tree(5, "").split(most, &mut save).unwrap();
            assert_eq!(files.is_empty(), most >= 341, "{most}");
            let all = || files.iter().map(|(_, part)| part).chain([&root]);
            assert!(all().all(|part| part.count() <= most), "{most}");
            // Every file is named once, every GLB is in one of them.
            let mut names = Vec::new();
            for part in all() {
                visit(part, &mut |tile| names.extend(tile.uri.clone()));
            }
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
        for child in &tile.children {
            visit(child, what);
        }
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
