//! Gaussians in SOG.

use super::*;

#[test]
fn sog_is_read_from_its_pictures_and_codebooks() {
    let splats = read("a.sog", &sog_bytes(63)).expect("valid").splats;
    let wanted = Vec3::new(1f32.exp() - 1.0, 1.0 - 2f32.exp(), 0.0);
    assert!(close(splats.positions[0], wanted, 1e-5), "{:?}", splats.positions[0]);
    assert!(close(splats.scales[0], Vec3::new((-1f32).exp(), 1.0, (-1f32).exp()), 1e-6));
    assert!(
        same_turn(splats.rotations[0], Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), 1e-3),
        "the largest is x"
    );
    assert_eq!(
        (splats.sh[0], splats.sh[3], splats.sh_degree),
        ([0.75, 0.0, 0.75], [-0.5, 0.0, 0.0], 1)
    );
    assert!((splats.opacity[0] - 0.2).abs() < 1e-6);
    let error = read("a.sog", &sog_bytes(64)).expect_err("a list that is not there").to_string();
    assert!(error.contains("labels.webp") && error.contains("Gaussian 0"), "{error}");
}

#[test]
fn sog_bomb_is_refused_before_it_is_unpacked() {
    let large = webp_of([255, 0, 0, 255], 4000, 4000);
    let text = format!("{{\"version\": 2, \"list\": [{}0]}}", "0,".repeat(BOMB / 2)).into_bytes();
    for (name, bytes, needle) in
        [("u.webp", large, "has 16000000 pixels"), ("meta.json", text, "at most 1048576")]
    {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let small = zip::write::SimpleFileOptions::default();
        let mut old = zip::ZipArchive::new(std::io::Cursor::new(sog_bytes(0))).expect("an archive");
        for i in 0..old.len() {
            let entry = old.by_index(i).expect("an entry");
            if entry.name().expect("text") != name {
                archive.raw_copy_file(entry).expect("copied");
            }
        }
        archive.start_file(name, small).expect("an entry");
        archive.write_all(&bytes).expect("its bytes");
        let bytes = archive.finish().expect("a directory").into_inner();
        let began = std::time::Instant::now();
        let error = read("a.sog", &bytes).expect_err(name).to_string();
        assert!(error.contains(name) && error.contains(needle), "{error}");
        assert!(began.elapsed().as_millis() < 1000, "{:?}", began.elapsed());
    }
}

#[test]
fn an_unzipped_sog_is_read_by_its_folder_or_its_list() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path().join("toy");
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(sog_bytes(63))).expect("a zip");
    zip.extract(&at).expect("writable");
    let zipped = read_in(folder.path(), "a.sog", &sog_bytes(63), &options()).expect("valid").splats;
    for path in [at.clone(), at.join("meta.json")] {
        match read_content(&path, &options()).expect("valid") {
            Content::Splats(loaded) => assert_eq!(loaded.splats, zipped),
            Content::Scene(_) => panic!("Gaussians"),
        }
    }
    std::fs::remove_file(at.join("means_l.webp")).expect("there");
    assert!(
        read_content(&at, &options()).expect_err("a folder").to_string().contains("is a folder")
    );
}
