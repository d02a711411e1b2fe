//! Scenes far from the origin of their world: what is read and baked of them is what is read and baked at the origin.

use glam::DVec3;
use std::fmt::Write;
use std::path::Path;
use trisplat::bake::{Bake, BakeOptions};
use trisplat::formats::gltf::{GltfOptions, to_glb_bytes};
use trisplat::formats::{ReadOptions, read};
use trisplat::scene::Scene;

/// Zone 32 of UTM, in metres.
const FAR: DVec3 = DVec3::new(691_608.0, 5_334_760.0, 519.0);

/// Corners on a grid of 1/1024, so that text and doubles hold them exactly.
fn corners() -> Vec<DVec3> {
    let at = |i: u32| f64::from((i * 7919) % 2048) / 1024.0;
    (0..30).map(|i| DVec3::new(at(3 * i), at(3 * i + 1), at(3 * i + 2))).collect()
}

fn obj(offset: DVec3) -> Vec<u8> {
    let mut text = String::new();
    for p in corners().iter().map(|p| *p + offset) {
        writeln!(text, "v {} {} {} 0.25 0.5 0.75", p.x, p.y, p.z).unwrap();
    }
    (0..10).for_each(|i| writeln!(text, "f {} {} {}", 3 * i + 1, 3 * i + 2, 3 * i + 3).unwrap());
    text.into_bytes()
}

/// Doubles, as a mesh or as a soup.
fn ply(offset: DVec3, is_soup: bool) -> Vec<u8> {
    let own = if is_soup {
        "property float opacity\nproperty float sigma\nproperty float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
    } else {
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 30\nproperty double x\nproperty double y\nproperty double z\n\
         element face 10\nproperty list uchar int vertex_indices\n{own}end_header\n"
    )
    .into_bytes();
    corners()
        .iter()
        .for_each(|p| (*p + offset).to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes())));
    for i in 0..10i32 {
        bytes.push(3);
        (3 * i..3 * i + 3).for_each(|v| bytes.extend(v.to_le_bytes()));
        match is_soup {
            true => [0.9f32, 0.01, 0.1, 0.2, 0.3].iter().for_each(|x| bytes.extend(x.to_le_bytes())),
            false => bytes.extend([40, 80, 120]),
        }
    }
    bytes
}

/// Corners of a scene, and what was taken off them; and the GLB that is baked of it, but for what it says of its origin.
fn baked(path: &Path) -> (Scene, [f64; 3], Vec<u8>) {
    let loaded = read(path, &ReadOptions::default()).unwrap();
    let (scene, center) = (loaded.scene.clone(), loaded.provenance.placement.center);
    assert_eq!(loaded.warnings.iter().any(|w| w.contains("far from the origin")), center != [0.0; 3]);
    let mut options = BakeOptions::default();
    options.place.up = "y".parse().unwrap();
    let mut asset = Bake::new(&options).run([loaded]).unwrap();
    asset.provenance = Default::default();
    (scene, center, to_glb_bytes(&asset, &GltfOptions::default()).unwrap())
}

#[test]
fn a_scene_at_utm_coordinates_bakes_to_the_bits_of_the_scene_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    type Make = fn(DVec3) -> Vec<u8>;
    let makes: [(&str, Make); 3] =
        [("a.obj", obj), ("b.ply", |o| ply(o, false)), ("c.ply", |o| ply(o, true))];
    for (name, make) in makes {
        let path = folder.path().join(name);
        std::fs::write(&path, make(FAR)).unwrap();
        let (_, center, far) = baked(&path);
        let taken = DVec3::from(center);
        assert!(taken.distance(FAR) < 4.0 && taken.fract() == DVec3::ZERO, "{name}: {taken}");
        // At the origin, and as far from it as whole numbers of the middle leave it.
        std::fs::write(&path, make(FAR - taken)).unwrap();
        let (_, center, near) = baked(&path);
        assert_eq!(center, [0.0; 3], "{name}");
        assert!(far == near, "{name}");
    }
}

#[test]
fn single_precision_and_scenes_near_by_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    for offset in [DVec3::ZERO, DVec3::splat(100.0), DVec3::new(4000.0, 0.0, -4000.0)] {
        std::fs::write(&path, obj(offset)).unwrap();
        let (scene, center, _) = baked(&path);
        assert_eq!(center, [0.0; 3]);
        assert_eq!(scene.corners(0)[1].as_dvec3(), corners()[1] + offset);
    }
}
