//! The object that cameras look at together, with what it stands on near it.
//!
//! Around the subject's ball, the height with most area is its support, such as a table. What is connected above it around the middle is the
//! object; what is beside, behind and below is left out, except the support within a hand's breadth, cut along an ellipse where it is whole.

use crate::place::ground::Foreground;
use crate::place::up::{Confidence, Evidence, estimate};
use glam::{DVec3, IVec3, Vec2, Vec3};
use std::collections::HashMap;
use trisplat_raster::framing::Subject;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::{Sets, median};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Scene, UpAxis};

/// What is farther from the middle than this many radii of the subject's ball is not looked at.
const REACH: f32 = 1.6;
/// Longest side of a triangle that is looked at, in radii: larger ones are walls.
const LONGEST: f32 = 1.0;
/// Thickness of the support, in radii.
const LAYER: f32 = 0.06;
/// The support is below this height above the middle, in radii ...
const SUPPORT_BELOW: f32 = 0.3;
/// ... and has at least this share of the area.
const LEAST_SUPPORT: f32 = 0.07;
/// Cells by which connected parts are found, per radius.
const CELLS: f32 = 14.0;
/// Longest side of a triangle that is in the cells of its corners too, in radii: longer ones reach from one thing to another.
const JOINED: f32 = 0.3;
/// The object is the part with most area within this many radii of the middle.
const CORE: f32 = 0.6;
/// Parts with less than this share of the object's area are crumbs.
const CRUMB: f32 = 0.05;
/// A hand's breadth, in half axes of the object.
const HAND: f32 = 0.15;
/// Share of the object within its half axes: some triangles lie astray.
const WITHIN: f32 = 0.98;

/// A triangle, in heights and places on the ground around the middle of the subject's ball, whose radius is 1.
#[derive(Clone, Copy)]
struct Piece {
    number: usize,
    corners: [Vec3; 3],
    middle: Vec3,
    area: f32,
}

impl Piece {
    /// Places that it connects: its middle and, unless it is long, its corners.
    fn places(&self) -> impl Iterator<Item = Vec3> + use<> {
        let [a, b, c] = self.corners;
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let corners = if longest < JOINED { 3 } else { 0 };
        std::iter::once(self.middle).chain(self.corners.into_iter().take(corners))
    }
}

/// Sides of the polygon that stands for the outline where triangles are cut.
const SIDES: usize = 64;

/// The space that the subject and its support take.
pub(crate) struct SubjectVolume {
    frame: Frame,
    outline: Outline,
    /// Height of the support, if it stands on one.
    support: Option<f32>,
    /// Where the support of the scene ends, as a share of the outline.
    edge: f32,
}

/// Rings that tell how much of the support was seen.
const RINGS: usize = 20;
/// A ring is whole when this share of it is covered.
const WHOLE: f32 = 0.95;
/// Least share of the outline up to which the rings of a soup must be whole: less of a support looks like crumbs.
const LEAST_WHOLE: f32 = 0.5;
/// Number of cells along the radius of the ground disc.
const CELLS_OF_SUPPORT: usize = 40;

impl SubjectVolume {
    /// Its radius as a share of the median distance of `cameras` from its middle.
    pub(super) fn share(&self, cameras: &[Camera]) -> Option<f64> {
        let (ball, outline) = (self.frame.ball, &self.outline);
        let center = ball.center + ball.radius * self.frame.out(outline.center.extend(0.0));
        let away = median(cameras.iter().map(|c| c.position().distance(center)).collect(), f32::total_cmp)?;
        Some(f64::from(ball.radius * outline.half.max_element() / away))
    }

    /// Which faces of a surface are within it, `corners` of the i-th; the support ends at its last whole ring. `[F]`
    pub(crate) fn faces(&self, count: usize, corners: impl Fn(usize) -> [Vec3; 3]) -> Vec<bool> {
        let within = |face: usize| {
            let piece = self.frame.piece(face, corners(face))?;
            let above = piece.corners.iter().all(|corner| corner.z > self.low());
            (above && self.outline.holds(&piece)).then_some(piece)
        };
        let pieces: Vec<Piece> = (0..count).filter_map(within).collect();
        let level = pieces.iter().filter(|piece| self.is_level(piece));
        let last = self.whole_rings(level).iter().rposition(|is_whole| *is_whole);
        let edge = last.map_or(1.0, |ring| (ring + 1) as f32 / RINGS as f32);
        let mut keep = vec![false; count];
        let stays = |piece: &&Piece| !self.is_level(piece) || self.outline.farthest(piece) <= edge;
        pieces.iter().filter(stays).for_each(|piece| keep[piece.number] = true);
        keep
    }

    /// The parts of a triangle that are within it: cut where it reaches over the edge, none where all of it is outside.
    pub(super) fn parts(&self, corners: [Vec3; 3]) -> Vec<[Vec3; 3]> {
        let Some(piece) = self.frame.piece(0, corners) else { return Vec::new() };
        let edge = if self.is_level(&piece) { self.edge } else { 1.0 };
        // Without a support the thing ends where it stood: what reached into the support would hang below it.
        let kept = self.edge > 0.0;
        let low = self.support.filter(|_| !kept).unwrap_or_else(|| self.low());
        if piece.corners.into_iter().all(|corner| corner.z >= low && self.outline.has(corner, edge)) {
            return vec![corners];
        }
        let heights: [&dyn Fn(Vec3) -> f32; 2] = [&|at| at.z - low, &|at| self.outline.top - at.z];
        let mut inside = heights.into_iter().fold(corners.to_vec(), |polygon, inside| {
            beyond(&polygon, |corner| inside(self.frame.within(corner)))
        });
        let apothem = edge * libm::cosf(std::f32::consts::PI / SIDES as f32);
        for side in 0..SIDES {
            let turn = std::f32::consts::TAU * side as f32 / SIDES as f32;
            let out = Vec2::new(libm::cosf(turn), libm::sinf(turn));
            let within = |corner| apothem - self.outline.place(self.frame.within(corner)).dot(out);
            inside = beyond(&inside, within);
        }
        (2..inside.len()).map(|i| [inside[0], inside[i - 1], inside[i]]).collect()
    }

    /// The height below which nothing is kept.
    fn low(&self) -> f32 {
        self.support.map_or(f32::NEG_INFINITY, |height| height - LAYER)
    }

    fn is_level(&self, piece: &Piece) -> bool {
        self.support.is_some_and(|height| piece.middle.z < height + LAYER)
    }

    /// Which rings around the middle `pieces` cover.
    fn whole_rings<'a>(&self, pieces: impl Iterator<Item = &'a Piece>) -> [bool; RINGS] {
        let side = 2 * CELLS_OF_SUPPORT;
        let cell = |along: f32| ((along + 1.0) * CELLS_OF_SUPPORT as f32).floor() as i32;
        let mut there = vec![false; side * side];
        for piece in pieces {
            for at in spread(piece.corners.map(|corner| self.outline.place(corner))) {
                let (x, y) = (cell(at.x), cell(at.y));
                if (0..side as i32).contains(&x) && (0..side as i32).contains(&y) {
                    there[y as usize * side + x as usize] = true;
                }
            }
        }
        let (mut seen, mut all) = ([0u32; RINGS], [0u32; RINGS]);
        for (number, is_there) in there.iter().enumerate() {
            let at = Vec2::new((number % side) as f32, (number / side) as f32) + 0.5;
            let ring = ((at / CELLS_OF_SUPPORT as f32 - 1.0).length() * RINGS as f32) as usize;
            if ring < RINGS {
                all[ring] += 1;
                seen[ring] += u32::from(*is_there);
            }
        }
        std::array::from_fn(|ring| seen[ring] as f32 >= WHOLE * all[ring] as f32)
    }
}

/// The part of a convex polygon where the affine function `inside` is not negative.
fn beyond(polygon: &[Vec3], inside: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, here) in polygon.iter().enumerate() {
        let next = polygon[(i + 1) % polygon.len()];
        let (a, b) = (inside(*here), inside(next));
        if a >= 0.0 {
            kept.push(*here);
        }
        if (a < 0.0) != (b < 0.0) {
            kept.push(here.lerp(next, a / (a - b)));
        }
    }
    kept
}

/// Places on a triangle, less than a cell of the support apart.
fn spread([a, b, c]: [Vec2; 3]) -> impl Iterator<Item = Vec2> {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let steps = (longest * CELLS_OF_SUPPORT as f32 * 1.5).ceil().max(1.0) as usize;
    let at = move |i: usize, k: usize| a + ((b - a) * i as f32 + (c - a) * k as f32) / steps as f32;
    (0..=steps).flat_map(move |i| (0..=steps - i).map(move |k| at(i, k)))
}

/// Which triangles of `scene` are the subject, and the space they take; `None` when nothing stands out. `up` is that of its file, if it
/// names one.
pub(super) fn subject(
    scene: &Scene,
    cameras: &[Camera],
    up: Option<UpAxis>,
) -> Option<(Vec<bool>, SubjectVolume)> {
    let count = scene.triangle_count();
    let middle = |i: usize| scene.corners(i).into_iter().sum::<Vec3>() / 3.0;
    let middles: Vec<Vec3> = (0..count).filter(|i| !scene.is_shell(*i)).map(middle).collect();
    let ball = Subject::of(&middles, cameras)?;
    let frame = Frame::new(ball, upward(scene, cameras, up));
    let pieces: Vec<Piece> =
        (0..count).filter(|i| !scene.is_shell(*i)).filter_map(|i| frame.piece(i, scene.corners(i))).collect();
    let support = support(&pieces);
    let above = |piece: &&Piece| support.is_none_or(|height| piece.middle.z > height + LAYER);
    let standing: Vec<Piece> = pieces.iter().filter(above).copied().collect();
    let object = object(&standing)?;
    let outline = Outline::new(&object)?;
    let mut volume = SubjectVolume { frame, outline, support, edge: 1.0 };
    // The object, and the support around it: what else is within floats.
    let level = || pieces.iter().filter(|piece| volume.is_level(piece) && piece.middle.z >= volume.low());
    let both = || object.iter().chain(level());
    let mut belongs = vec![false; count];
    both().for_each(|piece| belongs[piece.number] = true);
    // A trained support has holes far from the middle, where fewer photos look.
    let rings = volume.whole_rings(both()).iter().take_while(|is_whole| **is_whole).count();
    let edge = rings as f32 / RINGS as f32;
    volume.edge = if edge < LEAST_WHOLE { 0.0 } else { edge };
    let within = |i: usize| match scene {
        // What a soup's triangles have beyond the edge is cut off.
        Scene::Soup(_) => !volume.parts(scene.corners(i)).is_empty(),
        Scene::Mesh(_) => volume.parts(scene.corners(i)) == [scene.corners(i)],
    };
    let keep = parallel::collect(count, GRAIN, |i| belongs[i] && within(i));
    Some((keep, volume))
}

/// The direction that points up.
fn upward(scene: &Scene, cameras: &[Camera], known: Option<UpAxis>) -> DVec3 {
    if known == Some(UpAxis::Y) {
        return DVec3::Y;
    }
    let corners = (0..scene.triangle_count()).filter(|i| !scene.is_shell(*i)).flat_map(|i| scene.corners(i));
    let mesh = Mesh { positions: corners.collect(), ..Mesh::default() };
    let estimate = estimate(Foreground::new(&mesh, 0), Evidence { cameras, points: &[] });
    let usable = estimate.filter(|estimate| estimate.confidence != Confidence::None);
    usable.map_or(known.unwrap_or_default().vector(), |estimate| DVec3::from(estimate.direction))
}

/// Coordinates in which the subject's ball is that of radius 1 around the origin, and z is up.
struct Frame {
    ball: Subject,
    axes: [Vec3; 3],
}

impl Frame {
    fn new(ball: Subject, up: DVec3) -> Self {
        let up = up.as_vec3().normalize_or(Vec3::Y);
        let along = up.any_orthonormal_vector();
        Self { ball, axes: [along, up.cross(along), up] }
    }

    /// A place in these coordinates.
    fn within(&self, at: Vec3) -> Vec3 {
        Vec3::from(self.axes.map(|axis| axis.dot(at - self.ball.center))) / self.ball.radius
    }

    /// An offset in these coordinates as one in the scene's.
    fn out(&self, offset: Vec3) -> Vec3 {
        (0..3).map(|axis| self.axes[axis] * offset[axis]).sum()
    }

    /// A triangle that is near enough and not too large.
    fn piece(&self, number: usize, corners: [Vec3; 3]) -> Option<Piece> {
        let corners = corners.map(|corner| self.within(corner));
        let [a, b, c] = corners;
        let middle = (a + b + c) / 3.0;
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let area = (b - a).cross(c - a).length() / 2.0;
        let near = middle.truncate().length() < REACH && middle.z.abs() < REACH && longest < LONGEST;
        near.then_some(Piece { number, corners, middle, area })
    }
}

/// The height of the layer with most area, if it has enough.
fn support(pieces: &[Piece]) -> Option<f32> {
    let mut heights: Vec<(f32, f32)> = pieces.iter().map(|piece| (piece.middle.z, piece.area)).collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f32 = heights.iter().map(|one| one.1).sum();
    let (mut end, mut area, mut moment) = (0, 0.0, 0.0);
    let mut best = (0.0, 0.0);
    for (first, weight) in &heights {
        while end < heights.len() && heights[end].0 <= first + LAYER {
            area += heights[end].1;
            moment += heights[end].0 * heights[end].1;
            end += 1;
        }
        if area > best.0 && moment / area < SUPPORT_BELOW {
            best = (area, moment / area);
        }
        area -= weight;
        moment -= first * weight;
    }
    (best.0 > LEAST_SUPPORT * all).then_some(best.1)
}

/// The connected part around the middle, and others that are large.
fn object(standing: &[Piece]) -> Option<Vec<Piece>> {
    let cell = |at: Vec3| (at * CELLS).floor().as_ivec3();
    let mut numbers: HashMap<IVec3, u32> = HashMap::new();
    let mut cells: Vec<IVec3> = Vec::new();
    for at in standing.iter().flat_map(Piece::places) {
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
    // Area of each part, and how much of it is around the middle.
    let mut areas = vec![(0.0f32, 0.0f32); cells.len()];
    let part: Vec<usize> =
        standing.iter().map(|piece| sets.first(numbers[&cell(piece.middle)]) as usize).collect();
    for (piece, part) in standing.iter().zip(&part) {
        areas[*part].0 += piece.area;
        areas[*part].1 += if piece.middle.length() < CORE { piece.area } else { 0.0 };
    }
    let main = (0..areas.len()).max_by(|a, b| areas[*a].1.total_cmp(&areas[*b].1).then(b.cmp(a)))?;
    let largest = areas[main].0;
    let belongs = |part: usize| part == main || areas[part].1 > CRUMB * largest;
    Some(standing.iter().zip(&part).filter(|(_, part)| belongs(**part)).map(|(piece, _)| *piece).collect())
}

/// An ellipse on the ground around an object and a hand's breadth, up to its top.
struct Outline {
    center: Vec2,
    axes: [Vec2; 2],
    half: Vec2,
    top: f32,
}

impl Outline {
    /// `None` of nothing.
    fn new(object: &[Piece]) -> Option<Self> {
        let area: f32 = object.iter().map(|piece| piece.area).sum();
        let ground = |piece: &Piece| piece.middle.truncate();
        let center = object.iter().map(|piece| ground(piece) * piece.area).sum::<Vec2>() / area;
        if !center.is_finite() {
            return None;
        }
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for piece in object {
            let d = ground(piece) - center;
            (xx, xy, yy) =
                (xx + piece.area * d.x * d.x, xy + piece.area * d.x * d.y, yy + piece.area * d.y * d.y);
        }
        let turn = 0.5 * libm::atan2f(2.0 * xy, xx - yy);
        let along = Vec2::new(libm::cosf(turn), libm::sinf(turn));
        let axes = [along, along.perp()];
        let quantile = |value: &dyn Fn(&Piece) -> f32| {
            let mut values: Vec<f32> = object.iter().map(value).collect();
            let at = ((values.len() as f32 * WITHIN) as usize).min(values.len() - 1);
            *values.select_nth_unstable_by(at, f32::total_cmp).1
        };
        let half = axes.map(|axis| quantile(&|piece| (ground(piece) - center).dot(axis).abs()).max(1e-3));
        let half = Vec2::from(half);
        let away =
            |piece: &Piece| (Vec2::from(axes.map(|axis| (ground(piece) - center).dot(axis))) / half).length();
        let half = half * quantile(&away);
        let hand = HAND * half.max_element();
        Some(Self { center, axes, half: half + hand, top: quantile(&|piece| piece.middle.z) + hand })
    }

    /// A place on the ground, in half axes.
    fn place(&self, corner: Vec3) -> Vec2 {
        let at = corner.truncate() - self.center;
        Vec2::from(self.axes.map(|axis| at.dot(axis))) / self.half
    }

    /// How far out a triangle reaches, in half axes.
    fn farthest(&self, piece: &Piece) -> f32 {
        piece.corners.iter().map(|corner| self.place(*corner).length()).fold(0.0, f32::max)
    }

    /// Whether a corner is below its top and within a share of its half axes.
    fn has(&self, corner: Vec3, share: f32) -> bool {
        self.place(corner).length_squared() <= share * share && corner.z <= self.top
    }

    /// Whether a triangle is within it.
    fn holds(&self, piece: &Piece) -> bool {
        piece.corners.iter().all(|corner| self.has(*corner, 1.0))
    }
}
