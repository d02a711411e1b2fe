//! Any bytes: a hierarchy or one error, never a panic.
#![no_main]

mod source;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = trisplat_formats::bvh::read(source::source(bytes, "fuzz.bvh"));
});
