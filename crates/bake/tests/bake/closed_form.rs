//! The formulas of the stages against brute force.

use glam::{DVec2, DVec3, Vec3, dvec2};
use proptest::prelude::*;
use trisplat_bake::{area_factor, contour_factor, shrink};
use trisplat_scene::Rng;

/// The window at `p`: distance to the nearest edge over the inradius, to the power σ (eq. 1),
/// straight from the definition.
fn window(corners: &[DVec2; 3], p: DVec2, sigma: f64) -> f64 {
    let [a, b, c] = *corners;
    let orientation = (b - a).perp_dot(c - a).signum();
    let distance =
        |from: DVec2, to: DVec2| orientation * (to - from).normalize().perp_dot(p - from);
    let nearest = distance(a, b).min(distance(b, c)).min(distance(c, a));
    let ab = a.distance(b);
    let bc = b.distance(c);
    let ca = c.distance(a);
    let inradius = (b - a).perp_dot(c - a).abs() / (ab + bc + ca);
    (nearest / inradius).clamp(0.0, 1.0).powf(sigma)
}

fn flat(corners: [DVec2; 3]) -> [Vec3; 3] {
    corners.map(|v| v.extend(0.0).as_vec3())
}

/// Uniform points in the triangle, and how many.
fn points(corners: &[DVec2; 3], count: u64) -> impl Iterator<Item = DVec2> {
    let [a, b, c] = *corners;
    let rng = Rng::new(5, "monte carlo", 0);
    (0..count).map(move |i| {
        let u = rng.uniform_f64(2 * i);
        let v = rng.uniform_f64(2 * i + 1);
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        a + u * (b - a) + v * (c - a)
    })
}

/// The mean of the window is 2 / ((σ + 1)(σ + 2)) on any triangle, so the area factor squared is
/// the mean alpha.
#[test]
fn area_factor_is_the_mean_alpha() {
    let triangles = [
        [dvec2(0.0, 0.0), dvec2(1.0, 0.0), dvec2(0.5, 0.8)],
        [dvec2(0.0, 0.0), dvec2(3.0, 0.1), dvec2(0.2, 0.4)],
    ];
    let count = 200_000;
    for corners in triangles {
        for sigma in [0.01, 0.1, 0.5, 1.0, 1.16, 3.0, 10.0] {
            for opacity in [1.0, 0.4] {
                let alpha = points(&corners, count).map(|p| opacity * window(&corners, p, sigma));
                let (sum, squares) = alpha.fold((0.0, 0.0), |(s, q), a| (s + a, q + a * a));
                let mean = sum / count as f64;
                let deviation = ((squares / count as f64 - mean * mean) / count as f64).sqrt();
                let closed = area_factor(opacity, sigma).powi(2);
                assert!(
                    (mean - closed).abs() < 4.5 * deviation,
                    "sigma {sigma}: closed form {closed}, measured {mean} +- {deviation}"
                );
            }
        }
    }
}

/// On the border of the shrunk triangle, opacity times window is the contour value.
#[test]
fn the_contour_is_where_it_should_be() {
    let corners = [dvec2(0.0, 0.0), dvec2(2.0, 0.3), dvec2(0.4, 1.1)];
    for (opacity, sigma, contour) in
        [(1.0, 1.0, 0.5), (0.9, 0.3, 0.5), (0.6, 2.0, 0.25), (1.0, 0.1, 0.9)]
    {
        let factor = contour_factor(opacity, sigma, contour);
        let inner = shrink(&flat(corners), factor).map(|v| v.truncate().as_dvec2());
        for k in 0..3 {
            for along in [0.0, 0.2, 0.5, 0.9] {
                let value =
                    opacity * window(&corners, inner[k].lerp(inner[(k + 1) % 3], along), sigma);
                assert!(
                    (value - contour).abs() < 1e-5,
                    "sigma {sigma}: {value} on the contour {contour}"
                );
            }
        }
    }
}

#[test]
fn factors_at_the_edges_of_their_domain() {
    assert_eq!(contour_factor(0.5, 1.0, 0.5), 0.0);
    assert_eq!(contour_factor(0.2, 1.0, 0.5), 0.0);
    assert_eq!(contour_factor(f64::NAN, 1.0, 0.5), 0.0);
    assert_eq!(contour_factor(1.0, 1e-4, 0.5), 1.0);
    // 1 - 2^(-1/1000), to 14 digits: a difference from 1 would keep 13 fewer.
    assert!((contour_factor(1.0, 1e3, 0.5) / 6.929_070_095_474_781e-4 - 1.0).abs() < 1e-13);
    assert_eq!(area_factor(0.0, 1.0), 0.0);
    assert!((area_factor(1.0, 1e-4) - 1.0).abs() < 1e-4);
    assert!(area_factor(1.0, 1e3) > 0.0);
}

fn area(corners: &[Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// Signed distance of `p` inside the edge from `a` to `b` of a triangle whose third corner is `c`.
fn inside_by(p: DVec3, a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let along = (b - a).normalize();
    let inward = (c - a) - (c - a).dot(along) * along;
    (p - a).dot(inward.normalize())
}

proptest! {
    #![proptest_config(trisplat_fixtures::regressions::stored())]

    /// The shrunk triangle lies in the original, its plane and its area are right.
    #[test]
    fn shrinking_stays_inside(
        corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
        scale in -12i32..12,
        factor in 0.0f64..1.0,
    ) {
        let corners = corners.map(|v| Vec3::from(v) * 2f32.powi(scale));
        let longest = [0, 1, 2].map(|k: usize| corners[k].distance(corners[(k + 1) % 3])).into_iter().fold(0.0, f32::max);
        prop_assume!(area(&corners) > 1e-3 * f64::from(longest).powi(2));
        let shrunk = shrink(&corners, factor);
        let rounding = 1e-6 * 2f64.powi(scale);
        for v in shrunk {
            for k in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|j| corners[(k + j) % 3].as_dvec3());
                prop_assert!(inside_by(v.as_dvec3(), a, b, c) > -rounding);
            }
        }
        let wants = area(&corners) * factor * factor;
        prop_assert!((area(&shrunk) - wants).abs() < 4.0 * rounding * 2f64.powi(scale));
    }

    /// `auto` is between the two it chooses from, and never shrinks more than either.
    #[test]
    fn factors_are_fractions(opacity in 0.0f64..=1.0, log_sigma in -4.0f64..3.0, contour in 0.01f64..0.99) {
        let sigma = 10f64.powf(log_sigma);
        for factor in [contour_factor(opacity, sigma, contour), area_factor(opacity, sigma)] {
            prop_assert!((0.0..=1.0).contains(&factor));
        }
    }
}
