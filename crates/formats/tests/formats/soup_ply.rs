//! The soup PLY.

use super::files::{
    Cell, ENCODINGS, Element, Encoding, ply, provenance, soup, soup_elements, source,
};
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_formats::{
    ReadOptions, Source,
    ply::{read, write_soup},
};
use trisplat_scene::{ImportedScene, Provenance, Scene, Soup, camera::Camera};

fn written(soup: &Soup, provenance: &Provenance) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_soup(&mut bytes, soup, provenance, &[]).expect("writes to memory");
    bytes
}

fn read_soup(source: Source, sh_degree: u8) -> Soup {
    match read(source, &ReadOptions::with_degree(sh_degree)).expect("a valid file") {
        ImportedScene { scene: Scene::Soup(soup), warnings, .. } if warnings.is_empty() => soup,
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_degree_reads_back_bit_equal() {
    for degree in 0..=3 {
        // Enough for several blocks, and not a whole number of them.
        for count in [1, 2, 12_345] {
            let soup = soup(count, degree, 7);
            let bytes = written(&soup, &Provenance::default());
            assert_eq!(read_soup(source(&bytes), 3), soup, "degree {degree}, {count} triangles");
            for lower in 0..degree {
                let mut cut = soup.clone();
                cut.truncate_sh(lower);
                assert_eq!(
                    read_soup(source(&bytes), lower),
                    cut,
                    "degree {degree} read up to {lower}"
                );
            }
        }
    }
}

#[test]
fn the_shell_reads_back_wherever_it_is_in_the_file() {
    let mut soup = soup(12_345, 1, 7);
    soup.set_shell(5000..5400);
    let bytes = written(&soup, &provenance());
    assert_eq!(read_soup(source(&bytes), 3), soup);
    soup.shell.clear();
    let plain = written(&soup, &provenance());
    assert!(bytes.len() > plain.len() + 12_345, "a soup without one has no property for it");
}

#[test]
fn provenance_reads_back_equal() {
    let bytes = written(&soup(3, 0, 1), &provenance());
    let loaded = read(source(&bytes), &ReadOptions::with_degree(0)).expect("valid");
    assert_eq!(loaded.provenance, provenance());
}

#[test]
fn cameras_read_back_bit_equal() {
    let camera = |i: usize| Camera {
        rotation: Mat3::from_rotation_x(0.3 * i as f32) * Mat3::from_rotation_z(1.1),
        translation: Vec3::new(0.1, -2.0, i as f32 / 3.0),
        focal: Vec2::new(400.3, 410.7),
        center: Vec2::new(330.1, 220.9),
        size: UVec2::new(640, 480 + i as u32),
    };
    let cameras: Vec<Camera> = (0..20_000).map(camera).collect();
    let soup = soup(100, 1, 3);
    let mut bytes = Vec::new();
    write_soup(&mut bytes, &soup, &provenance(), &cameras).expect("writes to memory");
    let loaded = read(source(&bytes), &ReadOptions::with_degree(3)).expect("valid");
    assert_eq!((loaded.scene, loaded.provenance), (Scene::Soup(soup), provenance()));
    assert_eq!(loaded.cameras, cameras);

    let cut = read(source(&bytes[..bytes.len() - 1]), &ReadOptions::with_degree(3)).unwrap_err();
    assert!(cut.to_string().contains("view"), "{cut}");
    let end = bytes.len() - 20_000 * 72;
    bytes[end + 72 + 48..end + 72 + 52].copy_from_slice(&f32::NAN.to_le_bytes());
    let broken = read(source(&bytes), &ReadOptions::with_degree(3)).unwrap_err().to_string();
    assert!(broken.contains("view 1") && broken.contains("no camera"), "{broken}");
}

#[test]
fn the_writer_agrees_with_an_independent_one() {
    let soup = soup(100, 2, 3);
    let mut elements = soup_elements(&soup);
    elements[1].properties.extend(["red", "green", "blue"].map(|c| format!("uchar {c}")));
    for (i, row) in elements[1].rows.iter_mut().enumerate() {
        row.extend(soup.rgb(i).map(|x| Cell::U8((x * 255.0).round().clamp(0.0, 255.0) as u8)));
    }
    let ours = String::from_utf8_lossy(&written(&soup, &Provenance::default()))
        .replace("comment trisplat soup 1\n", "");
    assert_eq!(ours, String::from_utf8_lossy(&ply(Encoding::Little, &elements)));
}

#[test]
fn every_encoding_gives_the_same_soup() {
    for degree in 0..=3 {
        let soup = soup(333, degree, 5);
        for encoding in ENCODINGS {
            let bytes = ply(encoding, &soup_elements(&soup));
            assert_eq!(read_soup(source(&bytes), 3), soup, "{encoding:?}, degree {degree}");
        }
    }
}

#[test]
fn order_types_and_unknown_properties_do_not_matter() {
    let soup = soup(50, 1, 9);
    for encoding in ENCODINGS {
        let [mut vertices, mut faces] = soup_elements(&soup);
        // Properties back to front, strangers in between, lists of all lengths, doubles for floats.
        for element in [&mut vertices, &mut faces] {
            let lists = usize::from(element.name == "face");
            element.properties.reverse();
            element.properties.insert(1, "char flags".into());
            element.properties.push("list ushort double texcoord".into());
            for (i, row) in element.rows.iter_mut().enumerate() {
                let list: Vec<Cell> = row.drain(..4 * lists).collect();
                row.reverse();
                row.extend(list);
                row.insert(1, Cell::I8(-7));
                row.push(Cell::U16((i % 4) as u16));
                row.extend((0..i % 4).map(|x| Cell::F64(x as f64)));
            }
        }
        faces.properties[2] = faces.properties[2].replace("float", "double");
        for row in &mut faces.rows {
            let Cell::F32(x) = row[2] else { panic!("a float stands there") };
            row[2] = Cell::F64(x.into());
        }
        let rows = (0..20).map(|i| vec![Cell::U8(i), Cell::U32(9)]).collect();
        let camera = Element::new("camera", &["uchar a", "uint b"], rows);
        let rows =
            (0..3).map(|i| [vec![Cell::U8(i)], vec![Cell::U32(1); i as usize]].concat()).collect();
        let strips = Element::new("edges", &["list uchar uint vertex_indices"], rows);
        let empty = Element::new("nothing", &[], vec![Vec::new(); 5]);
        let bytes = ply(encoding, &[camera, empty, faces, strips, vertices]);
        assert_eq!(read_soup(source(&bytes), 1), soup, "{encoding:?}");
    }
}

#[test]
fn shared_and_shuffled_vertices_are_unshared() {
    let mut soup = soup(200, 0, 11);
    let [vertices, mut faces] = soup_elements(&soup);
    for (i, row) in faces.rows.iter_mut().enumerate() {
        for c in 0..3 {
            let pick = (7 * i + 91 * c) % vertices.rows.len();
            row[1 + c] = Cell::I32(pick as i32);
        }
    }
    let old = soup.vertices.clone();
    for (i, corners) in soup.vertices.iter_mut().enumerate() {
        for (c, corner) in corners.iter_mut().enumerate() {
            let pick = (7 * i + 91 * c) % (3 * old.len());
            *corner = old[pick / 3][pick % 3];
        }
    }
    for encoding in ENCODINGS {
        let elements = [
            Element {
                name: "vertex",
                properties: vertices.properties.clone(),
                rows: vertices.rows.clone(),
            },
            Element {
                name: "face",
                properties: faces.properties.clone(),
                rows: faces.rows.clone(),
            },
        ];
        assert_eq!(read_soup(source(&ply(encoding, &elements)), 0), soup, "{encoding:?}");
    }
    // Two faces over four vertices: fewer vertices than corners.
    let mut elements = soup_elements(&super::files::soup(2, 0, 1));
    elements[0].rows.truncate(4);
    for (c, v) in [0, 1, 2, 2, 1, 3].into_iter().enumerate() {
        elements[1].rows[c / 3][1 + c % 3] = Cell::I32(v);
    }
    let two = read_soup(source(&ply(Encoding::Little, &elements)), 0);
    assert_eq!(two.vertices[0][1..], [two.vertices[1][1], two.vertices[1][0]]);
}

#[test]
fn line_ends_of_any_system_and_obj_info_are_fine() {
    let soup = soup(4, 0, 2);
    for encoding in ENCODINGS {
        let bytes = ply(encoding, &soup_elements(&soup));
        let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        let header = String::from_utf8_lossy(&bytes[..end])
            .replace("element vertex", "obj_info x\n\nelement vertex");
        let crlf = [header.replace('\n', "\r\n").as_bytes(), &bytes[end..]].concat();
        assert_eq!(read_soup(source(&crlf), 0), soup, "{encoding:?}");
    }
}
