//! What one does in a page beyond looking around: what stands in the way, walking, switches.

use super::browser::{assert_seen, ball_and_crumb, ball_in_parts, chromium, mesh, named, visit};
use super::{assert_valid, bake, here, validator};
use glam::Vec3;
use serde_json::{Value, json};
use std::fs;
use tempfile::TempDir;
use trisplat_scene::image::RgbImage;

/// A blue wall of an OBJ, before the ball.
const WALL: &str = "v -9 -9 1.6 0 0 1\nv 9 -9 1.6 0 0 1\nv 0 14 1.6 0 0 1\nf -3 -2 -1\n";

#[test]
fn page_cuts_away_what_hides_the_subject() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let [scene, page, framed, turned] =
        ["ball.obj", "ball.html", "framed.png", "turned.png"].map(|name| folder.path().join(name));
    fs::write(&scene, format!("{}{WALL}", ball_in_parts(0.99))).unwrap();
    bake(&scene, &page, &["--up", "y"]);
    let steps = json!([
        { "show": "#eye=0,0.1,7&target=0,0,0" }, { "press": "f", "screenshot": framed },
        { "drag": [200, 150, 30, 10], "screenshot": turned }, { "press": "l" },
        { "show": "#eye=0,0.1,3&target=0,0,0" }, { "press": "w", "ms": 2500 },
    ]);
    let pages =
        json!([{ "page": page, "fragment": "#bare&ssaa=1", "size": [400, 300], "steps": steps }]);
    let visits = visit(&chromium, &pages);
    for picture in [&framed, &turned].map(|path| RgbImage::load(path).unwrap()) {
        let red = picture.rgb.iter().filter(|[r, g, _]| *r > 150 && *g < 60).count();
        let share = red as f64 / picture.rgb.len() as f64;
        assert!(share > 0.4, "the ball is in {share} of the picture");
        assert_eq!(picture.rgb[0], [0x66, 0x68, 0x6c], "the ground is neutral");
    }
    let views = visits[0]["views"].as_array().unwrap();
    let is_cut = |step: usize| views[step].as_str().unwrap().contains("&near=");
    assert_eq!([1, 2, 3, 5].map(is_cut), [false, true, true, false], "{views:?}");
    assert!(visits[0]["hash"].as_str().unwrap().contains("&near="), "the link shows the same");
    let place = |view: &Value| -> f64 {
        let text = view.as_str().unwrap();
        let eye = text.split("eye=").nth(1).unwrap().split('&').next().unwrap();
        eye.split(',').nth(2).unwrap().parse().unwrap()
    };
    let walked = [place(&views[5]), place(&views[6])];
    assert!(walked[1] < walked[0] - 0.2 && walked[1] > 1.6, "ends at the wall: {walked:?}");
}

#[test]
fn page_switches_wires_shine_and_surroundings() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("scene.html");
    let dataset = here("samples/dataset");
    let flags = ["--dataset", dataset.to_str().unwrap(), "--sh", "2", "--set", "scale=2"];
    let sphere = ["--backdrop", "sphere"];
    bake(&here("samples/soups/trained.ply"), &page, &[&flags[..], &sphere].concat());
    let inputs = [
        (json!({ "click": "wires" }), true),
        (json!({ "press": "t" }), true),
        (json!({ "press": "c", "least": 0.005 }), true),
        (json!({ "click": "sh", "least": 0.005 }), true),
        (json!({ "click": "around", "least": 0.01 }), true),
        (json!({ "press": "b", "least": 0.01 }), true),
    ];
    let steps = named(folder.path(), &inputs);
    let pages =
        json!([{ "page": page, "fragment": "#ssaa=1", "size": [720, 240], "steps": steps }]);
    let visits = visit(&chromium, &pages);
    assert_eq!(visits[0]["errors"], json!([]));
    assert!(visits[0]["scale"].as_str().unwrap().ends_with('m'), "{}", visits[0]);
    assert_seen(folder.path(), &inputs);
    let picture = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(picture("0-before.png") == picture("5-again.png"), "switched back");
}

/// With `--lit` the ball has shades; without, it is a red disc.
#[test]
fn page_of_a_mesh_shows_its_shape_by_light() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let scene = folder.path().join("ball.obj");
    fs::write(&scene, ball_and_crumb()).unwrap();
    let reds = [&["--up", "y"][..], &["--up", "y", "--lit=flat"]].map(|flags| {
        let [page, shot] = ["ball.html", "ball.png"].map(|name| folder.path().join(name));
        bake(&scene, &page, &[flags, &["--force"]].concat());
        let steps = json!([{ "show": "#eye=1,1,4&target=0,0,0", "screenshot": shot }]);
        let pages = json!([{ "page": page, "fragment": "#bare&ssaa=1", "size": [300, 200], "steps": steps }]);
        assert_eq!(visit(&chromium, &pages)[0]["errors"], json!([]));
        let picture = RgbImage::load(&shot).unwrap();
        let is_red = |[r, g, b]: &[u8; 3]| *r > 40 && *g < 20 && *b < 20;
        let shades: std::collections::BTreeSet<u8> =
            picture.rgb.iter().filter(|rgb| is_red(rgb)).map(|[r, ..]| *r).collect();
        shades
    });
    assert_eq!(reds[0].len(), 1, "{reds:?}");
    assert!(reds[1].len() > 20 && reds[1].last() > Some(&220), "{reds:?}");
}

#[test]
fn page_up_of_three_clicks_is_that_of_the_source() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let [scene, page] = ["ball.obj", "ball.html"].map(|name| folder.path().join(name));
    fs::write(&scene, format!("{}{WALL}", ball_in_parts(0.99))).unwrap();
    bake(&scene, &page, &["--up", "0.2,-0.9,0.3", "--set", "rotate=30"]);
    let placement = mesh(&page).1.placement;
    let list = |[x, y, z]: [f32; 3]| format!("{x},{y},{z}");
    let [eye, target] =
        [Vec3::new(0.0, 0.1, 4.0), Vec3::ZERO].map(|p| list(placement.to_file(p).to_array()));
    let up = list((placement.rotation().as_mat3() * Vec3::Y).to_array());
    let steps = json!([
        { "show": format!("#eye={eye}&target={target}&up={up}") }, { "click": "up" },
        { "single": [150, 100] }, { "single": [200, 270] }, { "single": [300, 120] },
    ]);
    let pages =
        json!([{ "page": page, "fragment": "#ssaa=1", "size": [720, 400], "steps": steps }]);
    let visits = visit(&chromium, &pages);
    let says = visits[0]["floor"].as_str().unwrap();
    assert!(says.starts_with("--up 0,0,1 "), "{says}");
    let view = visits[0]["views"][5].as_str().unwrap();
    let normal = placement.rotation().as_mat3() * Vec3::Z;
    let shown = view.split("up=").nth(1).unwrap().split('&').next().unwrap();
    let shown: Vec<f32> = shown.split(',').map(|number| number.parse().unwrap()).collect();
    assert!(Vec3::from_slice(&shown).distance(normal) < 1e-3, "{view} is not {normal} up");
}

#[test]
fn page_eraser_saves_the_rest_and_a_list_for_the_bake() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let [scene, page, saved, list, again] =
        ["ball.obj", "ball.html", "saved.glb", "list.json", "again.glb"]
            .map(|name| folder.path().join(name));
    fs::write(&scene, ball_and_crumb()).unwrap();
    bake(&scene, &page, &["--up", "-y"]);
    // The crumb is right of the ball.
    let around = [[650, 200], [780, 200], [780, 400], [650, 400]];
    let steps = json!([
        { "show": "#eye=4,0.1,8&target=4,0,0&fov=60" }, { "click": "erase" },
        { "stroke": around }, { "click": "delete" }, { "click": "undo" }, { "click": "redo" },
        { "click": "brush" }, { "stroke": [[170, 300], [210, 300]] }, { "press": "Delete" }, { "press": "Control+z" }, { "press": "Escape" },
        { "download": "save", "to": saved }, { "download": "list", "to": list },
    ]);
    let pages =
        json!([{ "page": page, "fragment": "#ssaa=1", "size": [900, 600], "steps": steps }]);
    let visits = visit(&chromium, &pages);
    assert_eq!(
        (&visits[0]["errors"], &visits[0]["count"]),
        (&json!([]), &json!("0 selected, 2 erased"))
    );
    let (whole, _) = mesh(&page);
    let (rest, provenance) = mesh(&saved);
    let is_crumb = |face: usize| whole.corners(face).iter().all(|p| p.length() > 7.0);
    let mut wanted = whole.clone();
    wanted.retain(|face| !is_crumb(face));
    assert_eq!(rest.face_count(), whole.face_count() - 2);
    assert!(rest.positions == wanted.positions && rest.colors == wanted.colors, "all else stays");
    assert_eq!(provenance.placement, mesh(&page).1.placement);
    if validator() {
        assert_valid(&[(saved, rest.face_count() as u64)]);
    }
    bake(&scene, &again, &["--up", "-y", "--erase", list.to_str().unwrap()]);
    assert_eq!(mesh(&again).0.face_count(), whole.face_count() - 2);
}
