//! The node tree, with the place of every mesh.

use super::document::{Document, Node};
use crate::far::is_far;
use glam::{DMat4, DQuat, DVec3, Vec3};
use std::path::Path;
use trisplat_scene::{Error, Limits, Result};

/// A mesh shown by a node.
#[derive(Debug)]
pub(crate) struct MeshInstance {
    /// Number of the mesh.
    pub(crate) mesh: usize,
    /// Number of the node, for messages.
    pub(crate) node: usize,
    /// From the mesh to the scene; none for the identity.
    pub(crate) transform: Option<DMat4>,
}

/// Every drawn mesh of the default scene, in the order of the tree, with its transform accumulated in f64.
///
/// # Errors
/// `Malformed` for indices out of range, for a node with two parents or in a cycle, and for transforms that
/// are not finite.
pub(crate) fn instances(path: &Path, document: &Document, limits: &Limits) -> Result<Vec<MeshInstance>> {
    let mut seen = vec![false; document.nodes.len()];
    let mut instances = Vec::new();
    let mut stack: Vec<(usize, Option<DMat4>, u64)> =
        roots(path, document)?.into_iter().rev().map(|n| (n, None, 0)).collect();
    while let Some((index, parent, depth)) = stack.pop() {
        limits.nesting(format_args!("{}: node {index}", path.display()), depth)?;
        let place = || format!("node {index}");
        let has = document.nodes.len();
        let node = document
            .nodes
            .get(index)
            .ok_or_else(|| Error::malformed(path, place(), format!("does not exist: the file has {has}")))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(Error::malformed(path, place(), "has two parents or is its own ancestor"));
        }
        let transform = match (parent, local(node)) {
            (None, local) => local,
            (parent, None) => parent,
            (Some(parent), Some(local)) => Some(parent * local),
        };
        if transform.is_some_and(|t| !t.is_finite()) {
            return Err(Error::malformed(path, place(), "has a transform that is not finite"));
        }
        if let Some(mesh) = node.mesh
            && !is_for_collision(node)
        {
            instances.push(MeshInstance { mesh, node: index, transform });
        }
        stack.extend(node.children.iter().rev().map(|&child| (child, transform, depth + 1)));
    }
    Ok(instances)
}

/// Whether Godot's importer uses the mesh of a node only for collisions.
fn is_for_collision(node: &Node) -> bool {
    node.name.as_deref().is_some_and(|name| name.ends_with("-colonly") || name.ends_with("-convcolonly"))
}

/// The nodes the walk starts from: those of the default scene, or all without a parent.
fn roots(path: &Path, document: &Document) -> Result<Vec<usize>> {
    let scene = match document.scene {
        Some(index) => Some(document.scenes.get(index).ok_or_else(|| {
            let has = document.scenes.len();
            Error::malformed(path, format!("scene {index}"), format!("does not exist: the file has {has}"))
        })?),
        None => document.scenes.first(),
    };
    if let Some(scene) = scene {
        return Ok(scene.nodes.clone());
    }
    let mut is_child = vec![false; document.nodes.len()];
    for child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(flag) = is_child.get_mut(*child) {
            *flag = true;
        }
    }
    Ok((0..is_child.len()).filter(|&node| !is_child[node]).collect())
}

/// A node's own transform; none when it is the identity, so that positions keep their bits.
fn local(node: &Node) -> Option<DMat4> {
    let transform = match node.matrix {
        Some(columns) => {
            let rounded = DMat4::from_cols_array(&columns.map(|x| f64::from(x as f32)));
            let moved = translation([columns[12], columns[13], columns[14]]);
            DMat4 { w_axis: moved.extend(rounded.w_axis.w), ..rounded }
        }
        None => {
            let to_f64 = |v: [f32; 3]| Vec3::from(v).as_dvec3();
            let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]).map(f64::from);
            let rotation = DQuat::from_xyzw(x, y, z, w);
            // Four f32 numbers are a unit quaternion only nearly.
            let rotation =
                if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            DMat4::from_scale_rotation_translation(
                node.scale.map_or(DVec3::ONE, to_f64),
                rotation,
                node.translation.map_or(DVec3::ZERO, translation),
            )
        }
    };
    (transform != DMat4::IDENTITY).then_some(transform)
}

/// A translation in single precision, as in engines; far from the origin in double precision.
fn translation(written: [f64; 3]) -> DVec3 {
    let (written, rounded) = (DVec3::from(written), DVec3::from(written).as_vec3());
    if rounded.is_finite() && is_far(written) { written } else { rounded.as_dvec3() }
}

/// Moves all nodes so that `origin` becomes (0, 0, 0).
pub(crate) fn take_off(instances: &mut [MeshInstance], origin: DVec3) {
    if origin == DVec3::ZERO {
        return;
    }
    for instance in instances {
        let placed = instance.transform.unwrap_or(DMat4::IDENTITY);
        instance.transform = Some(DMat4::from_translation(-origin) * placed);
    }
}
