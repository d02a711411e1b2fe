//! Textures of an input mesh: kept if one picture paints the whole mesh, else turned into a colour per face.

use crate::mesh::{Colors, Mesh};
use crate::texture::{FaceTexture, Texture};
use glam::Vec2;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// The textured faces of a part of a mesh, and the places of their corners on the texture.
pub(super) struct PaintedFaces {
    /// Number of the picture.
    pub(super) image: usize,
    pub(super) faces: Range<usize>,
    pub(super) uvs: Vec<[Vec2; 3]>,
    /// Nothing else colours them.
    pub(super) plain: bool,
}

/// Paints the faces of a mesh, in its order, with those `textures` that could be read. Returns notes for the
/// user.
pub(super) fn paint(
    mesh: &mut Mesh,
    painted: Vec<PaintedFaces>,
    textures: &BTreeMap<usize, Option<Arc<Texture>>>,
) -> Option<String> {
    let covered: usize = painted.iter().map(|painted| painted.faces.len()).sum();
    let within = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
    let plain = painted.iter().all(|painted| painted.plain && painted.uvs.as_flattened().iter().all(within));
    let mut readable = textures.values().flatten();
    let (only, others) = (readable.next()?, readable.next().is_some());
    let all_readable =
        painted.iter().all(|painted| textures.get(&painted.image).is_some_and(Option::is_some));
    if plain && covered == mesh.face_count() && !others && all_readable {
        let uvs = painted.into_iter().flat_map(|painted| painted.uvs).collect();
        let texture = FaceTexture { uvs, texture: only.clone() };
        let mean = |face: usize| texture.mean(face);
        mesh.colors = Colors::Face((0..mesh.face_count()).into_par_iter().map(mean).collect());
        mesh.texture = Some(texture);
        return None;
    }
    let mean = |face: usize| {
        let [a, b, c] = mesh.corner_colors(face);
        [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0)
    };
    let mut colors: Vec<[f32; 3]> = (0..mesh.face_count()).into_par_iter().map(mean).collect();
    for painted in painted {
        let Some(Some(texture)) = textures.get(&painted.image) else { continue };
        // Repeated pictures start again at every whole number.
        let repeated = |uvs: &[Vec2; 3]| {
            let first = ((uvs[0] + uvs[1] + uvs[2]) / 3.0).floor();
            uvs.map(|uv| uv - first)
        };
        let texture =
            FaceTexture { uvs: painted.uvs.iter().map(repeated).collect(), texture: texture.clone() };
        for (face, color) in colors[painted.faces].iter_mut().enumerate() {
            let mean = texture.mean(face);
            (0..3).for_each(|c| color[c] *= mean[c]);
        }
    }
    mesh.colors = Colors::Face(colors);
    Some("textures became one colour per triangle: only one picture that paints all of a scene, without repetition, is kept".to_owned())
}
