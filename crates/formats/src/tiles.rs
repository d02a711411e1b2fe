//! The files of a scene in tiles: OUT.tileset.json, and a folder OUT.tiles with one GLB per tile, and with
//! external tilesets if the tree is too large for one.
//!
//! A file's name in the folder holds a hash of its bytes. So an old tileset keeps its tiles until the new one
//! is published, an unchanged tile keeps its name, and a cache may keep tiles for ever.

use crate::gltf::{GltfOptions, from_file_name, to_glb_bytes};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::{AtomicFile, MadeFolders, sweep_folder};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Asset, Error, Provenance, Result, Tile};
use xxhash_rust::xxh3::xxh3_64;

/// Largest side of a tile's texture, texels: what today's phones draw.
const LARGEST_TEXTURE: u32 = 4096;

/// The ending of a tileset's name.
pub(crate) const ENDING: &str = "tileset.json";

/// Whether a file of this name is a tileset.
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

/// The tileset of a scene in blocks, with one block in memory at a time. Its tiles are removed unless it is
/// finished.
#[derive(Debug)]
pub struct TilesetWriter {
    path: PathBuf,
    file: AtomicFile,
    files: TileFiles,
    options: GltfOptions,
    /// Most tiles in one tileset.
    most_tiles: u32,
}

impl TilesetWriter {
    /// Begins the tileset `path` with at most `most_tiles` tiles per file; `options` are those of the tiles'
    /// encoding.
    ///
    /// Errors: a name that is not of a tileset; those of the operating system.
    pub fn start(path: &Path, options: GltfOptions, most_tiles: u32) -> Result<Self> {
        if !is_tileset(path) {
            return Err(Error::invalid("output", path.display(), "a name ending in tileset.json"));
        }
        let mut file = AtomicFile::create(path)?;
        let files = TileFiles::new(&mut file)?;
        Ok(Self { path: path.to_owned(), file, files, options, most_tiles })
    }

    /// Writes the tiles of block `index`.
    ///
    /// Errors: an asset that was not cut into tiles; what the operating system refuses.
    pub fn block(&mut self, index: usize, asset: &Asset) -> Result<TilesetTile> {
        let root = asset.tiles.as_ref().ok_or_else(|| not_cut(&self.path))?;
        self.files.tile(&mut self.file, &format!("b{index}r"), root, &asset.provenance, &self.options)
    }

    /// Writes a tile that is drawn instead of `children`, or beside them if it is not `replaced`.
    ///
    /// Errors: what the operating system refuses.
    pub fn above(
        &mut self,
        name: &str,
        asset: &Asset,
        error: f64,
        replaced: bool,
        children: Vec<TilesetTile>,
    ) -> Result<TilesetTile> {
        let bounds = bounds(&asset.mesh, asset.mesh.face_count());
        let uri = match bounds {
            Some(_) => Some(self.files.save(&mut self.file, name, asset, &self.options)?),
            None => None,
        };
        Ok(TilesetTile { uri, bounds, error, replaced, children })
    }

    /// Writes the tileset itself; returns the folder of the tiles and their bytes.
    ///
    /// Errors: what the operating system refuses.
    pub fn finish(mut self, root: TilesetTile) -> Result<(PathBuf, u64)> {
        let text = self.files.tileset(&mut self.file, root, self.most_tiles)?;
        self.file.write_all(text.as_bytes()).map_err(|e| Error::io(&self.path, e))?;
        self.file.commit()?;
        Ok(self.files.keep())
    }
}

fn not_cut(tileset: &Path) -> Error {
    Error::invalid("output", tileset.display(), "a scene cut into tiles: the option `tiles`")
}

/// The files of the tiles. They are removed unless the tileset that names them is published.
#[derive(Debug)]
pub(super) struct TileFiles {
    folder: PathBuf,
    /// Whether bytes are counted only.
    dry: bool,
    /// Names of all tiles.
    names: BTreeSet<String>,
    bytes: u64,
}

impl TileFiles {
    /// Writes all tiles of an asset; returns them and the text of the tileset, which holds at most `most_tiles` of them.
    ///
    /// Errors: an asset that was not cut into tiles; what the operating system refuses.
    pub(super) fn write(
        tileset: &mut AtomicFile,
        asset: &Asset,
        options: &GltfOptions,
        most_tiles: u32,
    ) -> Result<(Self, String)> {
        let root = asset.tiles.as_ref().ok_or_else(|| not_cut(tileset.path()))?;
        let mut files = Self::new(tileset)?;
        let provenance = Provenance { backdrop: 0, ..asset.provenance.clone() };
        let mut root = files.tile(tileset, "r", root, &provenance, options)?;
        if let Some((_, backdrop)) = asset.apart() {
            // Always beside the scene: its box contains everything, so it would be replaced first.
            let bounds = bounds(&backdrop.mesh, backdrop.mesh.face_count());
            let uri = Some(files.save(tileset, "backdrop", &backdrop, options)?);
            let error = bounds.map_or(0.0, |[low, high]| (high - low).length());
            root = TilesetTile { uri, bounds, error, replaced: false, children: vec![root] };
        }
        let text = files.tileset(tileset, root, most_tiles)?;
        Ok((files, text))
    }

    /// The text of the tileset; subtrees go to external tilesets, so that no file holds more than
    /// `most_tiles` tiles.
    fn tileset(&mut self, tileset: &mut AtomicFile, root: TilesetTile, most_tiles: u32) -> Result<String> {
        let generator = trisplat_scene::report::generator();
        let folder = self.address("");
        let mut save = |place: &str, part: TilesetTile| {
            let text = json(&part.beside(&folder), &generator);
            self.put(tileset, &format!("set{place}"), "json", text.as_bytes())
        };
        Ok(json(&root.split(most_tiles as usize, &mut save)?, &generator))
    }

    fn new(tileset: &mut AtomicFile) -> Result<Self> {
        let (folder, dry) = (folder_of(tileset.path()), tileset.is_dry());
        if !dry {
            tileset.keeps(MadeFolders::make(&folder)?);
        }
        Ok(Self { folder, dry, names: BTreeSet::new(), bytes: 0 })
    }

    /// Writes a tile and those below it; children have their parent's name with one more digit.
    fn tile(
        &mut self,
        tileset: &mut AtomicFile,
        name: &str,
        tile: &Tile,
        provenance: &Provenance,
        options: &GltfOptions,
    ) -> Result<TilesetTile> {
        let mut uri = None;
        if tile.mesh.face_count() > 0 {
            // A tile alone needs no viewpoint.
            let provenance = Provenance { viewpoint: None, ..provenance.clone() };
            let asset = Asset { provenance, ..Asset::from(Mesh::clone(&tile.mesh)) };
            uri = Some(self.save(tileset, name, &asset, options)?);
        }
        let below = tile.children.iter().enumerate();
        let child = |(i, child)| self.tile(tileset, &format!("{name}{i}"), child, provenance, options);
        let children = below.map(child).collect::<Result<_>>()?;
        let bounds = bounds(&tile.mesh, tile.mesh.face_count());
        Ok(TilesetTile { uri, bounds, error: tile.error, replaced: true, children })
    }

    /// Writes one file; returns its name relative to the tileset.
    fn save(
        &mut self,
        tileset: &mut AtomicFile,
        name: &str,
        asset: &Asset,
        options: &GltfOptions,
    ) -> Result<String> {
        match &asset.mesh.texture {
            None => self.put(tileset, name, "glb", &to_glb_bytes(asset, options)?),
            // A file shows a part of the scene: it has only that part's texels.
            Some(texture) => {
                let mut own = asset.clone();
                own.mesh.texture = Some(texture.excerpt(0, LARGEST_TEXTURE));
                self.put(tileset, name, "glb", &to_glb_bytes(&own, options)?)
            }
        }
    }

    /// Writes one file, unless it exists with these bytes; returns its name relative to the tileset.
    fn put(&mut self, tileset: &mut AtomicFile, name: &str, ending: &str, bytes: &[u8]) -> Result<String> {
        let name = format!("{name}-{:016x}.{ending}", xxh3_64(bytes));
        let path = self.folder.join(&name);
        self.bytes += bytes.len() as u64;
        match std::fs::read(&path) {
            _ if self.dry => {}
            Ok(old) if old == bytes => {}
            Ok(_) => {
                let reason = "was changed, its name says so; move it to another folder";
                return Err(Error::unsupported(&path, reason));
            }
            Err(_) => {
                let mut file = AtomicFile::create(&path)?;
                file.write_all(bytes).map_err(|e| Error::io(&path, e))?;
                // One that is there but cannot be read may belong to an earlier tileset.
                if !path.exists() {
                    tileset.names(&path);
                }
                file.commit()?;
            }
        }
        let uri = self.address(&name);
        self.names.insert(name);
        Ok(uri)
    }

    /// A file of the folder relative to the tileset.
    fn address(&self, name: &str) -> String {
        let folder = self.folder.file_name().unwrap_or_default().to_string_lossy();
        format!("{}/{name}", from_file_name(&folder))
    }

    /// Call this after the tileset is published: keeps its tiles, and removes those of an earlier tileset.
    /// Returns their folder and size, bytes.
    pub(super) fn keep(self) -> (PathBuf, u64) {
        if !self.dry {
            sweep_folder(&self.folder, |name| is_tile(name) && !self.names.contains(name));
        }
        (self.folder, self.bytes)
    }
}

/// Whether a name is that of one of our tiles: a place in the tree of the scene or of a block, and a hash.
fn is_tile(name: &str) -> bool {
    let named = name.strip_suffix(".glb").map(|name| (name, false));
    let named = named.or_else(|| name.strip_suffix(".json").map(|name| (name, true)));
    let Some(((place, hash), is_set)) =
        named.and_then(|(name, is_set)| Some((name.rsplit_once('-')?, is_set)))
    else {
        return false;
    };
    let hashed = hash.len() == 16 && hash.bytes().all(|b| b.is_ascii_hexdigit());
    if is_set {
        let part = place.strip_prefix("set");
        return hashed && part.is_some_and(|part| part.bytes().all(|b| b == b'.' || b.is_ascii_digit()));
    }
    let block = place.strip_prefix('b').map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit()));
    let in_tree = block
        .unwrap_or(place)
        .strip_prefix('r')
        .is_some_and(|digits| digits.bytes().all(|b| (b'0'..b'4').contains(&b)));
    (in_tree || place == "backdrop" || place == "shell") && hashed
}

// ---- The JSON of a tileset (3D Tiles 1.1) ---------------------------------------------------------

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

    #[test]
    fn names_say_what_is_a_tileset_and_what_a_tile() {
        for (path, folder) in
            [("a/tileset.json", "a/tiles"), ("b.tileset.json", "b.tiles"), ("C.TILESET.JSON", "C.tiles")]
        {
            assert!(is_tileset(Path::new(path)), "{path}");
            assert_eq!(folder_of(Path::new(path)), Path::new(folder));
        }
        assert!(!is_tileset(Path::new("a.json")) && !is_tileset(Path::new("mytileset.json")));
        assert!(is_tile("r-0123456789abcdef.glb") && is_tile("r0123-0123456789abcdef.glb"));
        assert!(is_tile("backdrop-0123456789abcdef.glb") && is_tile("b17r02-0123456789abcdef.glb"));
        assert!(is_tile("set0.12-0123456789abcdef.json") && !is_tile("settings-0123456789abcdef.json"));
        for other in
            ["r-0123.glb", "r4-0123456789abcdef.glb", "robot.glb", "r0-0123456789abcdeg.glb", "r0.bin"]
        {
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
