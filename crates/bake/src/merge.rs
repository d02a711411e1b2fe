//! Several inputs become one scene.
//!
//! Inputs that lie far from the origin of their world have origins of their own (`formats::far`);
//! they are moved to one of these first. Soups make a soup and meshes a mesh. The recipe makes a
//! soup solid before it joins a mesh. With textures among the inputs, colours become textures too.

use crate::texture::texture_all;
use glam::DVec3;
use trisplat_formats::is_far;
use trisplat_raster::kernel::sh::ShRotation;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{
    Error, ImportedScene, Placement, Provenance, Result, Scene, UpDirection, frames,
};

/// One scene out of `inputs`, in their order.
///
/// # Errors
///
/// No input, soups and meshes together, files with different axes up, too many coloured triangles
/// beside a texture.
pub fn merge(mut inputs: Vec<ImportedScene>) -> Result<ImportedScene> {
    share_origin(&mut inputs);
    texture_all(&mut inputs)?;
    let mut inputs = inputs.into_iter();
    let Some(mut all) = inputs.next() else {
        return Err(Error::invalid("inputs", "nothing", "at least one file"));
    };
    let mut backdrops: Vec<Mesh> = all.take_backdrop().into_iter().collect();
    for mut next in inputs {
        backdrops.extend(next.take_backdrop());
        all.scene = match (all.scene, next.scene) {
            (Scene::Soup(mut a), Scene::Soup(b)) => {
                a.append(b);
                Scene::Soup(a)
            }
            (Scene::Mesh(mut a), Scene::Mesh(b)) => {
                a.append(b)?;
                Scene::Mesh(a)
            }
            _ => {
                return Err(Error::invalid(
                    "inputs",
                    "a soup and a mesh",
                    "inputs of one kind: bake the soup first, then merge the meshes",
                ));
            }
        };
        // Cameras of only one part would let the other parts be dropped.
        all.cameras = if all.cameras.is_empty() || next.cameras.is_empty() {
            Vec::new()
        } else {
            [all.cameras, next.cameras].concat()
        };
        all.provenance = merge_provenance(all.provenance, next.provenance)?;
        all.warnings.extend(next.warnings);
    }
    for backdrop in backdrops {
        all.put_backdrop(backdrop)?;
    }
    Ok(all)
}

/// Takes the soups and baked meshes of `inputs` to one frame: that of the soups, from which the
/// meshes were placed when they were baked. A soup without an up axis takes that of the meshes; a
/// mesh whose up direction is no axis takes that of the soups.
pub(super) fn share_world(inputs: &mut [ImportedScene]) {
    share_origin(inputs);
    let is_soup = |loaded: &&ImportedScene| matches!(loaded.scene, Scene::Soup(_));
    let soup_up = inputs.iter().filter(is_soup).find_map(|loaded| loaded.provenance.up);
    let soup = inputs.iter().find(is_soup);
    let frame = soup.map_or(Placement::IDENTITY, |soup| soup.provenance.placement);
    let mut mesh_up = None;
    for loaded in inputs.iter_mut() {
        let placement = loaded.provenance.placement;
        if matches!(loaded.scene, Scene::Mesh(_)) && placement != Placement::IDENTITY {
            rebase(loaded, &frame);
            mesh_up = match placement.up {
                UpDirection::Axis(axis) => Some(axis),
                UpDirection::Vector(_) => soup_up,
            };
            loaded.provenance.up = mesh_up;
            // The viewpoint is in the frame of the file.
            loaded.provenance.viewpoint = None;
        }
        loaded.provenance.placement = frame;
    }
    for loaded in inputs.iter_mut().filter(|loaded| matches!(loaded.scene, Scene::Soup(_))) {
        loaded.provenance.up = loaded.provenance.up.or(mesh_up);
    }
}

fn merge_provenance(a: Provenance, b: Provenance) -> Result<Provenance> {
    if a.up != b.up && a.up_axis() != b.up_axis() {
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
        up: a.up.or(b.up),
        usual_up: a.usual_up.filter(|usual| b.usual_up == Some(*usual)),
        placement: if a.placement == b.placement { a.placement } else { Placement::IDENTITY },
        viewpoint: a.viewpoint.or(b.viewpoint),
        backdrop_faces: 0,
        exposure: a.exposure.filter(|exposure| b.exposure == Some(*exposure)),
        cameras: Vec::new(),
    })
}

// ---- One origin for all inputs of a bake --------------------------------------------------------

/// Maximum offset between inputs, in units of the world: beyond it, f32 rounds positions by more
/// than a thousandth of a unit.
const MAX_OFFSET: f64 = 16_384.0;

/// Moves inputs to the origin of the first one that is far from that of its world, or of the first
/// soup. An input without a known place in that world keeps its coordinates; a warning names it.
pub(super) fn share_origin(inputs: &mut [ImportedScene]) {
    let placements = || inputs.iter().map(|loaded| loaded.provenance.placement);
    let Some(first) = placements().next().filter(|first| placements().any(|other| other != *first))
    else {
        return;
    };
    let far = placements().find(is_georeferenced);
    let is_soup = |loaded: &&ImportedScene| matches!(loaded.scene, Scene::Soup(_));
    let soup_placement = inputs.iter().find(is_soup).map(|soup| soup.provenance.placement);
    let frame = far.or(soup_placement).unwrap_or(first);
    for (i, loaded) in inputs.iter_mut().enumerate() {
        let own = loaded.provenance.placement;
        if own == frame {
            continue;
        }
        let offset = DVec3::from(own.center) - DVec3::from(frame.center);
        let number = i + 1;
        if is_georeferenced(&own)
            || (far.is_none() && is_moved_soup(loaded))
            || is_near_origin(loaded, &frame)
        {
            let [x, y, z] = offset.to_array();
            rebase(loaded, &frame);
            let text = format!(
                "input {number} is put where it is in the world of the others: its origin is {x} {y} {z} from theirs"
            );
            loaded.warnings.push(text);
            if offset.abs().max_element() > MAX_OFFSET {
                let rounded = offset.abs().max_element() * f64::from(f32::EPSILON) / 2.0;
                let text = format!(
                    "input {number} is so far from the others that its positions are rounded by up to {rounded:.1e}; bake it by itself"
                );
                loaded.warnings.push(text);
            }
        } else if far.is_some() {
            let [x, y, z] = frame.center;
            let text = format!(
                "input {number} does not say where it is in the world of the others, whose origin is {x} {y} {z}: \
                 its positions are taken as relative to that"
            );
            loaded.warnings.push(text);
            loaded.provenance.placement = frame;
        }
    }
}

/// True if a reader gave the file an origin of its own, because it is far from that of its world,
/// or a bake kept such an origin.
fn is_georeferenced(placement: &Placement) -> bool {
    is_far(DVec3::from(placement.center))
}

/// True for a soup whose reader moved its origin and did not turn it, as a bake would.
fn is_moved_soup(loaded: &ImportedScene) -> bool {
    let Placement { up, rotate, scale, .. } = loaded.provenance.placement;
    matches!(loaded.scene, Scene::Soup(_))
        && Placement { up, rotate, scale, center: [0.0; 3] } == Placement::IDENTITY
}

/// True for an input in world coordinates that lies nearer to the origin of `frame` than to that of
/// the world: a single-precision file of the same place, which needs no move.
fn is_near_origin(loaded: &ImportedScene, frame: &Placement) -> bool {
    let triangles = loaded.scene.triangle_count();
    let corner = |i: usize| loaded.scene.corners(i)[0];
    let Some(at) = (0..triangles).map(corner).find(|corner| corner.is_finite()) else {
        return false;
    };
    let center = DVec3::from(frame.center);
    loaded.provenance.placement == Placement::IDENTITY
        && at.as_dvec3().distance(center) < center.length() / 2.0
}

/// Moves a scene from its own frame into `frame`, through their common world.
pub(super) fn rebase(loaded: &mut ImportedScene, frame: &Placement) {
    let motion = loaded.provenance.placement.inverse().then(frame);
    loaded.provenance.placement = *frame;
    if motion == Placement::IDENTITY {
        return;
    }
    let transform = motion.transform();
    match &mut loaded.scene {
        Scene::Soup(soup) => {
            for corner in soup.vertices.iter_mut().flatten() {
                *corner = transform(*corner);
            }
            ShRotation::turn_soup(soup, motion.rotation());
        }
        Scene::Mesh(mesh) => {
            for position in &mut mesh.positions {
                *position = transform(*position);
            }
            let rotation = motion.rotation();
            for normal in &mut mesh.normals {
                *normal = (rotation * normal.as_dvec3()).as_vec3();
            }
            ShRotation::turn(mesh, rotation);
        }
    }
    let to_file = |camera| frames::to_file(camera, &motion, DVec3::ZERO);
    loaded.cameras = loaded.cameras.iter().map(to_file).collect();
    let viewpoint =
        loaded.provenance.viewpoint.map(|viewpoint| motion.viewpoint_to_file(&viewpoint));
    loaded.provenance.viewpoint = viewpoint;
}
