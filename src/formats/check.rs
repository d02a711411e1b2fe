//! Finds what is wrong with a file: what its format forbids, and what an engine would stumble over.
//!
//! Readers stop at the first fault; here every fault is a finding with its place. Faults of one kind are
//! one finding with their number and the first few places.

mod gltf;
mod scene;

use super::detect::{detect, read_as};
use super::{Format, ReadOptions, Source, bvh, html};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::scene::{Loaded, Scene};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; nothing need be done.
    Note,
    /// The file works, but less well than it could.
    Warning,
    /// The file breaks its format's rules or cannot be drawn.
    Error,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Where: "accessor 3", "triangles 5, 17, 230 and 12 more".
    pub place: String,
    /// What is wrong and what would be right.
    pub what: String,
}

/// Everything found in one file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat validation")]
pub struct Checked {
    /// The file as given.
    pub path: String,
    /// Its format.
    pub format: Format,
    /// Triangles in it, when it could be read.
    pub triangles: Option<u64>,
    /// Findings in the order of the file.
    pub findings: Vec<Finding>,
}

impl Checked {
    /// Number of findings that are this bad.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }
}

/// Collects findings.
#[derive(Debug, Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, severity: Severity, place: impl Into<String>, what: impl Into<String>) {
        self.0.push(Finding { severity, place: place.into(), what: what.into() });
    }

    fn error(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Error, place, what);
    }

    fn warning(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Warning, place, what);
    }

    /// A finding of its own for a file that is broken; what the system refused stays an error.
    fn take(&mut self, error: Error) -> Result<()> {
        match error {
            Error::Io { .. } => return Err(error),
            Error::Malformed { at, reason, .. } => self.error(at, reason),
            Error::Unsupported { reason, .. } => self.error("file", reason),
            other => self.error("file", other.to_string()),
        }
        Ok(())
    }
}

/// Everything found in the file at `path` and in the hierarchy beside it.
///
/// # Errors
/// `Io`, and `Unsupported` for a file of no known format. A broken file is a finding.
pub fn check(path: &Path) -> Result<Checked> {
    let mut source = Source::open(path)?;
    let format = detect(&mut source)?;
    let mut findings = Findings::default();
    let (inner, mut source) = html::inside(format, source)?;
    if matches!(inner, Format::Glb | Format::Gltf) {
        gltf::check(source.again()?, &mut findings)?;
    }
    let mut triangles = None;
    // All of it is proven, so all of it is read.
    match read_as(inner, source.again()?, &ReadOptions { sh_degree: 3 }) {
        Ok(loaded) => {
            triangles = Some(loaded.scene.triangle_count() as u64);
            check_loaded(path, inner, &loaded, &mut findings)?;
        }
        // The same fault may have been found by the closer look already.
        Err(Error::Malformed { at, .. }) if findings.0.iter().any(|f| f.place == at) => {}
        Err(error) => findings.take(error)?,
    }
    if format == Format::Html {
        // No engine reads a page, and its own viewer reads everything.
        findings.0.retain(|finding| finding.place != gltf::LOSSY);
    }
    let path = path.display().to_string();
    Ok(Checked { path, format, triangles, findings: findings.0 })
}

fn check_loaded(path: &Path, format: Format, loaded: &Loaded, findings: &mut Findings) -> Result<()> {
    for warning in &loaded.warnings {
        findings.warning("file", warning);
    }
    match &loaded.scene {
        Scene::Soup(soup) => scene::check_soup(soup, findings),
        Scene::Mesh(mesh) => {
            scene::check_mesh(mesh, findings);
            if matches!(format, Format::Glb | Format::Gltf) {
                check_hierarchy(path, mesh, findings)?;
            }
        }
    }
    Ok(())
}

/// The hierarchy that the bake leaves beside a scene, when there is one.
fn check_hierarchy(path: &Path, mesh: &Mesh, findings: &mut Findings) -> Result<()> {
    let beside = path.with_extension("bvh");
    if path.as_os_str() == "-" || !beside.is_file() {
        return Ok(());
    }
    let place = beside.display().to_string();
    let (header, tree) = match bvh::read(Source::open(&beside)?) {
        Ok(read) => read,
        Err(Error::Malformed { at, reason, .. }) => {
            findings.error(format!("{place}: {at}"), reason);
            return Ok(());
        }
        Err(error) => return findings.take(error),
    };
    // 16-bit positions and reordered corners change the hash, not the hierarchy's worth.
    let exact = !findings.0.iter().any(|finding| finding.place == gltf::LOSSY);
    match bvh::belongs(&beside, &header, mesh) {
        Err(Error::Unsupported { reason, .. }) if exact => findings.error(place, reason),
        Err(Error::Unsupported { .. }) if header.faces as usize == mesh.face_count() => findings.add(
            Severity::Note,
            place,
            "holds the hash of the positions before they were quantised or compressed: it cannot be checked",
        ),
        Err(error) => findings.take(error)?,
        Ok(()) => {
            if let Err(error) = tree.validate_with(mesh) {
                findings.error(place, error.to_string());
            }
        }
    }
    Ok(())
}
