//! glTF read back: our own files in every variant, others' files, and files made to hurt.
#![allow(clippy::print_stderr)]

mod check;
mod files;
mod foreign;
mod gltf_json;
mod hostile;
mod own;
