//! Pages: what `trisplat bake -o scene.html` writes holds the scene, byte for byte.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use trisplat_formats::{Format, ReadOptions, check, info, read};
use trisplat_scene::Scene;

fn studio() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/studio.ply")
}

fn bake(output: &Path, flags: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    // Fitting takes long and has tests of its own.
    command.arg("bake").arg(studio()).arg("-o").arg(output).args(["--set", "reshape=off"]);
    let done = command.args(flags).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    done
}

/// Compression may begin a triangle with another of its corners.
fn scene(path: &Path) -> Scene {
    let mut scene = read(path, &ReadOptions::with_degree(0)).unwrap().scene;
    if let Scene::Mesh(mesh) = &mut scene {
        for face in mesh.indices.as_chunks_mut::<3>().0 {
            let least = (0..3).min_by_key(|k| face[*k]).unwrap();
            face.rotate_left(least);
        }
    }
    scene
}

#[test]
fn a_page_holds_the_scene_of_the_glb_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let [page, glb] = ["a <b>.html", "a.glb"].map(|name| folder.path().join(name));
    for flags in [&[][..], &["--set", "chunk_triangles=700"], &["--set", "weld=on"]] {
        let fast = [flags, &["--preset", "fast", "--force"]].concat();
        bake(&page, &fast);
        bake(&glb, &fast);
        assert_eq!(scene(&page), scene(&glb), "{flags:?}");
    }
    let text = std::fs::read_to_string(&page).unwrap();
    assert!(text.contains("<title>a &lt;b&gt;</title>") && text.ends_with("</html>\n"));
    bake(&page, &["--preset", "small", "--force"]);
    bake(&glb, &["--preset", "small", "--target", "web", "--force"]);
    assert_eq!(scene(&page), scene(&glb), "quantised");
}

#[test]
fn pages_are_the_same_bytes_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = ["1", "3"].map(|threads| {
        let path = folder.path().join("scene.html");
        bake(
            &path,
            &["--threads", threads, "--preset", "fast", "--set", "chunk_triangles=500", "--force"],
        );
        std::fs::read(path).unwrap()
    });
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn a_page_is_described_and_checked_like_any_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.html");
    bake(&path, &[]);
    let (info, _) = info::info_of_content(&path, &trisplat::ReadOptions::default()).unwrap();
    assert_eq!((info.format, info.triangles), (Format::Html, 9_628));
    assert_eq!(info.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(info.gltf.unwrap().extensions_required, ["EXT_meshopt_compression"]);
    let checked = check::check(&path, &trisplat::ReadOptions::default()).unwrap();
    assert_eq!(checked.triangles, Some(9_628));
    assert!(checked.findings.is_empty(), "{:?}", checked.findings);
}

#[test]
fn another_target_is_named_as_of_no_use() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let path = folder.path().join("scene.html");
    bake(&path, &["--target", "godot", "--report", report.to_str().unwrap()]);
    assert!(std::fs::read_to_string(&report).unwrap().contains("html: the page is its own viewer"));
    let plain = folder.path().join("plain.html");
    bake(&plain, &[]);
    assert_eq!(scene(&path), scene(&plain), "colours are linear all the same");
    assert!(!folder.path().join("scene.html.import").exists());
}

#[test]
fn damaged_and_foreign_pages_fail_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.html");
    bake(&path, &[]);
    let page = std::fs::read(&path).unwrap();
    let start = page.windows(6).position(|w| w == b"base64").unwrap();
    for cut in (start..page.len() - 200).step_by(page.len() / 97).chain([start + 8, start + 9]) {
        std::fs::write(&path, &page[..cut]).unwrap();
        let error = read(&path, &ReadOptions::with_degree(0)).unwrap_err().to_string();
        assert!(
            error.contains("cut short") || error.contains("page without a scene"),
            "{cut}: {error}"
        );
    }
    let mut spoilt = page.clone();
    spoilt[page.len() - 20_000] = b'%';
    for (bytes, needle) in
        [(&spoilt[..], "line "), (b"<!DOCTYPE html><title>x</title>", "page without a scene")]
    {
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path, &ReadOptions::with_degree(0)).unwrap_err().to_string();
        assert!(error.contains(needle) && error.contains("bake"), "{error}");
    }
}
