//! Soups of a plan: their names end with the XXH3 hash of their bytes, so that they replace nothing, and a changed one is not
//! taken for what it was.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use trisplat_formats::{self as formats, ReadOptions, ply};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, Soup,
    atomic::{AtomicFile, folder_of},
    camera::Camera,
    input,
};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Bytes read at a time.
const BUFFER: usize = 1 << 20;

/// A file of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Its name in the folder of the plan.
    pub file: String,
    /// The hash of its bytes (XXH3).
    pub hash: String,
    /// Triangles in it.
    pub triangles: u64,
}

/// The hash of a file's bytes.
///
/// Errors: what the operating system refuses; no regular file.
pub(super) fn hash_of_file(path: &Path, limits: &Limits) -> Result<String> {
    let (mut file, _) = input::open(path, limits)?;
    let (mut hash, mut buffer) = (Xxh3Default::new(), vec![0; BUFFER]);
    loop {
        match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
            0 => return Ok(digits(hash.digest())),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// The hash of a value as JSON.
pub(super) fn hash_of(value: &impl Serialize) -> Result<String> {
    let bytes =
        serde_json::to_vec(value).map_err(|e| Error::invalid("manifest", e, "numbers JSON can hold"))?;
    Ok(digits(xxh3_64(&bytes)))
}

/// A hash as sixteen hexadecimal digits.
pub(super) fn digits(hash: u64) -> String {
    format!("{hash:016x}")
}

/// Writes a soup as `NAME-HASH.ply` where `path` is `NAME.ply`; `begun` is called with its final path before it exists.
///
/// Errors: a file of that name with other bytes; what the operating system refuses.
pub(super) fn write(
    path: &Path,
    (soup, provenance, cameras): (&Soup, &Provenance, &[Camera]),
    limits: &Limits,
    begun: impl FnOnce(&Path),
) -> Result<(PathBuf, Source)> {
    let io = |e| Error::io(path, e);
    let mut bytes = Vec::new();
    ply::write_soup(&mut bytes, soup, provenance, cameras).map_err(io)?;
    let hash = digits(xxh3_64(&bytes));
    let file = format!("{}{hash}.ply", stem(path));
    let named = path.with_file_name(&file);
    if named.exists() && hash_of_file(&named, limits)? != hash {
        return Err(Error::unsupported(&named, "was changed, its name says so; move it to another folder"));
    }
    begun(&named);
    let mut out = AtomicFile::create(path)?;
    out.write_all(&bytes).map_err(io)?;
    out.commit_as(&named)?;
    Ok((named, Source { file, hash, triangles: soup.len() as u64 }))
}

/// The soup that was written as `path`, if it is there and unchanged.
pub(super) fn find(path: &Path, limits: &Limits) -> Option<PathBuf> {
    let begin = stem(path);
    let entries = std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    let is_it = |found: &PathBuf| {
        let name = found.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let named = name.strip_prefix(&begin).and_then(|rest| rest.strip_suffix(".ply"));
        named.is_some_and(|named| hash_of_file(found, limits).is_ok_and(|hash| hash == named))
    };
    entries.map(|entry| entry.path()).filter(is_it).min()
}

/// `NAME-`.
fn stem(path: &Path) -> String {
    format!("{}-", path.file_stem().unwrap_or_default().to_string_lossy())
}

/// Reads a soup of the plan, which must be as it was written.
pub(super) fn read(folder: &Path, source: &Source, limits: &Limits) -> Result<ImportedScene> {
    let path = folder.join(&source.file);
    if hash_of_file(&path, limits)? != source.hash {
        return Err(Error::unsupported(&path, "has changed since it was planned; plan again"));
    }
    let options = ReadOptions { sh_degree: 3, limits: *limits, ..ReadOptions::default() };
    let loaded = formats::read(&path, &options)?;
    match loaded.scene.triangle_count() as u64 == source.triangles {
        true => Ok(loaded),
        false => Err(Error::unsupported(&path, "has other triangles than were planned; plan again")),
    }
}
