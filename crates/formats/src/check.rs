//! Checks a file for faults that readers find, for data that engines reject, and for the promises
//! of this program's own files.
//!
//! Readers stop at the first fault; this check reports every fault with its place. Faults of one
//! kind are one finding, with their number and the first few places.

pub use crate::gltf::{Finding, Severity};

use crate::gltf::{self, Findings};
use crate::read::{FileKind, detect, kind_of, read_as, read_splats};
use crate::{Format, ReadOptions, Source, html};
use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Error, ImportedScene, Result, Scene, Soup, first_of, parallel};

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

/// Checks the file at `path`, read with `options`.
///
/// # Errors
/// `Io`, and `Unsupported` for a file of no known format. A broken file is a finding.
pub fn check(path: &Path, options: &ReadOptions) -> Result<Checked> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    if let Ok(FileKind::Splats(format)) = kind_of(format, &mut source, &options.limits) {
        return check_splats(path, format, source, options);
    }
    // No engine reads a page, and its own viewer reads everything.
    let for_engines = format != Format::Html;
    let mut findings = Findings::default();
    let (inner, source) = html::inside(format, source.again()?)?;
    if matches!(inner, Format::Glb | Format::Gltf) {
        gltf::check(source.again()?, options, for_engines, &mut findings)?;
    }
    let mut triangles = None;
    // Everything is read, so that everything is checked, not only the selection of `options`.
    match read_as(inner, source.again()?, &ReadOptions { sh_degree: 3, ..*options }) {
        Ok(loaded) => {
            triangles = Some(loaded.scene.triangle_count() as u64);
            check_loaded(&loaded, &mut findings);
        }
        // The checks of glTF files may have found the same fault.
        Err(Error::Malformed { at, .. })
            if findings.list.iter().any(|finding| finding.place == at) => {}
        Err(error) => findings.take(error)?,
    }
    Ok(Checked { path: path.display().to_string(), format, triangles, findings: findings.list })
}

/// Reads Gaussians whole; faults of their reader become findings.
fn check_splats(
    path: &Path,
    format: Format,
    source: Source,
    options: &ReadOptions,
) -> Result<Checked> {
    let mut findings = Findings::default();
    match read_splats(format, source, &ReadOptions { sh_degree: 3, ..*options }) {
        Ok(loaded) => {
            for warning in &loaded.warnings {
                findings.warning("file", warning);
            }
        }
        Err(error) => findings.take(error)?,
    }
    Ok(Checked {
        path: path.display().to_string(),
        format,
        triangles: None,
        findings: findings.list,
    })
}

fn check_loaded(loaded: &ImportedScene, findings: &mut Findings) {
    for warning in &loaded.warnings {
        findings.warning("file", warning);
    }
    match &loaded.scene {
        Scene::Soup(soup) => check_soup(soup, findings),
        Scene::Mesh(mesh) => check_mesh(mesh, findings),
    }
}

// ---- Triangles that an engine draws badly or not at all, in any format --------------------------

/// Largest side of a texture that today's phones draw, texels.
const MAX_TEXTURE_SIDE: u32 = 4096;
/// Maximum number of places that a finding names.
const NAMED: usize = 3;

pub(super) fn check_soup(soup: &Soup, findings: &mut Findings) {
    check_corners(soup.len(), |i| soup.vertices[i], findings);
    let bright = list(soup.len(), |i| !soup.rgb(i).iter().all(|c| (0.0..=1.0).contains(c)));
    report(
        &bright,
        findings,
        Severity::Note,
        "have a colour outside 0 to 1, which the bake clamps",
    );
}

pub(super) fn check_mesh(mesh: &Mesh, findings: &mut Findings) {
    check_corners(mesh.face_count(), |face| mesh.corners(face), findings);
    let faint = list(mesh.opacity.len(), |face| mesh.opacity[face] < 1.0);
    report(
        &faint,
        findings,
        Severity::Warning,
        "are translucent: engines sort and blend them per object",
    );
    if let Some(texture) = &mesh.texture {
        let sizes = texture.pages.iter().map(|page| page.size());
        if let Some(size) = sizes.max_by_key(|size| size.max_element())
            && size.max_element() > MAX_TEXTURE_SIDE
        {
            let what = format!(
                "{}x{} texels: phones draw {MAX_TEXTURE_SIDE} a side at most",
                size.x, size.y
            );
            findings.warning("texture", what);
        }
    }
    if let Colors::Vertex(_) = mesh.colors
        && !mesh.indices.is_empty()
    {
        let mut used = vec![false; mesh.vertex_count()];
        for &v in &mesh.indices {
            used[v as usize] = true;
        }
        let unused = used.iter().filter(|used| !**used).count();
        if unused > 0 {
            findings
                .warning("vertices", format!("{unused} of {} belong to no triangle", used.len()));
        }
    }
}

/// Degenerate triangles. glTF validators miss them: they look at equal indices, not at equal
/// positions.
fn check_corners(
    count: usize,
    corners: impl Fn(usize) -> [Vec3; 3] + Sync,
    findings: &mut Findings,
) {
    let is_coincident = |[a, b, c]: [Vec3; 3]| a == b || b == c || a == c;
    let coincident = list(count, |i| is_coincident(corners(i)));
    report(
        &coincident,
        findings,
        Severity::Warning,
        "have two corners in one place and cannot be seen",
    );
    let flat = list(count, |i| {
        let [a, b, c] = corners(i).map(Vec3::as_dvec3);
        !is_coincident(corners(i)) && (b - a).cross(c - a) == glam::DVec3::ZERO
    });
    report(&flat, findings, Severity::Warning, "have their corners on a line and cannot be seen");
}

fn list(count: usize, is_bad: impl Fn(usize) -> bool + Sync) -> Vec<usize> {
    parallel::filter_map(count, 1 << 14, |i| is_bad(i).then_some(i))
}

fn report(bad: &[usize], findings: &mut Findings, severity: Severity, what: &str) {
    if !bad.is_empty() {
        findings.add(
            severity,
            format!("triangles {}", first_of(bad.iter().map(usize::to_string), NAMED)),
            format!("{} {what}", bad.len()),
        );
    }
}
