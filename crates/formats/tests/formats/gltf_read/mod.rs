//! glTF read back: files of this program in every variant, files of others, and hostile files.

mod check;
mod files;
mod foreign;
mod gltf_json;
mod hostile;
mod looks;
mod own;
mod pictures;
