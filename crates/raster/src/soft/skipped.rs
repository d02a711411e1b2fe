//! Counts the work that a frame skips.

use super::tile_grid::{BLOCKS, tiles_between};
use super::{SoftOptions, SoftRasterizer, SoupRef, slabs};
use std::ops::AddAssign;
use trisplat_scene::{WorkCount, camera::Camera};

/// The full work of a frame, and the skipped part.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SoftWork {
    /// Triangles; those out of view, behind the near plane or too faint are skipped.
    pub triangles: WorkCount,
    /// Tiles of 16×16 px within the bounds of the remaining triangles; those that a triangle does not reach
    /// are skipped.
    pub tiles: WorkCount,
    /// Blocks of 4×4 px of reached tiles, each with one triangle; those that the triangle does not touch are
    /// skipped.
    pub blocks: WorkCount,
    /// Layers of blocks; those behind opaque pixels of a whole block are skipped.
    pub layers: WorkCount,
}

impl SoftWork {
    /// The skipped shares as text, for example "layers=31%".
    pub fn labels(&self) -> Vec<String> {
        let Self { triangles, tiles, blocks, layers } = self;
        let of = [("triangles", triangles), ("tiles", tiles), ("blocks", blocks), ("layers", layers)];
        of.iter().filter_map(|(name, work)| work.label(name)).collect()
    }
}

impl AddAssign for SoftWork {
    fn add_assign(&mut self, other: Self) {
        self.triangles += other.triangles;
        self.tiles += other.tiles;
        self.blocks += other.blocks;
        self.layers += other.layers;
    }
}

impl SoftRasterizer {
    /// Draws a frame twice, like [`render`](SoftRasterizer::render) and to the last layer, and counts. `None` for a
    /// frame drawn in slabs.
    pub fn work(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) -> Option<SoftWork> {
        self.render(soup, camera, options);
        let splats = &self.projection.splats;
        if slabs::are_needed(splats, camera.size, options, self.pairs_per_slab) {
            return None;
        }
        let [width, height] = camera.size.as_vec2().to_array();
        let across = |(first, last): (u32, u32)| u64::from((last + 1).saturating_sub(first));
        let within = |b: &super::splats::ScreenBox| {
            across(tiles_between(b.lo[0], b.hi[0], width)) * across(tiles_between(b.lo[1], b.hi[1], height))
        };
        let boxed: u64 = splats.bounds.iter().map(within).sum();
        let pairs = self.tiles.entries.len() as u64;
        let (visible, drawn) = (splats.len() as u64, self.blocks());
        self.render(soup, camera, &SoftOptions { min_transmittance: 0.0, ..*options });
        let to_the_end = self.blocks();
        self.tiles.bin(&self.projection.splats, camera.size, options.window);
        Some(SoftWork {
            triangles: WorkCount::of(visible, soup.vertices.len() as u64),
            tiles: WorkCount::of(pairs, boxed),
            blocks: WorkCount::of(self.blocks(), pairs * BLOCKS as u64),
            layers: WorkCount::of(drawn, to_the_end),
        })
    }

    /// Blocks of all entries: after binning possible ones, after drawing real ones.
    fn blocks(&self) -> u64 {
        self.tiles.entries.iter().map(|entry| u64::from(entry.blocks.count_ones())).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Soup;

    /// A camera at the origin that looks along z at 64×64 px.
    fn camera() -> Camera {
        let size = UVec2::splat(64);
        Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(64.0),
            center: Vec2::splat(32.0),
            size,
        }
    }

    /// Opaque triangles at these depths, each far larger than the picture.
    fn walls(depths: &[f32]) -> Soup {
        let wall = |&z: &f32| {
            let s = 10.0 * z.abs();
            [Vec3::new(-s, -s, z), Vec3::new(3.0 * s, -s, z), Vec3::new(-s, 3.0 * s, z)]
        };
        let n = depths.len();
        let vertices = depths.iter().map(wall).collect();
        Soup {
            vertices,
            opacity: vec![0.999; n],
            sigma: vec![0.001; n],
            sh: vec![[0.5; 3]; n],
            sh_degree: 0,
            ..Soup::default()
        }
    }

    #[test]
    fn what_is_out_of_view_beside_a_triangle_or_behind_opaque_ones_is_counted() {
        let soup = walls(&[1.0, 2.0, 3.0, 4.0, 5.0, -1.0]);
        let work =
            SoftRasterizer::new().work(&SoupRef::from(&soup), &camera(), &SoftOptions::default()).unwrap();
        assert_eq!(work.triangles, WorkCount { done: 5, skipped: 1 });
        // Five walls over 4×4 tiles of 16 blocks; two of opacity 0.99 leave 1e-4 of the light.
        assert_eq!(work.tiles, WorkCount { done: 80, skipped: 0 });
        assert_eq!(work.blocks, WorkCount { done: 1280, skipped: 0 });
        assert_eq!(work.layers.done + work.layers.skipped, 1280);
        assert!((256..=768).contains(&work.layers.done) && work.layers.done.is_multiple_of(256), "{work:?}");
    }

    #[test]
    fn a_thin_diagonal_reaches_few_of_the_tiles_of_its_box() {
        let mut soup = walls(&[1.0]);
        soup.vertices[0] =
            [Vec3::new(-0.45, -0.45, 1.0), Vec3::new(0.45, 0.43, 1.0), Vec3::new(0.43, 0.45, 1.0)];
        let work =
            SoftRasterizer::new().work(&SoupRef::from(&soup), &camera(), &SoftOptions::default()).unwrap();
        assert!(work.tiles.skipped >= 6 && work.tiles.done >= 4, "{work:?}");
        assert!(work.blocks.skipped > work.blocks.done, "{work:?}");
        assert_eq!(work.layers.skipped, 0);
    }
}
