//! Promises of the chunk stage: every face once, in consecutive runs of limited size, compact.

use super::hostile::{finite, grid, mesh_of};
use glam::Vec3;
use trisplat_bake::{ChunkDetails, ChunkOptions, FaceOrder, MAX_CHUNK_TRIANGLES, chunk};
use trisplat_scene::{Asset, mesh::Mesh, report::Outcome};
use trisplat_synthetic::soups::studio;

/// The mesh in chunks of at most `limit` faces, in their order.
pub(crate) fn chunked(mesh: Mesh, limit: u32) -> Asset {
    let mut asset = Asset { mesh, ..Asset::default() };
    chunk(
        &mut asset,
        &ChunkOptions { chunk_triangles: limit },
        FaceOrder::None,
        &mut ChunkDetails::default(),
    )
    .unwrap();
    asset
}

/// Corners, colours and opacity as bits.
type FaceBits = ([[u32; 3]; 3], [[u32; 3]; 3], u32);

/// The bits of every face, sorted.
fn faces(mesh: &Mesh) -> Vec<FaceBits> {
    let bits = |v: [f32; 3]| v.map(f32::to_bits);
    let face = |f: usize| {
        let opacity = mesh.opacity.get(f).copied().unwrap_or(1.0);
        (
            mesh.corners(f).map(|v| bits(v.into())),
            mesh.corner_colors(f).map(bits),
            opacity.to_bits(),
        )
    };
    let mut all: Vec<_> = (0..mesh.face_count()).map(face).collect();
    all.sort_unstable();
    all
}

#[test]
fn chunks_hold_every_face_once() {
    let mut meshes: Vec<(&str, Mesh)> =
        finite().into_iter().map(|(name, soup)| (name, mesh_of(&soup))).collect();
    let mut opaque = grid(12);
    opaque.opacity = (0..opaque.face_count()).map(|f| f as f32 / 1000.0).collect();
    meshes.push(("connected, with opacity", opaque));
    for (name, mesh) in meshes {
        for limit in [1, 7, 100] {
            let before = faces(&mesh);
            let asset = chunked(mesh.clone(), limit);
            assert_eq!(faces(&asset.mesh), before, "{name}, limit {limit}");
            let mut next = 0;
            for chunk in &asset.chunks {
                assert_eq!(chunk.first, next, "{name}, limit {limit}");
                assert!(
                    chunk.count <= limit && (chunk.count > 0 || mesh.face_count() == 0),
                    "{name}: {chunk:?}"
                );
                next += chunk.count;
            }
            assert_eq!(next as usize, mesh.face_count(), "{name}, limit {limit}");
            let most = mesh.face_count() / (limit as usize / 8).max(1) + 1;
            assert!(
                asset.chunks.len() <= most,
                "{name}, limit {limit}: {} chunks",
                asset.chunks.len()
            );
        }
    }
}

#[test]
fn a_small_scene_is_one_chunk_and_stays_as_it_is() {
    for limit in [0, 1000] {
        let mesh = mesh_of(&studio(1000, 1));
        let mut asset = Asset { mesh: mesh.clone(), ..Asset::default() };
        let outcome = chunk(
            &mut asset,
            &ChunkOptions { chunk_triangles: limit },
            FaceOrder::None,
            &mut ChunkDetails::default(),
        );
        assert!(matches!(outcome, Ok(Outcome::Skipped(_))));
        assert!(asset.mesh == mesh && asset.chunks.len() == 1 && asset.chunks[0].count == 1000);
    }
}

#[test]
fn a_chunk_fits_16_bit_indices() {
    let options = ChunkOptions { chunk_triangles: MAX_CHUNK_TRIANGLES + 1 };
    let error =
        chunk(&mut Asset::default(), &options, FaceOrder::None, &mut ChunkDetails::default())
            .unwrap_err();
    assert!(error.to_string().starts_with("chunk_triangles is 21846"), "{error}");
    const { assert!(3 * MAX_CHUNK_TRIANGLES <= 65_535) };
}

/// Chunks are better than runs of the same size along a curve, and triangles of another scale get
/// their own.
#[test]
fn large_triangles_do_not_bloat_the_chunks_of_small_ones() {
    let mut soup = studio(20_000, 2);
    for triangle in soup.vertices.iter_mut().step_by(50) {
        *triangle = triangle.map(|v| 100.0 * v); // 2% a hundred times as large and far
    }
    let asset = chunked(mesh_of(&soup), 500);
    let extent = |chunk: &trisplat_scene::Chunk| {
        let vertices =
            (chunk.first..chunk.first + chunk.count).flat_map(|f| asset.mesh.corners(f as usize));
        let (min, max) = vertices
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), v| (min.min(v), max.max(v)));
        (max - min).max_element()
    };
    let mut extents: Vec<f32> = asset.chunks.iter().map(extent).collect();
    extents.sort_by(f32::total_cmp);
    let all = extents[extents.len() - 1];
    let compact = extents.iter().filter(|&&e| e < 0.05 * all).count();
    assert!(compact * 10 >= 7 * extents.len(), "{compact} of {} chunks are compact", extents.len());
}
