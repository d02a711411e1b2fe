//! Accessors: typed elements in views of buffers, with every number checked before use.

use super::buffers::Buffers;
use super::document::{
    Accessor, Attributes, BufferView, GltfDocument, GltfImage, component_type, entry,
};
use super::material::{GltfTextureInfo, Sampler};
use super::meshopt::{self, CompressedView};
use super::sh::{self, ShExtras};
use glam::Vec2;
use gltf_json::accessor::ComponentType;
use gltf_json::buffer::MAX_BYTE_STRIDE;
use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;
use trisplat_scene::atlas::{self, PaintedFaces};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Error, FaceSh, Limits, Result, Texture, sh_count};

/// Maximum number of decompressed views kept for the next accessor: positions, colours and indices
/// of a mesh.
const MAX_CACHED_VIEWS: usize = 4;

/// Memory layout of an accessor's elements in their (decompressed) buffer view.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ElementLayout {
    pub(crate) component: ComponentType,
    pub(crate) normalized: bool,
    /// Components per element.
    pub(crate) width: u64,
    /// Number of elements.
    pub(crate) count: u64,
    view: Option<usize>,
    /// First byte within the view.
    pub(crate) offset: u64,
    /// Bytes from one element to the next.
    pub(crate) stride: u64,
}

impl ElementLayout {
    /// Bytes of an element without padding.
    fn element(&self) -> u64 {
        self.width * size(self.component)
    }

    /// True for floats and for integers that stand for 0 to 1, as colours are.
    pub(crate) fn is_unit(&self) -> bool {
        matches!(
            (self.component, self.normalized),
            (ComponentType::F32, _) | (ComponentType::U8 | ComponentType::U16, true)
        )
    }

    /// Bytes from the first element to the end of the last.
    fn span(&self) -> Option<u64> {
        match self.count.checked_sub(1) {
            None => Some(0),
            Some(steps) => steps.checked_mul(self.stride)?.checked_add(self.element()),
        }
    }
}

/// Reads accessors of a document.
pub(crate) struct Accessors<'a> {
    document: &'a GltfDocument,
    pub(crate) buffers: Buffers<'a>,
    /// Decompressed views, as words, latest last.
    unpacked: VecDeque<(usize, Vec<u32>)>,
}

impl<'a> Accessors<'a> {
    pub(crate) fn new(document: &'a GltfDocument, buffers: Buffers<'a>) -> Self {
        Self { document, buffers, unpacked: VecDeque::new() }
    }

    fn malformed(&self, place: String, reason: impl Into<String>) -> Error {
        Error::malformed(self.buffers.path(), place, reason)
    }

    /// The accessor of that number.
    pub(crate) fn accessor(&self, index: usize) -> Result<&'a Accessor> {
        entry(self.buffers.path(), "accessor", &self.document.accessors, index)
    }

    /// The view of that number.
    pub(crate) fn view(&self, index: usize) -> Result<&'a BufferView> {
        entry(self.buffers.path(), "bufferView", &self.document.buffer_views, index)
    }

    /// A checked accessor: every element is within its view, and the view's bytes exist. The caller
    /// counts the elements' memory by [`Buffers::spend`].
    pub(crate) fn layout(&mut self, index: usize) -> Result<ElementLayout> {
        let accessor = self.accessor(index)?;
        let place = || format!("accessor {index}");
        let component = component_type(accessor.component_type).ok_or_else(|| {
            self.malformed(
                place(),
                format!("has the unknown component type {}", accessor.component_type),
            )
        })?;
        let width = match accessor.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            // Of columns of floats, which have no padding.
            "MAT4" => 16,
            other => {
                return Err(self.malformed(
                    place(),
                    format!("has type {other:?}; expected SCALAR, VEC2 to VEC4 or MAT4"),
                ));
            }
        };
        let mut layout = ElementLayout {
            component,
            normalized: accessor.normalized,
            width,
            count: accessor.count,
            view: accessor.buffer_view,
            offset: accessor.byte_offset,
            stride: width * size(component),
        };
        match accessor.buffer_view {
            Some(view) => {
                layout.stride = self.stride(view)?.unwrap_or(layout.stride);
                self.check(&layout, place())?;
            }
            None if accessor.sparse.is_none() => {
                return Err(self.malformed(place(), "has no bufferView: there are no data"));
            }
            None => {}
        }
        Ok(layout)
    }

    /// The stride of a view's elements, if given.
    fn stride(&self, index: usize) -> Result<Option<u64>> {
        let view = self.view(index)?;
        let stride = view.extensions.meshopt.as_ref().map(|c| c.byte_stride).or(view.byte_stride);
        match stride {
            Some(stride) if !(1..=MAX_BYTE_STRIDE as u64).contains(&stride) => {
                let place = format!("bufferView {index}");
                Err(self.malformed(
                    place,
                    format!("has byteStride {stride}; expected 1 to {MAX_BYTE_STRIDE}"),
                ))
            }
            stride => Ok(stride),
        }
    }

    /// Checks that all elements are within their view and the view within real bytes.
    fn check(&mut self, layout: &ElementLayout, place: String) -> Result<()> {
        let Some(index) = layout.view else { return Ok(()) };
        let view = self.view(index)?;
        let length = match &view.extensions.meshopt {
            Some(compressed) => {
                let bytes = meshopt::check(compressed);
                let bytes = bytes
                    .map_err(|reason| self.malformed(format!("bufferView {index}"), reason))?;
                self.check_range(
                    index,
                    compressed.buffer,
                    compressed.byte_offset,
                    compressed.byte_length,
                )?;
                bytes
            }
            None => {
                self.check_range(index, view.buffer, view.byte_offset, view.byte_length)?;
                view.byte_length
            }
        };
        if layout.stride < layout.element() {
            let stride = layout.stride;
            let element = layout.element();
            return Err(self.malformed(
                place,
                format!("has {element} bytes per element, {stride} bytes apart"),
            ));
        }
        match layout.span().and_then(|span| span.checked_add(layout.offset)) {
            Some(end) if end <= length => Ok(()),
            _ => Err(self.malformed(
                place,
                format!(
                    "promises {} elements from byte {}, but bufferView {index} has {length} bytes",
                    layout.count, layout.offset
                ),
            )),
        }
    }

    fn check_range(&mut self, view: usize, buffer: usize, offset: u64, bytes: u64) -> Result<()> {
        let length = self.buffers.length(buffer)?;
        if offset.checked_add(bytes).is_none_or(|end| end > length) {
            return Err(self.malformed(
                format!("bufferView {view}"),
                format!("promises {bytes} bytes from {offset}, but buffer {buffer} has {length}"),
            ));
        }
        self.buffers.open(buffer)
    }

    /// All bytes of a view that is not compressed.
    pub(crate) fn view_bytes(&mut self, index: usize) -> Result<Vec<u8>> {
        let view = self.view(index)?;
        self.buffers.spend(view.byte_length)?;
        // Its existence is checked before memory is allocated.
        let length = self.buffers.length(view.buffer)?;
        if view.byte_length > length {
            let reason = format!("has {} bytes of a buffer of {length}", view.byte_length);
            return Err(self.malformed(format!("bufferView {index}"), reason));
        }
        self.buffers.open(view.buffer)?;
        let mut bytes = vec![0; view.byte_length as usize];
        self.buffers.read(view.buffer, view.byte_offset, &mut bytes)?;
        Ok(bytes)
    }

    /// Hands every element to `each` as N numbers in order; missing components are `fill`.
    /// Sparse replacements come after all others, with the number of the element they replace.
    pub(crate) fn for_each<const N: usize>(
        &mut self,
        index: usize,
        fill: f64,
        mut each: impl FnMut(usize, [f64; N]),
    ) -> Result<()> {
        let layout = self.layout(index)?;
        if layout.view.is_some() {
            decode(&layout, &self.bytes(&layout)?, fill, &mut each);
        } else {
            let mut zero = [0.0; N];
            zero[(layout.width as usize).min(N)..].fill(fill);
            for i in 0..layout.count as usize {
                each(i, zero);
            }
        }
        self.for_each_sparse(index, &layout, fill, each)
    }

    /// The bytes of all elements; the last may lack its padding.
    fn bytes(&mut self, layout: &ElementLayout) -> Result<Cow<'_, [u8]>> {
        let Some(index) = layout.view else { return Ok(Cow::default()) };
        let view = self.view(index)?;
        let length = layout.span().unwrap_or(0) as usize;
        if let Some(compressed) = &view.extensions.meshopt {
            let bytes: &[u8] = bytemuck::cast_slice(self.unpack(index, compressed)?);
            let start = layout.offset as usize;
            return Ok(bytes.get(start..start + length).unwrap_or_default().into());
        }
        let mut bytes = vec![0; length];
        self.buffers.read(view.buffer, view.byte_offset + layout.offset, &mut bytes)?;
        Ok(bytes.into())
    }

    /// A compressed view's bytes as words; [`Self::check`] has passed it.
    fn unpack(&mut self, index: usize, compressed: &CompressedView) -> Result<&[u32]> {
        if let Some(at) = self.unpacked.iter().position(|(view, _)| *view == index) {
            return Ok(&self.unpacked[at].1);
        }
        let place = format!("bufferView {index}");
        self.buffers.spend(compressed.count * compressed.byte_stride)?;
        let mut packed = vec![0; compressed.byte_length as usize];
        self.buffers.read(compressed.buffer, compressed.byte_offset, &mut packed)?;
        let words =
            meshopt::decode(compressed, &packed).map_err(|reason| self.malformed(place, reason))?;
        if self.unpacked.len() == MAX_CACHED_VIEWS {
            self.unpacked.pop_front();
        }
        self.unpacked.push_back((index, words));
        Ok(self.unpacked.back().map_or(&[], |(_, words)| words))
    }

    fn for_each_sparse<const N: usize>(
        &mut self,
        index: usize,
        layout: &ElementLayout,
        fill: f64,
        mut each: impl FnMut(usize, [f64; N]),
    ) -> Result<()> {
        let Some(sparse) = &self.accessor(index)?.sparse else { return Ok(()) };
        let place = || format!("accessor {index}: sparse");
        if sparse.count > layout.count {
            return Err(self.malformed(
                place(),
                format!("replaces {} of {} elements", sparse.count, layout.count),
            ));
        }
        let component = component_type(sparse.indices.component_type)
            .filter(|c| matches!(c, ComponentType::U8 | ComponentType::U16 | ComponentType::U32))
            .ok_or_else(|| self.malformed(place(), "has indices that are not unsigned integers"))?;
        let numbers = ElementLayout {
            component,
            normalized: false,
            width: 1,
            count: sparse.count,
            view: Some(sparse.indices.buffer_view),
            offset: sparse.indices.byte_offset,
            stride: size(component),
        };
        let values = ElementLayout {
            count: sparse.count,
            view: Some(sparse.values.buffer_view),
            offset: sparse.values.byte_offset,
            stride: layout.element(),
            ..*layout
        };
        self.check(&numbers, place())?;
        self.check(&values, place())?;
        let mut at = Vec::new();
        decode(&numbers, &self.bytes(&numbers)?, 0.0, &mut |_, [number]: [f64; 1]| {
            at.push(number as usize)
        });
        if let Some(bad) = at.iter().find(|&&number| number as u64 >= layout.count) {
            return Err(
                self.malformed(place(), format!("replaces element {bad} of {}", layout.count))
            );
        }
        decode(&values, &self.bytes(&values)?, fill, &mut |i, value| each(at[i], value));
        Ok(())
    }
}

/// Bytes of a component.
fn size(component: ComponentType) -> u64 {
    component.size() as u64
}

/// Hands every element of `bytes` to `each`, with its number.
fn decode<const N: usize>(
    layout: &ElementLayout,
    bytes: &[u8],
    fill: f64,
    each: &mut impl FnMut(usize, [f64; N]),
) {
    for (i, element) in bytes.chunks(layout.stride as usize).enumerate() {
        let cells = element.chunks_exact(layout.component.size()).take(layout.width as usize);
        let mut values = [fill; N];
        for (value, cell) in values.iter_mut().zip(cells) {
            *value = number(layout, cell);
        }
        each(i, values);
    }
}

/// A component; normalised integers become -1 to 1.
fn number(layout: &ElementLayout, cell: &[u8]) -> f64 {
    let mut word = [0; 4];
    word[..cell.len()].copy_from_slice(cell);
    let [a, b, ..] = word;
    let (value, one) = match layout.component {
        ComponentType::I8 => (f64::from(a as i8), f64::from(i8::MAX)),
        ComponentType::U8 => (f64::from(a), f64::from(u8::MAX)),
        ComponentType::I16 => (f64::from(i16::from_le_bytes([a, b])), f64::from(i16::MAX)),
        ComponentType::U16 => (f64::from(u16::from_le_bytes([a, b])), f64::from(u16::MAX)),
        ComponentType::U32 => (f64::from(u32::from_le_bytes(word)), f64::from(u32::MAX)),
        ComponentType::F32 => return f64::from(f32::from_le_bytes(word)),
    };
    if layout.normalized { (value / one).max(-1.0) } else { value }
}

// ---- Base-colour textures of an input, kept or turned into a colour per face --------------------

/// The warning about a texture that cannot be read.
pub(crate) const UNREAD: &str =
    "a texture is not read, its triangles have the base colour of their material";

/// The faces of a primitive on a picture, or why there is none. `corner` maps a corner to its
/// vertex in the primitive; `faces` are numbers of the merged mesh.
pub(crate) fn painted_faces(
    document: &GltfDocument,
    accessors: &mut Accessors,
    info: &GltfTextureInfo,
    attributes: &Attributes,
    faces: Range<usize>,
    corner: impl Fn(usize) -> usize,
) -> Result<Result<PaintedFaces, String>> {
    let index = info.index;
    let Some(texture) = document.textures.get(index) else {
        return Ok(Err(format!("texture {index} does not exist")));
    };
    let image = match texture.picture() {
        Ok(image) => image,
        Err(why) => return Ok(Err(format!("texture {index} has {why}"))),
    };
    let Some(coordinates) = attributes.tex_coord(info.set()) else {
        return Ok(Err(format!(
            "texture {index} is laid by TEXCOORD_{}, which is not there",
            info.set()
        )));
    };
    let layout = accessors.layout(coordinates)?;
    if layout.component == ComponentType::U32 || layout.width != 2 {
        return Ok(Err(format!("accessor {coordinates} holds no texture coordinates")));
    }
    accessors.buffers.spend(8 * layout.count + 24 * faces.len() as u64)?;
    let mut at = vec![Vec2::ZERO; layout.count as usize];
    accessors
        .for_each(coordinates, 0.0, |i, uv| at[i] = Vec2::from(info.place(uv).map(|x| x as f32)))?;
    let corner = |number: usize| at.get(corner(number)).copied().unwrap_or(Vec2::NAN);
    let uvs = (0..faces.len()).map(|face| [0, 1, 2].map(|k| corner(3 * face + k))).collect();
    let sampler = texture.sampler.and_then(|sampler| document.samplers.get(sampler));
    let wrap = sampler.map(Sampler::wrap).unwrap_or_default();
    let filter = sampler.map(Sampler::filter).unwrap_or_default();
    Ok(Ok(PaintedFaces { image, faces, uvs, wrap, filter }))
}

/// Paints the whole mesh, whose faces are in the order of `painted`. Returns notes for the user.
pub(crate) fn paint(
    painted: Vec<PaintedFaces>,
    mesh: &mut Mesh,
    document: &GltfDocument,
    accessors: &mut Accessors,
    limits: &Limits,
) -> Vec<String> {
    let mut textures = BTreeMap::new();
    let mut warnings = Vec::new();
    for painted in &painted {
        textures.entry(painted.image).or_insert_with(|| {
            let read = read(document, accessors, painted.image, limits);
            read.map_err(|e| warnings.push(format!("{UNREAD}: {e}"))).ok()
        });
    }
    warnings.extend(atlas::paint(mesh, painted, &textures));
    warnings
}

/// The spherical harmonics of the faces of a primitive, at the texels of their first corners, or
/// why there are none. `corner` maps a corner to its vertex in the primitive.
pub(crate) fn harmonics(
    document: &GltfDocument,
    accessors: &mut Accessors,
    (extras, info): (&ShExtras, &GltfTextureInfo),
    attributes: &Attributes,
    faces: usize,
    corner: impl Fn(usize) -> usize,
    limits: &Limits,
) -> Result<Result<FaceSh, String>> {
    let painted = match painted_faces(document, accessors, info, attributes, 0..faces, corner)? {
        Ok(painted) => painted,
        Err(why) => return Ok(Err(why)),
    };
    let texture = match read(document, accessors, painted.image, limits) {
        Ok(texture) => texture,
        Err(e) => return Ok(Err(e.to_string())),
    };
    accessors.buffers.spend(12 * (faces as u64) * sh_count(extras.degree) as u64)?;
    let mut coefficients = Vec::new();
    for [first, ..] in &painted.uvs {
        let found = sh::coefficients(extras, texture.picture(), *first, &mut coefficients);
        if found.is_none() {
            return Ok(Err("a triangle has no texels".to_owned()));
        }
    }
    Ok(FaceSh::new(extras.degree, coefficients).map_err(|e| e.to_string()))
}

/// The texture of a picture in a buffer or beside the file.
fn read(
    document: &GltfDocument,
    accessors: &mut Accessors,
    image: usize,
    limits: &Limits,
) -> Result<Arc<Texture>> {
    let path = accessors.buffers.path().to_owned();
    let place = format!("image {image}");
    let image = entry(&path, "image", &document.images, image)?;
    let bytes = picture_bytes(accessors, image, &place)?;
    let texture = Texture::decoded(&path, &bytes, limits)?;
    // With its mip levels.
    accessors.buffers.spend(2 * texture.picture().bytes())?;
    Ok(Arc::new(texture))
}

/// An encoded picture, in a buffer or beside the file; `place` is for messages.
pub(crate) fn picture_bytes(
    accessors: &mut Accessors,
    image: &GltfImage,
    place: &str,
) -> Result<Vec<u8>> {
    match image {
        GltfImage { buffer_view: Some(view), .. } => accessors.view_bytes(*view),
        GltfImage { uri: Some(uri), .. } => accessors.buffers.picture(uri, place),
        _ => {
            let path = accessors.buffers.path();
            Err(Error::malformed(path, place, "has neither a bufferView nor a uri"))
        }
    }
}
