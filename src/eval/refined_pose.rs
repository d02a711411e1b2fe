//! A held-out pose refined against the scene: the second figure of an evaluation.
//!
//! A pose that is half a pixel off costs a sharp scene more than a blurred one. The camera is turned and moved until
//! its drawing comes closest to the photo, by Gauss-Newton steps over six numbers. The photo is used twice, for its
//! pose and for its score, so the figure stands beside the one with the pose as given and never replaces it.

use crate::camera::Camera;
use crate::image::Pixels;
use crate::math::color_fit::ColorMap;
use crate::math::normal_equations;
use glam::DVec3;

/// Largest turn and largest motion, px, as a training corrects at most.
const MOST_PX: f64 = 3.0;
/// Half the difference of poses by which the change of a drawing is measured, px: at first wide, to see beyond an edge,
/// then narrower, down to the second.
const DIFFERENCES: [f64; 2] = [1.0, 0.25];
/// Most Gauss-Newton steps.
const STEPS: u32 = 12;
/// Steps shorter than this share of the difference want a narrower one.
const SHORT: f64 = 0.2;
/// How often a step that makes the drawing worse is halved.
const HALVINGS: u32 = 3;
/// Damping, as a share of each unknown's own weight: a turn and a motion look nearly alike in a distant scene.
const DAMPING: f64 = 1e-3;

/// A camera with a refined pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct RefinedPose {
    /// The camera.
    pub camera: Camera,
    /// How far it turned and moved, as a distance in the photo of points at the median distance, px.
    pub by_px: f32,
}

/// Turn about the camera's axes, then motion along them, px.
type Motion = [f64; 6];

/// Refines the pose of `given` so that `draw` comes closest to `photo`. A point at distance `unit`, in world units,
/// moves by one pixel when the camera moves by that distance over the focal length.
pub(super) fn refined(
    given: &Camera,
    unit: f64,
    photo: &Pixels,
    mut draw: impl FnMut(&Camera) -> Pixels,
) -> RefinedPose {
    let camera = |at: &Motion| {
        let focal = given.mean_focal();
        let [turn, motion] = [0, 3].map(|k| DVec3::from_slice(&at[k..k + 3]) / focal);
        given.moved(turn, motion * unit)
    };
    let mut at = [0.0; 6];
    let mut drawing = draw(given);
    let mut fit = Fit::new(&drawing, photo);
    let mut difference = DIFFERENCES[0];
    for _ in 0..STEPS {
        let mut beside = |k: usize, by: f64| {
            let mut beside = at;
            beside[k] += by;
            draw(&camera(&beside))
        };
        let slopes =
            std::array::from_fn(|k| fit.slopes(&beside(k, difference), &beside(k, -difference), difference));
        let step = fit.step(&drawing, &slopes, photo);
        let closer = (0..=HALVINGS).find_map(|halved| {
            let share = 0.5f64.powi(halved as i32);
            let next = limited(std::array::from_fn(|k| at[k] + share * step[k]));
            let drawing = draw(&camera(&next));
            let its_fit = Fit::new(&drawing, photo);
            (its_fit.error < fit.error).then_some((next, drawing, its_fit))
        });
        let mut moved = 0.0;
        if let Some((next, its_drawing, its_fit)) = closer {
            moved = length(&std::array::from_fn(|k| next[k] - at[k]));
            (at, drawing, fit) = (next, its_drawing, its_fit);
        }
        if moved < SHORT * difference {
            difference /= 2.0;
            if difference < DIFFERENCES[1] {
                break;
            }
        }
    }
    RefinedPose { camera: camera(&at), by_px: length(&at) as f32 }
}

fn length(motion: &Motion) -> f64 {
    motion.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn limited(at: Motion) -> Motion {
    let [turn, motion] = [0, 3].map(|k| DVec3::from_slice(&at[k..k + 3]).clamp_length_max(MOST_PX));
    [turn.x, turn.y, turn.z, motion.x, motion.y, motion.z]
}

/// How a drawing fits the photo after its colours are corrected.
struct Fit {
    map: ColorMap,
    /// Sum of squared differences.
    error: f64,
}

impl Fit {
    fn new(drawing: &Pixels, photo: &Pixels) -> Self {
        let map = ColorMap::fit(&drawing.rgb, &photo.rgb, photo.alpha.as_deref());
        let error = (0..photo.rgb.len()).map(|i| {
            let difference = difference(map.color(drawing.rgb[i]), encoded(photo.rgb[i]));
            weight(photo, i) * difference.iter().map(|d| d * d).sum::<f64>()
        });
        Self { map, error: error.sum() }
    }

    /// How the corrected colours of each pixel change by one pixel of motion, from drawings `by` px before and behind.
    fn slopes(&self, after: &Pixels, before: &Pixels, by: f64) -> Vec<[f32; 3]> {
        let slope = |(after, before): (&[u8; 3], &[u8; 3])| {
            difference(self.map.color(*after), self.map.color(*before))
                .map(|change| (change / (2.0 * by)) as f32)
        };
        after.rgb.iter().zip(&before.rgb).map(slope).collect()
    }

    /// The motion that brings the drawing closest to the photo, if its colours have these slopes.
    fn step(&self, drawing: &Pixels, slopes: &[Vec<[f32; 3]>; 6], photo: &Pixels) -> Motion {
        let (mut matrix, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
        for i in (0..photo.rgb.len()).filter(|i| weight(photo, *i) > 0.0) {
            let wanted = difference(encoded(photo.rgb[i]), self.map.color(drawing.rgb[i]));
            for (c, wanted) in wanted.into_iter().enumerate() {
                let row = slopes.each_ref().map(|slopes| f64::from(slopes[i][c]));
                normal_equations::add(&mut matrix, &mut right, &row, wanted, weight(photo, i));
            }
        }
        (0..6).for_each(|k| matrix[k][k] *= 1.0 + DAMPING);
        normal_equations::solved(matrix, right)
    }
}

fn weight(photo: &Pixels, i: usize) -> f64 {
    photo.alpha.as_ref().map_or(1.0, |alpha| f64::from(alpha[i]) / 255.0)
}

fn encoded(rgb: [u8; 3]) -> [f64; 3] {
    rgb.map(|c| f64::from(c) / 255.0)
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] - b[c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    /// A wall at distance 2 with smooth waves of colour, and a nearer half.
    fn draw(camera: &Camera) -> Pixels {
        let back = camera.rotation.transpose();
        let eye = camera.position();
        let color = |i: u32| {
            let [x, y] = [i % camera.size.x, i / camera.size.x].map(|k| k as f32 + 0.5);
            let ray = back * ((Vec2::new(x, y) - camera.center) / camera.focal).extend(1.0);
            let far = eye + ray * ((2.0 - eye.z) / ray.z);
            let near = eye + ray * ((1.2 - eye.z) / ray.z);
            let at = if near.x > 0.0 { near * 1.7 } else { far };
            let wave = |a: f32, b: f32| (127.0 + 90.0 * (a * at.x + b * at.y).sin()) as u8;
            [wave(9.0, 2.0), wave(-3.0, 11.0), wave(6.0, 7.0)]
        };
        let rgb = (0..camera.size.element_product()).map(color).collect();
        Pixels { size: camera.size, rgb, alpha: None }
    }

    fn camera() -> Camera {
        Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(100.0),
            center: Vec2::new(48.0, 36.0),
            size: UVec2::new(96, 72),
        }
    }

    fn off(by: f64) -> Camera {
        camera().moved(DVec3::new(0.006, -0.004, 0.003) * by, DVec3::new(-0.01, 0.006, 0.008) * by)
    }

    #[test]
    fn a_pose_that_is_off_is_found_again_whatever_the_exposure() {
        let mut photo = draw(&camera());
        photo.rgb.iter_mut().flatten().for_each(|c| *c = (f64::from(*c) * 0.8 + 9.0) as u8);
        let wrong = off(1.0);
        let found = refined(&wrong, 2.0, &photo, draw);
        let error = |a: &Camera| {
            let seen = |c: &Camera, p: Vec3| {
                let q = c.rotation * p + c.translation;
                q.truncate() / q.z * c.focal
            };
            let points = [Vec3::new(-0.7, -0.5, 2.0), Vec3::new(0.3, 0.2, 1.2), Vec3::new(-0.2, 0.6, 2.0)];
            points.iter().map(|&p| seen(a, p).distance(seen(&camera(), p))).fold(0.0, f32::max)
        };
        assert!(error(&wrong) > 0.5, "{}", error(&wrong));
        assert!(error(&found.camera) < 0.05, "{}", error(&found.camera));
        assert!((0.3..1.5).contains(&found.by_px), "{}", found.by_px);
    }

    #[test]
    fn a_right_pose_stays_and_a_wrong_one_moves_by_three_pixels_at_most() {
        let photo = draw(&camera());
        let found = refined(&camera(), 2.0, &photo, draw);
        assert!(found.by_px < 0.02, "{}", found.by_px);
        let found = refined(&off(9.0), 2.0, &photo, draw);
        assert!(found.by_px <= (2.0f32).sqrt() * 3.0 + 1e-5, "{}", found.by_px);
        let masked = Pixels { alpha: Some(vec![0; photo.rgb.len()]), ..photo };
        assert_eq!(refined(&off(1.0), 2.0, &masked, draw).by_px, 0.0, "nothing to see, nothing to move");
    }
}
