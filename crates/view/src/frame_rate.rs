//! Holds a frame rate in motion: if a frame takes too long, fewer samples and then fewer pixels are drawn.

use glam::{UVec2, Vec2};

/// Share of the window's width and height that is drawn, from the best level to the coarsest. The first has
/// the requested samples, the others one per pixel.
const SHARES: [f32; 8] = [1.0, 1.0, 0.875, 0.75, 0.625, 0.5, 0.375, 0.25];
/// Frames whose median decides.
const FRAMES: usize = 5;
/// Frames after a change with times of the previous level: the number in flight, plus one.
const IN_FLIGHT: usize = 5;
/// A finer level is tried when its expected time is at most this share of the limit, so that levels do not
/// alternate.
const SPARE: f64 = 0.85;
/// A coarser level that saves less than this share of the time is given up, because pixels are not the cost.
const WORTH: f64 = 0.1;

/// Chooses the number of pixels so that a frame meets the time limit of the graphics card.
#[derive(Debug, Clone)]
pub(crate) struct FrameRate {
    /// Most milliseconds of a frame.
    budget: f64,
    /// Samples per pixel of the first level.
    msaa: u32,
    level: usize,
    /// Frames whose times are not counted yet.
    skipped: usize,
    times: Vec<f64>,
    /// The level above and its time, when this one is on trial.
    before: Option<(usize, f64)>,
    /// Milliseconds of a frame that stays too slow with fewer pixels.
    too_slow: Option<f64>,
}

impl FrameRate {
    /// For `fps` frames per second, in a window with `msaa` samples per pixel at rest.
    pub(crate) fn new(fps: f64, msaa: u32) -> Self {
        let times = Vec::with_capacity(FRAMES);
        Self { budget: 1e3 / fps, msaa, level: 0, skipped: IN_FLIGHT, times, before: None, too_slow: None }
    }

    /// The frame rate to hold.
    pub(crate) fn fps(&self) -> f64 {
        1e3 / self.budget
    }

    /// The size to draw for a window of `size`, with one sample per pixel; `None` for all of it, with all samples.
    pub(crate) fn size(&self, size: UVec2) -> Option<UVec2> {
        let share = SHARES[self.level];
        let reduced = || (size.as_vec2() * share).round().max(Vec2::ONE).as_uvec2();
        (self.level > 0).then(reduced)
    }

    /// Share of the triangles that would be fast enough, if fewer pixels are not.
    pub(crate) fn triangles_that_would_do(&self) -> Option<f64> {
        self.too_slow.map(|ms| (self.budget / ms).min(1.0))
    }

    /// A frame was drawn in full at rest: the next measurement does not belong to the level.
    pub(crate) fn rests(&mut self) {
        self.skipped = IN_FLIGHT;
        self.times.clear();
    }

    /// The card worked for `ms` on a frame in motion.
    pub(crate) fn took(&mut self, ms: f64) {
        if self.skipped > 0 {
            self.skipped -= 1;
            return;
        }
        self.times.push(ms);
        if self.times.len() == FRAMES {
            self.times.sort_unstable_by(f64::total_cmp);
            let median = self.times[FRAMES / 2];
            self.times.clear();
            self.decide(median);
        }
    }

    fn decide(&mut self, ms: f64) {
        if let Some((level, before)) = self.before.take()
            && ms > (1.0 - WORTH) * before
        {
            self.too_slow = Some(before);
            self.change(level);
        } else if ms <= self.budget {
            self.too_slow = None;
            if self.level > 0 && ms * self.work(self.level - 1) / self.work(self.level) <= SPARE * self.budget
            {
                self.change(self.level - 1);
            }
        } else if self.too_slow.is_none() && self.level + 1 < SHARES.len() {
            let fits = |&level: &usize| ms * self.work(level) / self.work(self.level) <= self.budget;
            let level = (self.level + 1..SHARES.len()).find(fits).unwrap_or(SHARES.len() - 1);
            self.before = Some((self.level, ms));
            self.change(level);
        } else {
            self.too_slow = Some(ms);
        }
    }

    fn change(&mut self, level: usize) {
        self.level = level;
        self.skipped = IN_FLIGHT;
    }

    /// Samples of a level, relative to one for each pixel of the window: at most that much work.
    fn work(&self, level: usize) -> f64 {
        let samples = if level == 0 { f64::from(self.msaa) } else { 1.0 };
        samples * f64::from(SHARES[level]).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: UVec2 = UVec2::new(1600, 800);

    /// Draws frames on a card that takes `fixed` ms and `per_sample` ms for one sample of each pixel of the window; returns the last time.
    fn drive(rate: &mut FrameRate, fixed: f64, per_sample: f64, frames: usize) -> f64 {
        let mut ms = 0.0;
        for _ in 0..frames {
            let samples = rate
                .size(SIZE)
                .map_or(4.0, |size| f64::from(size.element_product()) / f64::from(SIZE.element_product()));
            ms = fixed + per_sample * samples;
            rate.took(ms);
        }
        ms
    }

    #[test]
    fn a_fast_card_draws_everything() {
        let mut rate = FrameRate::new(60.0, 4);
        drive(&mut rate, 2.0, 1.0, 200);
        assert_eq!(rate.size(SIZE), None);
        assert_eq!(rate.triangles_that_would_do(), None);
    }

    #[test]
    fn a_slow_card_draws_as_many_pixels_as_it_can_and_more_when_there_is_less_to_draw() {
        let mut rate = FrameRate::new(60.0, 4);
        let ms = drive(&mut rate, 2.0, 30.0, 400);
        let size = rate.size(SIZE).unwrap();
        assert!(ms <= 1e3 / 60.0, "{ms} ms");
        assert!(size.x >= SIZE.x / 2, "{size}: the card could draw more");
        drive(&mut rate, 2.0, 8.0, 400);
        assert_eq!(rate.size(SIZE), Some(SIZE), "one sample of each pixel takes 10 ms");
        drive(&mut rate, 1.0, 1.0, 400);
        assert_eq!(rate.size(SIZE), None);
    }

    #[test]
    fn where_triangles_cost_pixels_are_not_given_up_and_what_would_do_is_said() {
        let mut rate = FrameRate::new(60.0, 1);
        drive(&mut rate, 40.0, 1.0, 400);
        assert_eq!(rate.size(SIZE), None);
        let share = rate.triangles_that_would_do().unwrap();
        assert!((0.3..0.5).contains(&share), "{share}");
        drive(&mut rate, 5.0, 1.0, 400);
        assert_eq!(rate.triangles_that_would_do(), None);
    }

    #[test]
    fn levels_do_not_alternate() {
        let mut rate = FrameRate::new(60.0, 4);
        drive(&mut rate, 3.0, 20.0, 400);
        let size = rate.size(SIZE);
        for _ in 0..100 {
            drive(&mut rate, 3.0, 20.0, 7);
            assert_eq!(rate.size(SIZE), size);
        }
    }

    #[test]
    fn times_of_frames_at_rest_decide_nothing() {
        let mut rate = FrameRate::new(60.0, 4);
        for _ in 0..100 {
            rate.took(100.0);
            rate.rests();
        }
        assert_eq!(rate.size(SIZE), None);
    }
}
