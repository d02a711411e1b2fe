//! Textures of an input mesh: kept if pictures paint the whole mesh, else turned into a colour per face.

use glam::Vec2;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{
    FaceTexture, Texture,
    mesh::{Colors, Mesh},
};

/// Most pictures that are kept: of more, drawing each by itself costs an engine more than they show.
const MOST_PAGES: usize = 256;

/// The textured faces of a part of a mesh, and the places of their corners on the texture.
pub(crate) struct PaintedFaces {
    /// Number of the picture.
    pub image: usize,
    /// Consecutive faces of the mesh.
    pub faces: Range<usize>,
    /// Places of their corners on the picture, each from 0 to 1 and beyond.
    pub uvs: Vec<[Vec2; 3]>,
    /// Nothing else colours them.
    pub plain: bool,
}

/// Paints the faces of a mesh, in its order, with those `textures` that could be read. Returns notes for the
/// user.
pub(crate) fn paint(
    mesh: &mut Mesh,
    painted: Vec<PaintedFaces>,
    textures: &BTreeMap<usize, Option<Arc<Texture>>>,
) -> Option<String> {
    let covered: usize = painted.iter().map(|painted| painted.faces.len()).sum();
    let within = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
    let plain = painted.iter().all(|painted| painted.plain && painted.uvs.as_flattened().iter().all(within));
    let readable: BTreeMap<usize, &Arc<Texture>> =
        textures.iter().filter_map(|(number, texture)| Some((*number, texture.as_ref()?))).collect();
    if readable.is_empty() {
        return None;
    }
    let all_readable = painted.iter().all(|painted| readable.contains_key(&painted.image));
    if plain && covered == mesh.face_count() && all_readable && readable.len() <= MOST_PAGES {
        let texture = pages(painted, &readable);
        mesh.colors = Colors::Face(parallel::collect(mesh.face_count(), 1, |face| texture.mean(face)));
        mesh.texture = Some(texture);
        return None;
    }
    let mean = |face: usize| {
        let [a, b, c] = mesh.corner_colors(face);
        [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0)
    };
    let mut colors: Vec<[f32; 3]> = parallel::collect(mesh.face_count(), GRAIN, mean);
    for painted in painted {
        let Some(Some(texture)) = textures.get(&painted.image) else { continue };
        // Repeated pictures start again at every whole number.
        let repeated = |uvs: &[Vec2; 3]| {
            let first = ((uvs[0] + uvs[1] + uvs[2]) / 3.0).floor();
            uvs.map(|uv| uv - first)
        };
        let texture = FaceTexture::new(painted.uvs.iter().map(repeated).collect(), texture.clone());
        for (face, color) in colors[painted.faces].iter_mut().enumerate() {
            let mean = texture.mean(face);
            (0..3).for_each(|c| color[c] *= mean[c]);
        }
    }
    mesh.colors = Colors::Face(colors);
    Some("textures became one colour per triangle: only pictures that paint all of a scene, without repetition, are kept".to_owned())
}

/// The pictures of faces as pages.
fn pages(painted: Vec<PaintedFaces>, readable: &BTreeMap<usize, &Arc<Texture>>) -> FaceTexture {
    let number = |image: usize| readable.range(..image).count() as u16;
    let page_of: Vec<u16> = match readable.len() {
        1 => Vec::new(),
        _ => painted.iter().flat_map(|p| std::iter::repeat_n(number(p.image), p.faces.len())).collect(),
    };
    let uvs = painted.into_iter().flat_map(|painted| painted.uvs).collect();
    FaceTexture { uvs, pages: readable.values().map(|texture| Arc::clone(texture)).collect(), page_of }
}
