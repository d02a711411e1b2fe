//! The effort of each round: its cost is that of its drawings, so large scenes get fewer pictures.

use trisplat_scene::camera::Camera;

/// Preferred number of pictures per round; the next round uses others if there are more. A round judges each
/// triangle alone, so few pictures mislead it: with 12, scenes of 8,000 to 20,000 triangles lost up to 1.9 dB
/// (docs/benchmarks/reshape.md).
const ROUND_VIEWS: u64 = 48;
/// Longest side of the pictures, px: finer detail is not fitted.
const LONGEST_SIDE: u32 = 960;
/// The same for scenes of few triangles, ...
const SHORTEST_SIDE: u32 = 128;
/// ... which need this many pixels per triangle.
const PIXELS_PER_FACE: f64 = 16.0;
/// With fewer pictures, triangles would be fitted to only a few views.
const FEWEST_VIEWS: u64 = 12;
/// Large scenes get fewer rounds than this, even if more are requested.
const USUAL_ROUNDS: u32 = 16;
/// With fewer, nothing would be gained.
const FEWEST_ROUNDS: u32 = 4;
/// Its multiples, less their whole part, never come close to an earlier one.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
/// Most triangles and samples drawn per round, on average. With a quarter, scenes of 360,000 triangles were fitted
/// to too few pictures to gain anything.
const MOST_DRAWN: u64 = 50_000_000;
/// Triangles are cut once per this many rounds, ...
const CUT_EVERY: u32 = 3;
/// ... but only within this first share of the rounds, because the halves must still move.
const CUT_UNTIL: f64 = 0.8;

/// The number of rounds, and the pictures of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Effort {
    pub(super) rounds: u32,
    /// Pictures of a round.
    pub(super) pictures: usize,
    /// Longest side of the pictures, px.
    pub(super) side: u32,
}

impl Effort {
    /// For `faces` and the pictures of `cameras`: large scenes get fewer pictures, and then fewer rounds.
    pub(super) fn new(faces: usize, cameras: &[Camera], rounds: u32) -> Self {
        let side = ((PIXELS_PER_FACE * faces as f64).sqrt() as u32).clamp(SHORTEST_SIDE, LONGEST_SIDE);
        let (faces, views) = (faces as u64, cameras.len() as u64);
        let pixels = |camera: &Camera| camera.within(side).size.as_u64vec2().element_product();
        let pixels = (cameras.iter().map(pixels).sum::<u64>() / views.max(1)).max(1);
        // Every face twice, as it is and moved.
        let per_view = 2 * faces + pixels;
        let pictures = (MOST_DRAWN / per_view).clamp(FEWEST_VIEWS, ROUND_VIEWS).min(views);
        let affordable = MOST_DRAWN * u64::from(rounds.max(USUAL_ROUNDS)) / (pictures.max(1) * per_view);
        let affordable = u32::try_from(affordable).unwrap_or(u32::MAX).max(FEWEST_ROUNDS);
        Self { rounds: affordable.min(rounds), pictures: pictures as usize, side }
    }

    /// The pictures of `round`, of `views`: evenly spaced, and from round to round between those before.
    pub(super) fn chosen(self, round: u32, views: usize) -> Vec<usize> {
        let step = views as f64 / self.pictures as f64;
        let shift = (f64::from(round) * GOLDEN_RATIO).fract();
        (0..self.pictures).map(|k| ((k as f64 + shift) * step) as usize).collect()
    }

    /// Whether triangles are cut after this round.
    pub(super) fn cuts(self, round: u32) -> bool {
        round.is_multiple_of(CUT_EVERY) && f64::from(round) < CUT_UNTIL * f64::from(self.rounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    fn cameras(count: usize, side: u32) -> Vec<Camera> {
        let size = UVec2::splat(side);
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        vec![Camera { rotation, translation, focal: Vec2::ONE, center: size.as_vec2() / 2.0, size }; count]
    }

    #[test]
    fn large_scenes_get_fewer_pictures_and_then_fewer_rounds() {
        let effort = |faces, count, side| Effort::new(faces, &cameras(count, side), 16);
        let plan = |rounds, pictures, side| Effort { rounds, pictures, side };
        assert_eq!(effort(40_000, 40, 300), plan(16, 40, 800));
        assert_eq!(effort(8_000, 96, 360), plan(16, 48, 357), "few triangles need as many pictures");
        assert_eq!(effort(1_000_000, 96, 360), plan(16, 23, 960));
        let larger = effort(5_000_000, 96, 360);
        assert!(larger.pictures == 12 && (FEWEST_ROUNDS..16).contains(&larger.rounds), "{larger:?}");
        assert_eq!(effort(50_000_000, 96, 360), plan(FEWEST_ROUNDS, 12, 960));
        assert_eq!(effort(1, 1, 1), plan(16, 1, 128));
    }

    #[test]
    fn every_round_has_as_many_pictures_and_soon_all_had_their_turn() {
        for (pictures, views) in [(1, 1), (43, 43), (48, 49), (48, 96), (12, 255)] {
            let effort = Effort { rounds: 16, pictures, side: 960 };
            let mut seen = vec![0; views];
            for round in 0..64 {
                let chosen = effort.chosen(round, views);
                assert_eq!(chosen.len(), pictures);
                assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]), "{chosen:?}");
                chosen.iter().for_each(|&view| seen[view] += 1);
            }
            assert!(seen.iter().all(|&count| count > 0), "{pictures} of {views}: {seen:?}");
        }
    }

    #[test]
    fn the_last_rounds_cut_nothing() {
        let effort = Effort { rounds: 16, pictures: 1, side: 960 };
        let cut: Vec<u32> = (1..16).filter(|&round| effort.cuts(round)).collect();
        assert_eq!(cut, [3, 6, 9, 12]);
    }
}
