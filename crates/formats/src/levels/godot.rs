//! A scene of Godot 4 that holds all levels, each drawn within its range of distances.
//!
//! Godot measures from the middle of each node's own box, and chunks of two levels cover different pieces of
//! space, so separate ranges would open holes. So nodes of coarser levels get the box of the whole scene.
//! Nodes of the finest level, which Godot culls one by one, have the first node of the next level as
//! visibility parent: they are drawn when that node is too near.

use super::distances::EngineScene;
use std::fmt::Write;

/// Tangent of half the default vertical angle of a `Camera3D`, 75 degrees.
const CAMERA: f64 = 0.767_327;

/// The text of the scene.
pub(super) fn text(scene: &EngineScene) -> String {
    let mut out = format!("[gd_scene load_steps={} format=3]\n\n", scene.files.len() + 1);
    for (i, file) in scene.files.iter().enumerate() {
        let name = file.name.replace('\\', "\\\\").replace('"', "\\\"");
        line(&mut out, format_args!("[ext_resource type=\"PackedScene\" path=\"{name}\" id=\"{i}\"]"));
    }
    line(&mut out, format_args!("\n[node name=\"Scene\" type=\"Node3D\"]"));
    let distances = scene.distances(CAMERA);
    for (i, file) in scene.files.iter().enumerate() {
        line(&mut out, format_args!("\n[node name=\"Lod{i}\" parent=\".\" instance=ExtResource(\"{i}\")]"));
        for node in &file.nodes {
            line(&mut out, format_args!("\n[node name=\"{node}\" parent=\"Lod{i}\"]"));
            match i {
                0 => nearest(&mut out, scene),
                _ => range(&mut out, scene, distances[i - 1], distances.get(i).copied()),
            }
        }
        // The one of the finest level is always drawn, which suffices.
        for node in file.backdrop.iter().filter(|_| i > 0) {
            line(&mut out, format_args!("\n[node name=\"{node}\" parent=\"Lod{i}\"]\nvisible = false"));
        }
    }
    line(&mut out, format_args!(""));
    for i in 0..scene.files.len() {
        line(&mut out, format_args!("[editable path=\"Lod{i}\"]"));
    }
    out
}

/// Properties of a node of the finest level.
fn nearest(out: &mut String, scene: &EngineScene) {
    if let Some(node) = scene.files.get(1).and_then(|next| next.nodes.first()) {
        line(out, format_args!("visibility_parent = NodePath(\"../../Lod1/{node}\")"));
    }
}

/// Properties of a node that is drawn from `begin` on, up to `end`.
fn range(out: &mut String, scene: &EngineScene, begin: f64, end: Option<f64>) {
    let [low, high] = scene.bounds;
    let numbers = [low, high - low].map(|v| format!("{}, {}, {}", v.x as f32, v.y as f32, v.z as f32));
    line(out, format_args!("custom_aabb = AABB({})", numbers.join(", ")));
    line(out, format_args!("visibility_range_begin = {}", begin as f32));
    if let Some(end) = end {
        line(out, format_args!("visibility_range_end = {}", end as f32));
    }
}

/// Text in memory takes every line.
fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = writeln!(out, "{text}");
}

#[cfg(test)]
mod tests {
    use super::super::distances::cube;
    use super::*;

    #[test]
    fn ranges_follow_each_other_without_a_gap() {
        let text = text(&cube());
        let numbers = |key: &str| -> Vec<f64> {
            let lines = text.lines().filter_map(|line| line.strip_prefix(key));
            lines.map(|value| value.parse().unwrap()).collect()
        };
        let (begins, ends) = (numbers("visibility_range_begin = "), numbers("visibility_range_end = "));
        assert_eq!((begins.len(), ends.len()), (2, 1), "{text}");
        assert_eq!(begins[1], ends[0]);
        // 1080 px, 75 degrees: 703.7 px at a distance of 1, so 0.02 units are 2 px at 7.04; the scene is 3 units nearer.
        assert!((begins[0] - 10.037).abs() < 1e-3, "{begins:?}");
        assert_eq!(text.matches("visibility_parent = NodePath(\"../../Lod1/scene\")").count(), 2);
        assert_eq!(text.matches("[node name=\"backdrop\"").count(), 2, "those of the coarser levels");
        assert_eq!(text.matches("]\nvisible = false\n").count(), 2);
        assert!((CAMERA - 37.5f64.to_radians().tan()).abs() < 1e-6);
    }

    #[test]
    fn names_of_files_are_quoted() {
        let mut scene = cube();
        scene.files[0].name = "a \"b\".glb".into();
        assert!(text(&scene).contains("path=\"a \\\"b\\\".glb\""));
    }
}
