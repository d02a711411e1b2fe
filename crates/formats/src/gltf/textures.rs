//! Base-colour textures of an input: kept if one picture paints the whole mesh, else turned into a colour per
//! face.

use super::accessor::Accessors;
use super::document::{Document, Image, TextureInfo};
use crate::faces;
use crate::faces::PaintedFaces;
use glam::Vec2;
use gltf_json::accessor::ComponentType;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use trisplat_scene::{Error, Limits, Result, Texture, mesh::Mesh};

/// The places of primitives on textures, in the order of their faces.
#[derive(Default)]
pub(crate) struct PaintedPrimitives(Vec<PaintedFaces>);

impl PaintedPrimitives {
    /// Reads the places of the corners of `faces` on a texture; `corner` is the vertex of a corner within the
    /// primitive. Returns the reason if they cannot be read.
    pub(crate) fn add(
        &mut self,
        document: &Document,
        accessors: &mut Accessors,
        (info, coordinates): (&TextureInfo, Option<usize>),
        faces: Range<usize>,
        corner: impl Fn(usize) -> usize,
        plain: bool,
    ) -> Result<Option<String>> {
        let image = document.textures.get(info.index).and_then(|texture| texture.source);
        let (Some(image), Some(coordinates)) = (image, coordinates) else {
            return Ok(Some(format!(
                "texture {} has no PNG or JPEG picture (KTX2 is not read), or no TEXCOORD_0",
                info.index
            )));
        };
        if info.tex_coord != 0 || !info.extensions.is_empty() {
            return Ok(Some(format!("texture {} is transformed, or laid by other coordinates", info.index)));
        }
        let layout = accessors.layout(coordinates)?;
        let readable = matches!(
            (layout.component, layout.normalized),
            (ComponentType::F32, _) | (ComponentType::U8 | ComponentType::U16, true)
        );
        if !readable || layout.width != 2 {
            return Ok(Some(format!("accessor {coordinates} holds no texture coordinates")));
        }
        accessors.buffers.spend(8 * layout.count + 24 * faces.len() as u64)?;
        let mut at = vec![Vec2::ZERO; layout.count as usize];
        accessors.for_each(coordinates, 0.0, |i, uv: [f64; 2]| at[i] = Vec2::from(uv.map(|x| x as f32)))?;
        let corner = |number: usize| at.get(corner(number)).copied().filter(|uv| uv.is_finite());
        let face = |face: usize| Some([corner(3 * face)?, corner(3 * face + 1)?, corner(3 * face + 2)?]);
        let Some(uvs) = (0..faces.len()).map(face).collect() else {
            return Ok(Some(format!(
                "accessor {coordinates} lacks coordinates, or has some that are not finite"
            )));
        };
        self.0.push(PaintedFaces { image, faces, uvs, plain });
        Ok(None)
    }

    /// Paints the whole mesh, whose faces are in the order of their addition. Returns notes for the user.
    pub(crate) fn paint(
        self,
        mesh: &mut Mesh,
        document: &Document,
        accessors: &mut Accessors,
        limits: &Limits,
    ) -> Vec<String> {
        let (mut textures, mut warnings) = (BTreeMap::new(), Vec::new());
        for painted in &self.0 {
            textures.entry(painted.image).or_insert_with(|| {
                let read = read(document, accessors, painted.image, limits);
                read.map_err(|e| {
                    warnings.push(format!(
                        "a texture is not read, its triangles have the base colour of their material: {e}"
                    ))
                })
                .ok()
            });
        }
        warnings.extend(faces::paint(mesh, self.0, &textures));
        warnings
    }
}

/// The texture of a picture in a buffer or beside the file.
fn read(
    document: &Document,
    accessors: &mut Accessors,
    image: usize,
    limits: &Limits,
) -> Result<Arc<Texture>> {
    let path = accessors.buffers.path().to_owned();
    let place = format!("image {image}");
    let entry = document.images.get(image).ok_or_else(|| {
        let has = document.images.len();
        Error::malformed(&path, &place, format!("does not exist: the file has {has}"))
    })?;
    let bytes = picture_bytes(accessors, entry, &place)?;
    let texture = Texture::decoded(&path, &bytes, limits)?;
    // With its mip levels.
    accessors.buffers.spend(2 * texture.picture().bytes())?;
    Ok(Arc::new(texture))
}

/// An encoded picture, in a buffer or beside the file; `place` is for messages.
pub(crate) fn picture_bytes(accessors: &mut Accessors, image: &Image, place: &str) -> Result<Vec<u8>> {
    match image {
        Image { buffer_view: Some(view), .. } => accessors.view_bytes(*view),
        Image { uri: Some(uri), .. } => accessors.buffers.picture(uri, place),
        _ => {
            let path = accessors.buffers.path();
            Err(Error::malformed(path, place, "has neither a bufferView nor a uri"))
        }
    }
}
