//! The files that a document names.

use super::container::ContainerFile;
use super::document::{Image, parse};
use super::uri;
use crate::Source;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use trisplat_scene::{Limits, Result};

/// What of a document may name files. Buffers do so as pictures do.
#[derive(Debug, Deserialize)]
struct Named {
    #[serde(default)]
    buffers: Vec<Image>,
    #[serde(default)]
    images: Vec<Image>,
}

/// The files beside `source` that its buffers and pictures are in.
pub fn named_files(source: &mut Source, limits: &Limits) -> Result<Vec<PathBuf>> {
    let container = ContainerFile::read(source, limits)?;
    let Named { buffers, images } = parse(&source.path, &container.json, limits)?;
    let folder = source.path.parent().unwrap_or(Path::new(""));
    let uris = buffers.into_iter().chain(images).filter_map(|named| named.uri);
    // What has a scheme, as data has, is no file.
    let beside = uris.filter(|uri| !uri::is_data(uri) && !uri.contains(':'));
    Ok(beside.map(|uri| folder.join(uri::unescaped(&uri))).collect())
}
