//! The reference of `trisplat bench stress`, which is written with the kernels' formulas, against the oracle, which
//! shares no formula with them.

use super::compare::{exact_grad, oracle_camera, plain, rules};
use crate::common::oracle;
use trisplat_bench::{
    stress::axes::{AXES, Axis},
    stress::case::StressCase,
    stress::exact::ExactFrame,
    stress::promises::{PROMISES, domain},
    stress::scene::StressScene,
};
use trisplat_raster::soft::{FrameGrad, SoftOptions};
use trisplat_scene::Rng;

/// The largest difference of a value, and of an entry of a gradient from the largest of its triangle, away from jumps.
const DIFFERENCE: f64 = 1e-8;
/// Pixels nearer to a jump or kink than this are left out.
const MARGIN: f64 = 1e-6;

/// Cases that the oracle can follow: its absolute coordinates lose digits when triangles are far larger than a pixel.
fn cases() -> Vec<StressCase> {
    let one = |seed, axes: &[(Axis, f64)]| StressCase { seed, axes: axes.iter().copied().collect() };
    let mut cases: Vec<StressCase> = (0..12).map(|seed| one(seed, &[])).collect();
    for (axis, values) in [
        (Axis::Scale, [1e-6, 1e9]),
        (Axis::Distance, [100.0, 1e4]),
        (Axis::Aspect, [10.0, 100.0]),
        (Axis::Inradius, [0.2, 50.0]),
        (Axis::Sigma, [0.01, 20.0]),
        (Axis::Opacity, [0.05, 1.0]),
        (Axis::DepthRatio, [30.0, 1e4]),
        (Axis::Focal, [4.0, 1e3]),
        (Axis::Behind, [0.4, 0.9]),
        (Axis::Gap, [1e-3, 0.1]),
        (Axis::Layers, [1.0, 20.0]),
        (Axis::Sh, [0.01, 100.0]),
    ] {
        cases.extend(values.into_iter().flat_map(|v| (20..23).map(move |seed| one(seed, &[(axis, v)]))));
    }
    cases
}

#[test]
fn the_reference_of_the_stress_test_equals_the_oracle() {
    let (mut drawn, mut pixels, mut left_out) = (0, 0, 0);
    for case in cases() {
        let StressScene { soup, camera, options } = StressScene::new(&case);
        let mut exact = ExactFrame::default();
        exact.draw(&soup, &camera, &options);
        let picture = oracle::render(&plain(&soup), &oracle_camera(&camera), &rules(&options));
        drawn += usize::from(exact.drawn());
        for (i, pixel) in picture.iter().enumerate() {
            pixels += 1;
            if pixel.margin.min(exact.margin[i]) < MARGIN {
                left_out += 1;
                continue;
            }
            let values = exact.rgb[i].into_iter().chain([exact.transmittance[i]]);
            for (got, want) in values.zip(pixel.rgb.into_iter().chain([pixel.transmittance])) {
                let error = (got - want).abs() / exact.color_scale;
                assert!(error < DIFFERENCE, "{case:?}, pixel {i}: {got} instead of {want}");
            }
        }
    }
    assert!(drawn > 70 && left_out * 50 < pixels, "{drawn} drawn, {left_out} of {pixels} pixels left out");
}

#[test]
fn the_gradient_of_the_reference_equals_dual_numbers_through_the_oracle() {
    let mut compared = 0;
    for case in cases().into_iter().step_by(2).filter(|case| case.value(Axis::Layers) < 10.0) {
        let StressScene { soup, camera, options } = StressScene::new(&case);
        let options = SoftOptions { ratio_least: 0.0, ..options };
        let mut exact = ExactFrame::default();
        exact.draw(&soup, &camera, &options);
        let picture = oracle::render(&plain(&soup), &oracle_camera(&camera), &rules(&options));
        let mut d = FrameGrad::default();
        for (i, (margin, pixel)) in (0u64..).zip(exact.margin.iter().zip(&picture)) {
            let rng = Rng::new(case.seed, "gradient", i);
            let keep = if margin.min(pixel.margin) < 1e-4 { 0.0 } else { 1.0 };
            d.d_rgb.push([0, 1, 2].map(|n| (rng.uniform(n) - 0.5) * keep));
            d.d_transmittance.push((rng.uniform(3) - 0.5) * keep);
        }
        let got = exact.backward(&soup, &camera, &options, &d);
        for (t, got) in got.iter().enumerate().filter(|(t, _)| !exact.kinked[*t]) {
            let want = exact_grad(&soup, t, &camera, &options, &d);
            // At a clamped colour the oracle's slope is 0, while a gradient passes if it raises the colour (docs/numerics.md).
            let clamped: Vec<usize> = (11..14).filter(|n| want[*n] == 0.0).collect();
            if !clamped.is_empty() {
                assert!(
                    clamped.iter().all(|n| got.numbers()[*n] <= 0.0),
                    "{case:?}, {t}: a colour is lowered"
                );
                continue;
            }
            compared += 1;
            let groups = [0..9, 9..10, 10..11, 11..want.len()];
            for group in groups {
                let size = want[group.clone()].iter().fold(1e-12, |m, x| f64::max(m, x.abs()));
                for n in group {
                    let error = (got.numbers()[n] - want[n]).abs() / size;
                    assert!(
                        error < 1e-6,
                        "{case:?}, entry {n} of {t}: {} instead of {}",
                        got.numbers()[n],
                        want[n]
                    );
                }
            }
        }
    }
    assert!(compared > 60, "{compared} triangles compared");
}

#[test]
fn the_docs_state_the_promises_of_the_code() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/numerics.md");
    let docs = std::fs::read_to_string(path).unwrap();
    let states = |name: &str, cells: &[String]| {
        let row = docs.lines().find(|line| line.starts_with(&format!("| `{name}` |")));
        let row = row.unwrap_or_else(|| panic!("no row for {name}"));
        for cell in cells {
            assert!(row.contains(&format!("| {cell} |")), "the row of {name} does not say {cell}: {row}");
        }
    };
    for row in &PROMISES {
        let at_most = if row.at_most == 0.0 { "0".to_owned() } else { format!("{:e}", row.at_most) };
        states(row.name, &[format!("{:?}", row.on).to_lowercase(), at_most]);
    }
    let number =
        |x: f64| if (1e-3..1e3).contains(&x) || x == 0.0 { format!("{x:.3}") } else { format!("{x:e}") };
    let number = |x: f64| match number(x) {
        text if text.contains('.') && !text.contains('e') => {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        text => text,
    };
    for row in &AXES {
        let (least, most) = domain(row.axis);
        let range = |from: f64, to: f64| format!("{} to {}", number(from), number(to));
        states(row.name, &[range(row.least, row.most), range(least, most)]);
    }
}
