//! Projects faces and puts them into the bins of the tiles that they touch.

use super::bins::{
    Batch, LargeTriangle, SnappedTriangle, TILE_HEIGHT, TILE_WIDTH, TINY, TinyTriangle, extent,
    samples_between, tile_count,
};
use super::clipped;
use super::hidden::TileDepths;
use super::projector::{GUARD, Projector, snap_group};
use glam::Vec3;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

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
        let mut group = FaceGroup::new();
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
                        clipped::clip(projector, mesh.corners(face), |piece| out.insert(&piece, face as u32))
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
struct FaceGroup {
    /// Corner by corner, axis by axis.
    world: [[FaceValues; 3]; 3],
    x: [[i32; GROUP]; 3],
    y: [[i32; GROUP]; 3],
    w: [FaceValues; 3],
    action: [u32; GROUP],
}

impl FaceGroup {
    fn new() -> Self {
        let zero = [0; GROUP];
        Self {
            world: [[[0.0; GROUP]; 3]; 3],
            x: [zero; 3],
            y: [zero; 3],
            w: [[0.0; GROUP]; 3],
            action: [Action::SKIP; GROUP],
        }
    }

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
