//! Gaussians on the screen: ellipses with an opacity, a colour and a depth, and the tiles that they
//! touch.

use crate::kernel::sh;
use crate::soft::projected::{DepthKey, by_depth};
use crate::soft::{MARGIN, TILE, tile_count};
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::spread;
use trisplat_scene::math::real::V3;
use trisplat_scene::{Splats, parallel};

/// Largest alpha of a layer.
pub(super) const ALPHA_CAP: f32 = 0.99;
/// Logarithm to base 2 of the smallest alpha that is drawn, 1/255.
pub(super) const LOG2_CUTOFF: f32 = -7.994_353_4;
/// A pixel ends with the layer that brings its transmittance below this.
pub(super) const MIN_TRANSMITTANCE: f32 = 1e-4;
/// The Jacobian of the projection is taken no farther from the axis than this many times half the
/// view.
pub(super) const VIEW_GUARD: f32 = 1.3;

/// Drawing options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Depth from which on the middles of Gaussians are drawn, world units, > 0.
    pub near: f32,
}

/// Depth of the near plane in units of the scene's size, for scenes so small that the usual depth
/// would cut into them.
const NEAR_PER_SIZE: f64 = 0.01;

impl GaussianOptions {
    /// Options for `splats` of any size, over a background, sRGB-encoded.
    pub fn suited_to(splats: &Splats, background: [f32; 3]) -> Self {
        let default_near = Self::default().near;
        let (_, size) = spread(&splats.positions);
        let near = default_near.min((size * NEAR_PER_SIZE) as f32).max(f32::MIN_POSITIVE);
        Self { background, near }
    }
}

impl Default for GaussianOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], near: 0.05 }
    }
}

/// Gaussians that one task projects.
const PER_TASK: usize = 4096;

/// A Gaussian on the screen. At (dx, dy) px from its middle, its alpha is 2 to the power of
/// `level - (along dx + shear dy)² - (down dy)²`: a sum of squares, which stays exact where the
/// coefficients of the inverse covariance cancel, as for long and thin ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ellipse {
    pub(super) middle: Vec2,
    pub(super) along: f32,
    pub(super) shear: f32,
    pub(super) down: f32,
    /// Logarithm of the opacity to base 2.
    pub(super) level: f32,
    pub(super) rgb: [f32; 3],
    /// Depth of the middle, > 0.
    pub(super) depth: f32,
    /// Index of its Gaussian in the scene.
    pub(super) gaussian: u32,
}

impl Ellipse {
    /// Square of the radius, in the units of the squares above, within which it is drawn.
    pub(super) fn reach_squared(&self) -> f32 {
        self.level - LOG2_CUTOFF
    }

    /// Half of its height, px.
    pub(super) fn half_height(&self) -> f32 {
        self.reach_squared().max(0.0).sqrt() / self.down
    }
}

/// Projects the Gaussians of a picture.
struct GaussianProjector<'a> {
    splats: &'a Splats,
    camera: &'a Camera,
    near: f32,
    /// Largest tangents at which the Jacobian is taken.
    guard: Vec2,
}

/// All Gaussians that may be seen, in the order of the scene.
pub(super) fn all(splats: &Splats, camera: &Camera, options: &GaussianOptions) -> Vec<Ellipse> {
    let guard = camera.size.as_vec2() / camera.focal * (0.5 * VIEW_GUARD);
    let projector = GaussianProjector { splats, camera, near: options.near, guard };
    let tasks: Vec<Vec<Ellipse>> =
        parallel::map((0..splats.len()).step_by(PER_TASK), |_, first| {
            let some = first..(first + PER_TASK).min(splats.len());
            some.filter_map(|i| projector.project(i)).collect()
        });
    tasks.concat()
}

/// Indices of the ellipses by depth, nearest first; equal depths in the order of the scene.
pub(super) fn front_to_back(ellipses: &[Ellipse]) -> Vec<u32> {
    let key = |(i, ellipse): (usize, &Ellipse)| DepthKey {
        depth: ellipse.depth.to_bits(),
        index: i as u32,
    };
    let mut keys: Vec<DepthKey> = ellipses.iter().enumerate().map(key).collect();
    by_depth(&mut keys, &mut Vec::new());
    keys.iter().map(|key| key.index).collect()
}

impl GaussianProjector<'_> {
    /// One Gaussian; `None` when it is too near, too faint, or beside the picture.
    fn project(&self, i: usize) -> Option<Ellipse> {
        let splats = self.splats;
        let camera = self.camera;
        let at = camera.rotation * splats.positions[i] + camera.translation;
        if !(at.z >= self.near) {
            return None;
        }
        let tangent = at.truncate() / at.z;
        let [first, second] = self.axes_on_screen(i, tangent, at.z);
        let xx = first.length_squared();
        let yy = second.length_squared();
        let xy = first.dot(second);
        let blur = splats.filter.variance;
        // |a × b|² + blur (a² + b²) + blur²: the determinant without the cancellation of xx yy - xy².
        let sharp = first.cross(second).length_squared();
        let determinant = sharp + blur * (xx + yy) + blur * blur;
        let xx = xx + blur;
        let yy = yy + blur;
        let light_kept = if splats.filter.keeps_light { (sharp / determinant).sqrt() } else { 1.0 };
        let half_log2_e = std::f32::consts::LOG2_E * 0.5;
        let ellipse = Ellipse {
            middle: tangent * camera.focal + camera.center,
            along: (half_log2_e * yy / determinant).sqrt(),
            shear: -xy * (half_log2_e / (yy * determinant)).sqrt(),
            down: (half_log2_e / yy).sqrt(),
            level: (splats.opacity[i] * light_kept).log2(),
            rgb: [0.0; 3],
            depth: at.z,
            gaussian: i as u32,
        };
        let reach = ellipse.reach_squared();
        if !(reach >= 0.0
            && ellipse.along.is_finite()
            && ellipse.shear.is_finite()
            && ellipse.down > 0.0)
        {
            return None;
        }
        let half = Vec2::new((reach * xx / half_log2_e).sqrt(), ellipse.half_height()) + MARGIN;
        let low = ellipse.middle - half;
        let high = ellipse.middle + half;
        let size = camera.size.as_vec2();
        let is_in_picture = high.x >= 0.0 && high.y >= 0.0 && low.x <= size.x && low.y <= size.y;
        is_in_picture.then(|| Ellipse { rgb: self.color(i, at), ..ellipse })
    }

    /// The two rows of J W R S, whose products are the covariance on the screen.
    fn axes_on_screen(&self, i: usize, tangent: Vec2, depth: f32) -> [Vec3; 2] {
        let t = tangent.clamp(-self.guard, self.guard);
        let per_depth = self.camera.focal / depth;
        let jacobian = [
            Vec3::new(per_depth.x, 0.0, -per_depth.x * t.x),
            Vec3::new(0.0, per_depth.y, -per_depth.y * t.y),
        ];
        let own_axes = Mat3::from_quat(self.splats.rotations[i]);
        jacobian.map(|row| {
            let world = self.camera.rotation.transpose() * row;
            own_axes.transpose() * world * self.splats.scales[i]
        })
    }

    /// Its colour towards the camera, not clamped above. `at` is its middle in camera space.
    fn color(&self, i: usize, at: Vec3) -> [f32; 3] {
        let k = self.splats.sh_count();
        let towards = (self.camera.rotation.transpose() * at).normalize_or(Vec3::Z);
        let basis = sh::basis(self.splats.sh_degree, V3::new(towards.x, towards.y, towards.z));
        let mut rgb = Vec3::splat(0.5);
        for (coefficient, basis) in self.splats.sh[i * k..(i + 1) * k].iter().zip(basis) {
            rgb += Vec3::from(*coefficient) * basis;
        }
        rgb.max(Vec3::ZERO).to_array()
    }
}

/// Ellipses that one task bins.
const BINNED_PER_TASK: usize = 8192;
const TILE_PX: f32 = TILE as f32;

/// An ellipse in a row of tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileRun {
    pub(super) ellipse: u32,
    /// First and last tile.
    first: u16,
    last: u16,
}

/// The ellipses of every row of tiles, front to back, in parts that follow each other.
#[derive(Debug)]
pub(super) struct Rows {
    /// `[parts][rows]`
    parts: Vec<Vec<Vec<TileRun>>>,
    pub(super) count: UVec2,
}

/// The ellipses of the tiles of one row, front to back.
#[derive(Debug)]
pub(super) struct RowTiles {
    starts: Vec<u32>,
    ellipses: Vec<u32>,
}

/// Sorts the ellipses into rows; `order` is front to back.
pub(super) fn bin(ellipses: &[Ellipse], order: &[u32], size: UVec2) -> Rows {
    let count = tile_count(size);
    let parts = parallel::map(order.chunks(BINNED_PER_TASK), |_, ranks| {
        let mut rows = vec![Vec::new(); count.y as usize];
        for at in ranks {
            add(&ellipses[*at as usize], *at, size, &mut rows);
        }
        rows
    });
    Rows { parts, count }
}

/// Adds an ellipse to the rows that it touches.
fn add(ellipse: &Ellipse, index: u32, size: UVec2, rows: &mut [Vec<TileRun>]) {
    let half = ellipse.half_height() + MARGIN;
    let top = ellipse.middle.y - half;
    let bottom = ellipse.middle.y + half;
    let Some((first, last)) = tiles_between(top, bottom, size.y) else { return };
    for row in first..=last {
        // The centres of the row's first and last pixels, relative to the middle.
        let from = f32::from(row) * TILE_PX + 0.5 - ellipse.middle.y;
        let Some((left, right)) = extent(ellipse, from, from + TILE_PX - 1.0) else { continue };
        let left = ellipse.middle.x + left - MARGIN;
        let right = ellipse.middle.x + right + MARGIN;
        if let Some((first, last)) = tiles_between(left, right, size.x) {
            rows[usize::from(row)].push(TileRun { ellipse: index, first, last });
        }
    }
}

/// Left and right end of the part of an ellipse between two heights, from its middle, px.
fn extent(ellipse: &Ellipse, from: f32, to: f32) -> Option<(f32, f32)> {
    let Ellipse { along, shear, down, .. } = *ellipse;
    let reach = ellipse.reach_squared();
    let half = ellipse.half_height();
    let from = from.max(-half);
    let to = to.min(half);
    if from > to + MARGIN {
        return None;
    }
    // The right end of a line is (√(reach - (down dy)²) - shear dy) / along, concave in dy and
    // largest here.
    let widest = -half * shear / (shear * shear + down * down).sqrt();
    let end = |dy: f32| {
        let dy = dy.min(to).max(from);
        let width = (reach - (down * dy) * (down * dy)).max(0.0).sqrt();
        ((-width - shear * dy) / along, (width - shear * dy) / along)
    };
    Some((end(-widest).0, end(widest).1))
}

/// First and last tile with a pixel centre in [low, high].
fn tiles_between(low: f32, high: f32, size: u32) -> Option<(u16, u16)> {
    let first = (low - 0.5).ceil().max(0.0);
    let last = (high - 0.5).floor().min(size as f32 - 1.0);
    (first <= last).then(|| ((first / TILE_PX) as u16, (last / TILE_PX) as u16))
}

impl Rows {
    /// The ellipses of the tiles of row `row`.
    pub(super) fn tiles(&self, row: usize) -> RowTiles {
        let runs = || self.parts.iter().flat_map(|part| &part[row]);
        let mut starts = vec![0u32; self.count.x as usize + 1];
        for run in runs() {
            for count in &mut starts[usize::from(run.first)..=usize::from(run.last)] {
                *count += 1;
            }
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        let mut next = starts.clone();
        let mut ellipses = vec![0; sum as usize];
        for run in runs() {
            for place in &mut next[usize::from(run.first)..=usize::from(run.last)] {
                ellipses[*place as usize] = run.ellipse;
                *place += 1;
            }
        }
        RowTiles { starts, ellipses }
    }
}

impl RowTiles {
    /// The ellipses of a tile, front to back.
    pub(super) fn of(&self, tile: usize) -> &[u32] {
        &self.ellipses[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}
