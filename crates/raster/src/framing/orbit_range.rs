//! How far photos look around a viewpoint's target. An orbit beyond that shows what no photo saw.

use glam::DVec3;
use std::f64::consts::TAU;
use trisplat_scene::camera::{Camera, OrbitRange, Viewpoint};

/// How far an orbit may go beyond the photos, rad: less than most neighbouring photos are apart.
const MARGIN: f64 = 0.26;
/// Photos without a gap wider than this, rad, surround the target.
const GAP: f64 = std::f64::consts::FRAC_PI_2;
/// Fewer photos of the target leave the orbit free.
const LEAST: usize = 3;

/// The range of the photos taken by `cameras` around the target of `viewpoint`. `None` if fewer than half of them show
/// the target, as in a room that is photographed from its middle.
pub(super) fn orbit_range(viewpoint: &Viewpoint, cameras: &[Camera]) -> Option<OrbitRange> {
    let target = DVec3::from(viewpoint.target);
    let here = direction(viewpoint, DVec3::from(viewpoint.eye) - target)?;
    let of_photo = |camera: &Camera| {
        let shows = camera.frames(target.as_vec3());
        shows.then(|| direction(viewpoint, camera.position().as_dvec3() - target)).flatten()
    };
    let photos: Vec<[f64; 2]> = cameras.iter().filter_map(of_photo).collect();
    if photos.len() < LEAST || 2 * photos.len() < cameras.len() {
        return None;
    }
    let elevations = photos.iter().map(|photo| photo[1]).chain([here[1]]);
    let (low, high) = elevations.fold((f64::MAX, f64::MIN), |(low, high), e| (low.min(e), high.max(e)));
    let upright = std::f64::consts::FRAC_PI_2;
    let elevation = [(low - MARGIN).max(-upright), (high + MARGIN).min(upright)].map(f64::to_degrees);
    let turn = turn(photos.iter().map(|photo| photo[0]).collect());
    Some(OrbitRange { turn: turn.map(|turn| turn.map(f64::to_degrees)), elevation })
}

/// The least and largest turn of photos and of the viewpoint itself, which is at 0; `None` if they surround the target.
fn turn(mut photos: Vec<f64>) -> Option<[f64; 2]> {
    photos.push(0.0);
    photos.sort_unstable_by(f64::total_cmp);
    let after = |i: usize| photos.get(i + 1).copied().unwrap_or(photos[0] + TAU);
    let gap = |i: usize| after(i) - photos[i];
    let widest = (0..photos.len()).reduce(|a, b| if gap(b) > gap(a) { b } else { a })?;
    // From the end of the widest gap to its beginning, with the viewpoint's 0 between them.
    let (low, high) = (photos[(widest + 1) % photos.len()], photos[widest]);
    let low = if low > 0.0 { low - TAU } else { low };
    let high = if high < 0.0 { high + TAU } else { high };
    (gap(widest) > GAP).then_some([low - MARGIN, high + MARGIN])
}

/// The turn and elevation of an offset from the target, rad: 0 is the turn of the eye, and more is counter-clockwise seen
/// from above. `None` for an eye right above the target.
fn direction(viewpoint: &Viewpoint, offset: DVec3) -> Option<[f64; 2]> {
    let up = DVec3::from(viewpoint.up);
    let start =
        (DVec3::from(viewpoint.eye) - DVec3::from(viewpoint.target)).reject_from(up).try_normalize()?;
    let turn = libm::atan2(offset.dot(up.cross(start)), offset.dot(start));
    let elevation = libm::asin(offset.try_normalize()?.dot(up).clamp(-1.0, 1.0));
    (turn.is_finite() && elevation.is_finite()).then_some([turn, elevation])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing::LENS;
    use glam::{Mat3, Vec3};

    const VIEWPOINT: Viewpoint = Viewpoint {
        eye: [0.0, 1.0, 4.0],
        target: [0.0, 1.0, 0.0],
        up: [0.0, 1.0, 0.0],
        fov: 50.0,
        radius: None,
        orbit: None,
    };

    /// A camera at some degrees around the target and above it, which looks at it.
    fn at(turn: f32, elevation: f32) -> Camera {
        let (turn, elevation) = (turn.to_radians(), elevation.to_radians());
        let away = Vec3::new(turn.sin() * elevation.cos(), elevation.sin(), turn.cos() * elevation.cos());
        LENS.looking(Vec3::Y + 3.0 * away, Vec3::Y, Vec3::Y)
    }

    fn range(turns: &[f32]) -> Option<OrbitRange> {
        let cameras: Vec<Camera> = turns.iter().map(|turn| at(*turn, 20.0)).collect();
        orbit_range(&VIEWPOINT, &cameras)
    }

    #[test]
    fn photos_of_one_side_bound_the_orbit() {
        let margin = MARGIN.to_degrees();
        for (turns, wants) in [
            (&[-40.0, -10.0, 30.0][..], [-40.0, 30.0]),
            (&[10.0, 20.0, 35.0], [0.0, 35.0]),
            (&[-100.0, -50.0, 60.0, 120.0], [-100.0, 120.0]),
            // Past half a turn.
            (&[60.0, 120.0, 190.0], [0.0, 190.0]),
        ] {
            let OrbitRange { turn, elevation } = range(turns).unwrap();
            let turn = turn.unwrap();
            let off = [turn[0] - wants[0] + margin, turn[1] - wants[1] - margin];
            assert!(off.iter().all(|off| off.abs() < 0.01), "{turns:?}: {turn:?}");
            // The viewpoint itself is level.
            assert!((elevation[0] + margin).abs() < 0.01 && (elevation[1] - 20.0 - margin).abs() < 0.01);
        }
    }

    #[test]
    fn photos_all_around_leave_the_turn_free() {
        let all: Vec<f32> = (0..8).map(|i| 45.0 * i as f32).collect();
        assert_eq!(range(&all).unwrap().turn, None);
    }

    #[test]
    fn photos_of_something_else_leave_the_orbit_free() {
        assert_eq!(range(&[0.0, 10.0]), None, "few");
        let away = |camera: Camera| {
            let turned = Mat3::from_rotation_y(3.0) * camera.rotation;
            Camera { rotation: turned, translation: -(turned * camera.position()), ..camera }
        };
        let cameras: Vec<Camera> = (0..9)
            .map(|i| at(10.0 * i as f32, 0.0))
            .enumerate()
            .map(|(i, c)| if i < 4 { c } else { away(c) })
            .collect();
        assert_eq!(orbit_range(&VIEWPOINT, &cameras), None);
        let above = Viewpoint { eye: [0.0, 9.0, 0.0], ..VIEWPOINT };
        assert_eq!(orbit_range(&above, &[at(0.0, 0.0); 5]), None, "an eye right above has no direction");
    }
}
