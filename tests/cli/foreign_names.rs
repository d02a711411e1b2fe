//! What a folder holds, and what its files are called: nothing in it runs, and nothing outside of
//! the output is written.
#![cfg(unix)]

use super::capture::{Fake, eprintln_not_checked, exif, heic, names};
use super::stderr;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use trisplat_scene::image::RgbImage;

/// Modules that Python, the scripts and what these import look for.
const MODULES: [&str; 8] =
    ["json", "os", "threading", "pycolmap", "pillow_heif", "PIL", "usercustomize", "site"];

#[test]
fn nothing_beside_the_photos_runs() {
    let who = Command::new("python3").args(["-c", "import sys; print(sys.executable)"]).output();
    let Some(python) = who.ok().filter(|who| who.status.success()) else {
        eprintln_not_checked("python3 is not installed");
        return;
    };
    let python = String::from_utf8(python.stdout).unwrap();
    let fake = Fake::new();
    let photos = fake.at("photos");
    let tools = fake.at("tools");
    std::fs::create_dir(&tools).unwrap();
    fake.program(
        "tools/python3",
        &format!(
            "#!/bin/sh\necho >> '{}'\nexec '{}' \"$@\"\n",
            fake.at("asked").display(),
            python.trim()
        ),
    );
    let asked = || std::fs::read(fake.at("asked")).unwrap_or_default().len();
    let ran = fake.at("ran");
    let plant = |name: &str, text: String| {
        std::fs::write(photos.join(name), text).unwrap();
        Command::new("chmod").arg("+x").arg(photos.join(name)).status().unwrap();
    };
    for name in MODULES {
        plant(
            &format!("{name}.py"),
            format!("open({:?}, 'a').write({name:?})\n", ran.display().to_string()),
        );
    }
    for name in ["colmap", "heif-convert", "ffmpeg", "magick", "glomap", "python"] {
        plant(
            name,
            format!(
                "#!/bin/sh\necho {name} >> '{}'\necho ffmpeg version heic COLMAP 3.8\n",
                ran.display()
            ),
        );
    }
    std::fs::write(photos.join("a.heic"), heic(&exif(1, [80, 60], 26), b"")).unwrap();
    // The folder of the photos is the current one, and an empty part of a path stands for it.
    let capture = || {
        let mut command = fake.command(&["capture", ".", "-o", "../set"]);
        command
            .current_dir(&photos)
            .env("PATH", format!(":{}", tools.display()))
            .env("PYTHONPATH", ":");
        command.output().unwrap()
    };
    let missing = capture();
    assert_eq!(missing.status.code(), Some(1), "{}", stderr(&missing));
    assert!(!ran.exists(), "{:?} ran", std::fs::read_to_string(&ran));
    assert!(asked() == 1, "pycolmap is asked for first");
    // The next program is asked whether it reads HEIC.
    let mut command = fake.command(&["capture", ".", "-o", "../set", "--poses", "../colmap"]);
    command
        .current_dir(&photos)
        .env("PATH", format!(":{}", tools.display()))
        .env("PYTHONPATH", ":");
    let missing = stderr(&command.output().unwrap());
    assert!(missing.contains("a.heic") && asked() == 2 && !ran.exists(), "{missing}");
    // A program that the user names by its place is found there.
    let mut command = fake.command(&["capture", ".", "-o", "../set", "--poses", "../colmap"]);
    let said = stderr(&command.current_dir(&photos).output().unwrap());
    assert!(said.contains("a.heic") && !ran.exists(), "{said}");
    std::fs::remove_file(photos.join("a.heic")).unwrap();
    let mut command = fake.command(&["capture", ".", "-o", "../set", "--poses", "../colmap"]);
    let said = stderr(&command.current_dir(&photos).output().unwrap());
    assert!(said.contains("40 of 40 photos") && !ran.exists(), "{said}");
}

/// Every file below a folder that is not of the capture, with its bytes.
fn outside(fake: &Fake) -> Vec<(String, Vec<u8>)> {
    let own = |name: &String| !["out", "calls"].contains(&name.as_str());
    let files = names(fake.folder()).into_iter().filter(own);
    files.filter_map(|name| Some((name.clone(), std::fs::read(fake.at(&name)).ok()?))).collect()
}

#[test]
fn a_photos_name_writes_nothing_outside_of_the_output() {
    let fake = Fake::new();
    let notes = exif(1, [64, 48], 26);
    fake.converter(&notes);
    let jpeg = RgbImage { size: [64, 48].into(), rgb: vec![[200, 90, 30]; 64 * 48], alpha: None };
    let jpeg = jpeg.to_jpeg(90).unwrap();
    std::fs::create_dir(fake.at("phone")).unwrap();
    // The second is hidden.
    let stems = [
        r"x\..\..\..\..\..\precious",
        r"..\..\precious",
        "-o",
        "c:precious",
        "a\nb",
        "nul",
        "%d[0]",
    ];
    for stem in stems {
        std::fs::write(fake.at("phone").join(format!("{stem}.heic")), heic(&notes, &jpeg)).unwrap();
        std::fs::write(fake.at("phone").join(format!("{stem}.jpeg")), &jpeg).unwrap();
    }
    std::fs::write(fake.at("precious.jpg"), "precious").unwrap();
    let before = outside(&fake);
    std::fs::create_dir(fake.at("out")).unwrap();
    let output = fake.run(&["capture", "phone", "-o", "out/a/b/set"]);
    assert!(stderr(&output).contains("12 photos"), "{}", stderr(&output));
    assert_eq!(outside(&fake), before);
    let folders =
        ["64x48", "64x48-26mm"].map(|folder| names(&fake.at("out/a/b/set/images").join(folder)));
    let taken = folders.concat();
    assert_eq!(taken.len(), 12, "{taken:?}");
    for name in &taken {
        assert!(!name.starts_with('-') && !name.contains(['\\', ':', '\n', '/']), "{name:?}");
    }
    assert!(
        taken.contains(&"_nul.jpg".into()) && taken.contains(&"%d[0].jpeg".into()),
        "{taken:?}"
    );
}

#[test]
fn capture_passes_names_that_no_program_misreads() {
    let fake = Fake::new();
    if !fake.video("walk.mp4", &["-frames:v", "12"]) {
        return;
    }
    let walk = std::fs::read(fake.at("walk.mp4")).unwrap();
    std::fs::create_dir(fake.at("clips")).unwrap();
    for name in ["...mp4", "%03d a.mp4", "-i.mp4", "file:x.mp4"] {
        std::fs::write(fake.at("clips").join(name), &walk).unwrap();
    }
    let capture = |output: &str, inputs: &[&str]| {
        let said = fake.run(&[&["capture", output, "--frames", "5"], inputs].concat());
        assert!(stderr(&said).contains("photos"), "{output}: {}", stderr(&said));
        assert!(!stderr(&said).contains("ffmpeg ended"), "{output}: {}", stderr(&said));
    };
    for folder in ["a%d", "http:o", "-dash"] {
        capture(&format!("--output={folder}"), &["walk.mp4"]);
        let set = Path::new(".").join(folder);
        let images = names(&fake.folder().join(set).join("images"));
        assert!(
            (2..=5).contains(&images.len()) && images[0].starts_with("frame_"),
            "{folder}: {images:?}"
        );
    }
    // In a folder, a name that begins with a dot is hidden.
    capture("--output=set", &["clips", "clips/...mp4"]);
    assert_eq!(names(&fake.at("set/images")), ["%03d_a", "_", "_i", "file_x"]);
    assert_eq!(
        names(&fake.at("set")),
        ["capture", "images", "sparse"],
        "frames are in their folders"
    );
    let pairs = std::fs::read_to_string(fake.at("set/capture/pairs.txt")).unwrap();
    assert!(pairs.lines().all(|line| line.split(' ').count() == 2), "{pairs}");
}

#[test]
fn a_link_to_itself_is_no_output() {
    let fake = Fake::new();
    symlink("round.glb", fake.at("round.glb")).unwrap();
    let scene = super::sample("studio.ply");
    for force in [&[][..], &["--force"]] {
        let bake =
            [&["bake", scene.to_str().unwrap(), "-o", "round.glb", "--preset", "fast"], force]
                .concat();
        let error = fake.error(&bake);
        assert!(error.contains("round.glb") && error.contains("leads to itself"), "{error}");
        assert!(fake.at("round.glb").is_symlink());
    }
}

#[test]
fn a_broken_photo_is_named_by_its_own_name() {
    let fake = Fake::new();
    let notes = exif(1, [64, 48], 26);
    fake.converter(&notes);
    let photo = RgbImage { size: [64, 48].into(), rgb: vec![[200, 90, 30]; 64 * 48], alpha: None };
    let jpeg = photo.to_jpeg(90).unwrap();
    std::fs::create_dir(fake.at("phone")).unwrap();
    // Without a head, and without a body in a photo that is turned.
    let turned =
        [&jpeg[..2], &[0xff, 0xe1, 0, 34], b"Exif\0\0", &exif_of(3), &jpeg[2..jpeg.len() / 2]]
            .concat();
    for broken in [&jpeg[..20], &turned] {
        std::fs::write(fake.at("phone/a.heic"), heic(&notes, broken)).unwrap();
        let error = fake.error(&["capture", "phone", "-o", "set"]);
        assert!(error.contains("phone/a.heic: ") && !error.contains(".trisplat."), "{error}");
    }
    for name in ["b.jpg", "c.jpg"] {
        std::fs::write(fake.at(name), &jpeg[..20]).unwrap();
    }
    let error = fake.error(&["capture", "b.jpg", "c.jpg", "-o", "set"]);
    assert!(error.starts_with("error: .: photos: b.jpg: "), "{error}");
}

/// TIFF with an orientation alone.
fn exif_of(orientation: u8) -> Vec<u8> {
    [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[orientation, 0, 0, 0, 0, 0, 0, 0]]
        .concat()
}
