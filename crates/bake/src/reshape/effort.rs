//! The effort of each round: its cost is that of its drawings, so large scenes get fewer pictures.

use trisplat_scene::camera::Camera;

/// Preferred number of pictures per round; the next round uses others.
const ROUND_VIEWS: u64 = 48;
/// Longest side of the pictures, px: finer detail is not fitted.
const LONGEST_SIDE: u32 = 960;
/// The same for scenes of few triangles, ...
const SHORTEST_SIDE: u32 = 128;
/// ... which need this many pixels per triangle.
const PIXELS_PER_FACE: f64 = 32.0;
/// Samples of a round per triangle: more do not measure its effect better.
const ENOUGH_SAMPLES: u64 = 192;
/// With fewer pictures, triangles would be fitted to only a few views.
const FEWEST_VIEWS: u64 = 12;
/// Large scenes get fewer rounds than this, even if more are requested.
const USUAL_ROUNDS: u32 = 16;
/// With fewer, nothing would be gained.
const FEWEST_ROUNDS: u32 = 4;
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
    /// A round uses one picture in this many.
    pub(super) stride: usize,
    /// Longest side of the pictures, px.
    pub(super) side: u32,
}

impl Effort {
    /// For `faces`: enough pictures per round to show each face; large scenes get fewer pictures, and then
    /// fewer rounds.
    pub(super) fn new(faces: usize, cameras: &[Camera], rounds: u32) -> Self {
        let side = ((PIXELS_PER_FACE * faces as f64).sqrt() as u32).clamp(SHORTEST_SIDE, LONGEST_SIDE);
        let (faces, views) = (faces as u64, cameras.len() as u64);
        let pixels = |camera: &Camera| camera.within(side).size.as_u64vec2().element_product();
        let pixels = (cameras.iter().map(pixels).sum::<u64>() / views.max(1)).max(1);
        // Every face twice, as it is and moved.
        let per_view = 2 * faces + pixels;
        let enough = (ENOUGH_SAMPLES * faces).div_ceil(pixels);
        let affordable = MOST_DRAWN / per_view;
        let per_round = enough.min(affordable).clamp(FEWEST_VIEWS, ROUND_VIEWS).min(views).max(1);
        let affordable = MOST_DRAWN * u64::from(rounds.max(USUAL_ROUNDS)) / (per_round * per_view);
        let affordable = u32::try_from(affordable).unwrap_or(u32::MAX).max(FEWEST_ROUNDS);
        Self { rounds: affordable.min(rounds), stride: views.div_ceil(per_round) as usize, side }
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
        let plan = |rounds, stride, side| Effort { rounds, stride, side };
        assert_eq!(effort(40_000, 40, 300), plan(16, 1, 960));
        assert_eq!(effort(10_000, 96, 360), plan(16, 7, 565), "a few pictures show enough");
        let large = effort(1_000_000, 96, 360);
        assert_eq!(large, plan(16, 5, 960));
        let larger = effort(5_000_000, 96, 360);
        assert!(larger.stride == 8 && (FEWEST_ROUNDS..16).contains(&larger.rounds), "{larger:?}");
        assert_eq!(effort(50_000_000, 96, 360), plan(FEWEST_ROUNDS, 8, 960));
        assert_eq!(effort(1, 1, 1), plan(16, 1, 128));
    }

    #[test]
    fn the_last_rounds_cut_nothing() {
        let effort = Effort { rounds: 16, stride: 1, side: 960 };
        let cut: Vec<u32> = (1..16).filter(|&round| effort.cuts(round)).collect();
        assert_eq!(cut, [3, 6, 9, 12]);
    }
}
