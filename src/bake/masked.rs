//! What masks take out of a scene: triangles in masked pixels and, where masks leave an object, everything
//! beside it.

use super::pieces::pieces;
use super::silhouettes::Silhouettes;
use super::unseen::UnseenOptions;
use super::views::{SAMPLES, Views};
use super::visibility::{Counted, counted};
use crate::camera::Camera;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::report::StageProgress;
use glam::Vec3;

/// At least this share of a triangle's visible area must lie in unmasked pixels.
const LEAST_COUNTED: f32 = 0.5;
/// A piece away from an object is dropped when it has less than this share of the area that photos show.
const LEAST_PIECE: f64 = 0.005;

/// Drops triangles that photos see mostly in masked pixels, where training never compared them with anything.
/// Of an object that masks leave, drops triangles outside its silhouettes, and small pieces away from it.
/// Returns how many; `None` without such masks, and with `keep_unseen`.
///
/// Errors: a photo that cannot be decoded.
pub fn masked(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &UnseenOptions,
    progress: &mut StageProgress<'_>,
) -> Result<Option<u64>> {
    let Some(views) = views.filter(|views| views.are_masked() && !options.keep_unseen) else {
        return Ok(None);
    };
    let mut silhouettes = Silhouettes::new(mesh.face_count());
    let add = |camera: &Camera, photo: &_| silhouettes.add(mesh, camera, photo);
    let counted = counted(mesh, views, SAMPLES, add, progress)?;
    let is_object = silhouettes.show_an_object();
    let stays = |face: usize| {
        counted[face].share().is_none_or(|share| share >= LEAST_COUNTED)
            && (!is_object || silhouettes.contain(face))
    };
    let mut kept: Vec<u32> = (0..mesh.face_count() as u32).filter(|face| stays(*face as usize)).collect();
    if is_object {
        kept = without_strays(mesh, views.cameras(), kept, &counted);
    }
    // Masks that would remove everything are not masks of this scene.
    if kept.is_empty() {
        return Ok(Some(0));
    }
    let dropped = (mesh.face_count() - kept.len()) as u64;
    mesh.keep(&kept);
    Ok(Some(dropped))
}

/// `faces` without small pieces, if photos look at the rest from outside. A scene around its cameras may be
/// in pieces.
fn without_strays(mesh: &Mesh, cameras: &[Camera], faces: Vec<u32>, counted: &[Counted]) -> Vec<u32> {
    let (piece_of, count) = pieces(mesh, &faces);
    let samples = |face: u32| counted[face as usize].samples;
    let mut samples_of = vec![0; count];
    for (face, piece) in faces.iter().zip(&piece_of) {
        samples_of[*piece as usize] += samples(*face);
    }
    let all: u64 = samples_of.iter().sum();
    let is_large = |piece: u32| samples_of[piece as usize] as f64 >= LEAST_PIECE * all as f64;
    let kept: Vec<u32> =
        faces.iter().zip(&piece_of).filter(|(_, piece)| is_large(**piece)).map(|(face, _)| *face).collect();
    let corners = || kept.iter().flat_map(|face| mesh.corners(*face as usize));
    let low = corners().fold(Vec3::INFINITY, Vec3::min);
    let high = corners().fold(Vec3::NEG_INFINITY, Vec3::max);
    let is_inside = |camera: &Camera| {
        let eye = camera.position();
        eye.cmpge(low).all() && eye.cmple(high).all()
    };
    if cameras.iter().any(is_inside) { faces } else { kept }
}
