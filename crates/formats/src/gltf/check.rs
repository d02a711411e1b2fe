//! Rules of glTF 2.0 that reading a file does not check: container lengths and padding, alignment, bounds
//! that equal the data, ranges, declared extensions; and sizes that engines handle well.

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::container::{ContainerFile, GlbChunk};
use super::document::{self, Document, Primitive};
use super::extensions::{MESHOPT, MESHOPT_KHR, QUANTIZATION};
use super::limits::{MAX_SHORT_VERTICES, READABLE_BYTES};
use super::textures;
use crate::findings::{Findings, Positions, Severity};
use crate::{ReadOptions, Source};
use gltf_json::accessor::ComponentType;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{Read, Seek, SeekFrom};
use trisplat_scene::{Error, Result};

/// Adds the faults of a glTF file; `for_engines` is false for a scene that only its own page reads.
pub fn check(
    mut source: Source,
    options: &ReadOptions,
    for_engines: bool,
    findings: &mut Findings,
) -> Result<()> {
    let container = match ContainerFile::read(&mut source, &options.limits) {
        Ok(container) => container,
        Err(error) => return findings.take(error),
    };
    let document: Document = match document::parse(&source.path, &container.json, &options.limits) {
        Ok(document) => document,
        Err(error) => return findings.take(error),
    };
    check_container(&mut source, &container, &document, findings)?;
    check_extensions(&document, for_engines, findings);
    check_cameras(&container.json, findings);
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    let mut checker = AccessorChecker {
        accessors: Accessors::new(&document, buffers),
        document: &document,
        seen: BTreeSet::new(),
    };
    for (m, mesh) in document.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            checker.primitive(&format!("mesh {m} primitive {p}"), primitive, findings)?;
        }
    }
    check_pictures(&document, &mut checker.accessors, findings)
}

/// Pictures that are not there: engines draw their triangles white, or nothing at all.
fn check_pictures(document: &Document, accessors: &mut Accessors, findings: &mut Findings) -> Result<()> {
    for (i, image) in document.images.iter().enumerate() {
        let place = format!("image {i}");
        match textures::picture_bytes(accessors, image, &place) {
            Ok(_) => {}
            Err(Error::Malformed { reason, .. }) => findings.error(place, reason),
            Err(error) => findings.error(place, error.to_string()),
        }
    }
    Ok(())
}

fn check_container(
    source: &mut Source,
    container: &ContainerFile,
    document: &Document,
    findings: &mut Findings,
) -> Result<()> {
    if source.len > READABLE_BYTES {
        let what = format!("has {} bytes: Unity, web pages and older Godot read less than 2 GiB", source.len);
        findings.warning("file", what);
    }
    if container.chunks.is_empty() {
        return Ok(());
    }
    if container.length != source.len {
        let what = format!("gives the length {}, but the file has {} bytes", container.length, source.len);
        findings.error("header", what);
    }
    for (i, chunk) in container.chunks.iter().enumerate() {
        if !chunk.is_aligned() {
            findings.error(format!("chunk {i}"), format!("has {} bytes, no multiple of 4", chunk.length));
        }
        if i > 0 && (i > 1 || !chunk.is_bin()) {
            findings.warning(format!("chunk {i}"), "is of a kind that glTF 2.0 does not know");
        }
    }
    if container.json.last().is_some_and(|last| !matches!(last, b'}' | b' ')) {
        findings.error("chunk 0", "is JSON padded with something other than spaces");
    }
    let buffer = document.buffers.first().filter(|buffer| buffer.uri.is_none());
    match (container.bin(), buffer) {
        (Some(bin), Some(buffer)) => check_padding(source, bin, buffer.byte_length.0, findings)?,
        (Some(_), None) => findings.warning("chunk 1", "is used by no buffer"),
        (None, _) => {}
    }
    Ok(())
}

/// The binary chunk may end with up to three zeros more than its buffer has.
fn check_padding(source: &mut Source, bin: GlbChunk, used: u64, findings: &mut Findings) -> Result<()> {
    let Some(rest) = bin.length.checked_sub(used) else { return Ok(()) };
    if rest > 3 {
        findings.warning("chunk 1", format!("has {rest} bytes more than buffer 0; expected at most 3"));
        return Ok(());
    }
    let mut padding = vec![0; rest as usize];
    let mut file = &*source.file;
    let read = file.seek(SeekFrom::Start(bin.start + used)).and_then(|_| file.read_exact(&mut padding));
    read.map_err(|e| trisplat_scene::Error::io(&source.path, e))?;
    if padding.iter().any(|byte| *byte != 0) {
        findings.error("chunk 1", "is padded with something other than zeros");
    }
    Ok(())
}

fn check_extensions(document: &Document, for_engines: bool, findings: &mut Findings) {
    let used = |name: &str| document.extensions_used.iter().any(|used| used == name);
    for name in document.extensions_required.iter().filter(|name| !used(name)) {
        findings.error("extensionsRequired", format!("names {name}, which extensionsUsed does not"));
    }
    let compressed = document.buffer_views.iter().any(|view| view.extensions.meshopt.is_some());
    let declared = used(MESHOPT) || used(MESHOPT_KHR);
    if compressed && !declared {
        findings.error("extensionsUsed", format!("lacks {MESHOPT}, which a bufferView uses"));
    }
    if compressed || used(QUANTIZATION) {
        findings.positions = Positions::Encoded;
        if for_engines {
            let what = "positions are quantised or compressed: some engines refuse the file";
            findings.add(Severity::Note, "extensionsUsed", what);
        }
    }
}

/// The cameras of a document and their planes.
#[derive(serde::Deserialize)]
struct Cameras {
    #[serde(default)]
    cameras: Vec<Value>,
}

fn check_cameras(json: &[u8], findings: &mut Findings) {
    let cameras = serde_json::from_slice::<Cameras>(json).map_or(Vec::new(), |found| found.cameras);
    for (i, camera) in cameras.iter().enumerate() {
        let Some(lens) = camera.get("perspective") else { continue };
        for name in ["yfov", "znear"] {
            if !lens[name].as_f64().is_some_and(|number| number > 0.0) {
                findings.error(format!("camera {i}"), format!("has a {name} that is no number above 0"));
            }
        }
        let nearer = |far: f64| lens["znear"].as_f64().is_some_and(|near| near >= far);
        if lens["zfar"].as_f64().is_some_and(nearer) {
            findings.error(format!("camera {i}"), "ends nearer than it begins");
        }
    }
}

/// Walks the accessors of triangles, each once.
struct AccessorChecker<'a> {
    accessors: Accessors<'a>,
    document: &'a Document,
    seen: BTreeSet<usize>,
}

impl AccessorChecker<'_> {
    fn primitive(&mut self, place: &str, primitive: &Primitive, findings: &mut Findings) -> Result<()> {
        let Some(position) = primitive.attributes.position else { return Ok(()) };
        let count = self.positions(position, findings)?;
        if let Some(vertices) = count.filter(|count| *count > MAX_SHORT_VERTICES) {
            let what = format!(
                "has {vertices} vertices: above {MAX_SHORT_VERTICES} engines need 32-bit indices, and they cull \
                 it only as a whole"
            );
            findings.warning(place, what);
        }
        if let Some(color) = primitive.attributes.color {
            self.colors(color, findings)?;
        }
        if let Some(indices) = primitive.indices {
            self.indices(indices, findings)?;
        }
        Ok(())
    }

    /// True the first time an accessor comes up; its alignment is checked then.
    fn is_first_check(&mut self, index: usize, is_vertex: bool, findings: &mut Findings) -> Result<bool> {
        if !self.seen.insert(index) {
            return Ok(false);
        }
        let layout = match self.accessors.layout(index) {
            Ok(layout) => layout,
            Err(error) => {
                findings.take(error)?;
                return Ok(false);
            }
        };
        let Some(view) = self.accessors.accessor(index)?.buffer_view else { return Ok(true) };
        let start = match self.accessors.view(view)? {
            view if view.extensions.meshopt.is_some() => 0,
            view => view.byte_offset,
        };
        let size = layout.component.size() as u64;
        if (start + layout.offset) % size != 0 || layout.offset % size != 0 || layout.stride % size != 0 {
            findings.error(
                format!("accessor {index}"),
                format!(
                    "starts at byte {} and steps by {}; expected multiples of {size}",
                    start + layout.offset,
                    layout.stride
                ),
            );
        } else if is_vertex && (layout.offset % 4 != 0 || layout.stride % 4 != 0) {
            findings.error(
                format!("accessor {index}"),
                format!(
                    "has vertices {} bytes apart from byte {}; expected multiples of 4",
                    layout.stride, layout.offset
                ),
            );
        }
        Ok(true)
    }

    /// Positions must be finite and within bounds that they touch. Returns their number when readable.
    fn positions(&mut self, index: usize, findings: &mut Findings) -> Result<Option<u64>> {
        if !self.is_first_check(index, true, findings)? {
            return Ok(None);
        }
        let layout = self.accessors.layout(index)?;
        let place = format!("accessor {index}");
        let declared = self.document.extensions_used.iter().any(|name| name == QUANTIZATION);
        if layout.component != ComponentType::F32 && !declared {
            findings.error(&place, format!("has integer positions without {QUANTIZATION}"));
        }
        let (mut low, mut high, mut bad) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], Vec::new());
        let read = self.accessors.for_each_stored(index, |i, position: [f64; 3]| {
            if position.iter().any(|x| !x.is_finite()) {
                bad.push(i);
                return;
            }
            for axis in 0..3 {
                low[axis] = low[axis].min(position[axis]);
                high[axis] = high[axis].max(position[axis]);
            }
        });
        if let Err(error) = read {
            findings.take(error)?;
            return Ok(None);
        }
        if let Some(first) = bad.first() {
            findings.error(
                &place,
                format!("has {} positions that are not finite, the first at {first}", bad.len()),
            );
        }
        let accessor = self.accessors.accessor(index)?;
        for (name, given, found) in [("min", &accessor.min, low), ("max", &accessor.max, high)] {
            match given.as_ref().map(numbers) {
                _ if layout.count == bad.len() as u64 => {}
                None => findings.error(&place, format!("has positions without {name}; expected {found:?}")),
                Some(Some(given)) if given.iter().zip(found).all(|(g, f)| *g as f32 == f as f32) => {}
                Some(_) => {
                    let given = given.as_ref().map(Value::to_string).unwrap_or_default();
                    findings.error(&place, format!("has {name} {given}, but its data have {found:?}"));
                }
            }
        }
        Ok(Some(layout.count))
    }

    fn colors(&mut self, index: usize, findings: &mut Findings) -> Result<()> {
        if !self.is_first_check(index, true, findings)? {
            return Ok(());
        }
        let (mut bad, mut first) = (0u64, None);
        let read = self.accessors.for_each(index, 1.0, |i, color: [f64; 4]| {
            if !color.iter().all(|c| (0.0..=1.0).contains(c)) {
                bad += 1;
                first = first.or(Some(i));
            }
        });
        if let Err(error) = read {
            return findings.take(error);
        }
        if let Some(first) = first {
            let what = format!("has {bad} colours outside 0 to 1, the first at {first}");
            findings.error(format!("accessor {index}"), what);
        }
        Ok(())
    }

    fn indices(&mut self, index: usize, findings: &mut Findings) -> Result<()> {
        if !self.is_first_check(index, false, findings)? {
            return Ok(());
        }
        let restart = match self.accessors.layout(index)?.component {
            ComponentType::U8 => 255.0,
            ComponentType::U16 => 65_535.0,
            _ => f64::from(u32::MAX),
        };
        let mut found = None;
        let read = self.accessors.for_each(index, 0.0, |i, [value]: [f64; 1]| {
            if value == restart {
                found = found.or(Some(i));
            }
        });
        if let Err(error) = read {
            return findings.take(error);
        }
        if let Some(at) = found {
            findings
                .error(format!("accessor {index}"), format!("holds {restart} at {at}, which means restart"));
        }
        Ok(())
    }
}

/// Three numbers, if the value is an array of three.
fn numbers(value: &Value) -> Option<[f64; 3]> {
    let list = value.as_array().filter(|list| list.len() == 3)?;
    Some([list[0].as_f64()?, list[1].as_f64()?, list[2].as_f64()?])
}
