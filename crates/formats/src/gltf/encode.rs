//! The binary buffer: positions, normals, colours and indices as glTF stores them, compressed or
//! not.

use super::container::{stream_offsets, write_padding};
use super::options::{ColorEncoding, GltfOptions, TextureFormat};
use super::part::{PartVertices, ScenePart, Stream, all_streams, parts};
use super::sh::{ShExtras, StoredSh};
use crate::finish::is_far;
use glam::{DVec3, Vec2, Vec3};
use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter, PrettyFormatter, Serializer};
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::LazyLock;
use trisplat_scene::math::color::srgb8_from_linear;
use trisplat_scene::mesh::Colors;
use trisplat_scene::{Asset, Error, Result, Texture, parallel};

/// Bytes encoded before they are written.
const BLOCK_BYTES: u64 = 1 << 20;

/// Writes one stream in blocks of about 1 MiB; `scratch` is reused from call to call.
pub(crate) fn write(
    out: &mut dyn Write,
    part: &ScenePart,
    stream: Stream,
    options: &GltfOptions,
    scratch: &mut Vec<u8>,
) -> io::Result<()> {
    if let Some(bytes) = contiguous_bytes(part, stream) {
        return out.write_all(bytes);
    }
    let stride = part.stride(stream, options);
    let count = part.count(stream);
    // Whole triangles, so that a block starts with a face.
    let step = (BLOCK_BYTES / stride) as usize / 3 * 3;
    for start in (0..count).step_by(step) {
        let range = start..count.min(start + step);
        scratch.resize(range.len() * stride as usize, 0);
        fill(scratch, part, stream, range, options);
        out.write_all(scratch)?;
    }
    Ok(())
}

/// All bytes of one stream.
pub(crate) fn bytes(part: &ScenePart, stream: Stream, options: &GltfOptions) -> Vec<u8> {
    let mut bytes = vec![0; part.bytes(stream, options) as usize];
    fill(&mut bytes, part, stream, 0..part.count(stream), options);
    bytes
}

/// The stream's bytes if memory has them in this form: float positions of a run of vertices.
fn contiguous_bytes<'a>(part: &ScenePart<'a>, stream: Stream) -> Option<&'a [u8]> {
    match (&part.vertices, stream, part.grid) {
        (PartVertices::Run(run), Stream::Positions, None) if cfg!(target_endian = "little") => {
            Some(bytemuck::cast_slice(&part.mesh.positions[run.clone()]))
        }
        _ => None,
    }
}

/// Fills `out` with the elements `range` of a stream; a range of vertices starts with a face.
fn fill(
    out: &mut [u8],
    part: &ScenePart,
    stream: Stream,
    range: Range<usize>,
    options: &GltfOptions,
) {
    let mesh = part.mesh;
    match stream {
        Stream::Positions => match part.grid {
            Some(grid) => vertices(out, &mesh.positions, part, range, |p| -> [u8; 8] {
                let code = grid.code(p);
                bytes_of([code.x, code.y, code.z, 0].map(u16::to_le_bytes))
            }),
            None => vertices(out, &mesh.positions, part, range, |p| -> [u8; 12] {
                bytes_of(p.to_array().map(f32::to_le_bytes))
            }),
        },
        Stream::Normals if part.grid.is_some() => fill_normals(out, part, range, |n| -> [u8; 4] {
            let [x, y, z] = n.to_array().map(|x| (127.0 * x).round() as i8);
            [x, y, z, 0].map(|byte| byte.to_le_bytes()[0])
        }),
        Stream::Normals => fill_normals(out, part, range, |n| -> [u8; 12] {
            bytes_of(n.to_array().map(f32::to_le_bytes))
        }),
        Stream::Colors => fill_colors(out, part, range, options.colors),
        Stream::TexCoords => fill_tex_coords(out, part, range),
        Stream::Indices => {
            let first = 3 * part.faces.start;
            let local =
                mesh.indices[first + range.start..first + range.end].iter().map(|&v| part.local(v));
            if part.has_short_indices() {
                cells(out, local, |i| (i as u16).to_le_bytes());
            } else {
                cells(out, local, |i| (i as u32).to_le_bytes());
            }
        }
    }
}

/// Encodes a normal once and stores it for every vertex that has it.
fn fill_normals<const N: usize>(
    out: &mut [u8],
    part: &ScenePart,
    range: Range<usize>,
    code: impl Fn(Vec3) -> [u8; N],
) {
    if part.indexed {
        return vertices(out, &part.vertex_normals, part, range, code);
    }
    faces(out, &part.mesh.normals, part, range, code);
}

/// Coordinates in [0, 1] as 16-bit numbers; three per face without shared vertices.
fn fill_tex_coords(out: &mut [u8], part: &ScenePart, range: Range<usize>) {
    let code = |uv: Vec2| -> [u8; 4] {
        bytes_of(uv.to_array().map(|x| (nearest(x.clamp(0.0, 1.0), 65535.0) as u16).to_le_bytes()))
    };
    let faces = part.faces.start + range.start / 3..part.faces.start + range.end / 3;
    if let Some(layout) = part.sh {
        return cells(out, faces.flat_map(|face| [layout.coordinates(face); 3]), code);
    }
    let Some(texture) = &part.mesh.texture else { return };
    if part.indexed {
        return vertices(out, &part.vertex_uvs, part, range, code);
    }
    cells(out, texture.uvs[faces].as_flattened().iter().copied(), code);
}

fn fill_colors(out: &mut [u8], part: &ScenePart, range: Range<usize>, encoding: ColorEncoding) {
    match encoding {
        ColorEncoding::U16Linear => colors(out, part, range, |c| -> [u8; 8] {
            let [r, g, b] = c.map(|x| nearest(x, 65535.0) as u16);
            bytes_of([r, g, b, u16::MAX].map(u16::to_le_bytes))
        }),
        ColorEncoding::U8Srgb => colors(out, part, range, |c| {
            let [r, g, b] = c.map(srgb8_from_linear);
            [r, g, b, u8::MAX]
        }),
        ColorEncoding::F32Linear => colors(out, part, range, |c| -> [u8; 16] {
            let [r, g, b] = c.map(|x| if x > 0.0 { x.min(1.0) } else { 0.0 });
            bytes_of([r, g, b, 1.0].map(f32::to_le_bytes))
        }),
        ColorEncoding::F32Srgb => colors(out, part, range, |c| -> [u8; 16] {
            let [r, g, b] = c.map(|x| CODES[usize::from(srgb8_from_linear(x))]);
            bytes_of([r, g, b, 1.0].map(f32::to_le_bytes))
        }),
    }
}

/// The nearest of `steps` whole steps, before truncation; exact, because the product fits f64.
fn nearest(x: f32, steps: f64) -> f64 {
    f64::from(x) * steps + 0.5
}

/// Encodes a colour once and stores it for every vertex that has it.
fn colors<const N: usize>(
    out: &mut [u8],
    part: &ScenePart,
    range: Range<usize>,
    code: impl Fn([f32; 3]) -> [u8; N],
) {
    match &part.mesh.colors {
        Colors::Face(colors) => faces(out, colors, part, range, code),
        Colors::Vertex(colors) => vertices(out, colors, part, range, code),
    }
}

/// Stores the array's values of the faces of the vertices `range` of a part, three times each.
fn faces<T: Copy, const N: usize>(
    out: &mut [u8],
    values: &[T],
    part: &ScenePart,
    range: Range<usize>,
    code: impl Fn(T) -> [u8; N],
) {
    let faces = part.faces.start + range.start / 3..part.faces.start + range.end / 3;
    for (triangle, &value) in out.chunks_exact_mut(3 * N).zip(&values[faces]) {
        let code = code(value);
        for corner in triangle.chunks_exact_mut(N) {
            corner.copy_from_slice(&code);
        }
    }
}

/// Stores the array's values of the vertices `range` of a part.
fn vertices<T: Copy, const N: usize>(
    out: &mut [u8],
    values: &[T],
    part: &ScenePart,
    range: Range<usize>,
    code: impl Fn(T) -> [u8; N],
) {
    match &part.vertices {
        PartVertices::Run(run) => {
            cells(
                out,
                values[run.start + range.start..run.start + range.end].iter().copied(),
                code,
            );
        }
        PartVertices::Listed(ids) => {
            cells(out, ids[range].iter().map(|&id| values[id as usize]), code)
        }
    }
}

/// Stores one cell of N bytes for every value.
fn cells<T, const N: usize>(
    out: &mut [u8],
    values: impl Iterator<Item = T>,
    code: impl Fn(T) -> [u8; N],
) {
    for (cell, value) in out.chunks_exact_mut(N).zip(values) {
        cell.copy_from_slice(&code(value));
    }
}

fn bytes_of<const M: usize, const K: usize, const N: usize>(parts: [[u8; K]; M]) -> [u8; N] {
    const { assert!(M * K == N) };
    let mut bytes = [0; N];
    bytes.copy_from_slice(parts.as_flattened());
    bytes
}

/// The smallest float not below code / 255: an importer that truncates 255 x gets the code back.
static CODES: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let near = code as f32 / 255.0;
        if f64::from(near) * 255.0 < code as f64 { near.next_up() } else { near }
    })
});

// ---- Streams compressed with meshopt ------------------------------------------------------------

/// EXT_meshopt_compression knows vertex codec version 0 only; the crate's own default is 1.
const VERTEX_CODEC: i32 = 0;

/// The compressed streams in file order. At most one per thread is uncompressed at a time.
///
/// # Errors
/// Failures of the encoder, with the remedy.
pub(crate) fn compress(parts: &[ScenePart], options: &GltfOptions) -> Result<Vec<Vec<u8>>, String> {
    let streams: Vec<(&ScenePart, Stream)> = all_streams(parts).collect();
    let compressed = parallel::map(streams, |_, (part, stream)| {
        let encoded = match stream {
            Stream::Indices => {
                let corners = 3 * part.faces.start..3 * part.faces.end;
                let local: Vec<u32> =
                    part.mesh.indices[corners].iter().map(|&v| part.local(v) as u32).collect();
                ::meshopt::encode_index_buffer(&local, part.vertices.len())
                    .map_err(|e| e.to_string())
            }
            _ => encode_vertices(&bytes(part, stream, options), part.stride(stream, options)),
        };
        match encoded {
            Ok(bytes) if !bytes.is_empty() => Ok(bytes),
            Ok(_) => Err(encoder_error(part, "no bytes came out")),
            Err(e) => Err(encoder_error(part, &e)),
        }
    });
    compressed.into_iter().collect()
}

fn encode_vertices(bytes: &[u8], stride: u64) -> Result<Vec<u8>, String> {
    fn cells<const N: usize>(bytes: &[u8]) -> Result<Vec<u8>, String> {
        let (cells, _) = bytes.as_chunks::<N>();
        ::meshopt::encode_vertex_buffer_level(cells, 0, Some(VERTEX_CODEC))
            .map_err(|e| e.to_string())
    }
    match stride {
        4 => cells::<4>(bytes),
        8 => cells::<8>(bytes),
        12 => cells::<12>(bytes),
        16 => cells::<16>(bytes),
        _ => Err(format!("no element has {stride} bytes")),
    }
}

fn encoder_error(part: &ScenePart, why: &str) -> String {
    format!("meshopt could not encode {}: {why}; write without compression", part.name)
}

// ---- The layout of the binary buffer: the streams of all parts, compressed or not, then pictures

/// The content of a file, without the bytes themselves.
pub(crate) struct GltfContent<'a> {
    pub(crate) asset: &'a Asset,
    pub(crate) options: &'a GltfOptions,
    pub(crate) parts: Vec<ScenePart<'a>>,
    /// Compressed streams in file order, when compressing.
    pub(crate) compressed: Option<Vec<Vec<u8>>>,
    /// Start of each stream in the file's buffer, in file order.
    pub(crate) starts: Vec<u64>,
    pub(crate) bin_bytes: u64,
    /// The pages of the texture, behind the streams, when there is one.
    pub(crate) pictures: Vec<EmbeddedPicture>,
    /// Degree and scales of the only picture, if it holds spherical harmonics.
    pub(crate) sh: Option<ShExtras>,
}

/// A picture in the file's buffer.
pub(crate) struct EmbeddedPicture {
    pub(crate) start: u64,
    pub(crate) bytes: Vec<u8>,
}

/// The format of the picture of a page: exact ones stay exact.
pub(crate) fn page_format(page: &Texture, options: &GltfOptions) -> TextureFormat {
    if page.style.is_exact { TextureFormat::Png } else { options.texture }
}

impl<'a> GltfContent<'a> {
    pub(crate) fn new(path: &Path, asset: &'a Asset, options: &'a GltfOptions) -> Result<Self> {
        let sh = StoredSh::of(asset)?;
        let parts = parts(path, asset, sh.as_ref().map(|sh| sh.layout), options)?;
        let compressed = if options.meshopt {
            Some(compress(&parts, options).map_err(|e| Error::unsupported(path, e))?)
        } else {
            None
        };
        let (starts, mut bin_bytes) = match &compressed {
            Some(streams) => stream_offsets(streams.iter().map(|s| s.len() as u64)),
            None => stream_offsets(
                all_streams(&parts).map(|(part, stream)| part.bytes(stream, options)),
            ),
        };
        let pages = asset.mesh.texture.iter().flat_map(|texture| &texture.pages);
        let pages = pages.map(|page| page_format(page, options).bytes(page.picture()));
        let mut pictures = Vec::new();
        for bytes in pages.chain(sh.iter().map(|sh| sh.picture.to_png_of_numbers())) {
            let bytes = bytes?;
            let start = bin_bytes.next_multiple_of(4);
            bin_bytes = start + bytes.len() as u64;
            pictures.push(EmbeddedPicture { start, bytes });
        }
        let sh = sh.map(|sh| sh.extras);
        Ok(Self { asset, options, parts, compressed, starts, bin_bytes, pictures, sh })
    }

    /// Streams the binary buffer, padding between the streams included.
    pub(crate) fn write_bin(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut at = 0;
        let mut scratch = Vec::new();
        for (i, (part, stream)) in all_streams(&self.parts).enumerate() {
            write_padding(out, at)?;
            at = self.starts[i];
            at += match &self.compressed {
                Some(streams) => {
                    out.write_all(&streams[i])?;
                    streams[i].len() as u64
                }
                None => {
                    write(out, part, stream, self.options, &mut scratch)?;
                    part.bytes(stream, self.options)
                }
            };
        }
        for picture in &self.pictures {
            write_padding(out, at)?;
            out.write_all(&picture.bytes)?;
            at = picture.start + picture.bytes.len() as u64;
        }
        Ok(())
    }
}

// ---- JSON in which numbers far from 0 have all their digits -------------------------------------

/// The text of `value`, on one line or indented.
pub(crate) fn text(value: &impl Serialize, is_pretty: bool) -> serde_json::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if is_pretty {
        value
            .serialize(&mut Serializer::with_formatter(&mut bytes, Exact(PrettyFormatter::new())))?
    } else {
        value.serialize(&mut Serializer::with_formatter(&mut bytes, Exact(CompactFormatter)))?
    }
    Ok(bytes)
}

/// A format that writes far numbers with all their digits.
struct Exact<F>(F);

/// Forwards methods of [`Formatter`].
macro_rules! same {
    ($($name:ident($($argument:ident: $kind:ty),*)),* $(,)?) => {
        $(fn $name<W: ?Sized + Write>(&mut self, writer: &mut W $(, $argument: $kind)*) -> io::Result<()> {
            self.0.$name(writer $(, $argument)*)
        })*
    };
}

impl<F: Formatter> Formatter for Exact<F> {
    fn write_f32<W: ?Sized + Write>(&mut self, writer: &mut W, value: f32) -> io::Result<()> {
        let exact = f64::from(value);
        if is_far(DVec3::splat(exact)) {
            self.0.write_f64(writer, exact)
        } else {
            self.0.write_f32(writer, value)
        }
    }

    same! {
        begin_array(), end_array(), begin_array_value(first: bool), end_array_value(),
        begin_object(), end_object(), begin_object_key(first: bool), end_object_key(),
        begin_object_value(), end_object_value(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::math::color::linear_from_srgb;

    #[test]
    fn truncating_a_float_code_gives_the_code() {
        for code in 0..=255u8 {
            let x = CODES[usize::from(code)];
            assert!((0.0..=1.0).contains(&x));
            assert_eq!((f64::from(x) * 255.0) as u8, code);
            assert_eq!((x * 255.0) as u8, code);
            assert_eq!(srgb8_from_linear(linear_from_srgb(x)), code);
        }
    }
}

#[cfg(test)]
mod exact_tests {
    use super::*;

    #[test]
    fn far_numbers_have_all_their_digits_and_nothing_else_changes() {
        let value = serde_json::json!({ "a": [1.5, { "b": [] }], "c": {}, "d": "e" });
        assert_eq!(text(&value, true).unwrap(), serde_json::to_vec_pretty(&value).unwrap());
        assert_eq!(text(&value, false).unwrap(), serde_json::to_vec(&value).unwrap());
        let numbers = [0.1f32, 1_814_142.9, -123_456_792.0, 4095.9];
        assert_eq!(text(&numbers, false).unwrap(), b"[0.1,1814142.875,-123456792.0,4095.9]");
    }
}
