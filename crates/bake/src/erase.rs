//! Erases triangles again: a list that the page's eraser saved, of where they were.
//!
//! The list is of one version of a scene, this bake is of the next one, whose triangles are others.
//! So a place is erased, not a number: a triangle goes if its middle is on a listed one and it is
//! not much larger, unless the listed one itself is still there. Runs on triangles that no longer
//! move, before levels of detail and colours.

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::{Error, Placement, Provenance, Result};

/// Distance of a middle from a listed triangle up to which it is on it, as a share of the height
/// of that: the middle of a neighbour of the same shape is a third away.
const MAX_DISTANCE: f32 = 0.25;
/// Distance of equal corners, as a share of the longest edge.
const SAME: f32 = 1e-3;
/// Longest edge of a triangle that goes, as a multiple of that of the listed one.
const MAX_SIZE: f32 = 2.0;
/// The format of the list.
const VERSION: u32 = 1;

/// Triangles to erase.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct EraseOptions {
    /// Erase what was erased in a page of an earlier version of the scene: the list that its
    /// eraser saved
    #[cfg_attr(feature = "cli", arg(long, value_name = "LIST"))]
    pub erase: Option<PathBuf>,
}

impl EraseOptions {
    /// Erases nothing.
    pub const DEFAULT: Self = Self { erase: None };

    /// Reads the list, so that one that cannot be read ends a bake before its work begins.
    ///
    /// # Errors
    ///
    /// A file that is no list.
    pub(crate) fn validate(&self) -> Result<()> {
        self.erase.as_deref().map_or(Ok(()), |path| EraseFile::read(path).map(drop))
    }
}

/// Triangles that were erased.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EraseDetails {
    /// Triangles of the list.
    pub listed: u64,
    /// Listed triangles on which the scene had none.
    pub unmatched: u64,
    /// Triangles of the scene and its backdrop that were erased.
    pub erased: u64,
}

trisplat_scene::stage!(EraseDetails, "erase");

/// The file, as `page/src/eraser.js` writes it.
#[derive(Deserialize)]
struct EraseFile {
    trisplat_erase: u32,
    #[serde(default)]
    source: Option<String>,
    #[serde(default)]
    placement: Option<Placement>,
    /// In the frame of the file whose triangles they were.
    triangles: Vec<[Vec3; 3]>,
}

impl EraseFile {
    fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::unread(path, e))?;
        let list: Self = serde_json::from_reader(BufReader::new(file)).map_err(|e| {
            let at = format!("line {}", e.line());
            Error::malformed(
                path,
                at,
                format!("is no list of erased triangles as the eraser of a page saves it: {e}"),
            )
        })?;
        if list.trisplat_erase != VERSION || list.triangles.is_empty() {
            let reason = "lists no triangle in a format that this version knows; save the list again from the page";
            return Err(Error::unsupported(path, reason));
        }
        Ok(list)
    }
}

/// Triangles of an earlier version, in the frame of the scene.
pub(crate) struct EraseList {
    path: PathBuf,
    triangles: Vec<[Vec3; 3]>,
}

impl EraseList {
    /// Reads a list for the scene of `provenance`.
    ///
    /// # Errors
    ///
    /// As [`EraseOptions::validate`]; a list of another scene.
    pub(crate) fn read(path: &Path, provenance: &Provenance) -> Result<Self> {
        let list = EraseFile::read(path)?;
        if let (Some(listed), Some(source)) = (&list.source, &provenance.source)
            && listed != source
        {
            let reason = format!(
                "lists triangles of a scene from “{listed}”, and this one is from “{source}”; give the list of this scene, or change `source` in it if the photos only have another name"
            );
            return Err(Error::unsupported(path, reason));
        }
        let to_world = list.placement.unwrap_or(Placement::IDENTITY);
        let to_scene = provenance.placement;
        let moved = |corner: Vec3| to_scene.to_file(to_world.to_world(corner));
        let triangles = list.triangles.iter().map(|triangle| triangle.map(moved)).collect();
        Ok(Self { path: path.to_owned(), triangles })
    }

    /// Erases the triangles of `mesh` and `backdrop` that are where the list has one.
    ///
    /// # Errors
    ///
    /// A list whose triangles are all outside of the scene; nothing left.
    pub(crate) fn erase(
        &self,
        mesh: &mut Mesh,
        backdrop: Option<&mut Mesh>,
        details: &mut EraseDetails,
    ) -> Result<Outcome<()>> {
        let corners = mesh.positions.iter().chain(backdrop.iter().flat_map(|b| &b.positions));
        let [low, high] = bounds(corners.copied()).unwrap_or_default();
        let listed = self.triangles.iter().flatten();
        if !listed.into_iter().any(|p| p.cmpge(low).all() && p.cmple(high).all()) {
            let reason = "lists no triangle within this scene: it is the list of another scene, or of one with other camera poses";
            return Err(Error::unsupported(&self.path, reason));
        }
        details.listed = self.triangles.len() as u64;
        let mut matched = vec![false; self.triangles.len()];
        let erased = self.erased_faces(mesh, &mut matched);
        let count = |flags: &[bool]| flags.iter().filter(|flag| **flag).count();
        if count(&erased) == erased.len() {
            let reason = "lists every triangle of this scene: nothing would be left";
            return Err(Error::unsupported(&self.path, reason));
        }
        let mut total = count(&erased);
        mesh.retain(|face| !erased[face]);
        if let Some(backdrop) = backdrop {
            let erased = self.erased_faces(backdrop, &mut matched);
            total += count(&erased);
            backdrop.retain(|face| !erased[face]);
        }
        details.erased = total as u64;
        details.unmatched = (matched.len() - count(&matched)) as u64;
        if total == 0 {
            return Ok(Outcome::Skipped("the scene has no triangle where the list has one"));
        }
        Ok(Outcome::Changed(()))
    }

    /// A flag per face of `mesh`; flags the listed triangles that match one.
    fn erased_faces(&self, mesh: &Mesh, matched: &mut [bool]) -> Vec<bool> {
        let middle = |face: usize| mesh.corners(face).iter().sum::<Vec3>() / 3.0;
        let mut middles: Vec<(Vec3, usize)> =
            (0..mesh.face_count()).map(|face| (middle(face), face)).collect();
        middles.sort_by(|(a, i), (b, j)| a.x.total_cmp(&b.x).then(i.cmp(j)));
        let mut erased = vec![false; middles.len()];
        for (triangle, matched) in self.triangles.iter().zip(matched) {
            let size = longest_edge(triangle);
            let reach = MAX_DISTANCE * height(triangle);
            let low = triangle.iter().copied().fold(Vec3::INFINITY, Vec3::min) - reach;
            let high = triangle.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max) + reach;
            let first = middles.partition_point(|(middle, _)| middle.x < low.x);
            let within = middles[first..].iter().take_while(|(middle, _)| middle.x <= high.x);
            let is_near = |(middle, face): &&(Vec3, usize)| {
                middle.cmpge(low).all()
                    && middle.cmple(high).all()
                    && distance(*middle, triangle) <= reach
                    && longest_edge(&mesh.corners(*face)) <= MAX_SIZE * size
            };
            let near: Vec<usize> = within.filter(is_near).map(|(_, face)| *face).collect();
            *matched |= !near.is_empty();
            let is_same = |face: &&usize| {
                let has = |p: &Vec3| triangle.iter().any(|q| p.distance(*q) <= SAME * size);
                mesh.corners(**face).iter().all(has)
            };
            // Layers over a remaining triangle stay.
            let has_same = near.iter().any(|face| is_same(&face));
            for face in near.iter().filter(|face| !has_same || is_same(face)) {
                erased[*face] = true;
            }
        }
        erased
    }
}

fn longest_edge([a, b, c]: &[Vec3; 3]) -> f32 {
    a.distance(*b).max(b.distance(*c)).max(c.distance(*a))
}

/// Smallest height of a triangle.
fn height(triangle: &[Vec3; 3]) -> f32 {
    let [a, b, c] = *triangle;
    (b - a).cross(c - a).length() / longest_edge(triangle).max(f32::MIN_POSITIVE)
}

/// Distance of a point from a triangle.
fn distance(point: Vec3, triangle: &[Vec3; 3]) -> f32 {
    let edges = [[0, 1], [1, 2], [2, 0]].map(|[i, k]| (triangle[i], triangle[k] - triangle[i]));
    let normal = edges[0].1.cross(edges[1].1).normalize_or_zero();
    let is_inside = |(from, along): &(Vec3, Vec3)| along.cross(point - *from).dot(normal) >= 0.0;
    if normal != Vec3::ZERO && edges.iter().all(is_inside) {
        return (point - triangle[0]).dot(normal).abs();
    }
    let to_edge = |(from, along): &(Vec3, Vec3)| {
        let share = (point - *from).dot(*along) / along.length_squared().max(f32::MIN_POSITIVE);
        point.distance(*from + *along * share.clamp(0.0, 1.0))
    };
    edges.iter().map(to_edge).fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::mesh::Colors;

    /// A floor of 200 triangles and a floater of one.
    fn floor_and_floater(shift: f32) -> Mesh {
        let cells = (0..100).map(|cell| Vec3::new((cell % 10) as f32, 0.0, (cell / 10) as f32));
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let mut positions: Vec<Vec3> = cells
            .flat_map(|at| {
                let [a, b, c, d] =
                    [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]
                        .map(|p| p + at);
                [a, b, c, a, c, d]
            })
            .collect();
        positions.extend(
            [[2.0, 3.0], [4.0, 3.0], [2.0, 5.0]].map(|[x, y]| Vec3::new(x + shift, y, 5.0)),
        );
        let colors = Colors::Face(vec![[0.5; 3]; positions.len() / 3]);
        Mesh { positions, colors, ..Mesh::default() }
    }

    fn list(folder: &Path, text: &str) -> PathBuf {
        let path = folder.join("list.json");
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn erase_list_of_a_version_removes_the_same_places_of_the_next() {
        let folder = tempfile::TempDir::new().unwrap();
        // The page's file was turned and scaled, so that (x, y, z) became 2 (x, -y, -z).
        let path = list(
            folder.path(),
            r#"{"trisplat_erase":1,"source":"mug","placement":{"up":"-y","scale":2,"center":[0,0,0]},
            "triangles":[[[4,-6,-10],[8,-6,-10],[4,-10,-10]],[[0,0,0],[2,0,0],[2,0,-2]],[[6,-2,0],[8,-2,0],[8,-2,-2]]]}"#,
        );
        let source = |name: &str| Provenance { source: Some(name.into()), ..Provenance::default() };
        let run = |mesh: &mut Mesh, provenance: &Provenance| {
            let mut details = EraseDetails::default();
            let list = EraseList::read(&path, provenance)?;
            list.erase(mesh, None, &mut details).map(|outcome| (outcome, details))
        };
        let mut mesh = floor_and_floater(0.1);
        let (outcome, details) = run(&mut mesh, &source("mug")).unwrap();
        assert_eq!(outcome, Outcome::Changed(()));
        assert_eq!(details, EraseDetails { listed: 3, unmatched: 1, erased: 2 });
        assert_eq!(mesh.face_count(), 199, "the floater and one of the floor, none beside it");
        assert!(mesh.positions.iter().all(|p| p.y == 0.0));
        let (again, details) = run(&mut mesh, &Provenance::default()).unwrap();
        assert!(matches!(again, Outcome::Skipped(_)), "{details:?}");
        let other = run(&mut mesh, &source("fox")).unwrap_err().to_string();
        assert!(other.contains("“mug”") && other.contains("“fox”"), "{other}");
        let far = Placement { center: [99.0; 3], ..Placement::IDENTITY };
        let elsewhere = Provenance { placement: far, ..Provenance::default() };
        let outside = run(&mut mesh, &elsewhere).unwrap_err().to_string();
        assert!(outside.contains("no triangle within this scene"), "{outside}");
        for (text, says) in [
            ("{}", "missing field"),
            (r#"{"trisplat_erase":1,"triangles":[]}"#, "lists no triangle"),
        ] {
            list(folder.path(), text);
            let refused = run(&mut mesh, &Provenance::default()).unwrap_err().to_string();
            assert!(refused.contains("list.json") && refused.contains(says), "{refused}");
        }
    }
}
