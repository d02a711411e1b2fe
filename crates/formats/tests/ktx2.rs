//! Textures as KTX2. `tests/external/textured.rs` asks other programs.

use glam::{UVec2, Vec2, Vec3};
use std::sync::Arc;
use trisplat_formats::{self as formats, OutputOptions, gltf::TextureFormat};
use trisplat_scene::{
    Asset, FaceTexture, Texture,
    image::RgbImage,
    mesh::{Colors, Mesh},
};

/// Two triangles on a smooth picture of this size.
fn asset(size: UVec2) -> Asset {
    let wave = |t: f32| (127.5 + 100.0 * t.sin()) as u8;
    painted(size, |x, y| {
        let at = UVec2::new(x, y).as_vec2() / 9.0;
        [wave(at.x), wave(at.y), wave(0.3 * (at.x + at.y))]
    })
}

/// Two triangles on a picture of these texels.
fn painted(size: UVec2, texel: impl Fn(u32, u32) -> [u8; 3]) -> Asset {
    let rgb = (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
    let [a, b, c, d] = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
    let texture = Texture::new(RgbImage { size, rgb, alpha: None });
    let mesh = Mesh {
        positions: [a, b, c, b, d, c].map(|at| Vec3::new(at.x, at.y, 0.0)).to_vec(),
        colors: Colors::Face(vec![[0.5; 3]; 2]),
        texture: Some(FaceTexture::new(vec![[a, b, c], [b, d, c]], Arc::new(texture))),
        ..Mesh::default()
    };
    Asset::from(mesh)
}

fn options(texture_format: TextureFormat) -> OutputOptions {
    OutputOptions { texture_format, ..OutputOptions::default() }
}

fn refused(name: &str, options: &OutputOptions) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = formats::write(&asset(UVec2::splat(8)), &folder.path().join(name), options).unwrap_err();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{name}: nothing is left");
    error.to_string()
}

#[cfg(not(feature = "ktx2"))]
#[test]
fn a_program_without_it_says_how_to_get_it() {
    for format in [TextureFormat::Ktx2, TextureFormat::Ktx2Uastc] {
        let message = refused("scene.glb", &options(format));
        assert!(message.contains("texture_format") && message.contains("--features ktx2"), "{message}");
    }
}

#[cfg(feature = "ktx2")]
mod built {
    use super::*;
    use std::path::Path;
    use trisplat_formats::OutputTarget;
    use trisplat_formats::{
        ReadOptions,
        check::{Severity, check},
        info::info,
    };
    use trisplat_scene::{Scene, math::metric};

    const BOTH: [TextureFormat; 2] = [TextureFormat::Ktx2, TextureFormat::Ktx2Uastc];

    fn written(asset: &Asset, path: &Path, format: TextureFormat) -> Vec<u8> {
        formats::write(asset, path, &options(format)).unwrap();
        std::fs::read(path).unwrap()
    }

    fn texture(scene: Scene) -> FaceTexture {
        let Scene::Mesh(mesh) = scene else { panic!("a mesh") };
        mesh.texture.expect("a texture")
    }

    #[test]
    fn a_file_reads_back_as_close_as_its_blocks_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.glb");
        // The second is padded to 64x36.
        for size in [UVec2::new(128, 64), UVec2::new(61, 33)] {
            let asset = asset(size);
            for (format, least_db, name) in [(BOTH[0], 33.0, "KTX2, ETC1S"), (BOTH[1], 42.0, "KTX2, UASTC")] {
                let bytes = written(&asset, &path, format);
                assert!(written(&asset, &path, format) == bytes, "the same bytes each time");
                let read = formats::read(&path, &ReadOptions::default()).unwrap();
                assert_eq!(read.warnings, [""; 0]);
                let back = texture(read.scene);
                assert_eq!(back.pages[0].size() % 4, UVec2::ZERO);
                assert_eq!(back.pages[0].stored().unwrap().format, name);
                let wants = asset.mesh.texture.as_ref().unwrap();
                let sampled = |texture: &FaceTexture| -> Vec<[u8; 3]> {
                    let at = |i: u32| {
                        let [a, b, c] = texture.uvs[(i % 2) as usize];
                        let (u, v) = ((i / 2 % 40) as f32 / 80.0, (i / 80) as f32 / 80.0);
                        let color = texture.pages[0].sample(a + u * (b - a) + v * (c - a), 0.0);
                        color.map(trisplat_scene::math::srgb8::srgb8_from_linear)
                    };
                    (0..3200).map(at).collect()
                };
                let psnr = metric::psnr(&sampled(wants), &sampled(&back), None);
                assert!(psnr > least_db, "{name}, {size}: {psnr}");
                let checked = check(&path, &ReadOptions::default()).unwrap();
                let wrong: Vec<_> =
                    checked.findings.iter().filter(|f| f.severity >= Severity::Warning).collect();
                assert!(wrong.is_empty(), "{wrong:?}");
                let (info, _) = info(&path, &ReadOptions::default()).unwrap();
                assert_eq!(info.texture.unwrap().stored.unwrap().format, name);
            }
        }
    }

    #[test]
    fn mip_levels_are_means_in_linear_light_and_the_picture_is_srgb() {
        let checkered = |x: u32, y: u32| if (x + y).is_multiple_of(2) { [255; 3] } else { [0; 3] };
        let (asset, folder) = (painted(UVec2::new(64, 16), checkered), tempfile::tempdir().unwrap());
        for format in BOTH {
            let glb = written(&asset, &folder.path().join("scene.glb"), format);
            let start = glb.windows(7).position(|seven| seven == b"\xABKTX 20").expect("a KTX2 picture");
            let file = &glb[start..];
            let descriptor = u32::from_le_bytes(file[48..52].try_into().unwrap()) as usize;
            assert_eq!(file[descriptor + 14], 2, "KHR_DF_TRANSFER_SRGB");
            let decoder = basisu::Transcoder::new(file).unwrap();
            assert_eq!(decoder.level_count(), 7);
            for level in 0..7 {
                let flags = basisu::DecodeFlags::NONE;
                let texels = decoder.transcode(level, basisu::TargetFormat::Rgba32, flags).unwrap();
                assert_eq!(texels.len() as u32, 4 * (64 >> level) * (16 >> level).max(1));
                for (i, texel) in texels.chunks_exact(4).enumerate() {
                    // Half of the light is code 188, not 128.
                    let wants = if level == 0 { checkered(i as u32 % 64, i as u32 / 64)[0] } else { 188 };
                    let off = texel[..3].iter().map(|code| code.abs_diff(wants)).max();
                    assert!(off <= Some(4), "{format:?}, level {level}, texel {i}: {texel:?}");
                }
            }
        }
    }

    #[test]
    fn what_cannot_hold_or_read_it_is_refused_by_name() {
        for (name, target, wants) in [
            ("scene.obj", OutputTarget::Gltf, "OBJ"),
            ("scene.usdz", OutputTarget::Gltf, "USDZ"),
            ("scene.html", OutputTarget::Gltf, "page"),
            ("scene.glb", OutputTarget::Blender, "Blender"),
            ("scene.glb", OutputTarget::Unreal, "Unreal"),
            ("scene.gltf", OutputTarget::Godot3, "Godot 3"),
        ] {
            let message = refused(name, &OutputOptions { target, ..options(TextureFormat::Ktx2) });
            assert!(message.contains(wants) && message.contains("jpeg or png"), "{message}");
        }
    }

    #[test]
    fn damaged_pictures_are_found_and_do_not_end_the_program() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.glb");
        for format in BOTH {
            let good = written(&asset(UVec2::splat(32)), &path, format);
            let start = good.windows(7).position(|seven| seven == b"\xABKTX 20").unwrap();
            for at in (start + 12..good.len()).step_by(5) {
                let mut bad = good.clone();
                bad[at] ^= 0x5a;
                std::fs::write(&path, &bad).unwrap();
                // Either it reads, or a warning says why the picture does not.
                let read = formats::read(&path, &ReadOptions::default()).unwrap();
                let Scene::Mesh(mesh) = read.scene else { panic!("a mesh") };
                assert!(mesh.texture.is_some() || !read.warnings.is_empty(), "byte {at}");
            }
            // The width, which is no multiple of 4 then.
            let mut bad = good.clone();
            bad[start + 20] = 31;
            std::fs::write(&path, &bad).unwrap();
            let found = check(&path, &ReadOptions::default()).unwrap();
            assert!(
                found.findings.iter().any(|finding| finding.what.contains("multiples of 4")),
                "{found:?}"
            );
        }
    }
}
