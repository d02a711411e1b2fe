//! The up direction, from the rows of the photos, which people hold level, and the largest level
//! surface.

use super::evidence::Evidence;
use super::flat_surface::largest_surface;
use super::ground::Foreground;
use super::level_cameras::from_cameras;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Above this median tilt, degrees, cameras were held at random.
const RANDOM_TILT: f64 = 20.0;
/// Below this median tilt, degrees, cameras alone are trusted.
const STEADY_TILT: f64 = 8.0;
/// Smallest angle to the up axis, degrees, at which a floor is called tilted.
const MIN_FLOOR_TILT: f64 = 3.0;
/// Largest angle between a level surface and the cameras' estimate, degrees.
const WIDEST_CONE: f64 = 20.0;
/// The same where cameras agree exactly, degrees.
const NARROWEST_CONE: f64 = 5.0;
/// Largest angle between a wall and the cameras that look at it, degrees.
const WIDEST_VIEW: f64 = 60.0;

/// Reliability of an estimate of the up axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Confidence {
    /// Cameras agree, or there is a clear level surface.
    High,
    /// Cameras leave a direction open or tilt much, and no surface helps: check the result.
    Low,
    /// Cameras contradict each other: the estimate was not used.
    None,
}

/// The estimate of the up axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UpEstimate {
    /// The direction of the input that points up; a unit vector.
    pub direction: [f64; 3],
    /// Cameras it was estimated from.
    pub cameras: u64,
    /// Median angle between the rows of the photos and the horizontal, degrees.
    pub tilt: f64,
    /// The surface that decided, if one was clear.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<LevelSurface>,
    /// Another direction that the cameras fit nearly as well: photos may be stored upright or on
    /// their side, turned either way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other: Option<[f64; 3]>,
    /// Reliability.
    pub confidence: Confidence,
}

/// The largest surface that is nearly level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LevelSurface {
    /// Share of the photos' points around the middle of the scene, or, without them, of the
    /// triangles' area there.
    pub share: f64,
    /// Angle to the estimate from cameras alone, degrees.
    pub degrees: f64,
}

/// Estimates the up axis of a scene from the cameras that look at it; `None` without cameras.
///
/// People hold cameras level, so up is at right angles to the rows of the photos: the direction in
/// which the right vectors vary least. A table or floor near that direction is more level than
/// hands are steady, and replaces it.
pub(crate) fn estimate(scene: Foreground, evidence: Evidence) -> Option<UpEstimate> {
    let by_cameras = from_cameras(evidence.cameras)?;
    let cone = if by_cameras.is_open {
        WIDEST_CONE
    } else {
        (4.0 * by_cameras.tilt).clamp(NARROWEST_CONE, WIDEST_CONE)
    };
    let surface = if by_cameras.tilt < RANDOM_TILT {
        largest_surface(scene, evidence, by_cameras.up, cone)
    } else {
        None
    };
    let is_either_way = by_cameras.other.is_some_and(|other| other == -by_cameras.up);
    let confidence = match &surface {
        _ if by_cameras.tilt >= RANDOM_TILT => Confidence::None,
        _ if is_either_way => Confidence::Low,
        Some(_) => Confidence::High,
        None if by_cameras.other.is_some() => Confidence::Low,
        None if !by_cameras.is_open && by_cameras.tilt <= STEADY_TILT => Confidence::High,
        None => Confidence::Low,
    };
    let up = surface.as_ref().map_or(by_cameras.up, |s| s.normal);
    let other = if is_either_way { Some(-up) } else { by_cameras.other };
    let other = other.filter(|_| is_either_way || surface.is_none()).map(|up| up.to_array());
    let surface = surface.map(|s| LevelSurface {
        share: s.share,
        degrees: s.normal.angle_between(by_cameras.up).to_degrees(),
    });
    let cameras = evidence.cameras.len() as u64;
    Some(UpEstimate {
        direction: up.to_array(),
        cameras,
        tilt: by_cameras.tilt,
        surface,
        other,
        confidence,
    })
}

/// The normal of the largest nearly level surface of a scene whose `up` nothing tells, if it is
/// tilted to that.
pub(crate) fn tilted_floor(scene: Foreground, up: DVec3) -> Option<DVec3> {
    let floor = largest_surface(scene, Evidence::default(), up, WIDEST_CONE)?;
    (floor.normal.angle_between(up).to_degrees() > MIN_FLOOR_TILT).then_some(floor.normal)
}

/// The normal of the largest flat surface, such as a wall, that faces the direction `to_cameras`;
/// `None` without a clear one.
pub(crate) fn wall_normal(
    scene: Foreground,
    evidence: Evidence,
    to_cameras: DVec3,
) -> Option<DVec3> {
    largest_surface(scene, evidence, to_cameras, WIDEST_VIEW).map(|wall| wall.normal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::camera::Camera;
    use trisplat_scene::mesh::{Colors, Mesh};

    const CAMERA: Camera = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(50.0),
        size: UVec2::splat(100),
    };

    /// Cameras on a ring around the origin, held level except for `roll(i)` radians.
    fn ring(count: usize, up: Vec3, roll: impl Fn(usize) -> f32) -> Vec<Camera> {
        let x = up.any_orthonormal_vector();
        let y = up.cross(x);
        let camera = |i: usize| {
            let angle = i as f32 * 2.4;
            let eye = 5.0 * (x * angle.cos() + y * angle.sin()) + up * (1.0 + (i % 3) as f32);
            let level = CAMERA.with_look_at(eye, Vec3::ZERO, up);
            let rotation = Mat3::from_rotation_z(roll(i)) * level.rotation;
            Camera { rotation, translation: -(rotation * eye), ..level }
        };
        (0..count).map(camera).collect()
    }

    /// A bumpy disc of small triangles around the origin at right angles to `normal`, and as many
    /// anywhere.
    fn table(normal: Vec3, count: u64) -> Mesh {
        let rng = Rng::new(1, "table", 0);
        let x = normal.any_orthonormal_vector();
        let y = normal.cross(x);
        let random = |i: u64| 2.0 * rng.uniform(i) - 1.0;
        let positions = (0..count).flat_map(|i| {
            let at = |k: u64| random(16 * i + k);
            let middle = match i % 2 {
                0 => 3.0 * (x * at(0) + y * at(1)) + normal * 0.01 * at(2),
                _ => 3.0 * Vec3::new(at(0), at(1), at(2)),
            };
            [0, 1, 2].map(|corner| {
                let [a, b, c] = [0, 1, 2].map(|k| at(3 + 3 * corner + k));
                middle
                    + 0.05
                        * if i % 2 == 0 {
                            x * a + y * b + normal * 0.3 * c
                        } else {
                            Vec3::new(a, b, c)
                        }
            })
        });
        let positions: Vec<Vec3> = positions.collect();
        Mesh { colors: Colors::Face(vec![[0.5; 3]; count as usize]), positions, ..Mesh::default() }
    }

    fn estimate_of(mesh: &Mesh, cameras: &[Camera]) -> Option<UpEstimate> {
        estimate(Foreground::new(mesh, 0), Evidence { cameras, ..Evidence::default() })
    }

    fn degrees(estimate: &UpEstimate, up: Vec3) -> f64 {
        DVec3::from(estimate.direction).angle_between(up.as_dvec3()).to_degrees()
    }

    #[test]
    fn up_axis_of_level_cameras_is_normal_to_their_rows() {
        for up in [Vec3::NEG_Y, Vec3::Z, Vec3::new(0.3, -0.8, 0.5).normalize()] {
            let wobble = |i: usize| 0.05 * ((i * 7 % 11) as f32 - 5.0) / 5.0;
            let found =
                estimate_of(&Mesh::default(), &ring(40, up, wobble)).expect("there are cameras");
            assert!(degrees(&found, up) < 1.5, "{up}: {found:?}");
            assert!(
                (0.5..3.0).contains(&found.tilt) && found.confidence == Confidence::High,
                "{found:?}"
            );
        }
        assert_eq!(estimate_of(&Mesh::default(), &[]), None);
    }

    #[test]
    fn pictures_taken_with_the_camera_on_its_side_do_not_count() {
        let up = Vec3::new(0.1, -0.9, 0.2).normalize();
        let quarter = |i: usize| if i.is_multiple_of(3) { 1.57 } else { 0.01 * (i % 5) as f32 };
        let found =
            estimate_of(&Mesh::default(), &ring(30, up, quarter)).expect("there are cameras");
        assert!(degrees(&found, up) < 1.5 && found.confidence == Confidence::High, "{found:?}");
        // All of them on the same side, either way.
        for side in [1.57, -1.57] {
            let found =
                estimate_of(&Mesh::default(), &ring(30, up, |i| side + 0.01 * (i % 5) as f32));
            let found = found.expect("there are cameras");
            assert!(
                degrees(&found, up) < 1.5 && found.confidence == Confidence::High,
                "{side}: {found:?}"
            );
        }
    }

    #[test]
    fn photos_on_their_side_among_tilted_ones_are_known_by_their_columns() {
        // Nine of ten on their side, some tilted by the hand that turned them.
        let up = Vec3::new(0.9, 0.15, 0.4).normalize();
        let roll = |i: usize| {
            if i.is_multiple_of(10) { 0.0 } else { 1.57 + 0.06 * ((i % 5) as f32 - 2.0) }
        };
        let found = estimate_of(&Mesh::default(), &ring(77, up, roll)).expect("cameras");
        assert!(degrees(&found, up) < 3.0, "{found:?}");
        assert_eq!((found.confidence, found.other), (Confidence::High, None), "{found:?}");
        // Nearly level cameras do not tell which side is up.
        let level: Vec<Camera> = (0..20)
            .map(|i| {
                let angle = i as f32 * 2.4;
                let eye = 5.0 * Vec3::new(angle.cos(), 0.05, angle.sin());
                let upright = CAMERA.with_look_at(eye, Vec3::ZERO, Vec3::Y);
                let rotation = Mat3::from_rotation_z(1.57) * upright.rotation;
                Camera { rotation, translation: -(rotation * eye), ..upright }
            })
            .collect();
        let found = estimate_of(&Mesh::default(), &level).expect("cameras");
        let other = DVec3::from(found.other.expect("the other way"));
        assert!(found.confidence == Confidence::Low && other.y.abs() > 0.99, "{found:?}");
    }

    #[test]
    fn a_tilted_floor_is_named_and_a_level_one_is_not() {
        let tilted = Mat3::from_rotation_x(0.2) * Vec3::NEG_Y;
        let mesh = table(tilted, 6000);
        let floor = tilted_floor(Foreground::new(&mesh, 0), DVec3::NEG_Y).expect("a floor");
        assert!(floor.angle_between(tilted.as_dvec3()).to_degrees() < 1.0, "{floor}");
        let level = table(Vec3::NEG_Y, 6000);
        assert_eq!(tilted_floor(Foreground::new(&level, 0), DVec3::NEG_Y), None);
    }

    #[test]
    fn a_table_corrects_hands_and_a_slanted_or_missing_one_does_not() {
        let up = Vec3::NEG_Y;
        let tilted = |degrees: f32| Mat3::from_rotation_x(degrees.to_radians()) * up;
        let cameras = ring(24, up, |i| 0.06 * (i % 5) as f32 - 0.12);
        let corrected = estimate_of(&table(tilted(4.0), 6000), &cameras).expect("cameras");
        assert!(degrees(&corrected, tilted(4.0)) < 0.5, "{corrected:?}");
        let surface = corrected.surface.expect("a clear surface");
        assert!(surface.share > 0.2 && (2.0..6.5).contains(&surface.degrees), "{surface:?}");
        for other in [table(tilted(40.0), 6000), table(tilted(4.0), 0)] {
            let alone = estimate_of(&other, &cameras).expect("cameras");
            assert!(alone.surface.is_none() && degrees(&alone, up) < 3.0, "{alone:?}");
        }
    }

    #[test]
    fn doubt_is_named() {
        let up = Vec3::NEG_Y;
        let one = estimate_of(&Mesh::default(), &ring(1, up, |_| 0.0)).expect("a camera");
        assert_eq!(one.confidence, Confidence::Low);
        let alike: Vec<Camera> = (0..9).map(|_| CAMERA).collect();
        let alike = estimate_of(&Mesh::default(), &alike).expect("cameras");
        assert_eq!(alike.confidence, Confidence::Low);
        assert!(degrees(&alike, up) < 1e-6, "the columns decide: {alike:?}");
        let random =
            estimate_of(&Mesh::default(), &ring(60, up, |i| i as f32 * 1.7)).expect("cameras");
        assert_eq!(random.confidence, Confidence::None, "{random:?}");
    }

    #[test]
    fn the_ground_below_cameras_that_look_straight_down_is_below() {
        let eye = |i: usize| Vec3::new((i % 4) as f32, (i / 4) as f32, 5.0 + 0.1 * (i % 3) as f32);
        let down = |i: usize| {
            let toward = eye(i) - Vec3::new(0.02 * (i % 5) as f32, 0.03 * (i % 3) as f32, 1.0);
            // Flown in every direction.
            let heading = Vec3::new((i as f32 * 0.8).cos(), (i as f32 * 0.8).sin(), 0.0);
            CAMERA.with_look_at(eye(i), toward, heading)
        };
        let cameras: Vec<Camera> = (0..16).map(down).collect();
        let found = estimate_of(&table(Vec3::Z, 6000), &cameras).expect("cameras");
        assert!(
            degrees(&found, Vec3::Z) < 1.0 && found.confidence == Confidence::High,
            "{found:?}"
        );
    }

    #[test]
    fn points_of_the_photos_show_a_surface_that_triangles_do_not() {
        let up = Vec3::NEG_Y;
        let slab = Mat3::from_rotation_z(0.08) * up;
        let points = table(slab, 3000).positions;
        let cameras = ring(24, up, |i| 0.06 * (i % 5) as f32 - 0.12);
        let known = Evidence { cameras: &cameras, points: &points, are_chosen: false };
        let found = estimate(Foreground::new(&Mesh::default(), 0), known).expect("cameras");
        assert!(found.surface.is_some() && degrees(&found, slab) < 0.5, "{found:?}");
    }

    #[test]
    fn a_capture_in_another_frame_has_the_same_up() {
        let up = Vec3::new(0.1, -0.95, 0.2).normalize();
        let cameras = ring(30, up, |i| 0.04 * (i % 7) as f32 - 0.1);
        let turn = Mat3::from_rotation_y(2.0) * Mat3::from_rotation_x(-1.3);
        let moved: Vec<Camera> = cameras
            .iter()
            .map(|c| {
                let rotation = c.rotation * turn.transpose();
                let eye = turn * c.position() + Vec3::new(5.0, -3.0, 20.0);
                Camera { rotation, translation: -(rotation * eye), ..*c }
            })
            .collect();
        let here = estimate_of(&Mesh::default(), &cameras);
        let there = estimate_of(&Mesh::default(), &moved);
        let here = here.expect("cameras");
        let there = there.expect("cameras");
        let turned = turn.as_dmat3() * DVec3::from(here.direction);
        let off = turned.angle_between(DVec3::from(there.direction)).to_degrees();
        assert!(off < 0.01, "{off}°: {here:?} {there:?}");
    }

    /// Up of a real capture, as a vector of its world: by the model of a folder and by its
    /// `transforms.json`.
    #[test]
    fn colmap_and_transforms_of_a_folder_agree_and_stand_upright() {
        use std::io::Write as _;
        use trisplat_dataset::{Dataset, DatasetOptions};
        let data =
            std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
        // Up as picked by hand in the photos: the edge of a picture frame on the wall, walls of a
        // house, a carpet, a table.
        let picked = [
            ("fox480", [0.051, -0.090, 0.994]),
            ("dtu_scan24", [0.092, -0.377, -0.922]),
            ("banana", [0.025, -0.881, -0.473]),
            ("bonsai", [-0.160, -0.826, -0.540]),
        ];
        for (name, truth) in picked {
            if !data.join(name).is_dir() {
                let _ = writeln!(std::io::stderr(), "SKIPPED (no ../shared/data/{name})");
                continue;
            }
            let options = DatasetOptions::default();
            let up = |path: &std::path::Path, with_points: bool| {
                let dataset = Dataset::load(path, &options).expect(name);
                let cameras: Vec<Camera> = dataset.views.iter().map(|v| v.camera).collect();
                let points: Vec<Vec3> = dataset.points.iter().map(|p| p.position).collect();
                let points = if with_points { points } else { Vec::new() };
                let known = Evidence { cameras: &cameras, points: &points, are_chosen: false };
                let found = estimate(Foreground::new(&Mesh::default(), 0), known).expect("cameras");
                let mut named: Vec<_> =
                    dataset.views.iter().map(|v| (v.name.clone(), v.camera)).collect();
                named.sort_by(|a, b| a.0.cmp(&b.0));
                (found, named)
            };
            let (by_points, named) = up(&data.join(name), true);
            let (by_cameras, _) = up(&data.join(name), false);
            let angle = |found: &UpEstimate| degrees(found, Vec3::from(truth.map(|x| x as f32)));
            assert!(angle(&by_points) < 5.0, "{name}: {}°", angle(&by_points));
            assert!(angle(&by_cameras) < 6.0, "{name}: {}°", angle(&by_cameras));
            // The same photos seen from the other file: the turn between the worlds is that of any
            // camera.
            let (other, others) = up(&data.join(name).join("transforms.json"), false);
            let same: Vec<_> = named
                .iter()
                .filter_map(|(name, c)| {
                    others.iter().find(|(n, _)| n.ends_with(name.as_str())).map(|(_, o)| (c, o))
                })
                .collect();
            assert!(
                same.len() == others.len() && same.len() > 10,
                "{name}: {} of {}",
                same.len(),
                others.len()
            );
            let turn = (same[0].1.rotation.transpose() * same[0].0.rotation).as_dmat3();
            let turned = turn * DVec3::from(by_cameras.direction);
            let off = turned.angle_between(DVec3::from(other.direction)).to_degrees();
            assert!(off < 0.5, "{name}: {off}° between the two files");
        }
    }
}
