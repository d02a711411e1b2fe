//! Projection, depth planes, the fade, and clipping at the near plane.

use super::cases::{CASES, between, camera, corners, difference, duals, flat, triangle};
use trisplat_oracle::dual::Dual;
use trisplat_raster::{
    kernel::splat::{DepthPlaneGrad, SplatGrad},
    kernel::{splat, window},
};
use trisplat_scene::{
    Rng,
    math::real::Real,
    math::real::{V2, V3},
};

/// Pixels near the projection of v0, with the weight of each in a loss and the edge each looks at.
fn pixels(case: u64, origin: [f64; 2]) -> Vec<([f64; 2], f64, usize)> {
    let rng = Rng::new(case, "pixels", 1);
    (0..12)
        .map(|i| {
            let p = [0, 1]
                .map(|k| (origin[k as usize] + between(rng, 4 * i + k, -5.0, 5.0)).round() + 0.5);
            (p, between(rng, 4 * i + 2, -1.0, 1.0), (i % 3) as usize)
        })
        .collect()
}

#[test]
fn splat_grad_is_exact() {
    for case in 0..CASES {
        let x = triangle(case);
        let (focal, center) = camera::<f64>();
        let plain = splat::splat(&corners(x), focal, center);
        let d_inradius = 0.7;
        let mut d = SplatGrad {
            ratio: [0.0; 3],
            moment: [V2::zero(); 3],
            inradius: d_inradius,
            by_incenter: 1.0,
        };
        let dual = splat::splat(&corners(duals(x)), camera().0, camera().1);
        let mut loss = dual.inradius * Dual::of(d_inradius);
        for (p, weight, edge) in pixels(case, [plain.origin.x, plain.origin.y]) {
            let to = V2::new(p[0], p[1]) - plain.origin;
            d.ratio[edge] += weight;
            d.moment[edge] = d.moment[edge] + to.scale(weight);
            let to = V2::new(Dual::of(p[0]), Dual::of(p[1])) - dual.origin;
            loss = loss + window::ratios(&dual.edge, dual.shift, to)[edge] * Dual::of(weight);
        }
        let got = splat::splat_grad(&corners(x), focal, &plain, &d);
        let error = difference(&loss.d, &flat(&got));
        assert!(error < 1e-12 * 1e3f64.max(1.0 / plain.inradius), "case {case}: {error:e}");
    }
}

#[test]
fn splat_grad_with_constant_inradius_is_the_reference_form() {
    for case in 0..CASES {
        let x = triangle(case);
        let (focal, center) = camera::<f64>();
        let plain = splat::splat(&corners(x), focal, center);
        let mut d =
            SplatGrad { ratio: [0.0; 3], moment: [V2::zero(); 3], inradius: 0.3, by_incenter: 0.0 };
        let dual = splat::splat(&corners(duals(x)), camera().0, camera().1);
        let mut loss = Dual::of(0.0);
        for (p, weight, edge) in pixels(case, [plain.origin.x, plain.origin.y]) {
            let to = V2::new(p[0], p[1]) - plain.origin;
            d.ratio[edge] += weight;
            d.moment[edge] = d.moment[edge] + to.scale(weight);
            let to = V2::new(Dual::of(p[0]), Dual::of(p[1])) - dual.origin;
            // φ(p) differentiated, φ(s) held: distance over a constant.
            let distance = window::ratios(&dual.edge, dual.shift, to)[edge] * dual.inradius;
            loss = loss + distance * Dual::of(weight / plain.inradius);
        }
        let got = splat::splat_grad(&corners(x), focal, &plain, &d);
        let error = difference(&loss.d, &flat(&got));
        assert!(error < 1e-12 * 1e3f64.max(1.0 / plain.inradius), "case {case}: {error:e}");
    }
}

#[test]
fn depth_plane_grad_is_exact() {
    for case in 0..CASES {
        let x = triangle(case);
        let (focal, center) = camera::<f64>();
        let plain = splat::splat(&corners(x), focal, center);
        let plain_plane = splat::depth_plane(&corners(x), focal);
        let d_normal = [0.3, -0.8, 0.5];
        let mut d = DepthPlaneGrad {
            inv_depth: 0.0,
            slope: V2::zero(),
            normal: V3::new(d_normal[0], d_normal[1], d_normal[2]),
        };
        let dual = splat::splat(&corners(duals(x)), camera().0, camera().1);
        let plane = splat::depth_plane(&corners(duals(x)), camera().0);
        let n = plane.normal;
        let mut loss =
            n.x * Dual::of(d_normal[0]) + n.y * Dual::of(d_normal[1]) + n.z * Dual::of(d_normal[2]);
        for (p, weight, _) in pixels(case, [plain.origin.x, plain.origin.y]) {
            let to = V2::new(p[0], p[1]) - plain.origin;
            d.inv_depth += weight;
            d.slope = d.slope + to.scale(weight);
            let to = V2::new(Dual::of(p[0]), Dual::of(p[1])) - dual.origin;
            loss = loss + (plane.inv_depth + plane.slope.dot(to)) * Dual::of(weight);
        }
        let got = splat::depth_plane_grad(&corners(x), focal, &plain, &plain_plane, &d);
        let error = difference(&loss.d, &flat(&got));
        assert!(error < 1e-9, "case {case}: {error:e}");
    }
}

#[test]
fn depth_plane_is_the_ray_plane_intersection() {
    for case in 0..CASES {
        let c = corners(triangle(case));
        let (focal, center) = camera::<f64>();
        let s = splat::splat(&c, focal, center);
        let plane = splat::depth_plane(&c, focal);
        let n = c.edges[0].cross(c.edges[1]);
        for (p, _, _) in pixels(case, [s.origin.x, s.origin.y]) {
            let ray = V3::new((p[0] - center.x) / focal.x, (p[1] - center.y) / focal.y, 1.0);
            let inv_z = n.dot(ray) / n.dot(c.first);
            let got = plane.inv_depth + plane.slope.dot(V2::new(p[0], p[1]) - s.origin);
            assert!((got - inv_z).abs() < 1e-9 * inv_z.abs().max(1.0), "case {case}");
        }
        assert!(plane.normal.dot(c.first) < 0.0 && (plane.normal.length() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn fade_grad_is_exact() {
    for i in 0..100 {
        let r = f64::from(i) * 0.011;
        let dual = splat::fade(Dual::<1>::variable(r, 0), Dual::of(0.7));
        assert!((dual.d[0] - splat::fade_grad(r, 0.7)).abs() < 1e-12, "{r}");
        assert_eq!((splat::fade(r, 0.0), splat::fade_grad(r, 0.0)), (1.0, 0.0));
    }
}

#[test]
fn near_point_grad_is_exact() {
    for case in 0..CASES {
        let rng = Rng::new(case, "near", 0);
        let mut x: [f64; 6] = std::array::from_fn(|i| between(rng, i as u64, -3.0, 3.0));
        x[2] = between(rng, 7, 0.5, 3.0);
        x[5] = between(rng, 8, -3.0, 0.3);
        let d = V3::new(0.4, -1.1, 0.6);
        let v = |x: &[Dual<6>], i: usize| V3::new(x[i], x[i + 1], x[i + 2]);
        let dual = duals(x);
        let p = splat::near_point(v(&dual, 0), v(&dual, 3), Dual::of(0.4));
        let loss = p.x * Dual::of(d.x) + p.y * Dual::of(d.y) + p.z * Dual::of(d.z);
        let (a, b) =
            splat::near_point_grad(V3::new(x[0], x[1], x[2]), V3::new(x[3], x[4], x[5]), 0.4, d);
        assert!(difference(&loss.d, &[a.x, a.y, a.z, b.x, b.y, b.z]) < 1e-12, "case {case}");
    }
}

#[test]
fn clipping_keeps_the_winding_and_the_area() {
    let v = [[0.0, 0.0, 1.0], [3.0, 0.0, 2.0], [0.0, 2.0, -1.0]]
        .map(|[x, y, z]: [f64; 3]| V3::new(x, y, z));
    for mask in 0..8u8 {
        let front = [0, 1, 2].map(|i| mask >> i & 1 == 1);
        let (pieces, count) = splat::pieces(front);
        assert_eq!(count, [0, 1, 1, 2, 1, 2, 2, 1][mask as usize]);
        for piece in &pieces[..count] {
            assert_eq!(piece[0].from, piece[0].to);
            assert!(
                piece
                    .iter()
                    .all(|c| front[c.from as usize] && (c.from == c.to || !front[c.to as usize]))
            );
        }
    }
    // z = 0 cuts corner 2 off; the pieces' areas add up to the area above it.
    let (pieces, count) = splat::pieces([true, true, false]);
    let at = |c: splat::PieceCorner| {
        let a = v[c.from as usize];
        let b = v[c.to as usize];
        if c.from == c.to { a } else { splat::near_point(a, b, 0.0) }
    };
    let cross = |p: [V3<f64>; 3]| (p[1] - p[0]).cross(p[2] - p[0]);
    let whole = cross(v);
    let mut sum = 0.0;
    for piece in &pieces[..count] {
        let n = cross(piece.map(at));
        assert!(n.dot(whole) > 0.0);
        sum += n.length();
    }
    let cut = cross([
        at(splat::PieceCorner { from: 0, to: 2 }),
        at(splat::PieceCorner { from: 1, to: 2 }),
        v[2],
    ])
    .length();
    assert!((sum + cut - whole.length()).abs() < 1e-12);
}
