//! `bake --collision`: the stage, and the files of every target.

use super::shapes::{RADIUS, around, ball};
use glam::Vec3;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use std::process::{Command, Output};
use trisplat_bake::{Bake, BakeOptions};
use trisplat_formats::{OutputTarget, ReadOptions, output::OutputOptions, read, write};
use trisplat_scene::{
    Asset, ImportedScene, Scene,
    mesh::Mesh,
    report::{Outcome, Report, StageEvent, StageProgress},
};
use trisplat_surface::{CollisionDetails, CollisionOptions, collision};

const COLLISION: CollisionOptions = CollisionOptions { collision: true, collision_triangles: 1000 };

/// A ball off the origin, with cameras around it.
fn scene() -> ImportedScene {
    ImportedScene { cameras: around(24, 4.0, 128), ..ImportedScene::from(ball(Vec3::ZERO)) }
}

fn run(found: &mut Option<Mesh>, scene: &ImportedScene, options: &CollisionOptions) -> Outcome<()> {
    let mut details = CollisionDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    collision(found, scene, &[], options, &mut details, &mut StageProgress::new(&mut nobody))
        .unwrap()
}

#[test]
fn it_is_made_once_and_when_it_is_asked_for() {
    let mut found = None;
    let skipped =
        |outcome: Outcome<()>, why: &str| matches!(outcome, Outcome::Skipped(w) if w.contains(why));
    assert!(skipped(
        run(&mut found, &scene(), &CollisionOptions::DEFAULT),
        "`collision` was not asked for"
    ));
    assert_eq!(found, None);
    assert_eq!(run(&mut found, &scene(), &COLLISION), Outcome::Changed(()));
    assert!(found.as_ref().is_some_and(|mesh| (1..=1000).contains(&mesh.face_count())));
    let kept = found.clone();
    assert!(skipped(run(&mut found, &scene(), &COLLISION), "already"));
    assert_eq!(found, kept);
    let mut none = None;
    assert!(skipped(
        run(&mut none, &ImportedScene::from(Mesh::default()), &COLLISION),
        "no connected surface"
    ));
    assert!(CollisionOptions { collision_triangles: 0, ..COLLISION }.validate().is_err());
}

/// The ball as it is baked: twice as large, on the ground.
fn baked() -> Asset {
    let mut options = BakeOptions { collision: COLLISION, ..BakeOptions::default() };
    options.place.scale = 2.0;
    options.place.rotate = 30.0;
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([scene()]).unwrap();
    let details: CollisionDetails = report.details().unwrap();
    assert!(details.surface.pictures == 24 && details.surface.components == 1, "{details:?}");
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

pub(super) fn trisplat(folder: &Path, arguments: &[&str]) -> (Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let output = command.args(arguments).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

/// A folder with the trained sample as `a.ply`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/trained.ply");
    std::fs::copy(sample, folder.path().join("a.ply")).unwrap();
    folder
}

#[test]
fn the_command_line_writes_guards_and_reports_it() {
    let folder = folder();
    let bake =
        ["bake", "a.ply", "-o", "b.glb", "--teacher", "off", "--collision", "--report", "r.json"];
    let (done, said) = trisplat(folder.path(), &bake);
    assert!(done.status.success() && said.contains("wrote b.collision.glb"), "{said}");
    let report: Report =
        serde_json::from_slice(&std::fs::read(folder.path().join("r.json")).unwrap()).unwrap();
    let details: CollisionDetails = report.details().unwrap();
    assert!(details.surface.viewpoints.is_some() && details.surface.extracted > 0, "{details:?}");
    let faces = mesh(&folder.path().join("b.collision.glb")).face_count();
    assert!((1000..=4000).contains(&faces), "{faces}");

    let refuses = |arguments: &[&str], needles: &[&str]| {
        let (done, said) = trisplat(folder.path(), arguments);
        assert_eq!(done.status.code(), Some(1), "{said}");
        needles.iter().for_each(|needle| assert!(said.contains(needle), "{said} lacks {needle}"));
    };
    std::fs::remove_file(folder.path().join("b.glb")).unwrap();
    refuses(&["bake", "a.ply", "-o", "b.glb", "--collision"], &["b.collision.glb", "--force"]);
    refuses(
        &["bake", "a.ply", "-o", "c.html", "--collision"],
        &["--output is c.html", "--collision writes one"],
    );
    refuses(&["bake", "a.ply", "-o", "-", "--collision"], &["--collision writes one"]);
    assert!(!folder.path().join("b.glb").exists() && !folder.path().join("c.html").exists());
    // Without it the file of an earlier bake is named.
    let (_, said) = trisplat(folder.path(), &["bake", "a.ply", "-o", "b.glb", "--teacher", "off"]);
    assert!(said.contains("b.collision.glb is left of an earlier scene"), "{said}");
}

#[test]
fn mesh_writes_a_surface_and_refuses_what_bake_refuses() {
    let folder = folder();
    let (done, said) = trisplat(
        folder.path(),
        &[
            "mesh",
            "a.ply",
            "-o",
            "s.ply",
            "--resolution",
            "96",
            "--max-triangles",
            "5000",
            "--report",
            "r.json",
            "-v",
        ],
    );
    assert!(done.status.success(), "{said}");
    for stage in ["crop", "surface", "place", "write"] {
        assert!(said.lines().any(|line| line.starts_with(stage)), "{stage}: {said}");
    }
    let mesh = mesh(&folder.path().join("s.ply"));
    assert!(
        mesh.face_count() <= 5000 && mesh.vertex_count() < mesh.face_count(),
        "vertices are shared"
    );
    let refuses = |arguments: &[&str], needles: &[&str]| {
        let (done, said) = trisplat(folder.path(), arguments);
        assert_eq!(done.status.code(), Some(1), "{said}");
        needles.iter().for_each(|needle| assert!(said.contains(needle), "{said} lacks {needle}"));
    };
    refuses(&["mesh", "a.ply", "-o", "s.ply"], &["--output is s.ply", "--force"]);
    refuses(&["mesh", "a.ply", "-o", "a.ply", "--force"], &["a file that is not also an input"]);
    refuses(&["mesh", "a.ply", "-o", "s.html"], &["a name ending in .ply, .glb, .gltf or .obj"]);
    refuses(&["mesh", "a.ply", "-o", "t.ply", "--voxel=-1"], &["--voxel is -1"]);
    let none =
        ["mesh", "a.ply", "-o", "t.ply", "--resolution", "8", "--min-component", "900000000"];
    refuses(&none, &["the surface is empty", "--min-component"]);
    refuses(
        &["mesh", "a.ply", "-o", "t.ply", "--limit", "array_bytes=1000000"],
        &["the distance field"],
    );
    assert!(!folder.path().join("t.ply").exists());
}
