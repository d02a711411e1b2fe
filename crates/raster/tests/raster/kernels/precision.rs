//! f32 against f64, and lanes against f32 at every instruction set.

use super::cases::{camera, corners, triangle};
use trisplat_raster::kernel::{splat, window};
use trisplat_scene::{
    Rng,
    math::lanes::{LANES, Lanes, SimdLevel, Work, dispatch_at},
    math::real::V2,
    math::real::{Mask, Real},
};

/// Alpha of a splat at a pixel: projection, ratio and window.
fn chain<R: Real>(x: [R; 9], to: [R; 2]) -> R {
    let (focal, center) = camera();
    let s = splat::splat(&corners(x), focal, center);
    let ratio = window::ratio(&window::ratios(
        &s.edge,
        s.shift,
        splat::incenter(&s) + V2::new(to[0], to[1]),
    ));
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
    eprintln!("window chain, f32: largest error {worst:.1e}");
    assert!(worst < 5e-6, "{worst:e}");
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

const LEVELS: [SimdLevel; 3] = [SimdLevel::Portable, SimdLevel::Avx2, SimdLevel::Avx512];

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
                assert!(
                    (f64::from(*sum) / exact - 1.0).abs() < 1e-6,
                    "{level:?} row {i}: {sum} {exact}"
                );
            }
            for (i, x) in x.into_iter().enumerate() {
                let wide = f64::from(x);
                let log2 = wide.log2();
                let tolerance =
                    4e-7 * log2.abs() + if (0.7..1.42).contains(&x) { 1e-9 } else { 1.2e-7 };
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

struct Rounded<'a>(&'a [f32; LANES], &'a mut [i32; LANES]);

impl Work for Rounded<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        L::load(self.0).store_rounded(self.1);
    }
}

#[test]
fn lanes_round_to_even_at_every_level() {
    for level in LEVELS {
        for round in 0..200 {
            let rng = Rng::new(round, "rounded", 0);
            // Halves are ties; the largest are beyond the grid of the guard band.
            let step = [0.5, 0.499_999_97, 8_388_607.0][round as usize % 3];
            let x: [f32; LANES] =
                std::array::from_fn(|i| step * (rng.bits(i as u64) % 127) as f32 - 31.0 * step);
            let mut rounded = [0; LANES];
            dispatch_at(level, Rounded(&x, &mut rounded));
            assert_eq!(rounded, x.map(|x| x.round_ties_even() as i32), "{level:?} {x:?}");
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
        let mut cases = (0u64..).filter(|c| {
            splat::splat(&corners(triangle(*c)), camera().0, camera().1).inradius > 0.5
        });
        for round in 0..20 {
            for lane in 0..LANES {
                let t = triangle(cases.next().unwrap_or(round));
                for (row, value) in x.iter_mut().zip(&t) {
                    row[lane] = *value as f32;
                }
                x[9][lane] = 0.3;
                x[10][lane] = -0.2;
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
