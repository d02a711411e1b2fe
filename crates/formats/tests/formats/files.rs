//! Files for the tests: scenes with known values, and a PLY writer that knows every encoding.

use glam::Vec3;
use std::io::{Seek, Write};
use trisplat_formats::Source;
use trisplat_scene::{
    ImportedScene, Placement, Provenance, Result, Rng, Scene, Soup, UpAxis,
    math::color::linear_from_srgb,
    mesh::{Colors, Mesh},
};

/// `bytes` as an open file called "test".
pub(crate) fn source(bytes: &[u8]) -> Source {
    let mut file = tempfile::tempfile().expect("a temporary file");
    file.write_all(bytes).and_then(|()| file.rewind()).expect("writable");
    Source { path: "test".into(), file: file.into(), len: bytes.len() as u64 }
}

/// A file of the shared folder, or nothing (and a message) where there is none.
pub(crate) fn shared(name: &str) -> Option<Source> {
    let path = trisplat_fixtures::root().join("../shared/soups").join(name);
    if !path.exists() {
        trisplat_fixtures::skip::skipped(&format!("no ../shared/soups/{name}"));
        return None;
    }
    Some(Source::open(&path, &trisplat_scene::Limits::DEFAULT).expect("readable"))
}

/// A random soup with valid values.
pub(crate) fn soup(count: usize, sh_degree: u8, seed: u64) -> Soup {
    let k = (sh_degree as usize + 1).pow(2);
    let place = Rng::new(seed, "place", 0);
    let shade = Rng::new(seed, "shade", 0);
    let corner = |i: usize| Vec3::from([0, 1, 2].map(|a| place.normal((3 * i + a) as u64)));
    Soup {
        vertices: (0..count).map(|i| [0, 1, 2].map(|c| corner(3 * i + c))).collect(),
        opacity: (0..count).map(|i| shade.uniform(4 * i as u64)).collect(),
        sigma: (0..count).map(|i| 0.01 + 3.0 * shade.uniform(4 * i as u64 + 1)).collect(),
        sh: (0..count * k).map(|i| [0, 1, 2].map(|c| place.normal((9 * i + c) as u64))).collect(),
        sh_degree,
        ..Soup::default()
    }
}

/// Provenance with a value in every field.
pub(crate) fn provenance() -> Provenance {
    Provenance {
        generator: Some("trisplat 0.1.0".into()),
        source: Some("a room, \"zweiter\" Versuch.pt".into()),
        trainer: Some("triangle-splatting".into()),
        up: Some(UpAxis::NegY),
        usual_up: None,
        placement: Placement {
            up: UpAxis::Z.into(),
            rotate: 0.0,
            scale: 0.1,
            center: [1.0 / 3.0, -2e-9, 7e20],
        },
        viewpoint: Some(trisplat_fixtures::VIEWPOINT),
        backdrop_faces: 0,
        exposure: Some([0.5, 0.0, 1.0]),
        cameras: vec![[0.1, -20.5, 3.0, 0.25, -0.5, 0.125, 0.6, 0.4]],
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Encoding {
    Ascii,
    Little,
    Big,
}

pub(crate) const ENCODINGS: [Encoding; 3] = [Encoding::Ascii, Encoding::Little, Encoding::Big];

/// One number of a PLY row.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Cell {
    U8(u8),
    I8(i8),
    U16(u16),
    I32(i32),
    U32(u32),
    F32(f32),
    F64(f64),
}

impl Cell {
    fn push(self, encoding: Encoding, out: &mut Vec<u8>) {
        macro_rules! number {
            ($x:expr) => {
                match encoding {
                    Encoding::Ascii => out.extend_from_slice(format!("{} ", $x).as_bytes()),
                    Encoding::Little => out.extend_from_slice(&$x.to_le_bytes()),
                    Encoding::Big => out.extend_from_slice(&$x.to_be_bytes()),
                }
            };
        }
        match self {
            Cell::U8(x) => number!(x),
            Cell::I8(x) => number!(x),
            Cell::U16(x) => number!(x),
            Cell::I32(x) => number!(x),
            Cell::U32(x) => number!(x),
            Cell::F32(x) => number!(x),
            Cell::F64(x) => number!(x),
        }
    }
}

/// An element: name, properties as the header spells them, rows.
pub(crate) struct Element {
    pub(crate) name: &'static str,
    pub(crate) properties: Vec<String>,
    pub(crate) rows: Vec<Vec<Cell>>,
}

impl Element {
    pub(crate) fn new(name: &'static str, properties: &[&str], rows: Vec<Vec<Cell>>) -> Self {
        Self { name, properties: properties.iter().map(|p| (*p).to_owned()).collect(), rows }
    }
}

/// A whole PLY file, built by other code than the one under test.
pub(crate) fn ply(encoding: Encoding, elements: &[Element]) -> Vec<u8> {
    let format = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let mut out = format!("ply\nformat {format} 1.0\n");
    for element in elements {
        out += &format!("element {} {}\n", element.name, element.rows.len());
        for property in &element.properties {
            out += &format!("property {property}\n");
        }
    }
    let mut out = (out + "end_header\n").into_bytes();
    for row in elements.iter().flat_map(|e| &e.rows) {
        row.iter().for_each(|cell| cell.push(encoding, &mut out));
        if encoding == Encoding::Ascii {
            out.push(b'\n');
        }
    }
    out
}

/// `soup` as the elements vertex and face of a soup PLY.
pub(crate) fn soup_elements(soup: &Soup) -> [Element; 2] {
    let k = soup.sh_count();
    let floats = |values: &[f32]| values.iter().map(|x| Cell::F32(*x)).collect::<Vec<_>>();
    let vertices = soup.vertices.iter().flatten().map(|v| floats(&v.to_array())).collect();
    let face = |i: usize| {
        let sh = &soup.sh[i * k..(i + 1) * k];
        let mut row = vec![Cell::U8(3)];
        row.extend((0..3).map(|c| Cell::I32((3 * i + c) as i32)));
        row.extend(floats(&[soup.opacity[i], soup.sigma[i]]));
        row.extend(floats(&sh[0]));
        row.extend((0..3).flat_map(|c| sh[1..].iter().map(move |s| Cell::F32(s[c]))));
        row
    };
    let mut names = vec!["list uchar int vertex_indices".to_owned()];
    names.extend(["opacity", "sigma", "f_dc_0", "f_dc_1", "f_dc_2"].map(|n| format!("float {n}")));
    names.extend((0..3 * (k - 1)).map(|i| format!("float f_rest_{i}")));
    [
        Element::new("vertex", &["float x", "float y", "float z"], vertices),
        Element { name: "face", properties: names, rows: (0..soup.len()).map(face).collect() },
    ]
}

/// A strip of triangles that share vertices, with distinct 8-bit colours, linear as a mesh has
/// them.
pub(crate) fn mesh(faces: usize, per_face: bool, indexed: bool, opacity: bool) -> Mesh {
    let random = Rng::new(faces as u64, "mesh", 0);
    let count = if indexed { faces + 2 } else { 3 * faces };
    let axis = |v: usize, a: usize| random.normal((3 * v + a) as u64);
    let code = |i: usize, c: usize| random.bits((3 * i + c) as u64 + 7_000_000) as u8;
    let color = |i: usize| [0, 1, 2].map(|c| linear_from_srgb(f32::from(code(i, c)) / 255.0));
    Mesh {
        positions: (0..count).map(|v| Vec3::from([0, 1, 2].map(|a| axis(v, a)))).collect(),
        colors: if per_face {
            Colors::Face((0..faces).map(color).collect())
        } else {
            Colors::Vertex((0..count).map(color).collect())
        },
        indices: if indexed {
            (0..faces as u32).flat_map(|f| [f + 1, f, f + 2]).collect()
        } else {
            vec![]
        },
        opacity: if opacity {
            (0..faces).map(|f| f32::from(code(f, 9)) / 255.0).collect()
        } else {
            vec![]
        },
        ..Mesh::default()
    }
}

/// Visible properties of a face: corners, linear colours, opacity.
pub(crate) fn face(mesh: &Mesh, face: usize) -> ([Vec3; 3], [[f32; 3]; 3], f32) {
    (mesh.corners(face), mesh.corner_colors(face), mesh.opacity.get(face).copied().unwrap_or(1.0))
}

/// The mesh that was read, and its warnings.
pub(crate) fn loaded_mesh(loaded: Result<ImportedScene>) -> (Mesh, Provenance, Vec<String>) {
    match loaded.expect("a valid file") {
        ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, .. } => {
            (mesh, provenance, warnings)
        }
        other => panic!("{other:?}"),
    }
}
