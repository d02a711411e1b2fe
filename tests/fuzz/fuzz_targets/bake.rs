//! Any bytes that a reader lets through are baked: a valid mesh or one error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::io::Write;
use trisplat::{BakeOptions, Limits, ReadOptions};

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let limits = Limits { triangles: 1 << 16, camera_pixels: 1 << 16, ..Limits::DEFAULT };
    let options = ReadOptions { limits, ..ReadOptions::default() };
    let Ok(loaded) = trisplat_formats::read(file.path(), &options) else { return };
    if let Ok(baked) = trisplat::bake(loaded, &BakeOptions::default()) {
        baked.asset.mesh.validate().unwrap();
    }
});
