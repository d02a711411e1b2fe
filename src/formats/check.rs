//! Finds what is wrong with a file: what its format forbids, and what an engine would stumble over.
//!
//! Readers stop at the first fault; here every fault is a finding with its place. Faults of one kind are
//! one finding with their number and the first few places.

mod findings;
mod gltf;
mod scene;

pub use findings::{Finding, Severity};

use super::read::{detect, read_as};
use super::{Format, ReadOptions, Source, bvh, html};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::mesh::Mesh;
use crate::scene::{Loaded, Scene};
use findings::{Findings, Positions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

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

/// Everything found in the file at `path`, read with `options`, and in the hierarchy beside it.
///
/// # Errors
/// `Io`, and `Unsupported` for a file of no known format. A broken file is a finding.
pub fn check(path: &Path, options: &ReadOptions) -> Result<Checked> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    // No engine reads a page, and its own viewer reads everything.
    let for_engines = format != Format::Html;
    let mut findings = Findings::default();
    let (inner, mut source) = html::inside(format, source)?;
    if matches!(inner, Format::Glb | Format::Gltf) {
        gltf::check(source.again()?, options, for_engines, &mut findings)?;
    }
    let mut triangles = None;
    // All of it is checked, so all of it is read, whatever `options` want of it.
    match read_as(inner, source.again()?, &ReadOptions { sh_degree: 3, ..*options }) {
        Ok(loaded) => {
            triangles = Some(loaded.scene.triangle_count() as u64);
            check_loaded(path, inner, &loaded, &options.limits, &mut findings)?;
        }
        // The checks of glTF files may have found the same fault.
        Err(Error::Malformed { at, .. }) if findings.has_place(&at) => {}
        Err(error) => findings.take(error)?,
    }
    let path = path.display().to_string();
    Ok(Checked { path, format, triangles, findings: findings.list })
}

fn check_loaded(
    path: &Path,
    format: Format,
    loaded: &Loaded,
    limits: &Limits,
    findings: &mut Findings,
) -> Result<()> {
    for warning in &loaded.warnings {
        findings.warning("file", warning);
    }
    match &loaded.scene {
        Scene::Soup(soup) => scene::check_soup(soup, findings),
        Scene::Mesh(mesh) => {
            scene::check_mesh(mesh, findings);
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

/// The hierarchy that the bake leaves beside a scene, when there is one.
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
