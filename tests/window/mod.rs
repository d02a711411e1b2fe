//! A real window on a virtual screen, with a synthetic mouse and keys. Wants Xvfb, xdotool and
//! ImageMagick; without them tests say so and pass, unless TRISPLAT_REQUIRE_GPU=1.

mod drag;

use drag::drop_on;
use glam::{UVec2, Vec3};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use trisplat_fixtures::samples;
use trisplat_scene::image::RgbImage;

const TRISPLAT: &str = env!("CARGO_BIN_EXE_trisplat");
/// The size of the sample data set's photos, and of the window.
const PHOTO: &str = "200x150";

/// A virtual screen, with a window on it once one is opened.
struct Desk {
    screen: Child,
    display: String,
    folder: tempfile::TempDir,
    window: Option<(Child, String)>,
}

impl Drop for Desk {
    fn drop(&mut self) {
        for child in self.window.iter_mut().map(|w| &mut w.0).chain([&mut self.screen]) {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Desk {
    /// A screen, or `None` after saying loudly what is missing.
    fn new() -> Option<Self> {
        let required = std::env::var("TRISPLAT_REQUIRE_GPU").is_ok_and(|v| v == "1");
        for tool in ["Xvfb", "xdotool", "import"] {
            let found = Command::new("sh").args(["-c", &format!("command -v {tool}")]).output();
            if !found.is_ok_and(|o| o.status.success()) {
                assert!(!required, "TRISPLAT_REQUIRE_GPU=1, but {tool} is missing");
                trisplat_fixtures::skip::skipped(&format!("no {tool}"));
                return None;
            }
        }
        // A server that resets when its last client leaves refuses who comes while it does.
        let arguments =
            ["-noreset", "-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"];
        let mut screen = Command::new("Xvfb")
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        BufReader::new(screen.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let folder = tempfile::tempdir().unwrap();
        Some(Self { screen, display: format!(":{}", number.trim()), folder, window: None })
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `trisplat` on this screen.
    fn trisplat(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(TRISPLAT);
        command.args(arguments).current_dir(self.folder.path()).stdin(Stdio::null());
        // Vulkan's layers for Wayland complain without it.
        command.env("DISPLAY", &self.display).env("XDG_RUNTIME_DIR", self.folder.path());
        command.env_remove("WAYLAND_DISPLAY");
        command
    }

    fn run(&self, arguments: &[&str]) {
        let done = self.trisplat(arguments).output().unwrap();
        assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    }

    /// Opens a window and waits until it has the focus and has drawn something: keys pressed before
    /// are lost.
    fn open(&mut self, arguments: &[&str]) {
        let said = std::fs::File::create(self.at("said")).unwrap();
        let mut child = self.trisplat(arguments).stderr(said).spawn().unwrap();
        let id = wait_for("a window", || {
            if let Some(status) = child.try_wait().unwrap() {
                panic!("{status}: {}", std::fs::read_to_string(self.at("said")).unwrap());
            }
            let ids = self.xdotool("search --onlyvisible --name trisplat");
            ids.lines().next().map(str::to_owned)
        });
        wait_for("the focus", || {
            self.xdotool(&format!("windowfocus {id}"));
            (self.xdotool("getwindowfocus").trim() == id).then_some(())
        });
        self.window = Some((child, id));
        wait_for("a first picture", || {
            let seen = self.seen().rgb;
            seen.iter().any(|pixel| *pixel != seen[0]).then_some(())
        });
    }

    /// What xdotool prints.
    fn xdotool(&self, arguments: &str) -> String {
        let mut command = Command::new("xdotool");
        command.args(arguments.split(' ')).env("DISPLAY", &self.display);
        String::from_utf8(command.output().unwrap().stdout).unwrap()
    }

    /// What the window shows.
    fn seen(&self) -> RgbImage {
        let path = self.at("seen.png");
        let id = &self.window.as_ref().unwrap().1;
        let mut import = Command::new("import");
        import.args(["-window", id]).arg(&path).env("DISPLAY", &self.display);
        assert!(import.status().unwrap().success());
        RgbImage::load(&path).unwrap()
    }

    /// Presses F12 and returns the picture of number `number`.
    fn screenshot(&self, number: u32) -> RgbImage {
        self.xdotool("key F12");
        let path = self.at(&format!("shots/trisplat-{number:04}.png"));
        // On a busy machine a key may be lost.
        let mut again = Some(Instant::now() + Duration::from_secs(20));
        wait_for("a screenshot", || {
            if again.take_if(|again| Instant::now() > *again).is_some() {
                self.xdotool("key F12");
            }
            path.exists().then(|| RgbImage::load(&path).unwrap())
        })
    }

    /// Presses Escape and returns the exit code.
    fn close(&mut self) -> Option<i32> {
        self.xdotool("key Escape");
        let (child, _) = self.window.as_mut().unwrap();
        wait_for("the end", || child.try_wait().unwrap()).code()
    }
}

/// Tries until it succeeds.
fn wait_for<T>(what: &str, mut attempt: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(got) = attempt() {
            return got;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Share of pixels that are more than two codes off.
fn off(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.size, b.size);
    let differs = |(p, q): &(&[u8; 3], &[u8; 3])| (0..3).any(|c| p[c].abs_diff(q[c]) > 2);
    a.rgb.iter().zip(&b.rgb).filter(differs).count() as f64 / a.rgb.len() as f64
}

/// The picture in a folder that the window comes to show.
fn shown_picture(desk: &Desk, folder: &Path) -> RgbImage {
    let pictures: Vec<RgbImage> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| RgbImage::load(&e.unwrap().path()).unwrap())
        .collect();
    let shown = || pictures.iter().find(|picture| off(&desk.seen(), picture) < 0.01).cloned();
    wait_for("a photo's view, as the CPU draws it", shown)
}

/// A data set of two grey photos of the sample scene.
fn write_photos(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let target = Vec3::new(0.0, -0.35, 0.1);
    let frame = |(name, eye): (&str, Vec3)| {
        let size = UVec2::new(200, 150);
        RgbImage { size, rgb: vec![[128; 3]; 30_000], alpha: None }
            .save_png(folder.join(name))
            .unwrap();
        // Camera to world: right, up and back in columns.
        let back = (eye - target).normalize();
        let right = back.cross(Vec3::Y).normalize();
        let up = back.cross(right);
        let row = |k: usize| [right[k], up[k], back[k], eye[k]];
        serde_json::json!({ "file_path": name, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] })
    };
    let eyes = [("a.png", Vec3::new(1.5, -2.5, -5.8)), ("b.png", Vec3::new(-2.0, -2.0, -5.0))];
    let frames: Vec<_> = eyes.into_iter().map(frame).collect();
    let set = serde_json::json!({
        "w": 200, "h": 150, "fl_x": 210.0, "fl_y": 210.0, "cx": 100.0, "cy": 75.0, "frames": frames
    });
    std::fs::write(folder.join("transforms.json"), set.to_string()).unwrap();
}

/// Pixels of the red ball that stands in the middle of the sample scene.
fn red(picture: &RgbImage) -> usize {
    picture.rgb.iter().filter(|[r, g, b]| *r > 100 && *r / 2 > (*g).max(*b)).count()
}

#[test]
fn a_window_shows_what_the_cpu_draws_and_follows_mouse_and_keys() {
    let Some(mut desk) = Desk::new() else { return };
    samples::studio(desk.at("studio.ply"), 4000);
    // A file: `render` takes the colours of a soft soup from its soft pictures, the window shows
    // them as they are.
    desk.run(&["bake", "studio.ply", "-o", "studio.glb", "--teacher", "off"]);
    write_photos(&desk.at("photos"));
    desk.run(&[
        "render",
        "studio.glb",
        "-o",
        "cpu",
        "--ssaa",
        "1",
        "--dataset",
        "photos",
        "--split",
        "all",
    ]);
    let view = [
        "view",
        "studio.glb",
        "--dataset",
        "photos",
        "--size",
        PHOTO,
        "--msaa",
        "1",
        "--screenshots",
        "shots",
    ];
    desk.open(&view);

    // Without the panel the window is the picture of the photo that shows the subject best, as the
    // CPU draws it.
    desk.xdotool("key h");
    let cpu = shown_picture(&desk, &desk.at("cpu"));
    let same = |desk: &Desk, wants: &RgbImage, what: &str| {
        wait_for(what, || (off(&desk.seen(), wants) < 0.01).then_some(()));
    };
    assert!(off(&desk.screenshot(1), &cpu) < 0.01);

    // A drag turns the view, and a screenshot is what the window shows.
    desk.xdotool(
        "mousemove 100 75 mousedown 1 mousemove 115 78 mousemove 130 81 mousemove 150 85 mouseup 1",
    );
    wait_for("the drag", || (off(&desk.seen(), &cpu) > 0.3).then_some(()));
    let turned = desk.screenshot(2);
    assert!(off(&turned, &cpu) > 0.3);
    same(&desk, &turned, "the screenshot");

    // Wireframe; the photo over the picture.
    desk.xdotool("key 3");
    wait_for("wireframe", || (off(&desk.seen(), &turned) > 0.3).then_some(()));
    desk.xdotool("key 3");
    same(&desk, &turned, "triangles");

    // Flying moves; N goes to the next photo, P back.
    desk.xdotool("keydown w");
    wait_for("flight", || (off(&desk.seen(), &turned) > 0.2).then_some(()));
    desk.xdotool("keyup w");
    desk.xdotool("key n");
    desk.xdotool("key p");
    same(&desk, &cpu, "the photo's view");
    desk.xdotool("key o");
    wait_for("the photo beside", || (off(&desk.seen(), &cpu) > 0.3).then_some(()));
    desk.xdotool("key o key o");
    same(&desk, &cpu, "the photo's view alone");

    // From far away, F shows the subject as large as fits.
    desk.xdotool("mousemove 100 75 click --repeat 8 5");
    wait_for("the way out", || (off(&desk.seen(), &cpu) > 0.3).then_some(()));
    let far = desk.screenshot(3);
    desk.xdotool("key f");
    wait_for("the subject", || (red(&desk.seen()) > 2 * red(&far).max(20)).then_some(()));
    assert_eq!(desk.close(), Some(0));
}

/// CPU seconds that a process has taken, in ticks of the system.
#[cfg(target_os = "linux")]
fn ticks(child: &Child) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    // Behind the name, which may hold anything: user and system time are the 12th and 13th.
    let fields: Vec<&str> = stat[stat.rfind(')').unwrap() + 2..].split(' ').collect();
    fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn a_window_at_rest_draws_nothing() {
    let Some(mut desk) = Desk::new() else { return };
    samples::studio(desk.at("studio.ply"), 4000);
    desk.run(&["bake", "studio.ply", "-o", "studio.glb", "--teacher", "off"]);
    desk.open(&["view", "studio.glb", "--size", "640x480"]);
    let spent = |desk: &Desk| {
        let child = &desk.window.as_ref().unwrap().0;
        let before = ticks(child);
        std::thread::sleep(Duration::from_secs(2));
        ticks(child) - before
    };
    // What the first pictures need is made once.
    wait_for("rest", || (spent(&desk) <= 2).then_some(()));
    desk.xdotool("keydown w");
    wait_for("motion", || (spent(&desk) >= 20).then_some(()));
    desk.xdotool("keyup w");
    assert_eq!(desk.close(), Some(0));
}

#[test]
fn view_region_hides_the_outside_and_is_saved() {
    let Some(mut desk) = Desk::new() else { return };
    samples::studio(desk.at("studio.ply"), 4000);
    desk.open(&["view", "studio.ply", "--size", PHOTO, "--msaa", "1", "--screenshots", "shots"]);
    desk.xdotool("key h");
    let whole = desk.screenshot(1);
    desk.xdotool("key x");
    // The box leaves out the outermost triangles, and its edges are drawn over the others.
    wait_for("the region", || (off(&desk.seen(), &whole) > 0.01).then_some(()));
    desk.xdotool("key Return");
    let saved = desk.at("shots/studio.crop.json");
    wait_for("the saved region", || saved.exists().then_some(()));
    let config: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&saved).unwrap()).unwrap();
    let region = config["crop"]["crop"][0].as_str().unwrap().to_owned();
    assert_eq!(desk.close(), Some(0));

    // The same triangles as with the region on the command line, and fewer than all.
    let bake = |output: &str, flags: &[&str]| {
        desk.run(
            &[&["bake", "studio.ply", "-o", output, "--teacher", "off", "-q"], flags].concat(),
        );
        std::fs::read(desk.at(output)).unwrap()
    };
    let all = bake("all.glb", &[]);
    let by_file = bake("file.glb", &["--config", "shots/studio.crop.json"]);
    assert!(by_file.len() < all.len());
    assert!(by_file == bake("flag.glb", &[&format!("--crop={region}")]), "{region}");
}

#[test]
fn drop_of_a_file_shows_it_and_of_a_broken_one_nothing() {
    let Some(mut desk) = Desk::new() else { return };
    samples::studio(desk.at("studio.ply"), 4000);
    desk.run(&["bake", "studio.ply", "-o", "a scene.glb", "--teacher", "off"]);
    write_photos(&desk.at("photos"));
    std::fs::write(desk.at("one.obj"), "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n")
        .unwrap();
    std::fs::write(desk.at("broken.glb"), "glTF, but not really").unwrap();
    desk.open(&["view", "one.obj", "--size", PHOTO, "--msaa", "1", "--screenshots", "shots"]);
    let id = desk.window.as_ref().unwrap().1.clone();
    let title = |desk: &Desk| desk.xdotool(&format!("getwindowname {id}"));
    let drop = |desk: &Desk, name: &str| {
        let uri = format!("file://{}", desk.at(name).display().to_string().replace(' ', "%20"));
        drop_on(&desk.display, id.parse().unwrap(), &uri);
    };
    assert!(title(&desk).starts_with("one.obj"), "{}", title(&desk));
    desk.xdotool("key h");
    let before = desk.screenshot(1);
    drop(&desk, "broken.glb");
    drop(&desk, "a scene.glb");
    wait_for("the other scene", || {
        let shown = title(&desk).starts_with("a scene.glb");
        // Refused while the broken one was still being read.
        shown.then_some(()).or_else(|| drop_again(&drop, &desk))
    });
    let after = desk.screenshot(2);
    assert!(off(&before, &after) > 0.05, "another picture");
    // A folder is a data set of the scene that is shown: the window goes to one of its photos.
    drop(&desk, "photos");
    desk.run(&[
        "render",
        "a scene.glb",
        "-o",
        "cpu",
        "--ssaa",
        "1",
        "--dataset",
        "photos",
        "--split",
        "all",
    ]);
    shown_picture(&desk, &desk.at("cpu"));
    assert_eq!(desk.close(), Some(0));
}

/// Drops the scene once more, after a while.
fn drop_again(drop: &dyn Fn(&Desk, &str), desk: &Desk) -> Option<()> {
    std::thread::sleep(Duration::from_millis(500));
    drop(desk, "a scene.glb");
    None
}

#[test]
fn a_window_that_cannot_be_filled_closes_with_the_reason() {
    let Some(desk) = Desk::new() else { return };
    std::fs::write(desk.at("broken.glb"), "glTF, but not really").unwrap();
    let done = desk.trisplat(&["view", "broken.glb"]).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("error: broken.glb"), "{said}");

    let done = desk.trisplat(&["view", "broken.glb"]).env("DISPLAY", ":65000").output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("no window can be opened") && said.contains("trisplat render"), "{said}");
}

#[test]
fn view_of_a_training_changes_no_byte_of_its_file() {
    let Some(mut desk) = Desk::new() else { return };
    samples::photos(desk.at("photos"), [12, 64, 300], 0);
    let train = |output: &'static str, more: &[&'static str]| {
        let plain = [
            "train",
            "photos",
            "--preset",
            "solid",
            "--steps",
            "400",
            "--max-triangles",
            "600",
            "--teacher",
            "off",
        ];
        [&plain[..], &["--backend", "cpu", "--output", output], more].concat()
    };
    desk.run(&train("alone.ply", &[]));
    desk.open(&train("watched.ply", &["--view"]));
    let first = desk.seen();
    // The note of the end stands in the panel, and the picture is no longer that of the first
    // triangles.
    let watched = desk.at("watched.ply");
    wait_for("the scene", || watched.exists().then_some(()));
    wait_for("another picture", || (off(&desk.seen(), &first) > 0.02).then_some(()));
    assert_eq!(desk.close(), Some(0));
    assert!(std::fs::read(&watched).unwrap() == std::fs::read(desk.at("alone.ply")).unwrap());
}

#[test]
fn a_training_goes_on_when_its_window_is_closed() {
    let Some(mut desk) = Desk::new() else { return };
    samples::photos(desk.at("photos"), [12, 64, 300], 0);
    // Long enough that it is not over when the window is closed, and then stopped.
    let train =
        ["train", "photos", "--steps", "300000", "--max-cpu-secs", "15", "--max-triangles", "600"];
    desk.open(&[&train[..], &["--backend", "cpu", "--view", "-o", "scene.ply"]].concat());
    assert!(!desk.at("scene.ply").exists());
    assert_eq!(desk.close(), Some(0));
    assert!(desk.at("scene.ply").exists());
}

#[test]
fn train_view_without_a_screen_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("scene.ply");
    let mut train = Command::new(TRISPLAT);
    train.args(["train", "samples/dataset", "--view", "-o"]).arg(&output);
    let done = train.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    assert_eq!(done.status.code(), Some(1));
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(said.contains("no window can be opened") && said.contains("--preview"), "{said}");
    assert!(!output.exists());
}
