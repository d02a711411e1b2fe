//! The training photos at full, half and quarter size, in a fixed random order per epoch.

use glam::UVec2;
use std::sync::Arc;
use trisplat_dataset::{Photos, PictureFile, StoredPhoto, View};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Result, Rng};

/// Minimum shorter side of the smaller photos of early steps, px.
pub(crate) const MIN_PX: u32 = 64;

/// Photos by index and level. Small ones stay in memory, or in a temporary file, while their level
/// is in use.
#[derive(Debug)]
pub(crate) struct Pyramid {
    photos: Photos,
    sizes: Vec<UVec2>,
    cut: Vec<bool>,
    small: Vec<Option<SmallPhoto>>,
    small_bytes: u64,
    small_budget: u64,
    file: PictureFile,
    level: u32,
    min_px: u32,
}

/// A photo at the level in use.
#[derive(Debug, Clone)]
enum SmallPhoto {
    Held(Arc<RgbImage>),
    Stored(StoredPhoto),
}

/// Small photos take a quarter of the memory of the full ones, so they get a fifth of all.
const SMALL_SHARE: u64 = 5;

impl Pyramid {
    /// The photos of `views`, decoded under a budget; none is shrunk below `min_px` on its shorter
    /// side.
    pub(crate) fn new(views: &[&View], budget_bytes: u64, min_px: u32) -> Self {
        let small_budget = budget_bytes / SMALL_SHARE;
        let photos = views.iter().map(|v| v.photo.clone()).collect();
        Self {
            photos: Photos::new(photos, budget_bytes - small_budget),
            sizes: views.iter().map(|v| v.photo.size).collect(),
            cut: views.iter().map(|v| v.photo.is_cut()).collect(),
            small: vec![None; views.len()],
            small_bytes: 0,
            small_budget,
            file: PictureFile::default(),
            level: 0,
            min_px,
        }
    }

    /// The size photo `i` has at `level`.
    pub(crate) fn size(&self, i: usize, level: u32) -> UVec2 {
        size_at(self.sizes[i], level, self.min_px)
    }

    /// True when photo `i` shows an object without background: see
    /// [`Photo::is_cut`](trisplat_dataset::Photo::is_cut).
    pub(crate) fn is_cut(&self, i: usize) -> bool {
        self.cut[i]
    }

    /// Prefetches the photos of an epoch at `level`.
    pub(crate) fn prefetch(&mut self, order: &[usize], level: u32) {
        let cached = |i: usize| level > 0 && level == self.level && self.small[i].is_some();
        let missing: Vec<usize> = order.iter().copied().filter(|&i| !cached(i)).collect();
        self.photos.prefetch(missing);
    }

    /// The hash of photo `i`, if it has been decoded.
    pub(crate) fn digest(&self, i: usize) -> Option<u64> {
        self.photos.digest(i)
    }

    /// Decodes the photos of `known` and returns the first one with another hash. They are not
    /// decoded again later.
    pub(crate) fn first_changed(&mut self, known: &[(usize, u64)]) -> Result<Option<usize>> {
        self.photos.prefetch(known.iter().map(|(i, _)| *i));
        for (i, digest) in known {
            self.photos.take(*i)?;
            if self.photos.digest(*i) != Some(*digest) {
                return Ok(Some(*i));
            }
        }
        Ok(None)
    }

    /// Photo `i` at `level`.
    pub(crate) fn take(&mut self, i: usize, level: u32) -> Result<Arc<RgbImage>> {
        if level != self.level {
            self.small.fill(None);
            self.small_bytes = 0;
            self.file = PictureFile::default();
            self.level = level;
        }
        match self.small.get(i).and_then(Option::as_ref) {
            Some(SmallPhoto::Held(pixels)) => return Ok(Arc::clone(pixels)),
            Some(SmallPhoto::Stored(place)) => {
                if let Ok(pixels) = self.file.get(*place) {
                    return Ok(Arc::new(pixels));
                }
            }
            None => {}
        }
        let full = self.photos.take(i)?;
        let size = self.size(i, level);
        if size == full.size {
            return Ok(full);
        }
        let pixels = Arc::new(full.downscaled(size));
        self.small[i] = self.keep(&pixels);
        Ok(pixels)
    }

    /// Keeps a small photo; `None` without memory and disk space: then it is made again.
    fn keep(&mut self, pixels: &Arc<RgbImage>) -> Option<SmallPhoto> {
        if self.small_bytes + pixels.bytes() > self.small_budget {
            return self.file.put(pixels).ok().map(SmallPhoto::Stored);
        }
        self.small_bytes += pixels.bytes();
        Some(SmallPhoto::Held(Arc::clone(pixels)))
    }
}

/// The size at `level` of a photo of size `full`; its shorter side does not fall below `min_px`.
pub(crate) fn size_at(full: UVec2, level: u32, min_px: u32) -> UVec2 {
    let shorter = full.min_element();
    let level = (0..=level).rev().find(|l| shorter >> l >= min_px).unwrap_or(0);
    (full / (1 << level)).max(UVec2::ONE)
}

/// The order in which epoch `epoch` visits `count` photos: every one once.
pub(crate) fn order(count: usize, seed: u64, epoch: u64) -> Vec<usize> {
    let rng = Rng::new(seed, "photo order", epoch);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&i| (rng.bits(i as u64), i));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_epoch_visits_every_photo_once_in_its_own_order() {
        let mut first = order(43, 7, 0);
        assert_ne!(first, order(43, 7, 1));
        assert_eq!(first, order(43, 7, 0));
        first.sort_unstable();
        assert!(first.into_iter().eq(0..43));
    }
}
