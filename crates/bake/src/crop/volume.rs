//! The volume of a subject and its support, and the triangles in it.

use glam::{DVec3, Vec2, Vec3};
use trisplat_raster::framing::Subject;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::math::lists::median;

/// Maximum distance of triangles from the middle, in radii of the subject's ball.
pub(super) const REACH: f32 = 1.6;
/// Longest side of a triangle that is in the cells of its corners too, in radii: longer ones reach
/// from one thing to another.
const MAX_JOINED_EDGE: f32 = 0.5;
/// Margin kept around the object, in object radii.
const MARGIN: f32 = 0.12;
/// Share of the object inside each side of its outline: some triangles lie astray.
const INSIDE_SHARE: f32 = 0.99;

/// A triangle, in heights and places on the ground around the middle of the subject's ball, whose
/// radius is 1.
#[derive(Clone, Copy)]
pub(super) struct GroundTriangle {
    pub(super) number: usize,
    pub(super) corners: [Vec3; 3],
    pub(super) middle: Vec3,
    area: f32,
    /// Area that cameras see.
    pub(super) seen: f32,
}

impl GroundTriangle {
    /// Its longest side.
    pub(super) fn longest(&self) -> f32 {
        let [a, b, c] = self.corners;
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    }

    /// Places that it connects: its middle and, unless it is long, its corners.
    pub(super) fn places(&self) -> impl Iterator<Item = Vec3> + use<> {
        let corners = if self.longest() < MAX_JOINED_EDGE { 3 } else { 0 };
        std::iter::once(self.middle).chain(self.corners.into_iter().take(corners))
    }
}

/// Sides of an outline.
const SIDES: usize = 32;

/// The surface that a subject stands on, or hangs from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Support {
    pub(super) height: f32,
    /// Lowest height: trained walls are rough, and cloth has folds.
    pub(super) low: f32,
    /// Highest height.
    pub(super) high: f32,
}

/// The space that the subject and its support take.
pub(crate) struct SubjectVolume {
    pub(super) frame: BallFrame,
    pub(super) outline: Outline,
    pub(super) support: Option<Support>,
    /// Radius at which the support of the scene ends, as a share of the outline.
    pub(super) edge: f32,
}

impl Support {
    pub(super) fn holds(&self, piece: &GroundTriangle) -> bool {
        piece.middle.z < self.high
    }
}

/// Number of rings for the coverage of the support.
const RINGS: usize = 20;
/// A ring is whole when this share of it is covered.
const WHOLE_RING_SHARE: f32 = 0.95;
/// Minimum covered share of a soup's support out to its edge.
const MIN_SUPPORT_SHARE: f32 = 0.75;
/// Minimum distance of that edge, as a share of the outline: smaller supports look like crumbs and
/// are left out.
const MIN_EDGE_DISTANCE: f32 = 0.5;
/// Number of cells along the radius of the ground disc.
const CELLS_OF_SUPPORT: usize = 40;

impl SubjectVolume {
    /// Its radius as a share of the median distance of `cameras` from its middle.
    pub(super) fn relative_radius(&self, cameras: &[Camera]) -> Option<f64> {
        let ball = self.frame.ball;
        let outline = &self.outline;
        let center = ball.center + ball.radius * self.frame.out(outline.center.extend(0.0));
        let away = median(
            cameras.iter().map(|c| c.position().distance(center)).collect(),
            f32::total_cmp,
        )?;
        Some(f64::from(ball.radius * outline.radius() / away))
    }

    /// True for the faces of a surface inside the volume, `corners` of the i-th; the support ends
    /// at its last whole ring. `[F]`
    pub(crate) fn faces(&self, count: usize, corners: impl Fn(usize) -> [Vec3; 3]) -> Vec<bool> {
        let within = |face: usize| {
            let piece = self.frame.piece(face, corners(face), 0.0)?;
            let above = piece.corners.iter().all(|corner| corner.z > self.low());
            (above && self.outline.holds(&piece)).then_some(piece)
        };
        let pieces: Vec<GroundTriangle> = (0..count).filter_map(within).collect();
        let level = pieces.iter().filter(|piece| self.is_level(piece));
        let last =
            self.rings(level).iter().rposition(|[there, all]| *there >= WHOLE_RING_SHARE * all);
        let edge = last.map_or(1.0, |ring| (ring + 1) as f32 / RINGS as f32);
        let mut keep = vec![false; count];
        let stays =
            |piece: &&GroundTriangle| !self.is_level(piece) || self.outline.farthest(piece) <= edge;
        for piece in pieces.iter().filter(stays) {
            keep[piece.number] = true;
        }
        keep
    }

    /// The parts of a triangle inside the volume: cut where it reaches over the edge, none where
    /// all of it is outside.
    pub(super) fn parts(&self, corners: [Vec3; 3]) -> Vec<[Vec3; 3]> {
        let Some(piece) = self.frame.piece(0, corners, 0.0) else { return Vec::new() };
        let edge = if self.is_level(&piece) { self.edge } else { 1.0 };
        // Without a support the thing ends where it stood: what reached into the support would hang
        // below it.
        let kept = self.edge > 0.0;
        let low =
            self.support.filter(|_| !kept).map_or_else(|| self.low(), |support| support.height);
        if piece.corners.into_iter().all(|corner| corner.z >= low && self.outline.has(corner, edge))
        {
            return vec![corners];
        }
        let heights: [&dyn Fn(Vec3) -> f32; 2] = [&|at| at.z - low, &|at| self.outline.top - at.z];
        let mut inside = heights.into_iter().fold(corners.to_vec(), |polygon, inside| {
            beyond(&polygon, |corner| inside(self.frame.within(corner)))
        });
        for side in &self.outline.sides {
            let within = |corner| self.outline.inside(self.frame.within(corner), *side, edge);
            inside = beyond(&inside, within);
        }
        (2..inside.len()).map(|i| [inside[0], inside[i - 1], inside[i]]).collect()
    }

    /// The height below which nothing is kept.
    pub(super) fn low(&self) -> f32 {
        self.support.map_or(f32::NEG_INFINITY, |support| support.low)
    }

    pub(super) fn is_level(&self, piece: &GroundTriangle) -> bool {
        self.support.is_some_and(|support| support.holds(piece))
    }

    /// Radius, as a share of the outline, within which `pieces` cover most of the ground; 0 if it
    /// is small.
    pub(super) fn edge_of<'a>(&self, pieces: impl Iterator<Item = &'a GroundTriangle>) -> f32 {
        let mut sums = [0.0, 0.0];
        let is_there = self.rings(pieces).map(|ring| {
            sums = [0, 1].map(|i| sums[i] + ring[i]);
            sums[0] >= MIN_SUPPORT_SHARE * sums[1]
        });
        let edge = is_there
            .iter()
            .rposition(|is| *is)
            .map_or(0.0, |ring| (ring + 1) as f32 / RINGS as f32);
        if edge < MIN_EDGE_DISTANCE { 0.0 } else { edge }
    }

    /// Cells of each ring around the middle that `pieces` cover, and all cells of the ring.
    fn rings<'a>(&self, pieces: impl Iterator<Item = &'a GroundTriangle>) -> [[f32; 2]; RINGS] {
        let side = 2 * CELLS_OF_SUPPORT;
        let cell = |along: f32| ((along + 1.0) * CELLS_OF_SUPPORT as f32).floor() as i32;
        let mut there = vec![false; side * side];
        for piece in pieces {
            for at in spread(piece.corners.map(|corner| self.outline.place(corner))) {
                let x = cell(at.x);
                let y = cell(at.y);
                if (0..side as i32).contains(&x) && (0..side as i32).contains(&y) {
                    there[y as usize * side + x as usize] = true;
                }
            }
        }
        let mut rings = [[0.0; 2]; RINGS];
        for (number, is_there) in there.iter().enumerate() {
            let at = Vec2::new((number % side) as f32, (number / side) as f32) + 0.5;
            let ring = ((at / CELLS_OF_SUPPORT as f32 - 1.0).length() * RINGS as f32) as usize;
            if ring < RINGS {
                rings[ring][0] += f32::from(u8::from(*is_there));
                rings[ring][1] += 1.0;
            }
        }
        rings
    }
}

/// The part of a convex polygon where the affine function `inside` is not negative.
fn beyond(polygon: &[Vec3], inside: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, here) in polygon.iter().enumerate() {
        let next = polygon[(i + 1) % polygon.len()];
        let a = inside(*here);
        let b = inside(next);
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

/// Coordinates in which the subject's ball is that of radius 1 around the origin, and z is up.
pub(super) struct BallFrame {
    ball: Subject,
    axes: [Vec3; 3],
}

impl BallFrame {
    pub(super) fn new(ball: Subject, up: DVec3) -> Self {
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

    /// A triangle that is near enough.
    pub(super) fn piece(
        &self,
        number: usize,
        corners: [Vec3; 3],
        seen: f32,
    ) -> Option<GroundTriangle> {
        let corners = corners.map(|corner| self.within(corner));
        let [a, b, c] = corners;
        let middle = centroid(corners);
        let area = (b - a).cross(c - a).length() / 2.0;
        let near = middle.truncate().length() < REACH && middle.z.abs() < REACH;
        near.then_some(GroundTriangle { number, corners, middle, area, seen })
    }
}

/// A polygon on the ground around an object and a hand's breadth, up to its top: a hull, as a
/// circle would leave viewers that frame the file less of the object.
pub(super) struct Outline {
    center: Vec2,
    /// The directions of its sides, and how far from the center they are.
    sides: [(Vec2, f32); SIDES],
    pub(super) top: f32,
}

impl Outline {
    /// `None` of nothing.
    pub(super) fn new(object: &[GroundTriangle]) -> Option<Self> {
        let area: f32 = object.iter().map(|piece| piece.area).sum();
        let ground = |piece: &GroundTriangle| piece.middle.truncate();
        let center = object.iter().map(|piece| ground(piece) * piece.area).sum::<Vec2>() / area;
        if !center.is_finite() {
            return None;
        }
        let mut values = vec![0.0; object.len()];
        let mut quantile = |value: &dyn Fn(&GroundTriangle) -> f32| {
            for (slot, piece) in values.iter_mut().zip(object) {
                *slot = value(piece);
            }
            let at = ((values.len() as f32 * INSIDE_SHARE) as usize).min(values.len() - 1);
            *values.select_nth_unstable_by(at, f32::total_cmp).1
        };
        let mut outline = Self::disc(1e-3);
        for (out, reach) in &mut outline.sides {
            *reach = reach.max(quantile(&|piece| (ground(piece) - center).dot(*out)));
        }
        let margin = MARGIN * outline.radius();
        let top = quantile(&|piece| piece.middle.z);
        for (_, reach) in &mut outline.sides {
            *reach += margin;
        }
        Some(Self { center, top: top + margin, ..outline })
    }

    /// One around the middle, as high as it is wide.
    pub(super) fn disc(radius: f32) -> Self {
        let side = |i: usize| {
            let turn = std::f32::consts::TAU * i as f32 / SIDES as f32;
            (Vec2::new(libm::cosf(turn), libm::sinf(turn)), radius)
        };
        Self { center: Vec2::ZERO, sides: std::array::from_fn(side), top: radius }
    }

    /// Radius around its center.
    pub(super) fn radius(&self) -> f32 {
        self.sides.iter().map(|side| side.1).fold(0.0, f32::max)
    }

    /// Radius around the middle of the ball.
    pub(super) fn far(&self) -> f32 {
        self.center.length() + self.radius()
    }

    /// True if the middle of the ball is within its radius.
    pub(super) fn is_central(&self) -> bool {
        self.center.length() < self.radius()
    }

    /// Distance of a corner inside a side, at a share of the outline.
    fn inside(&self, corner: Vec3, (out, reach): (Vec2, f32), share: f32) -> f32 {
        share * reach - (corner.truncate() - self.center).dot(out)
    }

    /// A place on the ground, 1 from the middle at the outline.
    fn place(&self, corner: Vec3) -> Vec2 {
        let at = corner.truncate() - self.center;
        let share = self.sides.iter().map(|(out, reach)| at.dot(*out) / reach).fold(0.0, f32::max);
        at.normalize_or_zero() * share
    }

    /// Largest radius of a triangle, as a share of the outline.
    fn farthest(&self, piece: &GroundTriangle) -> f32 {
        piece.corners.iter().map(|corner| self.place(*corner).length()).fold(0.0, f32::max)
    }

    /// True if a corner is below the top and within a share of the outline.
    fn has(&self, corner: Vec3, share: f32) -> bool {
        corner.z <= self.top
            && self.sides.iter().all(|side| self.inside(corner, *side, share) >= 0.0)
    }

    /// True if a triangle is inside the outline.
    fn holds(&self, piece: &GroundTriangle) -> bool {
        piece.corners.iter().all(|corner| self.has(*corner, 1.0))
    }
}
