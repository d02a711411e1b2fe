//! Pictures beside an OBJ or a PLY, in the dialects of the programs that write them.

use glam::{UVec2, Vec3};
use std::fs;
use tempfile::TempDir;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{ImportedScene, Scene};

/// Four colours: red and green above, blue and white below.
const TEXELS: [[u8; 3]; 4] = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255; 3]];

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = TempDir::new().expect("a folder");
    let picture = RgbImage { size: UVec2::splat(2), rgb: TEXELS.to_vec(), alpha: None };
    fs::write(folder.path().join("my col.png"), picture.to_png().expect("a picture"))
        .expect("written");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

fn read(folder: &TempDir, name: &str) -> ImportedScene {
    formats::read(&folder.path().join(name), &ReadOptions::default()).expect("valid")
}

fn mesh(loaded: &ImportedScene) -> &Mesh {
    match &loaded.scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("a mesh"),
    }
}

/// The colour at a corner of a face.
fn at_corner(loaded: &ImportedScene, face: usize, corner: usize) -> Vec3 {
    let texture =
        mesh(loaded).texture.as_ref().unwrap_or_else(|| panic!("kept: {:?}", loaded.warnings));
    Vec3::from(texture.texture(face).sample(texture.uvs[face][corner], 0.0))
}

/// Checks that a square from (0, 0) to (1, 1), its corners in the middle of texels, shows the
/// picture upright.
fn is_upright(loaded: &ImportedScene) {
    // Lower left, lower right, upper right.
    let wanted = [Vec3::Z, Vec3::ONE, Vec3::Y];
    for (corner, wanted) in wanted.into_iter().enumerate() {
        let seen = at_corner(loaded, 0, corner);
        assert!(
            (seen - wanted).abs().max_element() < 0.01,
            "corner {corner}: {seen}, {:?}",
            loaded.warnings
        );
    }
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.25 0.25\nvt 0.75 0.25\nvt 0.75 0.75\nvt 0.25 0.75\nusemtl m\nf 1/1 2/2 3/3 4/4\n";

#[test]
fn a_picture_is_read_once_by_whichever_names_materials_call_it() {
    let mut mtl = String::new();
    let mut obj = "mtllib a.mtl\n".to_owned() + SQUARE.rsplit_once("usemtl").expect("a material").0;
    for i in 0..40 {
        let name = ["my col.png", "./my col.png", "MY COL.png", "x/../my col.png"][i % 4];
        mtl += &format!("newmtl m{i}\nmap_Kd {name}\n");
        obj += &format!("usemtl m{i}\nf 1/1 2/2 3/3 4/4\n");
    }
    let folder = folder(&[("a.obj", &obj), ("a.mtl", &mtl)]);
    fs::create_dir(folder.path().join("x")).expect("made");
    #[cfg(unix)]
    std::os::unix::fs::symlink("my col.png", folder.path().join("link.png")).expect("linked");
    let loaded = read(&folder, "a.obj");
    is_upright(&loaded);
    let texture = mesh(&loaded).texture.as_ref().expect("kept");
    assert_eq!((texture.pages.len(), mesh(&loaded).face_count()), (1, 80), "{:?}", loaded.warnings);
}

#[test]
fn names_that_no_library_has_cost_little_time_and_few_words() {
    let count = 60_000;
    let mtl: String = (0..count).map(|i| format!("newmtl known{i}\nKd 1 0 0\n")).collect();
    let faces: String = (0..count).map(|i| format!("usemtl Unknown{i}\nf 1/1 2/2 3/3\n")).collect();
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl KNOWN7\nf 1/1 2/2 3/3\n{faces}");
    let folder = folder(&[("a.obj", &obj), ("a.mtl", &mtl)]);
    let began = std::time::Instant::now();
    let loaded = read(&folder, "a.obj");
    assert!(began.elapsed().as_secs() < 10, "{:?}", began.elapsed());
    let warning =
        loaded.warnings.iter().find(|warning| warning.contains("no library has")).expect("said");
    assert!(warning.contains("Unknown6 and 59993 more") && warning.len() < 300, "{warning}");
    let Colors::Face(colors) = &mesh(&loaded).colors else { panic!("{:?}", loaded.warnings) };
    assert_eq!(
        (colors[2], colors[3]),
        ([1.0, 0.0, 0.0], [1.0; 3]),
        "a name in another case is found"
    );
}

/// One line names as many libraries as fit in it.
#[test]
fn a_line_of_many_libraries_costs_little_time() {
    let names = "a.mtl ".repeat(10_000);
    let lines: String = (0..20).map(|_| format!("mtllib {names}\n")).collect();
    let folder = folder(&[("a.obj", &(lines + SQUARE))]);
    let began = std::time::Instant::now();
    read(&folder, "a.obj");
    assert!(began.elapsed().as_secs() < 5, "{:?}", began.elapsed());
}

#[test]
fn obj_library_and_picture_names_are_found() {
    for (library, obj, mtl) in [
        ("a.mtl", "mtllib a.mtl\n", "newmtl m\nmap_Kd my col.png\n"),
        ("q mtl.mtl", "mtllib \"q mtl.mtl\"\n", "newmtl m\nKd 1 1 1\nmap_Kd \"my col.png\"\n"),
        ("b.mtl", "mtllib a.mtl b.mtl\n", "newmtl m\nmap_Kd my col.png\n"),
        ("b.mtl", "mtllib a.mtl \\\nb.mtl\n", "newmtl \\\nm\nmap_Kd \\\nmy col.png\n"),
        ("SCENE.MTL", "mtllib scene.mtl\n", "newmtl M\nmap_kd MY COL.PNG\n"),
        ("a.mtl", "mtllib C:\\Users\\me\\a.mtl\n", "newmtl m\nmap_Kd C:\\textures\\My Col.png\n"),
        ("a.mtl", "mtllib /home/me/a.mtl\n", "newmtl m\nmap_Kd /home/me/my col.png\n"),
        ("a.mtl", "mtllib a.mtl\n", "newmtl m\nmap_Kd textures/my col.png\n"),
        ("a.mtl", "mtllib ./a.mtl\n", "newmtl m\nmap_Kd .\\my col.png\n"),
    ] {
        let folder = folder(&[(library, mtl), ("s.obj", &format!("{obj}{SQUARE}"))]);
        is_upright(&read(&folder, "s.obj"));
    }
}

#[test]
fn picture_of_another_machine_is_found_by_the_end_of_its_path() {
    let obj = format!("mtllib a.mtl\n{SQUARE}");
    let with = |inner: &str, named: &str| {
        let folder = folder(&[("a.mtl", &format!("newmtl m\nmap_Kd {named}\n")), ("s.obj", &obj)]);
        let to = folder.path().join(inner);
        fs::create_dir_all(to.parent().expect("a folder")).expect("made");
        fs::rename(folder.path().join("my col.png"), to).expect("moved");
        read(&folder, "s.obj")
    };
    for (inner, named) in [
        ("Textures/Wall_D.PNG", "C:\\Users\\me\\Documents\\textures\\wall_d.png"),
        ("tex/a/wall.png", "/home/me/project/tex/a/wall.png"),
        ("textures/wall.png", "../textures/wall.png"),
        ("maps/wall.png", "wall.png"),
        ("maps/WALL.png", "D:/elsewhere/wall.png"),
    ] {
        is_upright(&with(inner, named));
    }
    // Two of the name are not guessed between; what helps is said.
    let lost = with("x/y/wall.png", "/home/me/wall.png").warnings.join("; ");
    assert!(lost.contains("copy it beside the file, or give `allow_outside`"), "{lost}");
    if cfg!(not(windows)) {
        let lost = with("x/y/wall.png", "C:\\maps\\wall.png").warnings.join("; ");
        assert!(lost.contains("copy it beside") && !lost.contains("allow_outside"), "{lost}");
    }
}

#[test]
fn alpha_of_a_material_is_named_and_light_of_a_black_one_is_its_colour() {
    let of = |mtl: &str| {
        let obj = format!("mtllib a.mtl\n{SQUARE}");
        read(&folder(&[("a.mtl", mtl), ("s.obj", &obj)]), "s.obj")
    };
    for alpha in ["map_d my col.png", "d 0", "d 0.5", "Tr 0.3", "MAP_OPACITY my col.png"] {
        let text = of(&format!("newmtl m\nKd 1 0 0\n{alpha}\n")).warnings.join("; ");
        let keyword = alpha.split(' ').next().expect("a word");
        assert!(text.contains("drawn whole: m (") && text.contains(keyword), "{alpha}: {text}");
    }
    for opaque in ["d 1.0", "Tr 0", "Tr 1.0", "d", "illum 2"] {
        let text = of(&format!("newmtl m\nKd 1 0 0\n{opaque}\n")).warnings.join("; ");
        let of_plain_color = "a material has one colour and no picture: without light only its outline shows; `trisplat bake --lit` lets light fall on it";
        assert_eq!(text, of_plain_color, "{opaque}");
    }
    let color = |mtl: &str| match &mesh(&of(mtl)).colors {
        Colors::Face(colors) => colors[0],
        Colors::Vertex(_) => panic!("colours of materials are faces'"),
    };
    assert_eq!(color("newmtl m\nKd 0 0 0\nKe 1 0 0\n"), [1.0, 0.0, 0.0]);
    assert_eq!(color("newmtl m\nKd 0 1 0\nKe 1 0 0\n"), [0.0, 1.0, 0.0]);
    assert_eq!(color("newmtl m\nKd 0 0 0\nKe 0 0 0\n"), [0.0; 3]);
    is_upright(&of("newmtl m\nKd 0 0 0\nKe 1 1 1\nmap_Ke my col.png\n"));
    is_upright(&of("newmtl m\nKd 0 0 0\nKe 1 1 1\nmap_Kd my col.png\n"));
}

#[test]
fn a_face_may_go_on_in_the_next_line() {
    let folder = folder(&[("s.obj", &SQUARE.replace("3/3 4/4", "3/3 \\\r\n4/4"))]);
    assert_eq!(mesh(&read(&folder, "s.obj")).face_count(), 2);
}

#[test]
fn utf_16_is_read() {
    let folder = folder(&[("a.mtl", "newmtl m\nmap_Kd my col.png\n")]);
    for big in [false, true] {
        let text = format!("\u{feff}mtllib a.mtl\r\n{SQUARE}");
        let bytes: Vec<u8> = text
            .encode_utf16()
            .flat_map(|unit| if big { unit.to_be_bytes() } else { unit.to_le_bytes() })
            .collect();
        fs::write(folder.path().join("s.obj"), bytes).expect("written");
        is_upright(&read(&folder, "s.obj"));
    }
}

#[test]
fn options_and_colours_of_a_material_change_its_picture() {
    let of = |mtl: &str, square: &str| {
        let folder = folder(&[("a.mtl", mtl), ("s.obj", &format!("mtllib a.mtl\n{square}"))]);
        read(&folder, "s.obj")
    };
    // Half of the scale, and what it moves away.
    let half = SQUARE.replace("0.25", "0.5").replace("0.75", "1.5");
    is_upright(&of("newmtl m\nmap_Kd -s 0.5 0.5 1 my col.png\n", &half));
    let moved = SQUARE.replace("vt 0.25", "vt 0.15").replace("vt 0.75", "vt 0.65");
    is_upright(&of("newmtl m\nmap_Kd -o 0.1 0 0 my col.png\n", &moved));
    let red = of("newmtl m\nKd 1 0.5 0.5\nmap_Kd my col.png\n", SQUARE);
    let wanted = Vec3::new(1.0, linear_from_srgb(0.5), linear_from_srgb(0.5));
    assert!((at_corner(&red, 0, 1) - wanted).abs().max_element() < 0.01);
    // Black would leave nothing of it.
    is_upright(&of("newmtl m\nKd 0 0 0\nmap_Kd my col.png\n", SQUARE));
}

#[test]
fn what_is_lost_is_named() {
    let lost = |files: &[(&str, &str)], name: &str, words: &[&str]| {
        let loaded = read(&folder(files), name);
        let named = loaded.warnings.iter().any(|w| words.iter().all(|word| w.contains(word)));
        assert!(named, "{words:?}: {:?}", loaded.warnings);
    };
    let obj = format!("mtllib a.mtl\n{SQUARE}");
    lost(
        &[("a.mtl", "newmtl other\nKd 1 0 0\n"), ("s.obj", &obj)],
        "s.obj",
        &["no library has", "m"],
    );
    lost(
        &[("a.mtl", "newmtl m\nmap_Kd gone.png\n"), ("s.obj", &obj)],
        "s.obj",
        &["not read", "m: ", "gone.png"],
    );
    let bare = obj.replace("/1", "").replace("/2", "").replace("/3", "").replace("/4", "");
    lost(
        &[("a.mtl", "newmtl m\nmap_Kd my col.png\n"), ("s.obj", &bare)],
        "s.obj",
        &["not read", "no texture coordinates"],
    );
    let ply = |more: &str, row: &str| {
        format!(
            "ply\nformat ascii 1.0\n{more}element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2{row}\n"
        )
    };
    lost(
        &[("a.ply", &ply("comment TextureFile my col.png\n", ""))],
        "a.ply",
        &["my col.png", "no texture coordinates"],
    );
}

fn square_ply(comments: &str, vertex: &str, face: &str, rows: [&str; 4], faces: &[&str]) -> String {
    let vertices = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
    let vertices: Vec<String> =
        vertices.iter().zip(rows).map(|(at, row)| format!("{at} {row}")).collect();
    format!(
        "ply\nformat ascii 1.0\n{comments}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{vertex}element face {}\n\
         property list uchar int vertex_indices\n{face}end_header\n{}\n{}\n",
        faces.len(),
        vertices.join("\n"),
        faces.join("\n")
    )
}

#[test]
fn a_ply_has_its_picture_by_vertex_or_by_corner() {
    let file = "comment TextureFile my col.png\n";
    let places = ["0.25 0.25", "0.75 0.25", "0.75 0.75", "0.25 0.75"];
    let colored = places.map(|place| format!("{place} 255 255 255"));
    let [a, b, c, d] = &colored;
    let lists = "property list uchar float texcoord\n";
    let pages = "comment TextureFile gone.png\ncomment TextureFile my col.png\n";
    for text in [
        square_ply(
            file,
            "property float s\nproperty float t\n",
            "",
            places,
            &["3 0 1 2", "3 0 2 3"],
        ),
        square_ply(file, "property float u\nproperty float v\n", "", places, &["4 0 1 2 3"]),
        square_ply(
            file,
            "property float u\nproperty float v\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n",
            "",
            [a, b, c, d],
            &["3 0 1 2"],
        ),
        square_ply(file, "", lists, [""; 4], &["3 0 1 2 6 .25 .25 .75 .25 .75 .75"]),
        square_ply(file, "", lists, [""; 4], &["4 0 1 2 3 8 .25 .25 .75 .25 .75 .75 .25 .75"]),
        square_ply(
            pages,
            "",
            "property list uchar float texcoord\nproperty int texnumber\n",
            [""; 4],
            &["3 0 1 2 6 .25 .25 .75 .25 .75 .75 1", "3 0 2 3 6 0 0 1 1 0 1 0"],
        ),
    ] {
        is_upright(&read(&folder(&[("a.ply", &text)]), "a.ply"));
    }
}

#[test]
fn alpha_of_scanners_removes_no_faces() {
    let channels =
        "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";
    let of = |alpha: [u8; 4]| {
        let rows = alpha.map(|alpha| format!("200 100 50 {alpha}"));
        let [a, b, c, d] = &rows;
        read(
            &folder(&[("a.ply", &square_ply("", channels, "", [a, b, c, d], &["4 0 1 2 3"]))]),
            "a.ply",
        )
    };
    let nowhere = of([0; 4]);
    assert!(
        mesh(&nowhere).opacity.is_empty()
            && nowhere.warnings.iter().any(|w| w.contains("alpha is 0"))
    );
    for alpha in [[0, 255, 255, 255], [255, 0, 255, 0]] {
        assert!(mesh(&of(alpha)).opacity.iter().all(|o| *o == 1.0), "{alpha:?}");
    }
    let faint = of([51; 4]);
    assert!(mesh(&faint).opacity.iter().all(|o| (o - 0.2).abs() < 1e-3));
    assert!(matches!(&mesh(&faint).colors, Colors::Vertex(_)));
    assert_eq!(mesh(&faint).texture, None);
}
