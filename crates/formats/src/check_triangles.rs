//! Triangles that an engine draws badly or not at all, in any format.

use crate::findings::{Findings, Severity};
use glam::Vec3;
use trisplat_scene::parallel;
use trisplat_scene::{
    Soup,
    mesh::{Colors, Mesh},
};

/// Largest side of a texture that today's phones draw, texels.
const LARGEST_TEXTURE: u32 = 4096;
/// Most places that a finding names.
const NAMED: usize = 3;

pub(super) fn check_soup(soup: &Soup, findings: &mut Findings) {
    check_corners(soup.len(), |i| soup.vertices[i], findings);
    let bright = list(soup.len(), |i| !soup.rgb(i).iter().all(|c| (0.0..=1.0).contains(c)));
    report(&bright, findings, Severity::Note, "have a colour outside 0 to 1, which the bake clamps");
}

pub(super) fn check_mesh(mesh: &Mesh, findings: &mut Findings) {
    check_corners(mesh.face_count(), |face| mesh.corners(face), findings);
    let faint = list(mesh.opacity.len(), |face| mesh.opacity[face] < 1.0);
    report(&faint, findings, Severity::Warning, "are translucent: engines sort and blend them per object");
    if let Some(texture) = &mesh.texture {
        let sizes = texture.pages.iter().map(|page| page.size());
        if let Some(size) = sizes.max_by_key(|size| size.max_element())
            && size.max_element() > LARGEST_TEXTURE
        {
            let what = format!("{}x{} texels: phones draw {LARGEST_TEXTURE} a side at most", size.x, size.y);
            findings.warning("texture", what);
        }
    }
    if let Colors::Vertex(_) = mesh.colors
        && !mesh.indices.is_empty()
    {
        let mut used = vec![false; mesh.vertex_count()];
        mesh.indices.iter().for_each(|&v| used[v as usize] = true);
        let unused = used.iter().filter(|used| !**used).count();
        if unused > 0 {
            findings.warning("vertices", format!("{unused} of {} belong to no triangle", used.len()));
        }
    }
}

/// Degenerate triangles. glTF validators miss them: they look at equal indices, not at equal positions.
fn check_corners(count: usize, corners: impl Fn(usize) -> [Vec3; 3] + Sync, findings: &mut Findings) {
    let is_coincident = |[a, b, c]: [Vec3; 3]| a == b || b == c || a == c;
    let coincident = list(count, |i| is_coincident(corners(i)));
    report(&coincident, findings, Severity::Warning, "have two corners in one place and cannot be seen");
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
        findings.add(severity, format!("triangles {}", places(bad)), format!("{} {what}", bad.len()));
    }
}

/// "5, 17, 230 and 12 more".
fn places(numbers: &[usize]) -> String {
    let named: Vec<String> = numbers.iter().take(NAMED).map(usize::to_string).collect();
    let more = numbers.len() - named.len();
    let named = named.join(", ");
    if more == 0 { named } else { format!("{named} and {more} more") }
}
