//! A soft object that was trained on black or white has triangles of that colour around it.

use super::hostile::soup_of;
use super::teacher::{baked_with, skipped};
use glam::Vec3;
use trisplat_bake::{
    BackgroundDetails, BackgroundFrom, BackgroundOptions, BakeOptions, BakePreset,
};
use trisplat_fixtures::soups::{ball, cameras_between, colored, distant_cameras, shards};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{Asset, ImportedScene, Soup, math::metric};
use trisplat_teacher::{ObjectBackground, Teacher};

const BLACK: [f32; 3] = [0.0; 3];
const WHITE: [f32; 3] = [1.0; 3];
/// Triangles of the ball.
const BALL: usize = 3000;

/// The ball among triangles of the colour it was trained on.
fn trained_on(rgb: [f32; 3]) -> Soup {
    let mut object = ball();
    object.append(shards(rgb));
    object
}

fn baked(
    soup: Soup,
    background: BackgroundFrom,
) -> (Asset, Option<BackgroundDetails>, Option<String>) {
    let background = BackgroundOptions { background };
    let scene = ImportedScene { cameras: distant_cameras(), ..ImportedScene::from(soup) };
    let (asset, report) = baked_with(scene, BakeOptions { background, ..BakeOptions::default() });
    (asset, report.details(), skipped(&report, "background").map(str::to_owned))
}

/// A baked scene over a colour, against the soft `object` alone over that colour, from between the
/// cameras: PSNR, dB, and the share of the pixels beside the object that do not show the colour.
fn over(asset: &Asset, object: &Soup, background: [f32; 3]) -> (f64, f64) {
    let drawn = |background| SoftOptions { background, ..SoftOptions::default() };
    let soft = |background| Teacher::new(object.clone(), &distant_cameras(), &drawn(background));
    let [mut own, mut black, mut white] = [background, BLACK, WHITE].map(soft);
    let drawing = SolidRasterOptions { background, samples: 4, ..SolidRasterOptions::default() };
    let color = background.map(|c| (c * 255.0) as u8);
    let mut psnr = 0.0;
    let mut beside = 0;
    let mut shards = 0;
    for camera in cameras_between() {
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

#[test]
fn only_what_shows_the_background_alone_goes() {
    let found = ObjectBackground::of(&trained_on(BLACK), &distant_cameras(), None).unwrap();
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
    let found = ObjectBackground::of(&marked, &distant_cameras(), None).unwrap();
    assert_eq!(found.is_object.last(), Some(&true));
    // A given colour overrules the pictures: on white, black triangles are an object.
    let given = ObjectBackground::of(&trained_on(BLACK), &distant_cameras(), Some(WHITE)).unwrap();
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
