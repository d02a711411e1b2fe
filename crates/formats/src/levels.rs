//! Files that make an engine draw each level of detail where it suffices; each engine has its own
//! kind.

use crate::{lines::quoted, tiles};
use glam::DVec3;
use std::fmt::Write;
use trisplat_scene::Asset;
use trisplat_scene::report::generator;
use xxhash_rust::xxh3::xxh3_64;

/// The kind of file an engine reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum EngineLevels {
    /// Godot 4: a scene with visibility ranges, OUT.lod.tscn.
    GodotScene,
    /// Unity: an editor script that makes an LOD group, OUT.lod.cs.
    UnityScript,
    /// Unreal Engine 5: a Python script for the editor that makes one static mesh, OUT.lod.py.
    UnrealScript,
}

impl EngineLevels {
    /// All kinds.
    pub(crate) const ALL: [Self; 3] = [Self::GodotScene, Self::UnityScript, Self::UnrealScript];

    /// The ending of the file's name, which replaces the scene's.
    pub(crate) fn ending(self) -> &'static str {
        match self {
            Self::GodotScene => "lod.tscn",
            Self::UnityScript => "lod.cs",
            Self::UnrealScript => "lod.py",
        }
    }

    /// The text of the file for a scene called `name`.
    pub(super) fn text(self, name: &str, scene: &EngineScene) -> String {
        match self {
            Self::GodotScene => text(scene),
            Self::UnityScript => unity(name, scene),
            Self::UnrealScript => unreal(name, scene),
        }
    }
}

// ---- The levels of a scene for an engine, and the distance at which each suffices ---------------

/// Height of the screen that levels are chosen for, px.
const SCREEN_PX: f64 = 1080.0;
/// Width of a level's median triangle on that screen at which a finer level takes over, px.
const TRIANGLE_PX: f64 = 2.0;
/// Minimum ratio of the distances at which two levels change: engines need falling heights on the
/// screen.
pub(super) const MIN_DISTANCE_RATIO: f64 = 1.001;

/// A level and its file.
#[derive(Debug)]
pub(crate) struct LevelFile {
    /// Name of the file.
    pub(crate) name: String,
    /// Names of its nodes, without the backdrop's.
    pub(crate) nodes: Vec<String>,
    /// Names of the backdrop's nodes; usually one, or none.
    pub(crate) backdrop: Vec<String>,
}

/// The scene and its levels, finest first, and the space they are in.
#[derive(Debug)]
pub(crate) struct EngineScene {
    pub(super) files: Vec<LevelFile>,
    /// Side of the median triangle of each level, units of the file.
    pub(super) details: Vec<f64>,
    /// Lowest and highest corner of all levels.
    pub(super) bounds: [DVec3; 2],
    /// Radius of the sphere about the middle of the bounds that contains all levels.
    pub(super) radius: f64,
}

impl EngineScene {
    /// From the finest level and the others, and their files, in this order.
    pub(crate) fn new<'a>(levels: impl Iterator<Item = (&'a Asset, LevelFile)>) -> Self {
        let (assets, files): (Vec<&Asset>, Vec<LevelFile>) = levels.unzip();
        let bounds =
            assets.iter().filter_map(|asset| tiles::bounds(&asset.mesh, asset.scene_faces()));
        let bounds = bounds.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).unwrap_or_default();
        let middle = (bounds[0] + bounds[1]) / 2.0;
        let corners = assets
            .iter()
            .flat_map(|asset| (0..asset.scene_faces()).flat_map(|f| asset.mesh.corners(f)));
        let radius = corners.map(|p| p.as_dvec3().distance(middle)).fold(0.0, f64::max);
        let details = assets.iter().map(|asset| asset.detail()).collect();
        Self { files, details, bounds, radius }
    }

    /// The distance from the middle at which each level but the finest begins, for a camera with
    /// this tangent of half its vertical angle.
    pub(super) fn distances(&self, tangent: f64) -> Vec<f64> {
        let near = |detail: &f64| detail / TRIANGLE_PX * SCREEN_PX / (2.0 * tangent);
        let mut last = 0.0_f64;
        let mut next = |distance: f64| {
            last = distance.max(last * MIN_DISTANCE_RATIO);
            last
        };
        self.details.iter().skip(1).map(|detail| next(near(detail) + self.radius)).collect()
    }
}

// ---- A scene of Godot 4 that holds all levels, each drawn within its range of distances ---------

/// Tangent of half the default vertical angle of a `Camera3D`, 75 degrees.
const CAMERA: f64 = 0.767_327;

/// The text of the scene.
pub(super) fn text(scene: &EngineScene) -> String {
    let mut out = format!("[gd_scene load_steps={} format=3]\n\n", scene.files.len() + 1);
    for (i, file) in scene.files.iter().enumerate() {
        let name = quoted(&file.name);
        line(&mut out, format_args!("[ext_resource type=\"PackedScene\" path={name} id=\"{i}\"]"));
    }
    line(&mut out, format_args!("\n[node name=\"Scene\" type=\"Node3D\"]"));
    let distances = scene.distances(CAMERA);
    for (i, file) in scene.files.iter().enumerate() {
        line(
            &mut out,
            format_args!("\n[node name=\"Lod{i}\" parent=\".\" instance=ExtResource(\"{i}\")]"),
        );
        for node in &file.nodes {
            line(&mut out, format_args!("\n[node name=\"{node}\" parent=\"Lod{i}\"]"));
            match (i, scene.files.get(1).and_then(|next| next.nodes.first())) {
                (0, None) => {}
                (0, Some(next)) => {
                    line(
                        &mut out,
                        format_args!("visibility_parent = NodePath(\"../../Lod1/{next}\")"),
                    );
                }
                _ => range(&mut out, scene, distances[i - 1], distances.get(i).copied()),
            }
        }
        // The backdrop of the finest level is always drawn, which suffices.
        for node in file.backdrop.iter().filter(|_| i > 0) {
            line(
                &mut out,
                format_args!("\n[node name=\"{node}\" parent=\"Lod{i}\"]\nvisible = false"),
            );
        }
    }
    line(&mut out, format_args!(""));
    for i in 0..scene.files.len() {
        line(&mut out, format_args!("[editable path=\"Lod{i}\"]"));
    }
    out
}

/// Properties of a node that is drawn from `begin` on, up to `end`.
fn range(out: &mut String, scene: &EngineScene, begin: f64, end: Option<f64>) {
    let [low, high] = scene.bounds;
    let numbers =
        [low, high - low].map(|v| format!("{}, {}, {}", v.x as f32, v.y as f32, v.z as f32));
    line(out, format_args!("custom_aabb = AABB({})", numbers.join(", ")));
    line(out, format_args!("visibility_range_begin = {}", begin as f32));
    if let Some(end) = end {
        line(out, format_args!("visibility_range_end = {}", end as f32));
    }
}

/// Append a line; text in memory takes every one.
fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = writeln!(out, "{text}");
}

// ---- Scripts that make one object of all levels in the editors of Unity and Unreal --------------

/// Tangent of half the default vertical angle of Unity's camera, 60 degrees.
const UNITY_CAMERA: f64 = 0.577_350;
/// Tangent of half the default vertical angle of Unreal's camera, which has 90 degrees from left to
/// right at 16:9.
const UNREAL_CAMERA: f64 = 9.0 / 16.0;
/// Unity accepts heights up to the whole screen.
const WHOLE_SCREEN: f64 = 1.0;
/// Screen size of Unreal's finest level: it is drawn wherever no other level is.
const FINEST_SCREEN_SIZE: f64 = 2.0;

const UNITY: &str = include_str!("levels/levels_unity.cs");
const UNREAL: &str = include_str!("levels/levels_unreal.py");

/// A script for Unity's editor.
pub(super) fn unity(name: &str, scene: &EngineScene) -> String {
    let side = (scene.bounds[1] - scene.bounds[0]).max_element();
    let height = |distance: f64| side / (2.0 * distance * UNITY_CAMERA);
    let mut max_height = WHOLE_SCREEN;
    let heights = scene.distances(UNITY_CAMERA).into_iter().map(|distance| {
        let height = height(distance).min(max_height);
        max_height = height / MIN_DISTANCE_RATIO;
        height
    });
    // No level follows the last: the coarsest is drawn at any distance.
    let heights: Vec<String> =
        heights.chain([0.0]).map(|height| format!("{}f", height as f32)).collect();
    filled(UNITY, name, scene, &heights)
}

/// A script for Unreal's editor.
pub(super) fn unreal(name: &str, scene: &EngineScene) -> String {
    let size = |distance: f64| (scene.radius / (distance * UNREAL_CAMERA)) as f32;
    let sizes = scene.distances(UNREAL_CAMERA).into_iter().map(size);
    let sizes: Vec<String> = [FINEST_SCREEN_SIZE as f32]
        .into_iter()
        .chain(sizes)
        .map(|size| format!("{size:?}"))
        .collect();
    filled(UNREAL, name, scene, &sizes)
}

/// A template with the scene in it. What is put in is not searched for keys: names may contain
/// them.
fn filled(template: &str, name: &str, scene: &EngineScene, sizes: &[String]) -> String {
    let files: Vec<String> = scene.files.iter().map(|file| quoted(&file.name)).collect();
    let put = [
        ("{generator}", generator()),
        ("{class}", class(name)),
        ("{files}", files.join(", ")),
        ("{sizes}", sizes.join(", ")),
        ("{name}", quoted(name)),
    ];
    let mut out = String::new();
    let mut rest = template;
    while let Some((at, key, value)) =
        put.iter().filter_map(|(key, value)| Some((rest.find(key)?, key, value))).min()
    {
        out.extend([&rest[..at], value]);
        rest = &rest[at + key.len()..];
    }
    out + rest
}

/// A name that is valid in both languages and unique for every scene.
fn class(name: &str) -> String {
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain == name { plain } else { format!("{plain}_{:08x}", xxh3_64(name.as_bytes()) as u32) }
}

/// Three levels of a cube about (1, 2, 3) whose corners are 3 units from there.
#[cfg(test)]
fn cube() -> EngineScene {
    let half = DVec3::splat(3f64.sqrt());
    let middle = DVec3::new(1.0, 2.0, 3.0);
    let file = |(name, nodes): (&str, &[&str])| LevelFile {
        name: name.into(),
        nodes: nodes.iter().map(|node| (*node).into()).collect(),
        backdrop: vec!["backdrop".into()],
    };
    let files = [
        ("a.glb", &["chunk_0000", "chunk_0001"][..]),
        ("a.lod1.glb", &["scene"]),
        ("a.lod2.glb", &["scene"]),
    ];
    EngineScene {
        files: files.map(file).into(),
        details: vec![0.01, 0.02, 0.04],
        bounds: [middle - half, middle + half],
        radius: 3.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_switch_at_triangles_of_two_pixels() {
        let tangent = 0.5;
        let distances = cube().distances(tangent);
        for (distance, detail) in distances.iter().zip([0.02, 0.04]) {
            let nearest = distance - 3.0;
            let px = detail / nearest * SCREEN_PX / (2.0 * tangent);
            assert!((px - 2.0).abs() < 1e-9, "{px} px at {distance}");
        }
        let still = EngineScene { details: vec![1.0, 1.0, 1.0], ..cube() }.distances(tangent);
        assert!(still[0] < still[1], "{still:?}");
    }
}

#[cfg(test)]
mod godot_tests {
    use super::cube;
    use super::*;

    #[test]
    fn ranges_follow_each_other_without_a_gap() {
        let text = text(&cube());
        let numbers = |key: &str| -> Vec<f64> {
            let lines = text.lines().filter_map(|line| line.strip_prefix(key));
            lines.map(|value| value.parse().unwrap()).collect()
        };
        let begins = numbers("visibility_range_begin = ");
        let ends = numbers("visibility_range_end = ");
        assert_eq!((begins.len(), ends.len()), (2, 1), "{text}");
        assert_eq!(begins[1], ends[0]);
        // 1080 px, 75 degrees: 703.7 px at a distance of 1, so 0.02 units are 2 px at 7.04; the
        // scene is 3 units nearer.
        assert!((begins[0] - 10.037).abs() < 1e-3, "{begins:?}");
        assert_eq!(text.matches("visibility_parent = NodePath(\"../../Lod1/scene\")").count(), 2);
        assert_eq!(
            text.matches("[node name=\"backdrop\"").count(),
            2,
            "those of the coarser levels"
        );
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

#[cfg(test)]
mod scripts_tests {
    use super::cube;
    use super::*;
    use crate::lines::breaks_text;

    /// The numbers in the first line with `key`, between the brackets.
    fn numbers(text: &str, key: &str) -> Vec<f64> {
        let line = text.lines().find(|line| line.contains(key)).unwrap();
        let list = line.rsplit_once(['{', '[']).unwrap().1.split(['}', ']']).next().unwrap();
        list.split(", ")
            .map(|number| number.trim().trim_end_matches('f').parse().unwrap())
            .collect()
    }

    #[test]
    fn levels_in_unity_and_unreal_change_at_two_pixels() {
        // 1080 px at 60 degrees: 0.02 units are 2 px wide at 9.353, and the scene is 3 units
        // nearer; its side is 3.464 units.
        let heights = numbers(&unity("a", &cube()), "Heights =");
        assert!((heights[0] - 3.4641 / (2.0 * 12.353 * 0.57735)).abs() < 1e-4, "{heights:?}");
        assert!(heights.len() == 3 && heights[0] > heights[1] && heights[2] == 0.0, "{heights:?}");
        // 90 degrees from left to right: 960 px at a distance of 1.
        let sizes = numbers(&unreal("a", &cube()), "SCREEN_SIZES =");
        assert!((sizes[1] - 3.0 / (12.6 * 0.5625)).abs() < 1e-4, "{sizes:?}");
        assert!(sizes.len() == 3 && sizes[0] > sizes[1] && sizes[1] > sizes[2], "{sizes:?}");
        assert!((UNITY_CAMERA - 30f64.to_radians().tan()).abs() < 1e-6);
    }

    #[test]
    fn unity_gets_heights_within_the_screen_that_fall() {
        let scene = EngineScene { details: vec![0.0; 4], ..cube() };
        let heights = numbers(&unity("a", &scene), "Heights =");
        assert!(heights.iter().all(|height| (0.0..=1.0).contains(height)), "{heights:?}");
        assert!(heights.windows(2).all(|pair| pair[0] > pair[1]), "{heights:?}");
    }

    #[test]
    fn classes_of_scenes_differ() {
        assert_eq!(class("room2"), "room2");
        assert!(class("a-b") != class("a.b") && class("a-b").starts_with("a_b_"));
    }

    /// Names that hold keys, line breaks of three languages, quotes and marks that turn text round.
    #[test]
    fn a_name_is_never_code() {
        let name = "{name}\"+{files}\\{class}\u{2028}\u{85}\n\r\u{202e}x";
        let mut scene = cube();
        scene.files[0].name = name.into();
        for text in [unity(name, &scene), unreal(name, &scene), text(&scene)] {
            let wanted = r#""{name}\"+{files}\\{class}\u2028\u0085\n\r\u202ex""#;
            assert!(text.contains(wanted), "{text}");
            assert!(!text.chars().any(|c| breaks_text(c) && c != '\n'), "{text}");
            assert_eq!(
                text.matches("+{files}").count(),
                text.matches(wanted).count(),
                "only within strings: {text}"
            );
        }
    }

    #[test]
    fn nothing_is_left_to_fill_in() {
        for text in [unity("a \"b\"", &cube()), unreal("a \"b\"", &cube())] {
            assert!(text.contains(r#""a \"b\"""#), "{text}");
            for key in ["{generator}", "{class}", "{files}", "{sizes}", "{name}"] {
                assert!(!text.contains(key), "{key}: {text}");
            }
        }
    }
}
