//! Damaged files: each is refused with a clear error, or read, and then baked to a valid scene.
//! `TRISPLAT_FUZZ_CASES=100000 cargo test --release --test program mutants` for a long run.

mod datasets;
mod gltf;
mod scenes;
