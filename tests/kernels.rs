//! Every kernel: its gradient against dual numbers, f32 against f64, lanes against f32.

mod common;

use common::dual::Dual;
use trisplat::kernel::splat::{CameraTriangle, DepthPlaneGrad, SplatGrad};
use trisplat::kernel::{clip, composite, sh, splat, window};
use trisplat::math::lanes::{LANES, Lanes, Level, Work, dispatch_at};
use trisplat::math::real::{Mask, Real};
use trisplat::math::vec::{V2, V3};
use trisplat::rng::Rng;

/// Largest difference of two gradients relative to their size.
fn difference(exact: &[f64], got: &[f64]) -> f64 {
    assert_eq!(exact.len(), got.len());
    let size = exact.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    exact.iter().zip(got).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size.max(1e-300)
}

fn between(rng: Rng, index: u64, lo: f64, hi: f64) -> f64 {
    lo + (hi - lo) * rng.uniform_f64(index)
}

const CASES: u64 = 200;
const FOCAL: [f64; 2] = [310.0, 290.0];
const CENTER: [f64; 2] = [100.0, 70.0];

/// v0, e1, e2 of a triangle in front of the camera.
fn triangle(case: u64) -> [f64; 9] {
    let rng = Rng::new(case, "triangle", 0);
    let size = 10f64.powf(between(rng, 20, -2.0, 0.3));
    let mut out = [0.0; 9];
    for (i, x) in out.iter_mut().enumerate() {
        *x = between(rng, i as u64, -1.0, 1.0) * if i < 3 { 1.0 } else { size };
    }
    out[2] = between(rng, 2, 4.0, 8.0);
    out
}

fn corners<R: Real>(x: [R; 9]) -> CameraTriangle<R> {
    let v = |i: usize| V3::new(x[i], x[i + 1], x[i + 2]);
    CameraTriangle { first: v(0), edges: [v(3), v(6)] }
}

fn flat(c: &CameraTriangle<f64>) -> Vec<f64> {
    [c.first, c.edges[0], c.edges[1]].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

fn camera<R: Real>() -> (V2<R>, V2<R>) {
    (V2::new(R::of(FOCAL[0]), R::of(FOCAL[1])), V2::new(R::of(CENTER[0]), R::of(CENTER[1])))
}

fn duals<const N: usize>(x: [f64; N]) -> [Dual<N>; N] {
    std::array::from_fn(|i| Dual::variable(x[i], i))
}

/// Pixels near the projection of v0, with the weight of each in a loss and the edge each looks at.
fn pixels(case: u64, origin: [f64; 2]) -> Vec<([f64; 2], f64, usize)> {
    let rng = Rng::new(case, "pixels", 1);
    (0..12)
        .map(|i| {
            let p = [0, 1].map(|k| (origin[k as usize] + between(rng, 4 * i + k, -5.0, 5.0)).round() + 0.5);
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
        let mut d =
            SplatGrad { ratio: [0.0; 3], moment: [V2::zero(); 3], inradius: d_inradius, exact_incenter: 1.0 };
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
            SplatGrad { ratio: [0.0; 3], moment: [V2::zero(); 3], inradius: 0.3, exact_incenter: 0.0 };
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
fn plane_grad_is_exact() {
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
fn plane_is_the_ray_plane_intersection() {
    for case in 0..CASES {
        let c = corners(triangle(case));
        let (focal, center) = camera::<f64>();
        let (s, plane) = (splat::splat(&c, focal, center), splat::depth_plane(&c, focal));
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
        (x[2], x[5]) = (between(rng, 7, 0.5, 3.0), between(rng, 8, -3.0, 0.3));
        let d = V3::new(0.4, -1.1, 0.6);
        let v = |x: &[Dual<6>], i: usize| V3::new(x[i], x[i + 1], x[i + 2]);
        let dual = duals(x);
        let p = clip::near_point(v(&dual, 0), v(&dual, 3), Dual::of(0.4));
        let loss = p.x * Dual::of(d.x) + p.y * Dual::of(d.y) + p.z * Dual::of(d.z);
        let (a, b) = clip::near_point_grad(V3::new(x[0], x[1], x[2]), V3::new(x[3], x[4], x[5]), 0.4, d);
        assert!(difference(&loss.d, &[a.x, a.y, a.z, b.x, b.y, b.z]) < 1e-12, "case {case}");
    }
}

#[test]
fn clip_keeps_the_sense_of_rotation_and_the_area() {
    let v = [[0.0, 0.0, 1.0], [3.0, 0.0, 2.0], [0.0, 2.0, -1.0]].map(|[x, y, z]: [f64; 3]| V3::new(x, y, z));
    for mask in 0..8u8 {
        let front = [0, 1, 2].map(|i| mask >> i & 1 == 1);
        let (pieces, count) = clip::pieces(front);
        assert_eq!(count, [0, 1, 1, 2, 1, 2, 2, 1][mask as usize]);
        for piece in &pieces[..count] {
            assert_eq!(piece[0].from, piece[0].to);
            assert!(
                piece.iter().all(|c| front[c.from as usize] && (c.from == c.to || !front[c.to as usize]))
            );
        }
    }
    // z = 0 cuts corner 2 off; the pieces' areas add up to the area above it.
    let (pieces, count) = clip::pieces([true, true, false]);
    let at = |c: clip::Corner| {
        let (a, b) = (v[c.from as usize], v[c.to as usize]);
        if c.from == c.to { a } else { clip::near_point(a, b, 0.0) }
    };
    let cross = |p: [V3<f64>; 3]| (p[1] - p[0]).cross(p[2] - p[0]);
    let whole = cross(v);
    let mut sum = 0.0;
    for piece in &pieces[..count] {
        let n = cross(piece.map(at));
        assert!(n.dot(whole) > 0.0);
        sum += n.length();
    }
    let cut =
        cross([at(clip::Corner { from: 0, to: 2 }), at(clip::Corner { from: 1, to: 2 }), v[2]]).length();
    assert!((sum + cut - whole.length()).abs() < 1e-12);
}

#[test]
fn window_grad_is_exact() {
    for case in 0..CASES {
        let rng = Rng::new(case, "window", 0);
        let x =
            [between(rng, 0, 0.02, 1.0), 10f64.powf(between(rng, 1, -2.0, 1.0)), between(rng, 2, -4.0, 0.0)];
        let [ratio, sigma, log2_opacity] = duals(x);
        let alpha = window::alpha(ratio.log2(), log2_opacity, sigma);
        let (d_sigma, d_ratio) = window::alpha_grad(x[0], x[0].log2(), x[1], 0.0, alpha.v);
        let d_log2_opacity = alpha.v * std::f64::consts::LN_2;
        assert!(difference(&alpha.d, &[d_ratio, d_sigma, d_log2_opacity]) < 1e-12, "case {case}");
    }
}

#[test]
fn window_is_one_at_the_incenter_and_zero_on_the_boundary() {
    for case in 0..CASES {
        let (focal, center) = camera::<f64>();
        let s = splat::splat(&corners(triangle(case)), focal, center);
        let at = |to| window::ratio(&window::ratios(&s.edge, s.shift, to));
        let tolerance = 1e-12 * 1e3f64.max(1.0 / s.inradius);
        assert!((at(splat::incenter(&s)) - 1.0).abs() < tolerance);
        for corner in [V2::zero(), s.sides[0], s.sides[1], (s.sides[0] + s.sides[1]).scale(0.5)] {
            assert!(at(corner).abs() < tolerance * 10.0, "case {case}");
        }
    }
}

#[test]
fn ratio_floor_is_where_the_window_meets_the_cutoff() {
    for sigma in [1e-4, 0.01, 0.5, 1.16, 20.0, 1e3] {
        for opacity in [0.004, 0.1, 0.99, 1.0f64] {
            let floor = window::ratio_floor(opacity.log2(), sigma, (1.0 / 255.0f64).log2());
            assert!(floor.is_finite() && floor > 0.0);
            if floor > 1e-5 {
                let alpha = window::alpha(floor.log2(), opacity.log2(), sigma);
                assert!((alpha * 255.0 - 1.0).abs() < 1e-9, "{sigma} {opacity}");
            }
        }
    }
}

#[test]
fn exactly_one_edge_is_nearest() {
    for r in
        [[1.0, 2.0, 3.0], [2.0, 1.0, 3.0], [3.0, 2.0, 1.0], [1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0]]
    {
        assert_eq!(window::nearest(&r).iter().filter(|m| **m).count(), 1, "{r:?}");
    }
}

/// Layers of (alpha, value) over a background value, as duals.
fn blended<R: Real>(alphas: &[R], values: &[R], background: R) -> R {
    let (mut sum, mut t) = (R::of(0.0), R::of(1.0));
    for (alpha, value) in alphas.iter().zip(values) {
        let (w, after) = composite::blend(t, *alpha);
        sum = sum + w * *value;
        t = after;
    }
    sum + t * background
}

#[test]
fn blend_grad_is_exact_up_to_alpha_one() {
    for (case, ends) in [(0, 0.7), (1, 1.0), (2, 0.9999)] {
        let rng = Rng::new(case, "blend", 0);
        let mut alphas: [f64; 6] = std::array::from_fn(|i| between(rng, i as u64, 0.05, 0.6));
        alphas[5] = ends;
        let values: [f64; 6] = std::array::from_fn(|i| between(rng, 10 + i as u64, -1.0, 1.0));
        let background = 0.3;
        let loss = blended(&duals(alphas), &values.map(Dual::of), Dual::of(background));
        let mut behind = loss.v;
        let mut t = 1.0;
        let mut got = Vec::new();
        for i in 0..6 {
            let (w, after) = composite::blend(t, alphas[i]);
            behind -= w * values[i];
            got.push(composite::blend_grad(t, alphas[i], values[i], behind, i == 5, background));
            t = after;
        }
        assert!(difference(&loss.d, &got) < 1e-12, "case {case}");
    }
}

#[test]
fn coverage_is_exact_for_edges_and_strips_and_so_is_its_gradient() {
    // The pixel [-1/2, 1/2]² and lines x = const: clipping it is arithmetic.
    let far = 9.0;
    for i in -20..=20 {
        let left = f64::from(i) * 0.04;
        let half_plane = window::coverage(&[left, far, far]);
        assert!((half_plane.max(0.0) - (left + 0.5).clamp(0.0, 1.0)).abs() < 1e-15);
        for width in [0.02, 0.3, 0.9, 2.0] {
            let (from, to) = (-left, width - left);
            let exact = (to.min(0.5) - from.max(-0.5)).max(0.0);
            let strip = window::coverage(&[left, width - left, far]).max(0.0);
            assert!((strip - exact).abs() < 1e-12, "{left} {width}: {strip} {exact}");
        }
    }
    for case in 0..CASES {
        let rng = Rng::new(case, "coverage", 0);
        let x: [f64; 3] = std::array::from_fn(|i| between(rng, i as u64, -0.1, 1.0));
        let exact = window::coverage(&duals(x));
        let got = window::coverage_edges(&x).map(|cut| f64::from(u8::from(cut)));
        assert!(difference(&exact.d, &got) < 1e-12 || exact.d == got, "case {case}");
    }
}

#[test]
fn distortion_grad_is_exact() {
    let w = [0.3, 0.2, 0.15, 0.1];
    let m = [0.1, 0.25, 0.3, 0.7];
    let x: [f64; 8] = std::array::from_fn(|i| if i < 4 { w[i] } else { m[i - 4] });
    let dual = duals(x);
    let (mut loss, mut sums) = (Dual::of(0.0), [Dual::of(0.0); 3]);
    let mut brute = Dual::<8>::of(0.0);
    for i in 0..4 {
        let (w, m) = (dual[i], dual[i + 4]);
        loss = loss + composite::distortion(w, m, sums);
        sums = [sums[0] + w, sums[1] + w * m, sums[2] + w * m * m];
        for j in 0..i {
            let d = m - dual[j + 4];
            brute = brute + w * dual[j] * d * d;
        }
    }
    assert!((loss.v - brute.v).abs() < 1e-15 && difference(&brute.d, &loss.d) < 1e-12);
    let totals = sums.map(|s| s.v);
    let grads: Vec<_> = (0..4).map(|i| composite::distortion_grad(w[i], m[i], totals)).collect();
    let got: Vec<f64> = grads.iter().map(|g| g.0).chain(grads.iter().map(|g| g.1)).collect();
    assert!(difference(&brute.d, &got) < 1e-12);
}

#[test]
fn sh_grad_is_exact() {
    for case in 0..CASES {
        let rng = Rng::new(case, "sh", 0);
        let degree = (case % 4) as u8;
        let x: [f64; 3] = std::array::from_fn(|i| between(rng, i as u64, -2.0, 2.0));
        let weights: [f64; sh::MAX_COEFFICIENTS] =
            std::array::from_fn(|i| between(rng, 10 + i as u64, -1.0, 1.0));
        let [a, b, c] = duals(x);
        let v = V3::new(a, b, c);
        let unit = v.scale(Dual::of(1.0) / v.length());
        let mut loss = Dual::of(0.0);
        for (y, w) in sh::basis(degree, unit).into_iter().zip(weights) {
            loss = loss + y * Dual::of(w);
        }
        let length = v.length().v;
        let unit = V3::new(unit.x.v, unit.y.v, unit.z.v);
        let got = sh::normalize_grad(unit, length, sh::basis_grad(degree, unit, &weights));
        if degree > 0 {
            assert!(difference(&loss.d, &[got.x, got.y, got.z]) < 1e-12, "case {case}");
        }
    }
}

#[test]
fn sh_basis_is_orthonormal() {
    // Fibonacci sphere: an equal-weight quadrature.
    let n = 20_000;
    let mut gram = [[0.0f64; sh::MAX_COEFFICIENTS]; sh::MAX_COEFFICIENTS];
    for i in 0..n {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
        let (s, c) = (2.399_963_229_728_653 * f64::from(i)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let y = sh::basis(3, V3::new(r * c, r * s, z));
        for a in 0..sh::MAX_COEFFICIENTS {
            for b in 0..sh::MAX_COEFFICIENTS {
                gram[a][b] += y[a] * y[b] * 4.0 * std::f64::consts::PI / f64::from(n);
            }
        }
    }
    for (a, row) in gram.iter().enumerate() {
        for (b, x) in row.iter().enumerate() {
            assert!((x - f64::from(u8::from(a == b))).abs() < 1e-3, "{a} {b} {x}");
        }
    }
}

/// Alpha of a splat at a pixel, the whole chain.
fn chain<R: Real>(x: [R; 9], to: [R; 2]) -> R {
    let (focal, center) = camera();
    let s = splat::splat(&corners(x), focal, center);
    let ratio = window::ratio(&window::ratios(&s.edge, s.shift, splat::incenter(&s) + V2::new(to[0], to[1])));
    window::alpha(ratio.max(R::of(1e-6)).log2(), R::of(-0.3), R::of(1.16))
}

#[test]
fn f32_stays_near_f64() {
    let mut worst = 0.0f64;
    for case in 0..2000 {
        let x = triangle(case).map(|x| x as f32);
        let exact = splat::splat(&corners(x.map(f64::from)), camera().0, camera().1);
        if exact.inradius < 0.5 {
            continue;
        }
        let to = [0.3f32, -0.2];
        let error = (f64::from(chain(x, to)) - chain(x.map(f64::from), to.map(f64::from))).abs();
        worst = worst.max(error);
    }
    assert!(worst < 2e-5, "{worst:e}");
}

struct Functions<'a> {
    x: &'a [f32; LANES],
    out: &'a mut [[f32; LANES]; 12],
}

impl Work for Functions<'_> {
    type Output = (u16, [f32; LANES], f32);
    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let x = L::load(self.x);
        let two = L::splat(2.0);
        let mask = x.lt(two);
        let values = [
            x.log2(),
            (-x).max(L::splat(-100.0)).exp2(),
            x.sqrt(),
            (-x).abs(),
            x.min(two),
            x.max(two),
            x.masked(mask),
            two.add_where(mask, x, x),
            L::select(mask.not(), x, two),
            x / two - x * two,
            L::select(L::from_bits(0b1010_0110_0011_0101), x, -x),
            L::select(mask.and(x.le(L::splat(1.0))).or(two.lt(x)), x, two),
        ];
        for (out, v) in self.out.iter_mut().zip(values) {
            v.store(out);
        }
        let many: [L; LANES] = std::array::from_fn(|i| x * L::splat(i as f32 + 1.0));
        (L::bits(mask), L::sums(&many), x.max_lane())
    }
}

const LEVELS: [Level; 3] = [Level::Portable, Level::Avx2, Level::Avx512];

#[test]
fn lanes_equal_scalars_at_every_level() {
    for level in LEVELS {
        for round in 0..200 {
            let rng = Rng::new(round, "lanes", 0);
            let x: [f32; LANES] = std::array::from_fn(|i| {
                (2.0f32).powf((rng.uniform(i as u64) - 0.5) * if round < 100 { 30.0 } else { 2.0 })
            });
            let mut out = [[0.0; LANES]; 12];
            let (bits, sums, largest) = dispatch_at(level, Functions { x: &x, out: &mut out });
            assert_eq!(largest, x.iter().copied().fold(0.0, f32::max));
            for (i, sum) in sums.iter().enumerate() {
                let exact = x.iter().map(|x| f64::from(*x)).sum::<f64>() * (i as f64 + 1.0);
                assert!((f64::from(*sum) / exact - 1.0).abs() < 1e-6, "{level:?} row {i}: {sum} {exact}");
            }
            for (i, x) in x.into_iter().enumerate() {
                let wide = f64::from(x);
                let log2 = wide.log2();
                let tolerance = 4e-7 * log2.abs() + if (0.7..1.42).contains(&x) { 1e-9 } else { 1.2e-7 };
                assert!((f64::from(out[0][i]) - log2).abs() < tolerance, "{level:?} log2 {x}");
                let exp2 = (-wide).max(-100.0).exp2();
                assert!((f64::from(out[1][i]) / exp2 - 1.0).abs() < 2.5e-7, "{level:?} exp2 {x}");
                assert_eq!(bits >> i & 1 == 1, x < 2.0);
                let picked = 0b1010_0110_0011_0101u16 >> i & 1 == 1;
                let rest = [
                    x.sqrt(),
                    x,
                    x.min(2.0),
                    x.max(2.0),
                    if x < 2.0 { x } else { 0.0 },
                    if x < 2.0 { x.mul_add(x, 2.0) } else { 2.0 },
                    if x < 2.0 { 2.0 } else { x },
                    x / 2.0 - x * 2.0,
                    if picked { x } else { -x },
                    if x <= 1.0 || x > 2.0 { x } else { 2.0 },
                ];
                for (k, want) in rest.into_iter().enumerate() {
                    let got = out[k + 2][i];
                    assert!(
                        (got - want).abs() <= 1e-6 * want.abs(),
                        "{level:?} function {k} of {x}: {got} {want}"
                    );
                }
            }
        }
    }
}

struct Alpha<'a>(&'a [[f32; LANES]; 11], &'a mut [f32; LANES]);

impl Work for Alpha<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let x: [L; 9] = std::array::from_fn(|i| L::load(&self.0[i]));
        chain(x, [L::load(&self.0[9]), L::load(&self.0[10])]).store(self.1);
    }
}

#[test]
fn kernels_on_lanes_equal_kernels_on_f32() {
    for level in LEVELS {
        let mut x = [[0.0f32; LANES]; 11];
        let mut cases =
            (0u64..).filter(|c| splat::splat(&corners(triangle(*c)), camera().0, camera().1).inradius > 0.5);
        for round in 0..20 {
            for lane in 0..LANES {
                let t = triangle(cases.next().unwrap_or(round));
                for (row, value) in x.iter_mut().zip(&t) {
                    row[lane] = *value as f32;
                }
                (x[9][lane], x[10][lane]) = (0.3, -0.2);
            }
            let mut got = [0.0; LANES];
            dispatch_at(level, Alpha(&x, &mut got));
            for (lane, got) in got.into_iter().enumerate() {
                let want = chain(std::array::from_fn(|i| x[i][lane]), [0.3f32, -0.2]);
                assert!((got - want).abs() < 2e-5, "{level:?}: {got} {want}");
            }
        }
    }
}
