//! Draws several sets of faces at once, each with a z-buffer of its own.
//!
//! The planes of disjoint sets give the picture of any union of them, without drawing: the nearest of the
//! sets' nearest faces.

use super::bin::rounds;
use super::bins::tile_size;
use super::bins::{Batch, TILE_HEIGHT, TILE_WIDTH, tile_count};
use super::bins::{EMPTY, STRIDE, SampleKey, SampleKeys, face_of};
use super::fill::draw_large;
use super::fill::draw_tiny;
use super::projector::Projector;
use glam::UVec2;
use trisplat_scene::parallel;
use trisplat_scene::{
    math::lanes::{Lanes, Work, dispatch},
    mesh::Mesh,
};

/// The nearest face of a set at a sample. The greater of two is nearer; at the same depth it has the lower
/// face index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Nearest(SampleKey);

impl Nearest {
    /// No face at all: farther than any.
    pub const NONE: Self = Self(0);

    /// The nearest and the second nearest of four.
    #[inline(always)]
    pub fn two_of([a, b, c, d]: [Self; 4]) -> [Self; 2] {
        let (near, far) = ([a.max(b), c.max(d)], [a.min(b), c.min(d)]);
        [near[0].max(near[1]), near[0].min(near[1]).max(far[0]).max(far[1])]
    }

    /// The face, or `NO_FACE`.
    #[inline(always)]
    pub fn face(self) -> u32 {
        face_of(self.0)
    }
}

/// The samples of one tile, plane by plane.
#[derive(Debug)]
pub struct PlaneTile<'a> {
    keys: &'a [SampleKeys],
    /// Its first sample in the picture.
    pub corner: UVec2,
    /// Its samples across and down.
    pub size: UVec2,
}

impl PlaneTile<'_> {
    /// The nearest face of a plane at sample `x`, `y` of the tile.
    #[inline(always)]
    pub fn nearest(&self, plane: usize, x: u32, y: u32) -> Nearest {
        Nearest(self.keys[plane][y as usize * STRIDE + x as usize])
    }
}

/// Draws all tiles and gives them to `on_tile`, several at a time and in any order.
pub(super) fn planes(
    batches: &mut Vec<Batch>,
    mesh: &Mesh,
    projector: &Projector,
    pairs: usize,
    (planes, plane_of): (usize, &[u8]),
    on_tile: impl Fn(&PlaneTile<'_>) + Sync,
) {
    let tiles = tile_count(projector.size);
    let fill = |keys: &mut [SampleKeys], batches: &[Batch], tile: usize| {
        let (column, row) = (tile as u32 % tiles.x, tile as u32 / tiles.x);
        dispatch(FillPlanes { keys, batches, plane_of, tile, column, row });
    };
    let faces = rounds(batches, mesh, projector, (pairs, planes), fill);
    parallel::for_each_with(
        0..tiles.x * tiles.y,
        || vec![EMPTY; planes],
        |keys, _, tile| {
            let (column, row) = (tile % tiles.x, tile / tiles.x);
            let keys = faces.keys(keys, tile as usize, fill);
            let corner = UVec2::new(column * TILE_WIDTH as u32, row * TILE_HEIGHT as u32);
            on_tile(&PlaneTile { keys, corner, size: tile_size(projector.size, column, row) });
        },
    );
}

/// Draws into the keys of a tile in all planes.
struct FillPlanes<'a> {
    keys: &'a mut [SampleKeys],
    batches: &'a [Batch],
    plane_of: &'a [u8],
    tile: usize,
    column: u32,
    row: u32,
}

impl Work for FillPlanes<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let corner = [(self.column as usize * TILE_WIDTH) as i32, (self.row as usize * TILE_HEIGHT) as i32];
        for batch in self.batches {
            let bin = &batch.bins[self.tile];
            for tiny in &bin.tiny {
                draw_tiny::<L>(&mut self.keys[usize::from(self.plane_of[tiny.face as usize])], tiny);
            }
            for place in &bin.large {
                let large = &batch.large[*place as usize];
                draw_large::<L>(
                    &mut self.keys[usize::from(self.plane_of[large.face as usize])],
                    large,
                    corner,
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SolidRasterOptions, SolidRasterizer};
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use std::sync::Mutex;
    use trisplat_scene::Rng;
    use trisplat_scene::camera::Camera;
    use trisplat_scene::mesh::Mesh;

    /// Triangles of all sizes that hide each other.
    fn mesh(faces: u64) -> Mesh {
        let rng = Rng::new(3, "planes", 0);
        let point = |i: u64| Vec3::from([0, 1, 2].map(|k| rng.uniform(3 * i + k) * 2.0 - 1.0));
        let corner = |i: u64| {
            let reach = if (i / 3).is_multiple_of(7) { 1.5 } else { 0.1 };
            point(i / 3) * 1.5 + Vec3::Z * 3.0 + reach * point(i + 10_000)
        };
        Mesh { positions: (0..3 * faces).map(corner).collect(), ..Mesh::default() }
    }

    #[test]
    fn the_nearest_of_some_planes_is_what_their_faces_look_like() {
        let size = UVec2::new(150, 70);
        let center = size.as_vec2() / 2.0;
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        let camera = Camera { rotation, translation, focal: Vec2::splat(60.0), center, size };
        let (mesh, options) = (mesh(600), SolidRasterOptions::default());
        let plane_of: Vec<u8> = (0..600).map(|f| (f * f % 3) as u8).collect();
        let pixels = size.x as usize * size.y as usize;
        for some in [&[0, 1, 2][..], &[0, 2], &[1]] {
            let drawn = Mutex::new(vec![0; pixels]);
            SolidRasterizer::new().planes(&mesh, &camera, &options, (3, &plane_of), |tile| {
                let mut drawn = drawn.lock().unwrap();
                for (x, y) in (0..tile.size.y).flat_map(|y| (0..tile.size.x).map(move |x| (x, y))) {
                    let nearest =
                        some.iter().map(|p| tile.nearest(*p, x, y)).fold(Nearest::NONE, Nearest::max);
                    drawn[((tile.corner.y + y) * size.x + tile.corner.x + x) as usize] = nearest.face();
                }
            });
            let kept: Vec<u32> = (0..600).filter(|f| some.contains(&plane_of[*f as usize].into())).collect();
            let mut part = Mesh { positions: Vec::new(), ..Mesh::default() };
            part.positions.extend(kept.iter().flat_map(|f| mesh.corners(*f as usize)));
            let mut alone = SolidRasterizer::new().visibility(&part, &camera, &options).face.clone();
            let seen = alone.iter_mut().filter(|face| **face != super::super::NO_FACE);
            assert!(seen.map(|face| *face = kept[*face as usize]).count() > pixels / 4);
            assert!(*drawn.lock().unwrap() == alone, "{some:?}");
        }
    }
}
