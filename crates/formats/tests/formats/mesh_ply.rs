//! Mesh PLY.

use super::files::{
    Cell, ENCODINGS, Element, Encoding, face, loaded_mesh, mesh, ply, provenance, source,
};
use glam::Vec3;
use trisplat_formats::{
    ReadOptions,
    ply::{read, write_mesh},
};
use trisplat_scene::{
    Asset,
    math::color::linear_from_srgb,
    mesh::{Colors, Mesh},
};

const OPTIONS: ReadOptions = ReadOptions::with_degree(0);

fn written(mesh: &Mesh, face_colors: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let asset = Asset { mesh: mesh.clone(), provenance: provenance(), ..Asset::default() };
    write_mesh(&mut bytes, &asset, face_colors).expect("writes to memory");
    bytes
}

#[test]
fn every_kind_of_mesh_reads_back_as_it_looked() {
    for count in [1, 20_000] {
        for flags in 0..16 {
            let [per_face, indexed, opacity, face_colors] =
                [1, 2, 4, 8].map(|bit| flags & bit != 0);
            let before = mesh(count, per_face, indexed, opacity);
            let bytes = written(&before, face_colors);
            let (after, back, warnings) = loaded_mesh(read(source(&bytes), &OPTIONS));
            assert_eq!((after.face_count(), &warnings[..]), (count, &[][..]));
            assert_eq!(back, provenance());
            for i in 0..count {
                let (corners, colors, alpha) = face(&before, i);
                let after = face(&after, i);
                assert_eq!((corners, alpha), (after.0, after.2), "face {i}, {flags:04b}");
                if per_face || !face_colors {
                    assert_eq!(colors, after.1, "face {i}, {flags:04b}");
                }
            }
            assert_eq!(matches!(after.colors, Colors::Face(_)), face_colors);
            let own = !indexed || !face_colors && (per_face || opacity);
            assert_eq!(
                after.vertex_count(),
                if own { 3 * count } else { count + 2 },
                "{flags:04b}"
            );
            assert_eq!(after.indices.is_empty(), own, "{flags:04b}");
        }
    }
}

#[test]
fn different_corner_colors_become_their_mean_at_the_face() {
    let gradient = Mesh {
        positions: vec![Vec3::X, Vec3::Y, Vec3::Z],
        colors: Colors::Vertex(vec![[0.0, 0.3, 1.0], [0.0, 0.6, 1.0], [0.75, 0.9, 1.0]]),
        ..Mesh::default()
    };
    let (mesh, ..) = loaded_mesh(read(source(&written(&gradient, true)), &OPTIONS));
    let [[r, g, b], ..] = mesh.corner_colors(0);
    assert!((r - 0.25).abs() < 0.005 && (g - 0.6).abs() < 0.005 && b == 1.0, "{r} {g} {b}");
}

/// A triangle whose color properties are given.
fn triangle(at_vertex: &[&str], vertex: &[Cell], at_face: &[&str], face: &[Cell]) -> [Element; 2] {
    let corner =
        |x: f32, y: f32| [&[Cell::F32(x), Cell::F32(y), Cell::F32(0.0)][..], vertex].concat();
    let vertices = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)];
    let mut faces =
        vec![[&[Cell::U8(3), Cell::U32(0), Cell::U32(1), Cell::U32(2)][..], face].concat()];
    faces.push(faces[0].clone());
    [
        Element::new(
            "vertex",
            &[&["float x", "float y", "float z"][..], at_vertex].concat(),
            vertices,
        ),
        Element::new("face", &[&["list uchar uint vertex_index"][..], at_face].concat(), faces),
    ]
}

#[test]
fn colors_of_every_type_and_name_are_understood() {
    let code = [0u8, 51, 255];
    let wanted = code.map(|c| linear_from_srgb(f32::from(c) / 255.0));
    type Spell = fn(u8) -> Cell;
    let kinds: [(&str, Spell); 4] = [
        ("uchar", Cell::U8),
        ("ushort", |c| Cell::U16(u16::from(c) * 257)),
        ("float", |c| Cell::F32(f32::from(c) / 255.0)),
        ("double", |c| Cell::F64(f64::from(c) / 255.0)),
    ];
    let names = [["red", "green", "blue", "alpha"], ["r", "g", "b", "a"]];
    let names = names.into_iter().chain([[
        "diffuse_red",
        "diffuse_green",
        "diffuse_blue",
        "diffuse_alpha",
    ]]);
    for (names, (kind, cell)) in names.flat_map(|n| kinds.map(|k| (n, k))) {
        for encoding in ENCODINGS {
            for (with_alpha, at_face) in
                [(false, false), (false, true), (true, false), (true, true)]
            {
                let count = if with_alpha { 4 } else { 3 };
                let properties =
                    names[..count].iter().map(|n| format!("{kind} {n}")).collect::<Vec<_>>();
                let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
                let cells: Vec<Cell> =
                    code.into_iter().chain([102]).take(count).map(cell).collect();
                let elements = if at_face {
                    triangle(&[], &[], &properties, &cells)
                } else {
                    triangle(&properties, &cells, &[], &[])
                };
                let (mesh, _, warnings) =
                    loaded_mesh(read(source(&ply(encoding, &elements)), &OPTIONS));
                assert_eq!(warnings, [""; 0]);
                for (got, wanted) in mesh.corner_colors(1).concat().iter().zip([wanted; 3].concat())
                {
                    assert!((got - wanted).abs() < 1e-6, "{kind} {names:?}: {got} for {wanted}");
                }
                assert_eq!(mesh.opacity.len(), if with_alpha { 2 } else { 0 });
                assert!(mesh.opacity.iter().all(|a| (a - 0.4).abs() < 1e-6), "{:?}", mesh.opacity);
            }
        }
    }
}

#[test]
fn a_face_is_as_opaque_as_its_most_opaque_corner() {
    let mut elements = triangle(
        &["uchar red", "uchar green", "uchar blue", "uchar alpha"],
        &[Cell::U8(1), Cell::U8(2), Cell::U8(3), Cell::U8(255)],
        &[],
        &[],
    );
    elements[0].rows.iter_mut().for_each(|row| row[6] = Cell::U8(51));
    elements[0].rows[1][6] = Cell::U8(102);
    let (mesh, ..) = loaded_mesh(read(source(&ply(Encoding::Little, &elements)), &OPTIONS));
    assert_eq!(mesh.opacity, [0.4, 0.4]);
    assert_eq!(mesh.indices, [0, 1, 2, 0, 1, 2]);
}

#[test]
fn guesses_are_warnings() {
    let red = ["float red", "float green", "float blue"];
    let mild = [Cell::F32(1.25), Cell::F32(-0.1), Cell::F32(0.5)];
    let cases: [([Element; 2], &str, [f32; 3]); 3] = [
        (triangle(&[], &[], &[], &[]), "white", [1.0; 3]),
        (triangle(&red, &mild, &[], &[]), "clamped", [1.0, 0.0, linear_from_srgb(0.5)]),
        (triangle(&red, &[Cell::F32(0.0); 3], &red, &[Cell::F32(1.0); 3]), "both", [0.0; 3]),
    ];
    for (elements, says, color) in cases {
        let (mesh, _, warnings) =
            loaded_mesh(read(source(&ply(Encoding::Little, &elements)), &OPTIONS));
        assert!(warnings.len() == 1 && warnings[0].contains(says), "{warnings:?}");
        assert_eq!(mesh.corner_colors(1), [color; 3]);
    }
}

/// Four corners of a square and a fifth inside it; a triangle, an arrowhead (concave at the fifth
/// corner), a triangle, a square.
fn polygons(at_vertex: &[(&str, Cell)], at_face: &[&str], colors: &[[u8; 4]; 4]) -> [Element; 2] {
    let place = |x: f32, y: f32| {
        [x, y, 0.0].map(Cell::F32).into_iter().chain(at_vertex.iter().map(|(_, c)| *c)).collect()
    };
    let vertices =
        [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 0.5)].map(|(x, y)| place(x, y));
    let names: Vec<&str> = ["float x", "float y", "float z"]
        .into_iter()
        .chain(at_vertex.iter().map(|v| v.0))
        .collect();
    let corners: [&[i32]; 4] = [&[0, 1, 2], &[0, 4, 1, 2, 3], &[0, 1, 3], &[0, 1, 2, 3]];
    let row = |(corners, color): (&&[i32], &[u8; 4])| {
        let list = std::iter::once(Cell::U8(corners.len() as u8))
            .chain(corners.iter().map(|c| Cell::I32(*c)));
        let color = color.iter().take(at_face.len()).map(|c| Cell::U8(*c));
        list.chain(color).collect::<Vec<Cell>>()
    };
    let rows = corners.iter().zip(colors).map(row).collect();
    let properties = [&["list uchar int vertex_indices"], at_face].concat();
    [Element::new("vertex", &names, vertices.to_vec()), Element::new("face", &properties, rows)]
}

#[test]
fn polygons_become_triangles_with_the_colors_of_their_face() {
    let colors = [[0, 0, 0, 255], [51, 102, 153, 51], [255, 0, 0, 255], [7, 8, 9, 102]];
    let linear = |c: [u8; 4]| [0, 1, 2].map(|i| linear_from_srgb(f32::from(c[i]) / 255.0));
    for encoding in ENCODINGS {
        let at_face = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
        let mut elements = polygons(&[], &at_face, &colors);
        for flipped in [false, true] {
            if flipped {
                elements.reverse();
            }
            let (mesh, _, warnings) =
                loaded_mesh(read(source(&ply(encoding, &elements)), &OPTIONS));
            assert_eq!((mesh.face_count(), warnings.len()), (7, 0), "{encoding:?}");
            let of_face = [0, 1, 1, 1, 2, 3, 3];
            for (triangle, face) in of_face.into_iter().enumerate() {
                assert_eq!(
                    mesh.corner_colors(triangle)[0],
                    linear(colors[face]),
                    "{encoding:?}: {triangle}"
                );
                assert_eq!(mesh.opacity[triangle], f32::from(colors[face][3]) / 255.0);
            }
            let doubled: Vec<f32> = (0..7)
                .map(|face| {
                    let [a, b, c] = mesh.corners(face);
                    (b - a).cross(c - a).z
                })
                .collect();
            assert!(doubled.iter().all(|area| *area > 0.0), "{doubled:?}");
            assert_eq!(
                [doubled[1..4].iter().sum::<f32>(), doubled[5] + doubled[6]],
                [7.0, 8.0],
                "{doubled:?}"
            );
        }
    }
}

#[test]
fn polygons_share_the_colors_of_their_vertices() {
    let red =
        [("uchar red", Cell::U8(255)), ("uchar green", Cell::U8(0)), ("uchar blue", Cell::U8(0))];
    for encoding in ENCODINGS {
        let (mesh, ..) =
            loaded_mesh(read(source(&ply(encoding, &polygons(&red, &[], &[[0; 4]; 4]))), &OPTIONS));
        assert_eq!(
            (mesh.face_count(), mesh.vertex_count(), mesh.opacity.len()),
            (7, 5, 0),
            "{encoding:?}"
        );
        assert_eq!(mesh.corner_colors(6), [[1.0, 0.0, 0.0]; 3]);
    }
}

#[test]
fn damaged_polygons_are_named() {
    for encoding in ENCODINGS {
        let mut elements = polygons(&[], &[], &[[0; 4]; 4]);
        elements[1].rows[1][4] = Cell::I32(5);
        let message =
            read(source(&ply(encoding, &elements)), &OPTIONS).expect_err("no vertex 5").to_string();
        assert!(
            message.contains("face 1: names vertex 5, but there are 5 vertices"),
            "{encoding:?}: {message}"
        );
        let whole = ply(encoding, &polygons(&[], &[], &[[0; 4]; 4]));
        for end in (0..whole.len() - 4).rev() {
            assert!(read(source(&whole[..end]), &OPTIONS).is_err(), "{encoding:?} cut at {end}");
        }
    }
}
