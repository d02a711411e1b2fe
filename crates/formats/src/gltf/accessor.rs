//! Accessors: typed elements in views of buffers, with every number checked before use.

use super::buffers::Buffers;
use super::document::{Accessor, BufferView, Document, component_type};
use super::meshopt::{self, CompressedView};
use gltf_json::accessor::ComponentType;
use gltf_json::buffer::MAX_BYTE_STRIDE;
use std::collections::VecDeque;
use trisplat_scene::{Error, Result};

/// Bytes read at a time when elements are decoded.
const BLOCK_BYTES: u64 = 1 << 18;

/// Decompressed views kept for the next accessor: positions, colours and indices of a mesh.
const KEPT_VIEWS: usize = 4;

/// The place of an accessor's elements in their view, decompressed if necessary.
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
    document: &'a Document,
    pub(crate) buffers: Buffers<'a>,
    /// Decompressed views, as words, latest last.
    unpacked: VecDeque<(usize, Vec<u32>)>,
    block: Vec<u8>,
}

impl<'a> Accessors<'a> {
    pub(crate) fn new(document: &'a Document, buffers: Buffers<'a>) -> Self {
        Self { document, buffers, unpacked: VecDeque::new(), block: Vec::new() }
    }

    fn malformed(&self, place: String, reason: impl Into<String>) -> Error {
        Error::malformed(self.buffers.path(), place, reason)
    }

    /// The accessor of that number.
    pub(crate) fn accessor(&self, index: usize) -> Result<&'a Accessor> {
        self.document.accessors.get(index).ok_or_else(|| {
            let has = self.document.accessors.len();
            self.malformed(format!("accessor {index}"), format!("does not exist: the file has {has}"))
        })
    }

    /// The view of that number.
    pub(crate) fn view(&self, index: usize) -> Result<&'a BufferView> {
        self.document.buffer_views.get(index).ok_or_else(|| {
            let has = self.document.buffer_views.len();
            self.malformed(format!("bufferView {index}"), format!("does not exist: the file has {has}"))
        })
    }

    /// A checked accessor: every element is within its view, and the view's bytes exist. The caller counts
    /// the elements' memory by [`Buffers::spend`].
    pub(crate) fn layout(&mut self, index: usize) -> Result<ElementLayout> {
        let accessor = self.accessor(index)?;
        let place = || format!("accessor {index}");
        let component = component_type(accessor.component_type).ok_or_else(|| {
            self.malformed(place(), format!("has the unknown component type {}", accessor.component_type))
        })?;
        let width = match accessor.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => {
                return Err(
                    self.malformed(place(), format!("has type {other:?}; expected SCALAR or VEC2 to VEC4"))
                );
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
                Err(self
                    .malformed(place, format!("has byteStride {stride}; expected 1 to {MAX_BYTE_STRIDE}")))
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
                let bytes = bytes.map_err(|reason| self.malformed(format!("bufferView {index}"), reason))?;
                self.check_range(index, compressed.buffer, compressed.byte_offset, compressed.byte_length)?;
                bytes
            }
            None => {
                self.check_range(index, view.buffer, view.byte_offset, view.byte_length)?;
                view.byte_length
            }
        };
        if layout.stride < layout.element() {
            let (stride, element) = (layout.stride, layout.element());
            return Err(
                self.malformed(place, format!("has {element} bytes per element, {stride} bytes apart"))
            );
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
        let layout = &self.layout(index)?;
        if layout.view.is_some() {
            let mut at = 0;
            self.for_each_block(layout, |block, stride| {
                at = decode(layout, block, stride, at, fill, &mut each);
            })?;
        } else {
            let mut zero = [0.0; N];
            zero[(layout.width as usize).min(N)..].fill(fill);
            (0..layout.count as usize).for_each(|i| each(i, zero));
        }
        self.for_each_sparse(index, layout, fill, each)
    }

    /// Fills `bytes` with all elements of an accessor if they are stored without gaps and uncompressed;
    /// returns whether they were.
    pub(crate) fn read_contiguous(&mut self, index: usize, bytes: &mut [u8]) -> Result<bool> {
        let layout = self.layout(index)?;
        let Some(view) = layout.view.filter(|_| layout.stride == layout.element()) else { return Ok(false) };
        let (view, sparse) = (self.view(view)?, self.accessor(index)?.sparse.is_some());
        if sparse || view.extensions.meshopt.is_some() || bytes.len() as u64 != layout.count * layout.stride {
            return Ok(false);
        }
        self.buffers.read(view.buffer, view.byte_offset + layout.offset, bytes)?;
        Ok(true)
    }

    /// Hands out the bytes of all elements in blocks of whole strides.
    fn for_each_block(&mut self, layout: &ElementLayout, mut each: impl FnMut(&[u8], u64)) -> Result<()> {
        let Some(index) = layout.view else { return Ok(()) };
        let view = self.view(index)?;
        if let Some(compressed) = &view.extensions.meshopt {
            let words = self.unpack(index, compressed)?;
            let bytes: &[u8] = bytemuck::cast_slice(words);
            let end = layout.offset + layout.span().unwrap_or(0);
            each(bytes.get(layout.offset as usize..end as usize).unwrap_or_default(), layout.stride);
            return Ok(());
        }
        let start = view.byte_offset + layout.offset;
        let step = (BLOCK_BYTES / layout.stride).max(1);
        let mut block = std::mem::take(&mut self.block);
        let mut first = 0;
        while first < layout.count {
            let count = step.min(layout.count - first);
            // The last element of a view may lack its padding.
            let bytes = (count - 1) * layout.stride + layout.element();
            block.resize(bytes as usize, 0);
            self.buffers.read(view.buffer, start + first * layout.stride, &mut block)?;
            each(&block, layout.stride);
            first += count;
        }
        self.block = block;
        Ok(())
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
        let words = meshopt::decode(compressed, &packed).map_err(|reason| self.malformed(place, reason))?;
        if self.unpacked.len() == KEPT_VIEWS {
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
            return Err(
                self.malformed(place(), format!("replaces {} of {} elements", sparse.count, layout.count))
            );
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
        self.for_each_block(&numbers, |block, stride| {
            decode(&numbers, block, stride, 0, 0.0, &mut |_, [number]: [f64; 1]| at.push(number as usize));
        })?;
        if let Some(bad) = at.iter().find(|&&number| number as u64 >= layout.count) {
            return Err(self.malformed(place(), format!("replaces element {bad} of {}", layout.count)));
        }
        let mut next = 0;
        self.for_each_block(&values, |block, stride| {
            next = decode(&values, block, stride, next, fill, &mut |i, value| each(at[i], value));
        })
    }
}

/// Bytes of a component.
fn size(component: ComponentType) -> u64 {
    component.size() as u64
}

/// The number that 1.0 is stored as when integers are normalised.
fn one(component: ComponentType) -> f64 {
    match component {
        ComponentType::I8 => f64::from(i8::MAX),
        ComponentType::U8 => f64::from(u8::MAX),
        ComponentType::I16 => f64::from(i16::MAX),
        ComponentType::U16 => f64::from(u16::MAX),
        ComponentType::U32 => f64::from(u32::MAX),
        ComponentType::F32 => 1.0,
    }
}

/// Hands every element of `block` to `each`, numbered from `first`; returns the number after the last.
fn decode<const N: usize>(
    layout: &ElementLayout,
    block: &[u8],
    stride: u64,
    first: usize,
    fill: f64,
    each: &mut impl FnMut(usize, [f64; N]),
) -> usize {
    let one = if layout.normalized { one(layout.component) } else { 1.0 };
    let unit = |value: f64| if layout.normalized { (value / one).max(-1.0) } else { value };
    match layout.component {
        ComponentType::I8 => {
            elements(layout, block, stride, first, fill, each, |[a]| unit(f64::from(a as i8)))
        }
        ComponentType::U8 => elements(layout, block, stride, first, fill, each, |[a]| unit(f64::from(a))),
        ComponentType::I16 => {
            elements(layout, block, stride, first, fill, each, |b| unit(f64::from(i16::from_le_bytes(b))))
        }
        ComponentType::U16 => {
            elements(layout, block, stride, first, fill, each, |b| unit(f64::from(u16::from_le_bytes(b))))
        }
        ComponentType::U32 => {
            elements(layout, block, stride, first, fill, each, |b| unit(f64::from(u32::from_le_bytes(b))))
        }
        ComponentType::F32 => {
            elements(layout, block, stride, first, fill, each, |b| f64::from(f32::from_le_bytes(b)))
        }
    }
}

fn elements<const N: usize, const B: usize>(
    layout: &ElementLayout,
    block: &[u8],
    stride: u64,
    first: usize,
    fill: f64,
    each: &mut impl FnMut(usize, [f64; N]),
    number: impl Fn([u8; B]) -> f64,
) -> usize {
    let (width, mut at) = (layout.width as usize, first);
    // The last element may lack its padding, so it can be a short chunk.
    for element in block.chunks(stride as usize) {
        let (cells, _) = element.as_chunks::<B>();
        let mut values = [fill; N];
        for (value, cell) in values.iter_mut().zip(&cells[..width.min(cells.len())]) {
            *value = number(*cell);
        }
        each(at, values);
        at += 1;
    }
    at
}
