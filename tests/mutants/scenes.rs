//! Every reader against mutated files: it fails with a clear error or gives a valid scene, and
//! never panics.

use std::io::{Seek, Write};
use trisplat_fixtures::edits::mutate;
use trisplat_formats::{ReadOptions, Source, obj, off, ply};
use trisplat_scene::{
    Asset, Error, ImportedScene, Result, Scene, Soup,
    mesh::{Colors, Mesh},
};

/// A reader, and a file it reads.
type Row = (&'static str, Vec<u8>, fn(Source, &ReadOptions) -> Result<ImportedScene>);

/// One row for each path a reader may take.
fn table() -> Vec<Row> {
    vec![
        ("soup ply", soup_ply(1), ply::read),
        ("soup ply, ascii", ascii_soup_ply().into_bytes(), ply::read),
        ("soup ply, big-endian", big_endian_soup_ply(), ply::read),
        ("mesh ply", mesh_ply(false), ply::read),
        ("mesh ply, face colors", mesh_ply(true), ply::read),
        ("off", OFF.as_bytes().to_vec(), off::read),
        ("obj", OBJ.as_bytes().to_vec(), obj::read),
        ("obj, as written", written_obj(), obj::read),
        ("obj, polygons", POLYGONS.as_bytes().to_vec(), obj::read),
        ("mesh ply, polygons", polygon_ply(), ply::read),
    ]
}

const OFF: &str =
    "COFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0.5\n3 0 1 2 255 0 10 255\n3 2 1 3 1 2 3 102\n";
const OBJ: &str = "# a square\nmtllib a.mtl\no square\nv 0 0 0 0.5 0.2 1\nv 1 0 0 0 0 1\nv 0 1 0 1 1 1\n\
                   v 1 1 0 0 0 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2//1 3\nf -1 -2 -3\nl 1 2\n";

/// A concave polygon, a square and a triangle.
const POLYGONS: &str =
    "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 3 5\nf 3 4 5\n";

/// The same as PLY, with a colour per face.
fn polygon_ply() -> Vec<u8> {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\nelement vertex 5\n");
    ["x", "y", "z"].iter().for_each(|axis| text += &format!("property float {axis}\n"));
    text += "element face 3\nproperty list uchar ushort vertex_index\n";
    ["red", "green", "blue"]
        .iter()
        .for_each(|channel| text += &format!("property uchar {channel}\n"));
    let mut bytes = (text + "end_header\n").into_bytes();
    for x in [[0f32, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [1.0, 0.5, 0.0], [0.0, 2.0, 0.0]]
        .as_flattened()
    {
        bytes.extend(x.to_le_bytes());
    }
    for corners in [&[0u16, 1, 2, 3, 4][..], &[0, 1, 2, 4], &[2, 3, 4]] {
        bytes.push(corners.len() as u8);
        corners.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend([9, 80, 255]);
    }
    bytes
}

fn soup(degree: u8) -> Soup {
    let k = (degree as usize + 1).pow(2);
    Soup {
        vertices: (0..3)
            .map(|i| [0, 1, 2].map(|c| glam::Vec3::new(i as f32, c as f32, 0.5)))
            .collect(),
        opacity: vec![0.25, 0.5, 1.0],
        sigma: vec![0.01, 1.16, 3.0],
        sh: (0..3 * k).map(|i| [i as f32 * 0.1, -0.2, 1.0]).collect(),
        sh_degree: degree,
        ..Soup::default()
    }
}

fn soup_ply(degree: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    ply::write_soup(&mut bytes, &soup(degree), &Default::default(), &[]).expect("writes to memory");
    bytes
}

fn ascii_soup_ply() -> String {
    let mut text = String::from("ply\nformat ascii 1.0\nelement vertex 4\n");
    text +=
        "property float x\nproperty float y\nproperty double z\nelement edge 1\nproperty int a\n";
    text += "property list uchar int b\nelement face 2\nproperty list uchar int vertex_indices\n";
    for name in ["opacity", "sigma", "f_dc_0", "f_dc_1", "f_dc_2"] {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n0 0 0\n1 0 0\n0 1 0\n1 1 1e-3\n7 2 1 0\n";
    text + "3 0 1 2 0.5 1 0.1 0.2 0.3\n3 3 2 1 1 0.01 -0.1 0 2\n"
}

/// The ascii soup's header over big-endian rows.
fn big_endian_soup_ply() -> Vec<u8> {
    let ascii = ascii_soup_ply();
    let (header, _) = ascii.split_once("end_header\n").expect("a header");
    let mut bytes = (header.replace("ascii", "binary_big_endian") + "end_header\n").into_bytes();
    for [x, y] in [[0f32, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
        bytes.extend([x.to_be_bytes(), y.to_be_bytes()].concat());
        bytes.extend(0.5f64.to_be_bytes());
    }
    bytes.extend([0, 0, 0, 7, 2, 0, 0, 0, 1, 0, 0, 0, 0]);
    for corners in [[0i32, 1, 2], [3, 2, 1]] {
        bytes.push(3);
        corners.iter().for_each(|c| bytes.extend(c.to_be_bytes()));
        [0.5f32, 1.0, 0.1, 0.2, 0.3].iter().for_each(|x| bytes.extend(x.to_be_bytes()));
    }
    bytes
}

fn square() -> Asset {
    let mesh = Mesh {
        positions: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
            .map(|[x, y]| glam::Vec3::new(x, y, 0.0))
            .to_vec(),
        colors: Colors::Vertex(vec![[0.0, 0.5, 1.0], [0.1; 3], [0.2; 3], [0.3; 3]]),
        indices: vec![0, 1, 2, 2, 1, 3],
        opacity: vec![],
        ..Mesh::default()
    };
    Asset { mesh, ..Asset::default() }
}

fn mesh_ply(face_colors: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    ply::write_mesh(&mut bytes, &square(), face_colors).expect("writes to memory");
    bytes
}

fn written_obj() -> Vec<u8> {
    let mut bytes = Vec::new();
    obj::write(&mut bytes, &mut Vec::new(), "a.mtl", None, &square()).expect("writes to memory");
    bytes
}

fn read_bytes(row: &Row, bytes: &[u8], sh_degree: u8) -> Result<ImportedScene> {
    let mut file = tempfile::tempfile().expect("a temporary file");
    file.write_all(bytes).and_then(|()| file.rewind()).expect("writable");
    let source = Source { path: "mutant".into(), file: file.into(), len: bytes.len() as u64 };
    row.2(source, &ReadOptions::with_degree(sh_degree))
}

/// Reads the file and checks what came of it.
fn survive(row: &Row, bytes: &[u8], sh_degree: u8) {
    let name = row.0;
    match read_bytes(row, bytes, sh_degree) {
        Ok(ImportedScene { scene, .. }) => {
            let proof = match &scene {
                Scene::Soup(soup) => soup.validate(),
                Scene::Mesh(mesh) => mesh.validate(),
            };
            assert!(proof.is_ok() && scene.triangle_count() > 0, "{name}: {proof:?}");
        }
        Err(
            error @ (Error::Malformed { .. } | Error::Unsupported { .. } | Error::Limit { .. }),
        ) => {
            let message = error.to_string();
            assert!(message.starts_with("mutant: ") && message.len() < 500, "{name}: {message}");
        }
        Err(error) => panic!("{name}: {error:?}"),
    }
}

#[test]
fn the_seeds_are_valid() {
    for (name, bytes, read) in table() {
        let mut file = tempfile::tempfile().expect("a temporary file");
        file.write_all(&bytes).and_then(|()| file.rewind()).expect("writable");
        let source = Source { path: name.into(), file: file.into(), len: bytes.len() as u64 };
        let loaded = read(source, &ReadOptions::with_degree(3));
        assert!(loaded.is_ok(), "{name}: {loaded:?}");
    }
}

/// A thousand mutants of each file: ten thousand.
#[test]
fn mutants_never_panic() {
    for row in table() {
        mutate(row.0, &row.1, 1000, |bytes| survive(&row, bytes, bytes.len() as u8 % 4));
    }
}

/// What a reader lets through is baked: most failures were there.
#[test]
fn mutants_that_are_read_are_baked_or_refused() {
    for row in table() {
        mutate(row.0, &row.1, 100, |bytes| {
            let Ok(loaded) = read_bytes(&row, bytes, 3) else { return };
            match trisplat::bake(loaded, &trisplat::BakeOptions::default()) {
                Ok(baked) => {
                    let mesh = baked.asset.mesh;
                    let proof = mesh.validate();
                    assert!(proof.is_ok() && mesh.face_count() > 0, "{}: {proof:?}", row.0);
                }
                Err(error) => assert!(error.to_string().len() < 1000, "{}: {error}", row.0),
            }
        });
    }
}
