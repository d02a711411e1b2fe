//! Bad input, one table: each file fails with one clear error or loses what is not finite, and none
//! panics or asks for memory it cannot fill.

use super::files::{
    Cell, ENCODINGS, Element, Encoding, mesh, ply, provenance, soup, soup_elements, source,
};
use proptest::prelude::*;
use trisplat_formats::{ReadOptions, Source, obj, off, ply as format};
use trisplat_scene::{Asset, Error, ImportedScene, Result};

const OPTIONS: ReadOptions = ReadOptions::with_degree(3);

type Read = fn(Source, &ReadOptions) -> Result<ImportedScene>;

fn soup_bytes(count: usize, degree: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    format::write_soup(&mut bytes, &soup(count, degree, 1), &provenance(), &[]).expect("writes");
    bytes
}

fn mesh_bytes(count: usize, face_colors: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let asset = Asset { mesh: mesh(count, false, true, false), ..Asset::default() };
    format::write_mesh(&mut bytes, &asset, face_colors).expect("writes");
    bytes
}

fn obj_bytes(count: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut mtl = Vec::new();
    let asset = Asset { mesh: mesh(count, false, true, false), ..Asset::default() };
    obj::write(&mut bytes, &mut mtl, "a.mtl", None, &asset).expect("writes");
    bytes
}

fn off_bytes(count: usize) -> Vec<u8> {
    let mesh = mesh(count, true, true, false);
    let mut text = format!("COFF\n{} {count} 0\n", mesh.vertex_count());
    mesh.positions.iter().for_each(|v| text += &format!("{} {} {}\n", v.x, v.y, v.z));
    mesh.indices
        .chunks(3)
        .for_each(|f| text += &format!("3 {} {} {} 9 8 7 255\n", f[0], f[1], f[2]));
    text.into_bytes()
}

/// The error of a file that must fail with one.
fn error(read: Read, bytes: &[u8], what: &str) -> String {
    let result = read(source(bytes), &OPTIONS);
    let error = result.err().unwrap_or_else(|| panic!("{what} was read without complaint"));
    let known =
        matches!(error, Error::Malformed { .. } | Error::Unsupported { .. } | Error::Limit { .. });
    assert!(known, "{what}: {error:?}");
    let message = error.to_string();
    assert!(
        message.starts_with("test: ") && message.len() < 400 && !message.contains('\n'),
        "{message}"
    );
    message
}

#[test]
fn truncated_files_are_errors() {
    let [vertices, faces] = soup_elements(&soup(400, 1, 1));
    let elements = [vertices, faces];
    let files: [(&str, Read, Vec<u8>, Vec<u8>); 6] = [
        ("soup", format::read, soup_bytes(400, 1), soup_bytes(1, 0)),
        ("ascii soup", format::read, ply(Encoding::Ascii, &elements), Vec::new()),
        ("big-endian soup", format::read, ply(Encoding::Big, &elements), Vec::new()),
        ("mesh", format::read, mesh_bytes(1000, false), mesh_bytes(2, true)),
        ("off", off::read, off_bytes(400), Vec::new()),
        ("tiny off", off::read, Vec::new(), off_bytes(1)),
    ];
    for (name, read, long, tiny) in files {
        // Text may lose its last line end, and its last number some digits, and still be whole.
        let slack =
            if name.contains("soup") && !name.contains("ascii") || name == "mesh" { 0 } else { 12 };
        for end in (0..long.len().saturating_sub(slack)).step_by(997) {
            error(read, &long[..end], &format!("{name} cut at {end} of {}", long.len()));
        }
        for end in 0..tiny.len().saturating_sub(slack) {
            error(read, &tiny[..end], &format!("tiny {name} cut at {end}"));
        }
    }
    // An OBJ promises nothing, so it may be whole anywhere; it must only never panic.
    let obj_file = obj_bytes(60);
    for end in 0..obj_file.len() {
        if let Err(e) = obj::read(source(&obj_file[..end]), &OPTIONS) {
            assert!(matches!(e, Error::Malformed { .. }), "{e:?}");
        }
    }
}

#[test]
fn broken_headers_are_refused() {
    let good =
        String::from_utf8(ply(Encoding::Ascii, &soup_elements(&soup(2, 0, 1)))).expect("text");
    let long = "x".repeat(2 << 20);
    let swap = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1)
    };
    let cases = [
        (String::new(), "empty"),
        ("plyer\n".into(), "must start with the line `ply`"),
        ("PK\u{3}\u{4}".into(), "must start with the line `ply`"),
        ("ply\n".into(), "before end_header"),
        ("ply\nformat ascii 1.0\nend_header\n".into(), "no element vertex"),
        (swap("ply\n", "ply \u{0}\n"), "must start"),
        (swap("format ascii 1.0\n", ""), "no format line"),
        (swap("ascii 1.0", "ascii 2.0"), "unknown format"),
        (swap("ascii 1.0", "binary_middle_endian 1.0"), "unknown format"),
        (swap("end_header", "end_of_header"), "cannot make sense"),
        (swap("end_header\n", ""), "is end_header missing"),
        (swap("end_header\n", &format!("comment {long}\nend_header\n")), "1 MiB"),
        (long.clone(), "must start"),
        (swap("element vertex 6", "element vertex 99999999999999999999"), "whole number"),
        (swap("element vertex 6", "element vertex -6"), "whole number"),
        (swap("element vertex 6", "element vertex six"), "whole number"),
        (swap("element vertex 6", "element vertex"), "NAME COUNT"),
        (
            swap("element vertex 6", "property float t\nelement vertex 6"),
            "before the first element",
        ),
        (swap("element face 2", "element vertex 2"), "twice"),
        (swap("element face 2", "element face 0"), "no rows"),
        (swap("element face 2", "element facet 2"), "point cloud"),
        (swap("element face 2", "element tristrips 2"), "strips"),
        (swap("float x", "quaternion x"), "unknown type"),
        (swap("float x", "float"), "expected `property"),
        (swap("float x", "float y"), "twice"),
        (swap("float x", "float u"), "no property x"),
        (swap("float y", &format!("float {long}")), "1 MiB"),
        (swap("list uchar int", "list float int"), "integer type"),
        (swap("list uchar int", "list uchar float"), "integer type"),
        (swap("vertex_indices", "corners"), "vertex_indices"),
        (swap("list uchar int vertex_indices", "int vertex_indices"), "not a number of its type"),
        (swap("float opacity", "float faith"), "opacity"),
        (swap("float f_dc_1", "float f_dc_3"), "f_dc_1"),
        (swap("float f_dc_2", "float f_rest_0"), "0, 9, 24 or 45"),
        (swap("element face", "element a 1\nelement a 2\nelement face"), "twice"),
    ];
    for (text, says) in cases {
        let message = error(format::read, text.as_bytes(), says);
        assert!(message.contains(says), "{message:?} should say {says:?}");
    }
    let many: String = (0..2000).map(|i| format!("property float p{i}\n")).collect();
    assert!(
        error(format::read, swap("property float x\n", &many).as_bytes(), "many").contains("1024")
    );
    let many: String = (0..2000).map(|i| format!("element e{i} 0\n")).collect();
    assert!(
        error(format::read, swap("element vertex", &(many + "element vertex")).as_bytes(), "many")
            .contains("1024")
    );
}

#[test]
fn gaussians_are_refused_with_the_command_that_trains_triangles() {
    let names =
        ["x", "y", "z", "f_dc_0", "opacity", "scale_0", "rot_0"].map(|n| format!("float {n}"));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let gaussians = Element::new("vertex", &names, vec![vec![Cell::F32(0.5); 7]; 9]);
    let message = error(format::read, &ply(Encoding::Little, &[gaussians]), "gaussians");
    assert!(message.contains("Gaussians") && message.contains("trisplat bake"), "{message}");
}

#[test]
fn promises_beyond_the_file_cost_nothing() {
    for encoding in ENCODINGS {
        for rows in ["4000000000", "9223372036854775807", "18446744073709551615"] {
            for element in ["vertex 6", "face 2"] {
                let good = ply(encoding, &soup_elements(&soup(2, 0, 1)));
                let text = String::from_utf8_lossy(&good).into_owned();
                let (name, _) = element.split_once(' ').expect("two words");
                let end = good.windows(11).position(|w| w == b"end_header\n").expect("a header");
                let header = text[..end]
                    .replace(&format!("element {element}"), &format!("element {name} {rows}"));
                let bytes = [header.as_bytes(), &good[end..]].concat();
                error(format::read, &bytes, &format!("{encoding:?} {element} as {rows}"));
            }
        }
    }
    // Rows without properties take no bytes: any number of them is there.
    let huge = "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nelement vertex 0\nend_header\n";
    error(format::read, huge.as_bytes(), "nothing, often");
    for name in ["vertex", "face"] {
        let bare = format!(
            "ply\nformat binary_little_endian 1.0\nelement {name} 18446744073709551615\nend_header\n"
        );
        error(format::read, bare.as_bytes(), "bare rows");
    }
    for counts in
        ["4000000000 1 0", "3 4000000000 0", "18446744073709551615 18446744073709551615 0"]
    {
        let text = format!("OFF\n{counts}\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
        assert!(error(off::read, text.as_bytes(), counts).contains("more than fit"), "{counts}");
    }
}

/// A sparse file: 5 GiB of zeros behind an honest header.
#[test]
fn a_huge_file_of_zeros_is_refused_quickly() {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                  property float z\nelement face 400000000\nproperty list uchar int vertex_indices\nend_header\n";
    let mut sparse = source(header.as_bytes());
    sparse.len = 5 << 30;
    sparse.file.set_len(sparse.len).expect("a sparse file");
    let message = format::read(sparse, &OPTIONS).expect_err("too many").to_string();
    assert!(message.contains("`limit` triangles=400000000"), "{message}");
}

#[test]
fn broken_faces_are_named() {
    let table: [(usize, Cell, &str); 6] = [
        (1, Cell::I32(-1), "-1"),
        (1, Cell::I32(i32::MIN), "-2147483648"),
        (2, Cell::I32(300), "300"),
        (3, Cell::I32(i32::MAX), "2147483647"),
        (0, Cell::U8(2), "has 2 corners"),
        (0, Cell::U8(255), "has 255 corners"),
    ];
    for encoding in ENCODINGS {
        for (cell, value, says) in table {
            let mut elements = soup_elements(&soup(100, 0, 1));
            elements[1].rows[57][cell] = value;
            let message = error(format::read, &ply(encoding, &elements), says);
            assert!(
                message.contains("face 57") && message.contains(says),
                "{encoding:?}: {message}"
            );
            // The same faces in a mesh, where a count of 255 takes the next faces for its corners.
            without_sigma(&mut elements[1]);
            let message = error(format::read, &ply(encoding, &elements), says);
            let polygon = matches!(value, Cell::U8(255));
            assert!(
                polygon || message.contains("face 57") && message.contains(says),
                "{encoding:?}: {message}"
            );
        }
        // Real quads and real lines in a soup: rows of another length. A mesh may have quads.
        for corners in [2u8, 4] {
            let mut elements = soup_elements(&soup(100, 0, 1));
            let list = [vec![Cell::U8(corners)], vec![Cell::I32(1); corners.into()]].concat();
            elements[1].rows[57].splice(0..4, list);
            let message = error(format::read, &ply(encoding, &elements), "polygons");
            assert!(message.contains(&format!("face 57: has {corners} corners")), "{message}");
            without_sigma(&mut elements[1]);
            elements[1].rows[57].remove(usize::from(corners) + 2);
            let bytes = ply(encoding, &elements);
            match corners {
                2 => assert!(
                    error(format::read, &bytes, "line")
                        .contains("face 57: has 2 corners; expected 3")
                ),
                _ => assert!(format::read(source(&bytes), &OPTIONS).is_ok()),
            }
        }
    }
    let corners = "COFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 1 1 1 255\n";
    for (face, says) in [
        ("4 0 1 2 3", "3 vertices"),
        ("4 0 1 2", "fewer than 4"),
        ("4097 0 1 2", "has 4097 corners; the limit is 4096"),
        ("99999999999 0 1 2", "has 99999999999 corners"),
        ("2 0 1", "has 2 corners; expected 3 or more"),
        ("-3 0 1 2", "has -3 corners"),
        ("3 0 1", "fewer than 3"),
        ("3 0 1 3", "3 vertices"),
        ("3 0 1 -1", "\"-1\""),
        ("3 0 1 99999999999", "99999999999"),
        ("3 0 1 x", "\"x\""),
        ("3 0 1 2 5", "1 numbers"),
        ("3 0 1 2 1 2 3 4 5", "more numbers"),
        ("3 0 1 2 1 2 red", "\"red\""),
        ("x", "\"x\""),
    ] {
        let message = error(off::read, format!("{corners}{face}\n").as_bytes(), says);
        assert!(
            message.contains("face 1") && message.contains("line 7") && message.contains(says),
            "{message}"
        );
    }
    for (face, says) in [
        ("1 2 ".repeat(3000).as_str(), "has 6000 corners; the limit is 4096"),
        ("1 2", "has 2 corners; expected 3 or more"),
        ("", "has 0 corners"),
        ("0 1 2", "vertex 0"),
        ("1 2 -4", "vertex -4"),
        ("1 2 x/1", "\"x/1\""),
        ("1 2 9223372036854775808", "expected a vertex number"),
        ("1 2 9999999999", "9999999999"),
        ("1 2 -9223372036854775808", "-9223372036854775808"),
    ] {
        let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf {face}\n");
        let message = error(obj::read, text.as_bytes(), says);
        assert!(
            message.contains("face 1") && message.contains("line 5") && message.contains(says),
            "{message}"
        );
    }
    let message = error(obj::read, b"v 0 0 0\nf 1 1 1\nf 1 2 7\nf 1 1 3\n", "ahead");
    assert!(message.contains("line 3") && message.contains("vertex 7"), "{message}");
}

#[test]
fn broken_text_names_its_line() {
    let corners = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    for (text, says) in [
        (String::new(), "empty"),
        ("# only a comment\n".into(), "empty"),
        ("hello\n".into(), "must start with OFF"),
        ("NOFF\n".into(), "NOFF"),
        ("OFF BINARY\n".into(), "binary OFF"),
        (format!("OFF\nthree 1 0\n{corners}"), "line 2"),
        (format!("OFF\n3\n{corners}"), "two whole numbers"),
        (format!("OFF\n-3 1 0\n{corners}"), "two whole numbers"),
        (format!("OFF\n3 0 0\n{corners}"), "no triangles"),
        (format!("OFF\n3 1 0\n{}", corners.replace("1 0 0", "1 0")), "line 4"),
        (
            format!("OFF\n3 1 0\n{}", corners.replace("1 0 0", "1 0 0 9")),
            "1 numbers for its colour",
        ),
        (format!("OFF\n3 1 0\n{}", corners.replace("1 0 0", "1 zero 0")), "\"zero\""),
        (format!("OFF\n3 1 0\n{}", corners.replace("2\n", "2 300 0 0\n")), "300"),
        (format!("OFF\n3 1 0\n{}", corners.replace("2\n", "2 100.0 20.5 0\n")), "100"),
        (format!("OFF\n3 1 0\n{corners}").replace(' ', &" ".repeat(1 << 17)), "64 KiB"),
    ] {
        let message = error(off::read, text.as_bytes(), says);
        assert!(message.contains(says), "{message:?} should say {says:?}");
    }
    for (text, says) in [
        ("", "no faces"),
        ("v 0 0 0\n", "no faces"),
        ("v 0 0\nf 1 1 1\n", "line 1"),
        ("v 0 0 0 1 1\nf 1 1 1\n", "has 5 numbers"),
        ("v 0 0 0 1 1 1 1 1\nf 1 1 1\n", "more numbers"),
        ("\n\nv 0 0 zero\nf 1 1 1\n", "line 3"),
        ("v 0 0 0 255 128 0\nf 1 1 1\n", "255"),
    ] {
        let message = error(obj::read, text.as_bytes(), says);
        assert!(message.contains(says), "{message:?} should say {says:?}");
    }
}

/// Makes the faces of a soup those of a mesh. Rows that were changed before must lose their σ by
/// hand.
fn without_sigma(faces: &mut Element) {
    let changed = faces.rows[57].len() != faces.rows[56].len();
    faces.properties.retain(|p| !p.ends_with("sigma"));
    for (i, row) in faces.rows.iter_mut().enumerate() {
        if !(changed && i == 57) {
            row.remove(5);
        }
    }
}

const POISON: [f32; 8] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-45, -1e-45, 1e38, -1e38, f32::MIN_POSITIVE];

#[test]
fn every_poison_in_every_field_is_dropped_refused_or_harmless() {
    for encoding in ENCODINGS {
        for poison in POISON {
            for (element, row, cells) in [(0, 4, 0..3), (1, 1, 4..9)] {
                for cell in cells {
                    let mut elements = soup_elements(&soup(3, 0, 1));
                    elements[element].rows[row][cell] = Cell::F32(poison);
                    let name = elements[element].properties
                        [if element == 1 { cell - 3 } else { cell }]
                    .clone();
                    let bytes = ply(encoding, &elements);
                    let range = match &name[6..] {
                        "opacity" => 0.0..=1.0,
                        "sigma" => f32::from_bits(1)..=f32::MAX,
                        _ => f32::MIN..=f32::MAX,
                    };
                    if poison.is_finite() && !range.contains(&poison) {
                        assert!(
                            error(format::read, &bytes, &name).contains("triangle 1"),
                            "{name} {poison}"
                        );
                        continue;
                    }
                    let loaded = format::read(source(&bytes), &OPTIONS)
                        .expect("two valid triangles at least");
                    let left = if poison.is_finite() { 3 } else { 2 };
                    assert_eq!(loaded.scene.triangle_count(), left, "{name} {poison}");
                    assert_eq!(loaded.warnings.len(), 3 - left, "{name} {poison}");
                }
            }
        }
    }
}

#[test]
fn poison_in_text_is_dropped_or_harmless() {
    for poison in POISON.map(|x| x.to_string()).into_iter().chain(["1e99999".into(), "-nan".into()])
    {
        let off = format!("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 {poison} 0\n3 0 1 2\n3 1 2 3\n");
        let obj = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 {poison} 0\nf 1 2 3\nf 2 3 4\n");
        for (read, text) in [(off::read as Read, off), (obj::read, obj)] {
            match read(source(text.as_bytes()), &OPTIONS) {
                Ok(loaded) => {
                    let finite = poison.parse::<f32>().is_ok_and(f32::is_finite);
                    assert_eq!(loaded.scene.triangle_count(), if finite { 2 } else { 1 }, "{text}");
                }
                Err(e) => {
                    assert!(poison == "-nan" && e.to_string().contains("not a number"), "{e}")
                }
            }
        }
    }
}

#[test]
fn raw_checkpoint_values_are_recognised() {
    for (cell, value, says) in
        [(4, -0.3, "sigmoid"), (4, 1.5, "sigmoid"), (5, -4.6, "exp"), (5, 0.0, "exp")]
    {
        let mut elements = soup_elements(&soup(10, 0, 1));
        elements[1].rows[7][cell] = Cell::F32(value);
        let message = error(format::read, &ply(Encoding::Little, &elements), says);
        assert!(message.contains("triangle 7") && message.contains(says), "{message}");
    }
}

proptest! {
    #![proptest_config(trisplat_fixtures::regressions::stored())]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let header = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n".to_vec();
        for read in [format::read as Read, off::read, obj::read] {
            let _ = read(source(&bytes), &OPTIONS);
            let _ = read(source(&[&header[..], &bytes].concat()), &OPTIONS);
        }
    }
}
