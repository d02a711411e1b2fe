//! The graphics card's pictures against a ray caster in f64. Without a card, software Vulkan serves
//! (Debian: mesa-vulkan-drivers); without that too, tests say so and pass, unless
//! TRISPLAT_REQUIRE_GPU=1.

use glam::{DVec3, Mat3, UVec2, Vec2, Vec3};
use trisplat_bake::{BakeOptions, BakePreset, bake};
use trisplat_gpu::AdapterOptions;
use trisplat_raster::solid::view_colors;
use trisplat_scene::{
    Asset, Chunk, Error, FaceSh, ImportedScene, Rng, Scene,
    camera::Camera,
    image::RgbImage,
    math::color::{linear_from_srgb, srgb_from_linear},
    mesh::{Colors, Mesh},
};
use trisplat_view::{FrameParams, Headless};

/// A card, or `None` after saying loudly that there is none.
pub(super) fn card() -> Option<Headless> {
    match Headless::new(&AdapterOptions::default()) {
        Ok(headless) => Some(headless),
        Err(why) => {
            let required = std::env::var("TRISPLAT_REQUIRE_GPU").is_ok_and(|v| v == "1");
            assert!(!required, "TRISPLAT_REQUIRE_GPU=1, but {why}");
            trisplat_fixtures::skip::skipped(&format!("no adapter: {why}"));
            None
        }
    }
}

const SIZE: UVec2 = UVec2::new(160, 120);
const BACKGROUND: [f32; 3] = [0.2, 0.4, 0.6];
const NEAR: f32 = 0.05;

fn camera() -> Camera {
    Camera {
        rotation: Mat3::from_rotation_y(0.3) * Mat3::from_rotation_x(-0.2),
        translation: Vec3::new(0.1, -0.2, 2.5),
        focal: Vec2::new(130.0, 128.0),
        center: Vec2::new(83.3, 57.1),
        size: SIZE,
    }
}

/// `count` triangles of all sizes about the origin, some through the near plane, one colour each.
fn triangles(count: usize, seed: u64) -> Mesh {
    let rng = Rng::new(seed, "view test", 0);
    let draw = |i: usize| rng.uniform_f64(i as u64) as f32;
    let vec = |i: usize| Vec3::new(draw(i), draw(i + 1), draw(i + 2)) - 0.5;
    let mut mesh = Mesh::default();
    let mut colors = Vec::new();
    for face in 0..count {
        let first = 20 * face;
        // Every tenth is a long sliver, many of them through the near plane.
        let long = if face % 10 == 0 { 12.0 } else { 1.0 };
        let scale = 0.05 + 0.6 * draw(first + 12).powi(3);
        let center = 2.0 * vec(first);
        mesh.positions.extend(
            [3, 6, 9].map(|k| center + if k == 3 { long } else { 1.0 } * scale * vec(first + k)),
        );
        colors.push([13, 14, 15].map(|k| linear_from_srgb(draw(first + k))));
    }
    mesh.colors = Colors::Face(colors);
    mesh
}

/// The same faces with indices, every vertex shared by two of them, coloured by vertex.
fn indexed(count: usize) -> Mesh {
    let faces = triangles(count, 7);
    let mut indices = Vec::new();
    let vertices = faces.positions.len() as u32;
    for face in 0..count as u32 {
        indices.extend([3 * face, 3 * face + 1, (3 * face + 5) % vertices]);
    }
    let rng = Rng::new(8, "view test", 1);
    let color =
        |v: usize| [0, 1, 2].map(|k| linear_from_srgb(rng.uniform_f64((3 * v + k) as u64) as f32));
    Mesh {
        colors: Colors::Vertex((0..faces.positions.len()).map(color).collect()),
        indices,
        ..faces
    }
}

fn asset(mesh: Mesh) -> Asset {
    let count = mesh.face_count() as u32;
    Asset { mesh, chunks: vec![Chunk { first: 0, count }], ..Asset::default() }
}

/// The first thing on a pixel's ray, and its linear colour. `None` is background.
fn cast(mesh: &Mesh, camera: &Camera, at: Vec2) -> Option<(usize, [f64; 3])> {
    let rotation = camera.rotation.as_dmat3();
    let ray = ((at - camera.center) / camera.focal).as_dvec2().extend(1.0);
    let mut best: Option<(f64, usize, [f64; 3])> = None;
    for face in 0..mesh.face_count() {
        let [a, b, c] =
            mesh.corners(face).map(|v| rotation * v.as_dvec3() + camera.translation.as_dvec3());
        let across = ray.cross(c - a);
        let inverse = 1.0 / (b - a).dot(across);
        let u = -a.dot(across) * inverse;
        let q = (-a).cross(b - a);
        let v = ray.dot(q) * inverse;
        let t = (c - a).dot(q) * inverse;
        // Both axes of the picture are those of a camera that looks along +z with y down: fronts
        // turn clockwise about the ray.
        let is_back = (b - a).cross(c - a).dot(ray) > 0.0;
        if is_back && mesh.is_single_sided(face) {
            continue;
        }
        let hit = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= f64::from(NEAR);
        if hit && best.is_none_or(|(nearest, ..)| t < nearest) {
            let [p, q, r] = mesh.corner_colors(face).map(|c| DVec3::from(c.map(f64::from)));
            best = Some((t, face, (p * (1.0 - u - v) + q * u + r * v).to_array()));
        }
    }
    best.map(|(_, face, color)| (face, color))
}

/// Faces (0 = background) and 8-bit colours of every pixel.
fn reference(mesh: &Mesh, camera: &Camera) -> (Vec<usize>, RgbImage) {
    let mut faces = Vec::new();
    let mut rgb = Vec::new();
    for i in 0..camera.size.element_product() {
        let at = Vec2::new((i % camera.size.x) as f32 + 0.5, (i / camera.size.x) as f32 + 0.5);
        let hit = cast(mesh, camera, at);
        faces.push(hit.map_or(0, |(face, _)| face + 1));
        let code = |c: f64| (srgb_from_linear(c as f32) * 255.0).round() as u8;
        let background = BACKGROUND.map(|c| (c * 255.0).round() as u8);
        rgb.push(hit.map_or(background, |(_, color)| color.map(code)));
    }
    (faces, RgbImage { size: camera.size, rgb, alpha: None })
}

/// Largest difference of a pixel.
fn off(a: [u8; 3], b: [u8; 3]) -> u8 {
    (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0)
}

/// Within a face all pixels agree to one code; along edges, where the card rounds corners to 1/256
/// of a pixel, few differ.
fn assert_agrees(name: &str, got: &RgbImage, faces: &[usize], wants: &RgbImage) {
    let width = wants.size.x as usize;
    let inside = |i: usize| {
        let near = [i, i.wrapping_sub(1), i + 1, i.wrapping_sub(width), i + width];
        near.iter().all(|&n| faces.get(n).is_none_or(|f| *f == faces[i]))
    };
    let wrong: Vec<usize> =
        (0..faces.len()).filter(|&i| off(got.rgb[i], wants.rgb[i]) > 1).collect();
    let lost = wrong.iter().filter(|&&i| inside(i)).count();
    if lost > 0 || wrong.len() * 100 > faces.len() {
        let folder = std::env::temp_dir();
        got.save_png(folder.join(format!("{name}-got.png"))).unwrap();
        wants.save_png(folder.join(format!("{name}-wants.png"))).unwrap();
        panic!(
            "{name}: {} of {} pixels differ, {lost} inside faces; see {folder:?}",
            wrong.len(),
            faces.len()
        );
    }
}

fn params(camera: &Camera) -> FrameParams {
    FrameParams { background: BACKGROUND, near: NEAR, ..FrameParams::new(camera) }
}

#[test]
fn solid_colours_of_faces_and_vertices_are_exact() {
    let Some(mut card) = card() else { return };
    let camera = camera();
    for (name, mesh) in [("faces", triangles(600, 3)), ("vertices", indexed(300))] {
        let (ids, wants) = reference(&mesh, &camera);
        let seen: std::collections::BTreeSet<_> = ids.iter().collect();
        assert!(seen.len() > 80, "only {} faces are in view", seen.len());
        let asset = asset(mesh);
        let model = card.upload(&asset).unwrap();
        let (got, drawn) = card.render(&model, &params(&camera)).unwrap();
        assert_eq!(drawn.triangles, asset.mesh.face_count() as u64);
        assert_agrees(name, &got, &ids, &wants);
    }
}

#[test]
fn harmonics_on_the_card_are_those_of_the_cpu() {
    let Some(mut card) = card() else { return };
    let camera = camera();
    for degree in 1..=3 {
        let mut mesh = triangles(600, 3);
        let width = usize::from(degree + 1).pow(2);
        let rng = Rng::new(9, "view test", u64::from(degree));
        let value = |i: usize| 0.3 * rng.uniform(i as u64) - 0.15;
        let coefficients = (0..600 * width).map(|i| [0, 1, 2].map(|c| value(3 * i + c))).collect();
        mesh.sh = Some(FaceSh::new(degree, coefficients).unwrap());
        let colors = view_colors(&mesh, camera.position()).unwrap();
        let (ids, wants) = reference(&Mesh { colors, ..mesh.clone() }, &camera);
        let plain = reference(&mesh, &camera).1;
        assert!(plain.rgb.iter().zip(&wants.rgb).any(|(a, b)| off(*a, *b) > 20));
        let model = card.upload(&asset(mesh)).unwrap();
        let (got, _) = card.render(&model, &params(&camera)).unwrap();
        assert_agrees(&format!("harmonics-{degree}"), &got, &ids, &wants);
    }
}

#[test]
fn models_take_the_bytes_they_promise() {
    let Some(card) = card() else { return };
    assert_eq!(card.upload(&asset(triangles(1000, 3))).unwrap().bytes, 48_000);
    assert_eq!(card.upload(&asset(indexed(1000))).unwrap().bytes, 3000 * 16 + 1000 * 12);
    let mut faces = indexed(1000);
    faces.colors = Colors::Face(vec![[0.5; 3]; 1000]);
    assert!(matches!(card.upload(&asset(faces)), Err(Error::Invalid { .. })));
}

/// The mean of `side` times `side` pixels of a picture in linear light.
fn averaged(fine: &RgbImage, side: u32) -> RgbImage {
    let size = fine.size / side;
    let mean = |i: u32| {
        let x = side * (i % size.x);
        let y = side * (i / size.x);
        let sample = |k: u32| fine.rgb[((y + k / side) * fine.size.x + x + k % side) as usize];
        let linear = |c: usize| {
            (0..side * side).map(move |k| linear_from_srgb(f32::from(sample(k)[c]) / 255.0))
        };
        [0, 1, 2].map(|c| {
            (srgb_from_linear(linear(c).sum::<f32>() / (side * side) as f32) * 255.0).round() as u8
        })
    };
    RgbImage { size, rgb: (0..size.element_product()).map(mean).collect(), alpha: None }
}

#[test]
fn multisampling_comes_nearer_to_the_average() {
    let Some(mut card) = card() else { return };
    let asset = asset(triangles(120, 5));
    let model = card.upload(&asset).unwrap();
    let mut draw = |side, msaa| {
        let params = FrameParams { msaa, ..params(&camera().resized(SIZE * side)) };
        card.render(&model, &params).unwrap().0
    };
    let truth = averaged(&draw(8, 1), 8);
    let one = draw(1, 1);
    let four = draw(1, 4);
    let error = |p: &RgbImage| -> u64 {
        p.rgb.iter().zip(&truth.rgb).map(|(a, b)| u64::from(off(*a, *b)).pow(2)).sum()
    };
    assert!(error(&four) * 3 < error(&one), "{} is not far below {}", error(&four), error(&one));
}

#[test]
fn single_sided_faces_are_drawn_from_their_front_only() {
    let Some(mut card) = card() else { return };
    for mut mesh in [triangles(300, 4), indexed(60)] {
        let faces = mesh.face_count();
        let both = reference(&mesh, &camera()).0;
        mesh.single_sided = (0..faces).map(|face| face % 3 > 0).collect();
        let (faces, wants) = reference(&mesh, &camera());
        assert!(faces.iter().zip(&both).filter(|(one, both)| one != both).count() > 500);
        let model = card.upload(&asset(mesh)).unwrap();
        let (got, _) = card.render(&model, &params(&camera())).unwrap();
        let close = got.rgb.iter().zip(&wants.rgb).filter(|(a, b)| off(**a, **b) <= 2).count();
        assert!(close * 100 >= got.rgb.len() * 99, "{close} of {}", got.rgb.len());
    }
}

#[test]
fn culling_chunks_does_not_change_the_picture() {
    let Some(mut card) = card() else { return };
    let scene = Scene::Mesh(triangles(4000, 11));
    let loaded = ImportedScene {
        scene,
        provenance: Default::default(),
        warnings: Vec::new(),
        cameras: Vec::new(),
    };
    let mut baked = BakeOptions::preset(BakePreset::Fast);
    baked.chunk.chunk_triangles = 64;
    let chunked = bake(loaded, &baked).unwrap();
    assert!(chunked.chunks.len() > 50);
    let camera = Camera { focal: Vec2::splat(500.0), ..camera() };
    let whole = asset(chunked.mesh.clone());
    let [chunked_model, whole_model] = [&chunked, &whole].map(|asset| card.upload(asset).unwrap());
    let (few, drawn) = card.render(&chunked_model, &params(&camera)).unwrap();
    assert!(drawn.triangles < 3000, "{} triangles drawn", drawn.triangles);
    let (all, _) = card.render(&whole_model, &params(&camera)).unwrap();
    assert!(few.rgb.iter().zip(&all.rgb).all(|(a, b)| off(*a, *b) <= 1));
}

#[test]
fn what_a_card_cannot_do_is_an_error_that_says_so() {
    let Some(mut card) = card() else { return };
    let missing =
        AdapterOptions { adapter: Some("no such card".into()), ..AdapterOptions::default() };
    let said = Headless::new(&missing).unwrap_err().to_string();
    assert!(
        said.contains("adapter is no such card") && said.contains(&card.gpu.info.name),
        "{said}"
    );
    let model = card.upload(&asset(triangles(3, 1))).unwrap();
    let huge = camera().resized(UVec2::new(60_000, 2_000));
    let said = card.render(&model, &params(&huge)).unwrap_err().to_string();
    assert!(said.contains("60000x2000") && said.contains(&card.gpu.info.name), "{said}");
    card.gpu.device.destroy();
    let said = card.render(&model, &params(&camera())).unwrap_err().to_string();
    assert!(said.starts_with("gpu: "), "{said}");
}

#[test]
fn nothing_to_draw_is_background() {
    let Some(mut card) = card() else { return };
    let model = card.upload(&Asset::default()).unwrap();
    let (got, drawn) = card.render(&model, &params(&camera())).unwrap();
    assert_eq!((drawn.triangles, drawn.draws), (0, 0));
    assert!(got.rgb.iter().all(|p| *p == [51, 102, 153]));
}
