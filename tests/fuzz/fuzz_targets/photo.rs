//! Any bytes as a photo and as a mask: a picture of the size its header claims or one error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::io::Write;
use trisplat::Limits;
use trisplat::image::Pixels;

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let limits = Limits { picture_pixels: 1 << 22, ..Limits::DEFAULT };
    let size = Pixels::size_of(file.path(), &limits);
    if let (Ok(size), Ok(pixels)) = (size, Pixels::load_within(file.path(), &limits)) {
        assert_eq!(pixels.size, size);
        assert_eq!(pixels.rgb.len(), (size.x * size.y) as usize);
    }
    drop(Pixels::load_mask(file.path(), &limits));
});
