//! The surroundings as a panorama for the sky of an engine, in place of a backdrop.
//!
//! A smooth `surface` stands where the shell of a training is, or behind everything. Its picture has the colours that photos agree on (`known`),
//! and continues them where nobody looked (`fill`). Without photos or pictures of a soft scene it has the shell's colours, blurred.

use super::fill::fill;
use super::known::Known;
use super::limits::{LEAST_COVERED, MOST_SUBDIVISIONS, RADIUS_FACTOR};
use super::panorama::{panorama, turned};
use super::surface::surface;
use crate::views::Views;
use glam::{UVec2, Vec3};
use trisplat_scene::{
    Asset, Placement, Result, camera::Camera, image::RgbImage, math::median::median,
    math::octasphere::face_count, mesh::Mesh,
};

/// Subdivisions of the octahedron without a shell: a sphere.
const OF_SPHERE: u32 = 4;
/// Texels per pixel of the photos: what stands behind a scene is out of focus.
const TEXELS_PER_PIXEL: f64 = 0.5;
/// Fewest and most rows of the picture.
const ROWS: [u32; 2] = [256, 1024];
/// How far a shell's own colours are blurred where no picture looks, in heights of the picture: so far that its facets do not show.
const BLUR: f32 = 0.1;

/// The panorama of a bake that is asked for one, in the frame of the cameras.
#[derive(Default)]
pub(crate) struct Sky(Option<RgbImage>);

impl Sky {
    /// What stands behind `mesh`, a scene without its `shell`: what `views` show of it, or the shell's colours. Nothing of an object.
    ///
    /// Errors: a photo that cannot be decoded; more vertices than 32 bits count.
    pub(crate) fn behind(
        mesh: &Mesh,
        shell: Option<&Mesh>,
        views: Option<&mut Views>,
        cameras: &[Camera],
    ) -> Result<Self> {
        Ok(Self(match (shell, views.filter(|views| !views.is_empty())) {
            (None, Some(views)) if views.covered() < LEAST_COVERED => None,
            (shell, Some(views)) => Some(photographed(mesh, shell, views)?),
            (Some(shell), None) => Some(blurred(shell, cameras)),
            (None, None) => None,
        }))
    }
}

/// What `views` show behind `mesh`, where `shell` is.
fn photographed(mesh: &Mesh, shell: Option<&Mesh>, views: &mut Views) -> Result<RgbImage> {
    let (center, mut least) = (views.center(), views.radius());
    if shell.is_none() {
        least = mesh.positions.iter().map(|v| v.distance(center)).fold(least, f32::max);
    }
    let (behind, uvs) = surface(center, subdivisions(shell), shell, RADIUS_FACTOR * least);
    // Neither colours nor textures matter to what is visible.
    let mut all = Mesh { shell: Vec::new(), texture: None, ..mesh.clone() };
    all.append(behind)?;
    let rows = rows(views);
    let mut known = Known::of_photos(&all, mesh.face_count(), &uvs, rows as usize, views)?;
    if let Some(shell) = shell {
        known.add(&panorama(shell, center, rows), shell_weight(rows));
    }
    Ok(filled(known))
}

/// The colours of a shell, blurred, for a scene without photos that `cameras` may have looked at.
fn blurred(shell: &Mesh, cameras: &[Camera]) -> RgbImage {
    let mean = |points: &mut dyn ExactSizeIterator<Item = Vec3>| {
        let count = points.len().max(1) as f32;
        points.sum::<Vec3>() / count
    };
    let center = match cameras.is_empty() {
        true => mean(&mut shell.positions.iter().copied()),
        false => mean(&mut cameras.iter().map(Camera::position)),
    };
    let mut known = Known::nothing(ROWS[0] as usize);
    known.add(&panorama(shell, center, ROWS[0]), shell_weight(ROWS[0]));
    filled(known)
}

/// The weight of a shell's own colours, against the pull of a neighbouring texel.
fn shell_weight(rows: u32) -> f32 {
    (BLUR * rows as f32).powi(-2)
}

fn filled(known: Known) -> RgbImage {
    let rows = known.rows as u32;
    let rgb = fill(known).into_iter().map(|value| value.map(|code| (code + 0.5) as u8)).collect();
    RgbImage { size: UVec2::new(2 * rows, rows), rgb, alpha: None }
}

/// Subdivisions of an octahedron for at most as many triangles as the shell.
fn subdivisions(shell: Option<&Mesh>) -> u32 {
    let fits =
        |shell: &Mesh| (1..=MOST_SUBDIVISIONS).rev().find(|s| face_count(*s) <= shell.face_count() as u64);
    shell.map_or(OF_SPHERE, |shell| fits(shell).unwrap_or(1))
}

/// Rows of a picture that suits the photos.
fn rows(views: &Views) -> u32 {
    let focals = views.cameras().iter().map(Camera::mean_focal).collect();
    let per_radian = TEXELS_PER_PIXEL * median(focals, f64::total_cmp).unwrap_or(0.0);
    ((per_radian * std::f64::consts::PI) as u32).next_power_of_two().clamp(ROWS[0], ROWS[1])
}

/// Gives `asset` the panorama in place of its backdrop, also in its levels. Returns whether there is one.
pub(crate) fn take_sky(asset: &mut Asset, sky: Sky, placement: &Placement) -> bool {
    if let Some((scene, _)) = asset.apart() {
        (asset.mesh, asset.chunks, asset.provenance.backdrop) = (scene.mesh, scene.chunks, 0);
    }
    for level in &mut asset.levels {
        if let Some((scene, _)) = level.apart() {
            *level = scene;
        }
    }
    asset.sky = sky.0.map(|picture| turned(&picture, placement));
    asset.sky.is_some()
}
