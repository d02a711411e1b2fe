//! Checks a file for faults that readers find, for what engines reject, and for our own promises.
//!
//! Readers stop at the first fault; this check reports every fault with its place. Faults of one kind are one
//! finding, with their number and the first few places.

pub use crate::findings::{Finding, Severity};

use super::read::{detect, read_as};
use super::{bvh, check_triangles, html};
use crate::findings::{Findings, Positions};
use crate::{Format, ReadOptions, Source, gltf};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::{Error, ImportedScene, Limits, Result, Scene, mesh::Mesh};

/// Everything found in one file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat validation")]
pub struct Checked {
    /// The file as given.
    pub path: String,
    /// Its format.
    pub format: Format,
    /// Number of triangles, if the file could be read.
    pub triangles: Option<u64>,
    /// Findings in the order of the file.
    pub findings: Vec<Finding>,
}

impl Checked {
    /// Number of findings of this severity.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }
}

/// Checks the file at `path`, read with `options`, and the hierarchy beside it.
///
/// # Errors
/// `Io`, and `Unsupported` for a file of no known format. A broken file is a finding.
pub fn check(path: &Path, options: &ReadOptions) -> Result<Checked> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    // No engine reads a page, and its own viewer reads everything.
    let for_engines = format != Format::Html;
    let mut findings = Findings::default();
    let (inner, mut source) = html::inside(format, source.again()?)?;
    if matches!(inner, Format::Glb | Format::Gltf) {
        gltf::check(source.again()?, options, for_engines, &mut findings)?;
    }
    let mut triangles = None;
    // Everything is read, so that everything is checked, whatever `options` select.
    match read_as(inner, source.again()?, &ReadOptions { sh_degree: 3, ..*options }) {
        Ok(loaded) => {
            triangles = Some(loaded.scene.triangle_count() as u64);
            check_loaded(path, inner, &loaded, &options.limits, &mut findings)?;
        }
        // The checks of glTF files may have found the same fault.
        Err(Error::Malformed { at, .. }) if findings.has_place(&at) => {}
        Err(error) => findings.take(error)?,
    }
    Ok(Checked { path: path.display().to_string(), format, triangles, findings: findings.list })
}

fn check_loaded(
    path: &Path,
    format: Format,
    loaded: &ImportedScene,
    limits: &Limits,
    findings: &mut Findings,
) -> Result<()> {
    for warning in &loaded.warnings {
        findings.warning("file", warning);
    }
    match &loaded.scene {
        Scene::Soup(soup) => check_triangles::check_soup(soup, findings),
        Scene::Mesh(mesh) => {
            check_triangles::check_mesh(mesh, findings);
            if matches!(format, Format::Glb | Format::Gltf) {
                let mut scene = loaded.clone();
                scene.take_backdrop();
                if let Scene::Mesh(mesh) = &scene.scene {
                    check_hierarchy(path, mesh, limits, findings)?;
                }
            }
        }
    }
    Ok(())
}

/// The hierarchy beside a scene, if there is one.
fn check_hierarchy(path: &Path, mesh: &Mesh, limits: &Limits, findings: &mut Findings) -> Result<()> {
    let beside = path.with_extension("bvh");
    if path.as_os_str() == "-" || !beside.is_file() {
        return Ok(());
    }
    let place = beside.display().to_string();
    let (header, tree) = match bvh::read(Source::open(&beside, limits)?) {
        Ok(read) => read,
        Err(Error::Malformed { at, reason, .. }) => {
            findings.error(format!("{place}: {at}"), reason);
            return Ok(());
        }
        Err(error) => return findings.take(error),
    };
    // 16-bit positions and reordered corners change the hash, but the hierarchy is still right.
    let exact = findings.positions == Positions::AsBaked;
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
