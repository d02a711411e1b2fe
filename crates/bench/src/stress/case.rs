//! A case: a seed and a value on every axis. From it follows the scene that is drawn: few triangles
//! in a picture of 16 x 16 px, made in double precision and then rounded.

use super::axes::{AXES, Axis, AxisRow, DEEP_EVERY};
use super::promises::{On, REACH, domain};
use glam::{DMat3, DQuat, DVec2, DVec3, UVec2, Vec2};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use trisplat_raster::soft::SoftOptions;
use trisplat_raster::solid::SolidRasterOptions;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Error, Result, Rng, Soup};

/// A case of the stress test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StressCase {
    /// Seed of its triangles' places.
    pub(super) seed: u64,
    /// Its values; ordinary on every other axis.
    #[serde(default)]
    pub(super) axes: BTreeMap<Axis, f64>,
}

/// Choice of the axes of a random case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stretch {
    /// One axis, over all of its range.
    Single(Axis),
    /// Two axes, over all of their ranges.
    Pair(Axis, Axis),
    /// Two axes, over the ranges of the promises.
    PromisedPair(Axis, Axis),
    /// All axes at once, over the ranges of the promises.
    Promised,
}

impl StressCase {
    /// Its value on an axis.
    pub(super) fn value(&self, axis: Axis) -> f64 {
        self.axes.get(&axis).copied().unwrap_or(axis.row().ordinary)
    }

    /// A case from JSON.
    ///
    /// # Errors
    /// Other text; a value that does not lie on its axis.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let wants = |e: serde_json::Error| {
            format!("a case as in {{\"seed\": 1, \"axes\": {{\"sigma\": 0.5}}}} ({e})")
        };
        let case: Self =
            serde_json::from_str(text).map_err(|e| Error::invalid("case", text, wants(e)))?;
        case.validate()?;
        Ok(case)
    }

    /// The case as [`Self::parse`] reads it.
    pub(super) fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// True when every value lies in the promises' domain.
    pub(super) fn is_promised(&self) -> bool {
        let inside = |row: &AxisRow| {
            let (least, most) = domain(row.axis);
            (least..=most).contains(&self.value(row.axis))
        };
        AXES.iter().all(inside)
    }

    /// True if a promise on such cases holds for this one, which may be drawn from the promises'
    /// domain.
    pub(super) fn is_on(&self, on: On, promised: bool) -> bool {
        let side = || self.value(Axis::Aspect) * self.value(Axis::Inradius).max(1.0);
        match on {
            On::Domain => promised,
            On::Reach => side() / self.value(Axis::Focal) <= REACH,
            On::Everything => true,
        }
    }

    fn validate(&self) -> Result<()> {
        for (axis, value) in &self.axes {
            let row = axis.row();
            if !(row.least..=row.most).contains(value) {
                let wants = format!("{} to {}", row.least, row.most);
                return Err(Error::invalid(format!("axis {}", row.name), value, wants));
            }
        }
        Ok(())
    }

    /// Random case number `index` of a run, and how it was stretched. One in four of each kind.
    pub(super) fn random(seed: u64, index: u64) -> (Self, Stretch) {
        let rng = Rng::new(seed, "stress", index);
        let count = AXES.len() as u64;
        let first = rng.bits(0) % count;
        // Another one.
        let second = (first + 1 + rng.bits(1) % (count - 1)) % count;
        let [a, b] = [first, second].map(|i| AXES[i as usize].axis);
        let stretch = match index % 4 {
            0 => Stretch::Single(a),
            1 => Stretch::Pair(a, b),
            2 => Stretch::PromisedPair(a, b),
            _ => Stretch::Promised,
        };
        let at = |axis: Axis| rng.uniform_f64(10 + axis as u64);
        let deep = rng.bits(3).is_multiple_of(DEEP_EVERY);
        let full = |axis: Axis, alone: bool| {
            let row = axis.row();
            let most =
                if alone && (axis != Axis::Layers || deep) { row.most } else { row.most_in_pairs };
            (axis, row.between(row.least, most, at(axis)))
        };
        let promised = |axis: Axis| {
            let (least, most) = domain(axis);
            (axis, axis.row().between(least, most.min(axis.row().most_in_pairs), at(axis)))
        };
        let axes = match stretch {
            Stretch::Single(a) => BTreeMap::from([full(a, true)]),
            Stretch::Pair(a, b) => BTreeMap::from([full(a, false), full(b, false)]),
            Stretch::PromisedPair(a, b) => BTreeMap::from([promised(a), promised(b)]),
            Stretch::Promised => AXES.iter().map(|row| promised(row.axis)).collect(),
        };
        (Self { seed: rng.bits(2) >> 11, axes }, stretch)
    }
}

/// Width and height of the pictures, px.
pub(super) const SIDE: u32 = 16;
/// Depth of the nearest triangles, scene units.
const NEAREST: f64 = 2.0;
/// Depth of the near plane, scene units.
const NEAR: f64 = 0.01;
/// Cases with more triangles have all of them over the middle.
const FEW: f64 = 8.0;
/// SH degree of the triangles.
const DEGREE: u8 = 3;

/// Scene and its rendering.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StressScene {
    /// The triangles.
    pub(super) soup: Soup,
    /// The camera.
    pub(super) camera: Camera,
    /// Options of the rasteriser.
    pub(super) options: SoftOptions,
}

impl StressScene {
    /// The scene of a case.
    pub(super) fn new(case: &StressCase) -> Self {
        let rng = Rng::new(case.seed, "stress scene", 0);
        let at = |n: u64| rng.uniform_f64(n) * 2.0 - 1.0;
        let axis = DVec3::new(at(0), at(1), at(2)).normalize_or(DVec3::Z);
        // Rounded first: what is made below is seen by the camera that there is.
        let rotation = DMat3::from_quat(DQuat::from_axis_angle(axis, 3.0 * at(3))).as_mat3();
        let away = DVec3::new(at(4), at(5), at(6)).normalize_or(DVec3::X);
        let scale = case.value(Axis::Scale);
        let eye = away * case.value(Axis::Distance);
        let translation = (-(rotation.as_dmat3() * eye) * scale).as_vec3();
        let camera = Camera {
            rotation,
            translation,
            focal: Vec2::splat(case.value(Axis::Focal) as f32),
            center: DVec2::new(0.5 * f64::from(SIDE) + at(7), 0.5 * f64::from(SIDE) + at(8))
                .as_vec2(),
            size: UVec2::splat(SIDE),
        };
        let options = SoftOptions {
            background: [0.2, 0.5, 0.9],
            near: (NEAR * scale) as f32,
            ..SoftOptions::default()
        };
        let soup = soup(case, &camera, eye, scale);
        Self { soup, camera, options }
    }

    /// The same triangles as a mesh, and how the solid rasteriser draws them.
    pub(super) fn solid(&self) -> (Mesh, SolidRasterOptions) {
        let positions = self.soup.vertices.as_flattened().to_vec();
        let colors = Colors::Face(vec![[0.5; 3]; self.soup.len()]);
        let options =
            SolidRasterOptions { near: self.options.near, ..SolidRasterOptions::default() };
        (Mesh { positions, colors, ..Mesh::default() }, options)
    }
}

/// The triangles that a camera at `eye`, before everything is scaled, sees where the case says.
fn soup(case: &StressCase, camera: &Camera, eye: DVec3, scale: f64) -> Soup {
    let back = camera.rotation.as_dmat3().transpose();
    let count = case.value(Axis::Layers).round();
    let mut soup = Soup { sh_degree: DEGREE, ..Soup::default() };
    for k in 0..count as u64 {
        let rng = Rng::new(case.seed, "stress triangle", k);
        let at = |n: u64| rng.uniform_f64(n) * 2.0 - 1.0;
        let depth = depth(case, k, rng.uniform_f64(0));
        let outline = outline(case, &rng, count > FEW);
        let moved = if k % 2 == 0 { rng.bits(1) % 6 } else { 6 };
        let corner = |i: u64| {
            let slant = if case.value(Axis::Gap) < 1.0 { 1.0 } else { (0.3 * at(20 + i)).exp() };
            let z = depth * slant;
            let ray = (outline[i as usize] - camera.center.as_dvec2()) / camera.focal.as_dvec2();
            // Corner 0, 1, 2, or the two others.
            let behind = moved == i || (3..6).contains(&moved) && moved != i + 3;
            let z_moved = if behind { z * (1.0 - 2.0 * case.value(Axis::Behind)) } else { z };
            ((back * (ray * z).extend(z_moved) + eye) * scale).as_vec3()
        };
        soup.vertices.push([corner(0), corner(1), corner(2)]);
        let spread = |n: u64| if k % 2 == 0 { 1.0 } else { (0.3 * at(n)).exp() };
        soup.opacity.push(case.value(Axis::Opacity).powf(spread(2)).min(1.0) as f32);
        let sigma = Axis::Sigma.row();
        soup.sigma
            .push((case.value(Axis::Sigma) * spread(3)).clamp(sigma.least, sigma.most) as f32);
        let size = case.value(Axis::Sh);
        let coefficients = (u64::from(DEGREE) + 1).pow(2);
        soup.sh.extend(
            (0..coefficients).map(|n| [0, 1, 2].map(|c| (size * at(30 + 3 * n + c)) as f32)),
        );
    }
    soup
}

/// Depth of triangle `k`, scene units; `share` is its place between nearest and farthest.
fn depth(case: &StressCase, k: u64, share: f64) -> f64 {
    let gap = case.value(Axis::Gap);
    if gap < 1.0 {
        return NEAREST * (1.0 + gap * k as f64);
    }
    let share = if k < 2 { k as f64 } else { share };
    NEAREST * case.value(Axis::DepthRatio).powf(share)
}

/// Corners on the screen of a triangle of the wanted inradius and aspect, px.
fn outline(case: &StressCase, rng: &Rng, in_the_middle: bool) -> [DVec2; 3] {
    let at = |n: u64| rng.uniform_f64(n) * 2.0 - 1.0;
    let inradius = case.value(Axis::Inradius) * (0.3 * at(10)).exp();
    let base = case.value(Axis::Aspect);
    let flat = [DVec2::ZERO, DVec2::new(base, 0.0), DVec2::new(base * (0.5 + 0.4 * at(11)), 1.0)];
    let opposite =
        [flat[1].distance(flat[2]), flat[2].distance(flat[0]), flat[0].distance(flat[1])];
    let perimeter = opposite.iter().sum::<f64>();
    let incenter =
        (flat[0] * opposite[0] + flat[1] * opposite[1] + flat[2] * opposite[2]) / perimeter;
    // The inradius of a triangle of this base and height 1 is its base over its perimeter.
    let size = inradius * perimeter / base;
    let turn = DVec2::from_angle(std::f64::consts::PI * at(12));
    let reach = if in_the_middle { (0.5 * inradius).min(6.0) } else { 6.0 };
    let middle = DVec2::splat(0.5 * f64::from(SIDE)) + reach * DVec2::new(at(13), at(14));
    flat.map(|corner| middle + turn.rotate((corner - incenter) * size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_raster::kernel::splat::{CameraTriangle, splat};
    use trisplat_scene::math::real::{V2, V3};

    #[test]
    fn random_cases_lie_on_their_axes_and_stretch_what_they_say() {
        for index in 0..4000 {
            let (case, stretch) = StressCase::random(3, index);
            case.validate().unwrap();
            let stretched = match stretch {
                Stretch::Single(a) => vec![a],
                Stretch::Pair(a, b) | Stretch::PromisedPair(a, b) => vec![a, b],
                Stretch::Promised => AXES.map(|row| row.axis).to_vec(),
            };
            assert_eq!(case.axes.len(), stretched.len(), "{stretch:?}");
            assert!(stretched.iter().all(|axis| case.axes.contains_key(axis)), "{stretch:?}");
            assert_eq!(StressCase::random(3, index), (case, stretch));
        }
    }

    #[test]
    fn a_case_is_the_same_after_it_was_written_and_read() {
        let (case, _) = StressCase::random(5, 3);
        let text = serde_json::to_string(&case).unwrap();
        assert_eq!(serde_json::from_str::<StressCase>(&text).unwrap(), case);
    }

    #[test]
    fn a_value_outside_its_axis_is_refused() {
        let case = StressCase { seed: 0, axes: BTreeMap::from([(Axis::Sigma, 1e9)]) };
        let message = case.validate().unwrap_err().to_string();
        assert_eq!(message, "axis sigma is 1000000000: expected 0.0001 to 1000");
    }

    /// A triangle of the scene in the camera's space, double precision.
    fn seen(scene: &StressScene, triangle: usize) -> [DVec3; 3] {
        let camera = &scene.camera;
        let to_camera =
            |v: Vec3| camera.rotation.as_dmat3() * v.as_dvec3() + camera.translation.as_dvec3();
        scene.soup.vertices[triangle].map(to_camera)
    }

    fn inradius(scene: &StressScene, triangle: usize) -> f64 {
        let [a, b, c] = seen(scene, triangle).map(|p| V3::new(p.x, p.y, p.z));
        let focal = f64::from(scene.camera.focal.x);
        splat(
            &CameraTriangle { first: a, edges: [b - a, c - a] },
            V2::new(focal, focal),
            V2::zero(),
        )
        .inradius
    }

    fn scene(seed: u64, axes: &[(Axis, f64)]) -> StressScene {
        StressScene::new(&StressCase {
            seed,
            axes: axes.iter().copied().collect::<BTreeMap<_, _>>(),
        })
    }

    #[test]
    fn a_scene_is_what_its_case_says() {
        for seed in 0..50 {
            let plain = scene(seed, &[]);
            plain.soup.validate().unwrap();
            assert_eq!(plain.soup.len(), 4);
            for (axis, value) in
                [(Axis::Inradius, 40.0), (Axis::Inradius, 0.2), (Axis::Aspect, 50.0)]
            {
                let stretched = scene(seed, &[(axis, value)]);
                let wanted = if axis == Axis::Inradius { value } else { 3.0 };
                for triangle in 0..4 {
                    let ratio = inradius(&stretched, triangle) / wanted;
                    assert!((0.7..1.4).contains(&ratio), "{axis:?} {value}: {ratio}");
                }
            }
            let far = scene(seed, &[(Axis::DepthRatio, 100.0)]);
            let depth = |k| seen(&far, k).iter().map(|p| p.z).sum::<f64>() / 3.0;
            assert!((50.0..200.0).contains(&(depth(1) / depth(0))));
            let behind = scene(seed, &[(Axis::Behind, 0.75)]);
            let corners_behind = |k| seen(&behind, k).iter().filter(|p| p.z < 0.0).count();
            assert!((1..=2).contains(&corners_behind(0)) && corners_behind(1) == 0);
            let moved = scene(seed, &[(Axis::Distance, 1000.0)]);
            let position = moved.camera.position().length();
            assert!((position - 1000.0).abs() < 0.1, "{position}");
            assert_eq!(scene(seed, &[(Axis::Layers, 100.0)]).soup.len(), 100);
            assert_eq!(scene(seed, &[(Axis::Opacity, 1.0)]).soup.opacity, [1.0; 4]);
        }
    }

    #[test]
    fn near_planes_are_one_behind_the_other() {
        let flat = scene(1, &[(Axis::Gap, 0.01)]);
        let depths: Vec<f64> = (0..4).map(|k| seen(&flat, k)[0].z).collect();
        for pair in depths.windows(2) {
            assert!((pair[1] - pair[0] - 0.02).abs() < 1e-5, "{depths:?}");
        }
    }
}
