//! A texture of a mesh's own colours, so that it can join a textured one.

use super::atlas::Atlas;
use super::options::TextureOptions;
use super::texels::Texels;
use super::textured;
use trisplat_scene::{ImportedScene, Result, Scene, math::color::srgb_from_linear, mesh::Mesh};

/// Corners whose sRGB-encoded colours differ by less look alike.
const ALIKE: f32 = 2.0 / 255.0;

/// Gives every mesh of `inputs` a texture if one of them has one: a merge could keep neither colours nor texture of both otherwise.
///
/// Errors: more triangles than the largest texture has texels.
pub(crate) fn texture_all(inputs: &mut [ImportedScene]) -> Result<()> {
    let is_textured =
        |loaded: &ImportedScene| matches!(&loaded.scene, Scene::Mesh(mesh) if mesh.texture.is_some());
    if !inputs.iter().any(is_textured) {
        return Ok(());
    }
    for loaded in inputs {
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && mesh.texture.is_none()
        {
            *mesh = with_texture(std::mem::take(mesh))?;
            let name = loaded.provenance.source.as_deref().unwrap_or("an input");
            let warning = format!("the colours of {name} became a texture, because another input has one");
            loaded.warnings.push(warning);
        }
    }
    Ok(())
}

/// A triangle of one colour has one texel, any other those of its corners.
fn with_texture(mesh: Mesh) -> Result<Mesh> {
    let mut mesh = mesh.unshared();
    let length = |face: usize| {
        let corners = mesh.corner_colors(face).map(|corner| corner.map(srgb_from_linear));
        let differs = |k: usize| (0..3).any(|c| (corners[k][c] - corners[0][c]).abs() > ALIKE);
        if differs(1) || differs(2) { 1.0 } else { 0.0 }
    };
    let edges: Vec<[f32; 3]> = (0..mesh.face_count()).map(|face| [length(face); 3]).collect();
    let options = TextureOptions { texels_per_pixel: 1.0, ..TextureOptions::DEFAULT };
    let atlas = Atlas::new(&mesh, &edges, &options)?;
    mesh.texture = Some(textured(&atlas, Texels::new(&mesh, &atlas).picture(0.0)));
    Ok(mesh)
}
