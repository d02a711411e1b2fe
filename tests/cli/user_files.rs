//! `capture` and `make` never delete or replace a file that they did not write, nor one that was
//! changed since.
#![cfg(unix)]

use super::capture::{Fake, names};
use super::stderr;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_fixtures::folders::copy_folder;

const CAPTURE: [&str; 4] = ["capture", "photos", "-o", "set"];

/// Every file below `folder` and its bytes.
fn all(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(all(&path))
        } else {
            drop(files.insert(path.clone(), std::fs::read(&path).unwrap()))
        }
    }
    files
}

#[test]
fn photos_in_the_output_of_a_capture_are_refused_and_stay() {
    let fake = Fake::new();
    fake.succeed(&CAPTURE);
    std::fs::create_dir(fake.at("m.make")).unwrap();
    let copied =
        Command::new("cp").arg("-r").arg(fake.at("set")).arg(fake.at("m.make/photos")).status();
    assert!(copied.unwrap().success());
    std::os::unix::fs::symlink("set/images", fake.at("link")).unwrap();
    std::fs::create_dir(fake.at("linked")).unwrap();
    std::os::unix::fs::symlink("../set/images/view_0001.png", fake.at("linked/a.png")).unwrap();
    std::os::unix::fs::symlink("../set/images", fake.at("linked/more")).unwrap();
    std::os::unix::fs::symlink("set", fake.at("same")).unwrap();
    let before = all(fake.folder());
    let inside = [
        "capture set/images -o set -f",
        "capture set/images/view_0001.png set/images/view_0002.png set/images/view_0003.png -o set -f",
        "capture set/sparse/../images -o ./set/ -f",
        "capture link -o set -f",
        "capture linked -o set -f",
        "capture linked/a.png -o set -f",
        "capture set/images -o same -f",
        "capture set/images -o set/images/view_0001.png/.. -f",
        "make m.make/photos/images -o m.glb -f",
        "make set/images -o m.glb --work set -f",
    ];
    for command in inside {
        let words: Vec<&str> = command.split(' ').collect();
        let said = fake.error(&words);
        let refused =
            said.contains("lies in the output folder") || said.contains("a folder outside of");
        assert!(refused, "{command}: {said}");
        assert!(all(fake.folder()) == before, "{command}");
    }
    for output in ["photos/set", "photos", "link/new", "photos/../photos/a/b"] {
        let input = if output.starts_with("link") { "set" } else { "photos" };
        let said = fake.error(&["capture", input, "-o", output, "-f"]);
        assert!(said.contains("a folder outside of"), "{output}: {said}");
        assert!(all(fake.folder()) == before, "{output}");
    }
}

#[test]
fn a_capture_whose_photos_are_gone_stops_and_nothing_changes() {
    let fake = Fake::new();
    fake.succeed(&CAPTURE);
    std::fs::remove_file(fake.at("set/images/view_0003.png")).unwrap();
    fake.calls();
    let before = all(fake.folder());
    let said = fake.error(&CAPTURE);
    assert!(said.contains("some of its photos are gone"), "{said}");
    assert!(fake.calls().is_empty() && all(fake.folder()) == before);
}

#[test]
fn a_model_that_the_user_changed_stays() {
    let fake = Fake::new();
    fake.succeed(&CAPTURE);
    let model =
        std::fs::read_to_string(fake.at("set/sparse/0/cameras.txt")).unwrap() + "# refined by me\n";
    std::fs::write(fake.at("set/sparse/0/cameras.txt"), &model).unwrap();
    let before = all(fake.folder());
    assert_eq!(fake.succeed(&CAPTURE).matches("done before").count(), 4);
    let said = fake.error(&[&CAPTURE[..], &["--mapper", "global"]].concat());
    assert!(said.contains("this one has a model already"), "{said}");
    fake.succeed(&[&CAPTURE[..], &["--mapper", "incremental"]].concat());
    assert!(
        all(fake.folder())
            .into_iter()
            .filter(|(path, _)| !path.ends_with("calls"))
            .eq(before.into_iter().filter(|(path, _)| !path.ends_with("calls")))
    );
}

#[test]
fn a_capture_of_other_photos_is_set_aside_with_the_users_files() {
    let fake = Fake::new();
    fake.succeed(&CAPTURE);
    let mine =
        ["images/mine.txt", "sparse/0/mine.txt", "sparse/mine/a", "capture/mine.txt", "mine.txt"];
    for name in mine {
        std::fs::create_dir_all(fake.at("set").join(name).parent().unwrap()).unwrap();
        std::fs::write(fake.at("set").join(name), name).unwrap();
    }
    let before = all(&fake.at("set"));
    let old = |name: &str| -> BTreeMap<PathBuf, Vec<u8>> {
        let files = all(&fake.at(name)).into_iter();
        files
            .map(|(path, bytes)| {
                (fake.at("set").join(path.strip_prefix(fake.at(name)).unwrap()), bytes)
            })
            .collect()
    };
    std::fs::remove_file(fake.at("photos/view_0003.png")).unwrap();
    assert!(fake.error(&CAPTURE).contains("the capture of other inputs"));
    let again = [&CAPTURE[..], &["--force"]].concat();
    for step in ["feature_extractor", "exhaustive_matcher", "mapper"] {
        std::fs::write(fake.at("fails"), step).unwrap();
        assert!(fake.error(&again).contains("the disk is made of cheese"), "{step}");
        assert!(old("set.old") == before, "{step}");
    }
    // The begun one goes on.
    std::fs::remove_file(fake.at("fails")).unwrap();
    fake.calls();
    let said = fake.succeed(&again);
    assert!(said.contains("39 photos") && said.matches("done before").count() == 2, "{said}");
    assert_eq!(fake.calls().len(), 2, "matching goes on, then the mapper");
    let next = all(&fake.at("set"));
    std::fs::remove_file(fake.at("photos/view_0004.png")).unwrap();
    assert!(fake.succeed(&again).contains("is in set.old-2 now"));
    assert!(old("set.old") == before && old("set.old-2") == next);
}

#[test]
fn a_photo_folder_that_is_a_link_stays_as_it_is() {
    let fake = Fake::new();
    fake.succeed(&CAPTURE);
    std::fs::remove_dir_all(fake.at("set/images")).unwrap();
    std::os::unix::fs::symlink("../photos", fake.at("set/images")).unwrap();
    copy_folder(&fake.at("photos"), &fake.at("other"));
    std::fs::remove_file(fake.at("other/view_0001.png")).unwrap();
    let before = all(&fake.at("photos"));
    fake.succeed(&["capture", "other", "-o", "set", "-f"]);
    assert!(all(&fake.at("photos")) == before && fake.at("set.old/images").is_symlink());
}

#[test]
fn photos_of_one_stem_are_all_taken() {
    let fake = Fake::new();
    let webp = |from: &str, to: &str| {
        let picture = trisplat_scene::image::RgbImage::load(&fake.at(from)).unwrap();
        let mut bytes = Vec::new();
        let rgb: Vec<u8> = picture.rgb.concat();
        let size = picture.size;
        image::codecs::webp::WebPEncoder::new_lossless(&mut bytes)
            .encode(&rgb, size.x, size.y, image::ExtendedColorType::Rgb8)
            .unwrap();
        std::fs::write(fake.at(to), bytes).unwrap();
    };
    webp("photos/view_0002.png", "photos/view_0001.webp");
    webp("photos/view_0003.png", "photos/view_0041.webp");
    std::fs::copy(fake.at("photos/view_0004.png"), fake.at("photos/VIEW_0005.PNG")).unwrap();
    let said = fake.succeed(&CAPTURE);
    assert!(said.contains("43 photos"), "{said}");
    let images = names(&fake.at("set/images"));
    assert_eq!(images.len(), 43, "{images:?}");
    let pixels = |name: &str| trisplat_scene::image::RgbImage::load(&fake.at(name)).unwrap();
    for (made, from) in [
        ("view_0001.png", "view_0001.png"),
        ("view_0001.webp.png", "view_0002.png"),
        ("view_0041.png", "view_0003.png"),
        ("VIEW_0005.PNG", "view_0004.png"),
        ("view_0005-2.png", "view_0005.png"),
    ] {
        assert!(
            pixels(&format!("set/images/{made}")) == pixels(&format!("photos/{from}")),
            "{made}"
        );
    }
}

/// A short run on small pictures; the fake program finds the poses.
const MAKE: [&str; 11] = [
    "make",
    "photos",
    "-o",
    "m.glb",
    "--max-size",
    "60",
    "--steps",
    "200",
    "--max-triangles",
    "500",
    "-f",
];

#[test]
fn a_users_scene_in_the_working_folder_is_not_replaced() {
    let fake = Fake::new();
    let make = [&MAKE[..], &["--work", "w"]].concat();
    for name in
        ["scene.ply", "training.json", "scene.checkpoint", "scene.teacher.ply", "files.json"]
    {
        std::fs::create_dir_all(fake.at("w")).unwrap();
        std::fs::write(fake.at("w").join(name), "mine").unwrap();
        let said = fake.error(&make);
        assert!(
            said.contains(&format!("w/{name}: is not a file that trisplat wrote; move it")),
            "{said}"
        );
        assert_eq!(std::fs::read_to_string(fake.at("w").join(name)).unwrap(), "mine");
        assert_eq!(names(&fake.at("w")).len(), 2, "photos and {name}: {:?}", names(&fake.at("w")));
        std::fs::remove_file(fake.at("w").join(name)).unwrap();
    }
    let output = fake.run(&make);
    assert!(output.status.success(), "{}", stderr(&output));
    // A finished scene that was changed is baked as it is, and never trained over.
    let scene = std::fs::read(fake.at("w/scene.ply")).unwrap();
    std::fs::write(fake.at("w/scene.ply"), [&scene[..], b"\n"].concat()).unwrap();
    let other: Vec<&str> =
        make.iter().map(|word| if *word == "60" { "50" } else { word }).collect();
    let said = fake.error(&other);
    assert!(said.contains("w/scene.ply: was changed after trisplat wrote it"), "{said}");
    assert!(std::fs::read(fake.at("w/scene.ply")).unwrap().len() == scene.len() + 1);
}

#[test]
fn capture_of_one_or_two_photos_is_refused_without_a_folder() {
    let fake = Fake::new();
    for photos in [&["photos/view_0001.png"][..], &["photos/view_0001.png", "photos/view_0002.png"]]
    {
        let said = fake.error(&[&["make", "-o", "m.glb"], photos].concat());
        assert!(
            said.contains(&format!("{} photo", photos.len())) && said.contains("give 3 or more"),
            "{said}"
        );
        assert!(
            fake.calls().is_empty() && !fake.at("m.make").exists() && !fake.at("m.glb").exists()
        );
    }
    std::fs::create_dir(fake.at("none")).unwrap();
    for input in ["none", "missing", "colmap"] {
        fake.error(&["make", input, "-o", "m.glb"]);
        assert!(!fake.at("m.make").exists(), "{input}");
    }
    // A data set with poses too.
    trisplat_fixtures::samples::photos(fake.at("two"), [2, 32, 60], 0);
    let said = fake.error(&["make", "two", "-o", "m.glb"]);
    assert!(said.contains("2 photos are not enough; give 3 or more"), "{said}");
    assert!(!fake.at("m.make").exists() && !fake.at("m.glb").exists());
}
