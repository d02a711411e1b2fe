//! A tileset (3D Tiles 1.1): the tree, and every file it names.

use super::findings::{Finding, Findings, Severity};
use crate::error::{Error, Result};
use crate::formats::gltf::uri;
use crate::input;
use glam::{DMat4, DVec3, Vec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a box may lack, as a share of its own size: writers round, and positions of 16 bits are off by so much.
const SLACK: f64 = 1e-3;

/// A tile that was checked as a file of its own.
pub(super) struct CheckedTile {
    /// Triangles in it, when it could be read.
    pub(super) triangles: Option<u64>,
    pub(super) findings: Vec<Finding>,
    /// Lowest and highest corner of its triangles, backdrop excluded, as its file has them.
    pub(super) bounds: Option<[Vec3; 2]>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Tileset {
    asset: Asset,
    geometric_error: f64,
    root: Tile,
}

#[derive(Deserialize)]
struct Asset {
    version: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Tile {
    bounding_volume: Volume,
    geometric_error: f64,
    refine: Option<String>,
    transform: Option<[f64; 16]>,
    content: Option<Content>,
    #[serde(default)]
    contents: Vec<Content>,
    #[serde(default)]
    children: Vec<Tile>,
}

#[derive(Deserialize)]
struct Volume {
    #[serde(rename = "box")]
    around: Option<[f64; 12]>,
}

#[derive(Deserialize)]
struct Content {
    uri: String,
}

/// Checks the tileset at `path`, of which `json` is the text; `check_file` checks a tile, those outside its folder with `allow_outside` only. Returns the triangles in all its files, when all
/// could be read.
pub(super) fn check(
    path: &Path,
    json: &[u8],
    allow_outside: bool,
    check_file: &mut dyn FnMut(&Path) -> Result<CheckedTile>,
    findings: &mut Findings,
) -> Result<Option<u64>> {
    let set: Tileset = match serde_json::from_slice(json) {
        Ok(set) => set,
        Err(e) => {
            findings.error(format!("line {} column {}", e.line(), e.column()), format!("is no tileset: {e}"));
            return Ok(None);
        }
    };
    if !matches!(set.asset.version.as_str(), "1.0" | "1.1") {
        findings.error("asset", format!("has the version {}; 1.0 and 1.1 are known", set.asset.version));
    }
    if set.root.refine.is_none() {
        findings.error("root", "lacks `refine`, which the first tile must have");
    }
    let folder = (path.as_os_str() != "-").then(|| path.parent().unwrap_or(Path::new("")).to_owned());
    let mut tree =
        Tree { folder, allow_outside, check_file, findings, tiles: BTreeMap::new(), notes: BTreeMap::new() };
    tree.tile("root", &set.root, &Above { error: set.geometric_error, around: None })?;
    let Tree { tiles, notes, .. } = tree;
    for (what, count) in notes {
        findings.add(Severity::Note, format!("{count} of {} tiles", tiles.len()), what);
    }
    Ok(tiles.into_values().map(|tile| tile.triangles).sum())
}

/// What holds for all that is below a tile.
struct Above {
    error: f64,
    around: Option<OrientedBox>,
}

/// A file of the tileset.
struct TileFile {
    triangles: Option<u64>,
    bounds: Option<[Vec3; 2]>,
}

/// A tileset that is walked.
struct Tree<'a> {
    /// None of standard input.
    folder: Option<PathBuf>,
    allow_outside: bool,
    check_file: &'a mut dyn FnMut(&Path) -> Result<CheckedTile>,
    findings: &'a mut Findings,
    /// Every file once, by its name in the tileset.
    tiles: BTreeMap<String, TileFile>,
    /// What is worth knowing of tiles, and of how many: one finding, not one per tile.
    notes: BTreeMap<String, usize>,
}

impl Tree<'_> {
    /// A tile and those below it. No document is so deep that this does not return: JSON has at most 128 levels here.
    fn tile(&mut self, place: &str, tile: &Tile, above: &Above) -> Result<()> {
        let error = tile.geometric_error;
        if !(error >= 0.0 && error.is_finite()) {
            self.findings.error(place, format!("has the geometricError {error}; wants 0 or more"));
        } else if error > above.error {
            let what = format!(
                "has the geometricError {error}, above it is {}: it must not grow downwards",
                above.error
            );
            self.findings.error(place, what);
        }
        if let Some(refine) = tile.refine.as_deref().filter(|refine| !matches!(*refine, "ADD" | "REPLACE")) {
            self.findings.error(place, format!("has the refine {refine:?}; wants ADD or REPLACE"));
        }
        let around = self.volume(place, tile);
        let transform = DMat4::from_cols_array(&tile.transform.unwrap_or(DMat4::IDENTITY.to_cols_array()));
        let holds = |outer: &OrientedBox, inner: &OrientedBox| {
            inner.corners().iter().all(|corner| outer.holds(transform.transform_point3(*corner)))
        };
        if above.around.as_ref().zip(around.as_ref()).is_some_and(|(outer, inner)| !holds(outer, inner)) {
            self.findings.error(place, "has a box that is not within that of the tile above it");
        }
        for content in tile.content.iter().chain(&tile.contents) {
            self.content(place, content, around.as_ref())?;
        }
        let above = Above { error: error.min(above.error), around };
        for (i, child) in tile.children.iter().enumerate() {
            self.tile(&format!("{place}.children[{i}]"), child, &above)?;
        }
        Ok(())
    }

    fn volume(&mut self, place: &str, tile: &Tile) -> Option<OrientedBox> {
        let Some(numbers) = tile.bounding_volume.around else {
            let what = "has a bounding volume other than a box, which is not checked";
            self.findings.add(Severity::Note, place, what);
            return None;
        };
        let around = OrientedBox::new(&numbers);
        if around.is_none() {
            self.findings.error(place, "has a box without a volume");
        }
        around
    }

    /// The file of a tile; every file is checked once.
    fn content(&mut self, place: &str, content: &Content, around: Option<&OrientedBox>) -> Result<()> {
        let name = &content.uri;
        if !self.tiles.contains_key(name) {
            let file = self.file(place, name)?;
            self.tiles.insert(name.clone(), file);
        }
        let bounds = self.tiles.get(name).and_then(|file| file.bounds);
        if let (Some([low, high]), Some(around)) = (bounds, around) {
            let corners = corners(low.as_dvec3(), high.as_dvec3());
            // Tiles are Z-up, glTF in them is Y-up.
            if !corners.iter().all(|p| around.holds(DVec3::new(p.x, -p.z, p.y))) {
                self.findings.error(place, format!("has triangles outside its box, in {name}"));
            }
        }
        Ok(())
    }

    fn file(&mut self, place: &str, name: &str) -> Result<TileFile> {
        let mut none = |severity, what: String| {
            self.findings.add(severity, place, what);
            Ok(TileFile { triangles: None, bounds: None })
        };
        let relative = uri::unescaped(name);
        if name.contains(':')
            || name.starts_with("//")
            || Path::new(&relative).is_absolute()
            || relative.contains('\0')
        {
            return none(Severity::Note, format!("names {name}, which is not beside it and not checked"));
        }
        let Some(folder) = self.folder.clone() else {
            return none(
                Severity::Error,
                format!("names {name}, which standard input cannot reach; give the file by name"),
            );
        };
        if input::leaves_folder(Path::new(&relative)) && !self.allow_outside {
            let what = format!("names {name}, outside its folder; if that is right, give `allow_outside`");
            return none(Severity::Error, what);
        }
        let file = folder.join(relative);
        if !file.is_file() {
            return none(Severity::Error, format!("names {name}, which is not there: {}", file.display()));
        }
        if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
            return none(Severity::Note, format!("names {name}, a tileset of its own: validate it, too"));
        }
        let CheckedTile { triangles, findings, bounds } = match (self.check_file)(&file) {
            Err(Error::Unsupported { reason, .. }) => {
                return none(Severity::Error, format!("names {name}, which {reason}"));
            }
            other => other?,
        };
        for Finding { severity, place, what } in findings {
            match severity {
                Severity::Note => *self.notes.entry(what).or_default() += 1,
                _ => self.findings.add(severity, format!("{name}: {place}"), what),
            }
        }
        Ok(TileFile { triangles, bounds })
    }
}

/// A box: its middle and half of its axes.
struct OrientedBox {
    middle: DVec3,
    half: [DVec3; 3],
}

impl OrientedBox {
    fn new(numbers: &[f64; 12]) -> Option<Self> {
        let at = |i: usize| DVec3::from_slice(&numbers[3 * i..3 * i + 3]);
        let half = [at(1), at(2), at(3)];
        let is_box =
            numbers.iter().all(|x| x.is_finite()) && half.iter().all(|axis| axis.length_squared() > 0.0);
        is_box.then_some(Self { middle: at(0), half })
    }

    fn corners(&self) -> [DVec3; 8] {
        corners(DVec3::NEG_ONE, DVec3::ONE)
            .map(|p| self.middle + self.half[0] * p.x + self.half[1] * p.y + self.half[2] * p.z)
    }

    /// Whether a point is inside, or hardly outside.
    fn holds(&self, point: DVec3) -> bool {
        let slack = SLACK * self.half.iter().map(|axis| axis.length()).fold(0.0, f64::max);
        let from = point - self.middle;
        self.half.iter().all(|axis| from.dot(axis.normalize()).abs() <= axis.length() + slack)
    }
}

fn corners(low: DVec3, high: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low))
}
