//! Projects, clips and bins faces, in rounds, so that memory grows with the picture and not with the layers behind each other.
//!
//! The bins of all faces have no bound: 100,000 triangles that fill the picture are in every tile. At a limit
//! of pairs of triangles and tiles, the tiles are filled. Then triangles behind all samples of a tile are
//! omitted from the bins of the next round. The samples do not change, because the nearest face wins in any
//! order.

use super::bins::{
    Batch, EMPTY, LargeTriangle, SampleKeys, SnappedTriangle, TILE_HEIGHT, TILE_WIDTH, TINY, TileDepths,
    TinyTriangle, extent, samples_between, tile_count,
};
use super::projector::{GRID, GUARD, Projector, snap, snap_group};
use glam::{DVec3, Vec3};
use trisplat_scene::{
    math::lanes::LANES, math::lanes::Lanes, math::lanes::Work, math::lanes::dispatch, mesh::Mesh, parallel,
};

/// Faces that are projected together.
const GROUP: usize = LANES;
/// Smallest number of faces in a batch.
const LEAST_BATCH: usize = 4096;

/// Splits the faces into batches; [`bin`] fills their bins. The picture does not depend on the number of batches.
pub(super) fn start(batches: &mut Vec<Batch>, mesh: &Mesh) {
    let faces = mesh.face_count();
    let count = (4 * parallel::threads()).min(faces.div_ceil(LEAST_BATCH));
    let each = faces.div_ceil(count.max(1)).next_multiple_of(GROUP);
    batches.resize_with(count, Batch::default);
    for (i, batch) in batches.iter_mut().enumerate() {
        batch.left = (i * each).min(faces)..((i + 1) * each).min(faces);
    }
}

/// Empties the bins and fills them with the next faces, about `pairs` pairs of triangles and tiles, without
/// `hidden` ones. Returns whether no face is left.
pub(super) fn bin(
    batches: &mut [Batch],
    mesh: &Mesh,
    projector: &Projector,
    hidden: Option<&TileDepths>,
    pairs: usize,
) -> bool {
    let tiles = tile_count(projector.size);
    let pairs = pairs / batches.len().max(1);
    parallel::for_each(batches.iter_mut(), |_, batch| {
        batch.empty((tiles.x * tiles.y) as usize);
        dispatch(BinFaces { mesh, projector, batch, across: tiles.x as i32, hidden, pairs });
    });
    batches.iter().all(|batch| batch.left.is_empty())
}

/// Puts faces of a batch into its bins.
pub(super) struct BinFaces<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) projector: &'a Projector,
    pub(super) batch: &'a mut Batch,
    /// Tiles in a row.
    pub(super) across: i32,
    pub(super) hidden: Option<&'a TileDepths>,
    /// Number of pairs of triangles and tiles after which the rest must wait.
    pub(super) pairs: usize,
}

impl Work for BinFaces<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { mesh, projector, batch, across, hidden, pairs } = self;
        let mut out = BinWriter { batch, across, size: projector.size.as_ivec2().to_array(), hidden };
        let mut group = FaceGroup::default();
        while !out.batch.left.is_empty() && out.batch.pairs <= pairs {
            let start = out.batch.left.start;
            let count = GROUP.min(out.batch.left.len());
            out.batch.left.start += count;
            group.load(mesh, start, count);
            group.project::<L>(projector);
            for lane in 0..count {
                let face = start + lane;
                match group.action[lane] {
                    Action::DRAW => out.insert(&group.snapped(lane), face as u32),
                    Action::CLIP => {
                        clip(projector, mesh.corners(face), |piece| out.insert(&piece, face as u32))
                    }
                    _ => {}
                }
            }
        }
    }
}

/// The treatment of a face; a number, so that sixteen are decided at once.
struct Action;

impl Action {
    const SKIP: u32 = 0;
    const DRAW: u32 = 1;
    const CLIP: u32 = 2;
}

type FaceValues = [f32; GROUP];

/// Sixteen faces as a structure of arrays.
#[derive(Default)]
struct FaceGroup {
    /// Corner by corner, axis by axis.
    world: [[FaceValues; 3]; 3],
    x: [[i32; GROUP]; 3],
    y: [[i32; GROUP]; 3],
    w: [FaceValues; 3],
    action: [u32; GROUP],
}

impl FaceGroup {
    /// Loops instead of `map`, which is not inlined.
    #[inline(always)]
    fn load(&mut self, mesh: &Mesh, start: usize, count: usize) {
        if mesh.indices.is_empty() {
            let faces = mesh.positions[3 * start..3 * (start + count)].as_chunks::<3>().0;
            for (lane, corners) in faces.iter().enumerate() {
                self.put(lane, corners[0], corners[1], corners[2]);
            }
        } else {
            let faces = mesh.indices[3 * start..3 * (start + count)].as_chunks::<3>().0;
            for (lane, [a, b, c]) in faces.iter().enumerate() {
                let at = |v: u32| mesh.positions[v as usize];
                self.put(lane, at(*a), at(*b), at(*c));
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, lane: usize, a: Vec3, b: Vec3, c: Vec3) {
        let lane = lane % GROUP;
        let [first, second, third] = &mut self.world;
        (first[0][lane], first[1][lane], first[2][lane]) = (a.x, a.y, a.z);
        (second[0][lane], second[1][lane], second[2][lane]) = (b.x, b.y, b.z);
        (third[0][lane], third[1][lane], third[2][lane]) = (c.x, c.y, c.z);
    }

    #[inline(always)]
    fn project<L: Lanes>(&mut self, projector: &Projector) {
        // Corners in front of the near plane; box of the corners.
        let mut front = [0u32; GROUP];
        let mut low = [[f32::INFINITY; GROUP]; 2];
        let mut high = [[f32::NEG_INFINITY; GROUP]; 2];
        for corner in 0..3 {
            let world = &self.world[corner];
            let (mut x, mut y) = ([0.0; GROUP], [0.0; GROUP]);
            for lane in 0..GROUP {
                let seen = projector.to_camera([world[0][lane], world[1][lane], world[2][lane]]);
                let at = projector.project(seen);
                front[lane] += u32::from(seen[2] > projector.near);
                low[0][lane] = low[0][lane].min(at[0]);
                low[1][lane] = low[1][lane].min(at[1]);
                high[0][lane] = high[0][lane].max(at[0]);
                high[1][lane] = high[1][lane].max(at[1]);
                (x[lane], y[lane]) = (at[0], at[1]);
                self.w[corner][lane] = at[2];
            }
            snap_group::<L>(&x, &mut self.x[corner]);
            snap_group::<L>(&y, &mut self.y[corner]);
        }
        let [right, bottom] = projector.size.as_vec2().to_array();
        for lane in 0..GROUP {
            let within = (low[0][lane] > -GUARD)
                & (low[1][lane] > -GUARD)
                & (high[0][lane] < GUARD)
                & (high[1][lane] < GUARD);
            // One sample more on every side: snapping may move a corner in.
            let beside = (high[0][lane] < -1.0)
                | (high[1][lane] < -1.0)
                | (low[0][lane] > right + 1.0)
                | (low[1][lane] > bottom + 1.0);
            let all = front[lane] == 3;
            let out = (front[lane] == 0) | (all & beside);
            let drawn = if all & within { Action::DRAW } else { Action::CLIP };
            self.action[lane] = if out { Action::SKIP } else { drawn };
        }
    }

    #[inline(always)]
    fn snapped(&self, lane: usize) -> SnappedTriangle {
        SnappedTriangle {
            x: [self.x[0][lane], self.x[1][lane], self.x[2][lane]],
            y: [self.y[0][lane], self.y[1][lane], self.y[2][lane]],
            w: [self.w[0][lane], self.w[1][lane], self.w[2][lane]],
        }
    }
}

/// Puts triangles into bins.
struct BinWriter<'a> {
    batch: &'a mut Batch,
    across: i32,
    size: [i32; 2],
    hidden: Option<&'a TileDepths>,
}

impl BinWriter<'_> {
    #[inline(always)]
    fn insert(&mut self, at: &SnappedTriangle, face: u32) {
        let ((left, right), (top, bottom)) = (extent(at.x), extent(at.y));
        let (x0, x1) = samples_between(left, right);
        let (y0, y1) = samples_between(top, bottom);
        let (x0, x1) = (x0.max(0), x1.min(self.size[0] - 1));
        let (y0, y1) = (y0.max(0), y1.min(self.size[1] - 1));
        if x0 > x1 || y0 > y1 {
            return;
        }
        let (rows, columns) = (
            y0 / TILE_HEIGHT as i32..=y1 / TILE_HEIGHT as i32,
            x0 / TILE_WIDTH as i32..=x1 / TILE_WIDTH as i32,
        );
        let nearest = at.nearest();
        if self.hidden.is_some_and(|hidden| hidden.hides_all(&rows, nearest)) {
            return;
        }
        let tiny = right - left <= TINY && bottom - top <= TINY;
        if !tiny {
            self.batch.large.push(LargeTriangle { at: *at, face });
        }
        let index = self.batch.large.len() as u32;
        for row in rows {
            for column in columns.clone() {
                let tile = (row * self.across + column) as usize;
                if self.hidden.is_some_and(|hidden| hidden.hides(tile, nearest)) {
                    continue;
                }
                self.batch.pairs += 1;
                let bin = &mut self.batch.bins[tile];
                if tiny {
                    bin.tiny.push(TinyTriangle::new(at, face, column, row));
                } else {
                    bin.large.push(index - 1);
                }
            }
        }
    }
}

/// Planes of the guard band.
const SIDES: usize = 4;
/// Corners of a triangle clipped by five planes.
const MAX_CORNERS: usize = 3 + SIDES + 1;

#[derive(Debug, Clone, Copy, Default)]
struct ClipPoint {
    camera_space: DVec3,
    /// The projection of a corner, as in unclipped triangles.
    corner: Option<[f32; 3]>,
}

/// Passes the pieces of a triangle in front of the near plane and within the guard band to `emit`.
pub(super) fn clip(projector: &Projector, corners: [Vec3; 3], mut emit: impl FnMut(SnappedTriangle)) {
    let mut polygon = Polygon::default();
    for corner in corners {
        let camera_space = projector.to_camera(corner.to_array());
        // The same test as for unclipped triangles must decide here.
        let front = camera_space[2] > projector.near;
        let point = ClipPoint {
            camera_space: projector.to_camera_f64(corner),
            corner: front.then(|| projector.project(camera_space)),
        };
        polygon.push(point);
    }
    let near = f64::from(projector.near);
    polygon = polygon.clip(|p| p.camera_space.z - near, |p| p.corner.is_some());
    for side in 0..SIDES {
        let inside = |p: &ClipPoint| projector.inside_guard(p.camera_space, side);
        polygon = polygon.clip(inside, |p| inside(p) >= 0.0);
    }
    let snapped: Vec<([i32; 2], f32)> = polygon.points().iter().map(|p| snap_point(projector, p)).collect();
    for i in 2..snapped.len() {
        let fan = [snapped[0], snapped[i - 1], snapped[i]];
        emit(SnappedTriangle { x: fan.map(|p| p.0[0]), y: fan.map(|p| p.0[1]), w: fan.map(|p| p.1) });
    }
}

/// A point on the grid, and its 1/z.
fn snap_point(projector: &Projector, point: &ClipPoint) -> ([i32; 2], f32) {
    match point.corner {
        Some([x, y, w]) => ([snap(x), snap(y)], w),
        None => {
            let at = projector.project_f64(point.camera_space) * f64::from(GRID);
            let round = |x: f64| x.round_ties_even() as i32;
            ([round(at.x), round(at.y)], (1.0 / point.camera_space.z) as f32)
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Polygon {
    points: [ClipPoint; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    fn points(&self) -> &[ClipPoint] {
        &self.points[..self.count]
    }

    fn push(&mut self, point: ClipPoint) {
        self.points[self.count] = point;
        self.count += 1;
    }

    /// The part for which `distance` is not negative (Sutherland and Hodgman 1974); `keep` decides the side
    /// of a point.
    fn clip(&self, distance: impl Fn(&ClipPoint) -> f64, keep: impl Fn(&ClipPoint) -> bool) -> Self {
        let mut out = Self::default();
        for (i, from) in self.points().iter().enumerate() {
            let to = &self.points[(i + 1) % self.count];
            if keep(from) {
                out.push(*from);
            }
            match (keep(from), keep(to)) {
                (true, false) => out.push(between(from, to, &distance)),
                (false, true) => out.push(between(to, from, &distance)),
                _ => {}
            }
        }
        out
    }
}

/// The point of zero distance between `inside` and `outside`.
fn between(inside: &ClipPoint, outside: &ClipPoint, distance: impl Fn(&ClipPoint) -> f64) -> ClipPoint {
    let (d_in, d_out) = (distance(inside), distance(outside));
    let t = (d_in / (d_in - d_out)).clamp(0.0, 1.0);
    ClipPoint {
        camera_space: inside.camera_space + (outside.camera_space - inside.camera_space) * t,
        corner: None,
    }
}

/// Most pairs of triangles and tiles in the bins at once; 4 to 28 bytes each.
pub(super) const PAIRS_PER_ROUND: usize = 1 << 24;

/// The faces of a mesh, ready for the tiles.
pub(super) enum Faces<'a> {
    /// All are in the bins.
    Binned(&'a [Batch]),
    /// Tiles are filled already. `[tiles * planes]`
    Filled(Vec<SampleKeys>),
}

/// Bins the faces of a mesh; if these are too many for one round, `fill` draws those in the bins into the keys of a tile.
pub(super) fn rounds<'a>(
    batches: &'a mut Vec<Batch>,
    mesh: &Mesh,
    projector: &Projector,
    (pairs, planes): (usize, usize),
    fill: impl Fn(&mut [SampleKeys], &[Batch], usize) + Sync,
) -> Faces<'a> {
    start(batches, mesh);
    let mut all = bin(batches, mesh, projector, None, pairs);
    if all {
        return Faces::Binned(batches);
    }
    let tiles = tile_count(projector.size);
    let mut keys = vec![EMPTY; (tiles.x * tiles.y) as usize * planes];
    loop {
        parallel::for_each(keys.chunks_mut(planes), |tile, keys| fill(keys, batches, tile));
        if all {
            return Faces::Filled(keys);
        }
        let hidden = TileDepths::new(&keys, planes, projector.size);
        all = bin(batches, mesh, projector, Some(&hidden), pairs);
    }
}

impl Faces<'_> {
    /// The keys of tile `tile`: drawn into `keys` by `fill`, unless they exist. `[planes]`
    pub(super) fn keys<'a>(
        &'a self,
        keys: &'a mut [SampleKeys],
        tile: usize,
        fill: impl FnOnce(&mut [SampleKeys], &[Batch], usize),
    ) -> &'a [SampleKeys] {
        match self {
            Faces::Filled(filled) => &filled[tile * keys.len()..][..keys.len()],
            Faces::Binned(batches) => {
                keys.iter_mut().for_each(|keys| keys.fill(0));
                fill(keys, batches, tile);
                keys
            }
        }
    }
}
