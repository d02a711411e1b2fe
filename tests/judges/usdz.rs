//! USDZ, read and validated by the library of USD's makers.

use super::{bake, here, python, runs, studio};
use glam::Vec3;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;
use trisplat_formats::{ReadOptions, read};
use trisplat_scene::{Scene, mesh::Colors};

/// What the library says of a file.
fn judged(path: &Path) -> Option<Value> {
    let done = runs(python("pxr")?.arg(here("tests/judges/usd.py")).arg(path));
    let said = String::from_utf8_lossy(&done.stdout);
    let errors = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{errors}");
    Some(serde_json::from_str(&said).unwrap())
}

fn vectors(values: &Value) -> Vec<Vec3> {
    let number = |value: &Value| value.as_f64().unwrap() as f32;
    values
        .as_array()
        .unwrap()
        .iter()
        .map(|v| Vec3::from_array([0, 1, 2].map(|i| number(&v[i]))))
        .collect()
}

/// The triangles and colours are those of a GLB, and no validator has anything to say.
#[test]
fn a_usdz_holds_what_a_glb_holds_and_is_valid() {
    let folder = TempDir::new().unwrap();
    let [usdz, glb] = ["scene.usdz", "scene.glb"].map(|name| folder.path().join(name));
    let triangles = bake(&studio(), &usdz, &[]);
    let Some(judged) = judged(&usdz) else { return };
    bake(&studio(), &glb, &[]);
    assert!(judged["validators"].as_u64().unwrap() > 20, "{}", judged["validators"]);
    assert_eq!(judged["errors"], Value::Array(Vec::new()));
    assert_eq!((judged["up"].as_str(), judged["metres"].as_f64()), (Some("Y"), Some(1.0)));
    assert_eq!(judged["surface"], "UsdPreviewSurface");
    assert_eq!(judged["triangles"].as_u64(), Some(triangles));
    let Scene::Mesh(mesh) = read(&glb, &ReadOptions::default()).unwrap().scene else {
        panic!("a mesh")
    };
    let points = vectors(&judged["points"]);
    let indices: Vec<usize> = judged["indices"]
        .as_array()
        .unwrap()
        .iter()
        .map(|i| i.as_u64().unwrap() as usize)
        .collect();
    let ours = (0..mesh.face_count()).flat_map(|face| mesh.corners(face));
    assert!(indices.iter().map(|i| points[*i]).eq(ours), "positions");
    let colors = vectors(&judged["colors"]["values"]);
    let (of, ours) = match &mesh.colors {
        Colors::Face(colors) => ("uniform", colors),
        Colors::Vertex(colors) => ("vertex", colors),
    };
    let of_face = |face: usize| match judged["colors"]["of"].as_str().unwrap() {
        "uniform" => colors[face],
        _ => colors[indices[3 * face]],
    };
    for face in 0..mesh.face_count() {
        let ours = Vec3::from_array(if of == "uniform" {
            ours[face]
        } else {
            ours[mesh.face(face)[0] as usize]
        });
        // The GLB has 16 bits per channel.
        assert!(of_face(face).abs_diff_eq(ours, 1e-4), "{face}: {} {ours}", of_face(face));
    }
}
