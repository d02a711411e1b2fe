//! The files of a scene in tiles: OUT.tileset.json, and a folder OUT.tiles with one GLB per tile, and with
//! external tilesets if the tree is too large for one.
//!
//! A file's name in the folder holds a hash of its bytes. So an old tileset keeps its tiles until the new one
//! is published, an unchanged tile keeps its name, and a cache may keep tiles for ever.

use super::tileset::{self, TilesetTile};
use crate::gltf::{GltfOptions, to_glb_bytes, uri};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::{
    Asset, Error, Provenance, Result, Tile,
    atomic::{AtomicFile, MadeFolders, sweep_folder},
    mesh::Mesh,
};
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
        let bounds = tileset::bounds(&asset.mesh, asset.mesh.face_count());
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
            let bounds = tileset::bounds(&backdrop.mesh, backdrop.mesh.face_count());
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
            let text = tileset::json(&part.beside(&folder), &generator);
            self.put(tileset, &format!("set{place}"), "json", text.as_bytes())
        };
        Ok(tileset::json(&root.split(most_tiles as usize, &mut save)?, &generator))
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
        let bounds = tileset::bounds(&tile.mesh, tile.mesh.face_count());
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
        format!("{}/{name}", uri::from_file_name(&folder))
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
