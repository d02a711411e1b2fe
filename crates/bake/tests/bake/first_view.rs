//! The first view of a file: its subject, from a stored viewpoint, with nothing around it.

use glam::{DVec3, UVec2, Vec3};
use trisplat_bake::{Bake, BakeOptions};
use trisplat_formats::{
    self as formats, ReadOptions,
    gltf::{GltfOptions, to_glb_bytes},
};
use trisplat_raster::framing::{SceneEnclosure, orbit};
use trisplat_scene::{Asset, ImportedScene, Scene};

/// The README's first file, as its first command bakes it, without the slow part that changes no
/// place.
fn studio() -> Asset {
    let path = trisplat_fixtures::sample("soups/studio.ply");
    let scene = formats::read(&path, &ReadOptions::default()).expect("a sample");
    let options =
        BakeOptions { teacher: trisplat_bake::TeacherOptions::OFF, ..BakeOptions::DEFAULT };
    Bake::new(&options).run([scene]).expect("it bakes")
}

#[test]
fn glb_with_surroundings_has_a_camera_node() {
    let asset = studio();
    let viewpoint = asset.provenance.viewpoint.expect("photos or not");
    let bytes = to_glb_bytes(&asset, &GltfOptions::default()).expect("it fits");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    let nodes = json["nodes"].as_array().expect("nodes");
    let node = nodes.iter().find(|node| node["name"] == "viewpoint").expect("a camera node");
    let camera = &json["cameras"][node["camera"].as_u64().expect("its camera") as usize];
    let yfov = camera["perspective"]["yfov"].as_f64().expect("a lens");
    assert!((yfov.to_degrees() - viewpoint.fov).abs() < 1e-3);
    let numbers = |key: &str| -> Vec<f32> {
        node[key]
            .as_array()
            .expect("an array")
            .iter()
            .map(|x| x.as_f64().expect("a number") as f32)
            .collect()
    };
    let [eye, turn] = [numbers("translation"), numbers("rotation")];
    let eye = Vec3::from_slice(&eye);
    let ahead = glam::Quat::from_slice(&turn) * Vec3::NEG_Z;
    let target = DVec3::from(viewpoint.target).as_vec3();
    assert!((target - eye).normalize().dot(ahead) > 0.9999, "it looks at the target");
    assert!((glam::Quat::from_slice(&turn) * Vec3::X).y.abs() < 1e-4, "level");
    // The stage and what stands on it are around the target, the dome is not before it.
    assert!(target.length() < 2.0 && eye.distance(target) < 13.0, "{viewpoint:?}");
    assert!((1.0..6.0).contains(&viewpoint.radius.expect("a subject")), "{viewpoint:?}");
}

#[test]
fn orbit_of_any_soup_keeps_the_subject_in_view() {
    let path = trisplat_fixtures::sample("soups/studio.ply");
    let ImportedScene { scene, provenance, .. } =
        formats::read(&path, &ReadOptions::default()).expect("a sample");
    let surroundings = SceneEnclosure::of(&scene, &provenance);
    let viewpoint = surroundings.viewpoint(&[], Vec3::NEG_Y).expect("there is something to see");
    let target = DVec3::from(viewpoint.target).as_vec3();
    let room = surroundings.distance_from(target);
    assert!(room.is_finite() && f64::from(room) > viewpoint.radius.unwrap_or(0.0), "{room}");
    let Scene::Soup(soup) = &scene else { panic!("a soup") };
    let near =
        |t: &&[Vec3; 3]| t[0].distance(target) < 0.6 * viewpoint.radius.unwrap_or(0.0) as f32;
    let subject: Vec<Vec3> = soup.vertices.iter().filter(near).map(|t| t[0]).collect();
    assert!(subject.len() > 1000);
    for size in [UVec2::new(960, 720), UVec2::new(390, 844)] {
        let towards = |way: Vec3| surroundings.distance_along(target, way);
        for camera in orbit(&viewpoint, Vec3::NEG_Y, &towards, size, 12) {
            let away = camera.position() - target;
            assert!(away.length() < towards(away.normalize()));
            let inside = subject.iter().filter(|p| camera.is_in_frustum(**p)).count();
            assert!(
                inside as f64 > 0.98 * subject.len() as f64,
                "{inside} of {} {size}",
                subject.len()
            );
        }
    }
}
