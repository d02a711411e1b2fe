//! A soft object that was trained on black or white has triangles of that colour around it.

use super::hostile::{random_triangle, soup_of};
use super::teacher::{baked_with, ball, cameras, skipped};
use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    BackgroundDetails, BackgroundFrom, BackgroundOptions, BakeOptions, BakePreset, ReshapeOptions,
    refit::RefitColors,
};
use trisplat_job::{BakeInput, BakeJob};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{Asset, ImportedScene, Soup, camera::Camera, math::metric};
use trisplat_teacher::{Background, Teacher};

const BLACK: [f32; 3] = [0.0; 3];
const WHITE: [f32; 3] = [1.0; 3];
/// Triangles of the ball.
const BALL: usize = 3000;

/// Cameras that see all of the ball, and what is around it.
fn eyes() -> Vec<Camera> {
    cameras()
        .iter()
        .map(|camera| camera.with_look_at(camera.position() * 1.7, Vec3::ZERO, Vec3::NEG_Y))
        .collect()
}

/// Triangles of one colour far behind the ball, for every camera.
fn shards(rgb: [f32; 3]) -> Soup {
    let place = |i: u64| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
        let angle = i as f32 * 2.399_963;
        let radius = (1.0 - y * y).sqrt();
        Vec3::new(radius * angle.cos(), y, radius * angle.sin()) * 8.0
    };
    colored(soup_of((0..1000).map(|i| (random_triangle(i, place(i), 3.0), 0.9, 0.3))), rgb)
}

/// The same in one colour.
fn colored(mut soup: Soup, rgb: [f32; 3]) -> Soup {
    soup.sh.fill(rgb.map(|c| (c - 0.5) / 0.282_094_8));
    soup
}

/// The ball among triangles of the colour it was trained on.
fn trained_on(rgb: [f32; 3]) -> Soup {
    among_shards(ball(), rgb)
}

fn among_shards(mut object: Soup, rgb: [f32; 3]) -> Soup {
    object.append(shards(rgb));
    object
}

/// A ball of fewer and fainter triangles, for which some steps are enough.
fn faint_ball() -> Soup {
    let mut soup = ball();
    soup.retain(|i| i % 2 == 0);
    soup.opacity.fill(0.5);
    soup.sigma.fill(0.8);
    soup
}

fn baked(
    soup: Soup,
    background: BackgroundFrom,
) -> (Asset, Option<BackgroundDetails>, Option<String>) {
    let background = BackgroundOptions { background };
    let scene = ImportedScene { cameras: eyes(), ..ImportedScene::from(soup) };
    let (asset, report) = baked_with(scene, BakeOptions { background, ..BakeOptions::default() });
    (asset, report.details(), skipped(&report, "background").map(str::to_owned))
}

/// Cameras between those of the scene.
fn between() -> impl Iterator<Item = Camera> {
    (0..15_u8).map(|i| {
        let angle = f32::from(i) * 0.4 + 0.2;
        let eye = Vec3::new(angle.sin(), 0.1, angle.cos()) * 5.0;
        eyes()[0].with_look_at(eye, Vec3::ZERO, Vec3::NEG_Y)
    })
}

/// A baked scene over a colour, against the soft `object` alone over that colour, from between the
/// cameras: PSNR, dB, and the share of the pixels beside the object that do not show the colour.
fn over(asset: &Asset, object: &Soup, background: [f32; 3]) -> (f64, f64) {
    let drawn = |background| SoftOptions { background, ..SoftOptions::default() };
    let soft = |background| Teacher::new(object.clone(), &eyes(), &drawn(background));
    let [mut own, mut black, mut white] = [background, BLACK, WHITE].map(soft);
    let drawing = SolidRasterOptions { background, samples: 4, ..SolidRasterOptions::default() };
    let color = background.map(|c| (c * 255.0) as u8);
    let mut psnr = 0.0;
    let mut beside = 0;
    let mut shards = 0;
    for camera in between() {
        let solid = SolidRasterizer::new().render(&asset.mesh, &camera, &drawing);
        psnr += metric::psnr(&own.picture(&camera).rgb, &solid.rgb, None) / 15.0;
        // The background shows through where the object is not.
        let dark = black.picture(&camera);
        let light = white.picture(&camera);
        let is_empty = |(dark, light): (&[u8; 3], &[u8; 3])| light[0].abs_diff(dark[0]) > 242;
        for (pixel, _) in solid
            .rgb
            .iter()
            .zip(dark.rgb.iter().zip(&light.rgb))
            .filter(|(_, pair)| is_empty(*pair))
        {
            beside += 1;
            shards += u32::from((0..3).any(|c| pixel[c].abs_diff(color[c]) > 25));
        }
    }
    (psnr, f64::from(shards) / f64::from(beside))
}

#[test]
fn no_background_can_tell_which_one_an_object_was_trained_on() {
    let object = ball();
    for (own, other, name) in [(BLACK, WHITE, "black"), (WHITE, BLACK, "white")] {
        let (asset, details, skipped) = baked(trained_on(own), BackgroundFrom::Auto);
        let found = BackgroundDetails { object: true, color: Some(name.parse().unwrap()) };
        assert_eq!((details, skipped), (Some(found), None));
        let (with_shards, ..) = baked(trained_on(own), BackgroundFrom::Off);
        let (psnr, _) = over(&asset, &object, own);
        let (_, shards) = over(&asset, &object, other);
        let (_, before) = over(&with_shards, &object, other);
        assert!(psnr > 23.5, "{name}: {psnr:.2} dB");
        assert!(before > 0.5 && shards < 0.1, "{name}: shards {before:.3} before, {shards:.3} now");
    }
}

/// The same, trained solid for some steps on its own pictures. Fitting has tests of its own:
/// without it, so few steps are worth keeping.
fn hardened(soup: Soup, background: BackgroundFrom) -> Asset {
    let mut options = BakeOptions {
        background: BackgroundOptions { background },
        reshape: ReshapeOptions::OFF,
        ..BakeOptions::default()
    };
    options.place.up = "y".parse().unwrap();
    options.prune.max_triangles = Some(2000);
    options.refit.refit = RefitColors::Off;
    let scene = ImportedScene { cameras: eyes(), ..ImportedScene::from(soup) };
    let mut job = BakeJob::new([BakeInput::scene(scene)], options);
    job.harden = Some(400);
    job.run(&mut |_| Continue(())).unwrap().asset
}

#[test]
fn hardening_grows_no_shards_of_the_background() {
    let object = faint_ball();
    for (own, other, name) in [(BLACK, WHITE, "black"), (WHITE, BLACK, "white")] {
        let soup = among_shards(faint_ball(), own);
        let [asset, with_shards] =
            [BackgroundFrom::Auto, BackgroundFrom::Off].map(|from| hardened(soup.clone(), from));
        let (psnr, _) = over(&asset, &object, own);
        let (psnr_off, _) = over(&with_shards, &object, own);
        let (_, shards) = over(&asset, &object, other);
        let (_, before) = over(&with_shards, &object, other);
        // Training itself removes some: those that stand before a camera that does not show them.
        assert!(before > 0.3 && shards < 0.1, "{name}: shards {before:.3} before, {shards:.3} now");
        assert!(psnr > psnr_off - 0.7, "{name}: {psnr:.2} dB, {psnr_off:.2} dB with shards");
    }
}

#[test]
fn only_what_shows_the_background_alone_goes() {
    let found = Background::of(&trained_on(BLACK), &eyes(), None).unwrap();
    assert_eq!(found.rgb, Some(BLACK));
    let [ball_kept, shards_kept] = [&found.is_object[..BALL], &found.is_object[BALL..]]
        .map(|of| of.iter().filter(|kept| **kept).count());
    // No camera sees some of the shards.
    assert!(ball_kept == BALL && shards_kept < 450, "{ball_kept} {shards_kept}");
    // A black plate hides the ball: without it, pictures change.
    let corner = |x: f32, y: f32| Vec3::new(x, y, 1.3);
    let plate = [corner(-0.6, -0.6), corner(0.6, -0.6), corner(0.0, 0.7)];
    let mut marked = trained_on(BLACK);
    marked.append(colored(soup_of([(plate, 0.99, 0.05)]), BLACK));
    let found = Background::of(&marked, &eyes(), None).unwrap();
    assert_eq!(found.is_object.last(), Some(&true));
    // A given colour overrules the pictures: on white, black triangles are an object.
    let given = Background::of(&trained_on(BLACK), &eyes(), Some(WHITE)).unwrap();
    assert!(given.is_object.iter().all(|object| *object));
}

#[test]
fn scenes_that_fill_their_pictures_stay_as_they_are() {
    // Colours of the surroundings differ.
    let mut surrounded = ball();
    let mut around = shards(BLACK);
    around.sh = soup_of(around.vertices.iter().map(|corners| (*corners, 0.9, 0.3))).sh;
    surrounded.append(around);
    let (auto, details, why) = baked(surrounded.clone(), BackgroundFrom::Auto);
    assert_eq!(why.as_deref(), Some("the borders of its pictures have no common colour"));
    assert_eq!(details, None);
    assert!(auto.mesh == baked(surrounded, BackgroundFrom::Off).0.mesh);
    // Without shards there is nothing to drop; the pictures show the object alone.
    let (.., details, why) = baked(ball(), BackgroundFrom::Auto);
    assert_eq!(details, Some(BackgroundDetails { object: true, color: None }));
    assert_eq!(why.as_deref(), Some("no triangle shows the background alone"));
    assert_eq!(BakeOptions::preset(BakePreset::Fast).background, BackgroundOptions::OFF);
}
