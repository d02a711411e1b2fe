//! Moves the scene into the frame of a game engine: right-handed, Y up, and, where known or
//! requested, in metres, on its floor, with its median at the origin.
//!
//! Runs after `color`, so that it runs once over plain positions, and before `chunk`, whose boxes
//! must be those of the file.

use evidence::Evidence;
use glam::{DVec3, Vec3};
use ground::Foreground;
use option_values::{KnownLength, UpChoice};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::framing::{ViewpointInput, viewpoint};
use trisplat_raster::kernel::sh::ShRotation;
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::math::geometry::{bounds, central};
use trisplat_scene::math::lists::all_finite;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::{Outcome, counted};
use trisplat_scene::{
    Error, Placement, Provenance, Result, UpAxis, UpDirection, frames, parallel, stored_cameras,
};
use up::{Confidence, UpEstimate};

pub(crate) mod evidence;
mod flat_surface;
pub(crate) mod ground;
mod level_cameras;
pub(crate) mod option_values;
pub(crate) mod up;

/// The frame of the output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct PlaceOptions {
    /// Up direction of the input; the output is Y-up: auto, an axis (x -x y -y z -z) or any
    /// direction as in 0.02,-0.9,0.1. Auto: the direction of the cameras, corrected by the largest
    /// level surface; without cameras that of the file, else y for a mesh, -y for a soup and for
    /// Gaussians (COLMAP and its trainers).
    #[cfg_attr(feature = "cli", arg(long, default_value_t = PlaceOptions::DEFAULT.up, value_name = "UP", allow_hyphen_values = true))]
    #[schemars(with = "String")]
    pub up: UpChoice,
    /// Turn the output about its up axis, degrees, counter-clockwise as seen from above.
    #[cfg_attr(feature = "cli", arg(skip = PlaceOptions::DEFAULT.rotate))]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub rotate: f64,
    /// Output units per input unit.
    #[cfg_attr(feature = "cli", arg(skip = PlaceOptions::DEFAULT.scale))]
    #[schemars(range(min = 1e-9, max = 1e9))]
    pub scale: f64,
    /// Scale so that the output is in metres, by a known length: two points of the input, as
    /// `trisplat view` shows them, or their distance, and the metres between them, as in
    /// 0,1.5,2,0.4,1.5,2=0.25 or 0.4=0.25.
    #[cfg_attr(feature = "cli", arg(long, value_name = "A,B=METRES", allow_hyphen_values = true))]
    #[schemars(with = "Option<String>")]
    pub scale_by: Option<KnownLength>,
    /// Put the middle of the scene (the median of its vertices) at the origin.
    #[cfg_attr(feature = "cli", arg(skip = PlaceOptions::DEFAULT.center))]
    pub center: bool,
    /// Put the floor, the lowest large layer of triangles, at y = 0.
    #[cfg_attr(feature = "cli", arg(skip = PlaceOptions::DEFAULT.ground))]
    pub ground: bool,
}

impl PlaceOptions {
    /// Only turns the up axis.
    pub const DEFAULT: Self = Self {
        up: UpChoice::Auto,
        rotate: 0.0,
        scale: 1.0,
        scale_by: None,
        center: false,
        ground: false,
    };

    /// Checks ranges.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)?;
        if self.scale_by.is_some() && self.scale != 1.0 {
            return Err(Error::invalid("scale_by", "given beside `scale`", "one of the two"));
        }
        Ok(())
    }
}

trisplat_scene::default!(PlaceOptions);

/// Evidence for the up direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum UpBasis {
    /// The option `up`.
    Option,
    /// The file.
    File,
    /// Cameras, and a level surface if there is one.
    Cameras,
    /// Nothing: COLMAP and its trainers mostly have it so.
    Convention,
}

/// The move of the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlaceDetails {
    /// The direction of the input that points up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpDirection>,
    /// The estimate from cameras and surfaces; absent when `up` or the file gave the direction, and
    /// without cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<UpEstimate>,
    /// Evidence for the direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub basis: Option<UpBasis>,
    /// The up direction by the largest nearly level surface, where only convention tells it and
    /// that surface is tilted; not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tilted_floor: Option<[f64; 3]>,
    /// Turn about the up axis, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotate: Option<f64>,
    /// Output units per input unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// The point of the input that is the origin of the output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 3]>,
    /// Height of the floor in the input, along its up direction; only with `ground`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<f64>,
}

trisplat_scene::stage!(PlaceDetails, "place");

impl PlaceDetails {
    /// The direction and what tells it, as in "up -y by 42 cameras, 2° off level, and a surface".
    pub fn basis(&self) -> Option<String> {
        let up = shortened(self.up?.vector());
        let by = match (self.basis?, &self.estimate) {
            (UpBasis::Option, _) => "as given".to_owned(),
            (UpBasis::File, _) => "by the file".to_owned(),
            (UpBasis::Cameras, Some(estimate)) => {
                let surface = if estimate.surface.is_some() { " and a surface" } else { "" };
                let cameras = counted(estimate.cameras, "camera");
                format!("by {cameras}, {:.0}° off level,{surface}", estimate.tilt)
                    .trim_end_matches(',')
                    .to_owned()
            }
            _ => "by convention".to_owned(),
        };
        Some(format!("up {up} {by}"))
    }

    /// Warning if the up axis is a guess, with the option that mends it where one is known.
    pub fn warning(&self) -> Option<String> {
        if let (Some(floor), Some(up)) = (self.tilted_floor.map(DVec3::from), self.up) {
            let degrees = floor.angle_between(up.vector()).to_degrees();
            return Some(format!(
                "nothing tells what is up, taken as {}, and the largest nearly level surface is {degrees:.0}° off: `up` {} levels it",
                shortened(up.vector()),
                shortened(floor)
            ));
        }
        let estimate = self.estimate.as_ref()?;
        if let (Confidence::Low, Some(other)) = (estimate.confidence, estimate.other) {
            return Some(format!(
                "the up axis is a guess, as photos may be upright or on their side: `up` {} if the result lies on its side or its head",
                shortened(other.into())
            ));
        }
        let why = match estimate.confidence {
            Confidence::High => return None,
            Confidence::Low => {
                "the up axis is a guess: the cameras leave it open and there is no large level surface"
            }
            Confidence::None => "the up axis is unknown: the cameras were held in every direction",
        };
        Some(format!("{why}; look at the result and give `up` if it is tilted"))
    }
}

/// The placement by `options`; `evidence` is in the frame of `mesh`.
pub fn placement(
    mesh: &Mesh,
    provenance: &Provenance,
    evidence: Evidence,
    options: &PlaceOptions,
    details: &mut PlaceDetails,
) -> Placement {
    let scene = Foreground::new(mesh, provenance.backdrop_faces);
    let (up, basis) = match (options.up, provenance.up) {
        (UpChoice::Given(up), _) => (up, UpBasis::Option),
        // glTF is Y-up, and so are files of an earlier bake.
        (UpChoice::Auto, Some(UpAxis::Y)) => (UpAxis::Y.into(), UpBasis::File),
        (UpChoice::Auto, said) => {
            details.estimate = up::estimate(scene, evidence).filter(|_| !evidence.are_chosen);
            let usable = details.estimate.as_ref().filter(|e| e.confidence != Confidence::None);
            let known = usable.map(|e| UpDirection::near(DVec3::from(e.direction)));
            match (known, said) {
                (Some(up), _) => (up, UpBasis::Cameras),
                (None, Some(axis)) => (axis.into(), UpBasis::File),
                (None, None) => (provenance.up_axis().into(), UpBasis::Convention),
            }
        }
    };
    details.basis = Some(basis);
    // Meshes are made upright.
    let may_be_tilted = details.estimate.is_none() && provenance.usual_up.is_none();
    if basis == UpBasis::Convention && may_be_tilted {
        details.tilted_floor = up::tilted_floor(scene, up.vector()).map(|floor| floor.to_array());
    }
    // Unlike the middle of the bounds the median does not follow a far background.
    let middle = if options.center { central(scene.vertices()) } else { None };
    let mut center = middle.unwrap_or_default().as_dvec3();
    if options.ground {
        let axis = up.vector();
        details.ground = ground::ground(scene, evidence.cameras, axis);
        center += axis * (details.ground.unwrap_or(0.0) - center.dot(axis));
    }
    let scale = options.scale_by.map_or(options.scale, |length| length.scale());
    Placement { up, rotate: options.rotate, scale, center: center.to_array() }
}

/// A direction as the option `up` takes it, with three places.
fn shortened(direction: DVec3) -> String {
    let rounded = (direction * 1000.0).round() / 1000.0 + 0.0;
    match UpDirection::near(rounded) {
        UpDirection::Vector(_) => format!("{},{},{}", rounded.x, rounded.y, rounded.z),
        axis @ UpDirection::Axis(_) => UpChoice::Given(axis).to_string(),
    }
}

/// Moves `mesh` by `placement`, and records the move in `provenance` so that it can be undone.
///
/// # Errors
///
/// A scale that takes a position out of the range of an f32.
pub fn place(
    mesh: &mut Mesh,
    provenance: &mut Provenance,
    placement: Placement,
    details: &mut PlaceDetails,
) -> Result<Outcome<()>> {
    provenance.up = Some(UpAxis::Y);
    details.up = Some(placement.up);
    if placement == Placement::IDENTITY {
        return Ok(Outcome::Skipped(
            "the input is Y-up already and no other change of its frame was asked for",
        ));
    }
    // The placement leads back to the source, not to the file that was read.
    provenance.placement = provenance.placement.then(&placement);
    let viewpoint = provenance.viewpoint.map(|viewpoint| placement.viewpoint_to_file(&viewpoint));
    provenance.viewpoint = viewpoint.filter(Viewpoint::is_possible);
    let cameras = stored_cameras::decode_cameras(&provenance.cameras);
    let cameras = cameras.iter().map(|camera| frames::to_file(camera, &placement, DVec3::ZERO));
    provenance.cameras = stored_cameras::encode_cameras(&cameras.collect::<Vec<Camera>>());
    details.scale = Some(placement.scale);
    details.center = Some(placement.center);
    details.rotate = (placement.rotate != 0.0).then_some(placement.rotate);
    let transform = placement.transform();
    let blocks = parallel::map(mesh.positions.chunks_mut(1 << 14), |_, positions| {
        for position in positions.iter_mut() {
            *position = transform(*position);
        }
        all_finite(bytemuck::cast_slice(positions))
    });
    let rotation = placement.rotation();
    for normal in &mut mesh.normals {
        *normal = (rotation * normal.as_dvec3()).as_vec3();
    }
    ShRotation::turn(mesh, rotation);
    if !blocks.into_iter().all(|are_finite| are_finite) {
        Err(Error::invalid("scale", placement.scale, "a factor that keeps every position finite"))
    } else {
        Ok(Outcome::Changed(()))
    }
}

// ---- Where a subject stands: the origin is under it, and it faces the viewer --------------------

/// The placement by `options`. The origin of a `subject` is under the middle of its bounds, at the
/// height that it stands on. Unless `options` turn it, the side of the first viewpoint faces +Z,
/// the front of glTF. `evidence` is in the frame of `mesh`.
pub(crate) fn placement_of(
    subject: bool,
    mesh: &Mesh,
    provenance: &Provenance,
    evidence: Evidence,
    options: &PlaceOptions,
    details: &mut PlaceDetails,
) -> Placement {
    if !subject {
        return placement(mesh, provenance, evidence, options, details);
    }
    let grounded = PlaceOptions { ground: true, ..options.clone() };
    let placement = placement(mesh, provenance, evidence, &grounded, details);
    let scene = Foreground::new(mesh, provenance.backdrop_faces);
    details.ground = ground::under(scene, details.ground, placement.up.vector());
    let Some(floor) = details.ground else { return placement };
    let placement = standing(scene, placement, floor);
    // Whoever turns it chooses where it faces.
    let turn = if options.rotate == 0.0 { front(mesh, &placement, evidence.cameras) } else { None };
    turn.map_or(placement, |rotate| standing(scene, Placement { rotate, ..placement }, floor))
}

/// The same placement with the origin under the middle of the bounds, at the height `floor`.
fn standing(scene: Foreground, placement: Placement, floor: f64) -> Placement {
    let turned = Placement { center: [0.0; 3], scale: 1.0, ..placement };
    let turn = turned.transform();
    let [low, high] = bounds(scene.vertices().iter().map(|place| turn(*place))).unwrap_or_default();
    let middle = (low + high) / 2.0;
    let under = turned.to_world_f64(Vec3::new(middle.x, floor as f32, middle.z));
    Placement { center: under.to_array(), ..placement }
}

/// The turn about the up axis, degrees, after which the first viewpoint of a subject placed by
/// `how` is towards +Z. `None` without cameras, which alone know its front.
fn front(mesh: &Mesh, placement: &Placement, cameras: &[Camera]) -> Option<f64> {
    if cameras.is_empty() {
        return None;
    }
    let cameras: Vec<Camera> =
        cameras.iter().map(|c| frames::to_file(c, placement, DVec3::ZERO)).collect();
    let transform = placement.transform();
    let corners = |face: usize| mesh.corners(face).map(&transform);
    let count = mesh.face_count();
    let up = Vec3::Y;
    let is_single_sided = |face: usize| mesh.is_single_sided(face);
    let scenery = ViewpointInput {
        corners: &corners,
        is_single_sided: &is_single_sided,
        count,
        is_surface: false,
        cameras: &cameras,
        up,
        enclosure_distance: &|_| f32::INFINITY,
    };
    let first = viewpoint(&scenery)?.viewpoint;
    let away = DVec3::from(first.eye) - DVec3::from(first.target);
    let turn = -libm::atan2(away.x, away.z).to_degrees();
    turn.is_finite().then_some(turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::mesh::Colors;

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![
                Vec3::new(1.0, 2.0, 3.0),
                Vec3::new(4.0, 5.0, 7.0),
                Vec3::new(-1.0, 0.5, 2.0),
            ],
            colors: Colors::Face(vec![[0.5; 3]]),
            ..Mesh::default()
        }
    }

    const VIEWPOINT: Viewpoint = Viewpoint {
        eye: [1.0, 2.0, 3.0],
        target: [0.0; 3],
        up: [0.0, -1.0, 0.0],
        fov: 40.0,
        radius: Some(0.5),
        orbit: None,
    };

    #[test]
    fn every_axis_goes_up_and_comes_back() {
        for (up, axis) in [
            (UpAxis::X, Vec3::X),
            (UpAxis::NegX, -Vec3::X),
            (UpAxis::Y, Vec3::Y),
            (UpAxis::NegY, -Vec3::Y),
            (UpAxis::Z, Vec3::Z),
            (UpAxis::NegZ, -Vec3::Z),
        ] {
            let placement =
                Placement { up: up.into(), rotate: 25.0, scale: 2.0, center: [1.0, -2.0, 3.0] };
            let origin = placement.to_file(Vec3::new(1.0, -2.0, 3.0));
            let tip = placement.to_file(Vec3::new(1.0, -2.0, 3.0) + axis);
            assert!((tip - origin - 2.0 * Vec3::Y).length() < 1e-6, "{up:?}");
            assert!((up.to_y_up().determinant() - 1.0).abs() < 1e-12, "{up:?} mirrors");
            let there = Vec3::new(0.3, 0.7, -0.9);
            assert!((placement.to_world(placement.to_file(there)) - there).length() < 1e-5);
        }
    }

    #[test]
    fn a_second_run_has_nothing_to_do() {
        let mut mesh = triangle();
        let mut provenance = Provenance { viewpoint: Some(VIEWPOINT), ..Provenance::default() };
        let run = |mesh: &mut Mesh, provenance: &mut Provenance| {
            let mut details = PlaceDetails::default();
            let placement = placement(
                mesh,
                provenance,
                Evidence::default(),
                &PlaceOptions::DEFAULT,
                &mut details,
            );
            place(mesh, provenance, placement, &mut details).unwrap()
        };
        let first = run(&mut mesh, &mut provenance);
        assert_eq!(first, Outcome::Changed(()));
        assert_eq!(mesh.positions[0], Vec3::new(1.0, -2.0, -3.0));
        let placed = Viewpoint { eye: [1.0, -2.0, -3.0], up: [0.0, 1.0, 0.0], ..VIEWPOINT };
        assert_eq!(provenance.viewpoint, Some(placed));
        let again = run(&mut mesh, &mut provenance);
        assert!(matches!(again, Outcome::Skipped(_)));
        assert_eq!(provenance.placement.up, UpAxis::NegY.into());
    }

    #[test]
    fn a_placed_file_placed_again_keeps_the_way_back_to_its_source() {
        let directions = [
            UpAxis::NegY.into(),
            UpDirection::Vector([0.3, -0.9, 0.2]),
            UpDirection::Vector([0.5, 0.5, -0.5]),
        ];
        for (first, second) in directions.iter().flat_map(|a| directions.map(|b| (*a, b))) {
            let one = Placement { up: first, rotate: 30.0, scale: 0.5, center: [100.0, -2.0, 3.0] };
            let two = Placement { up: second, rotate: -170.0, scale: 3.0, center: [0.0, 7.0, 1.0] };
            let both = one.then(&two);
            for world in [Vec3::new(99.0, 1.0, 2.0), Vec3::new(101.5, -3.0, 4.0)] {
                let wants = two.to_file(one.to_file(world));
                let got = both.to_file(world);
                assert!(wants.distance(got) < 1e-4, "{wants} is not {got}");
                assert!(both.to_world(got).distance(world) < 1e-4);
                assert!(both.inverse().to_file(got).distance(world) < 1e-4);
            }
            assert!(
                (one.inverse().then(&both).to_file(Vec3::ONE) - two.to_file(Vec3::ONE)).length()
                    < 1e-4
            );
        }
        let axis = Placement { up: UpAxis::Z.into(), ..Placement::IDENTITY };
        assert_eq!(axis.then(&axis.inverse()), Placement::IDENTITY, "axes stay exact");
    }

    #[test]
    fn the_scene_stands_on_the_ground_in_metres() {
        let mut mesh = Mesh::default();
        for i in 0..400 {
            let corner = Vec3::new((i % 20) as f32 * 0.1, 3.0, (i / 20) as f32 * 0.1);
            mesh.positions.extend([corner, corner + Vec3::X * 0.1, corner + Vec3::Z * 0.1]);
        }
        mesh.colors = Colors::Face(vec![[0.5; 3]; 400]);
        let options = PlaceOptions {
            scale_by: "0,0,0,0,0,2=1".parse().ok(),
            ground: true,
            center: true,
            rotate: 90.0,
            ..PlaceOptions::DEFAULT
        };
        let mut details = PlaceDetails::default();
        let mut provenance = Provenance::default();
        let how = placement(&mesh, &provenance, Evidence::default(), &options, &mut details);
        place(&mut mesh, &mut provenance, how, &mut details).unwrap();
        assert!(details.ground.is_some_and(|height| (height + 3.0).abs() < 1e-3), "{details:?}");
        assert!(
            mesh.positions.iter().all(|p| p.y.abs() < 1e-3 && p.x.abs() < 0.6 && p.z.abs() < 0.6)
        );
        // +x of the output, seen from above, came from where -z was before the turn.
        let turned = how.rotation() * DVec3::X;
        assert!((turned - DVec3::NEG_Z).length() < 1e-12, "{turned}");
        assert!(PlaceOptions { scale: 2.0, ..options.clone() }.validate().is_err(), "two scales");
        assert!(PlaceOptions { rotate: f64::NAN, ..options }.validate().is_err());
    }

    #[test]
    fn a_viewpoint_is_upright_in_the_file() {
        let tilted = UpDirection::near(DVec3::new(0.2, -0.9, -0.3));
        let placement = Placement { up: tilted, ..Placement::IDENTITY };
        assert_eq!(placement.viewpoint_to_file(&VIEWPOINT).up, [0.0, 1.0, 0.0]);
        let from_above = Viewpoint { eye: (tilted.vector() * 5.0).to_array(), ..VIEWPOINT };
        let placed = placement.viewpoint_to_file(&from_above);
        assert!(
            DVec3::from(placed.up).distance(placement.rotation() * DVec3::NEG_Y) < 1e-12,
            "{placed:?}"
        );
    }
}

#[cfg(test)]
mod under_tests {
    use super::option_values::UpChoice;
    use super::place;
    use super::*;
    use glam::UVec2;
    use trisplat_scene::UpAxis;
    use trisplat_scene::camera::Viewpoint;
    use trisplat_scene::mesh::Colors;

    /// A box of small triangles without a bottom, denser on one side: its largest layer is the top.
    fn crate_without_bottom() -> Mesh {
        let mut mesh = Mesh::default();
        let mut wall = |from: Vec3, u: Vec3, v: Vec3, cells: usize| {
            for (i, k) in (0..cells).flat_map(|i| (0..cells).map(move |k| (i, k))) {
                let at = |i: usize, k: usize| from + (u * i as f32 + v * k as f32) / cells as f32;
                mesh.positions.extend([at(i, k), at(i + 1, k), at(i, k + 1)]);
                mesh.positions.extend([at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]);
            }
        };
        let corner = Vec3::new(5.0, 2.0, -1.0);
        wall(corner, Vec3::X, Vec3::Y, 10);
        wall(corner, Vec3::Z, Vec3::Y, 40);
        wall(corner + Vec3::X, Vec3::Z, Vec3::Y, 10);
        wall(corner + Vec3::Z, Vec3::X, Vec3::Y, 10);
        wall(corner + Vec3::Y, Vec3::X, Vec3::Z, 10);
        mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
        mesh
    }

    #[test]
    fn the_origin_is_under_a_subject_without_a_floor() {
        let mut mesh = crate_without_bottom();
        let mut details = PlaceDetails::default();
        let options = PlaceOptions {
            up: UpChoice::Given(UpAxis::Y.into()),
            rotate: 90.0,
            scale: 2.0,
            ..PlaceOptions::DEFAULT
        };
        let mut provenance = Provenance::default();
        let how =
            placement_of(true, &mesh, &provenance, Evidence::default(), &options, &mut details);
        place(&mut mesh, &mut provenance, how, &mut details).unwrap();
        let bounds =
            mesh.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
        let (low, high) = bounds;
        assert!(low.y <= 0.0 && low.y > -0.15 && high.y > 1.85, "{bounds:?}");
        assert!((low.x + high.x).abs() < 1e-4 && (low.z + high.z).abs() < 1e-4, "{bounds:?}");
    }

    #[test]
    fn subject_faces_the_best_photographed_side() {
        let mesh = crate_without_bottom();
        let middle = Vec3::new(5.5, 2.5, -0.5);
        let photo = Viewpoint {
            eye: [0.0; 3],
            target: [1.0; 3],
            up: [0.0, 1.0, 0.0],
            fov: 40.0,
            radius: None,
            orbit: None,
        };
        let photo = photo.camera(UVec2::new(120, 90)).with_look_at(
            middle + Vec3::new(-3.0, 0.5, 1.0),
            middle,
            Vec3::Y,
        );
        let faces = |rotate: f64| {
            let up = UpChoice::Given(UpAxis::Y.into());
            let options = PlaceOptions { up, rotate, ..PlaceOptions::DEFAULT };
            let known = Evidence { cameras: &[photo], ..Evidence::default() };
            let how = placement_of(
                true,
                &mesh,
                &Provenance::default(),
                known,
                &options,
                &mut PlaceDetails::default(),
            );
            (frames::to_file(&photo, &how, DVec3::ZERO).position(), how.rotate)
        };
        let (eye, turn) = faces(0.0);
        assert!(eye.z > 2.5 && eye.x.abs() < 0.2 && turn != 0.0, "{eye} after {turn}");
        let (eye, turn) = faces(30.0);
        assert!(turn == 30.0 && eye.x < -1.0, "{eye} after {turn}");
    }
}
