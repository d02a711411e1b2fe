//! What the command line says: errors that name the remedy, scores, percents, colours.

use super::{fails, sample, stderr, trisplat};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use trisplat_fixtures::folders::copy_folder;

fn dataset() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset")
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    String::from_utf8(output.stdout.clone()).unwrap()
}

#[test]
fn a_setting_of_the_wrong_type_is_named_with_what_it_wants() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    let refused = |setting: &str, wants: &[&str]| {
        fails(folder.path(), &[&"train", &dataset(), &"-o", &out, &"--set", &setting], wants);
    };
    refused("steps=abc", &["--set is steps=abc: expected a whole number, 0 or more"]);
    refused("steps=-3", &["--set is steps=-3: expected a whole number"]);
    refused("rates.sparse=maybe", &["--set is rates.sparse=maybe: expected true or false"]);
    refused("rates.corners=x", &["--set is rates.corners=x: expected a number"]);
    refused("preset=best", &["--set is preset=best: expected one of", "solid"]);
}

#[test]
fn a_scene_is_no_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    let resume = [&"train" as &dyn AsRef<std::ffi::OsStr>, &dataset(), &"-o", &out, &"--resume"];
    let wants = ["studio.ply", "not a checkpoint", "give it as --from"];
    fails(folder.path(), &[&resume[..], &[&sample("studio.ply")]].concat(), &wants);
}

#[test]
fn pictures_go_into_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let draw = [
        &"render" as &dyn AsRef<std::ffi::OsStr>,
        &sample("studio.ply"),
        &"--orbit",
        &"1",
        &"--width",
        &"8",
    ];
    for name in ["a.txt", "a.png"] {
        let out = folder.path().join(name);
        fails(
            folder.path(),
            &[&draw[..], &[&"-o", &out]].concat(),
            &["--output", name, "a folder"],
        );
    }
    std::fs::write(folder.path().join("file"), b"").unwrap();
    fails(
        folder.path(),
        &[&draw[..], &[&"-o", &folder.path().join("file")]].concat(),
        &["--output", "a folder"],
    );
    for name in ["pictures", "v1.2", "a.txt/"] {
        let output = trisplat(&[&draw[..], &[&"-o", &folder.path().join(name)]].concat());
        assert!(output.status.success(), "{name}: {}", stderr(&output));
        assert!(folder.path().join(name).join("orbit_0000.png").is_file());
    }
}

#[cfg(feature = "view")]
#[test]
fn a_window_that_cannot_be_is_refused() {
    let output = trisplat(&[&"view", &sample("studio.ply"), &"--size", &"99999x99999"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("--size") && stderr(&output).contains("1 to 8192 px"),
        "{}",
        stderr(&output)
    );
    if cfg!(target_os = "linux") {
        let mut view = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        for display in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
            view.env_remove(display);
        }
        let output = view.arg("view").arg(sample("studio.ply")).output().unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(
            text.contains("DISPLAY is set; `trisplat render`") && !text.contains(".rs:"),
            "{text}"
        );
    }
}

#[test]
fn errors_are_coloured_when_asked_for_and_never_with_no_color() {
    let run = |variables: &[(&str, &str)], argument: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE").envs(variables.iter().copied());
        stderr(&command.args(["info", argument]).stdin(Stdio::null()).output().unwrap())
    };
    // An error of ours, and one of the parser.
    for argument in ["missing.ply", "--misspelt"] {
        assert!(run(&[("CLICOLOR_FORCE", "1")], argument).contains("\u{1b}[31m"), "{argument}");
        assert!(run(&[], argument).starts_with("error: "), "{argument}");
        assert!(!run(&[("NO_COLOR", "1")], argument).contains('\u{1b}'), "{argument}");
    }
}

#[test]
fn eval_prints_a_table_or_json_on_standard_output() {
    let eval = [
        &"eval" as &dyn AsRef<std::ffi::OsStr>,
        &sample("trained.ply"),
        &dataset(),
        &"--as",
        &"solid",
    ];
    let table = stdout(&trisplat(&eval));
    let rows: Vec<Vec<&str>> =
        table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows[0], ["photo", "step", "PSNR", "dB", "SSIM", "FLIP", "corrected", "dB", "SSIM"]);
    for row in &rows[1..7] {
        let [raw, corrected] = [2, 5].map(|i: usize| row[i].parse::<f64>().unwrap());
        assert!(corrected > raw - 0.01, "{table}");
    }
    let rest: Vec<&str> = rows[7..].iter().map(|row| row[0]).collect();
    assert_eq!(
        rest,
        ["depth", "exposed", "beside", "looks"],
        "after a header, 5 photos and a mean: {table}"
    );
    let psnr = |row: &[&str]| row[2].parse::<f64>().unwrap();
    let mean = rows[1..6].iter().map(|row| psnr(row)).sum::<f64>() / 5.0;
    assert!(rows[6][0] == "mean" && (psnr(&rows[6]) - mean).abs() < 2e-3, "{table}");
    assert!(table.contains("5 photos, ") && table.contains("4×4 samples per pixel"), "{table}");

    let quiet = trisplat(&[&eval[..], &[&"--quiet"]].concat());
    assert!(quiet.stderr.is_empty());
    assert_eq!(
        stdout(&quiet).lines().count(),
        6,
        "the header, the mean, depth, at own exposure, what is beside, and a word"
    );

    let json: serde_json::Value =
        serde_json::from_str(&stdout(&trisplat(&[&eval[..], &[&"--json"]].concat()))).unwrap();
    assert!((json["steps"][0]["mean"]["psnr"].as_f64().unwrap() - mean).abs() < 2e-3);
    assert_eq!(json["ssaa"], 4);
}

#[test]
fn eval_of_several_scenes_compares_them_with_the_first() {
    let scene = sample("trained.ply");
    let same = [&"eval" as &dyn AsRef<std::ffi::OsStr>, &scene, &scene, &dataset()];
    let how: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"--as", &"solid", &"--ssaa", &"1", &"--max-size", &"40"];
    let table = stdout(&trisplat(&[&same[..], &how].concat()));
    let rows: Vec<&str> = table.lines().collect();
    assert!(rows.len() == 3 && !rows[1].contains("SSIM,"), "{table}");
    let equal = "; +0.000 dB, +0.0000 SSIM, +0.0000 FLIP, 0 of 5 photos better";
    assert!(rows[2].ends_with(equal), "{table}");
    let json = stdout(&trisplat(&[&same[..], &how, &[&"--json"]].concat()));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json[1]["steps"][0]["grade"].is_string() && json[2].is_null(), "{json}");
}

#[test]
fn training_and_evaluation_say_the_same_of_a_solid_soup() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    let train = [
        "--preset",
        "solid",
        "--steps",
        "120",
        "--max-triangles",
        "2000",
        "--max-size",
        "80",
        "-v",
        "--teacher",
        "off",
        // The bake solves the colours of a shell, and its solid scene is closer than the
        // training's.
        "--set",
        "init.shell_subdivisions=0",
    ];
    let train: Vec<&dyn AsRef<std::ffi::OsStr>> = train.iter().map(|word| word as _).collect();
    let output = trisplat(
        &[&[&"train" as &dyn AsRef<std::ffi::OsStr>, &dataset(), &"-o", &out], &train[..]].concat(),
    );
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    let percents: Vec<u32> = said
        .lines()
        .filter_map(|line| line.split_once("%  step ")?.0.trim().parse().ok())
        .collect();
    assert_eq!(percents, (1..=100).collect::<Vec<u32>>(), "{said}");
    let held_out =
        said.lines().find_map(|line| line.split_once("held out ")).map(|(_, rest)| rest).unwrap();
    let train_psnr: f64 = held_out.split(' ').next().unwrap().parse().unwrap();
    let drawn = "(as trained, before a bake; drawn solid, 4×4 samples per pixel, photos at 80x60)";
    assert!(held_out.ends_with(drawn), "{held_out}");
    let eval = stdout(&trisplat(&[
        &"eval",
        &out,
        &dataset(),
        &"--max-size",
        &"80",
        &"--as",
        &"solid",
        &"-q",
    ]));
    let mean = eval.lines().find(|line| line.starts_with("mean")).unwrap();
    let eval_psnr: f64 = mean.split_whitespace().nth(2).unwrap().parse().unwrap();
    assert!(
        (train_psnr - eval_psnr).abs() < 0.1,
        "{train_psnr} while training, {eval_psnr} after: {eval}"
    );
}

#[test]
fn photos_of_another_place_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other");
    let sparse = dataset().join("sparse");
    let images = dataset().join("images");
    copy_folder(&sparse, &other.join("sparse"));
    // Every photo under the name of one from the other side.
    let mut names: Vec<_> =
        std::fs::read_dir(&images).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    std::fs::create_dir_all(other.join("images")).unwrap();
    for (i, name) in names.iter().enumerate() {
        let from = images.join(&names[(i + names.len() / 2) % names.len()]);
        std::fs::copy(from, other.join("images").join(name)).unwrap();
    }
    let out = folder.path().join("a.glb");
    let bake = |dataset: &Path, force: &[&dyn AsRef<std::ffi::OsStr>]| {
        let bake: [&dyn AsRef<std::ffi::OsStr>; 7] =
            [&"bake", &sample("trained.ply"), &"--dataset", &dataset, &"-o", &out, &"-f"];
        let output = trisplat(&[&bake[..], force].concat());
        (output.status.code(), stderr(&output))
    };
    let doubt = "photos that do not seem to show this scene";
    let (code, right) = bake(&dataset(), &[]);
    assert!(code == Some(0) && !right.contains(doubt), "{right}");
    let before = std::fs::read(&out).unwrap();
    let (code, wrong) = bake(&other, &[]);
    assert!(code == Some(1) && wrong.contains(doubt) && wrong.contains("force_dataset"), "{wrong}");
    assert_eq!(std::fs::read(&out).unwrap(), before, "the file is as it was");
    let (code, forced) = bake(&other, &[&"--set", &"force_dataset=true"]);
    assert!(
        code == Some(0) && forced.contains("warning: --dataset has photos that do not"),
        "{forced}"
    );
}

#[test]
fn merge_of_a_soup_and_a_baked_mesh_keeps_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let bake = |arguments: &[&dyn AsRef<std::ffi::OsStr>]| {
        // All turned alike: without it the cameras of one file would turn that file a little. And
        // with their domes as part of the scene: a backdrop's triangles depend on what it stands
        // behind.
        let bake: [&dyn AsRef<std::ffi::OsStr>; 3] = [&"bake", &"--up=0,-1,0", &"--backdrop=off"];
        let output = trisplat(&[&bake[..], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
    };
    let soup = sample("trained.ply");
    let other = sample("studio.ply");
    bake(&[&soup, &"-o", &path("plain.glb")]);
    bake(&[&soup, &"--set", &"center=true", &"--set", &"scale=2", &"-o", &path("placed.glb")]);
    bake(&[&other, &path("placed.glb"), &"-o", &path("both.glb")]);
    bake(&[&other, &"-o", &path("other.glb")]);
    let info = |name: &str| -> serde_json::Value {
        serde_json::from_str(&stdout(&trisplat(&[&"info", &path(name), &"--json"]))).unwrap()
    };
    let count = |name: &str| info(name)["triangles"].as_u64().unwrap();
    assert_eq!(count("both.glb"), count("plain.glb") + count("other.glb"));
    for (end, outer) in [("min", f64::min as fn(f64, f64) -> f64), ("max", f64::max)] {
        for axis in 0..3 {
            let bound = |name: &str| info(name)["bounds"][end][axis].as_f64().unwrap();
            let wanted = outer(bound("plain.glb"), bound("other.glb"));
            assert!(
                (bound("both.glb") - wanted).abs() < 1e-3,
                "{end} {axis}: {} for {wanted}",
                bound("both.glb")
            );
        }
    }
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let man = folder.path().join("man");
    assert!(trisplat(&[&"man", &man]).status.success());
    for name in ["trisplat.1", "trisplat-bake.1", "trisplat-train.1", "trisplat-view.1"] {
        let page =
            std::fs::read_to_string(man.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(page.contains(".TH "), "{name}");
    }
    assert!(
        std::fs::read_to_string(man.join("trisplat-bake.1")).unwrap().contains("max\\-triangles")
    );
}

#[test]
fn the_folder_of_a_make_names_what_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("scene.make");
    copy_folder(&dataset(), &work.join("photos"));
    std::fs::copy(sample("studio.ply"), work.join("scene.ply")).unwrap();
    let out = folder.path().join("out");
    let scene = Path::new("scene.make/scene.ply").display().to_string();
    let photos = Path::new("scene.make/photos").display().to_string();
    fails(folder.path(), &[&"bake", &work, &"-o", &out.with_extension("glb")], &[&scene, &photos]);
    fails(folder.path(), &[&"train", &work, &"-o", &out.with_extension("ply")], &[&photos]);
    fails(folder.path(), &[&"eval", &sample("studio.ply"), &work], &[&photos]);
}

#[test]
fn files_that_are_not_read_name_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("a.ksplat"), [0; 4096]).unwrap();
    std::fs::write(at("a.lcc"), "{\"version\": \"5.0\"}").unwrap();
    std::fs::create_dir(at("photos")).unwrap();
    let mut zip = zip::ZipWriter::new(std::fs::File::create(at("photos.zip")).unwrap());
    zip.start_file(
        "a.jpg",
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored),
    )
    .unwrap();
    zip.finish().unwrap();
    std::fs::copy(at("photos.zip"), at("a.usdz")).unwrap();
    let refused = |name: &str, wants: &[&str]| {
        fails(folder.path(), &[&"bake", &at(name), &"-o", &at("out.glb")], wants);
    };
    refused("a.ksplat", &[".ksplat", "not read", "SPZ"]);
    refused("a.lcc", &["LCC", "not read", "PLY"]);
    refused("photos.zip", &["zip archive of photos", "trisplat make"]);
    refused("a.usdz", &["USDZ", ".glb"]);
    refused("photos", &["is a folder", ".spz", "trisplat make"]);
    fails(
        folder.path(),
        &[&"make", &at("photos.zip"), &"-o", &at("out.glb")],
        &["zip archive", "unpack"],
    );
    let error = fails_of(&[&"make", &dataset(), &"-o", &at("noext")]);
    assert!(error.contains(".glb") && !error.contains("format"), "{error}");
}

/// What a command that fails says.
fn fails_of(args: &[&dyn AsRef<std::ffi::OsStr>]) -> String {
    let output = trisplat(args);
    assert!(!output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

#[test]
fn a_file_in_place_of_a_command_names_the_command() {
    let error = fails_of(&[&"scene.ply"]);
    assert!(
        error.contains("trisplat bake scene.ply") && error.contains("trisplat info"),
        "{error}"
    );
    let error = fails_of(&[&dataset(), &"-o", &"a.glb"]);
    assert!(error.contains("trisplat make"), "{error}");
    assert!(!fails_of(&[&"bkae"]).contains("a command comes first"));
}

#[test]
fn a_mistyped_file_names_the_near_one_and_system_folders_refuse() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.ply");
    std::fs::copy(sample("studio.ply"), &scene).unwrap();
    let text = fails_of(&[&"info", &folder.path().join("scne.ply")]);
    assert!(text.ends_with(&format!("; did you mean {}?\n", scene.display())), "{text}");
    let text = fails_of(&[&"info", &folder.path().join("other.obj")]);
    assert!(text.ends_with("does not exist\n"), "{text}");
    if cfg!(target_os = "linux") {
        let text = fails_of(&[&"bake", &scene, &"-o", &"/proc/x.glb"]);
        assert!(text.contains("/proc/x.glb: its folder takes no files"), "{text}");
    }
}

/// Each was typed by somebody who meant something else.
#[test]
fn mistakes_of_the_first_minutes_name_the_way_on() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.ply");
    std::fs::copy(sample("studio.ply"), &scene).unwrap();
    let list = folder.path().join("list.txt");
    std::fs::write(&list, "the red ones").unwrap();
    let out = folder.path().join("a.glb");
    let says = |args: &[&dyn AsRef<std::ffi::OsStr>], text: &str| {
        let error = fails_of(&[args, &[&"-o", &out]].concat());
        assert!(error.contains(text), "{error}");
    };
    says(&[&"make", &scene], "is no photo and no video; `trisplat bake` makes");
    says(&[&"bake", &scene, &"--set", &"min_opacty=0.1"], "; did you mean min_opacity?");
    says(&[&"bake", &"https://example.com/a.ply"], "is an address; download the file");
    let error = fails_of(&[&"bake", &scene, &"-o", &out, &"--erase", &list]);
    assert_eq!(error.lines().count(), 1, "before any work: {error}");
    assert!(error.contains("is no list of erased triangles"), "{error}");
}

/// Drawn as it is, such a mesh is an outline.
#[test]
fn a_mesh_of_plain_colours_is_told_of_light() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("a.mtl"), "newmtl red\nKd 0.7 0 0\n").unwrap();
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    std::fs::write(at("a.obj"), format!("mtllib a.mtl\n{corners}usemtl red\nf 1 2 3\n")).unwrap();
    let colored = corners.replace('\n', " 1 0 0\n");
    std::fs::write(at("b.obj"), format!("{colored}f 1 2 3\n")).unwrap();
    let told = |input: &str, out: &str, more: &[&dyn AsRef<std::ffi::OsStr>]| {
        let (input, out) = (at(input), at(out));
        let bake: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"bake", &input, &"-o", &out];
        let output = trisplat(&[&bake[..], more].concat());
        assert!(output.status.success());
        stderr(&output).contains("`trisplat bake --lit` lets light fall on it")
    };
    assert_eq!([told("a.obj", "a.glb", &[]), told("b.obj", "b.glb", &[])], [true, false]);
    assert!(!told("a.obj", "lit.glb", &[&"--lit"]));
    // Its file says that its colours are shown as they are.
    assert!(!told("a.glb", "again.glb", &[]));
}

#[test]
fn gaussians_are_validated_by_their_own_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.splat");
    let numbers: Vec<u8> =
        [0.0f32, 1.0, 2.0, 0.1, 0.1, 0.1].into_iter().flat_map(f32::to_le_bytes).collect();
    let record = [&numbers[..], &[255, 0, 0, 255, 255, 128, 128, 128]].concat();
    std::fs::write(&path, &record).unwrap();
    let said = stdout(&trisplat(&[&"validate", &path]));
    assert!(said.contains("a.splat: .splat: 0 errors"), "{said}");
    std::fs::write(&path, &record[..31]).unwrap();
    let output = trisplat(&[&"validate", &path]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        !output.status.success() && said.contains("cut short") && said.contains(".splat: 1 error"),
        "{said}"
    );
}

#[test]
fn a_mask_of_another_size_is_named_before_the_training() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    copy_folder(&dataset(), &set);
    std::fs::create_dir(set.join("masks")).unwrap();
    let mask = trisplat_scene::image::RgbImage {
        size: glam::UVec2::splat(8),
        rgb: vec![[255; 3]; 64],
        alpha: None,
    };
    mask.save_png(set.join("masks/view_0003.png")).unwrap();
    fails(folder.path(), &[&"info", &set], &["view_0003.png", "is 8x8", "as large as its photo"]);
}

#[test]
fn info_and_bake_measure_the_same_softness() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let out = folder.path().join("a.glb");
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
    let info = json(&stdout(&trisplat(&[&"info", &"--json", &sample("trained.ply")])));
    let args: [&dyn AsRef<std::ffi::OsStr>; 10] = [
        &"bake",
        &sample("trained.ply"),
        &"-o",
        &out,
        &"--dry-run",
        &"--report",
        &report,
        &"--set",
        &"reshape=off",
        &"-q",
    ];
    stdout(&trisplat(&args));
    let report = json(&std::fs::read_to_string(&report).unwrap());
    let teacher = report["stages"]
        .as_array()
        .unwrap()
        .iter()
        .find(|stage| stage["name"] == "teacher")
        .unwrap();
    assert_eq!(teacher["details"]["softness"], info["softness"], "{teacher}");
}

#[test]
fn bake_of_a_mesh_names_its_up_axis_and_removed_alpha() {
    let folder = tempfile::tempdir().unwrap();
    let ply = folder.path().join("a.ply");
    let out = folder.path().join("a.glb");
    let rows = |alpha: u8| {
        let row = |at: &str| format!("{at} 200 100 50 {alpha}\n");
        ["0 0 0", "1 0 0", "0 1 0"].map(row).concat()
    };
    let names =
        ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "uchar alpha"];
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex 6\n{}element face 2\nproperty list uchar int vertex_indices\nend_header\n",
        names.map(|name| format!("property {name}\n")).concat()
    );
    std::fs::write(&ply, format!("{head}{}{}3 0 1 2\n3 3 4 5\n", rows(255), rows(0))).unwrap();
    let said = |more: &[&str]| {
        let fixed: [&dyn AsRef<std::ffi::OsStr>; 5] = [&"bake", &ply, &"-o", &out, &"-f"];
        let more = more.iter().map(|word| word as &dyn AsRef<std::ffi::OsStr>);
        let output = trisplat(&fixed.into_iter().chain(more).collect::<Vec<_>>());
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let text = said(&[]);
    assert!(text.contains("removed 1 triangle whose alpha is below 0.014"), "{text}");
    assert!(text.contains("taken as −y: --up y if it lies on its head"), "{text}");
    assert!(!said(&["--up", "y"]).contains("taken as"));
}

/// What a terminal shows after `text`, by lines.
fn screen(text: &str) -> Vec<String> {
    let mut rows = vec![Vec::new()];
    let mut row = 0usize;
    let mut column = 0usize;
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\r' => column = 0,
            '\n' => row += 1,
            '\u{1b}' => {
                let mut word = String::new();
                while !word.ends_with(|c: char| c.is_ascii_alphabetic()) {
                    word.extend(letters.next().or(Some('m')));
                }
                let count = word.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0);
                match word.chars().last() {
                    Some('A') => row = row.saturating_sub(count.max(1)),
                    Some('B') => row += count.max(1),
                    Some('G') => column = count.max(1) - 1,
                    Some('K') if count == 2 => rows[row].clear(),
                    Some('K') => rows[row].truncate(column),
                    Some('J') => rows.truncate(row + 1),
                    _ => {}
                }
            }
            letter => {
                let line: &mut Vec<char> = &mut rows[row];
                line.resize(line.len().max(column + 1), ' ');
                line[column] = letter;
                column += 1;
            }
        }
        rows.resize(rows.len().max(row + 1), Vec::new());
    }
    rows.into_iter().map(String::from_iter).collect()
}

/// A terminal shows a spinner while a bake runs, and nothing of it afterwards.
#[test]
fn no_spinner_stays_in_the_terminal() {
    if Command::new("script").arg("--version").output().is_err() {
        return trisplat_fixtures::skip::skipped("no `script`, which gives a program a terminal");
    }
    let folder = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_trisplat");
    let soup = sample("trained.ply");
    let photos = dataset();
    let bake = format!(
        "'{program}' bake '{}' -o out.glb --dataset '{}'",
        soup.display(),
        photos.display()
    );
    let mut command = Command::new("script");
    let done = command
        .current_dir(&folder)
        .args(["-qec", &bake, "/dev/null"])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    let spins = |text: &str| text.contains(|c: char| ('\u{2800}'..'\u{2900}').contains(&c));
    assert!(done.status.success() && spins(&said), "{said}");
    let left = screen(&said);
    assert!(left.iter().any(|line| line.contains("wrote out.glb")), "{left:?}");
    assert!(!left.iter().any(|line| spins(line)), "{left:?}");
}
