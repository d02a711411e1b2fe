//! Simulates the depth maps of a phone: half as wide as photos, with noise and holes, in the layout of
//! `depths` beside a COLMAP model.

use super::{RayCamera, SyntheticOptions, camera, photo_name};
use glam::{DVec2, UVec2};
use image::{ImageBuffer, Luma};
use serde_json::{Map, json};
use std::path::Path;
use trisplat_scene::{Error, Result, Rng, parallel};

/// Standard deviation of a depth, as a share.
const NOISE: f64 = 0.01;
/// Share of the pixels, and of the blocks of pixels, without a depth.
const HOLES: f64 = 0.05;
/// Side of such a block, px.
const BLOCK: u32 = 8;
/// The smallest depth with a code.
const NEAREST: f64 = 0.5;

/// Writes a depth map per photo, and the file of their scales.
pub(crate) fn write(folder: &Path, options: &SyntheticOptions) -> Result<()> {
    let depths = folder.join("depths");
    std::fs::create_dir_all(&depths).map_err(|e| Error::io(&depths, e))?;
    let mut scales = Map::new();
    for index in 0..options.views {
        let name = photo_name(index);
        let path = depths.join(&name);
        let stem = name.trim_end_matches(".png");
        scales.insert(stem.into(), json!({"scale": 1.0 / NEAREST, "offset": 0.0}));
        depth_map(options, index)
            .save(&path)
            .map_err(|e| Error::malformed(&path, "picture", e.to_string()))?;
    }
    let file = folder.join("sparse/0/depth_params.json");
    let text = serde_json::to_string_pretty(&scales).expect("plain numbers and names are JSON");
    std::fs::write(&file, text + "\n").map_err(|e| Error::io(&file, e))
}

/// Codes of the inverse depth.
fn depth_map(options: &SyntheticOptions, index: u32) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    let camera = camera(options, index);
    let size = (camera.size / 2).max(UVec2::ONE);
    let step = camera.size.as_dvec2() / size.as_dvec2();
    let rays = RayCamera::new(&camera);
    let noise = Rng::new(options.seed, "depth", u64::from(index));
    let holes = Rng::new(options.seed, "holes", u64::from(index));
    let codes = parallel::collect(size.element_product() as usize, 1, |i| {
        let at = UVec2::new(i as u32 % size.x, i as u32 / size.x);
        let block = at / BLOCK;
        let draws = [i as u64, (1 << 32) + u64::from(block.y) * (1 << 16) + u64::from(block.x)];
        let hit = rays.trace((at.as_dvec2() + DVec2::splat(0.5)) * step);
        let Some(hit) = hit.filter(|hit| !hit.sky) else { return 0 };
        if draws.iter().any(|draw| holes.uniform_f64(*draw) < HOLES) {
            return 0;
        }
        // Rays have a depth of 1 per unit.
        let depth = hit.distance * (1.0 + NOISE * f64::from(noise.normal(i as u64)));
        (65536.0 * NEAREST / depth).round() as u16
    });
    ImageBuffer::from_raw(size.x, size.y, codes).expect("one code per pixel")
}
