//! Scenes far from the origin of their world: what is read and baked of them is what is read and
//! baked at the origin.

use base64::Engine;
use glam::DVec3;
use std::fmt::Write;
use std::path::Path;
use trisplat_bake::{Bake, BakeOptions, ReshapeOptions};
use trisplat_formats::{
    ReadOptions,
    gltf::{GltfOptions, to_glb_bytes},
    read,
};
use trisplat_scene::{Asset, ImportedScene, Scene, mesh::Mesh};

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
        if is_soup {
            [0.9f32, 0.01, 0.1, 0.2, 0.3].iter().for_each(|x| bytes.extend(x.to_le_bytes()))
        } else {
            bytes.extend([40, 80, 120])
        }
    }
    bytes
}

fn off(offset: DVec3) -> Vec<u8> {
    let mut text = String::from("COFF\n30 10 0\n");
    for p in corners().iter().map(|p| *p + offset) {
        writeln!(text, "{} {} {}", p.x, p.y, p.z).unwrap();
    }
    (0..10)
        .for_each(|i| writeln!(text, "3 {} {} {} 40 80 120", 3 * i, 3 * i + 1, 3 * i + 2).unwrap());
    text.into_bytes()
}

/// The corners in single precision, and a document whose node moves them; the buffer in the GLB or
/// in the text.
fn document(offset: DVec3, inside: bool) -> (String, Vec<u8>) {
    let bin: Vec<u8> =
        corners().iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
    let text = base64::engine::general_purpose::STANDARD.encode(&bin);
    let uri = if inside {
        String::new()
    } else {
        format!(", \"uri\": \"data:application/octet-stream;base64,{text}\"")
    };
    // Half of the way in the parent's node, half in a matrix.
    let half = (offset / 2.0).to_array();
    let [hx, hy, hz] = half;
    let json = format!(
        "{{\"asset\": {{\"version\": \"2.0\"}}, \"scene\": 0, \"scenes\": [{{\"nodes\": [0]}}],
        \"nodes\": [{{\"translation\": {half:?}, \"children\": [1]}},
            {{\"matrix\": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, {hx}, {hy}, {hz}, 1], \"mesh\": 0}}],
        \"meshes\": [{{\"primitives\": [{{\"attributes\": {{\"POSITION\": 0}}}}]}}],
        \"accessors\": [{{\"bufferView\": 0, \"componentType\": 5126, \"count\": 30, \"type\": \"VEC3\"}}],
        \"bufferViews\": [{{\"buffer\": 0, \"byteLength\": 360}}], \"buffers\": [{{\"byteLength\": 360{uri}}}]}}"
    );
    (json, bin)
}

fn gltf(offset: DVec3) -> Vec<u8> {
    document(offset, false).0.into_bytes()
}

fn glb(offset: DVec3) -> Vec<u8> {
    let (mut json, bin) = document(offset, true);
    json += &" ".repeat(json.len().wrapping_neg() % 4);
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    let number = |n: usize| (n as u32).to_le_bytes();
    bytes.extend(number(12 + 8 + json.len() + 8 + bin.len()));
    bytes.extend(number(json.len()));
    bytes.extend(b"JSON");
    bytes.extend(json.as_bytes());
    bytes.extend(number(bin.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(bin);
    bytes
}

/// Corners of a scene, and what was taken off them; and the GLB that is baked of it, but for what
/// it says of its origin.
fn baked(path: &Path) -> (Scene, [f64; 3], Vec<u8>) {
    let loaded = read(path, &ReadOptions::default()).unwrap();
    let scene = loaded.scene.clone();
    let center = loaded.provenance.placement.center;
    assert_eq!(
        loaded.warnings.iter().any(|w| w.contains("far from the origin")),
        center != [0.0; 3]
    );
    let mut options = BakeOptions::default();
    options.place.up = "y".parse().unwrap();
    // A round moves corners as well as many do.
    options.reshape.reshape_rounds = 2;
    let mut asset = Bake::new(&options).run([loaded]).unwrap();
    asset.provenance = Default::default();
    (scene, center, to_glb_bytes(&asset, &GltfOptions::default()).unwrap())
}

#[test]
fn utm_scene_bakes_to_the_bits_of_the_scene_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    for (i, (name, bytes)) in all(FAR).into_iter().enumerate() {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let (_, center, far) = baked(&path);
        let taken = DVec3::from(center);
        assert!(taken.distance(FAR) < 4.0 && taken.fract() == DVec3::ZERO, "{name}: {taken}");
        // At the origin, and as far from it as whole numbers of the middle leave it.
        std::fs::write(&path, &all(FAR - taken)[i].1).unwrap();
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

/// A place that single precision rounds by up to a quarter of a metre, with digits that it has no
/// room for.
const PLACE: DVec3 = DVec3::new(691_608.372, 5_334_760.618, 519.246);
/// From one input to the other.
const APART: DVec3 = DVec3::new(120.0, 0.0, 0.0);

/// Bakes inputs, Y up as they are, their corners where they are.
fn bake_all(inputs: Vec<ImportedScene>) -> Asset {
    let mut options = BakeOptions { reshape: ReshapeOptions::OFF, ..BakeOptions::default() };
    options.place.up = "y".parse().unwrap();
    options.tiles.tiles = true;
    Bake::new(&options).run(inputs).unwrap()
}

/// Every corner is where it was in the world, within a millimetre, and nothing else is.
fn is_in_its_place(asset: &Asset, mesh: &Mesh, offsets: &[DVec3], what: &str) {
    let placement = &asset.provenance.placement;
    let found: Vec<DVec3> = (0..mesh.face_count())
        .flat_map(|face| mesh.corners(face))
        .map(|p| placement.to_world_f64(p))
        .collect();
    let wanted: Vec<DVec3> =
        offsets.iter().flat_map(|offset| corners().into_iter().map(|p| p + *offset)).collect();
    assert_eq!(found.len(), wanted.len(), "{what}: every triangle is there");
    for corner in wanted {
        let nearest = found.iter().map(|p| p.distance(corner)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-3, "{what}: the corner {corner} is {nearest} m off");
    }
    let center = DVec3::from(placement.center);
    assert!(center.distance(offsets[0]) < 4.0, "{what}: the placement's centre is {center}");
}

#[test]
fn every_format_keeps_a_millimetre_at_utm_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in all(PLACE) {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let loaded = read(&path, &ReadOptions::default()).unwrap();
        assert_eq!(loaded.scene.triangle_count(), 10, "{name}");
        let asset = bake_all(vec![loaded]);
        is_in_its_place(&asset, &asset.mesh, &[PLACE], name);
    }
}

#[test]
fn merged_inputs_keep_their_distance_in_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let here = all(PLACE);
    let there = all(PLACE + APART);
    // Pairs of all formats; files that lie in Y up are merged with their like.
    for (i, (first, bytes)) in here.iter().enumerate() {
        for (second, others) in there.iter().filter(|(name, _)| is_gltf(name) == is_gltf(first)) {
            let paths =
                [folder.path().join(format!("a{first}")), folder.path().join(format!("b{second}"))];
            std::fs::write(&paths[0], bytes).unwrap();
            std::fs::write(&paths[1], others).unwrap();
            let inputs =
                paths.iter().map(|path| read(path, &ReadOptions::default()).unwrap()).collect();
            let asset = bake_all(inputs);
            let what = format!("{i}: {first} and {second}");
            is_in_its_place(&asset, &asset.mesh, &[PLACE, PLACE + APART], &what);
            let mut of_tiles = Mesh::default();
            asset.tiles.as_ref().unwrap().visit(&mut |tile| {
                if tile.children.is_empty() {
                    of_tiles.append(tile.mesh.clone()).unwrap();
                }
            });
            is_in_its_place(&asset, &of_tiles, &[PLACE, PLACE + APART], &format!("{what}, tiles"));
        }
    }
}

#[test]
fn merged_bakes_keep_their_distance_in_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let mut baked = Vec::new();
    for (i, offset) in [PLACE, PLACE + APART].into_iter().enumerate() {
        let source = folder.path().join(format!("{i}.ply"));
        std::fs::write(&source, ply(offset, i == 0)).unwrap();
        let scene = read(&source, &ReadOptions::default()).unwrap();
        let mut options = BakeOptions { reshape: ReshapeOptions::OFF, ..BakeOptions::default() };
        // Turned, scaled and each about its own middle.
        options.place.up = "-z".parse().unwrap();
        options.place.center = true;
        options.place.scale = 0.5 + i as f64;
        let asset = Bake::new(&options).run([scene]).unwrap();
        let path = folder.path().join(format!("{i}.glb"));
        std::fs::write(&path, to_glb_bytes(&asset, &GltfOptions::default()).unwrap()).unwrap();
        baked.push(read(&path, &ReadOptions::default()).unwrap());
    }
    let asset = bake_all(baked);
    is_in_its_place(&asset, &asset.mesh, &[PLACE, PLACE + APART], "GLBs");
}

#[test]
fn an_input_of_another_world_is_named_and_stays_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let paths = [folder.path().join("far.ply"), folder.path().join("near.obj")];
    std::fs::write(&paths[0], ply(PLACE, false)).unwrap();
    std::fs::write(&paths[1], obj(DVec3::new(5.0, 0.0, 0.0))).unwrap();
    let inputs = paths.iter().map(|path| read(path, &ReadOptions::default()).unwrap()).collect();
    let merged = trisplat_bake::merge(inputs).unwrap();
    assert_eq!(merged.scene.corners(10)[0].as_dvec3(), corners()[0] + DVec3::X * 5.0);
    let named = |w: &&String| w.starts_with("input 2 does not say where it is in the world");
    assert_eq!(merged.warnings.iter().filter(named).count(), 1, "{:?}", merged.warnings);
}

#[test]
fn a_stray_vertex_costs_no_digit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let text = String::from_utf8(obj(PLACE)).unwrap() + "v 0 0 0\nv 1e7 0 0\n";
    std::fs::write(&path, text).unwrap();
    let asset = bake_all(vec![read(&path, &ReadOptions::default()).unwrap()]);
    is_in_its_place(&asset, &asset.mesh, &[PLACE], "a stray");
}

/// A file of each format that holds more digits than single precision.
fn all(offset: DVec3) -> [(&'static str, Vec<u8>); 6] {
    [
        ("a.obj", obj(offset)),
        ("b.ply", ply(offset, false)),
        ("c.ply", ply(offset, true)),
        ("d.off", off(offset)),
        ("e.glb", glb(offset)),
        ("f.gltf", gltf(offset)),
    ]
}

fn is_gltf(name: &str) -> bool {
    name.ends_with(".glb") || name.ends_with(".gltf")
}
