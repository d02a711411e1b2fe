//! USDZ: the archive as its specification wants it, and the scene in it. `tests/judges/usdz.rs`
//! asks the library of its makers.

use glam::{Vec2, Vec3};
use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::Arc;
use trisplat_formats::{self as formats, OutputOptions, ReadOptions, gltf::TextureFormat};
use trisplat_scene::{
    Asset, FaceTexture, Provenance, Texture,
    image::RgbImage,
    mesh::{Colors, Mesh},
};

/// Two triangles, the second of them a backdrop.
fn asset() -> Asset {
    let mesh = Mesh {
        positions: vec![
            Vec3::ZERO,
            Vec3::X,
            Vec3::Y,
            Vec3::splat(9.0),
            Vec3::X * 9.0,
            Vec3::Y * 9.0,
        ],
        colors: Colors::Face(vec![[1.0, 0.5, 0.25], [0.0; 3]]),
        ..Mesh::default()
    };
    Asset {
        provenance: Provenance { backdrop_faces: 1, ..Provenance::default() },
        ..Asset::from(mesh)
    }
}

/// Every file of the archive, in order, and the warnings of its writer.
fn written(asset: &Asset, options: &OutputOptions) -> (Vec<(String, Vec<u8>)>, Vec<String>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.usdz");
    let said = formats::write(asset, &path, options).expect("writes").warnings;
    let mut zip = zip::ZipArchive::new(Cursor::new(std::fs::read(&path).expect("a file")))
        .expect("an archive");
    let mut files = Vec::new();
    for i in 0..zip.len() {
        let mut file = zip.by_index(i).expect("a file");
        assert_eq!(file.compression(), zip::CompressionMethod::Stored);
        let name = file.name().expect("a name").into_owned();
        assert_eq!(file.data_start().expect("a place") % 64, 0, "{name}");
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).expect("readable");
        files.push((name, bytes));
    }
    (files, said)
}

fn text(files: &[(String, Vec<u8>)]) -> &str {
    assert_eq!(files[0].0, "scene.usda", "the first file is the scene");
    std::str::from_utf8(&files[0].1).expect("text")
}

#[test]
fn a_scene_is_the_first_file_and_its_backdrop_stays_out() {
    let (files, said) = written(&asset(), &OutputOptions::default());
    let text = text(&files);
    assert!(text.starts_with("#usda 1.0\n"), "{text}");
    for part in [
        "upAxis = \"Y\"",
        "float3[] extent = [(0, 0, 0), (1, 1, 0)]",
        "int[] faceVertexCounts = [3]",
        "int[] faceVertexIndices = [0, 1, 2]",
        "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]",
        "color3f[] primvars:displayColor = [(1, 0.5, 0.25)]",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    assert_eq!(files.len(), 1);
    assert!(
        said.len() == 2 && said[0].contains("`texture`") && said[1].contains("backdrop"),
        "{said:?}"
    );
}

#[test]
fn single_sided_triangles_are_a_mesh_of_their_own() {
    let mesh = Mesh { single_sided: vec![false, true], ..asset().mesh };
    let (files, _) = written(&Asset::from(mesh), &OutputOptions::default());
    let [_, both, front] = text(&files).split("def Mesh").collect::<Vec<_>>()[..] else {
        panic!("two meshes: {}", text(&files));
    };
    assert!(
        both.contains("doubleSided = 1")
            && both.contains("points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]")
    );
    assert!(
        front.contains("doubleSided = 0")
            && front.contains("points = [(9, 9, 9), (9, 0, 0), (0, 9, 0)]")
    );
    assert!(front.contains("faceVertexIndices = [0, 1, 2]"));
}

#[test]
fn a_texture_is_a_picture_in_the_archive() {
    let mut asset = asset();
    asset.provenance.backdrop_faces = 0;
    let picture = RgbImage::from_rgb(glam::UVec2::splat(4), &[[0.5; 3]; 16]);
    let uv = [Vec2::ZERO, Vec2::X, Vec2::Y];
    asset.mesh.texture = Some(FaceTexture::new(vec![uv, uv], Arc::new(Texture::new(picture))));
    let options = OutputOptions { texture_format: TextureFormat::Png, ..OutputOptions::default() };
    let (files, said) = written(&asset, &options);
    let text = text(&files);
    // From the lower left corner.
    assert!(text.contains("primvars:st = [(0, 1), (1, 1), (0, 0), "), "{text}");
    assert!(
        text.contains("inputs:file = @texture.png@") && !text.contains("displayColor"),
        "{text}"
    );
    assert!(files[1].0 == "texture.png" && files[1].1.starts_with(b"\x89PNG"), "{}", files[1].0);
    assert!(said.is_empty(), "{said:?}");
}

#[test]
fn it_is_one_file_that_is_written_and_not_read() {
    let options = OutputOptions::default();
    let beside = formats::output::SideFiles { levels: 2, ..Default::default() };
    let several = formats::output::Output::of_scene(Path::new("a.usdz"), None, &options, &beside);
    assert!(several.expect_err("two files").to_string().contains(".glb, .gltf, .obj or .ply"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.usdz");
    formats::write(&asset(), &path, &options).expect("writes");
    let error = formats::read(&path, &ReadOptions::default()).expect_err("not read").to_string();
    assert!(error.contains("scene.usdz") && error.contains("written and not read"), "{error}");
}
