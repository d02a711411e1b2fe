//! Simplifies the connected parts of a mesh to meet a limit of triangles: their edges collapse,
//! where dropped triangles would leave holes. The rest of a scene is a soup, which meets its share
//! of the limit in `prune` or `unseen`.

use crate::prune::connected_flags;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::{Result, Scene};
use trisplat_surface::EdgeCollapse;

/// Measurements of the simplification.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimplifyDetails {
    /// Triangles that shared edges with others.
    pub connected: u64,
    /// Estimated movement of their surface, in units of the input.
    pub simplification_error: f64,
}

trisplat_scene::stage!(SimplifyDetails, "simplify");

/// Simplifies the connected parts of `scene` to their share of `max_triangles`, if the scene has
/// more.
///
/// # Errors
///
/// More vertices than 32 bits count.
pub fn simplify(
    scene: &mut Scene,
    max_triangles: Option<u64>,
    details: &mut SimplifyDetails,
) -> Result<Outcome<()>> {
    let Scene::Mesh(mesh) = scene else {
        return Ok(Outcome::Skipped("triangles of a soup are not connected"));
    };
    let limit = max_triangles.map_or(usize::MAX, |limit| limit as usize);
    if mesh.face_count() <= limit {
        return Ok(Outcome::Skipped("no limit of triangles asks for it"));
    }
    let parts = Parts::of(mesh);
    let Some(connected) = &parts.connected else {
        return Ok(Outcome::Skipped("hardly any triangles share an edge"));
    };
    let share = limit as f64 / mesh.face_count() as f64;
    let simplified = EdgeCollapse::new(connected).to(faces_of_share(connected, share));
    details.connected = connected.face_count() as u64;
    details.simplification_error = simplified.error;
    let mut whole = simplified.mesh;
    whole.append(parts.loose.into_owned())?;
    *mesh = whole;
    Ok(Outcome::Changed(()))
}

/// Faces of a share of a mesh; at least one.
pub(crate) fn faces_of_share(mesh: &Mesh, share: f64) -> usize {
    ((mesh.face_count() as f64 * share) as usize).max(1)
}

/// A mesh in two parts.
pub(crate) struct Parts<'a> {
    /// Faces that share edges, if there are any.
    pub connected: Option<Mesh>,
    /// The others.
    pub loose: Cow<'a, Mesh>,
}

impl<'a> Parts<'a> {
    /// All faces loose.
    pub(crate) fn of_soup(mesh: &'a Mesh) -> Self {
        Self { connected: None, loose: Cow::Borrowed(mesh) }
    }

    pub(crate) fn of(mesh: &'a Mesh) -> Self {
        let is_connected = connected_flags(mesh);
        if !is_connected.contains(&true) {
            return Self::of_soup(mesh);
        }
        let part = |of: bool| {
            let faces: Vec<u32> = (0..mesh.face_count() as u32)
                .filter(|face| is_connected[*face as usize] == of)
                .collect();
            mesh.part(&faces)
        };
        let loose =
            if is_connected.contains(&false) { part(false).unshared() } else { Mesh::default() };
        Self { connected: Some(part(true)), loose: Cow::Owned(loose) }
    }
}
