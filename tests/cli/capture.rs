//! `trisplat capture` with a program in place of COLMAP that notes what it is asked for and answers
//! with a known model; and with pycolmap and ffmpeg, where they are installed.
#![cfg(unix)]

use super::stderr;
use super::train::dataset;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use trisplat::{Dataset, DatasetOptions};
use trisplat_fixtures::folders::copy_folder;
use trisplat_scene::image::RgbImage;

/// Stands in for COLMAP.
const COLMAP: &str = include_str!("../fixtures/colmap.sh");

/// A folder with the program and the model of the sample, and photos without poses.
pub(super) struct Fake {
    folder: tempfile::TempDir,
}

impl Fake {
    pub(super) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        copy_folder(&dataset().join("sparse/0"), &at("model"));
        copy_folder(&dataset().join("images"), &at("photos"));
        std::fs::write(at("calls"), "").unwrap();
        let fake = Self { folder };
        fake.program("colmap", COLMAP);
        fake
    }

    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(super) fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Stands in for a converter of [`heic`] photos with these notes.
    pub(super) fn converter(&self, notes: &[u8]) {
        let start = heic(notes, b"").len() + 1;
        let script = format!(
            "#!/bin/sh\n[ $# = 4 ] || exec echo usage\ntail -c +{start} \"$3\" > \"$4\"\n[ -s \"$4\" ]\n"
        );
        self.program("heif-convert", &script);
    }

    /// A program that is found first.
    pub(super) fn program(&self, name: &str, script: &str) {
        std::fs::write(self.at(name), script).unwrap();
        std::fs::set_permissions(self.at(name), std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Makes a video of the photos, four in a second, and lets the program find the ffmpeg of this
    /// shell; false where there is none.
    pub(super) fn video(&self, name: &str, options: &[&str]) -> bool {
        let Some(ffmpeg) = which("ffmpeg") else {
            eprintln_not_checked("ffmpeg is not installed");
            return false;
        };
        self.program("ffmpeg", &format!("#!/bin/sh\nexec '{}' \"$@\"\n", ffmpeg.display()));
        let mut command = Command::new(ffmpeg);
        command.args(["-v", "error", "-framerate", "4", "-i"]).arg(self.at("photos/view_%04d.png"));
        command.args(options).args(["-pix_fmt", "yuv420p"]).arg(self.at(name));
        assert!(command.status().unwrap().success(), "ffmpeg fails");
        true
    }

    pub(super) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let path = format!("{}:/usr/bin:/bin", self.folder.path().display());
        command.current_dir(self.folder.path()).env("PATH", path).env_remove("TRISPLAT_POSES");
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub(super) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    pub(super) fn succeed(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    }

    /// The one error of a run.
    pub(super) fn error(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "{text}");
        errors[0].to_owned()
    }

    /// The commands that the program was asked for since the last question.
    pub(super) fn calls(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.at("calls")).unwrap_or_default();
        std::fs::write(self.at("calls"), "").unwrap();
        text.lines().map(str::to_owned).collect()
    }
}

pub(super) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const CAPTURE: [&str; 4] = ["capture", "photos", "-o", "set"];

#[test]
fn photos_become_a_data_set_and_nothing_is_done_twice() {
    let fake = Fake::new();
    let said = fake.succeed(&[&CAPTURE[..], &["--report", "report.json"]].concat());
    for row in [
        "photos     40 photos",
        "features   COLMAP 3.8",
        "matches    780 pairs, exhaustive",
        "40 of 40 photos",
    ] {
        assert!(said.contains(row), "{said}");
    }
    let calls = fake.calls();
    let commands: Vec<&str> = calls.iter().map(|call| call.split(' ').next().unwrap()).collect();
    assert_eq!(commands, ["feature_extractor", "exhaustive_matcher", "mapper"]);
    for option in [
        "--ImageReader.single_camera 1",
        "--SiftExtraction.use_gpu 0",
        "--SiftExtraction.max_image_size",
    ] {
        assert!(calls[0].contains(option), "{}", calls[0]);
    }
    assert!(!calls[0].contains("num_threads"), "this version has no such option: {}", calls[0]);
    assert!(
        calls[1].contains("--SiftMatching.use_gpu 0") && !calls[1].contains("FeatureMatching"),
        "{}",
        calls[1]
    );
    let set = Dataset::load(fake.at("set"), &DatasetOptions::default()).unwrap();
    assert_eq!(set.views.len(), 40);
    assert!(fake.at("set/capture/poses.log").is_file());
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(fake.at("report.json")).unwrap()).unwrap();
    let stages: Vec<&str> =
        report["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(stages, ["photos", "features", "matches", "model", "verdict"]);
    let verdict = &report["stages"][4]["details"];
    assert_eq!(
        (verdict["registered"].as_u64(), verdict["verdict"].as_str()),
        (Some(40), Some("good")),
        "{verdict}"
    );
    assert!(
        verdict["error_px"].as_f64().unwrap() < 0.5 && verdict["exposure"].as_f64().unwrap() < 0.07
    );

    let again = fake.succeed(&CAPTURE);
    assert_eq!(again.matches("done before").count(), 4, "{again}");
    assert!(fake.calls().is_empty());
    // Other photos are another capture.
    std::fs::remove_file(fake.at("photos/view_0003.png")).unwrap();
    assert!(
        fake.error(&CAPTURE).contains("the capture of other inputs"),
        "{}",
        fake.error(&CAPTURE)
    );
    let said = fake.succeed(&[&CAPTURE[..], &["--force"]].concat());
    assert!(said.contains("39 photos") && names(&fake.at("set/images")).len() == 39, "{said}");
}

#[test]
fn photos_without_poses_are_counted_and_advice_is_given() {
    let fake = Fake::new();
    let images = fake.at("model/images.txt");
    // Every photo has two lines; those of two neighbours go.
    let text = std::fs::read_to_string(&images).unwrap();
    let (head, rows): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with('#'));
    let kept = rows
        .chunks(2)
        .filter(|pair| !["view_0010", "view_0011"].iter().any(|n| pair[0].contains(n)));
    let lines: Vec<&str> = head.into_iter().chain(kept.flatten().copied()).collect();
    std::fs::write(&images, lines.join("\n") + "\n").unwrap();
    let said = fake.succeed(&CAPTURE);
    assert!(said.contains("38 of 40 photos have a pose"), "{said}");
    assert!(
        said.contains("take more photos between view_0009.png and view_0012.png: 2 there"),
        "{said}"
    );
}

#[test]
fn a_lens_that_folds_over_is_found_again_without_distortion() {
    let fake = Fake::new();
    copy_folder(&fake.at("model"), &fake.at("straight"));
    let cameras = fake.at("model/cameras.txt");
    let text = std::fs::read_to_string(&cameras).unwrap();
    let folded = text.replace(" PINHOLE 160 120 168 167.2 ", " SIMPLE_RADIAL 160 120 168 ");
    let folded = folded.trim_end().to_owned() + " -9\n";
    std::fs::write(&cameras, folded).unwrap();
    let said = fake.succeed(&CAPTURE);
    assert!(said.contains("40 of 40 photos have a pose (incremental, lens without"), "{said}");
    assert!(said.contains("one focal length without distortion; photos from other"), "{said}");
    let mappers: Vec<String> =
        fake.calls().into_iter().filter(|call| call.starts_with("mapper")).collect();
    assert_eq!(mappers.len(), 2, "{mappers:?}");
    assert!(mappers[1].ends_with("--Mapper.ba_refine_extra_params 0"), "{mappers:?}");
    assert_eq!(Dataset::load(fake.at("set"), &DatasetOptions::default()).unwrap().views.len(), 40);
    let again = fake.succeed(&CAPTURE);
    assert!(again.contains("one focal length without distortion"), "known later too: {again}");

    // A model from before, or another's, whose every photo has that lens.
    copy_folder(&fake.at("model"), &fake.at("set/sparse/0"));
    let error = fake.error(&["train", "set", "-o", "a.ply"]);
    for part in ["folds over", "no photo is left: all 40 fail", "a simpler lens"] {
        assert!(error.contains(part), "{error}");
    }
    assert!(!error.contains("--skip-broken"), "{error}");
    let mended = fake.succeed(&CAPTURE);
    assert!(mended.contains("lens without distortion"), "{mended}");
    assert_eq!(Dataset::load(fake.at("set"), &DatasetOptions::default()).unwrap().views.len(), 40);
}

#[test]
fn what_is_missing_or_fails_is_one_error_with_its_remedy() {
    let fake = Fake::new();
    let nothing = fake.at("empty");
    std::fs::create_dir(&nothing).unwrap();
    let output = fake.command(&CAPTURE).env("PATH", &nothing).output().unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    for remedy in ["pip install pycolmap", "apt install colmap", "brew install colmap", "--poses"] {
        assert!(text.contains(remedy), "{text}");
    }
    assert!(!fake.at("set").exists());
    let wrong = fake.error(&[&CAPTURE[..], &["--poses", "/bin/true"]].concat());
    assert!(wrong.contains("--poses is /bin/true: expected a colmap program"), "{wrong}");

    std::fs::write(fake.at("fails"), "exhaustive_matcher").unwrap();
    let failed = fake.error(&CAPTURE);
    for part in ["set/capture/poses.log", "colmap ended with", "the disk is made of cheese"] {
        assert!(failed.contains(part), "{failed}");
    }
    assert!(!fake.at("set/sparse").exists());
    std::fs::remove_file(fake.at("fails")).unwrap();
    fake.calls();
    fake.succeed(&CAPTURE);
    let calls = fake.calls();
    assert!(calls[0].starts_with("exhaustive_matcher") && calls.len() == 2, "{calls:?}");

    std::fs::write(fake.at("photos/IMG_1.NEF"), "x").unwrap();
    assert!(
        fake.error(&["capture", "photos", "-o", "other"]).contains("IMG_1.NEF: is a raw photo")
    );
    assert!(fake.error(&["capture", "model", "-o", "other"]).contains("holds no photo"));
    assert!(fake.error(&["capture", "photos", "-o", "model"]).contains("raw photo"));
    std::fs::remove_file(fake.at("photos/IMG_1.NEF")).unwrap();
    assert!(fake.error(&["capture", "photos", "-o", "model"]).contains("a new or empty folder"));
    assert!(
        fake.error(&["capture", "photos", "-o", "photos/set"])
            .contains("a folder outside of photos")
    );
    assert!(!fake.at("other").exists() && !fake.at("photos/set").exists());
}

/// Waits until `is` there.
fn wait_for(what: &str, is: impl Fn() -> bool) {
    let began = Instant::now();
    while !is() {
        assert!(began.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn interrupt(child: &Child) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
}

#[test]
fn capture_interrupted_leaves_no_program_and_resumes() {
    let fake = Fake::new();
    std::fs::write(fake.at("waits"), "mapper").unwrap();
    let child = fake.command(&CAPTURE).spawn().unwrap();
    wait_for("the mapper begins", || {
        std::fs::read_to_string(fake.at("pids")).is_ok_and(|t| t.ends_with('\n'))
    });
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("the same command goes on from here"), "{}", stderr(&output));
    let pids = std::fs::read_to_string(fake.at("pids")).unwrap();
    let is_gone = |pid: &str| {
        let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        state.is_empty() || state.contains(") Z")
    };
    wait_for("orphans", || pids.split_whitespace().all(is_gone));
    assert!(!fake.at("set/sparse").exists());
    assert!(
        names(&fake.at("set")).iter().all(|name| ["images", "capture"].contains(&name.as_str()))
    );
    std::fs::remove_file(fake.at("waits")).unwrap();
    fake.calls();
    let said = fake.succeed(&CAPTURE);
    assert_eq!(said.matches("done before").count(), 2, "{said}");
    assert_eq!(fake.calls().len(), 2, "matching goes on, then the mapper");
}

#[test]
fn a_program_that_outlives_a_killed_capture_is_not_disturbed() {
    let fake = Fake::new();
    std::fs::write(fake.at("waits"), "feature_extractor").unwrap();
    let mut child = fake.command(&CAPTURE).spawn().unwrap();
    let pids = || std::fs::read_to_string(fake.at("pids")).unwrap_or_default();
    wait_for("the program begins", || pids().ends_with('\n'));
    child.kill().unwrap();
    child.wait().unwrap();
    std::fs::remove_file(fake.at("waits")).unwrap();
    let busy = fake.error(&CAPTURE);
    assert!(busy.contains("poses.lock") && busy.contains("an earlier run has started"), "{busy}");
    let pids = pids();
    pids.split_whitespace().for_each(|pid| drop(Command::new("kill").args(["-9", pid]).status()));
    assert!(fake.succeed(&CAPTURE).contains("have a pose"));
}

/// A JPEG that says how its camera was held.
fn held(picture: &RgbImage, orientation: u8) -> Vec<u8> {
    let entry = [0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0];
    let tiff = [&b"II*\0\x08\0\0\0\x01\0"[..], &entry, &[0; 4]].concat();
    let jpeg = picture.to_jpeg(95).unwrap();
    let length = (2 + 6 + tiff.len() as u16).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, b"Exif\0\0", &tiff, &jpeg[2..]].concat()
}

#[test]
fn capture_turns_photos_upright_and_sorts_them_by_size() {
    let fake = Fake::new();
    let upright = RgbImage::load(&fake.at("photos/view_0004.png")).unwrap();
    // Held on its right side: the file is what the camera's chip saw.
    let turned = upright.turned(8);
    std::fs::create_dir(fake.at("phone")).unwrap();
    std::fs::write(fake.at("phone/a.jpg"), held(&turned, 6)).unwrap();
    std::fs::write(fake.at("phone/b.jpg"), held(&upright, 1)).unwrap();
    std::fs::write(fake.at("phone/c.jpg"), held(&turned, 1)).unwrap();
    fake.run(&["capture", "phone", "-o", "set"]);
    let [w, h] = [upright.size.x, upright.size.y];
    let [wide, high] = [format!("{w}x{h}"), format!("{h}x{w}")];
    assert_eq!(names(&fake.at("set/images").join(&wide)), ["a.jpg", "b.jpg"]);
    assert_eq!(names(&fake.at("set/images").join(&high)), ["c.jpg"]);
    assert!(fake.calls()[0].contains("--ImageReader.single_camera_per_folder 1"));
    let made = RgbImage::load(&fake.at("set/images").join(&wide).join("a.jpg")).unwrap();
    assert_eq!(made.size, upright.size);
    let apart = made
        .rgb
        .iter()
        .zip(&upright.rgb)
        .flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))));
    let mean = apart.sum::<f64>() / (3.0 * made.rgb.len() as f64);
    assert!(mean < 3.0, "{mean} codes");
    let untouched = std::fs::read(fake.at("set/images").join(&wide).join("b.jpg")).unwrap();
    assert!(untouched == held(&upright, 1));
}

#[test]
fn a_video_gives_frames_that_are_compared_in_sequence() {
    let fake = Fake::new();
    if !fake.video("walk.mp4", &["-r", "8"]) {
        return;
    }
    let said = fake.succeed(&["capture", "walk.mp4", "-o", "set", "--frames", "30"]);
    let taken = names(&fake.at("set/images"));
    assert!((10..=30).contains(&taken.len()) && taken[0].starts_with("frame_"), "{taken:?}");
    assert!(said.contains(&format!("{} of 80 frames", taken.len())), "{said}");
    let matching = &fake.calls()[1];
    assert!(
        matching.starts_with("matches_importer") && matching.contains("--match_type pairs"),
        "{matching}"
    );
    let pairs = std::fs::read_to_string(fake.at("set/capture/pairs.txt")).unwrap();
    assert!(pairs.lines().count() >= taken.len() - 1);
    // Every two frames are one picture, which is taken once.
    let picture = |name: &String| name[6..12].parse::<u32>().unwrap() / 2;
    assert!(taken.windows(2).all(|pair| picture(&pair[1]) > picture(&pair[0])), "{taken:?}");
}

/// As iPhones record, here of pixels that are wider than high.
#[test]
fn frames_of_hdr_videos_look_like_photos() {
    let fake = Fake::new();
    let hdr = "setsar=4/3,format=yuv420p,setparams=color_primaries=bt2020:color_trc=arib-std-b67:colorspace=bt2020nc";
    let made = |name: &str, filter: &str| fake.video(name, &["-r", "8", "-vf", filter]);
    if !made("hlg.mp4", hdr) || !made("plain.mp4", "setsar=4/3") {
        return;
    }
    let saturation = |video: &str, set: &str| {
        let said = fake.succeed(&["capture", video, "-o", set, "--frames", "8"]);
        let photo = fake.at(set).join("images").join(&names(&fake.at(set).join("images"))[0]);
        let photo = RgbImage::load(&photo).unwrap();
        assert_eq!(photo.size.to_array(), [213, 120]);
        let spread =
            |rgb: &[u8; 3]| rgb.iter().max().zip(rgb.iter().min()).map_or(0, |(a, b)| a - b);
        let sum: f64 = photo.rgb.iter().map(|rgb| f64::from(spread(rgb))).sum();
        (sum / photo.rgb.len() as f64, said)
    };
    let (plain, _) = saturation("plain.mp4", "plain");
    let (mapped, said) = saturation("hlg.mp4", "hlg");
    assert!(mapped > 1.5 * plain || said.contains("HDR video (HLG)"), "{mapped} {plain}");
}

fn which(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(program)).find(|file| file.is_file())
}

#[expect(clippy::print_stderr, reason = "a test that is skipped says so")]
pub(super) fn eprintln_not_checked(why: &str) {
    eprintln!("NOT CHECKED: {why}");
}

#[test]
fn pycolmap_finds_the_poses_of_the_sample() {
    let python = std::env::var("TRISPLAT_POSES").unwrap_or("python3".into());
    let probe =
        Command::new(&python).args(["-c", "import pycolmap"]).stderr(Stdio::null()).status();
    if !probe.is_ok_and(|status| status.success()) {
        eprintln_not_checked("no pycolmap in python3; TRISPLAT_POSES names another Python");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let trisplat = |words: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output = command.current_dir(folder.path()).args(words.split(' ')).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    trisplat_fixtures::samples::photos(folder.path().join("truth"), [16, 480, 1500], 0);
    let said = trisplat(&format!("capture truth/images -o set --poses {python}"));
    assert!(said.contains("16 of 16 photos have a pose") && said.contains("pycolmap"), "{said}");
    let load =
        |name: &str| Dataset::load(folder.path().join(name), &DatasetOptions::default()).unwrap();
    let found = load("set");
    let truth = load("truth");
    // Poses are found up to a similarity: ratios of distances between cameras are the same.
    let ratio = |set: &Dataset, a: usize, b: usize| {
        let at = |i: usize| set.views[i].camera.position();
        at(a).distance(at(b)) / at(0).distance(at(8))
    };
    for (a, b) in [(1, 5), (3, 12), (0, 15), (7, 11)] {
        let found = ratio(&found, a, b);
        let truth = ratio(&truth, a, b);
        assert!((found / truth - 1.0).abs() < 0.03, "{a} {b}: {found} {truth}");
    }
}

/// A block of EXIF: orientation, size and focal length.
pub(super) fn exif(orientation: u16, size: [u16; 2], focal_35: u16) -> Vec<u8> {
    let entry = |tag: u16, kind: u16, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()]
            .concat()
    };
    let table = |entries: &[Vec<u8>]| {
        [&(entries.len() as u16).to_le_bytes()[..], &entries.concat(), &[0; 4]].concat()
    };
    let first = table(&[entry(0x0112, 3, orientation.into()), entry(0x8769, 4, 8 + 30)]);
    let second = [(0xa002, size[0]), (0xa003, size[1]), (0xa405, focal_35)];
    let second = table(&second.map(|(tag, value)| entry(tag, 3, value.into())));
    [b"II\x2a\0\x08\0\0\0", &first[..], &second].concat()
}

/// A HEIC file with a JPEG for [`Fake::converter`].
pub(super) fn heic(exif: &[u8], jpeg: &[u8]) -> Vec<u8> {
    let part = |name: &[u8], body: &[u8]| {
        [&(8 + body.len() as u32).to_be_bytes()[..], name, body].concat()
    };
    let item = part(b"infe", b"\x02\0\0\0\0\x01\0\0Exif\0");
    let items = part(b"iinf", &[&b"\0\0\0\0\0\x01"[..], &item].concat());
    let data = part(b"idat", &[&[0; 4], exif].concat());
    let length = (4 + exif.len() as u32).to_be_bytes();
    let place = [&b"\x01\0\0\0\x44\0\0\x01\0\x01\0\x01\0\0\0\x01\0\0\0\0"[..], &length].concat();
    let meta = [&[0; 4], &items[..], &data, &part(b"iloc", &place)].concat();
    [part(b"ftyp", b"heic\0\0\0\0mif1heic"), part(b"meta", &meta), part(b"mdat", jpeg)].concat()
}

/// As iPhones take them: programs turn them and say so, turn them and still say to turn them, or
/// leave that to whoever reads the JPEG.
#[test]
fn heic_photos_are_converted_upright_with_their_focal_length() {
    let fake = Fake::new();
    let notes = exif(6, [80, 60], 26);
    fake.converter(&notes);
    std::fs::create_dir(fake.at("phone")).unwrap();
    // Upright, its upper half is red.
    let red = |[w, h]: [u32; 2], is_red: &dyn Fn(u32, u32) -> bool| {
        let pixel = |i: u32| if is_red(i % w, i / w) { [200, 20, 20] } else { [20, 20, 200] };
        let picture =
            RgbImage { size: [w, h].into(), rgb: (0..w * h).map(pixel).collect(), alpha: None };
        picture.to_jpeg(95).unwrap()
    };
    let upright = red([60, 80], &|_, y| y < 40);
    let lying = red([80, 60], &|x, _| x < 40);
    let noted = |jpeg: &[u8], notes: &[u8]| {
        let length = (2 + 6 + notes.len() as u16).to_be_bytes();
        [&jpeg[..2], b"\xff\xe1", &length, b"Exif\0\0", notes, &jpeg[2..]].concat()
    };
    for (name, jpeg) in
        [("a", upright.clone()), ("b", noted(&upright, &notes)), ("c", noted(&lying, &notes))]
    {
        std::fs::write(fake.at(&format!("phone/{name}.HEIC")), heic(&notes, &jpeg)).unwrap();
    }
    std::fs::write(fake.at("phone/d.heic"), heic(&notes, b"")).unwrap();
    let capture = ["capture", "phone", "-o", "set", "--report", "report.json"];
    let error = fake.error(&capture);
    assert!(error.contains("phone/d.heic") && error.contains("heif-convert ended with"), "{error}");
    std::fs::remove_file(fake.at("phone/d.heic")).unwrap();
    let said = fake.succeed(&capture);
    assert!(said.contains("3 photos, 1 turned upright, 3 converted"), "{said}");
    assert_eq!(names(&fake.at("set/images")), ["a.jpg", "b.jpg", "c.jpg"]);
    for name in ["a", "b", "c"] {
        let picture = RgbImage::load(&fake.at(&format!("set/images/{name}.jpg"))).unwrap();
        assert_eq!(picture.size.to_array(), [60, 80], "{name}");
        assert!(
            picture.rgb[60 * 5 + 30][0] > 150 && picture.rgb[60 * 75 + 30][2] > 150,
            "{name} is not upright"
        );
        let bytes = std::fs::read(fake.at(&format!("set/images/{name}.jpg"))).unwrap();
        let upright = exif(1, [80, 60], 26);
        assert!(bytes.windows(upright.len()).any(|part| part == upright), "{name} lost its notes");
    }
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(fake.at("report.json")).unwrap()).unwrap();
    assert_eq!(report["stages"][0]["details"]["focal_known"], 3, "{report}");
    // 26 mm of a film's diagonal.
    let focal = format!("focal length {:.0} px", 26.0 / 43.2666 * 100.0);
    assert!(said.contains(&focal), "{said}");

    // Programs that convert nothing, whatever they say of themselves; and names that lie.
    fake.program("heif-convert", "#!/bin/sh\necho 'reads HEIC' >&2\n");
    let python = "#!/bin/sh\necho \"No module named 'pillow_heif': ready for HEIC\" >&2\nexit 1\n";
    ["python3", "python"].iter().for_each(|name| fake.program(name, python));
    let start = heic(&notes, b"").len() + 1;
    fake.program("ffmpeg", &format!("#!/bin/sh\ntail -c +{start} \"$5\" > \"${{12}}\"\n"));
    std::fs::rename(fake.at("phone/a.HEIC"), fake.at("phone/a.JPG")).unwrap();
    let e = noted(&upright, &exif(1, [80, 60], 26));
    std::fs::write(fake.at("phone/e.HEIC"), e).unwrap();
    let said = fake.succeed(&["capture", "phone", "-o", "renamed"]);
    assert!(said.contains("4 photos, 1 turned upright, 3 converted"), "{said}");
    assert_eq!(names(&fake.at("renamed/images")), ["a.jpg", "b.jpg", "c.jpg", "e.jpg"]);

    // Without a program, whatever else this system has.
    ["heif-convert", "python3", "python", "ffmpeg"]
        .iter()
        .for_each(|name| std::fs::remove_file(fake.at(name)).unwrap());
    let mut command = fake.command(&["capture", "phone", "-o", "other"]);
    let said = stderr(&command.env("PATH", fake.folder()).output().unwrap());
    assert!(
        said.contains("phone/a.JPG") && said.contains("libheif") && said.contains("pillow-heif"),
        "{said}"
    );
    assert!(!fake.at("other").exists(), "{said}");
}

#[test]
fn make_leaves_a_broken_photo_out_if_that_is_wanted() {
    let fake = Fake::new();
    let picture =
        RgbImage { size: [64, 48].into(), rgb: vec![[200, 90, 30]; 64 * 48], alpha: None };
    let jpeg = picture.to_jpeg(90).unwrap();
    std::fs::write(fake.at("photos/broken.jpg"), &jpeg[..jpeg.len() / 2]).unwrap();
    let make = [
        "make",
        "photos",
        "-o",
        "scene.glb",
        "--steps",
        "200",
        "--max-size",
        "60",
        "--max-triangles",
        "500",
    ];
    let error = fake.error(&make);
    assert!(error.contains("broken.jpg") && error.contains("1 of 41 photos is broken"), "{error}");
    assert!(error.ends_with("or skip them with --skip-broken"), "{error}");
    let said = fake.succeed(&[&make[..], &["--skip-broken"]].concat());
    assert!(
        said.contains("1 of 41 photos is broken and left out") && fake.at("scene.glb").is_file(),
        "{said}"
    );
}

/// A model of the first points only.
fn with_points(fake: &Fake, most: usize) {
    let id_of = |word: &str| word.parse::<f64>().is_ok_and(|id| id > most as f64);
    let points = std::fs::read_to_string(fake.at("model/points3D.txt")).unwrap();
    let few: Vec<&str> =
        points.lines().filter(|line| line.split(' ').next().is_none_or(|id| !id_of(id))).collect();
    std::fs::write(fake.at("model/points3D.txt"), few.join("\n") + "\n").unwrap();
    let images = std::fs::read_to_string(fake.at("model/images.txt")).unwrap();
    let seen = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let kept = words.chunks(3).flat_map(|seen| match seen {
            [x, y, id] => [*x, *y, if id_of(id) { "-1" } else { id }],
            _ => panic!("{line}"),
        });
        kept.collect::<Vec<_>>().join(" ")
    };
    let mut is_pose = false;
    let lines = images.lines().map(|line| {
        is_pose = !line.starts_with('#') && !is_pose;
        if is_pose || line.starts_with('#') || line.is_empty() {
            line.to_owned()
        } else {
            seen(line)
        }
    });
    let text = lines.collect::<Vec<_>>().join("\n") + "\n";
    std::fs::write(fake.at("model/images.txt"), text).unwrap();
}

#[test]
fn make_stops_after_a_hopeless_capture() {
    let fake = Fake::new();
    // Fewer than eight for each of the 40 photos, but each photo sees more than ten.
    with_points(&fake, 300);
    let make = [
        "make",
        "photos",
        "-o",
        "scene.glb",
        "--steps",
        "100",
        "--max-size",
        "60",
        "--max-triangles",
        "300",
    ];
    let error = fake.error(&make);
    assert!(
        error.contains("is a poor capture: 300 points tie") && error.contains("--anyway"),
        "{error}"
    );
    assert!(!fake.at("scene.glb").exists() && !fake.at("scene.make/scene.ply").exists());
    let said = fake.succeed(&[&make[..], &["--anyway"]].concat());
    assert!(said.contains("done before") && fake.at("scene.glb").exists(), "{said}");
}
