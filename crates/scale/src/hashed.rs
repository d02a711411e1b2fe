//! Soups of a plan: their names end with the hash of their bytes, so that they replace nothing, and a changed one is not
//! taken for what it was.

use super::hash;
use std::path::{Path, PathBuf};
use trisplat_formats::ply;
use trisplat_scene::{
    Error, Limits, Provenance, Result, Soup,
    atomic::{AtomicFile, folder_of},
    camera::Camera,
};

/// Writes a soup as `NAME-HASH.ply` where `path` is `NAME.ply`; `begun` is called with its final path before it exists. Returns
/// that and the hash.
///
/// Errors: a file of that name with other bytes; what the operating system refuses.
pub(super) fn write(
    path: &Path,
    (soup, provenance, cameras): (&Soup, &Provenance, &[Camera]),
    limits: &Limits,
    begun: impl FnOnce(&Path),
) -> Result<(PathBuf, String)> {
    let mut out = hash::Hashed::new(AtomicFile::create(path)?);
    ply::write_soup(&mut out, soup, provenance, cameras).map_err(|e| Error::io(path, e))?;
    let (out, hash) = out.end();
    let named = path.with_file_name(format!("{}{hash}.ply", stem(path)));
    if named.exists() && hash::of_file(&named, limits)? != hash {
        return Err(Error::unsupported(&named, "was changed, its name says so; move it to another folder"));
    }
    begun(&named);
    out.commit_as(&named)?;
    Ok((named, hash))
}

/// The soup that was written as `path`, if it is there and unchanged.
pub(super) fn find(path: &Path, limits: &Limits) -> Option<PathBuf> {
    let begin = stem(path);
    let entries = std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    let is_it = |found: &PathBuf| {
        let name = found.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let named = name.strip_prefix(&begin).and_then(|rest| rest.strip_suffix(".ply"));
        named.is_some_and(|named| hash::of_file(found, limits).is_ok_and(|hash| hash == named))
    };
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_it).collect();
    found.sort();
    found.into_iter().next()
}

/// `NAME-`.
fn stem(path: &Path) -> String {
    format!("{}-", path.file_stem().unwrap_or_default().to_string_lossy())
}
