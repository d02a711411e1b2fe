//! Pictures of materials, however they are laid: what a triangle showed in the file it shows when
//! read.

use super::files::{Builder, UNSIGNED_BYTE, mesh, read_bytes};
use glam::{UVec2, Vec2, Vec3};
use serde_json::{Value, json};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{linear_of_srgb8, srgb_from_linear};
use trisplat_scene::mesh::Mesh;

const SIDE: i64 = 16;

fn code(x: i64, y: i64) -> [u8; 3] {
    let at = (x * 7 + y * 13) % 16;
    [(at * 16) as u8, (255 - x * 15) as u8, (y * 15 + 20) as u8]
}

fn picture() -> RgbImage {
    let rgb = (0..SIDE * SIDE).map(|i| code(i % SIDE, i / SIDE)).collect();
    RgbImage { size: UVec2::splat(SIDE as u32), rgb, alpha: None }
}

/// A document with that picture as texture 0.
fn with_picture() -> Builder {
    let mut b = Builder::new();
    let view = b.view(&picture().to_png().expect("a picture"));
    let image = b.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    b.push("textures", json!({ "source": image }));
    b
}

/// Adds a triangle with that material and these texture coordinates, and other attributes.
fn add(b: &mut Builder, material: Value, uvs: [f32; 6], others: &[(&str, usize)]) {
    let material = b.push("materials", material);
    let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
    let uv = b.floats("VEC2", &uvs);
    let mut attributes = json!({ "POSITION": position, "TEXCOORD_0": uv });
    for (name, accessor) in others {
        attributes[*name] = (*accessor).into();
    }
    let mesh = b.mesh(json!({ "attributes": attributes, "material": material }));
    b.node(json!({ "mesh": mesh }));
}

fn base(info: Value) -> Value {
    json!({ "pbrMetallicRoughness": { "baseColorTexture": info } })
}

const PLAIN: [f32; 6] = [0.1, 0.2, 0.9, 0.3, 0.4, 0.8];

/// The picture as an engine filters it, going on by `wrap` beyond its border; linear.
fn filtered(uv: Vec2, wrap: fn(i64) -> i64) -> Vec3 {
    let at = uv * SIDE as f32 - 0.5;
    let first = at.floor();
    let part = at - at.floor();
    let texel = |x: i64, y: i64| {
        let [x, y] = [first.x as i64 + x, first.y as i64 + y].map(wrap);
        Vec3::from(code(x, y).map(|c| linear_of_srgb8()[usize::from(c)]))
    };
    let row = |y: i64| texel(0, y).lerp(texel(1, y), part.x);
    row(0).lerp(row(1), part.y)
}

/// Checks that a face shows at many places what `wanted` says, which gets the place on it and its
/// texture coordinates.
fn shows(mesh: &Mesh, face: usize, uvs: [f32; 6], wanted: impl Fn([f32; 3], Vec2) -> Vec3) {
    let texture = mesh.texture.as_ref().expect("the texture is kept");
    for i in 0..40 {
        let a = (0.5 + i as f32 * 0.618) % 1.0;
        let b = (0.25 + i as f32 * 0.414) % 1.0;
        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        let weights = [1.0 - a - b, a, b];
        let on = |corners: [Vec2; 3]| (0..3).map(|k| corners[k] * weights[k]).sum::<Vec2>();
        let seen = texture.texture(face).sample(on(texture.uvs[face]), 0.0);
        let wanted = wanted(weights, on([0, 1, 2].map(|k| Vec2::new(uvs[2 * k], uvs[2 * k + 1]))));
        for (seen, wanted) in seen.into_iter().zip(wanted.to_array()) {
            let off = (srgb_from_linear(seen) - srgb_from_linear(wanted)).abs() * 255.0;
            assert!(off < 2.5, "{weights:?}: {seen} instead of {wanted}");
        }
    }
}

fn repeat(at: i64) -> i64 {
    at.rem_euclid(SIDE)
}

fn mirror(at: i64) -> i64 {
    if at.rem_euclid(2 * SIDE) < SIDE { repeat(at) } else { SIDE - 1 - repeat(at) }
}

fn clamp(at: i64) -> i64 {
    at.clamp(0, SIDE - 1)
}

#[test]
fn coordinates_beyond_the_picture_show_what_an_engine_shows() {
    let moved = |by: [f32; 2]| std::array::from_fn(|i| PLAIN[i] + by[i % 2]);
    let wide = [-1.3, 0.4, 2.6, -0.7, 0.3, 3.1];
    let modes = [10497, 33648, 33071];
    let wraps: [fn(i64) -> i64; 3] = [repeat, mirror, clamp];
    for (mode, wrap) in modes.into_iter().zip(wraps) {
        for uvs in
            [PLAIN, moved([3.0, -2.0]), moved([1.0, 5.0]), wide, [0., 0., 1.00002, 0., 0., 1.00002]]
        {
            let mut b = with_picture();
            b.push("samplers", json!({ "wrapS": mode, "wrapT": mode }));
            b.json["textures"][0]["sampler"] = 0.into();
            add(&mut b, base(json!({ "index": 0 })), uvs, &[]);
            // The border itself is within; filters there would need the next tile.
            let inner = |uv: Vec2| {
                uv.clamp(Vec2::splat(0.5 / SIDE as f32), Vec2::splat(1.0 - 0.5 / SIDE as f32))
            };
            let is_border = uvs[2] == 1.00002;
            shows(&b.mesh_of(), 0, uvs, |_, uv| {
                filtered(
                    if is_border { inner(uv) } else { uv },
                    if is_border { clamp } else { wrap },
                )
            });
        }
    }
}

#[test]
fn one_picture_may_go_on_in_two_ways() {
    let mut b = with_picture();
    b.push("samplers", json!({ "wrapS": 33648, "wrapT": 33648 }));
    b.push("textures", json!({ "source": 0, "sampler": 0 }));
    let wide = [0.2, 0.1, 2.6, 0.7, 0.3, 3.1];
    add(&mut b, base(json!({ "index": 0 })), wide, &[]);
    add(&mut b, base(json!({ "index": 1 })), wide, &[]);
    shows(&b.mesh_of(), 0, wide, |_, uv| filtered(uv, repeat));
    shows(&b.mesh_of(), 1, wide, |_, uv| filtered(uv, mirror));
}

#[test]
fn whole_tiles_keep_the_picture_itself() {
    let mut b = with_picture();
    add(&mut b, base(json!({ "index": 0 })), PLAIN.map(|x| x + 4.0), &[]);
    add(&mut b, base(json!({ "index": 0 })), PLAIN, &[]);
    let texture = b.mesh_of().texture.expect("kept");
    assert_eq!((texture.pages.len(), texture.pages[0].picture()), (1, &picture()));
    // A face that repeats it does not cost the others their picture.
    add(&mut b, base(json!({ "index": 0 })), PLAIN.map(|x| 3.0 * x), &[]);
    let texture = b.mesh_of().texture.expect("kept");
    assert_eq!(
        (texture.page_of.as_slice(), texture.pages[0].picture()),
        (&[0, 0, 1][..], &picture())
    );
}

#[test]
fn transforms_and_other_sets_of_coordinates_lay_the_picture() {
    let turn = 0.4f32;
    let (sin, cos) = turn.sin_cos();
    let at = |uv: Vec2| {
        let uv = uv * Vec2::new(0.5, 0.75);
        Vec2::new(cos * uv.x + sin * uv.y + 0.3, cos * uv.y - sin * uv.x + 0.1)
    };
    let info = json!({ "index": 0, "extensions": { "KHR_texture_transform":
        { "offset": [0.3, 0.1], "rotation": turn, "scale": [0.5, 0.75] } } });
    let mut b = with_picture();
    b.json["extensionsRequired"] = json!(["KHR_texture_transform"]);
    add(&mut b, base(info), PLAIN, &[]);
    shows(&b.mesh_of(), 0, PLAIN, |_, uv| filtered(at(uv), repeat));
    let other = PLAIN.map(|x| 1.0 - x);
    for info in [
        json!({ "index": 0, "texCoord": 1 }),
        json!({ "index": 0, "extensions": { "KHR_texture_transform": { "texCoord": 1 } } }),
        json!({ "index": 0, "extensions": { "KHR_texture_transform": {} }, "texCoord": 1 }),
    ] {
        let mut b = with_picture();
        let second = b.floats("VEC2", &other);
        add(&mut b, base(info), PLAIN, &[("TEXCOORD_1", second)]);
        shows(&b.mesh_of(), 0, other, |_, uv| filtered(uv, repeat));
    }
}

#[test]
fn colours_and_factors_multiply_the_picture() {
    let tint = Vec3::new(0.5, 0.25, 1.0);
    let factor = json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "baseColorFactor": [0.5, 0.25, 1, 1] } });
    let mut b = with_picture();
    let white = b.normalized(UNSIGNED_BYTE, "VEC4", 3, &[255; 12]);
    add(&mut b, base(json!({ "index": 0 })), PLAIN, &[("COLOR_0", white)]);
    let texture = b.mesh_of().texture.expect("kept");
    assert_eq!((texture.pages.len(), texture.pages[0].picture()), (1, &picture()));
    let corners = [Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.2, 1.0, 0.5), Vec3::ONE];
    let colors = b.floats("VEC3", &corners.iter().flat_map(|c| c.to_array()).collect::<Vec<f32>>());
    add(&mut b, factor.clone(), PLAIN, &[]);
    add(&mut b, factor, PLAIN, &[("COLOR_0", colors)]);
    let mesh = b.mesh_of();
    shows(&mesh, 0, PLAIN, |_, uv| filtered(uv, repeat));
    shows(&mesh, 1, PLAIN, |_, uv| filtered(uv, repeat) * tint);
    let texture = mesh.texture.as_ref().expect("kept");
    for (corner, color) in corners.into_iter().enumerate() {
        let uv = Vec2::new(PLAIN[2 * corner], PLAIN[2 * corner + 1]);
        let seen = Vec3::from(texture.texture(2).sample(texture.uvs[2][corner], 0.0));
        let wanted = filtered(uv, repeat) * tint * color;
        assert!((seen - wanted).abs().max_element() < 0.08, "corner {corner}: {seen} {wanted}");
    }
}

#[test]
fn texture_leaves_parts_without_a_picture_their_colours() {
    let mut b = with_picture();
    add(
        &mut b,
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 0, 1] } }),
        PLAIN,
        &[],
    );
    add(&mut b, base(json!({ "index": 0 })), PLAIN, &[]);
    let corners = [1., 0., 0., 0., 1., 0., 0., 0., 1.];
    let colors = b.floats("VEC3", &corners);
    add(&mut b, json!({}), PLAIN, &[("COLOR_0", colors)]);
    let mesh = mesh(b.read().expect("valid"));
    shows(&mesh, 0, PLAIN, |_, _| Vec3::new(1.0, 0.5, 0.0));
    shows(&mesh, 1, PLAIN, |_, uv| filtered(uv, repeat));
    let texture = mesh.texture.as_ref().expect("kept");
    for weights in [
        [1., 0., 0.],
        [0., 1., 0.],
        [0., 0., 1.],
        [0.5, 0.25, 0.25],
        [0.3, 0.3, 0.4],
        [0., 0.5, 0.5],
    ] {
        let at = (0..3).map(|k| texture.uvs[2][k] * weights[k]).sum::<Vec2>();
        let seen = Vec3::from(texture.texture(2).sample(at, 0.0));
        assert!((seen - Vec3::from(weights)).abs().max_element() < 0.06, "{seen} {weights:?}");
    }
}

#[test]
fn faces_that_repeat_without_end_become_coarser_and_are_counted() {
    let mut b = with_picture();
    add(&mut b, base(json!({ "index": 0 })), [0., 0., 900., 0., 0., 900.], &[]);
    let loaded = b.read().expect("valid");
    assert!(
        loaded.warnings.iter().any(|w| w.contains("1 triangle repeat")),
        "{:?}",
        loaded.warnings
    );
    let texture = mesh(loaded).texture.expect("kept");
    assert!(texture.pages[0].size().max_element() <= 8192);
}

#[test]
fn materials_of_other_kinds_have_their_colours() {
    let gloss = |content: Value| json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": content } });
    let mut b = with_picture();
    b.json["extensionsRequired"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    add(
        &mut b,
        gloss(json!({ "diffuseTexture": { "index": 0 }, "diffuseFactor": [0.5, 0.5, 0.5, 1] })),
        PLAIN,
        &[],
    );
    add(&mut b, gloss(json!({ "diffuseFactor": [0.8, 0.2, 0.1, 1] })), PLAIN, &[]);
    let black = json!({ "baseColorFactor": [0, 0, 0, 1] });
    add(
        &mut b,
        json!({ "pbrMetallicRoughness": black, "emissiveFactor": [0, 1, 0.5] }),
        PLAIN,
        &[],
    );
    let emits = json!({ "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": 0 }, "pbrMetallicRoughness": black });
    add(&mut b, emits, PLAIN, &[]);
    let mesh = mesh(b.read().expect("valid"));
    shows(&mesh, 0, PLAIN, |_, uv| filtered(uv, repeat) * 0.5);
    shows(&mesh, 1, PLAIN, |_, _| Vec3::new(0.8, 0.2, 0.1));
    shows(&mesh, 2, PLAIN, |_, _| Vec3::new(0.0, 1.0, 0.5));
    shows(&mesh, 3, PLAIN, |_, uv| filtered(uv, repeat));
}

#[test]
fn pictures_in_extensions_are_read_or_named() {
    let mut b = with_picture();
    b.json["textures"][0] = json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } });
    add(&mut b, base(json!({ "index": 0 })), PLAIN, &[]);
    shows(&b.mesh_of(), 0, PLAIN, |_, uv| filtered(uv, repeat));
    for (extension, kind) in [("EXT_texture_avif", "AVIF"), ("KHR_texture_basisu", "KTX2")] {
        b.json["textures"][0] = json!({ "extensions": { extension: { "source": 0 } } });
        let warnings = b.read().expect("valid").warnings;
        assert!(
            warnings.iter().any(|w| w.contains(kind) && w.contains("mesh 0 primitive 0")),
            "{warnings:?}"
        );
        b.json["textures"][0]["source"] = 0.into();
        shows(&b.mesh_of(), 0, PLAIN, |_, uv| filtered(uv, repeat));
    }
}

#[test]
fn gltf_extensions_unknown_and_required_are_refused() {
    let mut b = Builder::triangle();
    b.json["extensionsUsed"] = json!(["KHR_texture_transform", "ACME_shine", "ACME_glow"]);
    let warnings = b.read().expect("valid").warnings;
    assert!(warnings.iter().any(|w| w.contains("ACME_shine, ACME_glow")), "{warnings:?}");
    b.json["extensionsRequired"] = json!(["ACME_glow"]);
    let error = b.read().expect_err("required").to_string();
    assert!(error.contains("ACME_glow"), "{error}");
}

#[test]
fn instances_are_expanded() {
    let mut b = Builder::triangle();
    let at = b.floats("VEC3", &[0., 0., 0., 5., 0., 0., 0., 7., 0.]);
    let scale = b.floats("VEC3", &[1., 1., 1., 2., 2., 2., 1., 1., -1.]);
    let turn =
        b.floats("VEC4", &[0., 0., 0., 1., 0., 0., 0.5f32.sqrt(), 0.5f32.sqrt(), 0., 0., 0., 1.]);
    b.json["nodes"][0]["translation"] = json!([0, 0, 3]);
    b.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing":
        { "attributes": { "TRANSLATION": at, "SCALE": scale, "ROTATION": turn, "_ID": at } } });
    b.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let mesh = b.mesh_of();
    assert_eq!(mesh.face_count(), 3);
    let near = |a: Vec3, b: [f32; 3]| assert!((a - Vec3::from(b)).length() < 1e-5, "{a} {b:?}");
    near(mesh.corners(0)[1], [1.0, 0.0, 3.0]);
    near(mesh.corners(1)[1], [5.0, 2.0, 3.0]);
    near(mesh.corners(2)[1], [0.0, 8.0, 3.0]);
    b.json["accessors"][scale]["count"] = 2.into();
    let error = b.read().expect_err("unequal").to_string();
    assert!(error.contains("node 0") && error.contains("unequal"), "{error}");
}

#[test]
fn gltf_1_is_named() {
    for json in [
        r#"{"asset":{"version":"1.0"},"accessors":{"a":{}},"meshes":{},"nodes":{},"scenes":{},"scene":"s"}"#,
        r#"{"accessors":{},"meshes":{"m":{}},"scene":"s"}"#,
    ] {
        let error = read_bytes(json.as_bytes()).expect_err("old").to_string();
        assert!(error.contains("glTF 1.0: convert it"), "{error}");
    }
}
