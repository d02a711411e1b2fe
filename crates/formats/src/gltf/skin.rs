//! Skins: vertices where the joints of a skeleton at rest have them. The transform of a skinned
//! node itself does not count.

use super::accessor::Accessors;
use super::document::{self, Attributes, GltfDocument};
use glam::{DMat4, DVec3};
use gltf_json::accessor::ComponentType;
use std::collections::BTreeMap;
use trisplat_scene::{Limits, Result};

/// From the mesh to the scene for each joint of a skin.
pub(crate) type JointTransforms = Vec<DMat4>;

/// The joints of every skin that a node with a mesh uses, or why they are not known, by the number
/// of the skin. `origin` is subtracted from all positions.
pub(crate) fn joints_of_skins(
    document: &GltfDocument,
    accessors: &mut Accessors,
    origin: DVec3,
    limits: &Limits,
) -> Result<BTreeMap<usize, Result<JointTransforms, String>>> {
    let with_mesh = document.nodes.iter().filter(|node| node.mesh.is_some());
    let mut skins: BTreeMap<usize, _> =
        with_mesh.filter_map(|node| node.skin).map(|skin| (skin, Ok(Vec::new()))).collect();
    if skins.is_empty() {
        return Ok(skins);
    }
    let path = accessors.buffers.path().to_owned();
    let worlds = document::node_transforms(&path, document, limits)?;
    let moved = DMat4::from_translation(-origin);
    for (skin, found) in &mut skins {
        *found = joints(document, accessors, *skin, &worlds)?
            .map(|joints| joints.into_iter().map(|joint| moved * joint).collect());
    }
    Ok(skins)
}

/// The joints of a skin, or why they are not known. `worlds` are the transforms of all nodes.
fn joints(
    document: &GltfDocument,
    accessors: &mut Accessors,
    skin: usize,
    worlds: &[Option<DMat4>],
) -> Result<Result<JointTransforms, String>> {
    let Some(skin) = document.skins.get(skin) else {
        return Ok(Err(format!("skin {skin} does not exist")));
    };
    let world = |node: &usize| worlds.get(*node).copied().flatten();
    let Some(mut joints) = skin.joints.iter().map(world).collect::<Option<JointTransforms>>()
    else {
        return Ok(Err("its joints are not in the scene".to_owned()));
    };
    let Some(accessor) = skin.inverse_bind_matrices else { return Ok(Ok(joints)) };
    let layout = accessors.layout(accessor)?;
    if layout.width != 16
        || layout.component != ComponentType::F32
        || layout.count < joints.len() as u64
    {
        return Ok(Err(format!("accessor {accessor} holds no matrix for each joint")));
    }
    accessors.buffers.spend(layout.count.saturating_mul(128))?;
    accessors.for_each(accessor, 0.0, |i, columns: [f64; 16]| {
        if let Some(joint) = joints.get_mut(i) {
            *joint *= DMat4::from_cols_array(&columns);
        }
    })?;
    if joints.iter().any(|joint| !joint.is_finite()) {
        return Ok(Err("its joints are not finite".to_owned()));
    }
    Ok(Ok(joints))
}

/// The transform of each vertex of a primitive, the mean of its joints'; none for a primitive that
/// no joint moves, or whose numbers do not fit.
pub(crate) fn vertex_transforms(
    accessors: &mut Accessors,
    attributes: &Attributes,
    joints: &[DMat4],
    count: usize,
) -> Result<Option<Vec<DMat4>>> {
    let sets = [
        attributes.joints.zip(attributes.weights),
        attributes.more_joints.zip(attributes.more_weights),
    ];
    let mut transforms: Vec<DMat4> = Vec::new();
    for (numbers, weights) in sets.into_iter().flatten() {
        let layouts = [accessors.layout(numbers)?, accessors.layout(weights)?];
        if layouts.iter().any(|layout| layout.width != 4 || layout.count != count as u64) {
            return Ok(None);
        }
        accessors.buffers.spend((count as u64).saturating_mul(160))?;
        transforms.resize(count, DMat4::ZERO);
        let mut of_vertex = vec![[0usize; 4]; count];
        accessors
            .for_each(numbers, 0.0, |i, four: [f64; 4]| of_vertex[i] = four.map(|x| x as usize))?;
        let mut fits = true;
        accessors.for_each(weights, 0.0, |i, four: [f64; 4]| {
            for (joint, weight) in of_vertex[i].into_iter().zip(four) {
                match joints.get(joint) {
                    _ if weight == 0.0 => {}
                    Some(joint) => transforms[i] += *joint * weight,
                    None => fits = false,
                }
            }
        })?;
        if !fits {
            return Ok(None);
        }
    }
    // The sums of weights are 1 only nearly, and 0 where no joint moves a vertex.
    let still = joints.first().copied().unwrap_or(DMat4::IDENTITY);
    for transform in &mut transforms {
        let sum = transform.w_axis.w;
        *transform = if sum > 0.0 { *transform * sum.recip() } else { still };
    }
    Ok((!transforms.is_empty()).then_some(transforms))
}
