//! Findings about a valid glTF file that engines reject or draw badly: sizes, encodings, missing
//! pictures. Khronos' validator judges the rules of glTF 2.0 themselves.

use super::accessor::{self, Accessors};
use super::buffers::Buffers;
use super::container::ContainerFile;
use super::document::{self, GltfDocument, MAX_SHORT_VERTICES, QUANTIZATION, READABLE_BYTES};
use crate::{ReadOptions, Source};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{Error, Result};

/// Adds the findings of a glTF file; `for_engines` is false for a scene that only its own page
/// reads.
pub(crate) fn check(
    mut source: Source,
    options: &ReadOptions,
    for_engines: bool,
    findings: &mut Findings,
) -> Result<()> {
    let container = match ContainerFile::read(&mut source, &options.limits) {
        Ok(container) => container,
        Err(error) => return findings.take(error),
    };
    let document: GltfDocument =
        match document::parse(&source.path, &container.json, &options.limits) {
            Ok(document) => document,
            Err(error) => return findings.take(error),
        };
    if source.len > READABLE_BYTES {
        let what = format!(
            "has {} bytes: Unity, web pages and older Godot read less than 2 GiB",
            source.len
        );
        findings.warning("file", what);
    }
    let quantised = document.extensions_used.iter().any(|name| name == QUANTIZATION);
    if for_engines
        && (quantised || document.buffer_views.iter().any(|view| view.extensions.meshopt.is_some()))
    {
        let what = "positions are quantised or compressed: some engines refuse the file";
        findings.add(Severity::Note, "extensionsUsed", what);
    }
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    let mut accessors = Accessors::new(&document, buffers);
    check_sizes(&document, &mut accessors, findings);
    check_pictures(&document, &mut accessors, findings);
    Ok(())
}

/// Meshes that engines cull only as a whole.
fn check_sizes(document: &GltfDocument, accessors: &mut Accessors, findings: &mut Findings) {
    for (m, mesh) in document.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let Some(position) = primitive.attributes.position else { continue };
            // A missing accessor is a fault that reading finds.
            let Ok(layout) = accessors.layout(position) else { continue };
            if layout.count > MAX_SHORT_VERTICES {
                let what = format!(
                    "has {} vertices: above {MAX_SHORT_VERTICES} engines need 32-bit indices, and they cull it only \
                     as a whole",
                    layout.count
                );
                findings.warning(format!("mesh {m} primitive {p}"), what);
            }
        }
    }
}

/// Pictures that are not there: engines draw their triangles white, or nothing at all.
fn check_pictures(document: &GltfDocument, accessors: &mut Accessors, findings: &mut Findings) {
    for (i, image) in document.images.iter().enumerate() {
        let place = format!("image {i}");
        match accessor::picture_bytes(accessors, image, &place) {
            Ok(_) => {}
            Err(Error::Malformed { reason, .. }) => findings.error(place, reason),
            Err(error) => findings.error(place, error.to_string()),
        }
    }
}

// ---- Findings, and the list that collects them --------------------------------------------------

/// Severity of a finding.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// A note that needs no action.
    Note,
    /// The file works, but less well than it could.
    Warning,
    /// The file breaks its format's rules or cannot be drawn.
    Error,
}

/// One finding about a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Finding {
    /// Severity.
    pub severity: Severity,
    /// Place in the file: "accessor 3", "triangles 5, 17, 230 and 12 more".
    pub place: String,
    /// The fault and the remedy.
    pub what: String,
}

/// Collects findings.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    /// In the order of the file.
    pub(crate) list: Vec<Finding>,
}

impl Findings {
    /// Adds a finding at `place`.
    pub(crate) fn add(
        &mut self,
        severity: Severity,
        place: impl Into<String>,
        what: impl Into<String>,
    ) {
        self.list.push(Finding { severity, place: place.into(), what: what.into() });
    }

    /// Adds a fault.
    pub(crate) fn error(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Error, place, what);
    }

    /// Adds a warning.
    pub(crate) fn warning(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Warning, place, what);
    }

    /// Turns the error of a broken file into a finding; errors of the system stay errors.
    pub(crate) fn take(&mut self, error: Error) -> Result<()> {
        match error {
            Error::Io { .. } => return Err(error),
            Error::Malformed { at, reason, .. } => self.error(at, reason),
            Error::Unsupported { reason, .. } => self.error("file", reason),
            other => self.error("file", other.to_string()),
        }
        Ok(())
    }
}
