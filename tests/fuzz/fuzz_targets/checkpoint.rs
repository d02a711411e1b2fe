//! Any bytes as a checkpoint of a training: its state or one error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::io::Write;
use trisplat_train::checkpoint;

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    drop(checkpoint::read(file.path()));
});
