//! Nothing that a command reads, or that what it reads names, is replaced, emptied or removed:
//! tried for every option that names an output, with inputs of every kind.

use super::outputs::{folder, refused, run, state, succeed};
use super::stderr;
use clap::CommandFactory;
use std::any::TypeId;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use trisplat::cli::inputs::{IMAGES, OUTPUTS, RESUMED};
use trisplat::cli::program::Cli;

const PHOTO: &str = "photos/images/view_0001.png";
/// Files of the data set: photos with and without a pose, a mask, poses, the split.
const DATASET: [&str; 5] = [
    PHOTO,
    "photos/images/extra.png",
    "photos/masks/a.png",
    "photos/sparse/0/images.txt",
    "photos/test.txt",
];

/// A command line with `{}` in the place of an output, and inputs to try there.
struct Attempt {
    command: &'static str,
    option: &'static str,
    line: String,
    inputs: Vec<String>,
}

/// Options that no input can be given to, and why.
const WITHOUT_INPUTS: [(&str, &str); 4] = [
    ("man", "folder"),
    // Both take names that are not taken yet.
    ("view", "screenshots"),
    // Folders with files of their own: tests/cli/user_files.rs.
    ("capture", "output"),
    ("make", "work"),
];

/// A folder with a soup and photos of enough places for two blocks.
fn large_folder() -> tempfile::TempDir {
    let folder = folder();
    trisplat_fixtures::samples::photos(folder.path().join("photos"), [8, 32, 200], 0);
    folder
}

/// Adds to the folder of a soup and a data set: hard links of photos by other names, loose photos,
/// scenes of several files, options, a checkpoint, tiles, a plan and one whose blocks are trained.
fn inputs() -> tempfile::TempDir {
    let folder = large_folder();
    let at = |name: &str| folder.path().join(name);
    let make = |line: &str| drop(succeed(run(folder.path(), &line.split(' ').collect::<Vec<_>>())));
    for (copy, what) in
        [("photos/images/extra.png", PHOTO), ("photos/masks/a.png", PHOTO), ("loose/a.png", PHOTO)]
    {
        std::fs::create_dir_all(at(copy).parent().unwrap()).unwrap();
        std::fs::copy(at(what), at(copy)).unwrap();
    }
    std::fs::copy(at(PHOTO), at("wall.png")).unwrap();
    for link in ["link.ply", "link.glb", "link.html"] {
        std::fs::hard_link(at(PHOTO), at(link)).unwrap();
    }
    std::fs::write(at("options.json"), "{}").unwrap();
    std::fs::write(at("run.checkpoint"), "precious").unwrap();
    std::fs::create_dir(at("q")).unwrap();
    std::fs::write(at("q/manifest.json"), "{}").unwrap();
    make("bake a.ply -o g.gltf --preset fast");
    let json = std::fs::read_to_string(at("g.gltf")).unwrap();
    let json =
        json.replace("g.bin", "m.bin").replacen('{', r#"{"images": [{"uri": "wall.png"}],"#, 1);
    std::fs::write(at("g.gltf"), json).unwrap();
    std::fs::rename(at("g.bin"), at("m.bin")).unwrap();
    std::fs::write(at("scene.mtl"), "newmtl wall\nmap_Kd wall.png\n").unwrap();
    let obj = "mtllib scene.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl wall\nf 1/1 2/1 3/1\n";
    std::fs::write(at("o.obj"), obj).unwrap();
    make("bake a.ply -o t.tileset.json --preset fast");
    make("plan photos -o city --blocks 2 --steps 80 --max-triangles 600 --min-cover 0");
    std::fs::create_dir(at("begun")).unwrap();
    for file in std::fs::read_dir(at("city")).unwrap().map(Result::unwrap) {
        std::fs::copy(file.path(), at("begun").join(file.file_name())).unwrap();
    }
    make("train --block city:0");
    make("train --block city:1");
    folder
}

/// The files in `folder` whose names begin like `begin` and end like `end`, by their names from
/// above.
fn like(folder: &Path, inner: &str, begin: &str, end: &str) -> Vec<String> {
    let entries =
        std::fs::read_dir(folder.join(inner)).unwrap().map(|entry| entry.unwrap().file_name());
    let names = entries.map(|name| name.into_string().unwrap());
    let found: Vec<String> = names
        .filter(|name| name.starts_with(begin) && name.ends_with(end))
        .map(|name| format!("{inner}/{name}"))
        .collect();
    assert!(!found.is_empty(), "{inner}/{begin}…{end}");
    found
}

/// Those of the data set, and more.
fn of_dataset<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&DATASET[..], more].concat()
}

fn attempts(folder: &Path) -> Vec<Attempt> {
    let mut all = Vec::new();
    let mut add = |command, option, line: &str, inputs: &[&str]| {
        let inputs = inputs.iter().map(|input| (*input).to_owned()).collect();
        all.push(Attempt { command, option, line: line.to_owned(), inputs });
    };
    add("make", "output", "make photos -o {} -f", &["link.glb"]);
    add("make", "page", "make photos -o n.glb --page {} -f", &["link.html"]);
    add("make", "report", "make photos -o n.glb --report {} -f", &DATASET);
    add("make", "report", "make loose -o n.glb --report {} -f", &["loose/a.png"]);
    add("capture", "report", "capture loose -o set --report {} -f", &["loose/a.png"]);
    add("bake", "output", "bake a.ply --dataset photos -o {} -f", &["link.glb", "link.ply"]);
    let bake =
        "bake a.ply g.gltf o.obj --dataset photos --config options.json -o n.glb --report {} -f";
    let named = ["a.ply", "g.gltf", "m.bin", "wall.png", "o.obj", "scene.mtl", "options.json"];
    add("bake", "report", bake, &of_dataset(&named));
    add("mesh", "output", "mesh a.ply photos -o {} -f", &["link.ply", "a.ply"]);
    add("mesh", "report", "mesh g.gltf photos -o n.ply --report {} -f", &of_dataset(&["m.bin"]));
    add("train", "output", "train photos --from a.ply -o {} -f", &["link.ply", "a.ply"]);
    let from = of_dataset(&["g.gltf", "m.bin", "a.ply"]);
    let train = "train photos --from g.gltf --teacher a.ply -o n.ply -f";
    for (option, line) in
        [("checkpoint", "--checkpoint {}"), ("log", "--log {}"), ("report", "--report {}")]
    {
        add("train", option, &format!("{train} {line}"), &from);
    }
    add(
        "train",
        "report",
        "train photos -o n.ply --resume run.checkpoint --report {} -f",
        &["run.checkpoint"],
    );
    add("train", "preview", "train photos -o n.ply --preview {} -f", &["photos/images"]);
    add("train", "preview", "train --block begun:0 --preview {} -f", &["photos/images"]);
    add("plan", "output", "plan photos --config q/manifest.json -o {} --blocks 2 -f", &["q"]);
    add("eval", "report", "eval g.gltf photos --report {} -f", &of_dataset(&["g.gltf", "m.bin"]));
    let eval = "eval a.ply photos --as solid --split all --save-renders {} -f";
    add("eval", "save_renders", eval, &["photos/images"]);
    add(
        "render",
        "output",
        "render a.ply --dataset photos --split all -o {} -f",
        &["photos/images"],
    );
    let of_plan = |plan: &str| {
        let kinds = [("manifest", ".json"), ("start-", ".ply"), ("coarse-", ".ply")];
        kinds.iter().flat_map(|(begin, end)| like(folder, plan, begin, end)).collect::<Vec<_>>()
    };
    let photos = || DATASET.iter().map(|name| (*name).to_owned());
    let mut owned = |command, option, line: &str, inputs| {
        all.push(Attempt { command, option, line: line.to_owned(), inputs });
    };
    let block = of_plan("begun").into_iter().chain(photos()).collect();
    owned("train", "log", "train --block begun:0 --log {} -f", block);
    let blocks = like(folder, "city", "block-", ".ply");
    let scenes = ["start-", "coarse-"].iter().flat_map(|begin| like(folder, "city", begin, ".ply"));
    let scenes = scenes.chain(blocks).chain(["link.ply".to_owned()]).collect();
    owned("merge", "output", "merge city -o {} -f", scenes);
    all
}

/// The options of every command that take paths: `train`, `log`.
fn path_options(command: &clap::Command, name: &str, found: &mut BTreeSet<(String, String)>) {
    for option in command.get_arguments() {
        if option.get_value_parser().type_id() == TypeId::of::<PathBuf>() {
            found.insert((name.to_owned(), option.get_id().to_string()));
        }
    }
    for inner in command.get_subcommands() {
        let name = format!("{name} {}", inner.get_name());
        path_options(inner, name.trim_start(), found);
    }
}

/// Fails for an option that names an output without an attempt: a new one is found here.
fn check_that_all_are_tried(attempts: &[Attempt]) {
    let mut found = BTreeSet::new();
    path_options(&Cli::command(), "", &mut found);
    let tried = attempts.iter().map(|attempt| (attempt.command, attempt.option));
    let known: BTreeSet<(&str, &str)> = tried.chain(WITHOUT_INPUTS).collect();
    for (command, option) in &found {
        let is_output = OUTPUTS.contains(&option.as_str());
        let is_known = known.contains(&(command.as_str(), option.as_str()));
        assert!(
            !is_output || is_known,
            "`{command}` writes `{option}`: add a line that tries an input there"
        );
    }
    let options: BTreeSet<&str> = found.iter().map(|(_, option)| option.as_str()).collect();
    let expected = OUTPUTS.iter().chain([&RESUMED, &IMAGES]).filter(|option| {
        let is_built = |feature: bool, of_it: &[&str]| feature || !of_it.contains(*option);
        is_built(cfg!(feature = "view"), &["screenshots"])
    });
    expected.for_each(|option| assert!(options.contains(option), "no command has `{option}`"));
}

#[test]
fn no_output_of_any_command_is_something_that_it_reads() {
    let folder = inputs();
    let before = state(folder.path());
    let attempts = attempts(folder.path());
    check_that_all_are_tried(&attempts);
    for Attempt { option, line, inputs, .. } in attempts {
        for input in inputs {
            // On systems without file numbers a hard link is another file.
            if cfg!(not(unix)) && input.starts_with("link.") {
                continue;
            }
            let line = line.replace("{}", &input);
            let flag = format!("--{}", option.replace('_', "-"));
            refused(folder.path(), &line.split(' ').collect::<Vec<_>>(), &[&flag, " is ", "input"]);
            assert_eq!(state(folder.path()), before, "{line}");
        }
    }
    // A log of a block is not emptied without --force either, and a scene's second file is not
    // replaced.
    refused(folder.path(), &["train", "--block", "begun:0", "--log", PHOTO], &["--log", "input"]);
    refused(
        folder.path(),
        &["bake", "g.gltf", "-o", "m.gltf", "-f"],
        &["--output is m.bin", "input"],
    );
    refused(
        folder.path(),
        &["bake", "o.obj", "-o", "scene.obj", "-f"],
        &["--output is scene.mtl", "input"],
    );
    let tile = like(folder.path(), "t.tiles", "r", ".glb").remove(0);
    refused(
        folder.path(),
        &["bake", &tile, "-o", "t.tileset.json", "-f"],
        &["--output is t.tiles", "inputs"],
    );
    assert_eq!(state(folder.path()), before);
}

#[test]
fn a_plan_removes_only_what_an_earlier_plan_made() {
    let folder = large_folder();
    let plan = |seed: &str| {
        let line = "plan photos -o q --blocks 2 --steps 80 --max-triangles 600 --min-cover 0 --force --seed";
        let line = line.split(' ').chain([seed]).collect::<Vec<_>>();
        run(folder.path(), &line)
    };
    let write =
        |name: &str| std::fs::write(folder.path().join("q").join(name), "precious").unwrap();
    std::fs::create_dir(folder.path().join("q")).unwrap();
    let theirs = [
        "start-0000.ply",
        "start-0007-0123456789abcdef.ply",
        "coarse-0123456789abcdef.ply",
        "notes.txt",
    ];
    theirs.iter().for_each(|name| write(name));
    succeed(plan("0"));
    let [mut starts, coarse] =
        ["start-", "coarse-"].map(|begin| like(folder.path(), "q", begin, ".ply"));
    starts.retain(|start| !theirs.iter().any(|name| start.ends_with(name)));
    assert_eq!((starts.len(), coarse.len()), (2, 2), "{starts:?} {coarse:?}");
    // One of these was changed since.
    std::fs::write(folder.path().join(&starts[0]), "changed").unwrap();
    succeed(plan("3"));
    let there = |name: &str| folder.path().join(name).is_file();
    assert!(there(&starts[0]), "what was changed stays");
    assert!(!there(&starts[1]), "what is no longer named goes");
    assert_eq!(
        like(folder.path(), "q", "coarse-", ".ply").len(),
        2,
        "the coarse scene of before goes, too"
    );
    for name in theirs {
        assert_eq!(
            std::fs::read(folder.path().join("q").join(name)).unwrap(),
            b"precious",
            "{name}"
        );
    }
    // The first plan again would write that file.
    let said = stderr(&plan("0"));
    assert!(said.contains(&format!("error: {}: was changed", starts[0])), "{said}");
    assert_eq!(std::fs::read(folder.path().join(&starts[0])).unwrap(), b"changed");
    let status = run(folder.path(), &["plan", "--status", "q"]);
    assert!(status.status.success(), "the plan of before is whole: {}", stderr(&status));
}

#[test]
fn previews_of_an_earlier_run_need_force() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("p")).unwrap();
    std::fs::write(folder.path().join("p/step-000002.png"), "precious").unwrap();
    let train = [
        "train",
        "photos",
        "--steps",
        "6",
        "--max-triangles",
        "200",
        "-o",
        "n.ply",
        "--preview",
        "p",
    ];
    let before = state(folder.path());
    refused(folder.path(), &train, &["--preview", "--force"]);
    assert_eq!(state(folder.path()), before);
    succeed(run(folder.path(), &[&train[..], &["--force"]].concat()));
}

#[cfg(target_os = "linux")]
#[test]
fn names_that_are_not_utf8_are_refused_in_linked_files() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    use std::process::{Command, Stdio};
    let folder = folder();
    let before = state(folder.path());
    let refused = |arguments: &[&OsStr], needles: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output = command
            .args(arguments)
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        needles.iter().for_each(|needle| assert!(said.contains(needle), "{said}"));
    };
    let words = |line: &'static str| line.split(' ').map(OsStr::new).collect::<Vec<_>>();
    for name in [&b"\xff.gltf"[..], b"\xff.glb", b"\xff.obj", b"\xff.tileset.json", b"\xff.html"] {
        let name = OsStr::from_bytes(name);
        refused(
            &[words("bake a.ply -o"), vec![name]].concat(),
            &["--output is ", "a name in UTF-8"],
        );
        refused(&[words("mesh a.ply -o"), vec![name]].concat(), &["--output is "]);
        refused(&[words("make photos --page n.html -o"), vec![name]].concat(), &["--output is "]);
    }
    refused(
        &[words("bake a.ply --target godot --lod 0.5 -o"), vec![OsStr::from_bytes(b"\xff.glb")]]
            .concat(),
        &["UTF-8"],
    );
    assert_eq!(state(folder.path()), before);
    let moved = folder.path().join(OsStr::from_bytes(b"\xff"));
    std::fs::rename(folder.path().join("photos"), &moved).unwrap();
    refused(
        &[words("plan -o q --blocks 2 --steps 80"), vec![moved.as_os_str()]].concat(),
        &["a path in UTF-8"],
    );
    assert!(!folder.path().join("q").exists());
}
