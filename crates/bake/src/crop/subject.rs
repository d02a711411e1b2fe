//! The object that cameras look at together, with the surface that it stands on near it.
//!
//! In the smallest ball around the point that cameras look at in which something is whole: the
//! lowest layer with much area that they see is its support, such as a table, or a wall. What is
//! connected above it around the middle is the object; what is beside, behind and below is left
//! out, except the support within a hand's breadth, cut along a polygon.

use super::volume::{BallFrame, GroundTriangle, Outline, REACH, SubjectVolume, Support};
use crate::place::evidence::Evidence;
use crate::place::ground::Foreground;
use crate::place::up::{Confidence, estimate, wall_normal};
use glam::{DVec3, IVec3, Vec2, Vec3};
use std::collections::HashMap;
use trisplat_raster::framing::Subject;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::{self, Camera};
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::math::lists::{Sets, median};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Scene, UpAxis};

/// Maximum edge of a triangle, in radii: larger ones are walls.
const MAX_EDGE: f32 = 1.0;
/// Maximum number of pictures that decide visibility.
const MAX_PICTURES: usize = 48;
/// Longer side of these pictures, px.
const PICTURE_SIDE: u32 = 320;
/// Near plane of these pictures, in radii.
const NEAR: f32 = 0.05;
/// Ratio of the radii of successive balls in which the subject is searched.
const BALL_GROWTH: f32 = 1.189_207_1;
/// Number of the ball that fits into the width of a picture.
const WIDTH_BALL: usize = 4;
/// Share of the visible area that counts as all of it.
const WHOLE_VIEW_SHARE: f32 = 0.9;
/// Maximum height of a whole thing, as a share of the reach.
const MAX_HEIGHT: f32 = 0.9;
/// Maximum radius on the ground of a whole thing, as a share of the reach.
const MAX_RADIUS: f32 = 0.75;
/// Minimum radius of a subject, in radii: smaller things are parts of it.
const MIN_RADIUS: f32 = 0.25;
/// The lowest layer with at least this share of the largest is the support.
const MIN_LAYER_SHARE: f32 = 0.5;
/// A support ends where a layer has less than this share of its area.
const MIN_EDGE_SHARE: f32 = 0.25;
/// Maximum number of layers of a support on each side.
const MAX_LAYERS: usize = 6;
/// Thickness of the support, in radii.
const LAYER_THICKNESS: f32 = 0.06;
/// Maximum height of the support above the middle, in radii.
const MAX_SUPPORT_HEIGHT: f32 = 0.3;
/// Minimum share of the area that a support has.
const MIN_SUPPORT_AREA: f32 = 0.1;
/// Cells by which connected parts are found, per radius.
const CELLS_PER_RADIUS: f32 = 14.0;
/// The object is the part with most area within this many radii of the middle.
const CORE_RADIUS: f32 = 0.6;
/// Minimum area of a part, as a share of the object's: smaller ones are crumbs.
const MIN_PART_AREA: f32 = 0.05;

/// True for the triangles of `scene` that are the subject, and its volume; `None` when nothing
/// stands out. `up` is that of its file, if it names one.
pub(super) fn subject(
    scene: &Scene,
    cameras: &[Camera],
    up: Option<UpAxis>,
) -> Option<(Vec<bool>, SubjectVolume)> {
    let StandingObject { frame, pieces, support, object, outline } = find(scene, cameras, up)?;
    let mut volume = SubjectVolume { frame, outline, support, edge: 1.0 };
    // The object, and the support around it: other triangles inside float.
    let is_near = |at: Vec3| {
        at.z >= volume.low() && support.is_some_and(|support| at.z < support.high + LAYER_THICKNESS)
    };
    let is_flat = |piece: &GroundTriangle| {
        piece.longest() < MAX_EDGE || piece.corners.into_iter().all(is_near)
    };
    let is_level =
        |piece: &&GroundTriangle| volume.is_level(piece) && is_near(piece.middle) && is_flat(piece);
    let level = || pieces.iter().filter(is_level);
    let both = || object.iter().chain(level());
    let mut belongs = vec![false; scene.triangle_count()];
    for piece in both() {
        belongs[piece.number] = true;
    }
    // A trained support has holes far from the middle, where fewer photos look.
    volume.edge = volume.edge_of(both());
    let within = |i: usize| match scene {
        // A soup's triangles are cut at the edge.
        Scene::Soup(_) => !volume.parts(scene.corners(i)).is_empty(),
        Scene::Mesh(_) => volume.parts(scene.corners(i)) == [scene.corners(i)],
    };
    let keep = parallel::collect(belongs.len(), GRAIN, |i| belongs[i] && within(i));
    Some((keep, volume))
}

/// Find the thing in the middle of the pictures of `cameras`, or else all that they show there.
fn find(scene: &Scene, cameras: &[Camera], up: Option<UpAxis>) -> Option<StandingObject> {
    let count = scene.triangle_count();
    let middle = |i: usize| centroid(scene.corners(i));
    let middles: Vec<Vec3> = (0..count).filter(|i| !scene.is_shell(*i)).map(middle).collect();
    let ball = Subject::of(&middles, cameras)?;
    let inner = (0..count).filter(|i| !scene.is_shell(*i)).flat_map(|i| scene.corners(i));
    let mesh = Mesh {
        positions: inner.collect(),
        colors: Colors::Face(vec![[0.0; 3]; middles.len()]),
        ..Mesh::default()
    };
    let areas = visible_areas(&mesh, cameras, ball);
    let ways = ways(&mesh, cameras, up);
    let looked_at = looked_at(cameras);
    let standing = |(ball, way)| StandingObject::new(scene, &areas, BallFrame::new(ball, way));
    // Only a thing with a support is on a wall.
    let is_whole = |found: &StandingObject, way: usize| {
        found.is_whole() && (found.support.is_some() || way == 0)
    };
    let mut middle = None;
    for (size, ball) in looked_at.iter().enumerate() {
        for (number, way) in ways.iter().enumerate() {
            let found = standing((*ball, *way));
            if found.as_ref().is_some_and(|found| is_whole(found, number)) {
                return found;
            }
            middle = if (size, number) == (WIDTH_BALL, 0) { found } else { middle };
        }
    }
    // A thing without an end is cut out as photos show it, unless it is all that they show.
    let all: f32 = areas.iter().sum();
    let reached = standing((ball, *ways.first()?));
    let reached =
        reached.filter(|found| looked_at.is_empty() || found.sees() > WHOLE_VIEW_SHARE * all);
    reached.or_else(|| middle.map(StandingObject::cut))
}

/// Balls around the point that `cameras` look at: from a quarter of the width of most pictures
/// there to half of their height.
fn looked_at(cameras: &[Camera]) -> Vec<Subject> {
    let Some(center) = camera::focus(cameras.iter()) else { return Vec::new() };
    let size = |side: fn(Vec2) -> f32| {
        let at = |camera: &Camera| (camera.rotation * center + camera.translation).z;
        let sizes =
            cameras.iter().map(|camera| side(camera.size.as_vec2() / camera.focal) * at(camera));
        median(sizes.collect(), f32::total_cmp).unwrap_or(0.0)
    };
    let smallest = size(Vec2::min_element) / 4.0;
    let largest = size(Vec2::max_element) / 2.0;
    let ball = |radius| Subject { center, radius, is_alone: false };
    let radii = std::iter::successors(Some(smallest), |radius| Some(radius * BALL_GROWTH));
    radii.take_while(|radius| 0.0 < *radius && *radius <= largest).map(ball).collect()
}

/// The area of each face that some of `cameras` see, times their number; all of it without cameras.
/// `[F]`
fn visible_areas(mesh: &Mesh, cameras: &[Camera], ball: Subject) -> Vec<f32> {
    let mut areas = vec![0.0; mesh.face_count()];
    let mut solid = SolidRasterizer::new();
    let options = SolidRasterOptions { near: NEAR * ball.radius, ..SolidRasterOptions::default() };
    for camera in cameras.iter().step_by(cameras.len().div_ceil(MAX_PICTURES).max(1)) {
        let camera = camera.fit_within(PICTURE_SIDE);
        let drawn = solid.visibility(mesh, &camera, &options);
        for (face, depth) in
            drawn.face.iter().zip(&drawn.depth).filter(|(face, _)| **face != NO_FACE)
        {
            areas[*face as usize] += depth * depth / camera.focal.element_product();
        }
    }
    if cameras.is_empty() {
        areas = (0..mesh.face_count()).map(|face| mesh.area(face) as f32).collect();
    }
    areas
}

/// The directions in which a subject may stand out: up from a table, then from a wall that faces
/// the cameras.
fn ways(mesh: &Mesh, cameras: &[Camera], file_up: Option<UpAxis>) -> Vec<DVec3> {
    let scene = Foreground::new(mesh, 0);
    let evidence = Evidence { cameras, ..Evidence::default() };
    let usable =
        || estimate(scene, evidence).filter(|estimate| estimate.confidence != Confidence::None);
    let up = match file_up {
        Some(UpAxis::Y) => DVec3::Y,
        _ => usable()
            .map_or(file_up.unwrap_or_default().vector(), |estimate| estimate.direction.into()),
    };
    let to_cameras = -cameras.iter().map(|camera| camera.rotation.row(2).as_dvec3()).sum::<DVec3>();
    let wall =
        to_cameras.try_normalize().and_then(|to_cameras| wall_normal(scene, evidence, to_cameras));
    std::iter::once(up).chain(wall).collect()
}

/// The object in a ball, and the surface that it stands on.
struct StandingObject {
    frame: BallFrame,
    pieces: Vec<GroundTriangle>,
    support: Option<Support>,
    object: Vec<GroundTriangle>,
    outline: Outline,
}

impl StandingObject {
    fn new(scene: &Scene, areas: &[f32], frame: BallFrame) -> Option<Self> {
        let inner = (0..scene.triangle_count()).filter(|i| !scene.is_shell(*i)).zip(areas);
        let pieces: Vec<GroundTriangle> =
            inner.filter_map(|(i, area)| frame.piece(i, scene.corners(i), *area)).collect();
        let support = support(&pieces);
        let is_level = |piece: &GroundTriangle| support.is_some_and(|support| support.holds(piece));
        let stands = |piece: &&GroundTriangle| piece.longest() < MAX_EDGE && !is_level(piece);
        let standing: Vec<GroundTriangle> = pieces.iter().filter(stands).copied().collect();
        let object = object(&standing)?;
        let outline = Outline::new(&object)?;
        Some(Self { frame, pieces, support, object, outline })
    }

    /// The area that is seen in its reach.
    fn sees(&self) -> f32 {
        self.pieces.iter().map(|piece| piece.seen).sum()
    }

    /// All that is in the ball.
    fn cut(mut self) -> Self {
        self.object =
            self.pieces.iter().filter(|piece| piece.middle.length() < 1.0).copied().collect();
        self.outline = Outline::disc(1.0);
        self.support = Some(Support {
            height: -1.0,
            low: -1.0 - LAYER_THICKNESS,
            high: LAYER_THICKNESS - 1.0,
        });
        self
    }

    /// True if it ends within the ball, and is no mere part of the thing in the middle.
    fn is_whole(&self) -> bool {
        let outline = &self.outline;
        let ends = outline.far() < MAX_RADIUS * REACH && outline.top < MAX_HEIGHT * REACH;
        ends && outline.radius() > MIN_RADIUS && outline.is_central()
    }
}

/// The layer with most area, if it has enough.
fn support(pieces: &[GroundTriangle]) -> Option<Support> {
    let within = pieces.iter().filter(|piece| piece.longest() < MAX_EDGE);
    let mut heights: Vec<(f32, f32)> = within.map(|piece| (piece.middle.z, piece.seen)).collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f32 = heights.iter().map(|one| one.1).sum();
    let mut end = 0;
    let mut area = 0.0;
    let mut moment = 0.0;
    let mut layers = Vec::new();
    for (first, weight) in &heights {
        while end < heights.len() && heights[end].0 <= first + LAYER_THICKNESS {
            area += heights[end].1;
            moment += heights[end].0 * heights[end].1;
            end += 1;
        }
        if moment / area < MAX_SUPPORT_HEIGHT {
            layers.push((area, moment / area));
        }
        area -= weight;
        moment -= first * weight;
    }
    let largest = layers.iter().map(|layer| layer.0).fold(0.0, f32::max);
    // Cloth has folds: of a board on it, more may be in one layer.
    let first = layers.iter().find(|layer| layer.0 >= MIN_LAYER_SHARE * largest)?;
    let near =
        layers.iter().filter(|layer| (first.1..first.1 + LAYER_THICKNESS).contains(&layer.1));
    let (area, height) = near.copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let between = |low: f32, high: f32| {
        let at = |height: f32| heights.partition_point(|one| one.0 < height);
        heights[at(low)..at(high)].iter().map(|one| one.1).sum::<f32>()
    };
    // Half a layer is on either side of its middle.
    let is_thick = |at: f32| {
        between(height + at - LAYER_THICKNESS / 2.0, height + at + LAYER_THICKNESS / 2.0)
            > MIN_EDGE_SHARE * area
    };
    let end = |way: f32| {
        let layers = (1..MAX_LAYERS).map(|i| way * i as f32 * LAYER_THICKNESS);
        layers.take_while(|at| is_thick(*at)).last().unwrap_or(0.0) + way * LAYER_THICKNESS
    };
    (area > MIN_SUPPORT_AREA * all).then(|| Support {
        height,
        low: height + end(-1.0),
        high: height + end(1.0),
    })
}

/// The connected part around the middle, and others that are large.
fn object(standing: &[GroundTriangle]) -> Option<Vec<GroundTriangle>> {
    let cell = |at: Vec3| (at * CELLS_PER_RADIUS).floor().as_ivec3();
    let mut numbers: HashMap<IVec3, u32> = HashMap::new();
    let mut cells: Vec<IVec3> = Vec::new();
    for at in standing.iter().flat_map(GroundTriangle::places) {
        numbers.entry(cell(at)).or_insert_with(|| {
            cells.push(cell(at));
            cells.len() as u32 - 1
        });
    }
    let mut sets = Sets::new(cells.len());
    for piece in standing {
        for at in piece.places() {
            sets.join(numbers[&cell(piece.middle)], numbers[&cell(at)]);
        }
    }
    for (number, at) in cells.iter().enumerate() {
        for beside in 0..27 {
            let step = IVec3::new(beside % 3, beside / 3 % 3, beside / 9) - 1;
            if let Some(other) = numbers.get(&(*at + step)) {
                sets.join(number as u32, *other);
            }
        }
    }
    // Visible area of each part, and of the part of it around the middle.
    let mut areas = vec![(0.0f32, 0.0f32); cells.len()];
    let part: Vec<usize> =
        standing.iter().map(|piece| sets.first(numbers[&cell(piece.middle)]) as usize).collect();
    for (piece, part) in standing.iter().zip(&part) {
        areas[*part].0 += piece.seen;
        areas[*part].1 += if piece.middle.length() < CORE_RADIUS { piece.seen } else { 0.0 };
    }
    let main =
        (0..areas.len()).max_by(|a, b| areas[*a].1.total_cmp(&areas[*b].1).then(b.cmp(a)))?;
    let largest = areas[main].0;
    let belongs = |part: usize| part == main || areas[part].1 > MIN_PART_AREA * largest;
    Some(
        standing
            .iter()
            .zip(&part)
            .filter(|(_, part)| belongs(**part))
            .map(|(piece, _)| *piece)
            .collect(),
    )
}
