//! Scenes to write.

use glam::Vec3;
use proptest::prelude::*;
use trisplat_scene::{
    Asset, Chunk,
    math::color::linear_from_srgb,
    mesh::{Colors, Mesh},
};

/// Every 8-bit code in every channel, one colour per face; positions with awkward decimals.
pub(crate) fn ramp(faces: usize) -> Asset {
    let code = |i: usize| linear_from_srgb((i % 256) as f32 / 255.0);
    let colors = (0..faces).map(|i| [code(i), code(255 - i % 256), code(i * 7)]).collect();
    asset(positions(3 * faces), Colors::Face(colors), Vec::new())
}

pub(crate) fn positions(count: usize) -> Vec<Vec3> {
    // Squares, because equal steps would put the corners of a face on a line.
    let part = |i: usize, ratio: f64| ((i * i) as f64 * ratio).fract() as f32;
    (0..count)
        .map(|i| {
            Vec3::new(
                part(i, 0.618_034) * 3.3 - 1.1,
                part(i, 0.754_877) / 3.0,
                part(i, 0.569_84) - 9.0,
            )
        })
        .collect()
}

pub(crate) fn asset(positions: Vec<Vec3>, colors: Colors, indices: Vec<u32>) -> Asset {
    let mesh = Mesh { positions, colors, indices, ..Mesh::default() };
    cut(Asset { mesh, ..Asset::default() }, 1)
}

pub(crate) fn cut(mut asset: Asset, chunks: u32) -> Asset {
    let faces = u64::from(asset.mesh.face_count() as u32);
    let start = |i: u32| (faces * u64::from(i) / u64::from(chunks)) as u32;
    asset.chunks =
        (0..chunks).map(|i| Chunk { first: start(i), count: start(i + 1) - start(i) }).collect();
    asset
}

/// A closed strip of faces that share their vertices, one colour per vertex.
pub(crate) fn strip(vertices: u32) -> Asset {
    let color = |i: u32| [0.0, i as f32 / vertices as f32, 1.0];
    let indices = (0..vertices).flat_map(|i| [i, (i + 1) % vertices, (i + 2) % vertices]).collect();
    asset(positions(vertices as usize), Colors::Vertex((0..vertices).map(color).collect()), indices)
}

/// Any valid mesh: coordinates from denormal to 1e12, shared vertices or not, cut anywhere.
pub(crate) fn any_asset() -> impl Strategy<Value = Asset> {
    let float = prop_oneof![4 => -10.0f32..10.0, 1 => -1e-40f32..1e-40, 1 => -1e12f32..1e12];
    let vertices = proptest::collection::vec((float.clone(), float.clone(), float), 3..60);
    let channel = 0.0f32..=1.0;
    let colors = proptest::collection::vec((channel.clone(), channel.clone(), channel), 60);
    (vertices, colors, any::<bool>(), proptest::collection::vec(any::<u32>(), 0..90), 1u32..6)
        .prop_map(|(vertices, colors, by_face, indices, chunks)| {
            let mut points: Vec<Vec3> = vertices.into_iter().map(Vec3::from).collect();
            let mut indices: Vec<u32> =
                indices.into_iter().map(|i| i % points.len() as u32).collect();
            indices.truncate(indices.len() / 3 * 3);
            if indices.is_empty() {
                points.truncate(points.len() / 3 * 3);
            }
            let mut mesh = Mesh { positions: points, indices, ..Mesh::default() };
            let color = |i: usize| <[f32; 3]>::from(colors[i % colors.len()]);
            mesh.colors = if by_face {
                Colors::Face((0..mesh.face_count()).map(color).collect())
            } else {
                Colors::Vertex((0..mesh.vertex_count()).map(color).collect())
            };
            cut(Asset { mesh, ..Asset::default() }, chunks)
        })
}
