//! The solid rasteriser: defines an engine's picture, on the CPU.
//!
//! ```text
//! faces ──► project, clip, bin ──► tiles ──► fill (nearest face of every sample) ──► resolve ──► Pixels
//!                                                                              └──► export ──► Visibility
//! ```
//!
//! Every other renderer of this project is compared with this definition:
//!
//! * A triangle is clipped at the near plane and at a guard band far outside the picture; opacity
//!   is ignored: everything is opaque. Single-sided faces whose corners run clockwise in the
//!   picture are not drawn.
//! * Corners are snapped to 1/256 of a sample, as GPUs do; from there on edge functions are exact,
//!   so a shared edge neither gaps nor overlaps. A sample on an edge belongs to the triangle for
//!   which it is a top or left edge.
//! * Samples lie at the centres of a regular grid of N x N per pixel.
//! * The nearest face wins: greatest 1/z, which is affine on the screen; ties go to the lower face
//!   index. This does not depend on the order of drawing, hence not on the number of threads.
//! * Corners with spherical harmonics have the colour that the camera sees there: `view_colors.rs`.
//! * Colours are interpolated perspective-correctly in linear light, averaged over a pixel's
//!   samples in linear light, then sRGB-encoded and rounded.

mod bin;
mod fill;
mod projector;
mod shade;
mod view_colors;
mod visibility;

pub use view_colors::{direction_basis, view_colors};
pub use visibility::{Barycentrics, FaceBarycentrics, NO_FACE, Nearest, PlaneTile, Visibility};

use bin::{
    Batch, EMPTY, STRIDE, SampleKeys, TILE_HEIGHT, TILE_WIDTH, TileDepths, face_of,
    inverse_depth_of, tile_count, tile_place, tile_size,
};
use fill::FillTile;
use glam::UVec2;
use projector::Projector;
use shade::ShadeTile;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::lanes::dispatch;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Error, Result, parallel};

/// Largest number of samples along an axis of the picture: beyond it f32 cannot resolve 1/256 of a
/// sample.
const MAX_SAMPLES: u32 = 1 << 15;

/// Drawing options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidRasterOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Samples per pixel along each axis: 1, 2 or 4.
    pub samples: u32,
    /// Depth of the near plane in units of the mesh, > 0. Depth precision does not depend on it.
    pub near: f32,
}

impl Default for SolidRasterOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], samples: 1, near: 0.01 }
    }
}

impl SolidRasterOptions {
    /// Checks the ranges, and that a picture of `size` has at most `MAX_SAMPLES` along each axis.
    pub fn validate(&self, size: UVec2) -> Result<()> {
        if !matches!(self.samples, 1 | 2 | 4) {
            return Err(Error::invalid("samples", self.samples, "1, 2 or 4"));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(Error::invalid("near", self.near, "a depth above 0"));
        }
        let samples = u64::from(size.max_element()) * u64::from(self.samples);
        if samples > u64::from(MAX_SAMPLES) {
            let wants = format!("a picture of at most {} px a side", MAX_SAMPLES / self.samples);
            return Err(Error::invalid("samples", format!("{} on {size} px", self.samples), wants));
        }
        Ok(())
    }
}

/// Maximum number of pairs of triangles and tiles in the bins at once; 4 to 28 bytes each.
const PAIRS_PER_ROUND: usize = 1 << 24;

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct SolidRasterizer {
    batches: Vec<Batch>,
    visibility: Visibility,
    /// Maximum number of pairs of triangles and tiles in the bins at once, if tests set fewer.
    pairs_per_round: Option<usize>,
}

impl SolidRasterizer {
    /// A rasteriser without scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// The picture of `camera`, in 8 bits. The same bytes for any number of threads.
    ///
    /// The mesh must be valid ([`Mesh::validate_shape`]) and the options valid for the camera's
    /// size.
    pub fn render(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        options: &SolidRasterOptions,
    ) -> RgbImage {
        let projector = &Projector::new(camera, options.samples, options.near);
        let size = camera.size;
        let samples = options.samples as usize;
        let mut rgb = vec![[0; 3]; size.x as usize * size.y as usize];
        let tiles =
            split_tiles(&mut rgb, size.x as usize, TILE_WIDTH / samples, TILE_HEIGHT / samples);
        let background = options.background.map(linear_from_srgb);
        let seen = view_colors(mesh, camera.position());
        let colors = seen.as_ref().unwrap_or(&mesh.colors);
        BinnedFaces::new(self, mesh, projector, (1, None)).for_each_tile(
            tiles,
            |place, keys, mut rows| {
                let corner = [place.x * TILE_WIDTH as u32, place.y * TILE_HEIGHT as u32];
                dispatch(ShadeTile {
                    mesh,
                    colors,
                    projector,
                    background,
                    corner,
                    keys: &keys[0],
                    rows: &mut rows,
                });
            },
        );
        RgbImage { size, rgb, alpha: None }
    }

    /// The face and depth that every sample sees.
    pub fn visibility(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        options: &SolidRasterOptions,
    ) -> &Visibility {
        let projector = Projector::new(camera, options.samples, options.near);
        let mut out = std::mem::take(&mut self.visibility);
        out.size = projector.size;
        let width = out.size.x as usize;
        let count = out.size.x as usize * out.size.y as usize;
        out.face.resize(count, NO_FACE);
        out.depth.resize(count, f32::INFINITY);
        let faces = split_tiles(&mut out.face, width, TILE_WIDTH, TILE_HEIGHT);
        let depths = split_tiles(&mut out.depth, width, TILE_WIDTH, TILE_HEIGHT);
        let tiles = faces.into_iter().zip(depths).collect();
        BinnedFaces::new(self, mesh, &projector, (1, None)).for_each_tile(
            tiles,
            |_, keys, (faces, depths)| {
                for ((row_faces, depths), keys) in
                    faces.into_iter().zip(depths).zip(keys[0].chunks(STRIDE))
                {
                    for ((face, depth), key) in row_faces.iter_mut().zip(depths).zip(keys) {
                        *face = face_of(*key);
                        *depth = 1.0 / inverse_depth_of(*key);
                    }
                }
            },
        );
        self.visibility = out;
        &self.visibility
    }

    /// The nearest face of each plane at every sample: face f belongs to plane `plane_of[f]` of
    /// `planes`. Tiles are given to `on_tile` several at a time and in any order. `[F]`
    pub fn planes(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        options: &SolidRasterOptions,
        (planes, plane_of): (usize, &[u8]),
        on_tile: impl Fn(&PlaneTile<'_>) + Sync,
    ) {
        let projector = Projector::new(camera, options.samples, options.near);
        let tiles = vec![(); tile_count(projector.size).element_product() as usize];
        let faces = BinnedFaces::new(self, mesh, &projector, (planes, Some(plane_of)));
        faces.for_each_tile(tiles, |place, keys, ()| {
            let corner = place * UVec2::new(TILE_WIDTH as u32, TILE_HEIGHT as u32);
            on_tile(&PlaneTile { keys, corner, size: tile_size(projector.size, place) });
        });
    }
}

/// The faces of a mesh, ready for the tiles.
struct BinnedFaces<'a> {
    /// With all faces in the bins, unless the tiles are filled.
    batches: &'a [Batch],
    /// The keys of all tiles; empty if all faces fit in the bins at once. `[tiles * planes]`
    filled: Vec<SampleKeys>,
    planes: usize,
    plane_of: Option<&'a [u8]>,
    /// Samples across and down.
    size: UVec2,
}

impl<'a> BinnedFaces<'a> {
    /// Bins the faces of a mesh; if these are too many for one round, draws those in the bins into
    /// the keys of all tiles.
    fn new(
        solid: &'a mut SolidRasterizer,
        mesh: &Mesh,
        projector: &Projector,
        (planes, plane_of): (usize, Option<&'a [u8]>),
    ) -> Self {
        let batches = &mut solid.batches;
        let size = projector.size;
        let pairs = solid.pairs_per_round.unwrap_or(PAIRS_PER_ROUND);
        bin::start(batches, mesh);
        let mut all = bin::bin(batches, mesh, projector, None, pairs);
        let mut filled = Vec::new();
        if !all {
            filled = vec![EMPTY; tile_count(size).element_product() as usize * planes];
            loop {
                parallel::for_each(filled.chunks_mut(planes), |tile, keys| {
                    dispatch(FillTile { keys, batches, plane_of, tile, size });
                });
                if all {
                    break;
                }
                let hidden = TileDepths::new(&filled, planes, size);
                all = bin::bin(batches, mesh, projector, Some(&hidden), pairs);
            }
        }
        Self { batches, filled, planes, plane_of, size }
    }

    /// Gives `on_tile` the place and the keys of each tile with its part of `tiles`. `[planes]`
    fn for_each_tile<T: Send>(
        &self,
        tiles: Vec<T>,
        on_tile: impl Fn(UVec2, &[SampleKeys], T) + Sync,
    ) {
        let Self { batches, filled, planes, plane_of, size } = self;
        parallel::for_each_with(
            tiles,
            || vec![EMPTY; *planes],
            |keys, tile, part| {
                let keys = if filled.is_empty() {
                    for keys in keys.iter_mut() {
                        keys.fill(0);
                    }
                    dispatch(FillTile { keys, batches, plane_of: *plane_of, tile, size: *size });
                    &keys[..]
                } else {
                    &filled[tile * planes..][..*planes]
                };
                on_tile(tile_place(*size, tile), keys, part);
            },
        );
    }
}

/// The rows of a picture split into tiles of `columns` by `rows`, tile by tile. `[tiles][rows]`
fn split_tiles<T>(
    values: &mut [T],
    width: usize,
    columns: usize,
    rows: usize,
) -> Vec<Vec<&mut [T]>> {
    let mut tiles: Vec<Vec<&mut [T]>> = Vec::new();
    for band in values.chunks_mut(width * rows) {
        let first = tiles.len();
        tiles.resize_with(first + width.div_ceil(columns), || Vec::with_capacity(rows));
        for row in band.chunks_mut(width) {
            for (tile, part) in tiles[first..].iter_mut().zip(row.chunks_mut(columns)) {
                tile.push(part);
            }
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::Colors;

    const SIZE: UVec2 = UVec2::new(300, 170);

    fn camera() -> Camera {
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        Camera {
            rotation,
            translation,
            focal: Vec2::splat(200.0),
            center: SIZE.as_vec2() / 2.0,
            size: SIZE,
        }
    }

    /// Triangles of all sizes, many of them across the picture, tilted and level, some through the
    /// near plane.
    fn deep(faces: u64) -> Mesh {
        let mut positions = Vec::new();
        let mut colors = Vec::new();
        for i in 0..faces {
            let rng = Rng::new(5, "deep", i);
            let point = |k: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * k + c) - 1.0));
            let depth = 6.0 - 5.9 * rng.uniform(30);
            let (reach, tilt) = [(4.0, 0.0), (0.2, 0.5), (6.0, 0.3), (0.02, 1.0)][i as usize % 4];
            let center = point(0) * depth * 0.4;
            for k in 1..4 {
                let corner = center + reach * depth * point(k);
                positions.push(Vec3::new(corner.x, corner.y, depth + tilt * reach * point(k).z));
            }
            colors.push([31, 32, 33].map(|c| rng.uniform(c)));
        }
        Mesh { positions, colors: Colors::Face(colors), ..Mesh::default() }
    }

    #[test]
    fn single_sided_faces_are_drawn_from_their_front_only() {
        // The second crosses the near plane, so that it is clipped.
        let front =
            [Vec3::new(-1.0, 1.0, 3.0), Vec3::new(1.0, 1.0, 3.0), Vec3::new(0.0, -1.0, 3.0)];
        let clipped =
            [Vec3::new(-1.0, 1.0, -1.0), Vec3::new(1.0, 1.0, -1.0), Vec3::new(0.0, 1.0, 5.0)];
        for corners in [front, clipped] {
            let mut mesh = Mesh::from_triangles(&[corners], &[[1.0; 3]]).unwrap();
            let drawn = |mesh: &Mesh| {
                let mut solid = SolidRasterizer::new();
                let seen = solid.visibility(mesh, &camera(), &SolidRasterOptions::default());
                seen.face.iter().filter(|face| **face != NO_FACE).count()
            };
            let both = drawn(&mesh);
            assert!(both > 1000);
            mesh.single_sided = vec![true];
            let eye_in_front = mesh.flat_normal(0).dot(-corners[0]) > 0.0;
            assert!(eye_in_front);
            assert_eq!(drawn(&mesh), both);
            mesh.flip(0);
            assert_eq!(drawn(&mesh), 0);
            mesh.single_sided = Vec::new();
            assert_eq!(drawn(&mesh), both);
        }
    }

    #[test]
    fn rounds_change_no_sample() {
        let mesh = deep(6000);
        let camera = camera();
        for samples in [1, 2] {
            let options = SolidRasterOptions { samples, ..SolidRasterOptions::default() };
            let mut whole =
                SolidRasterizer { pairs_per_round: Some(usize::MAX), ..SolidRasterizer::default() };
            let picture = whole.render(&mesh, &camera, &options);
            whole.visibility(&mesh, &camera, &options);
            for pairs in [1, 5000, 40_000] {
                let mut rounds =
                    SolidRasterizer { pairs_per_round: Some(pairs), ..SolidRasterizer::default() };
                assert!(rounds.render(&mesh, &camera, &options) == picture, "{pairs}");
                assert!(*rounds.visibility(&mesh, &camera, &options) == whole.visibility);
            }
        }
    }

    #[test]
    fn hidden_faces_take_no_memory() {
        let flat = |z: f32| {
            [Vec3::new(-30.0, -30.0, z), Vec3::new(30.0, -30.0, z), Vec3::new(0.0, 60.0, z)]
        };
        let positions =
            (0..20_000).flat_map(|i| flat(2.0 + 1e-4 * (i * 7919 % 20_000) as f32)).collect();
        let mesh =
            Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; 20_000]), ..Mesh::default() };
        let mut solid =
            SolidRasterizer { pairs_per_round: Some(2000), ..SolidRasterizer::default() };
        let seen = solid.visibility(&mesh, &camera(), &SolidRasterOptions::default());
        assert!(seen.face.iter().all(|face| *face == 0));
        let held: usize =
            solid.batches.iter().flat_map(|b| &b.bins).map(|bin| bin.large.capacity()).sum();
        assert!(held < 40_000, "{held} pairs");
    }
}
