//! Hardening of a soft scene by its own pictures.

use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    BackgroundFrom, BackgroundOptions, BakeOptions, ReshapeOptions, refit::RefitColors,
};
use trisplat_fixtures::soups::{ball, cameras_between, distant_cameras, shards};
use trisplat_job::{BakeInput, BakeJob};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{Asset, ImportedScene, Soup, math::metric};
use trisplat_teacher::Teacher;

const BLACK: [f32; 3] = [0.0; 3];
const WHITE: [f32; 3] = [1.0; 3];

/// A ball of fewer and fainter triangles, for which some steps are enough.
fn faint_ball() -> Soup {
    let mut soup = ball();
    soup.retain(|i| i % 2 == 0);
    soup.opacity.fill(0.5);
    soup.sigma.fill(0.8);
    soup
}

fn among_shards(mut object: Soup, rgb: [f32; 3]) -> Soup {
    object.append(shards(rgb));
    object
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

/// The bake of a soup, trained solid for some steps on its own pictures. Fitting has tests of its
/// own: without it, so few steps are worth keeping.
fn hardened(soup: Soup, background: BackgroundFrom) -> Asset {
    let mut options = BakeOptions {
        background: BackgroundOptions { background },
        reshape: ReshapeOptions::OFF,
        ..BakeOptions::default()
    };
    options.place.up = "y".parse().unwrap();
    options.prune.max_triangles = Some(2000);
    options.refit.refit = RefitColors::Off;
    let scene = ImportedScene { cameras: distant_cameras(), ..ImportedScene::from(soup) };
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
