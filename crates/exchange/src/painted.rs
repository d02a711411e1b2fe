//! Textures of an input mesh: kept if nothing else colours their faces, else turned into a colour per face.

use glam::Vec2;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use trisplat_scene::{
    FaceTexture, NO_PAGE, Texture,
    mesh::{Colors, Mesh},
};

/// Most pictures that are kept: of more, drawing each by itself costs an engine more than they show.
const MOST_PAGES: usize = 256;

/// The textured faces of a part of a mesh, and the places of their corners on the texture.
pub struct PaintedFaces {
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
pub fn paint(
    mesh: &mut Mesh,
    painted: Vec<PaintedFaces>,
    textures: &BTreeMap<usize, Option<Arc<Texture>>>,
) -> Option<String> {
    let within = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
    let plain = painted.iter().all(|painted| painted.plain && painted.uvs.as_flattened().iter().all(within));
    let readable: BTreeMap<usize, &Arc<Texture>> =
        textures.iter().filter_map(|(number, texture)| Some((*number, texture.as_ref()?))).collect();
    if readable.is_empty() {
        return None;
    }
    let all_readable = painted.iter().all(|painted| readable.contains_key(&painted.image));
    if plain && all_readable && readable.len() <= MOST_PAGES {
        let texture = pages(painted, &readable, mesh.face_count());
        match texture.is_whole() {
            true => {
                let mean = |face: usize| texture.mean(face).unwrap_or_default();
                mesh.colors = Colors::Face((0..mesh.face_count()).into_par_iter().map(mean).collect());
            }
            false => color_corners(mesh, &texture),
        }
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
        let texture = FaceTexture::new(painted.uvs.iter().map(repeated).collect(), texture.clone());
        for (face, color) in colors[painted.faces].iter_mut().enumerate() {
            let mean = texture.mean(face).unwrap_or([1.0; 3]);
            (0..3).for_each(|c| color[c] *= mean[c]);
        }
    }
    mesh.colors = Colors::Face(colors);
    Some("textures became one colour per triangle: only pictures without repetition or another colour are kept".to_owned())
}

/// Gives the corners of faces on a page their colours of it, beside faces with colours.
fn color_corners(mesh: &mut Mesh, texture: &FaceTexture) {
    for face in 0..mesh.face_count() {
        let (Some(mean), Some(corners)) = (texture.mean(face), texture.corner_means(face)) else { continue };
        let vertices = mesh.face(face);
        match &mut mesh.colors {
            Colors::Face(colors) => colors[face] = mean,
            Colors::Vertex(colors) => {
                vertices.into_iter().zip(corners).for_each(|(vertex, color)| colors[vertex as usize] = color);
            }
        }
    }
}

/// The pictures of faces as pages; of `count` faces, others show colours.
fn pages(painted: Vec<PaintedFaces>, readable: &BTreeMap<usize, &Arc<Texture>>, count: usize) -> FaceTexture {
    let mut page_of = vec![NO_PAGE; count];
    let mut uvs = vec![[Vec2::ZERO; 3]; count];
    for painted in painted {
        page_of[painted.faces.clone()].fill(readable.range(..painted.image).count() as u16);
        uvs[painted.faces].copy_from_slice(&painted.uvs);
    }
    if readable.len() == 1 && !page_of.contains(&NO_PAGE) {
        page_of.clear();
    }
    FaceTexture { uvs, pages: readable.values().map(|texture| Arc::clone(texture)).collect(), page_of }
}
