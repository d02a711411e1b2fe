//! OFF and COFF.

use super::files::{loaded_mesh, source};
use glam::Vec3;
use trisplat_formats::ReadOptions;
use trisplat_formats::off::read;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};

fn mesh(text: &str) -> (Mesh, Vec<String>) {
    let (mesh, _, warnings) =
        loaded_mesh(read(source(text.as_bytes()), &ReadOptions::with_degree(0)));
    (mesh, warnings)
}

fn gray(code: f32) -> [f32; 3] {
    [linear_from_srgb(code / 255.0); 3]
}

#[test]
fn the_exporters_layout_keeps_its_shared_vertices() {
    let (mesh, warnings) = mesh(
        "COFF\n4 2 0\n0 0 0\n1 0 0\n0 1.5 0\n1e0 1 -.5\n3 0 1 2 255 128 0 255\n3 2 1 3 1 2 3 255\n",
    );
    assert_eq!(mesh.positions[2..], [Vec3::new(0.0, 1.5, 0.0), Vec3::new(1.0, 1.0, -0.5)]);
    assert_eq!(mesh.indices, [0, 1, 2, 2, 1, 3]);
    let codes = [[255.0, 128.0, 0.0], [1.0, 2.0, 3.0f32]];
    assert_eq!(
        mesh.colors,
        Colors::Face(codes.map(|c| c.map(|x| linear_from_srgb(x / 255.0))).to_vec())
    );
    assert_eq!((mesh.opacity.len(), warnings.len()), (0, 0));
}

#[test]
fn dialects_are_understood() {
    let face = Colors::Face(vec![gray(51.0)]);
    let vertex = Colors::Vertex(vec![gray(51.0); 3]);
    let corners = "0 0 0\n1 0 0\n0 1 0\n";
    let painted = "0 0 0 51 51 51 255\n1 0 0 51 51 51 255\n0 1 0 51 51 51 255\n";
    let cases = [
        (format!("OFF\n3 1 0\n{corners}3 0 1 2 51 51 51\n"), &face),
        (format!("OFF 3 1 0\n{corners}3 0 1 2 51 51 51"), &face),
        (format!("\u{feff}OFF\n3 1\n{corners}3 0 1 2 0.2 0.2 0.2\n"), &face),
        (
            format!("# hi\n\nCOFF # x\n\n3 1 0 # y\r\n{corners}\n3 0 1 2 51 51 51 255 # z\n\nrest"),
            &face,
        ),
        (format!("COFF\n3 1 3\n{painted}3 0 1 2\n"), &vertex),
    ];
    for (text, colors) in cases {
        let (mesh, warnings) = mesh(&text);
        assert_eq!((&mesh.colors, mesh.face_count(), warnings.len()), (colors, 1, 0), "{text}");
    }
}

#[test]
fn ones_are_floats_only_in_a_file_of_floats() {
    let corners = "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n";
    let (floats, _) = mesh(&format!("{corners}3 0 1 2 1 1 1\n3 0 1 2 0.2 0 0.5\n"));
    assert_eq!(floats.corner_colors(0)[0], [1.0; 3]);
    let (integers, _) = mesh(&format!("{corners}3 0 1 2 1 1 1\n3 0 1 2 51 0 127\n"));
    assert_eq!(integers.corner_colors(0)[0], gray(1.0));
}

#[test]
fn alpha_is_opacity_and_a_missing_color_is_white() {
    let corners = "OFF\n3 3 0\n0 0 0\n1 0 0\n0 1 0\n";
    let (mesh, _) = mesh(&format!("{corners}3 0 1 2\n3 0 1 2 0 0 0\n3 0 1 2 51 51 51 102\n"));
    assert_eq!(mesh.opacity, [1.0, 1.0, 0.4]);
    assert_eq!(mesh.colors, Colors::Face(vec![[1.0; 3], [0.0; 3], gray(51.0)]));
}

#[test]
fn no_color_at_all_and_overshoot_are_warnings() {
    let corners = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
    for (face, says) in [("3 0 1 2", "white"), ("3 0 1 2 1.2 0.5 -0.1", "2 colour values")] {
        let (_, warnings) = mesh(&format!("{corners}{face}\n"));
        assert!(warnings.len() == 1 && warnings[0].contains(says), "{warnings:?}");
    }
}

#[test]
fn every_triangle_of_a_polygon_has_its_color_and_opacity() {
    let vertices = "0 0 0\n2 0 0\n2 2 0\n1 0.5 0\n0 2 0\n";
    let faces = "3 0 1 2 0 0 0 255\n5 0 1 2 3 4 51 51 51 102\n3 0 1 4 255 255 255\n";
    let (mesh, warnings) = mesh(&format!("OFF\n5 3 0\n{vertices}{faces}"));
    assert_eq!((mesh.face_count(), warnings.len()), (5, 0));
    assert_eq!(mesh.opacity, [1.0, 0.4, 0.4, 0.4, 1.0]);
    let [black, dark, white] = [gray(0.0), gray(51.0), gray(255.0)];
    assert_eq!(mesh.colors, Colors::Face(vec![black, dark, dark, dark, white]));
    let doubled = |face| {
        let [a, b, c] = mesh.corners(face);
        (b - a).cross(c - a).z
    };
    let areas: Vec<f32> = (1..4).map(doubled).collect();
    assert!(areas.iter().all(|a| *a > 0.0) && areas.iter().sum::<f32>() == 5.0, "{areas:?}");
}
