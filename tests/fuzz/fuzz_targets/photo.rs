//! Any bytes as a photo and as a mask: a picture of the size its header claims or one error, never
//! a panic that reaches the caller.
#![no_main]

#[allow(dead_code, reason = "shared with the tests of photos")]
#[path = "../../fixtures/src/png.rs"]
mod png;

use libfuzzer_sys::fuzz_target;
use std::io::Write;
use trisplat::Limits;
use trisplat_scene::image::RgbImage;
use trisplat_scene::input::is_guarded;

/// As in the program, a panic of the decoder is an error of the photo: it does not end the fuzzer,
/// whose hook is for all others.
fn spare_guarded() {
    let abort = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !is_guarded() {
            abort(info);
        }
    }));
}

fuzz_target!(init: spare_guarded(), |bytes: &[u8]| {
    look_at(bytes);
    // Behind the checksums, which no random change keeps.
    look_at(&png::with_checksums(bytes));
});

fn look_at(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let limits = Limits { picture_pixels: 1 << 22, ..Limits::DEFAULT };
    let size = RgbImage::size_of(file.path(), &limits);
    if let (Ok(size), Ok(pixels)) = (size, RgbImage::load_within(file.path(), &limits)) {
        assert_eq!(pixels.size, size);
        assert_eq!(pixels.rgb.len(), (size.x * size.y) as usize);
    }
    drop(RgbImage::load_mask(file.path(), &limits));
}
