//! The stage `texture`: large triangles show what photos show of a scene with much more detail.

use glam::{UVec2, Vec2, Vec3};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_bake::{
    Bake, BakeOptions, TextureDetail, TextureDetails, TextureOptions, TextureWhen, UpChoice, Views,
    refit::UnseenColors, texture,
};
use trisplat_formats::{
    OutputOptions, ReadOptions,
    gltf::{GltfOptions, TextureFormat, to_glb_bytes},
};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Result, Scene, UpAxis, UpDirection,
    camera::Camera,
    image::RgbImage,
    math::metric,
    mesh::{Colors, Mesh},
    report::{Outcome, Report, StageEvent, StageProgress},
};

pub(super) const DRAWING: SolidRasterOptions =
    SolidRasterOptions { background: [0.0; 3], samples: 4, near: 0.01 };
const AUTO: TextureOptions =
    TextureOptions { texture: TextureWhen::Auto, ..TextureOptions::DEFAULT };
pub(super) const ON: TextureOptions =
    TextureOptions { texture: TextureWhen::On, ..TextureOptions::DEFAULT };

/// A wall of `across` by `across` squares of two triangles, 2 wide, with one colour each; slightly
/// bent.
fn wall(across: u32, color: impl Fn(f32, f32) -> [f32; 3]) -> Mesh {
    let at = |i: u32| 2.0 * i as f32 / across as f32 - 1.0;
    let point = |x: u32, y: u32| Vec3::new(at(x), at(y), 0.05 * at(x) * at(x));
    let mut positions = Vec::new();
    let mut colors = Vec::new();
    for (y, x) in (0..across).flat_map(|y| (0..across).map(move |x| (y, x))) {
        let [a, b] = [point(x, y), point(x + 1, y)];
        let [c, d] = [point(x, y + 1), point(x + 1, y + 1)];
        positions.extend([a, b, d, a, d, c]);
        let middle = (a + d) / 2.0;
        colors.extend([color(middle.x, middle.y); 2]);
    }
    Mesh { positions, colors: Colors::Face(colors), ..Mesh::default() }
}

pub(super) fn grey(across: u32) -> Mesh {
    wall(across, |_, _| [0.2; 3])
}

/// Stripes and spots.
pub(super) fn painted() -> Mesh {
    wall(48, |x, y| {
        let wave = |t: f32| 0.5 + 0.4 * (9.0 * t).sin();
        [wave(x), wave(y), if (x - 0.3).hypot(y) < 0.3 { 0.9 } else { 0.1 }]
    })
}

pub(super) fn cameras() -> Vec<Camera> {
    let lens = Camera {
        rotation: glam::Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(150.0),
        center: Vec2::new(64.0, 48.0),
        size: UVec2::new(128, 96),
    };
    let eye = |i: u32| Vec3::new((i % 5) as f32 * 0.4 - 0.8, (i / 5) as f32 * 0.5 - 0.6, -2.5);
    (0..20).map(|i| lens.with_look_at(eye(i), Vec3::ZERO, Vec3::NEG_Y)).collect()
}

pub(super) fn photos() -> Vec<RgbImage> {
    cameras()
        .iter()
        .map(|camera| SolidRasterizer::new().render(&painted(), camera, &DRAWING))
        .collect()
}

pub(super) fn textured(
    mesh: &mut Mesh,
    options: &TextureOptions,
) -> (Result<Outcome<()>>, TextureDetails) {
    let mut views = Views::drawn(cameras(), photos());
    let mut details = TextureDetails::default();
    let outcome = texture(
        mesh,
        Some(&mut views),
        None,
        options,
        &mut details,
        &mut StageProgress::new(&mut |_| Continue(())),
    );
    (outcome, details)
}

/// PSNR of a mesh against the painted wall from between the cameras, dB.
pub(super) fn psnr(mesh: &Mesh) -> f64 {
    let camera = cameras()[0].with_look_at(Vec3::new(0.23, 0.11, -2.4), Vec3::ZERO, Vec3::NEG_Y);
    let [wants, got] =
        [&painted(), mesh].map(|mesh| SolidRasterizer::new().render(mesh, &camera, &DRAWING));
    metric::psnr(&wants.rgb, &got.rgb, None)
}

#[test]
fn few_triangles_show_what_many_do() {
    let mut mesh = grey(4);
    let before = psnr(&mesh);
    let (outcome, details) = textured(&mut mesh, &ON);
    assert_eq!(outcome.unwrap(), Outcome::Changed(()));
    mesh.validate().unwrap();
    let after = psnr(&mesh);
    assert!(after > before + 12.0 && after > 28.0, "{before} {after}");
    assert!(details.psnr_after > details.psnr_before.map(|psnr| psnr + 12.0), "{details:?}");
    // Other renderers draw one fair colour for each triangle.
    assert!(mesh.drop_texture() && psnr(&mesh) > before + 2.0, "{} {before}", psnr(&mesh));
}

#[test]
fn a_part_is_scored_by_the_pixels_that_it_covers() {
    let scores = |background: f32, part: bool| {
        let drawing = SolidRasterOptions { background: [background; 3], ..DRAWING };
        let photo = |camera: &Camera| SolidRasterizer::new().render(&painted(), camera, &drawing);
        let mut views = Views::drawn(cameras(), cameras().iter().map(photo).collect());
        views.show_part(part);
        let mut details = TextureDetails::default();
        let mut observer = |_: StageEvent<'_>| Continue(());
        let mut progress = StageProgress::new(&mut observer);
        texture(&mut grey(4), Some(&mut views), None, &ON, &mut details, &mut progress).unwrap();
        [details.psnr_before, details.psnr_after].map(|psnr| psnr.expect("photos judge"))
    };
    let dark = scores(0.0, true);
    let bright = scores(1.0, true);
    let whole = scores(1.0, false);
    assert!((dark[0] - bright[0]).abs() < 0.2, "what stands behind it counts: {dark:?} {bright:?}");
    // A good texture shows the mixed pixels at its edges.
    assert!(bright[1] > 25.0 && (dark[1] - bright[1]).abs() < 2.0, "{dark:?} {bright:?}");
    assert!(whole[1] < bright[1] - 10.0, "beside it, nothing is drawn: {bright:?} {whole:?}");
}

/// `auto` keeps the colours; who asks for a texture gets one, and is told.
#[test]
fn texture_auto_is_off_for_photos_that_disagree() {
    let grey = || wall(4, |_, _| [0.4; 3]);
    // Every photo is of other stripes, about that grey.
    let striped =
        |i: usize| wall(48, move |x, _| [0.4 + 0.2 * (9.0 * x + 2.4 * i as f32).sin(); 3]);
    let photo = |(i, camera): (usize, &Camera)| {
        SolidRasterizer::new().render(&striped(i), camera, &DRAWING)
    };
    let mut views = Views::drawn(cameras(), cameras().iter().enumerate().map(photo).collect());
    let mut run = |options: &TextureOptions| {
        let mut mesh = grey();
        let mut details = TextureDetails::default();
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let mut progress = StageProgress::new(&mut nobody);
        let outcome =
            texture(&mut mesh, Some(&mut views), None, options, &mut details, &mut progress);
        (outcome.unwrap(), mesh, details)
    };
    let (outcome, mesh, details) = run(&AUTO);
    assert!(matches!(outcome, Outcome::Skipped(why) if why.contains("held-out")), "{details:?}");
    assert!(mesh == grey() && details.psnr_after < details.psnr_before, "{details:?}");
    assert!(details.ssim_after < details.ssim_before, "{details:?}");
    let (outcome, mesh, asked) = run(&ON);
    assert!(outcome == Outcome::Changed(()) && mesh.texture.is_some(), "{asked:?}");
    let warning = asked.warning().unwrap();
    assert!(warning.contains("closer to the photos") && warning.contains("SSIM"), "{warning}");
}

/// Blur wins PSNR: where only that prefers the colours, `auto` writes the texture.
#[test]
fn auto_takes_detail_that_costs_a_little_psnr() {
    // Every photo has the same stripes, a third of a wave beside where the mean of them is.
    let striped = |i: usize| {
        let shift = if i.is_multiple_of(2) { 0.05 } else { -0.05 };
        wall(96, move |x, _| [0.4 + 0.3 * (18.0 * (x + shift)).sin(); 3])
    };
    let photo = |(i, camera): (usize, &Camera)| {
        SolidRasterizer::new().render(&striped(i), camera, &DRAWING)
    };
    let mut views = Views::drawn(cameras(), cameras().iter().enumerate().map(photo).collect());
    let mut mesh = wall(4, |_, _| [0.4; 3]);
    let mut details = TextureDetails::default();
    // The report rates the scene's own colours above texels.
    let unseen = UnseenColors { colors: mesh.colors.clone(), psnr_of_own: Some(60.0) };
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let mut progress = StageProgress::new(&mut nobody);
    let outcome =
        texture(&mut mesh, Some(&mut views), Some(unseen), &AUTO, &mut details, &mut progress);
    assert!(details.psnr_after < details.psnr_before, "{details:?}");
    assert!(details.ssim_after > details.ssim_before, "{details:?}");
    assert!(outcome.unwrap() == Outcome::Changed(()) && details.warning().is_none(), "{details:?}");
}

#[test]
fn colours_that_have_seen_the_held_out_photos_are_no_measure() {
    // The mesh has learnt photos by heart; what was fitted without them is grey.
    let mut mesh = painted();
    let mut details = TextureDetails::default();
    let mut views = Views::drawn(cameras(), photos());
    let grey = wall(48, |_, _| [0.2; 3]).colors;
    let mut unseen = UnseenColors { colors: grey.clone(), psnr_of_own: None };
    let mut run = |unseen: UnseenColors, mesh: &mut Mesh| {
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let mut progress = StageProgress::new(&mut nobody);
        let outcome =
            texture(mesh, Some(&mut views), Some(unseen), &AUTO, &mut details, &mut progress)
                .unwrap();
        (outcome, details.psnr_before.unwrap(), details.psnr_after.unwrap())
    };
    let (outcome, before, after) = run(unseen, &mut mesh);
    assert!(outcome == Outcome::Changed(()) && after > before + 6.0, "{before} {after}");
    assert_eq!(mesh.colors, painted().colors, "what has no texture shows the scene's own");
    // The scene keeps its colours, and they are estimated to be better.
    unseen = UnseenColors { colors: grey, psnr_of_own: Some(99.0) };
    let mut mesh = painted();
    let (outcome, before, _) = run(unseen, &mut mesh);
    assert!(matches!(outcome, Outcome::Skipped(_)) && before == 99.0 && mesh == painted());
}

#[test]
fn the_texture_does_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut mesh = grey(9);
            textured(&mut mesh, &ON).0.unwrap();
            mesh
        })
    };
    assert!(run(1) == run(3));
}

#[test]
fn a_texture_is_as_small_as_it_is_asked_to_be() {
    let (outcome, _) = textured(&mut grey(50), &TextureOptions { texture_size: 64, ..ON });
    assert!(outcome.unwrap_err().to_string().contains("5000 triangles"));
    for most in [64, 128, 4096] {
        let mut mesh = grey(16);
        let (_, details) = textured(&mut mesh, &TextureOptions { texture_size: most, ..ON });
        let [width, height] = details.size.unwrap();
        assert!(
            width <= most && height <= most && width.is_power_of_two() && height.is_power_of_two()
        );
        assert!((most >= 4096) == (details.texels_per_pixel == Some(0.7)), "{details:?}");
        let within = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
        assert!(mesh.texture.unwrap().uvs.as_flattened().iter().all(within));
    }
}

#[test]
fn without_photos_it_says_what_it_wants() {
    let mut details = TextureDetails::default();
    let mut run = |options: &TextureOptions| {
        texture(
            &mut grey(2),
            None,
            None,
            options,
            &mut details,
            &mut StageProgress::new(&mut |_| Continue(())),
        )
    };
    let message = run(&ON).unwrap_err().to_string();
    assert!(message.contains("photos") && message.contains("dataset"), "{message}");
    assert!(matches!(run(&TextureOptions::DEFAULT).unwrap(), Outcome::Skipped(_)));
}

pub(super) fn read(glb: &[u8]) -> ImportedScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, glb).unwrap();
    trisplat_formats::read(&path, &ReadOptions::default()).unwrap()
}

/// A wall with its texture, through the whole bake.
pub(super) fn baked(input: Mesh) -> Asset {
    let mut views = Views::drawn(cameras(), photos());
    let options =
        BakeOptions { texture: ON, ..BakeOptions::preset(trisplat_bake::BakePreset::Fast) };
    Bake::new(&options).photos(&mut views).run([ImportedScene::from(Scene::Mesh(input))]).unwrap()
}

#[test]
fn a_textured_file_reads_back_as_it_was() {
    let asset = baked(grey(4));
    let options = GltfOptions { texture: TextureFormat::Png, ..GltfOptions::default() };
    let Scene::Mesh(back) = read(&to_glb_bytes(&asset, &options).unwrap()).scene else {
        panic!("a mesh")
    };
    let of_asset = asset.mesh.texture.as_ref().unwrap();
    let of_file = back.texture.as_ref().unwrap();
    assert!(of_asset.pages == of_file.pages, "PNG is exact");
    assert_eq!(asset.mesh.positions, back.positions);
    for (a, b) in of_asset.uvs.as_flattened().iter().zip(of_file.uvs.as_flattened()) {
        assert!(a.distance(*b) < 2e-5, "{a} {b}");
    }
    // The colour that would be multiplied with the texture is left out, and JPEG is close.
    let jpeg = to_glb_bytes(&asset, &GltfOptions::default()).unwrap();
    assert!(!String::from_utf8_lossy(&jpeg).contains("COLOR_0"));
    let Scene::Mesh(close) = read(&jpeg).scene else { panic!("a mesh") };
    let [exact, close] =
        [&back, &close].map(|mesh| SolidRasterizer::new().render(mesh, &cameras()[7], &DRAWING));
    assert!(metric::psnr(&exact.rgb, &close.rgb, None) > 38.0);
}

#[test]
fn texture_baked_again_is_kept_where_triangles_stay() {
    let again = |max_triangles: Option<u64>, walls: usize| {
        let mut options = BakeOptions::preset(trisplat_bake::BakePreset::Fast);
        options.prune.max_triangles = max_triangles;
        let mut report = Report::new("bake");
        let inputs: Vec<ImportedScene> =
            (0..walls).map(|_| ImportedScene::from(Scene::Mesh(baked(grey(4)).mesh))).collect();
        let asset = Bake::new(&options).report(&mut report).run(inputs).unwrap();
        (asset.mesh.texture, report.warnings)
    };
    let says = |warnings: &[String]| warnings.iter().any(|warning| warning.contains("texture"));
    let (kept, warnings) = again(None, 1);
    assert!(kept.is_some() && !says(&warnings), "{warnings:?}");
    let (joined, warnings) = again(None, 2);
    assert_eq!((joined.unwrap().pages.len(), kept.unwrap().pages.len()), (2, 1));
    assert!(!says(&warnings), "{warnings:?}");
    let (fewer, warnings) = again(Some(20), 1);
    assert!(fewer.unwrap().uvs.len() == 20 && !says(&warnings), "{warnings:?}");
}

#[test]
fn what_holds_no_texture_is_refused_before_any_work() {
    let mut options = BakeOptions { texture: ON, ..BakeOptions::DEFAULT };
    let message = options.plan_output(Path::new("scene.ply"), None).unwrap_err().to_string();
    assert!(message.contains(".glb"), "{message}");
    for name in ["scene.gltf", "scene.obj", "scene.html", "scene.tileset.json"] {
        options.plan_output(Path::new(name), None).unwrap();
    }
    options.lod.lod = vec![0.5];
    options.tiles.tiles = false;
    options.plan_output(Path::new("scene.glb"), None).unwrap();
}

#[test]
fn levels_have_textures_of_their_own() {
    let bake = |texture: TextureWhen| {
        let mut views = Views::drawn(cameras(), photos());
        let mut options = BakeOptions::preset(trisplat_bake::BakePreset::Fast);
        options.texture.texture = texture;
        options.lod.lod = vec![0.5];
        // The wall stays where the cameras see it.
        options.place.up = UpChoice::Given(UpDirection::Axis(UpAxis::Y));
        Bake::new(&options)
            .photos(&mut views)
            .run([ImportedScene::from(Scene::Mesh(grey(8)))])
            .unwrap()
    };
    let [plain, textured] = [TextureWhen::Off, TextureWhen::On].map(bake);
    let level = |asset: &Asset| asset.levels[0].mesh.clone();
    let before = psnr(&level(&plain));
    let after = psnr(&level(&textured));
    assert!(after > before + 6.0, "{before} {after}");
    let texels = |mesh: &Mesh| mesh.texture.as_ref().unwrap().pages[0].size().element_product();
    let [scene, level] = [&textured.mesh, &level(&textured)].map(texels);
    // Its triangles are half as many, and enlarged.
    assert!(level <= scene, "{level} of {scene}");
}

/// The grey wall as a connected surface.
fn connected(across: u32) -> Mesh {
    let mut mesh = grey(across);
    let mut positions = Vec::<Vec3>::new();
    let mut indices = Vec::new();
    for corner in &mesh.positions {
        let known = positions.iter().position(|p| p == corner).unwrap_or(positions.len());
        if known == positions.len() {
            positions.push(*corner);
        }
        indices.push(known as u32);
    }
    mesh.colors = Colors::Vertex(vec![[0.2; 3]; positions.len()]);
    mesh.positions = positions;
    mesh.indices = indices;
    mesh
}

#[test]
fn a_connected_surface_stays_connected_and_is_painted_in_charts() {
    let mut mesh = connected(4);
    let before = psnr(&mesh);
    let (outcome, details) = textured(&mut mesh, &ON);
    assert_eq!(outcome.unwrap(), Outcome::Changed(()));
    mesh.validate().unwrap();
    assert_eq!(
        (details.charts, mesh.face_count(), mesh.vertex_count()),
        (Some(1), 32, 25),
        "{details:?}"
    );
    let after = psnr(&mesh);
    assert!(after > before + 12.0 && after > 28.0, "{before} {after}");
    // Vertices are shared in files, too.
    let options = GltfOptions { texture: TextureFormat::Png, ..GltfOptions::default() };
    let Scene::Mesh(back) =
        read(&to_glb_bytes(&Asset::from(mesh.clone()), &options).unwrap()).scene
    else {
        panic!("a mesh")
    };
    assert_eq!((back.vertex_count(), back.indices.len()), (25, 96));
    assert!((psnr(&back) - after).abs() < 0.2);
}

/// Two halves of a wall: photos of even number are brighter than the others, and each shows one
/// half only.
#[test]
fn the_best_photos_meet_without_a_seam() {
    let half = |view: usize| if view.is_multiple_of(2) { -1.0f32 } else { 1.0 };
    let exposed = |(view, camera): (usize, &Camera)| {
        let mut photo = SolidRasterizer::new().render(&painted(), camera, &DRAWING);
        let gain = 1.0 + 0.12 * half(view);
        photo.rgb.iter_mut().for_each(|p| *p = p.map(|c| (f32::from(c) * gain).min(255.0) as u8));
        photo
    };
    let run = |detail: TextureDetail| {
        let photos: Vec<RgbImage> = cameras().iter().enumerate().map(exposed).collect();
        let mut views = Views::drawn(cameras(), photos);
        let mut details = TextureDetails::default();
        let mut mesh = connected(8);
        let options = TextureOptions { texture_detail: detail, ..ON };
        texture(
            &mut mesh,
            Some(&mut views),
            None,
            &options,
            &mut details,
            &mut StageProgress::new(&mut |_| Continue(())),
        )
        .unwrap();
        (psnr(&mesh), details)
    };
    let [(mean, _), (best, details)] = [TextureDetail::Mean, TextureDetail::Best].map(run);
    assert!(details.best_photos > Some(1), "{details:?}");
    // Without levelling the photos' exposures would cost several dB.
    assert!(best > mean - 1.0, "{mean} {best}");
}

#[test]
fn obj_files_hold_the_texture_beside_them() {
    for mesh in [grey(4), connected(4)] {
        let mut mesh = mesh;
        textured(&mut mesh, &ON).0.unwrap();
        let wants = psnr(&mesh);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a wall.obj");
        let options =
            OutputOptions { texture_format: TextureFormat::Png, ..OutputOptions::default() };
        let written = trisplat_formats::write(&Asset::from(mesh.clone()), &path, &options).unwrap();
        let mut names: Vec<_> =
            written.files.iter().map(|f| f.path.rsplit('/').next().unwrap()).collect();
        names.sort_unstable();
        assert_eq!(names, ["a wall.mtl", "a wall.obj", "a wall.png"]);
        let back = trisplat_formats::read(&path, &ReadOptions::default()).unwrap();
        assert_eq!(back.warnings, [""; 0]);
        let Scene::Mesh(back) = back.scene else { panic!("a mesh") };
        assert_eq!((&back.positions, &back.indices), (&mesh.positions, &mesh.indices));
        assert!(
            mesh.texture.unwrap().pages == back.texture.as_ref().unwrap().pages,
            "PNG is exact"
        );
        assert!((psnr(&back) - wants).abs() < 0.1);
    }
}
