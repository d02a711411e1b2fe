//! Pages in a real browser: headless Chromium opens them from disk, draws them and is moved about
//! in them.

use super::{bake, have, here, runs_with, small_studio, studio};
use glam::{DVec3, Mat3, UVec2, Vec3};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{ReadOptions, read};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Provenance, Scene, camera::Camera, image::RgbImage, math::metric, mesh::Mesh,
};

/// The browser, when it and what drives it are there.
pub(super) fn chromium() -> Option<PathBuf> {
    let found = ["/usr/bin/chromium", "/usr/bin/chromium-browser"].map(PathBuf::from);
    let found = found.into_iter().find(|path| path.exists());
    let driver = here("target/judges/node_modules/playwright-core").exists();
    have("chromium", found.is_some() && driver).then_some(found).flatten()
}

/// What came of visiting `pages`: see `tests/judges/browser.mjs`.
pub(super) fn visit(chromium: &Path, pages: &Value) -> Vec<Value> {
    let mut command = Command::new("node");
    command.arg(here("tests/judges/browser.mjs")).arg(here("target/judges")).arg(chromium);
    let done = runs_with(&mut command, pages.to_string().as_bytes());
    let lines: Vec<Value> = done
        .stdout
        .split(|&b| b == b'\n')
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect();
    assert_eq!(
        lines.len(),
        pages.as_array().unwrap().len(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    lines
}

/// Triangles and origin of a file that was written.
pub(super) fn mesh(path: &Path) -> (Mesh, Provenance) {
    let loaded = read(path, &ReadOptions::with_degree(0)).unwrap();
    let Scene::Mesh(mesh) = loaded.scene else { panic!("baked files hold meshes") };
    (mesh, loaded.provenance)
}

/// A data set's camera in the frame of a file.
pub(super) fn in_file(camera: &Camera, origin: DVec3, provenance: &Provenance) -> Camera {
    let placement = &provenance.placement;
    let rotation = camera.rotation.as_dmat3();
    let center =
        rotation * (DVec3::from(placement.center) - origin) + camera.translation.as_dvec3();
    Camera {
        rotation: (rotation * placement.rotation().transpose()).as_mat3(),
        translation: (center * placement.scale).as_vec3(),
        ..*camera
    }
}

/// The words that make a page look through a camera.
pub(super) fn fragment(camera: &Camera) -> String {
    let list = |numbers: &[f32]| numbers.iter().map(f32::to_string).collect::<Vec<_>>().join(",");
    let axes: Mat3 = camera.rotation.transpose();
    let eye = camera.position();
    let [fx, fy, cx, cy] = [camera.focal.x, camera.focal.y, camera.center.x, camera.center.y];
    format!(
        "#eye={}&target={}&up={}&pinhole={}",
        list(&eye.to_array()),
        list(&(eye + axes * Vec3::Z).to_array()),
        list(&(axes * Vec3::NEG_Y).to_array()),
        list(&[fx, fy, cx, cy, camera.size.x as f32, camera.size.y as f32]),
    )
}

/// Held-out cameras of the sample data set, at `size`, in the frame of a file.
fn cameras(provenance: &Provenance, size: UVec2) -> Vec<Camera> {
    let dataset = Dataset::load(here("samples/dataset"), &DatasetOptions::default()).unwrap();
    let cameras =
        dataset.test().map(|v| in_file(&v.camera.resized(size), dataset.origin, provenance));
    cameras.take(3).collect()
}

#[test]
fn a_page_shows_what_our_renderer_draws() {
    let flags = ["--set", "chunk_triangles=3000", "--set", "scale=2", "--set", "center=true"];
    assert_page_draws_as_we_do(&studio(), &flags);
}

#[test]
fn page_draws_view_dependent_colours_as_we_do() {
    let dataset = here("samples/dataset");
    let flags = ["--dataset", dataset.to_str().unwrap(), "--sh", "2", "--set", "scale=2"];
    assert_page_draws_as_we_do(&here("samples/soups/trained.ply"), &flags);
}

/// Bake a page, and compare what a browser shows with our renderer from held-out cameras.
fn assert_page_draws_as_we_do(input: &Path, flags: &[&str]) {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("scene.html");
    bake(input, &page, flags);
    let (mesh, provenance) = mesh(&page);
    let size = UVec2::new(480, 360);
    let cameras = cameras(&provenance, size);
    let screenshot = |samples: u32, i: usize| folder.path().join(format!("{samples}-{i}.png"));
    // Pixel centres only, then as users see it once all is at rest.
    let pages: Vec<Value> = [(1, "&ssaa=1"), (4, "")]
        .map(|(samples, words)| {
            let step = |(i, c): (usize, &Camera)| json!({ "show": fragment(c), "screenshot": screenshot(samples, i) });
            let steps: Vec<Value> = cameras.iter().enumerate().map(step).collect();
            let fragment = format!("#bare&near=0.01&background=204060{words}");
            json!({ "page": page, "fragment": fragment, "size": [size.x, size.y], "steps": steps })
        })
        .into();
    for (visit, samples) in visit(&chromium, &Value::from(pages)).iter().zip([1, 4]) {
        assert_eq!((&visit["errors"], &visit["state"]), (&json!([]), &json!("ready")), "{visit}");
        for (i, camera) in cameras.iter().enumerate() {
            let background = [0x20, 0x40, 0x60].map(|code| f32::from(code as u8) / 255.0);
            let options = SolidRasterOptions { background, samples, near: 0.01 };
            let ours = SolidRasterizer::new().render(&mesh, camera, &options);
            let theirs = RgbImage::load(&screenshot(samples, i)).unwrap();
            assert_eq!(theirs.size, size);
            let psnr = metric::psnr(&ours.rgb, &theirs.rgb, None);
            let far = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|c| a[c].abs_diff(b[c]) > 2);
            let off =
                ours.rgb.iter().zip(&theirs.rgb).filter(far).count() as f64 / ours.rgb.len() as f64;
            println!(
                "camera {i}, {samples} samples along an axis: {psnr:.2} dB, {:.2}% off",
                100.0 * off
            );
            if let Some(folder) = std::env::var_os("TRISPLAT_KEEP").map(PathBuf::from) {
                ours.save_png(folder.join(format!("{samples}-{i}-ours.png"))).unwrap();
                theirs.save_png(folder.join(format!("{samples}-{i}-page.png"))).unwrap();
            }
            // One sample decides all of a pixel, and browsers' software snaps corners to 1/16 px,
            // ours to 1/256.
            let close = if samples == 1 { off < 0.01 } else { psnr >= 35.0 };
            assert!(close, "camera {i}, {samples} samples: {psnr:.2} dB, {:.2}% off", 100.0 * off);
        }
    }
}

/// The direction of the eye from the target of a view.
fn direction(view: &Value) -> DVec3 {
    away(view).normalize()
}

/// The way from the target of a view to its eye, as the page tells it.
fn away(view: &Value) -> DVec3 {
    let text = view.as_str().unwrap().trim_start_matches('#');
    let point = |name: &str| -> DVec3 {
        let list = text.split('&').find_map(|part| part.strip_prefix(name)).unwrap();
        let numbers: Vec<f64> = list.split(',').map(|number| number.parse().unwrap()).collect();
        DVec3::from_slice(&numbers)
    };
    point("eye=") - point("target=")
}

#[test]
fn page_drag_stays_within_the_photos_viewpoints() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let scene = folder.path().join("scene.ply");
    let page = folder.path().join("scene.html");
    bake(&studio(), &scene, &[]);
    let bytes = fs::read(&scene).unwrap();
    let end = bytes.windows(10).position(|word| word == b"end_header").unwrap();
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let range = r#""orbit":{"turn":[-30,50],"elevation":[-5,70]},"fov""#;
    let ranged = header.replace("\"fov\"", range);
    assert_ne!(header, ranged);
    fs::write(&scene, [ranged.as_bytes(), &bytes[end..]].concat()).unwrap();
    bake(&scene, &page, &[]);
    let right = json!({ "drag": [5, 150, 390, 0] });
    let left = json!({ "drag": [395, 150, -390, 0] });
    let down = json!({ "drag": [200, 5, 0, 290] });
    let steps = [left.clone(), left.clone(), right.clone(), right.clone(), down.clone(), down];
    let anywhere = [left.clone(), left.clone(), json!({ "click": "anywhere" }), left];
    let pages = json!([
        { "page": page, "fragment": "#ssaa=1", "size": [400, 300], "steps": anywhere },
        { "page": page, "fragment": "#ssaa=1", "size": [400, 300], "steps": steps },
        { "page": page, "fragment": "#ssaa=1&eye=0,-9,0.1&target=0,0,0", "size": [400, 300], "steps": [right] },
    ]);
    let visits = visit(&chromium, &pages);
    let free = visits[0]["views"].as_array().unwrap();
    assert!(direction(&free[2]).dot(direction(&free[4])) < 0.9, "limits that are lifted: {free:?}");
    let visits = &visits[1..];
    let views = visits[0]["views"].as_array().unwrap();
    let angles = |view: &Value| {
        let start = direction(&views[0]);
        let now = direction(view);
        let turn = now.x.atan2(now.z) - start.x.atan2(start.z);
        let turn = (turn + PI).rem_euclid(std::f64::consts::TAU) - PI;
        [turn, now.y.asin()].map(|angle| angle.to_degrees().round())
    };
    let reached = [2, 4, 6].map(|step| angles(&views[step]));
    assert_eq!([reached[0][0], reached[1][0], reached[2][1]], [50.0, -30.0, 70.0], "{reached:?}");
    assert_eq!(visits[0]["limit"], json!(true), "the page says why it comes back");
    assert!(direction(&visits[1]["views"][0]).y < -0.99, "{}", visits[1]);
}

/// What an input did to the picture, in shares of its pixels.
pub(super) struct Seen {
    /// Pixels that the input changed.
    pub(super) changed: f64,
    /// Pixels that were not as they are when the view is drawn anew.
    pub(super) stale: f64,
}

/// Compares the pictures that `tests/judges/inputs.mjs` saved as `name`.
pub(super) fn seen(name: &Path) -> Seen {
    let picture =
        |when| RgbImage::load(&PathBuf::from(format!("{}-{when}.png", name.display()))).unwrap();
    let [before, after, again] = ["before", "after", "again"].map(picture);
    let share = |a: &RgbImage, b: &RgbImage| {
        let far = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|c| a[c].abs_diff(b[c]) > 2);
        let same_size = a.size == b.size;
        if same_size {
            a.rgb.iter().zip(&b.rgb).filter(far).count() as f64 / a.rgb.len() as f64
        } else {
            1.0
        }
    };
    Seen { changed: share(&before, &after), stale: share(&after, &again) }
}

/// Share of pixels that may differ where a picture is the same: a camera that comes to rest creeps.
pub(super) const SAME: f64 = 0.002;
/// Share of pixels that an input changes at least, unless its `least` says another.
pub(super) const MOVED: f64 = 0.02;

/// The inputs, each with the name under which its pictures are saved in `folder`.
pub(super) fn named(folder: &Path, inputs: &[(Value, bool)]) -> Vec<Value> {
    let with = |(i, (input, _)): (usize, &(Value, bool))| {
        let mut input = input.clone();
        input["seen"] = json!(folder.join(i.to_string()));
        input
    };
    inputs.iter().enumerate().map(with).collect()
}

/// Asserts that each input changed the picture if it `moves`, and that the picture was then what is
/// drawn anew.
pub(super) fn assert_seen(folder: &Path, inputs: &[(Value, bool)]) {
    for (i, (input, moves)) in inputs.iter().enumerate() {
        let Seen { changed, stale } = seen(&folder.join(i.to_string()));
        println!("{input}: {:.1}% changed, {:.1}% stale", 100.0 * changed, 100.0 * stale);
        assert!(stale < SAME, "{i}, {input}: {stale} of the picture is from before");
        let least = input["least"].as_f64().unwrap_or(MOVED);
        let as_promised = if *moves { changed > least } else { changed < SAME };
        assert!(as_promised, "{i}, {input}: {changed} of the picture changed");
    }
}

#[test]
fn mouse_fingers_keys_and_buttons_change_the_picture_at_once() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("scene.html");
    bake(&small_studio(folder.path()), &page, &["--backdrop", "off"]);
    // Small pictures, as software draws every frame of a glide.
    let wide = [280, 210];
    let high = [210, 280];
    let middle = [140, 105];
    let inputs = [
        (json!({ "wheel": -100, "notches": 9, "at": middle }), true),
        (json!({ "wheel": 100, "notches": 4, "at": middle }), true),
        (json!({ "drag": [140, 105, 42, 14] }), true),
        (json!({ "drag": [140, 105, 28, 21], "button": "right" }), true),
        (json!({ "press": "w", "ms": 300 }), true),
        (json!({ "press": "ArrowLeft", "ms": 300 }), true),
        (json!({ "press": "q", "ms": 200 }), true),
        (json!({ "press": "d", "ms": 200 }), true),
        (json!({ "press": "a", "ms": 200 }), true),
        (json!({ "press": "e", "ms": 200 }), true),
        (json!({ "double": [105, 119] }), true),
        (json!({ "hide": true }), false),
        (json!({ "press": "Home" }), true),
        (json!({ "click": "fly" }), false),
        (json!({ "drag": [140, 105, 42, 14] }), true),
        (json!({ "wheel": -100, "notches": 4 }), true),
        (json!({ "press": "s", "ms": 300 }), true),
        (json!({ "press": "v" }), false),
        (json!({ "press": "f" }), true),
        (json!({ "press": "r" }), true),
        (json!({ "click": "fit" }), true),
        (json!({ "click": "start" }), true),
        (json!({ "show": "#eye=3,3,3&target=0,0,0" }), true),
        (json!({ "resize": high }), true),
    ];
    let touches = [
        (json!({ "pinch": [105, 140, 42, 140] }), true),
        (json!({ "finger": [105, 140, 35, 0] }), true),
        (json!({ "fingers": [105, 140, 28, 21], "least": 0.6 }), true),
        (json!({ "tap": [77, 161] }), true),
    ];
    let lost = [(json!({ "lose": true }), false)];
    let [mouse, fingers, driver] =
        ["mouse", "fingers", "driver"].map(|name| folder.path().join(name));
    for folder in [&mouse, &fingers, &driver] {
        fs::create_dir(folder).unwrap();
    }
    let pages = json!([
        { "page": page, "fragment": "#ssaa=2", "size": wide, "steps": named(&mouse, &inputs) },
        { "page": page, "fragment": "#ssaa=2&eye=5,1,2&target=0,0,0&fov=40", "size": high, "touch": true,
          "steps": named(&fingers, &touches) },
        { "page": page, "fragment": "#ssaa=2", "size": wide, "steps": named(&driver, &lost) },
    ]);
    let visits = visit(&chromium, &pages);
    // The browser complains of what the lost graphics took along.
    for visit in &visits[..2] {
        assert_eq!((&visit["errors"], &visit["state"]), (&json!([]), &json!("ready")), "{visit}");
        assert_eq!((&visit["loading"], &visit["flying"]), (&json!(false), &json!(false)));
    }
    assert_seen(&mouse, &inputs);
    assert_seen(&fingers, &touches);
    assert_seen(&driver, &lost);
    assert_eq!(
        visits[0]["help"],
        json!(false),
        "the first touch of the picture takes the help away"
    );
    assert_eq!(
        visits[1]["keys"],
        json!(false),
        "a phone has no keys, and needs the room for the picture"
    );
    assert_eq!(visits[1]["views"][0], json!("#eye=5,1,2&target=0,0,0&up=0,1,0&fov=40"));
}

/// An OBJ with a red ball of radius 1, and a blue crumb far from it.
pub(super) fn ball_and_crumb() -> String {
    ball_in_parts(1.0)
}

/// The same with parts of the ball this much smaller: below 1 they do not touch, as those of
/// trained scenes.
pub(super) fn ball_in_parts(size: f64) -> String {
    let around = |a: u32, b: u32| {
        let down = f64::from(a) * PI / 8.0;
        let turn = f64::from(b) * PI / 8.0;
        [down.sin() * turn.cos(), down.cos(), down.sin() * turn.sin()]
    };
    let part = |a, b| {
        let corners = [around(a, b), around(a, b + 1), around(a + 1, b + 1), around(a + 1, b)];
        let middle = |axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0;
        let placed =
            |corner: [f64; 3], axis: usize| size * corner[axis] + (1.0 - size) * middle(axis);
        corners.map(|corner| [0, 1, 2].map(|axis| placed(corner, axis)))
    };
    let ball = (0..8).flat_map(|a| (0..16).map(move |b| (part(a, b), "1 0 0")));
    let crumb = [[8.0, 0.0, 0.0], [8.2, 0.0, 0.0], [8.2, 0.2, 0.0], [8.0, 0.2, 0.0]];
    let face = |(corners, color): ([[f64; 3]; 4], &str)| {
        let line = |[x, y, z]: [f64; 3]| format!("v {x} {y} {z} {color}\n");
        format!("{}f -4 -3 -2 -1\n", corners.map(line).concat())
    };
    ball.chain([(crumb, "0.2 0.2 0.8")]).map(face).collect()
}

/// Asserts that the red ball is whole in a picture and large: as high and wide as `share` of the
/// picture's shorter side.
fn assert_framed(picture: &Path, share: f64) {
    let picture = RgbImage::load(picture).unwrap();
    let at = |i: usize| UVec2::new(i as u32 % picture.size.x, i as u32 / picture.size.x);
    let red = |(_, [r, g, _]): &(usize, &[u8; 3])| *r > 150 && *g < 60;
    let ball: Vec<UVec2> = picture.rgb.iter().enumerate().filter(red).map(|(i, _)| at(i)).collect();
    assert!(!ball.is_empty(), "the subject is in the picture");
    let low = ball.iter().copied().reduce(UVec2::min).unwrap();
    let high = ball.iter().copied().reduce(UVec2::max).unwrap();
    assert!(
        low.min_element() > 2 && (high + 3).cmplt(picture.size).all(),
        "not whole: {low} to {high}"
    );
    let least = (f64::from(picture.size.min_element()) * share) as u32;
    assert!((high - low).min_element() >= least, "not large: {low} to {high} of {}", picture.size);
}

#[test]
fn page_key_f_frames_the_subject_and_the_link_is_the_view() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let [scene, page, wide, narrow] =
        ["ball.obj", "ball.html", "wide.png", "narrow.png"].map(|name| folder.path().join(name));
    fs::write(&scene, ball_and_crumb()).unwrap();
    bake(&scene, &page, &["--up", "y"]);
    let steps = json!([
        { "press": "f" }, { "drag": [200, 150, 90, 40] }, { "wheel": 100, "notches": 5 }, { "press": "f", "screenshot": wide },
        { "press": "r" }, { "press": "l" },
        { "drag": [200, 150, 150, 60], "button": "right" }, { "resize": [200, 300] }, { "press": "f", "screenshot": narrow },
    ]);
    let visits = visit(
        &chromium,
        &json!([{ "page": page, "fragment": "#bare&ssaa=2", "size": [400, 300], "steps": steps }]),
    );
    for picture in [wide, narrow] {
        assert_framed(&picture, 0.7);
    }
    let views = visits[0]["views"].as_array().unwrap();
    let word = |view: &Value, word: &str| {
        view.as_str().unwrap().split('&').find(|part| part.starts_with(word)).map(str::to_owned)
    };
    for framed in [1, 4] {
        assert_eq!(
            word(&views[framed], "target="),
            word(&views[1], "target="),
            "F looks at the subject"
        );
        let turned = direction(&views[framed]).dot(direction(&views[framed - 1]));
        assert!(turned > 0.999, "F looks from where one is: {turned}");
    }
    assert!(direction(&views[1]).dot(direction(&views[4])) < 0.99, "the drag turned");
    assert_eq!(views[5], views[0], "R is the first view");
    assert_eq!(visits[0]["hash"], views[6], "the link is the view");
}

/// All that there is would be a dot in the dark otherwise.
#[test]
fn zooming_out_ends_where_all_is_as_high_as_the_picture() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let [scene, page] = ["ball.obj", "ball.html"].map(|name| folder.path().join(name));
    fs::write(&scene, ball_and_crumb()).unwrap();
    bake(&scene, &page, &["--up", "y"]);
    let steps = json!([{ "wheel": 400, "at": [200, 150], "notches": 60 }, { "show": "#eye=0,0,900&target=0,0,0" }]);
    let visits = visit(
        &chromium,
        &json!([{ "page": page, "fragment": "#ssaa=1", "size": [400, 300], "steps": steps }]),
    );
    let views = visits[0]["views"].as_array().unwrap();
    let away = [0, 1, 2].map(|step| away(&views[step]).length());
    assert!(away[1] > 2.0 * away[0] && away[1] < 2.6 * 8.3, "{away:?}");
    assert!((away[2] - 900.0).abs() < 0.01, "an address goes anywhere: {away:?}");
}

#[test]
fn a_page_that_is_cut_short_says_so() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("scene.html");
    bake(&studio(), &page, &[]);
    let whole = fs::read_to_string(&page).unwrap();
    let start = whole.find("gltf-binary;base64\">").unwrap() + 20;
    let end = whole.rfind("</script><script>").unwrap();
    let short = format!("{}{}", &whole[..start + (end - start) / 8 * 4], &whole[end..]);
    fs::write(&page, short).unwrap();
    let visits = visit(&chromium, &json!([{ "page": page, "size": [300, 200] }]));
    assert_eq!(visits[0]["state"], json!("failed"), "{}", visits[0]);
    assert!(visits[0]["says"].as_str().unwrap().contains("cut short"), "{}", visits[0]);
    assert_eq!(visits[0]["loading"], json!(true), "the message is in sight");
}

#[test]
fn a_browser_that_cannot_draw_gets_advice() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("scene.html");
    bake(&studio(), &page, &[]);
    let visits = visit(
        &chromium,
        &json!([
            { "page": page, "size": [300, 200], "webgl": false },
            { "page": page, "size": [300, 200], "script": false },
        ]),
    );
    assert_eq!(
        (&visits[0]["state"], &visits[0]["loading"]),
        (&json!("failed"), &json!(true)),
        "{}",
        visits[0]
    );
    let says = visits[0]["says"].as_str().unwrap();
    assert!(says.contains("WebGL 2") && says.contains("hardware acceleration"), "{says}");
    let text = visits[1]["text"].as_str().unwrap();
    assert!(text.contains("turn on JavaScript") && !text.contains("loading"), "{text}");
}

/// The page that the program carries is the one that its sources make.
#[test]
fn the_page_is_built_from_its_sources() {
    let packages = here("target/judges/page");
    let lock = |folder: &Path| fs::read(folder.join("package-lock.json")).unwrap_or_default();
    let there = packages.join("node_modules").exists() && lock(&packages) == lock(&here("page"));
    if !have("page", there) {
        return;
    }
    let folder = TempDir::new_in(&packages).unwrap();
    let copy = folder.path().join("src");
    fs::create_dir(&copy).unwrap();
    for file in fs::read_dir(here("page/src")).unwrap().flatten() {
        fs::copy(file.path(), copy.join(file.file_name())).unwrap();
    }
    fs::copy(here("page/build.mjs"), folder.path().join("build.mjs")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("../node_modules", folder.path().join("node_modules")).unwrap();
    let done =
        super::runs(Command::new("node").arg("build.mjs").arg("dist").current_dir(folder.path()));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    for name in ["page.html", "LICENSES.txt"] {
        let built = fs::read(folder.path().join("dist").join(name)).unwrap();
        let kept = fs::read(here("crates/formats/page").join(name)).unwrap();
        assert!(
            built == kept,
            "crates/formats/page/{name} is not what page/src makes: cd page && npm ci && npm run build"
        );
    }
}
