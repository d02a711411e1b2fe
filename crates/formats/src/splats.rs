//! Files of Gaussian splats: a reader per format. Those in PLY are in [`ply`].

pub(crate) mod build;
pub mod cameras;
mod sog;
mod spz;

pub use build::{finish, unit, zeroed};

use super::format::Format;
use super::read_options::ReadOptions;
use super::source::Source;
use super::{gaussians, ply};
use trisplat_scene::{ImportedSplats, Result, guard::guarded};

/// The format of an open file when it holds Gaussians that we read.
pub fn format_of(source: &mut Source) -> Result<Option<Format>> {
    let head = source.head()?;
    match gaussians::recognise(&head, &source.path) {
        Some(gaussians::SPZ) => return Ok(Some(Format::Spz)),
        Some(gaussians::SPLAT) => return Ok(Some(Format::Splat)),
        _ => {}
    }
    Ok(match Format::detect(&head, &source.named()) {
        Some(Format::Ply) if ply::holds_splats(source)? => Some(Format::Ply),
        Some(Format::Pt) if sog::is_sog(source)? => Some(Format::Sog),
        _ => None,
    })
}

/// The Gaussians in an open file of that format, with the cameras in a list beside it.
pub fn read_as(format: Format, source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let path = source.path.clone();
    guarded(&path, || {
        let mut loaded = match format {
            Format::Splat => build::read(source, options)?,
            Format::Spz => spz::read(source, options)?,
            Format::Sog => sog::read(source, options)?,
            _ => ply::read_splats(source, options)?,
        };
        cameras::add_beside(&path, &mut loaded, &options.limits);
        Ok(loaded)
    })
}
