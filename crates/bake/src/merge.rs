//! Several inputs become one scene.
//!
//! Inputs that lie far from the origin of their world have origins of their own (`formats::far`); they are
//! moved to one of these first. Soups make a soup and meshes a mesh. The recipe makes a soup solid before it
//! joins a mesh. Colours beside textures become a texture, too.

use super::one_origin::{rebase, share_origin};
use super::texture::texture_all;
use trisplat_scene::{Error, ImportedScene, Placement, Provenance, Result, Scene, UpDirection, mesh::Mesh};

/// One scene out of `inputs`, in their order.
///
/// Errors: no input, soups and meshes together, files with different axes up, too many coloured triangles beside a texture.
pub fn merge(mut inputs: Vec<ImportedScene>) -> Result<ImportedScene> {
    share_origin(&mut inputs);
    let backdrops: Vec<Mesh> = inputs.iter_mut().filter_map(ImportedScene::take_backdrop).collect();
    texture_all(&mut inputs)?;
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
        all.cameras = match all.cameras.is_empty() || next.cameras.is_empty() {
            true => Vec::new(),
            false => [all.cameras, next.cameras].concat(),
        };
        all.provenance = merge_provenance(all.provenance, next.provenance)?;
        all.warnings.extend(next.warnings);
    }
    for backdrop in backdrops {
        all.put_backdrop(backdrop)?;
    }
    Ok(all)
}

/// Takes the soups and baked meshes of `inputs` to one frame: that of the soups, from which the meshes were
/// placed when they were baked. A soup without an up axis takes that of the meshes; a mesh that was not
/// turned takes that of the soups.
pub(super) fn share_world(inputs: &mut [ImportedScene]) {
    share_origin(inputs);
    let is_soup = |loaded: &&ImportedScene| matches!(loaded.scene, Scene::Soup(_));
    let of_soups = inputs.iter().filter(is_soup).find_map(|loaded| loaded.provenance.up);
    let soup = inputs.iter().find(is_soup);
    let frame = soup.map_or(Placement::IDENTITY, |soup| soup.provenance.placement);
    let mut up = None;
    for loaded in inputs.iter_mut() {
        let placement = loaded.provenance.placement;
        if matches!(loaded.scene, Scene::Mesh(_)) && placement != Placement::IDENTITY {
            rebase(loaded, &frame);
            up = match placement.up {
                UpDirection::Axis(axis) => Some(axis),
                UpDirection::Vector(_) => of_soups,
            };
            loaded.provenance.up = up;
            // It is in the frame of the file.
            loaded.provenance.viewpoint = None;
        }
        loaded.provenance.placement = frame;
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
        backdrop: 0,
    })
}
