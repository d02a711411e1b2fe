//! Gaussians in SPZ.

use super::*;

#[test]
fn spz_is_unpacked_in_its_own_frame_with_y_up() {
    let half = Quat::from_xyzw(0.0, 0.0, 0.5f32.sqrt(), 0.5f32.sqrt());
    for (version, turn, bytes) in [
        (2, Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), gzipped(&spz_bytes(2))),
        (3, half, gzipped(&spz_bytes(3))),
        (4, half, spz4_bytes()),
    ] {
        let loaded = read("a.spz", &bytes).expect("valid");
        let splats = loaded.splats;
        assert_eq!(splats.positions[0], Vec3::new(-1.0, 1.5, 0.0));
        assert!(close(splats.scales[0], Vec3::new(1.0, (-1f32).exp(), (-2f32).exp()), 1e-6));
        assert!((splats.opacity[0] - 0.2).abs() < 1e-6);
        assert!(
            (splats.sh[0][0] - 0.5 / 0.15).abs() < 1e-5
                && (splats.sh[0][1] + 0.5 / 0.15).abs() < 1e-5
        );
        assert_eq!(splats.sh[1], [0.0, -1.0, 0.5], "channels are innermost");
        assert!(same_turn(splats.rotations[0], turn, 1e-2), "{version}: {:?}", splats.rotations[0]);
        assert_eq!(
            (splats.filter, loaded.provenance.up),
            (ScreenFilter::ANTIALIASED, Some(UpAxis::Y))
        );
    }
}

#[test]
fn arrays_of_spz_4_that_do_not_fit_are_refused() {
    type Edit = fn(&mut Vec<u8>);
    let cases: [(Edit, &str); 5] = [
        (|b| b[8..12].copy_from_slice(&u32::MAX.to_le_bytes()), "promises 4294967295"),
        (|b| b[40] = 10, "10 bytes by the table"),
        (|b| b[16..20].copy_from_slice(&u32::MAX.to_le_bytes()), "table of arrays"),
        (|b| b[39] = 1, "array 0: lies beyond"),
        (|b| b[128] = 0, "zstd -t"),
    ];
    for (edit, needle) in cases {
        let mut bytes = spz4_bytes();
        edit(&mut bytes);
        let error = read("a.spz", &bytes).expect_err(needle).to_string();
        assert!(error.contains(needle) && !error.contains('\n'), "{needle}: {error}");
    }
}

#[test]
fn a_bomb_of_gzip_is_unpacked_to_what_its_header_needs() {
    let mut spz = spz_bytes(3);
    spz.resize(BOMB, 0);
    let began = std::time::Instant::now();
    assert_eq!(read("a.spz", &gzipped(&spz)).expect("the rest is left").splats.len(), 1);
    let mut many = spz_bytes(3)[..16].to_vec();
    many[8..12].copy_from_slice(&200_000_000u32.to_le_bytes());
    many.resize(BOMB, 0);
    let error = read("a.spz", &gzipped(&many)).expect_err("more than gzip can hold").to_string();
    assert!(
        error.contains("promises 200000000 Gaussians") && error.contains("cut short"),
        "{error}"
    );
    assert!(began.elapsed().as_secs() < 10, "{:?}", began.elapsed());
}

#[test]
fn a_bomb_of_zstd_is_refused_before_it_is_unpacked() {
    // A block of zstd repeats one byte 2^17 times in four bytes.
    let blocks = [[0x02, 0x00, 0x10, 0x00]; 10_000].concat();
    let frame = [&[0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58][..], &blocks, &[0x03, 0, 0x10, 0]].concat();
    for (claimed, needle) in [(1u64 << 31, "2147483648 bytes by the table"), (9, "array")] {
        let mut bytes = spz4_bytes();
        bytes[32..40].copy_from_slice(&(frame.len() as u64).to_le_bytes());
        bytes[40..48].copy_from_slice(&claimed.to_le_bytes());
        bytes.truncate(128);
        bytes.extend(&frame);
        let began = std::time::Instant::now();
        let error = read("a.spz", &bytes).expect_err("a bomb").to_string();
        assert!(error.contains(needle) && !error.contains('\n'), "{error}");
        assert!(began.elapsed().as_millis() < 1000, "{:?}", began.elapsed());
    }
}
