//! The content of a tileset (3D Tiles): tiles, levels, files and their sizes. Tiles themselves are not read.

use super::tileset_json::{Tile, Tileset, is_json};
use crate::foreign;
use crate::gltf::uri;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result, input};

/// The content of a tileset, including external tilesets.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat info of a tileset")]
pub struct TilesetInfo {
    /// The file as given.
    pub path: String,
    /// Number of tilesets: the file itself, and external ones.
    pub tilesets: u64,
    /// Number of tiles; a link to a tileset and its first tile count once.
    pub tiles: u64,
    /// Depth of the tree in tiles.
    pub levels: u64,
    /// Files with triangles.
    pub files: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// The size of detail that the first tile leaves out, in units of the file.
    pub geometric_error: f64,
    /// Files that are missing or not on this machine.
    pub missing: u64,
}

/// The content of the tileset at `path`; `None` for other files. Files outside its folder count as missing
/// unless `allow_outside`.
///
/// Errors: `Io`; `Malformed` for a broken tileset; tilesets nested deeper than the limits permit.
pub fn tileset_info(path: &Path, limits: &Limits, allow_outside: bool) -> Result<Option<TilesetInfo>> {
    let json = input::read(path, limits)?;
    if !foreign::is_tileset_json(&json) {
        return Ok(None);
    }
    let info = TilesetInfo { path: path.display().to_string(), ..TilesetInfo::default() };
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let (seen, waiting) = (BTreeSet::new(), Vec::new());
    let mut walk = Walk { folder, limits, allow_outside, seen, waiting, info };
    let root = walk.set(path, &json)?;
    walk.info.geometric_error = root.geometric_error;
    walk.tile(Path::new(""), &root, 1, 1)?;
    // One after the other and not within each other: they may be nested deeper than a stack is.
    while let Some(NestedSet { name, level, depth }) = walk.waiting.pop() {
        let path = walk.folder.join(&name);
        let json = input::read(&path, limits)?;
        let root = walk.set(&path, &json)?;
        walk.tile(&name, &root, level, depth)?;
    }
    Ok(Some(walk.info))
}

struct Walk<'a> {
    folder: PathBuf,
    limits: &'a Limits,
    allow_outside: bool,
    /// Files that were counted, relative to the folder.
    seen: BTreeSet<PathBuf>,
    /// Tilesets that are still to be read.
    waiting: Vec<NestedSet>,
    info: TilesetInfo,
}

/// A tileset that another one names.
struct NestedSet {
    /// Relative to the folder.
    name: PathBuf,
    /// Level of its first tile.
    level: u64,
    /// Number of tilesets around it, itself included.
    depth: u64,
}

impl Walk<'_> {
    /// The first tile of a tileset.
    fn set(&mut self, path: &Path, json: &[u8]) -> Result<Tile> {
        self.info.tilesets += 1;
        self.info.bytes += json.len() as u64;
        let set: Tileset = serde_json::from_slice(json).map_err(|e| {
            Error::malformed(
                path,
                format!("line {} column {}", e.line(), e.column()),
                format!("is no tileset: {e}"),
            )
        })?;
        Ok(set.root)
    }

    /// Counts a tile of the tileset `set`, nested `depth` deep, and those below it.
    fn tile(&mut self, set: &Path, tile: &Tile, level: u64, depth: u64) -> Result<()> {
        let mut is_stand_in = false;
        for content in tile.content.iter().chain(&tile.contents) {
            let name = set.parent().unwrap_or(Path::new("")).join(uri::unescaped(&content.uri));
            if !self.seen.insert(name.clone()) {
                continue;
            }
            let path = self.folder.join(&name);
            let outside = name.is_absolute() || input::leaves_folder(&name);
            match std::fs::metadata(&path)
                .ok()
                .filter(|meta| meta.is_file() && (self.allow_outside || !outside))
            {
                None => self.info.missing += 1,
                Some(_) if is_json(&content.uri) => {
                    is_stand_in = true;
                    self.limits.nesting(path.display(), depth + 1)?;
                    self.waiting.push(NestedSet { name, level, depth: depth + 1 });
                }
                Some(meta) => {
                    self.info.files += 1;
                    self.info.bytes += meta.len();
                }
            }
        }
        self.info.tiles += u64::from(!is_stand_in);
        self.info.levels = self.info.levels.max(level);
        tile.children.iter().try_for_each(|child| self.tile(set, child, level + 1, depth))
    }
}
