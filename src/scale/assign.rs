//! Which photos each block gets: those that show it, by the coarse scene, and of these the parts that do.

use super::cover::{Coverage, Sight};
use super::manifest::{Block, BlockPhoto};
use super::options::PlanOptions;
use crate::dataset::View;
use crate::error::{Error, Result};

/// A block with fewer photos gets those that show most of it, however little that is: what one photo shows has no depth.
const FEWEST_PHOTOS: usize = 3;

/// Gives each of `blocks` its photos among `views`.
///
/// Errors: a block that no photo shows.
pub(super) fn assign(
    blocks: &mut [Block],
    views: &[&View],
    coverage: &mut Coverage<'_>,
    options: &PlanOptions,
) -> Result<()> {
    let min_cover = options.min_cover as f32;
    // Those that show too little of a block are known too, for blocks that have no others.
    let mut shown: Vec<Vec<(usize, Sight)>> = vec![Vec::new(); blocks.len()];
    for (photo, view) in views.iter().enumerate() {
        for sight in coverage.look(&view.camera, blocks, 0.1 * min_cover) {
            shown[sight.block].push((photo, sight));
        }
    }
    for (i, (block, mut sights)) in blocks.iter_mut().zip(shown).enumerate() {
        sights.sort_by(|(a, x), (b, y)| y.cover.total_cmp(&x.cover).then(a.cmp(b)));
        let enough = sights.partition_point(|(_, sight)| sight.cover >= min_cover);
        let most = if options.block_photos == 0 { usize::MAX } else { options.block_photos as usize };
        sights.truncate(enough.max(FEWEST_PHOTOS).min(most.max(FEWEST_PHOTOS)));
        if sights.is_empty() {
            let wants = format!("fewer: no photo shows block {i}");
            return Err(Error::invalid("blocks", options.blocks.unwrap_or_default(), wants));
        }
        sights.sort_by_key(|(photo, _)| *photo);
        block.photos = sights.into_iter().map(|(photo, sight)| block_photo(photo, &sight)).collect();
    }
    Ok(())
}

fn block_photo(photo: usize, sight: &Sight) -> BlockPhoto {
    let (corner, size) = sight.part;
    BlockPhoto {
        photo: photo as u32,
        part: [corner.x, corner.y, size.x, size.y],
        // Digits beyond these say nothing.
        cover: (sight.cover * 1e4).round() / 1e4,
    }
}

/// Which triangles of the coarse scene the photos of a block show, in their parts that it is trained on. `[N]`
pub(super) fn visible(
    block: &Block,
    views: &[&View],
    triangles: usize,
    coverage: &mut Coverage<'_>,
) -> Result<Vec<bool>> {
    let mut visible = vec![false; triangles];
    for photo in &block.photos {
        let (corner, size) = photo.corner_and_size();
        let part = views[photo.photo as usize].cropped(corner, size)?;
        coverage.mark_visible(&part.camera, &mut visible);
    }
    Ok(visible)
}
