//! Several inputs become one scene.
//!
//! Soups make a soup and meshes a mesh. A soup cannot join a mesh before it is solid; the recipe sees to that.

use crate::asset::{Placement, Provenance};
use crate::error::{Error, Result};
use crate::mesh::{Colors, Mesh};
use crate::scene::{Loaded, Scene};

/// One scene out of `inputs`, in their order.
///
/// Errors: no input, soups and meshes together, files with different axes up.
pub fn merge(inputs: Vec<Loaded>) -> Result<Loaded> {
    let mut inputs = inputs.into_iter();
    let Some(mut all) = inputs.next() else {
        return Err(Error::invalid("inputs", "nothing", "at least one file"));
    };
    for next in inputs {
        all.scene = match (all.scene, next.scene) {
            (Scene::Soup(mut a), Scene::Soup(b)) => {
                a.append(b);
                Scene::Soup(a)
            }
            (Scene::Mesh(a), Scene::Mesh(b)) => Scene::Mesh(append(a, b)?),
            _ => {
                return Err(Error::invalid(
                    "inputs",
                    "a soup and a mesh",
                    "inputs of one kind: bake the soup first, then merge the meshes",
                ));
            }
        };
        // Cameras that saw only a part would have the rest dropped.
        all.cameras = match all.cameras.is_empty() || next.cameras.is_empty() {
            true => Vec::new(),
            false => [all.cameras, next.cameras].concat(),
        };
        all.provenance = merge_provenance(all.provenance, next.provenance)?;
        all.warnings.extend(next.warnings);
    }
    Ok(all)
}

/// Takes the soups and baked meshes of `inputs` to one frame: the world of the soups, which the meshes were placed in
/// when they were baked. A soup that does not say which of its axes points up takes the axis of the meshes.
pub(super) fn share_world(inputs: &mut [Loaded]) {
    let mut up = None;
    for loaded in inputs.iter_mut() {
        let placement = std::mem::take(&mut loaded.provenance.placement);
        if let (Scene::Mesh(mesh), false) = (&mut loaded.scene, placement == Placement::IDENTITY) {
            mesh.positions.iter_mut().for_each(|point| *point = placement.to_world(*point));
            loaded.provenance.up = Some(placement.up);
            // It is in the frame of the file.
            loaded.provenance.viewpoint = None;
            up = Some(placement.up);
        }
    }
    for loaded in inputs.iter_mut().filter(|loaded| matches!(loaded.scene, Scene::Soup(_))) {
        loaded.provenance.up = loaded.provenance.up.or(up);
    }
}

fn merge_provenance(a: Provenance, b: Provenance) -> Result<Provenance> {
    if a.up != b.up {
        return Err(Error::invalid(
            "inputs",
            format!("files of different up axes ({:?}, {:?})", a.up, b.up),
            "files of one frame: bake each with `up`, then merge the results",
        ));
    }
    let join = |a: Option<String>, b: Option<String>| match (a, b) {
        (Some(a), Some(b)) if a != b => Some(format!("{a} + {b}")),
        (a, b) => a.or(b),
    };
    Ok(Provenance {
        generator: join(a.generator, b.generator),
        source: join(a.source, b.source),
        trainer: join(a.trainer, b.trainer),
        up: a.up,
        placement: if a.placement == b.placement { a.placement } else { Placement::IDENTITY },
        viewpoint: a.viewpoint.or(b.viewpoint),
    })
}

/// Both meshes in one: indexed when either is, colours on faces only when both have them there.
fn append(mut a: Mesh, mut b: Mesh) -> Result<Mesh> {
    if !a.opacity.is_empty() || !b.opacity.is_empty() {
        a.opacity.resize(a.face_count(), 1.0);
        b.opacity.resize(b.face_count(), 1.0);
    }
    if matches!(a.colors, Colors::Vertex(_)) || matches!(b.colors, Colors::Vertex(_)) {
        spread(&mut a);
        spread(&mut b);
    }
    if a.indices.is_empty() != b.indices.is_empty() {
        number(&mut a);
        number(&mut b);
    }
    if a.vertex_count() + b.vertex_count() > u32::MAX as usize {
        return Err(Error::invalid("inputs", "more than 4,294,967,295 vertices", "fewer or smaller files"));
    }
    let first = a.vertex_count() as u32;
    a.indices.extend(b.indices.iter().map(|i| i + first));
    a.positions.append(&mut b.positions);
    a.opacity.append(&mut b.opacity);
    if let (Colors::Face(a), Colors::Face(b)) | (Colors::Vertex(a), Colors::Vertex(b)) =
        (&mut a.colors, &mut b.colors)
    {
        a.append(b);
    }
    Ok(a)
}

/// Writes out the indices 0, 1, 2, … of a mesh that has none.
fn number(mesh: &mut Mesh) {
    if mesh.indices.is_empty() {
        mesh.indices = (0..mesh.vertex_count() as u32).collect();
    }
}

/// Gives every corner its own vertex where colours are per face, so that they become per vertex.
fn spread(mesh: &mut Mesh) {
    if let Colors::Face(colors) = &mesh.colors {
        let corners: Vec<_> = (0..mesh.face_count()).flat_map(|f| mesh.corners(f)).collect();
        let colors = colors.iter().flat_map(|c| [*c; 3]).collect();
        mesh.positions = corners;
        mesh.colors = Colors::Vertex(colors);
        mesh.indices.clear();
    }
}
