//! The surroundings as a panorama for the sky of an engine, in place of a backdrop.
//!
//! A smooth `surface` stands where the shell of a training is, or behind everything. Its picture
//! has the colours that photos agree on (`panorama_colors`), continued where no photo looks.
//! Without photos or pictures of a soft scene it has the shell's colours, blurred.

use super::closed_surface::{
    MAX_SUBDIVISIONS, MIN_COVERED, RADIUS_FACTOR, closed_surface, direction, place,
};
use super::panorama_colors::{PanoramaColors, fill};
use crate::views::Views;
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::collections::HashSet;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::geometry::{face_count, mean, place_bits};
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Asset, Placement, Result, SurroundingsStorage};

/// Subdivisions of the octahedron without a shell: a sphere.
const SPHERE_SUBDIVISIONS: u32 = 4;
/// Texels per pixel of the photos: surroundings are out of focus.
const TEXELS_PER_PIXEL: f64 = 0.5;
/// Minimum and maximum rows of the picture.
const ROWS: [u32; 2] = [256, 1024];
/// Radius by which a shell's own colours are blurred where no picture looks, in heights of the
/// picture: large enough to hide its facets.
const BLUR_RADIUS: f32 = 0.1;

/// The panorama in place of a backdrop, in the frame of the cameras.
#[derive(Default)]
pub(crate) struct Sky(Option<RgbImage>);

impl Sky {
    /// Surroundings of `mesh`, a scene without its `shell`, as `views` show them, or in the shell's
    /// colours. Empty for an object.
    ///
    /// # Errors
    ///
    /// A photo that cannot be decoded; more vertices than 32 bits count.
    pub(crate) fn new(
        mesh: &Mesh,
        shell: Option<&Mesh>,
        views: Option<&mut Views>,
        cameras: &[Camera],
    ) -> Result<Self> {
        Ok(Self(match (shell, views.filter(|views| !views.is_empty())) {
            (None, Some(views)) if views.covered() < MIN_COVERED => None,
            (shell, Some(views)) => Some(photo_panorama(mesh, shell, views)?),
            (Some(shell), None) => Some(shell_panorama(shell, cameras)),
            (None, None) => None,
        }))
    }
}

/// Panorama of `views` behind `mesh`, where `shell` is.
fn photo_panorama(mesh: &Mesh, shell: Option<&Mesh>, views: &mut Views) -> Result<RgbImage> {
    let center = views.center();
    let mut radius = views.radius();
    if shell.is_none() {
        radius = mesh.positions.iter().map(|v| v.distance(center)).fold(radius, f32::max);
    }
    let (surface, uvs) = closed_surface(center, subdivisions(shell), shell, RADIUS_FACTOR * radius);
    // Visibility depends on neither colours nor textures.
    let mut all = Mesh { shell: Vec::new(), texture: None, ..mesh.clone() };
    all.append(surface)?;
    let rows = rows(views);
    let mut colors =
        PanoramaColors::of_photos(&all, mesh.face_count(), &uvs, rows as usize, views)?;
    if let Some(shell) = shell {
        colors.add(&panorama(shell, center, rows), shell_weight(rows));
    }
    Ok(filled(colors))
}

/// The colours of a shell, blurred, for a scene without photos that `cameras` may have looked at.
fn shell_panorama(shell: &Mesh, cameras: &[Camera]) -> RgbImage {
    let center = if cameras.is_empty() {
        mean(shell.positions.iter().copied())
    } else {
        mean(cameras.iter().map(Camera::position))
    };
    let mut colors = PanoramaColors::nothing(ROWS[0] as usize);
    colors.add(&panorama(shell, center, ROWS[0]), shell_weight(ROWS[0]));
    filled(colors)
}

/// The weight of a shell's own colours, against the pull of a neighbouring texel.
fn shell_weight(rows: u32) -> f32 {
    (BLUR_RADIUS * rows as f32).powi(-2)
}

fn filled(colors: PanoramaColors) -> RgbImage {
    let rows = colors.rows as u32;
    let rgb = fill(colors).into_iter().map(|value| value.map(|code| (code + 0.5) as u8)).collect();
    RgbImage { size: UVec2::new(2 * rows, rows), rgb, alpha: None }
}

/// Subdivisions of an octahedron for at most as many triangles as the shell.
fn subdivisions(shell: Option<&Mesh>) -> u32 {
    let fits = |shell: &Mesh| {
        (1..=MAX_SUBDIVISIONS).rev().find(|s| face_count(*s) <= shell.face_count() as u64)
    };
    shell.map_or(SPHERE_SUBDIVISIONS, |shell| fits(shell).unwrap_or(1))
}

/// Rows of a picture that suits the photos.
fn rows(views: &Views) -> u32 {
    let focals = views.cameras().iter().map(|c| f64::from(c.focal.x + c.focal.y) / 2.0).collect();
    let per_radian = TEXELS_PER_PIXEL * median(focals, f64::total_cmp).unwrap_or(0.0);
    ((per_radian * std::f64::consts::PI) as u32).next_power_of_two().clamp(ROWS[0], ROWS[1])
}

/// Gives `asset` the panorama in place of its backdrop, also in its levels. Returns whether there
/// is one.
pub(crate) fn replace_backdrop(asset: &mut Asset, sky: Sky, placement: &Placement) -> bool {
    if let Some((scene, _)) = asset.split_backdrop() {
        asset.mesh = scene.mesh;
        asset.chunks = scene.chunks;
        asset.provenance.backdrop_faces = 0;
    }
    for level in &mut asset.levels {
        if let Some((scene, _)) = level.split_backdrop() {
            *level = scene;
        }
    }
    let Sky(Some(picture)) = sky else { return false };
    asset.surroundings = SurroundingsStorage::Sky(turned(&picture, placement));
    true
}

// ---- A picture of everything around a place, as engines take it for their sky: equirectangular

/// Samples per pixel along each axis.
const SAMPLES: u32 = 2;

/// `mesh` as it is seen from `center`: `rows` rows, twice as many columns.
pub(super) fn panorama(mesh: &Mesh, center: Vec3, rows: u32) -> RgbImage {
    let near =
        mesh.positions.iter().map(|v| v.distance(center)).fold(f32::INFINITY, f32::min) * 1e-3;
    let options = SolidRasterOptions {
        background: [0.0; 3],
        samples: SAMPLES,
        near: near.max(f32::MIN_POSITIVE),
    };
    let mut solid = SolidRasterizer::new();
    let cameras = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|ahead| {
        let lens = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(rows as f32 / 2.0),
            center: Vec2::splat(rows as f32 / 2.0),
            size: UVec2::splat(rows),
        };
        let up = if ahead.y == 0.0 { Vec3::Y } else { Vec3::Z };
        lens.with_look_at(center, center + ahead, up)
    });
    let sides = cameras.map(|camera| (camera, solid.render(mesh, &camera, &options)));
    around(UVec2::new(2 * rows, rows), |direction| {
        let depth = |camera: &Camera| (camera.rotation * direction).z;
        let best = sides.iter().max_by(|a, b| depth(&a.0).total_cmp(&depth(&b.0)));
        best.map_or([0; 3], |(camera, side)| sampled(side, camera, direction))
    })
}

/// The picture of a colour in every direction.
fn around(size: UVec2, color: impl Fn(Vec3) -> [u8; 3] + Sync) -> RgbImage {
    let rgb = parallel::collect(size.element_product() as usize, GRAIN, |i| {
        let pixel = UVec2::new(i as u32 % size.x, i as u32 / size.x);
        color(direction((pixel.as_vec2() + 0.5) / size.as_vec2()))
    });
    RgbImage { size, rgb, alpha: None }
}

/// A panorama of the source's world as one of a file with this placement.
pub(super) fn turned(picture: &RgbImage, placement: &Placement) -> RgbImage {
    let size = picture.size;
    let back = placement.rotation().transpose();
    around(size, |direction| {
        let from = place((back * direction.as_dvec3()).as_vec3()) * size.as_vec2() - 0.5;
        // The first and the last column are neighbours.
        let corner = from.floor();
        let column = |x: f32| (x as i64).rem_euclid(i64::from(size.x)) as u32;
        let row = |y: f32| (y.max(0.0) as u32).min(size.y - 1);
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
            .map(|(x, y)| (column(corner.x + x), row(corner.y + y)));
        mixed(picture, corners, from - corner)
    })
}

/// The colour of a picture in a direction, between the four nearest pixels.
fn sampled(picture: &RgbImage, camera: &Camera, direction: Vec3) -> [u8; 3] {
    let seen = camera.rotation * direction;
    let last = (picture.size - 1).as_vec2();
    let at =
        (seen.truncate() / seen.z * camera.focal + camera.center - 0.5).clamp(Vec2::ZERO, last);
    let corner = at.as_uvec2();
    let part = at.fract();
    let next = (corner + 1).min(picture.size - 1);
    mixed(
        picture,
        [(corner.x, corner.y), (next.x, corner.y), (corner.x, next.y), (next.x, next.y)],
        part,
    )
}

/// The colour between four pixels, left and right above and left and right below, `part` of the way
/// from the first.
fn mixed(picture: &RgbImage, corners: [(u32, u32); 4], part: Vec2) -> [u8; 3] {
    let pixel = |x: u32, y: u32| picture.rgb[(y * picture.size.x + x) as usize].map(f32::from);
    let [a, b, c, d] = corners.map(|(x, y)| pixel(x, y));
    let mix = |i: usize| {
        let above = a[i] + part.x * (b[i] - a[i]);
        let below = c[i] + part.x * (d[i] - c[i]);
        above + part.y * (below - above)
    };
    [mix(0), mix(1), mix(2)].map(|code| (code + 0.5) as u8)
}

// ---- One closed surface in place of a shell of shards -------------------------------------------

/// Shells of more triangles show more detail than the surface would.
const MAX_FACES: usize = 8192;
/// Rows of the picture of the shell for each face around the surface.
const ROWS_PER_FACE: u32 = 4;

/// True if the faces of `shell` hardly touch: a closed surface has half as many vertices as faces,
/// separate faces have three times as many.
pub(crate) fn is_scattered(shell: &Mesh) -> bool {
    if shell.face_count() > MAX_FACES {
        return false;
    }
    let places: HashSet<[u32; 3]> =
        shell.positions.iter().map(|place| place_bits(*place)).collect();
    places.len() > shell.face_count()
}

/// A surface around `center` where `shell` is, but nowhere nearer than `least`, in the colours that
/// the shell shows there, of at most `most` triangles; `None` where that is too few to close
/// anything.
pub(crate) fn close_surface(
    shell: &Mesh,
    center: Vec3,
    min_radius: f32,
    max_faces: u64,
) -> Option<Mesh> {
    let has_enough = |s: &u32| face_count(*s) >= shell.face_count() as u64;
    let has_enough = (2..MAX_SUBDIVISIONS).find(has_enough).unwrap_or(MAX_SUBDIVISIONS);
    let subdivisions = (1..=has_enough).rev().find(|s| face_count(*s) <= max_faces)?;
    let picture = panorama(shell, center, ROWS_PER_FACE << subdivisions);
    let (mut mesh, _) = closed_surface(center, subdivisions, Some(shell), min_radius);
    let color = |face: usize| {
        let at = place(mesh.centroid(face) - center) * picture.size.as_vec2();
        let pixel = at.as_uvec2().min(picture.size - 1);
        let codes = picture.rgb[(pixel.y * picture.size.x + pixel.x) as usize];
        codes.map(|code| linear_from_srgb(f32::from(code) / 255.0))
    };
    mesh.colors = Colors::Face((0..mesh.face_count()).map(color).collect());
    Some(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces of a sphere, each turned a little about its middle and larger: they overlap and touch
    /// nowhere.
    fn scattered() -> Mesh {
        let (mut mesh, _) = closed_surface(Vec3::ZERO, 2, None, 10.0);
        for face in 0..mesh.face_count() {
            let middle = mesh.centroid(face);
            let normal = mesh.flat_normal(face);
            for corner in &mut mesh.positions[3 * face..3 * face + 3] {
                let turned =
                    glam::Quat::from_axis_angle(normal, 0.1 * face as f32) * (*corner - middle);
                *corner = middle + 2.0 * turned;
            }
        }
        let level =
            |face: usize| if mesh.centroid(face).y > 0.0 { [0.0, 0.5, 1.0] } else { [0.2; 3] };
        mesh.colors = Colors::Face((0..mesh.face_count()).map(level).collect());
        mesh
    }

    #[test]
    fn scattered_triangles_become_one_surface_in_their_colours() {
        let shell = scattered();
        assert!(is_scattered(&shell));
        let found = close_surface(&shell, Vec3::ZERO, 1.0, u64::MAX).unwrap();
        assert!(!is_scattered(&found) && found.face_count() == 128);
        for face in 0..found.face_count() {
            let middle = found.centroid(face);
            let color = found.corner_colors(face)[0];
            assert!((6.0..14.0).contains(&middle.length()), "{middle}");
            let wanted = if middle.y > 0.0 { 1.0 } else { 0.2 };
            assert!(
                middle.y.abs() < 4.0 || (color[2] - wanted).abs() < 0.01,
                "{middle}: {color:?}"
            );
        }
        let far = close_surface(&shell, Vec3::ZERO, 20.0, u64::MAX).unwrap();
        assert!(far.positions.iter().all(|v| v.length() > 19.9));
        // Fewer, larger triangles where a limit asks for that.
        let count =
            |most| close_surface(&shell, Vec3::ZERO, 1.0, most).map(|found| found.face_count());
        assert_eq!([31, 32, 127, 128].map(count), [None, Some(32), Some(32), Some(128)]);
    }
}
