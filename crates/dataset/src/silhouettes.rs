//! Tell masks that are silhouettes of an object from masks of the lens or of movement.

use super::dataset::{Point, View};
use glam::UVec2;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::parallel;

/// Photos that are looked at.
const PHOTOS: usize = 12;
/// Fewer points of an object say nothing.
const MIN_POINTS: usize = 50;
/// Photos that show a point that counts.
const MIN_OBSERVATIONS: u64 = 3;
/// Smaller masks say nothing: share of the pixels.
const MIN_AREA: f64 = 0.02;
/// Points that three quarters of the photos keep are masked this many times less often than pixels
/// are: 0.006 times in dtu_scan24, 0.001 to 0.08 where masks are those of balls in the sample and
/// three captures, 0.3 to 1.2 for discs at random places.
const MAX_MASKED_RATIO: f64 = 0.16;
/// Silhouettes differ between photos by this share of the masked area, even of a ball in the middle
/// of every photo. What belongs to the lens is always the same.
const MIN_CHANGE: f64 = 0.02;
/// Cells per side in which masks are compared.
const CELLS: u32 = 16;

/// One mask, compared with the tracked points.
struct MaskVotes {
    /// True for each point that it keeps; `None` for points outside the photo.
    keeps: Vec<Option<bool>>,
    /// Masked share of each cell.
    masked: Vec<f64>,
}

/// True if the masks of `views` are the silhouettes of the object that `points` lie on. False where
/// a photo has none.
pub(super) fn are_silhouettes(views: &[View], points: &[Point]) -> bool {
    if points.len() < MIN_POINTS || views.iter().any(|view| view.photo.mask.is_none()) {
        return false;
    }
    let chosen: Vec<&View> = evenly_spaced(views.len(), PHOTOS).map(|i| &views[i]).collect();
    // Who uses the masks reports those that cannot be decoded.
    let seen: Option<Vec<MaskVotes>> =
        parallel::map(&chosen, |_, view| MaskVotes::of(view, points)).into_iter().collect();
    seen.is_some_and(|seen| agree(&seen, points.len()))
}

fn agree(seen: &[MaskVotes], points: usize) -> bool {
    let cells = (CELLS * CELLS) as usize;
    let mean = |of: &dyn Fn(usize) -> f64| (0..cells).map(of).sum::<f64>() / cells as f64;
    let usual =
        |cell: usize| seen.iter().map(|sight| sight.masked[cell]).sum::<f64>() / seen.len() as f64;
    let area = mean(&usual);
    let change = |sight: &MaskVotes| mean(&|cell| (sight.masked[cell] - usual(cell)).abs());
    let change = seen.iter().map(change).sum::<f64>() / seen.len() as f64;
    if area < MIN_AREA || change < MIN_CHANGE * area {
        return false;
    }
    let mut objects = 0;
    let mut shown = 0u64;
    let mut masked = 0u64;
    for point in 0..points {
        let sights = || seen.iter().filter_map(|sight| sight.keeps[point]);
        let all = sights().count() as u64;
        let kept = sights().filter(|keeps| *keeps).count() as u64;
        // Points of the background are masked more often by the silhouettes of an object before
        // them.
        if all >= MIN_OBSERVATIONS && 4 * kept >= 3 * all {
            objects += 1;
            shown += all;
            masked = masked + all - kept;
        }
    }
    objects >= MIN_POINTS && (masked as f64) < MAX_MASKED_RATIO * area * shown as f64
}

impl MaskVotes {
    fn of(view: &View, points: &[Point]) -> Option<Self> {
        let (size, weights) = view.photo.decode_mask().ok()??;
        let camera = view.camera.resized(size);
        let keeps = |point: &Point| {
            let at = camera.project(point.position)?.0.as_uvec2();
            Some(weights[(at.y * size.x + at.x) as usize] > 127)
        };
        let mut cells = vec![(0.0, 0.0); (CELLS * CELLS) as usize];
        for (i, weight) in (0..).zip(&weights) {
            let at = UVec2::new(i % size.x, i / size.x) * CELLS / size;
            let (masked, all) = &mut cells[(at.y * CELLS + at.x) as usize];
            *masked += f64::from(255 - weight) / 255.0;
            *all += 1.0;
        }
        let masked = cells.iter().map(|(masked, all)| masked / f64::max(*all, 1.0)).collect();
        Some(Self { keeps: points.iter().map(keeps).collect(), masked })
    }
}
