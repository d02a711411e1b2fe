//! Wavefront OBJ, with the crate `tobj` as the judge.

use super::files::{face, loaded_mesh, mesh, provenance, source};
use proptest::prelude::*;
use trisplat_formats::{
    ReadOptions,
    obj::{read, write},
};
use trisplat_scene::{
    Asset,
    math::color::{linear_from_srgb, srgb_from_linear},
    mesh::{Colors, Mesh},
};

const OPTIONS: ReadOptions = ReadOptions::with_degree(0);

fn written(mesh: &Mesh) -> (String, String) {
    let mut obj = Vec::new();
    let mut mtl = Vec::new();
    let asset = Asset { mesh: mesh.clone(), provenance: provenance(), ..Asset::default() };
    write(&mut obj, &mut mtl, "scene.mtl", None, &asset).expect("writes to memory");
    (String::from_utf8(obj).expect("text"), String::from_utf8(mtl).expect("text"))
}

/// The result of tobj for a file: corners and sRGB colours of every face.
fn judged(obj: &str) -> Vec<([f32; 9], [f32; 9])> {
    let options = tobj::LoadOptions { single_index: true, ..Default::default() };
    let (models, _) =
        tobj::load_obj_buf(&mut obj.as_bytes(), &options, |_| Err(tobj::LoadError::OpenFileFailed))
            .expect("tobj reads it");
    let of_corner = |values: &[f32], v: u32| [0, 1, 2].map(|a| values[3 * v as usize + a]);
    let faces = |mesh: &tobj::Mesh| {
        assert!(mesh.face_arities.is_empty(), "triangles only");
        let gather = |values: &[f32], corners: &[u32]| {
            let all = corners.iter().flat_map(|v| of_corner(values, *v)).collect::<Vec<f32>>();
            <[f32; 9]>::try_from(all).expect("three corners")
        };
        let pairs = mesh
            .indices
            .chunks_exact(3)
            .map(|c| (gather(&mesh.positions, c), gather(&mesh.vertex_color, c)));
        pairs.collect::<Vec<_>>()
    };
    models.iter().flat_map(|model| faces(&model.mesh)).collect()
}

fn flat(mesh: &Mesh, i: usize) -> ([f32; 9], [f32; 9]) {
    let (corners, colors, _) = face(mesh, i);
    let corners: Vec<f32> = corners.iter().flat_map(|v| v.to_array()).collect();
    let colors: Vec<f32> = colors.concat().into_iter().map(srgb_from_linear).collect();
    (corners.try_into().expect("nine"), colors.try_into().expect("nine"))
}

#[test]
fn every_kind_of_mesh_reads_back_as_it_looked_here_and_in_tobj() {
    for count in [1, 9_000] {
        for flags in 0..4 {
            let [per_face, indexed] = [1, 2].map(|bit| flags & bit != 0);
            let before = mesh(count, per_face, indexed, false);
            let (obj, mtl) = written(&before);
            let (after, back, warnings) = loaded_mesh(read(source(obj.as_bytes()), &OPTIONS));
            assert_eq!((after.face_count(), warnings.len(), back), (count, 0, provenance()));
            let judged = judged(&obj);
            assert_eq!(judged.len(), count);
            for (i, (corners, colors)) in judged.into_iter().enumerate() {
                assert_eq!(face(&before, i), face(&after, i));
                let wanted = flat(&before, i);
                assert_eq!(corners, wanted.0);
                assert!(
                    colors.iter().zip(wanted.1).all(|(a, b)| (a - b).abs() < 1e-6),
                    "{colors:?}"
                );
                // Exactly the 8-bit codes that the colours came from.
                assert!(colors.iter().all(|c| *c == (c * 255.0).round() / 255.0), "{colors:?}");
            }
            let own = per_face || !indexed;
            assert_eq!(after.vertex_count(), if own { 3 * count } else { count + 2 });
            assert_eq!(after.indices.is_empty(), own);
            assert!(obj.contains("\nmtllib scene.mtl\n") && obj.contains("\nusemtl trisplat\n"));
            assert!(
                mtl.contains("newmtl trisplat\n")
                    && mtl.contains("\nillum 0\n")
                    && mtl.contains("Kd 1 1 1")
            );
        }
    }
}

#[test]
fn colors_between_the_codes_stay_between_them() {
    let colors = (0..3000).map(|i| [i as f32 / 3000.0, 0.5, 1.0 - i as f32 / 2999.0]).collect();
    let mut before = mesh(1000, false, false, false);
    before.colors = Colors::Vertex(colors);
    let (after, ..) = loaded_mesh(read(source(written(&before).0.as_bytes()), &OPTIONS));
    for i in 0..1000 {
        let a = before.corner_colors(i).concat();
        let b = after.corner_colors(i).concat();
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 2e-6), "{a:?} {b:?}");
    }
}

#[test]
fn dialects_are_understood() {
    let plain = "v 0 0 0 0.2 0.2 0.2\nv 1 0 0 0.2 0.2 0.2\nv 0 1 0 0.2 0.2 0.2\n";
    let cases = [
        format!("{plain}f 1 2 3\n"),
        format!(
            "# caf\u{e9}\r\nmtllib x.mtl\r\no a b\r\ng c\r\n{}s off\r\nf 1/1 2/2 3/3\r\n",
            plain.replace('\n', "\r\n")
        ),
        format!("{plain}vt 0 0\nvn 0 0 1\nusemtl a\nf 1//1 2//1 3//1\nl 1 2\np 1"),
        format!("{plain}f -3 -2/1/1 -1 # the last three"),
        format!("f 1 2 3\n{plain}"),
        format!("\t{}f\t1  2\t3 ", plain.replace(" 0.2\n", " 0.2 1\n").replace('v', "v ")),
    ];
    for text in cases {
        let (mesh, _, warnings) = loaded_mesh(read(source(text.as_bytes()), &OPTIONS));
        assert_eq!((mesh.face_count(), warnings.len()), (1, 0), "{text}");
        assert_eq!(mesh.corner_colors(0), [[linear_from_srgb(0.2); 3]; 3], "{text}");
    }
    let latin1 = [b"# caf\xe9\n".as_slice(), plain.as_bytes(), b"f 1 2 3\n"].concat();
    assert_eq!(loaded_mesh(read(source(&latin1), &OPTIONS)).0.face_count(), 1);
}

#[test]
fn vertices_without_a_color_do_not_shift_the_others() {
    let text = "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1\nv 1 1 0 0 1 0\nf 1 2 3\nf 2 3 4\n";
    let (mesh, _, warnings) = loaded_mesh(read(source(text.as_bytes()), &OPTIONS));
    assert!(warnings.len() == 1 && warnings[0].contains("2 vertices"), "{warnings:?}");
    let white = [1.0; 3];
    let red = [1.0, 0.0, 0.0];
    let green = [0.0, 1.0, 0.0];
    assert_eq!(
        [mesh.corner_colors(0), mesh.corner_colors(1)],
        [[white, red, white], [red, white, green]]
    );
    let (mesh, _, warnings) =
        loaded_mesh(read(source(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3"), &OPTIONS));
    assert_eq!((mesh.corner_colors(0), warnings.len()), ([white; 3], 1));
}

/// The first vertex has no colour, the others are red, green and blue.
const PARTLY_COLORED: &str = "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\n";

#[test]
fn tobj_shifts_colors_when_only_some_vertices_have_one() {
    let [red, green, blue] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let (_, colors) = judged(PARTLY_COLORED)[0];
    assert_eq!(
        colors.as_slice(),
        [red, green, blue].as_flattened(),
        "tobj shifts colours when only some vertices have one: if this fails, tobj was fixed: look again whether it can read OBJ for us"
    );
    let (mesh, ..) = loaded_mesh(read(source(PARTLY_COLORED.as_bytes()), &OPTIONS));
    assert_eq!(mesh.corner_colors(0), [[1.0; 3], red, green]);
}

#[test]
fn polygons_become_triangles_of_the_same_outline() {
    // A quad, an L of six corners (concave at its last), a line's midpoint as a corner, and a
    // triangle between them.
    let vertices = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 1 0 0\n";
    for (faces, areas) in [
        ("f 1 2 3 6\n", vec![3.0]),
        ("f 1/1 2/2 3/3 4/4 5/5 6/6\n", vec![3.0]),
        ("f 6 5 4 3 2 1\n", vec![-3.0]),
        ("f 4 5 6 1 2 3\n", vec![3.0]),
        ("f 1 7 2 3 6\n", vec![3.0]),
        ("f 1 2 3\nf 1 2 3 4 5 6\nf -4 -3 -2\n", vec![1.0, 3.0, 0.5]),
    ] {
        for text in [
            format!("{vertices}{faces}"),
            format!("{faces}{vertices}").replace("f -4 -3 -2", "f 4 5 6"),
        ] {
            let (mesh, ..) = loaded_mesh(read(source(text.as_bytes()), &OPTIONS));
            let doubled: Vec<f32> = (0..mesh.face_count())
                .map(|face| {
                    let [a, b, c] = mesh.corners(face);
                    (b - a).cross(c - a).z
                })
                .collect();
            let sign = f32::signum(areas[0]);
            assert!(
                doubled.iter().all(|area| area * sign >= 0.0),
                "{text}: no triangle is turned over: {doubled:?}"
            );
            assert_eq!(
                doubled.iter().sum::<f32>(),
                2.0 * areas.iter().sum::<f32>(),
                "{text}: {doubled:?}"
            );
        }
    }
}

#[test]
fn polygons_anywhere_in_space_keep_their_outline_and_colors() {
    // A star: its inner corners are concave. Tilted, far from the origin.
    let corners = 2 * 9;
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.2, -0.7);
    let place = |i: usize| {
        let angle = std::f32::consts::TAU * i as f32 / corners as f32;
        let radius = if i.is_multiple_of(2) { 2.0 } else { 0.7 };
        turn * glam::Vec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
            + glam::Vec3::new(300.0, -40.0, 7.0)
    };
    let mut text = String::new();
    for i in 0..corners {
        let v = place(i);
        text += &format!("v {} {} {} {} 0.5 0\n", v.x, v.y, v.z, i as f32 / 32.0);
    }
    text += &format!("f {}\n", (1..=corners).map(|i| i.to_string()).collect::<Vec<_>>().join(" "));
    let (mesh, ..) = loaded_mesh(read(source(text.as_bytes()), &OPTIONS));
    assert_eq!(mesh.face_count(), corners - 2);
    let normal = turn * glam::Vec3::Z;
    let area: f32 = (0..mesh.face_count())
        .map(|face| {
            let [a, b, c] = mesh.corners(face);
            let doubled = (b - a).cross(c - a).dot(normal);
            assert!(doubled > 0.0, "face {face} is turned over");
            doubled / 2.0
        })
        .sum();
    let wanted = 9.0 * 2.0 * 0.7 * (std::f32::consts::PI / 9.0).sin();
    assert!((area - wanted).abs() < 1e-3, "{area} for {wanted}");
    let Colors::Vertex(colors) = &mesh.colors else { panic!("colours of vertices") };
    assert_eq!(colors[16], [0.5, 0.5, 0.0].map(linear_from_srgb));
}

#[test]
fn obj_name_that_it_cannot_hold_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let asset = Asset::from(mesh(1, false, false, false));
    let write = |name: &str| {
        trisplat_formats::write(
            &asset,
            &folder.path().join(name),
            &trisplat_formats::OutputOptions::default(),
        )
    };
    for name in
        ["a\nv 9 9 9.obj", "a\rv 9 9 9.obj", "a\u{2028}v 9 9 9.obj", "a\u{85}b.obj", " a.obj"]
    {
        let error = write(name).expect_err(name).to_string();
        assert!(error.contains("OBJ cannot quote the name of its .mtl"), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    write("a#b \"c\" \u{e9}.obj").expect("a name that it holds");
    write("a\nb.glb").expect("glTF quotes any name");
}

proptest! {
    #![proptest_config(trisplat_fixtures::regressions::stored())]

    #[test]
    fn any_finite_position_reads_back_bit_equal(bits in prop::collection::vec(any::<u32>(), 9)) {
        let values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        prop_assume!(values.iter().all(|x| x.is_finite()));
        let mut before = mesh(1, false, false, false);
        before.positions = values.chunks_exact(3).map(glam::Vec3::from_slice).collect();
        let (after, ..) = loaded_mesh(read(source(written(&before).0.as_bytes()), &OPTIONS));
        let bits = |mesh: &Mesh| mesh.positions.iter().flat_map(|v| v.to_array()).map(f32::to_bits).collect::<Vec<_>>();
        prop_assert_eq!(bits(&after), bits(&before));
    }
}
