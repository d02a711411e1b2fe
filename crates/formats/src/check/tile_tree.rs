//! Checks a tileset (3D Tiles 1.1): its tree and every file that it names, including other tilesets.

use crate::findings::{Finding, Findings, Severity};
use crate::gltf::uri;
use crate::tileset_json::{Content, Tile, Tileset, is_json};
use glam::{DMat4, DVec3, Vec3};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result, input};

/// Tolerance of boxes, as a share of their size, because writers round and positions may have 16 bits.
const SLACK: f64 = 1e-3;

/// A tile, checked as a file.
pub(super) struct CheckedTile {
    /// Number of triangles, if the file could be read.
    pub(super) triangles: Option<u64>,
    pub(super) findings: Vec<Finding>,
    /// Lowest and highest corner of its triangles, backdrop excluded, as its file has them.
    pub(super) bounds: Option<[Vec3; 2]>,
}

/// Checks the tileset at `path` with the text `json`; `check_file` checks a tile, those outside its folder
/// with `allow_outside` only. Returns the number of triangles in all files, if all could be read.
pub(super) fn check(
    path: &Path,
    json: &[u8],
    (limits, allow_outside): (&Limits, bool),
    check_file: &mut dyn FnMut(&Path) -> Result<CheckedTile>,
    findings: &mut Findings,
) -> Result<Option<u64>> {
    let folder = (path.as_os_str() != "-").then(|| path.parent().unwrap_or(Path::new("")).to_owned());
    let files = Files { folder, limits, allow_outside, check_file };
    let first = SetFile { name: String::new(), around: None, depth: 1 };
    let (tiles, notes) = (BTreeMap::new(), BTreeMap::new());
    let mut tree = Tree { files, findings, tiles, notes, sets: vec![first], waiting: VecDeque::new() };
    let above = Above { error: f64::INFINITY, around: None, set: 0 };
    if tree.set(json, &above)?.is_none() {
        return Ok(None);
    }
    // One after the other and not within each other: they may be nested deeper than a stack is.
    while let Some((file, above)) = tree.waiting.pop_front() {
        tree.part(&file, &above)?;
    }
    let Tree { tiles, notes, .. } = tree;
    for (what, count) in notes {
        findings.add(Severity::Note, format!("{count} of {} tiles", tiles.len()), what);
    }
    Ok(tiles.into_values().map(|tile| tile.triangles).sum())
}

/// Constraints on everything below a tile.
struct Above {
    error: f64,
    around: Option<OrientedBox>,
    /// The innermost tileset around it.
    set: usize,
}

/// A tileset within the first one, or that one itself.
struct SetFile {
    /// Relative to the first, which has no name.
    name: String,
    /// The tileset that names it.
    around: Option<usize>,
    /// Number of tilesets around it, itself included.
    depth: u64,
}

/// A file of the tileset.
struct TileFile {
    triangles: Option<u64>,
    bounds: Option<[Vec3; 2]>,
}

/// Permissions and options for reading.
struct Files<'a> {
    /// The folder of the first tileset; none for standard input.
    folder: Option<PathBuf>,
    limits: &'a Limits,
    allow_outside: bool,
    check_file: &'a mut dyn FnMut(&Path) -> Result<CheckedTile>,
}

/// A tileset that is walked.
struct Tree<'a> {
    files: Files<'a>,
    findings: &'a mut Findings,
    /// Every file once, by its name in the tileset.
    tiles: BTreeMap<String, TileFile>,
    /// Notes on tiles, with their number, so that there is one finding for all.
    notes: BTreeMap<String, usize>,
    /// Every tileset so far.
    sets: Vec<SetFile>,
    /// Those that are still to be read.
    waiting: VecDeque<(PathBuf, Above)>,
}

impl Tree<'_> {
    /// A place in the innermost tileset, for findings.
    fn place(&self, above: &Above, within: &str) -> String {
        match &self.sets[above.set].name {
            name if name.is_empty() => within.to_owned(),
            name => format!("{name}: {within}"),
        }
    }

    /// True when the tileset `name` is this one, or around it.
    fn is_around(&self, set: usize, name: &str) -> bool {
        let outer = std::iter::successors(Some(set), |set| self.sets[*set].around);
        outer.into_iter().any(|set| self.sets[set].name == name)
    }

    /// The innermost tileset above; none when the file is not a tileset.
    fn set(&mut self, json: &[u8], above: &Above) -> Result<Option<()>> {
        let set: Tileset = match serde_json::from_slice(json) {
            Ok(set) => set,
            Err(e) => {
                let place = self.place(above, &format!("line {} column {}", e.line(), e.column()));
                self.findings.error(place, format!("is no tileset: {e}"));
                return Ok(None);
            }
        };
        if !matches!(set.asset.version.as_str(), "1.0" | "1.1") {
            let what = format!("has the version {}; 1.0 and 1.1 are known", set.asset.version);
            self.findings.error(self.place(above, "asset"), what);
        }
        if set.root.refine.is_none() {
            self.findings.error(self.place(above, "root"), "lacks `refine`, which the first tile must have");
        }
        let error = set.geometric_error.min(above.error);
        let above = Above { error, around: above.around.clone(), set: above.set };
        self.tile("root", &set.root, &above).map(Some)
    }

    /// Checks a tile and the tiles below it. Recursion ends, because JSON is read at most 128 levels deep.
    fn tile(&mut self, within: &str, tile: &Tile, above: &Above) -> Result<()> {
        let place = &self.place(above, within);
        let error = tile.geometric_error;
        if !(error >= 0.0 && error.is_finite()) {
            self.findings.error(place, format!("has the geometricError {error}; expected 0 or more"));
        } else if error > above.error {
            let what = format!(
                "has the geometricError {error}, above it is {}: it must not grow downwards",
                above.error
            );
            self.findings.error(place, what);
        }
        if let Some(refine) = tile.refine.as_deref().filter(|refine| !matches!(*refine, "ADD" | "REPLACE")) {
            self.findings.error(place, format!("has the refine {refine:?}; expected ADD or REPLACE"));
        }
        let around = self.volume(place, tile);
        let transform = DMat4::from_cols_array(&tile.transform.unwrap_or(DMat4::IDENTITY.to_cols_array()));
        let holds = |outer: &OrientedBox, inner: &OrientedBox| {
            inner.corners().iter().all(|corner| outer.holds(transform.transform_point3(*corner)))
        };
        if above.around.as_ref().zip(around.as_ref()).is_some_and(|(outer, inner)| !holds(outer, inner)) {
            self.findings.error(place, "has a box that is not within that of the tile above it");
        }
        let below = Above { error: error.min(above.error), around, set: above.set };
        for content in tile.content.iter().chain(&tile.contents) {
            self.content(place, content, &below)?;
        }
        for (i, child) in tile.children.iter().enumerate() {
            self.tile(&format!("{within}.children[{i}]"), child, &below)?;
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
    fn content(&mut self, place: &str, content: &Content, tile: &Above) -> Result<()> {
        let set = PathBuf::from(&self.sets[tile.set].name);
        let Some(name) = self.local(place, &content.uri, &set) else { return Ok(()) };
        if !self.tiles.contains_key(&name) {
            let file = self.file(place, &name, tile)?;
            self.tiles.insert(name.clone(), file);
        } else if self.is_around(tile.set, &name) {
            self.findings.error(place, format!("names {name}, the tileset that it is in"));
        }
        let bounds = self.tiles.get(&name).and_then(|file| file.bounds);
        if let (Some([low, high]), Some(around)) = (bounds, &tile.around) {
            let corners = corners(low.as_dvec3(), high.as_dvec3());
            // Tiles are Z-up, glTF in them is Y-up.
            if !corners.iter().all(|p| around.holds(DVec3::new(p.x, -p.z, p.y))) {
                self.findings.error(place, format!("has triangles outside its box, in {name}"));
            }
        }
        Ok(())
    }

    /// A file that the tileset `set` names, relative to the first; `None` when it must not be read.
    fn local(&mut self, place: &str, uri: &str, set: &Path) -> Option<String> {
        let relative = uri::unescaped(uri);
        let path = Path::new(&relative);
        if uri.contains(':') || uri.starts_with("//") || path.is_absolute() || relative.contains('\0') {
            let what = format!("names {uri}, which is not beside it and not checked");
            self.findings.add(Severity::Note, place, what);
            self.tiles.insert(uri.to_owned(), TileFile { triangles: None, bounds: None });
            return None;
        }
        Some(set.parent().unwrap_or(Path::new("")).join(path).to_string_lossy().into_owned())
    }

    fn file(&mut self, place: &str, name: &str, tile: &Above) -> Result<TileFile> {
        let mut none = |severity, what: String| {
            self.findings.add(severity, place, what);
            Ok(TileFile { triangles: None, bounds: None })
        };
        let Some(folder) = &self.files.folder else {
            return none(
                Severity::Error,
                format!("names {name}, which standard input cannot reach; give the file by name"),
            );
        };
        if input::leaves_folder(Path::new(name)) && !self.files.allow_outside {
            let what = format!("names {name}, outside its folder; if that is right, give `allow_outside`");
            return none(Severity::Error, what);
        }
        let file = folder.join(name);
        if !file.is_file() {
            return none(Severity::Error, format!("names {name}, which does not exist: {}", file.display()));
        }
        if is_json(name) {
            // It has no triangles of its own: its tiles are counted.
            let depth = self.sets[tile.set].depth + 1;
            self.files.limits.nesting(file.display(), depth)?;
            let above = Above { error: tile.error, around: tile.around.clone(), set: self.sets.len() };
            self.sets.push(SetFile { name: name.to_owned(), around: Some(tile.set), depth });
            self.waiting.push_back((file, above));
            return Ok(TileFile { triangles: Some(0), bounds: None });
        }
        let CheckedTile { triangles, findings, bounds } = match (self.files.check_file)(&file) {
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

    /// Checks a tileset within the tileset. What is none has no number of triangles.
    fn part(&mut self, file: &Path, above: &Above) -> Result<()> {
        let json = input::read(file, self.files.limits)?;
        if self.set(&json, above)?.is_none() {
            let name = self.sets[above.set].name.clone();
            self.tiles.insert(name, TileFile { triangles: None, bounds: None });
        }
        Ok(())
    }
}

/// A box: its middle and half of its axes.
#[derive(Clone)]
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
