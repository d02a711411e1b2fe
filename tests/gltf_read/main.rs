//! glTF read back: our own files in every variant, others' files, and hostile files.
#![allow(clippy::print_stderr)]

mod check;
mod files;
mod foreign;
mod gltf_json;
mod hostile;
mod own;
