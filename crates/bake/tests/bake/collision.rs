//! `collision` in a bake: the guards of the scene, and the files of every target.

use glam::Vec3;
use std::path::Path;
use trisplat_bake::{Bake, BakeOptions};
use trisplat_fixtures::shapes::{RADIUS, around, ball};
use trisplat_formats::{OutputTarget, ReadOptions, output::OutputOptions, read, write};
use trisplat_scene::{Asset, ImportedScene, Scene, mesh::Mesh, report::Report};
use trisplat_surface::{CollisionDetails, CollisionOptions};

const COLLISION: CollisionOptions =
    CollisionOptions { collision: true, collision_triangles: Some(1000) };

/// A ball off the origin, with cameras around it.
fn scene() -> ImportedScene {
    ImportedScene { cameras: around(24, 4.0, 128), ..ImportedScene::from(ball(Vec3::ZERO)) }
}

/// The ball as it is baked: twice as large, on the ground.
fn baked() -> Asset {
    let mut options = BakeOptions { collision: COLLISION, ..BakeOptions::default() };
    options.place.scale = 2.0;
    options.place.rotate = 30.0;
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([scene()]).unwrap();
    let details: CollisionDetails = report.details().unwrap();
    assert!(details.surface.components == 1, "{details:?}");
    asset
}

fn mesh(path: &Path) -> Mesh {
    match read(path, &ReadOptions::default()).unwrap().scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("what was written is a mesh"),
    }
}

/// The names of the nodes of a GLB.
fn nodes(path: &Path) -> Vec<String> {
    let document = gltf::Gltf::open(path).unwrap();
    document.nodes().map(|node| node.name().unwrap().to_owned()).collect()
}

#[test]
fn it_lies_where_the_scene_lies() {
    let asset = baked();
    let collision = asset.collision.as_ref().unwrap();
    assert!(collision.positions.iter().all(|p| (p.length() - 2.0 * RADIUS).abs() < 0.1));
}

#[test]
fn every_target_has_it_where_its_engine_looks() {
    let asset = baked();
    let faces = asset.collision.as_ref().unwrap().face_count();
    for target in
        [OutputTarget::Gltf, OutputTarget::Unity, OutputTarget::Godot, OutputTarget::Godot3]
    {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.glb");
        let written =
            write(&asset, &path, &OutputOptions { target, ..OutputOptions::DEFAULT }).unwrap();
        let beside = path.with_extension("collision.glb");
        let names = nodes(&path);
        // A viewer of ours draws the scene only.
        assert_eq!(mesh(&path).face_count(), asset.mesh.face_count());
        if target.has_collision_node() {
            assert!(
                !beside.exists() && names.iter().any(|name| name == "collision-colonly"),
                "{names:?}"
            );
            let document = gltf::Gltf::open(&path).unwrap();
            let node =
                document.nodes().find(|node| node.name() == Some("collision-colonly")).unwrap();
            let primitive = node.mesh().unwrap().primitives().next().unwrap();
            assert_eq!(primitive.indices().unwrap().count(), 3 * faces);
            assert_eq!(primitive.attributes().count(), 1, "positions only");
        } else {
            assert!(names.iter().all(|name| !name.contains("collision")), "{names:?}");
            assert_eq!(
                (nodes(&beside), mesh(&beside).face_count()),
                (vec!["collision".to_owned()], faces)
            );
            assert!(written.files.iter().any(|file| file.path.ends_with("scene.collision.glb")));
        }
    }
}

#[test]
fn other_formats_have_it_beside_them() {
    let asset = baked();
    let folder = tempfile::tempdir().unwrap();
    for ending in ["gltf", "obj", "ply"] {
        let path = folder.path().join(format!("{ending}.{ending}"));
        write(&asset, &path, &OutputOptions::default()).unwrap();
        let beside = path.with_extension(format!("collision.{ending}"));
        assert_eq!(mesh(&beside).face_count(), asset.collision.as_ref().unwrap().face_count());
    }
}
