//! Gaussians in PLY, plain and compressed.

use super::*;

#[test]
fn a_ply_becomes_physical_numbers_in_any_order_of_properties() {
    let rest: Vec<String> = (0..9).map(|i| format!("f_rest_{i}")).collect();
    let names = [owned(&PLAIN), rest].concat();
    let row = [plain_row(), (0..9).map(f64::from).collect()].concat();
    let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    for reversed in [false, true] {
        let mut names = names.clone();
        let mut row = row.clone();
        if reversed {
            names.reverse();
            row.reverse();
        }
        let ImportedSplats { splats, warnings, .. } =
            read("a.ply", &ply(&names, "float", &[row])).expect("valid");
        assert_eq!(
            (splats.len(), splats.sh_degree, splats.positions[0]),
            (1, 1, Vec3::new(1.0, 2.0, 3.0))
        );
        assert!(close(splats.scales[0], Vec3::new(-1.0, -2.0, -3.0).exp(), 1e-6));
        assert!(same_turn(splats.rotations[0], turn, 1e-6), "{:?}", splats.rotations[0]);
        assert_eq!((splats.opacity[0], splats.filter), (0.5, ScreenFilter::DILATED));
        let wanted = [[0.5, -0.5, 1.0], [0.0, 3.0, 6.0], [1.0, 4.0, 7.0], [2.0, 5.0, 8.0]];
        assert_eq!(
            (splats.sh.as_slice(), warnings.len()),
            (wanted.as_slice(), 0),
            "red, then green, then blue"
        );
    }
    let folder = tempfile::tempdir().expect("a folder");
    let low = read_in(
        folder.path(),
        "a.ply",
        &ply(&names, "float", &[row]),
        &ReadOptions::with_degree(0),
    );
    assert_eq!(low.expect("valid").splats.sh.len(), 4, "all degrees: they are drawn");
}

#[test]
fn gaussians_of_two_scales_are_discs_that_a_filter_widens() {
    let disc: Vec<&str> = PLAIN.into_iter().filter(|name| *name != "scale_2").collect();
    let mut row = plain_row();
    row.remove(9);
    let splats = read("a.ply", &ply(&owned(&disc), "float", &[row])).expect("valid").splats;
    assert!(close(splats.scales[0], Vec3::new((-1f32).exp(), (-2f32).exp(), 0.0), 1e-6));

    let names = [owned(&PLAIN), vec!["filter_3D".to_owned()]].concat();
    let row = [plain_row(), vec![0.1]].concat();
    let splats = read("a.ply", &ply(&names, "float", &[row])).expect("valid").splats;
    let sharp = DVec3::new(-1.0, -2.0, -3.0).exp();
    let wide = (sharp * sharp + 0.01).to_array().map(f64::sqrt);
    let share = sharp.to_array().iter().zip(wide).map(|(a, b)| a / b).product::<f64>();
    assert!(close(splats.scales[0], DVec3::from(wide).as_vec3(), 1e-6));
    assert!((f64::from(splats.opacity[0]) - 0.5 * share).abs() < 1e-6);
    assert_eq!(splats.filter, ScreenFilter::MIP);
}

#[test]
fn gaussians_that_are_not_finite_are_dropped_and_counted() {
    let mut rows = vec![plain_row(); 5];
    rows[1][0] = f64::NAN;
    rows[2][7] = 1000.0; // e^1000 is beyond any float
    rows[3][10..].fill(0.0); // no rotation
    let loaded = read("a.ply", &ply(&owned(&PLAIN), "float", &rows)).expect("two are left");
    assert_eq!(loaded.splats.len(), 2);
    assert_eq!(loaded.warnings, ["dropped 3 Gaussians with non-finite values (first: Gaussian 1)"]);
    let error =
        read("a.ply", &ply(&owned(&PLAIN), "float", &rows[1..4])).expect_err("none are left");
    assert!(error.to_string().contains("none of the 3 Gaussians is finite"), "{error}");
}

#[test]
fn gaussians_far_from_the_origin_keep_their_places() {
    let mut row = plain_row();
    row[0] = 500_000.123;
    let loaded = read("a.ply", &ply(&owned(&PLAIN), "double", &[row.clone(), row])).expect("valid");
    let world = f64::from(loaded.splats.positions[0].x) + loaded.provenance.placement.center[0];
    assert!((world - 500_000.123).abs() < 1e-4, "{world}");
    assert!(loaded.warnings[0].contains("far from the origin"));
}

#[test]
fn a_compressed_ply_is_unpacked_within_the_ranges_of_its_chunk() {
    let loaded = read("a.ply", &packed(true, true)).expect("valid").splats;
    assert!(close(loaded.positions[0], Vec3::new(7.0, 5.0, 9.0), 1e-3));
    assert!(close(loaded.scales[0], Vec3::new(1.0, (-4f32).exp(), 1.0), 1e-5));
    assert!(same_turn(loaded.rotations[0], Quat::from_xyzw(0.0, 0.0, 1.0, 0.0), 1e-4));
    assert!((loaded.opacity[0] - 0.2).abs() < 1e-6, "not a logit");
    let rgb = loaded.rgb(0);
    assert!((rgb[0] - 0.5).abs() < 1e-6 && rgb[1].abs() < 1e-6, "{rgb:?}");
    assert_eq!((loaded.sh[1][0], loaded.sh[2][0], loaded.sh[1][2]), (-4.0, 4.0, 4.0));
    assert!((loaded.sh[3][0] - 4.0 / 256.0).abs() < 1e-6);
    let plain = read("a.ply", &packed(false, false)).expect("valid").splats;
    assert!((plain.rgb(0)[0] - 1.0).abs() < 1e-6 && plain.sh_degree == 0);
}

/// Gaussians on a slanted sheet, `size` apart; `row` makes numbers of a length and a share.
fn sheet(size: f64, row: impl Fn(f64, f64) -> [f64; 2]) -> Vec<Vec<f64>> {
    let one = |i: usize| {
        let x = (i % 16) as f64;
        let y = (i / 16) as f64;
        let [scale, opacity] = row(size * (0.3 + 0.01 * x), 0.2 + 0.003 * i as f64);
        let place = [size * x, size * y, size * (x + y)];
        [place.to_vec(), vec![0.5, -0.5, 1.0, opacity, scale, scale, scale, 1.0, 0.0, 0.0, 0.0]]
            .concat()
    };
    (0..256).map(one).collect()
}

#[test]
fn splats_without_logarithms_or_logits_are_named() {
    let logit = |share: f64| (share / (1.0 - share)).ln();
    let read =
        |rows: &[Vec<f64>]| read("a.ply", &ply(&owned(&PLAIN), "float", rows)).expect("valid");
    for size in [0.02, 1.0, 500.0] {
        let usual = read(&sheet(size, |length, share| [length.ln(), logit(share)]));
        assert_eq!(usual.warnings, [""; 0], "{size}");
        let same = |other: &ImportedSplats| {
            let pairs = usual.splats.scales.iter().zip(&other.splats.scales);
            let scales = pairs.into_iter().all(|(a, b)| close(*a / *b, Vec3::ONE, 1e-4));
            let mut opacities = usual.splats.opacity.iter().zip(&other.splats.opacity);
            scales && opacities.all(|(a, b)| (a - b).abs() < 1e-5)
        };
        let both = read(&sheet(size, |length, share| [length, share]));
        assert!(same(&both), "{size}");
        assert!(
            both.warnings[0].contains("lengths") && both.warnings[0].contains("shares"),
            "{:?}",
            both.warnings
        );
        let one = read(&sheet(size, |length, share| [length, logit(share)]));
        assert!(
            same(&one)
                && one.warnings[0].contains("lengths")
                && !one.warnings[0].contains("shares"),
            "{size}"
        );
        let other = read(&sheet(size, |length, share| [length.ln(), share]));
        assert!(
            same(&other) && other.warnings[0].starts_with("its opacities"),
            "{size}: {:?}",
            other.warnings
        );
    }
}

#[test]
fn colours_stand_in_place_of_the_first_coefficient() {
    let names: Vec<String> = PLAIN
        .iter()
        .map(|name| {
            name.replace("f_dc_0", "red").replace("f_dc_1", "green").replace("f_dc_2", "blue")
        })
        .collect();
    let row = [&[1.0, 2.0, 3.0, 0.0, 1.0, 0.2][..], &plain_row()[6..]].concat();
    let floats = ply(&names, "float", std::slice::from_ref(&row));
    let text: Vec<String> = names
        .iter()
        .map(|name| {
            format!(
                "property {} {name}\n",
                if "red green blue".contains(name.as_str()) { "uchar" } else { "float" }
            )
        })
        .collect();
    let numbers = "1 2 3 0 255 51 0 -1 -2 -3 2 0 0 2\n";
    let bytes =
        format!("ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n{numbers}", text.concat());
    for file in [floats, bytes.into_bytes()] {
        let splats = read("a.ply", &file).expect("valid").splats;
        let rgb = splats.rgb(0);
        assert!(close(Vec3::from(rgb), Vec3::new(0.0, 1.0, 0.2), 1e-6), "{rgb:?}");
    }
}
