//! Bins and fills in rounds, so that memory grows with the picture and not with the layers behind each other.
//!
//! The bins of all faces have no bound: 100,000 triangles that fill the picture are in every tile. At a limit
//! of pairs of triangles and tiles, the tiles are filled. Then triangles behind all samples of a tile are
//! omitted from the bins of the next round. The samples do not change, because the nearest face wins in any
//! order.

use super::bin;
use super::bins::{Batch, tile_count};
use super::hidden::TileDepths;
use super::keys::{EMPTY, SampleKeys};
use super::projector::Projector;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

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
    bin::start(batches, mesh);
    let mut all = bin::bin(batches, mesh, projector, None, pairs);
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
        all = bin::bin(batches, mesh, projector, Some(&hidden), pairs);
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
