//! The metrics against values from independent implementations on the same PNG files:
//! reference.py writes them.

use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn picture(name: &str) -> RgbImage {
    let own = here("crates/scene/tests/metric").join(name);
    let path = if own.exists() { own } else { here("samples/dataset/images").join(name) };
    RgbImage::load(&path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn metrics_equal_scikit_image_and_flip_evaluator() {
    let text = std::fs::read_to_string(here("crates/scene/tests/metric/reference.json")).unwrap();
    let values: Value = serde_json::from_str(&text).unwrap();
    let pairs = values["pairs"].as_array().unwrap();
    assert_eq!(pairs.len(), 4);
    for pair in pairs {
        let [a, b] = ["reference", "test"].map(|key| picture(pair[key].as_str().unwrap()));
        let check = |key: &str, ours: f64, tolerance: f64| {
            let theirs = pair[key].as_f64().unwrap();
            assert!((ours - theirs).abs() < tolerance, "{pair}: {key} {ours}");
        };
        check("psnr", metric::psnr(&a.rgb, &b.rgb, None), 1e-9);
        check("ssim", metric::ssim(a.size, &a.rgb, &b.rgb, None), 1e-9);
        // In f32, by both.
        check("flip", metric::flip(a.size, &a.rgb, &b.rgb, None), 1e-4);
    }
}

/// Photos and trained scenes of others, where they are at hand.
#[test]
fn metrics_equal_torch_on_pictures_of_others() {
    let folder = here("../shared/metrics");
    let Ok(text) = std::fs::read_to_string(folder.join("reference_values.json")) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED (no ../shared/metrics)");
        return;
    };
    let pairs: serde_json::Map<String, Value> = serde_json::from_str(&text).unwrap();
    assert!(pairs.len() >= 6);
    for (pair, want) in &pairs {
        let (a, b) = pair.split_once('|').unwrap();
        let [a, b] =
            [a, b].map(|stem| RgbImage::load(&folder.join(format!("ref/{stem}.png"))).unwrap());
        let want = |key: &str| want[key].as_f64().unwrap();
        let psnr = metric::psnr(&a.rgb, &b.rgb, None);
        let ssim = metric::ssim(a.size, &a.rgb, &b.rgb, None);
        let flip = metric::flip(a.size, &a.rgb, &b.rgb, None);
        // The reference values were computed in f32.
        assert!((psnr - want("psnr")).abs() < 1e-5, "{pair}: psnr {psnr}, want {}", want("psnr"));
        assert!(
            (ssim - want("ssim_3dgs")).abs() < 1e-6,
            "{pair}: ssim {ssim}, want {}",
            want("ssim_3dgs")
        );
        assert!((flip - want("flip_ldr_mean")).abs() < 1e-4, "{pair}: flip {flip}");
    }
}
