//! Any bytes: a scene or one error, never a panic.
#![no_main]

mod source;

use libfuzzer_sys::fuzz_target;
use trisplat_formats::{self as formats, ReadOptions};

fuzz_target!(|bytes: &[u8]| {
    for sh_degree in [0, 3] {
        if let Ok(loaded) = formats::obj::read(
            source::source(bytes, "fuzz.obj"),
            &ReadOptions::with_degree(sh_degree),
        ) {
            loaded.scene.validate().unwrap();
        }
    }
});
