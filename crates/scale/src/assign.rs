//! Which photos each block gets: those that show it, judged by the coarse scene, each cropped to the part that shows it.

use super::cover::{Brush, Coverage, SeenBlock};
use super::manifest::{Block, BlockPhoto};
use super::options::PlanOptions;
use std::sync::atomic::AtomicBool;
use trisplat_dataset::View;
use trisplat_scene::parallel;
use trisplat_scene::{Error, Result};

/// A block with fewer photos than this gets those that show most of it, however little: one photo gives no depth.
const FEWEST_PHOTOS: usize = 3;

/// Gives each of `blocks` its photos among `views`; one that no photo shows has none.
///
/// Errors: no photo shows any.
pub(super) fn assign(
    blocks: &mut [Block],
    views: &[&View],
    coverage: &Coverage<'_>,
    options: &PlanOptions,
) -> Result<()> {
    let min_cover = options.min_cover as f32;
    // Those that show too little of a block are known too, for blocks that have no others.
    let mut shown: Vec<Vec<(usize, SeenBlock)>> = vec![Vec::new(); blocks.len()];
    let looks: Vec<Vec<SeenBlock>> = parallel::map_with(views, Brush::default, |brush, _, view| {
        coverage.look(brush, &view.camera, blocks, 0.1 * min_cover)
    });
    for (photo, looks) in looks.into_iter().enumerate() {
        looks.into_iter().for_each(|seen| shown[seen.block].push((photo, seen)));
    }
    for (block, mut views) in blocks.iter_mut().zip(shown) {
        views.sort_by(|(a, x), (b, y)| y.cover.total_cmp(&x.cover).then(a.cmp(b)));
        let enough = views.partition_point(|(_, seen)| seen.cover >= min_cover);
        let most = if options.block_photos == 0 { usize::MAX } else { options.block_photos as usize };
        views.truncate(enough.max(FEWEST_PHOTOS).min(most.max(FEWEST_PHOTOS)));
        views.sort_by_key(|(photo, _)| *photo);
        block.photos = views.into_iter().map(|(photo, seen)| block_photo(photo, &seen)).collect();
    }
    if blocks.iter().all(|block| block.photos.is_empty()) {
        let wants = "photos that show the coarse scene: none shows any block";
        return Err(Error::invalid("data set", "its cameras", wants));
    }
    Ok(())
}

fn block_photo(photo: usize, seen: &SeenBlock) -> BlockPhoto {
    let (corner, size) = seen.part;
    BlockPhoto {
        photo: photo as u32,
        part: [corner.x, corner.y, size.x, size.y],
        // Digits beyond these say nothing.
        cover: (seen.cover * 1e4).round() / 1e4,
    }
}

/// Which triangles of the coarse scene the cropped photos of a block show. `[N]`
pub(super) fn visible(
    block: &Block,
    views: &[&View],
    triangles: usize,
    coverage: &Coverage<'_>,
) -> Result<Vec<bool>> {
    let mut visible = Vec::new();
    visible.resize_with(triangles, AtomicBool::default);
    let look = |brush: &mut Brush, _, photo: &BlockPhoto| -> Result<()> {
        let (corner, size) = photo.corner_and_size();
        let part = views[photo.photo as usize].cropped(corner, size)?;
        coverage.mark_visible(brush, &part.camera, &visible);
        Ok(())
    };
    let looked = parallel::map_with(&block.photos, Brush::default, look);
    looked.into_iter().collect::<Result<()>>()?;
    Ok(visible.into_iter().map(AtomicBool::into_inner).collect())
}
