//! `bake --collision` and `mesh` on the command line.

use super::sample;
use std::path::Path;
use std::process::{Command, Output};
use trisplat_formats::{ReadOptions, read};
use trisplat_scene::{Scene, mesh::Mesh, report::Report};
use trisplat_surface::CollisionDetails;
use trisplat_synthetic::SyntheticOptions;

fn mesh(path: &Path) -> Mesh {
    match read(path, &ReadOptions::default()).unwrap().scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("what was written is a mesh"),
    }
}

fn trisplat(folder: &Path, arguments: &[&str]) -> (Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let output = command.args(arguments).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

/// A folder with the trained sample as `a.ply`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(sample("trained.ply"), folder.path().join("a.ply")).unwrap();
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
    refuses(&none, &["no surface was found", "--min-component"]);
    refuses(
        &["mesh", "a.ply", "-o", "t.ply", "--limit", "array_bytes=1000000"],
        &["the distance field"],
    );
    assert!(!folder.path().join("t.ply").exists());
}

#[test]
fn the_command_line_takes_photos_in_place_of_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let photos =
        SyntheticOptions { views: 3, width: 32, points: 50, ..SyntheticOptions::default() };
    trisplat_synthetic::write(&folder.path().join("photos"), &photos).unwrap();
    let refuses = |arguments: &[&str], needles: &[&str]| {
        let (done, said) = trisplat(folder.path(), arguments);
        assert_eq!(done.status.code(), Some(1), "{said}");
        needles.iter().for_each(|needle| assert!(said.contains(needle), "{said} lacks {needle}"));
    };
    refuses(
        &["mesh", "photos", "photos", "-o", "a.glb"],
        &["one data set", "photos is a data set already"],
    );
    refuses(&["mesh", "a.ply", "-o", "a.glb", "--texture"], &["texture is given without photos"]);
    refuses(&["mesh", "photos", "-o", "photos/a.txt"], &["--output"]);
    assert!(!folder.path().join("a.glb").exists());
}
