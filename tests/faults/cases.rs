//! The commands, and what must be true of their outputs after any fault.

use super::run::{Fault, Injector, Kind, Run};
use super::tree::{self, Tree};
use std::path::Path;
use std::process::Command;
use trisplat_fixtures::samples;
use trisplat_train::checkpoint;

/// A command, the files it finds and what it makes.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(super) arguments: &'static [&'static str],
    /// What is in `in` and, when outputs are replaced, in `out`.
    pub(super) before: Tree,
    /// Files that are published together: none of them may be new while another is old.
    pub(super) together: &'static [&'static str],
    /// The main output of a command that goes on when others cannot be written.
    pub(super) kept: Option<&'static str>,
    /// Either all outputs are there, or what was there before, and nothing else but what the next
    /// run goes on from.
    pub(super) all_or_nothing: bool,
}

/// What the command makes when nothing goes wrong.
pub(crate) struct Outcome {
    out: Tree,
    pub(crate) calls: u64,
}

/// Runs the program plainly in `folder`.
pub(super) fn plain(folder: &Path, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let output = command.args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A small soup and a small data set, and what `arguments` make of them before the command of the
/// case runs.
fn before(arguments: &[&str]) -> Tree {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::create_dir_all(path.join("in")).unwrap();
    std::fs::create_dir_all(path.join("out")).unwrap();
    samples::studio(path.join("in/a.ply"), 60);
    samples::photos(path.join("in/photos"), [4, 24, 40], 0);
    // What is no soup is judged without a bake, a hundred times sooner.
    std::fs::write(path.join("in/mesh.obj"), "v -1 0 0\nv 1 0 0\nv 0 -1 0\nf 1 2 3\n").unwrap();
    if !arguments.is_empty() {
        plain(path, arguments);
    }
    tree::read(path)
}

const BAKE: &[&str] = &[
    "bake",
    "in/a.ply",
    "-o",
    "out/a.gltf",
    "--lod",
    "0.5",
    "--target",
    "godot",
    "--report",
    "out/report.json",
    "--force",
    "--teacher",
    "off",
];

pub(crate) fn bake_replaces() -> Case {
    let mut old = BAKE.to_vec();
    old.extend(["--scale-by", "0.4=0.25"]);
    Case {
        name: "bake of many files over old ones",
        arguments: BAKE,
        before: before(&old),
        together: &["out/a.gltf", "out/a.bin", "out/a.lod", "out/a.tileset.json"],
        kept: None,
        all_or_nothing: false,
    }
}

pub(crate) fn bake_new() -> Case {
    Case {
        name: "bake of new files",
        arguments: BAKE,
        before: before(&[]),
        together: &["out/a.gltf", "out/a.bin", "out/a.lod", "out/a.tileset.json"],
        kept: None,
        all_or_nothing: false,
    }
}

pub(crate) fn train() -> Case {
    const TRAIN: &[&str] = &[
        "train",
        "in/photos",
        "-o",
        "out/a.ply",
        "--log",
        "out/log.jsonl",
        "--report",
        "out/report.json",
        "--preview",
        "out/preview",
        "--preview-every",
        "0",
        "--checkpoint-every",
        "2",
        "--keep",
        "2",
        "--steps",
        "6",
        "--log-every",
        "3",
        "--max-triangles",
        "200",
        "--force",
        "--preset",
        "outdoor",
    ];
    let mut old = TRAIN.to_vec();
    old.extend(["--seed", "7"]);
    Case {
        name: "train",
        arguments: TRAIN,
        before: before(&old),
        together: &["out/a.ply"],
        kept: Some("out/a.ply"),
        all_or_nothing: false,
    }
}

pub(crate) fn train_with_teacher() -> Case {
    const TRAIN: &[&str] = &[
        "train",
        "in/photos",
        "-o",
        "out/a.ply",
        "--teacher",
        "auto",
        "--checkpoint-every",
        "4",
        "--keep",
        "2",
        "--steps",
        "8",
        "--max-triangles",
        "200",
        // A killed run leaves its teacher, which is whole.
        "--force",
    ];
    Case {
        name: "train with a teacher",
        arguments: TRAIN,
        before: before(&[]),
        together: &["out/a.ply"],
        kept: Some("out/a.ply"),
        all_or_nothing: false,
    }
}

pub(crate) fn eval() -> Case {
    const EVAL: &[&str] = &[
        "eval",
        "in/mesh.obj",
        "in/photos",
        "--report",
        "out/report.json",
        "--save-renders",
        "out/renders",
        "--split",
        "all",
        "--ssaa",
        "1",
        "--force",
    ];
    let mut old = EVAL.to_vec();
    old.extend(["--background", "white"]);
    Case {
        name: "eval",
        arguments: EVAL,
        before: before(&old),
        together: &[],
        kept: None,
        all_or_nothing: false,
    }
}

pub(crate) fn render() -> Case {
    const RENDER: &[&str] =
        &["render", "in/a.ply", "--orbit", "3", "--width", "24", "-o", "out/pictures", "--force"];
    let mut old = RENDER.to_vec();
    old.extend(["--show", "depth"]);
    Case {
        name: "render",
        arguments: RENDER,
        before: before(&old),
        together: &[],
        kept: None,
        all_or_nothing: false,
    }
}

const PLAN: &[&str] = &[
    "plan",
    "in/photos",
    "-o",
    "out/city",
    "--blocks",
    "2",
    "--steps",
    "80",
    "--max-triangles",
    "600",
    "--min-cover",
    "0",
    "--force",
];

/// A case whose outputs are all there or none, after the runs of `earlier`.
fn whole(
    name: &'static str,
    arguments: &'static [&'static str],
    together: &'static [&'static str],
    earlier: &[Vec<&str>],
) -> Case {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    tree::write(path, &before(&[]));
    std::fs::create_dir_all(path.join("out")).unwrap();
    samples::photos(path.join("in/photos"), [8, 32, 200], 0);
    samples::studio(path.join("in/large.ply"), 2500);
    earlier.iter().for_each(|arguments| plain(path, arguments));
    Case { name, arguments, before: tree::read(path), together, kept: None, all_or_nothing: true }
}

pub(crate) fn plan_new() -> Case {
    whole("plan", PLAN, &[], &[])
}

pub(crate) fn plan_replaces() -> Case {
    whole("plan over an old one", PLAN, &[], &[[PLAN, &["--seed", "7"]].concat()])
}

/// The plan of [`PLAN`] in `in/city`, and its blocks.
fn city(blocks: &[&'static str]) -> Vec<Vec<&'static str>> {
    let mut plan = PLAN.to_vec();
    plan[3] = "in/city";
    let train = |block: &&'static str| vec!["train", "--block", block];
    std::iter::once(plan).chain(blocks.iter().map(train)).collect()
}

pub(crate) fn block() -> Case {
    let arguments = &["train", "--block", "out/city:1"];
    whole("train of a block", arguments, &["out/city/block-0001"], &[PLAN.to_vec()])
}

pub(crate) fn merge() -> Case {
    let arguments = &["merge", "in/city", "-o", "out/a.ply", "--force"];
    whole("merge", arguments, &["out/"], &city(&["in/city:0", "in/city:1"]))
}

pub(crate) fn tiles_of_a_city() -> Case {
    let arguments = &["bake", "in/city", "-o", "out/a.tileset.json", "--preset", "fast", "--force"];
    whole("bake of a city", arguments, &[], &city(&["in/city:0", "in/city:1"]))
}

pub(crate) fn tiles() -> Case {
    const TILES: &[&str] = &[
        "bake",
        "in/large.ply",
        "-o",
        "out/a.tileset.json",
        "--preset",
        "fast",
        "--set",
        "tile_triangles=1000",
        "--force",
    ];
    whole(
        "bake of tiles over old ones",
        TILES,
        &[],
        &[[TILES, &["--scale-by", "0.4=0.25"]].concat()],
    )
}

pub(crate) fn manual() -> Case {
    whole("man", &["man", "out/pages"], &["out/pages"], &[])
}

impl Case {
    /// Whether what a signal leaves is known: a training saves what it has by then.
    pub(crate) fn knows_signals(&self) -> bool {
        self.kept.is_none()
    }

    /// Whether the next run goes on from whatever a fault left.
    fn goes_on(&self) -> bool {
        matches!(self.arguments[0], "capture" | "make")
    }

    /// Calls that a plain run of the suite visits with each kind of fault.
    pub(crate) fn visits(&self) -> u64 {
        // Each run of it trains for seconds.
        if self.arguments[0] == "make" { 4 } else { 12 }
    }

    /// The outcome when nothing goes wrong.
    pub(crate) fn outcome(&self, injector: &Injector) -> Outcome {
        let (folder, run) = self.run(injector, None);
        assert!(run.output.status.success(), "{}", run.stderr());
        assert!(!run.calls.is_empty(), "no call was caught");
        Outcome { out: tree::read(folder.path()), calls: run.calls.len() as u64 }
    }

    fn run(&self, injector: &Injector, fault: Option<Fault>) -> (tempfile::TempDir, Run) {
        let folder = tempfile::tempdir().unwrap();
        tree::write(folder.path(), &self.before);
        std::fs::create_dir_all(folder.path().join("out")).unwrap();
        let run = injector.run(folder.path(), self.arguments, fault);
        (folder, run)
    }

    /// Runs with a fault and checks everything; then once more without, which must make everything
    /// as if nothing had been.
    pub(crate) fn check(&self, injector: &Injector, new: &Outcome, fault: Fault) {
        let (folder, run) = self.run(injector, Some(fault));
        let call = run.calls.get(fault.at as usize - 1).cloned().unwrap_or_default();
        let context = format!("{}, {fault:?}, {call}:\n{}", self.name, run.stderr());
        let found = tree::read(folder.path());
        let code = run.output.status.code();
        let mut ended_early = true;
        match fault.kind {
            Kind::Kill => assert!(code.is_none(), "was not killed: {context}"),
            // It may come when all is done.
            Kind::Signal if code == fault.exit_code() => {
                self.check_nothing_left(&found, "", &context)
            }
            _ => {
                self.check_exit(&run, &found, new, &call, &context);
                ended_early = code != Some(0);
            }
        }
        self.check_files(&found, new, &context);
        if self.all_or_nothing {
            self.check_all_or_nothing(&found, new, &context);
        }
        if fault.kind == Kind::Kill || ((self.all_or_nothing || self.goes_on()) && ended_early) {
            let complete = |tree: &Tree| new.out.iter().all(|(name, _)| tree.contains_key(name));
            if self.all_or_nothing && complete(&found) && !self.arguments.contains(&"--force") {
                return;
            }
            let again = injector.run(folder.path(), self.arguments, None);
            if self.goes_on()
                && complete(&found)
                && again.stderr().contains("--force to replace it")
            {
                // It was killed when all was done.
                return;
            }
            assert!(
                again.output.status.success(),
                "the next run: {}\nafter {context}",
                again.stderr()
            );
            let found = tree::read(folder.path());
            // When a training saves itself, and whether it has a teacher, depends on time.
            let depends = |name: &&String| self.goes_on() && name.contains("/scene.");
            let names = |tree: &Tree| {
                tree.keys().filter(|name| !depends(name)).cloned().collect::<Vec<_>>()
            };
            assert_eq!(names(&found), names(&new.out), "the next run, after {context}");
            self.check_files(&found, new, &context);
        }
    }

    /// All outputs are there, or all that was there before; of a run that was not killed nothing
    /// else is, but what the next goes on from.
    fn check_all_or_nothing(&self, found: &Tree, new: &Outcome, context: &str) {
        let holds = |tree: &Tree| {
            let same = |name: &String, bytes: &Vec<u8>| {
                is_volatile(name) || found.get(name) == Some(bytes)
            };
            let mut files = tree.iter().filter(|(name, _)| !tree::is_folder(name));
            files.all(|(name, bytes)| found.contains_key(name) && same(name, bytes))
        };
        let killed = found.keys().any(|name| tree::is_leftover(name));
        assert!(killed || holds(&new.out) || holds(&self.before), "part of the outputs: {context}");
        let goes_on = |name: &str| name.contains("/coarse-") || name.ends_with(".checkpoint");
        let more: Vec<&String> = found
            .keys()
            .filter(|name| {
                !self.before.contains_key(*name) && !tree::is_leftover(name) && !goes_on(name)
            })
            // After a kill they may stay, and otherwise they are looked for by themselves.
            .filter(|name| !tree::is_folder(name))
            .collect();
        assert!(holds(&new.out) || more.is_empty() || killed, "{more:?} are there: {context}");
    }

    fn check_nothing_left(&self, found: &Tree, call: &str, context: &str) {
        // What cannot be removed stays; the next run sweeps it.
        let may_stay = call.starts_with("unlink");
        // What another program made stays.
        let others = |name: &str| self.goes_on() && name.contains("/models/");
        let stays = |name: &String| {
            tree::is_leftover(name)
                || (tree::is_folder(name) && !self.before.contains_key(name) && !others(name))
        };
        let left: Vec<&String> = found.keys().filter(|name| stays(name)).collect();
        assert!(left.is_empty() || may_stay, "left behind: {left:?}: {context}");
    }

    /// Success with everything new, or one error; nothing left behind; work that was done is there.
    fn check_exit(&self, run: &Run, found: &Tree, new: &Outcome, call: &str, context: &str) {
        match run.output.status.code() {
            Some(0) => {
                assert_eq!(run.errors(), 0, "{context}");
                for (name, bytes) in &new.out {
                    assert!(
                        is_volatile(name) || found.get(name) == Some(bytes),
                        "{name} is not new: {context}"
                    );
                }
            }
            Some(1) => assert_eq!(run.errors(), 1, "{context}"),
            code => panic!("exit code {code:?}: {context}"),
        }
        self.check_nothing_left(found, call, context);
        let Some(kept) = self.kept else { return };
        let text = run.stderr();
        if let Some((_, rescued)) = text.split_once("the scene was saved as ") {
            let rescued = std::fs::read(rescued.lines().next().unwrap()).unwrap();
            assert!(rescued == new.out[kept], "the rescued scene is another: {context}");
        }
        // Nothing is written beside the scene before the training starts.
        let beside = ["write", "fsync", "rename"].iter().any(|name| call.starts_with(name))
            && !call.contains("a.ply");
        if beside && !text.contains("the scene was saved as ") {
            assert!(found.get(kept) == Some(&new.out[kept]), "the scene is not there: {context}");
        }
        assert!(run.temporary.path().exists());
    }

    /// Every file is as it was, or as it is to be.
    fn check_files(&self, found: &Tree, new: &Outcome, context: &str) {
        let mut old_ones = Vec::new();
        let mut new_ones = Vec::new();
        let is_file = |name: &str| !tree::is_leftover(name) && !tree::is_folder(name);
        for (name, bytes) in found.iter().filter(|(name, _)| is_file(name)) {
            let is_old = self.before.get(name) == Some(bytes);
            // COLMAP's database has another name until it is whole.
            let is_new = new.out.get(&name.replace("/features.db", "/database.db")) == Some(bytes);
            let whole = is_old || is_new || (is_volatile(name) && is_whole(name, bytes));
            assert!(whole, "{name} ({} bytes) is neither old nor new: {context}", bytes.len());
            if self.together.iter().any(|one| name.starts_with(one)) && is_old != is_new {
                if is_old { &mut old_ones } else { &mut new_ones }.push(name);
            }
        }
        assert!(
            old_ones.is_empty() || new_ones.is_empty(),
            "{old_ones:?} are old, {new_ones:?} new: {context}"
        );
        for (name, bytes) in self.before.iter().filter(|(name, _)| name.starts_with("in/")) {
            assert!(found.get(name) == Some(bytes), "{name} was changed: {context}");
        }
        // Of checkpoints the last are kept, whichever run wrote them.
        let rotates = |name: &str| name.ends_with(".checkpoint");
        let complete = found.keys().all(|name| !tree::is_leftover(name));
        // A capture of other photos is set aside.
        let is_there = |name: &str| {
            found.contains_key(name)
                || found.contains_key(&name.replacen("out/set/", "out/set.old/", 1))
        };
        let lost: Vec<&String> = self
            .before
            .keys()
            .filter(|name| !is_there(name) && new.out.contains_key(*name) && !rotates(name))
            .collect();
        assert!(lost.is_empty() || !complete, "{lost:?} are gone: {context}");
        let has_one = |tree: &Tree| tree.keys().any(|name| rotates(name));
        assert!(has_one(found) || !has_one(&self.before), "no checkpoint is left: {context}");
    }
}

/// True of files with times in them: no two runs write the same.
fn is_volatile(name: &str) -> bool {
    // `make` stops by time, and a capture's log names its folder.
    let made =
        ["out/a.glb", "out/a.html", "out/work/scene"].iter().any(|start| name.starts_with(start));
    made || [".json", ".jsonl", ".svg", ".checkpoint", ".log"]
        .iter()
        .any(|ending| name.ends_with(ending))
        && !["tileset", "manifest"].iter().any(|exact| name.contains(exact))
}

fn is_whole(name: &str, bytes: &[u8]) -> bool {
    let json = |bytes: &[u8]| serde_json::from_slice::<serde_json::Value>(bytes).is_ok();
    match name.rsplit('.').next().unwrap_or_default() {
        "json" => json(bytes),
        // A log grows line by line: its last may be cut.
        "jsonl" => {
            let mut lines: Vec<&[u8]> = bytes.split(|b| *b == b'\n').collect();
            lines.pop();
            lines.into_iter().all(json)
        }
        "log" => true,
        "glb" => bytes.starts_with(b"glTF") && bytes[8..12] == (bytes.len() as u32).to_le_bytes(),
        "html" => bytes.ends_with(b"</html>\n"),
        "ply" => {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.ply");
            std::fs::write(&path, bytes).unwrap();
            trisplat_formats::read(&path, &trisplat_formats::ReadOptions::default()).is_ok()
        }
        "svg" => bytes.starts_with(b"<svg") && bytes.ends_with(b"</svg>\n"),
        "checkpoint" => {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), bytes).unwrap();
            checkpoint::read(file.path()).is_ok()
        }
        _ => false,
    }
}
