//! All photos of a run, decoded in the background under a memory budget.
//!
//! Every file is decoded once. Photos beyond the budget are kept, already shrunk, in a cache on
//! disk (a temporary file without a name), and come back at the speed of a copy. What a decoder
//! needs counts too: photos leave memory before the next one is decoded, and one that takes more
//! than the budget is decoded alone.

use super::photo::{Photo, PictureFile, StoredPhoto};
use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use trisplat_scene::image::RgbImage;
use trisplat_scene::input::guarded;
use trisplat_scene::process::release_freed;
use trisplat_scene::{Error, Result};

/// Number of decoding threads, and of the next photos that stay in memory even beyond the budget,
/// so that training does not wait for the disk.
const WORKERS: usize = 2;
/// A taken photo is searched only this near to the front of the queue, because it occurs again
/// later.
const SOON: usize = 8;

/// Decoded photos by index.
#[derive(Debug)]
pub struct Photos {
    shared: Arc<Loader>,
    workers: Vec<JoinHandle<()>>,
}

#[derive(Debug)]
struct Loader {
    photos: Vec<Photo>,
    budget_bytes: u64,
    cache: PictureFile,
    state: Mutex<LoaderState>,
    /// Wakes workers when there may be work.
    work: Condvar,
    /// A photo has been decoded.
    decoded: Condvar,
}

#[derive(Debug, Default)]
struct LoaderState {
    slots: Vec<PhotoSlot>,
    /// The next photos, in order.
    queue: VecDeque<usize>,
    /// The photo that `take` is waiting for.
    awaited: Option<usize>,
    resident_bytes: u64,
    /// Counts takes, to find the least recently taken photo.
    clock: u64,
    decode_count: u64,
    stop: bool,
}

#[derive(Debug, Default)]
struct PhotoSlot {
    pixels: Option<Result<Arc<RgbImage>>>,
    cached: Option<StoredPhoto>,
    loading: bool,
    /// Of what was decoded.
    digest: Option<u64>,
    /// Clock of its last take.
    last_take: u64,
}

impl Photos {
    /// Photos by index; nothing is decoded before [`Photos::prefetch`] or [`Photos::take`].
    pub fn new(photos: Vec<Photo>, budget_bytes: u64) -> Self {
        let slots = photos.iter().map(|_| PhotoSlot::default()).collect();
        let state = Mutex::new(LoaderState { slots, ..LoaderState::default() });
        let cache = PictureFile::default();
        let work = Condvar::new();
        let decoded = Condvar::new();
        let shared = Arc::new(Loader { photos, budget_bytes, cache, state, work, decoded });
        // Drawn pictures need no threads, and some systems have none.
        let worker_count = if shared.photos.iter().all(|photo| photo.pixels_in_memory().is_some()) {
            0
        } else {
            WORKERS
        };
        let start = |_| {
            let shared = Arc::clone(&shared);
            std::thread::Builder::new().spawn(move || shared.work_until_stopped())
        };
        // A system that has no thread left: `take` decodes.
        let workers = (0..worker_count).map_while(|i| start(i).ok()).collect();
        Self { shared, workers }
    }

    /// Number of photos.
    pub fn len(&self) -> usize {
        self.shared.photos.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.shared.photos.is_empty()
    }

    /// Appends the next photos to the queue; threads decode them while memory lasts.
    pub fn prefetch(&mut self, order: impl IntoIterator<Item = usize>) {
        let count = self.len();
        let photos = &self.shared.photos;
        let missing_photos =
            order.into_iter().filter(|&i| i < count && photos[i].pixels_in_memory().is_none());
        self.shared.lock().queue.extend(missing_photos);
        self.shared.work.notify_all();
    }

    /// The photo at index `i`; waits until it is decoded. Fails when its file cannot be decoded.
    pub fn take(&mut self, i: usize) -> Result<Arc<RgbImage>> {
        if i >= self.len() {
            return Err(Error::invalid("photo", i, format!("an index below {}", self.len())));
        }
        if let Some(pixels) = self.shared.photos[i].pixels_in_memory() {
            return Ok(pixels);
        }
        let mut state = self.shared.lock();
        loop {
            if let Some(pixels) = state.slots[i].pixels.take() {
                state.awaited = None;
                let pixels = pixels?;
                state.clock += 1;
                state.slots[i].last_take = state.clock;
                state.slots[i].pixels = Some(Ok(Arc::clone(&pixels)));
                if let Some(at) = state.queue.iter().take(SOON).position(|&next| next == i) {
                    state.queue.remove(at);
                }
                self.shared.work.notify_all();
                return Ok(pixels);
            }
            if self.workers.is_empty() {
                state = self.shared.load(state, i);
                continue;
            }
            state.awaited = Some(i);
            self.shared.work.notify_all();
            state = self.shared.decoded.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The hash of the decoded photo `i`; `None` before it is decoded.
    pub fn digest(&self, i: usize) -> Option<u64> {
        self.shared.lock().slots.get(i)?.digest
    }

    /// Number of files decoded so far.
    pub fn decoded(&self) -> u64 {
        self.shared.lock().decode_count
    }
}

impl Drop for Photos {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.work.notify_all();
        for worker in self.workers.drain(..) {
            // A worker that panicked has nothing left to clean up.
            let _ = worker.join();
        }
    }
}

impl Loader {
    fn lock(&self) -> MutexGuard<'_, LoaderState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The loop of a worker thread.
    fn work_until_stopped(&self) {
        let mut state = self.lock();
        while !state.stop {
            let Some(i) = self.next_job(&state) else {
                state = self.work.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            state = self.load(state, i);
        }
    }

    /// Decodes photo `i`, or reads it back, without the lock.
    fn load<'a>(
        &'a self,
        mut state: MutexGuard<'a, LoaderState>,
        i: usize,
    ) -> MutexGuard<'a, LoaderState> {
        state.slots[i].loading = true;
        self.evict(&mut state, i);
        let cached = state.slots[i].cached;
        let digest = state.slots[i].digest;
        drop(state);
        let cached = cached.and_then(|place| self.cache.get(place).ok());
        let decodes = cached.is_none() && !self.photos[i].is_stored();
        let photo = &self.photos[i];
        // A panic must not leave others waiting for the photo.
        let pixels = cached.map_or_else(|| guarded(&photo.path, || photo.decode()), Ok);
        if decodes {
            // Memory of this thread's decoder would add to that of the other's.
            release_freed();
        }
        // Once, and outside the lock: it reads every byte.
        let digest = digest.or_else(|| pixels.as_ref().ok().map(RgbImage::digest));
        let mut state = self.lock();
        state.decode_count += u64::from(decodes);
        state.slots[i].digest = digest;
        let slot = &mut state.slots[i];
        slot.loading = false;
        let bytes = pixels.as_ref().map_or(0, RgbImage::bytes);
        slot.pixels = Some(pixels.map(Arc::new));
        state.resident_bytes += bytes;
        self.evict(&mut state, i);
        self.decoded.notify_all();
        // There may be memory for another one.
        self.work.notify_all();
        state
    }

    /// Maximum bytes that bringing photo `i` into memory takes.
    fn cost(&self, state: &LoaderState, i: usize) -> u64 {
        let photo = &self.photos[i];
        if state.slots[i].cached.is_some() { photo.most_bytes() } else { photo.decoding_bytes() }
    }

    /// Bytes that are taken, at most, by photos on their way into memory.
    fn loading_bytes(&self, state: &LoaderState) -> u64 {
        let loading = (0..state.slots.len()).filter(|&i| state.slots[i].loading);
        loading.map(|i| self.cost(state, i)).sum()
    }

    /// The most urgent photo: the one waited for, then the next in the queue while memory lasts.
    fn next_job(&self, state: &LoaderState) -> Option<usize> {
        let idle = |i: usize| state.slots[i].pixels.is_none() && !state.slots[i].loading;
        let loading = self.loading_bytes(state);
        // Others can leave for one of the next photos.
        let soon = state.queue.iter().take(WORKERS).chain(&state.awaited).collect::<BTreeSet<_>>();
        let soon_pixels =
            soon.into_iter().filter_map(|&i| state.slots[i].pixels.as_ref()?.as_ref().ok());
        let soon_bytes = soon_pixels.map(|pixels| pixels.bytes()).sum::<u64>();
        let fits =
            |resident: u64, i: usize| resident + loading + self.cost(state, i) <= self.budget_bytes;
        if let Some(i) = state.awaited.filter(|&i| idle(i)) {
            // Also the photo waited for is decoded alone if it does not fit beside another one.
            return (loading == 0 || fits(soon_bytes, i)).then_some(i);
        }
        for (ahead, &i) in state.queue.iter().enumerate() {
            let fits = fits(if ahead < WORKERS { soon_bytes } else { state.resident_bytes }, i);
            if !fits && (ahead >= WORKERS || loading > 0) {
                return None;
            }
            if idle(i) {
                return Some(i);
            }
        }
        None
    }

    /// Moves the least recently taken photos to the disk cache until the budget is met, also by
    /// those on their way, except those needed at once.
    fn evict(&self, state: &mut LoaderState, newest: usize) {
        let loading = self.loading_bytes(state);
        while state.resident_bytes + loading > self.budget_bytes {
            let soon = |i: usize| {
                i == newest
                    || state.awaited == Some(i)
                    || state.queue.iter().take(WORKERS).any(|&e| e == i)
            };
            let resident = |slot: &PhotoSlot| matches!(slot.pixels, Some(Ok(_)));
            let oldest = (0..state.slots.len())
                .filter(|&i| resident(&state.slots[i]) && !soon(i))
                .min_by_key(|&i| state.slots[i].last_take);
            let Some(i) = oldest else { return };
            let Some(Ok(pixels)) = state.slots[i].pixels.take() else { return };
            state.resident_bytes -= pixels.bytes();
            if state.slots[i].cached.is_none() && !self.photos[i].is_stored() {
                // If the disk is full, too, the file is decoded again later.
                state.slots[i].cached = self.cache.put(&pixels).ok();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PhotoBackground;
    use glam::UVec2;
    use std::path::Path;

    const SIZE: UVec2 = UVec2::new(16, 12);

    fn pixels(i: usize) -> RgbImage {
        let rgb = (0..SIZE.x * SIZE.y).map(|k| [i as u8, k as u8, 77]).collect();
        RgbImage { size: SIZE, rgb, alpha: None }
    }

    fn photos(folder: &Path, count: usize) -> Vec<Photo> {
        let photo = |i| {
            let path = folder.join(format!("{i}.png"));
            pixels(i).save_png(&path).unwrap();
            Photo {
                path,
                mask: None,
                depth: None,
                size: SIZE,
                stored: SIZE,
                undistort: None,
                background: PhotoBackground::default(),
                limits: trisplat_scene::Limits::DEFAULT,
                drawn: None,
                cut: false,
                crop: None,
                decoding: 0,
            }
        };
        (0..count).map(photo).collect()
    }

    #[test]
    fn every_file_is_decoded_once_whatever_the_budget() {
        let folder = tempfile::tempdir().unwrap();
        let one = pixels(0).bytes();
        for budget in [0, one, 3 * one, 7 * one, 1 << 30] {
            let mut photos = Photos::new(photos(folder.path(), 20), budget);
            for epoch in 0..4 {
                let order: Vec<usize> = (0..20).map(|k| (k * 7 + epoch * 3) % 20).collect();
                photos.prefetch(order.iter().copied());
                for i in order {
                    assert_eq!(*photos.take(i).unwrap(), pixels(i), "budget {budget}");
                }
            }
            assert_eq!(photos.decoded(), 20, "budget {budget}");
            assert!(
                (0..20).all(|i| photos.digest(i) == Some(pixels(i).digest())),
                "budget {budget}"
            );
            let resident = photos.shared.lock().resident_bytes;
            assert!(resident <= budget + (WORKERS as u64 + 1) * one, "{resident} of {budget}");
        }
    }

    #[test]
    fn taking_without_prefetching_works_and_the_queue_may_be_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let mut photos = Photos::new(photos(folder.path(), 5), 0);
        photos.prefetch([4, 3, 99]);
        for i in [0, 1, 1, 4, 0, 2] {
            assert_eq!(*photos.take(i).unwrap(), pixels(i));
        }
    }

    #[test]
    fn a_broken_file_fails_when_taken_and_the_others_go_on() {
        let folder = tempfile::tempdir().unwrap();
        let list = photos(folder.path(), 3);
        std::fs::write(folder.path().join("1.png"), b"\x89PNG\r\n\x1a\nnothing").unwrap();
        let mut photos = Photos::new(list, 1 << 20);
        photos.prefetch(0..3);
        assert!(photos.take(0).is_ok());
        let message = photos.take(1).unwrap_err().to_string();
        assert!(message.contains("1.png"), "{message}");
        assert!(photos.take(2).is_ok());
        assert!(photos.take(1).is_err(), "still broken");
    }
}
