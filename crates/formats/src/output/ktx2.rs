//! Which files may hold KTX2 pictures: those whose readers decode them.

use super::{OutputFormat, OutputOptions};
use trisplat_scene::Result;

impl OutputOptions {
    /// Whether a file of this format can hold pictures as `texture_format` says.
    ///
    /// Errors: KTX2 in a program without it, in another format than glTF, or for a target that does not read it.
    pub(super) fn check_texture_format(&self, format: OutputFormat) -> Result<()> {
        let texture = self.texture_format;
        if !texture.is_ktx2() {
            return Ok(());
        }
        texture.check_built()?;
        let why = match format {
            OutputFormat::Glb | OutputFormat::Gltf | OutputFormat::Tiles => self.target.ktx2().err(),
            OutputFormat::Html => Some("the page has no decoder of KTX2; write a .glb for a page that has"),
            OutputFormat::Obj => Some("no program reads KTX2 pictures of an OBJ"),
            OutputFormat::Usdz => Some("USDZ may hold PNG and JPEG only"),
            // It has no texture.
            OutputFormat::Ply => None,
        };
        why.map_or(Ok(()), |why| Err(texture.refused(why)))
    }
}
