//! The metrics against values from an independent implementation on the same PNG files.

#![allow(clippy::print_stderr, reason = "a skipped test says so")]

use std::path::Path;
use trisplat::image::Pixels;
use trisplat::math::metric;

const METRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/metrics");

#[test]
fn metrics_equal_the_reference_values() {
    let folder = Path::new(METRICS);
    let Ok(text) = std::fs::read_to_string(folder.join("reference_values.json")) else {
        eprintln!("SKIPPED (no ../shared/metrics)");
        return;
    };
    let pairs: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).unwrap();
    assert!(pairs.len() >= 6);
    for (pair, want) in &pairs {
        let (a, b) = pair.split_once('|').unwrap();
        let [a, b] = [a, b].map(|stem| Pixels::load(&folder.join(format!("ref/{stem}.png"))).unwrap());
        let want = |key: &str| want[key].as_f64().unwrap();
        let psnr = metric::psnr(&a.rgb, &b.rgb, None);
        let ssim = metric::ssim(a.size, &a.rgb, &b.rgb, None);
        let flip = metric::flip(a.size, &a.rgb, &b.rgb, None);
        // The reference values were computed in f32.
        assert!((psnr - want("psnr")).abs() < 1e-5, "{pair}: psnr {psnr}, want {}", want("psnr"));
        assert!((ssim - want("ssim_3dgs")).abs() < 1e-6, "{pair}: ssim {ssim}, want {}", want("ssim_3dgs"));
        assert!((flip - want("flip_ldr_mean")).abs() < 1e-4, "{pair}: flip {flip}");
    }
}
