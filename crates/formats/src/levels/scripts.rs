//! Scripts that make one object of all levels in the editors of Unity and Unreal.

use super::distances::{APART, EngineScene};
use serde_json::{Value, json};
use trisplat_scene::report::generator;
use xxhash_rust::xxh3::xxh3_64;

/// Tangent of half the default vertical angle of Unity's camera, 60 degrees.
const UNITY_CAMERA: f64 = 0.577_350;
/// The same of Unreal, which has 90 degrees from left to right at 16:9.
const UNREAL_CAMERA: f64 = 9.0 / 16.0;
/// Unity accepts heights up to the whole screen.
const WHOLE_SCREEN: f64 = 1.0;
/// Screen size of Unreal's finest level: it is drawn wherever no other level is.
const FINEST: f64 = 2.0;

const UNITY: &str = include_str!("levels_unity.cs");
const UNREAL: &str = include_str!("levels_unreal.py");

/// A script for Unity's editor.
pub(super) fn unity(name: &str, scene: &EngineScene) -> String {
    let side = (scene.bounds[1] - scene.bounds[0]).max_element();
    let height = |distance: f64| side / (2.0 * distance * UNITY_CAMERA);
    let mut most = WHOLE_SCREEN;
    let heights = scene.distances(UNITY_CAMERA).into_iter().map(|distance| {
        let height = height(distance).min(most);
        most = height / APART;
        height
    });
    // No level follows the last: the coarsest is drawn at any distance.
    let heights: Vec<String> = heights.chain([0.0]).map(|height| format!("{}f", height as f32)).collect();
    filled(UNITY, name, scene, &heights)
}

/// A script for Unreal's editor.
pub(super) fn unreal(name: &str, scene: &EngineScene) -> String {
    let size = |distance: f64| (scene.radius / (distance * UNREAL_CAMERA)) as f32;
    let sizes = scene.distances(UNREAL_CAMERA).into_iter().map(size);
    let sizes: Vec<String> =
        [FINEST as f32].into_iter().chain(sizes).map(|size| format!("{size:?}")).collect();
    filled(UNREAL, name, scene, &sizes)
}

/// A template with the scene in it. Strings of JSON are strings of C# and of Python.
fn filled(template: &str, name: &str, scene: &EngineScene, sizes: &[String]) -> String {
    let files: Vec<String> = scene.files.iter().map(|file| json!(file.name).to_string()).collect();
    let put = [
        ("{generator}", generator()),
        ("{class}", class(name)),
        ("{files}", files.join(", ")),
        ("{sizes}", sizes.join(", ")),
        ("{name}", Value::from(name).to_string()),
    ];
    put.iter().fold(template.to_owned(), |text, (key, value)| text.replace(key, value))
}

/// A name that is valid in both languages and unique for every scene.
fn class(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    match plain == name {
        true => plain,
        false => format!("{plain}_{:08x}", xxh3_64(name.as_bytes()) as u32),
    }
}

#[cfg(test)]
mod tests {
    use super::super::distances::cube;
    use super::*;

    /// The numbers in the first line with `key`, between the brackets.
    fn numbers(text: &str, key: &str) -> Vec<f64> {
        let line = text.lines().find(|line| line.contains(key)).unwrap();
        let list = line.rsplit_once(['{', '[']).unwrap().1.split(['}', ']']).next().unwrap();
        list.split(", ").map(|number| number.trim().trim_end_matches('f').parse().unwrap()).collect()
    }

    #[test]
    fn levels_change_in_unity_and_unreal_where_their_triangles_are_two_pixels_wide() {
        // 1080 px at 60 degrees: 0.02 units are 2 px wide at 9.353, and the scene is 3 units nearer; its side is 3.464 units.
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
