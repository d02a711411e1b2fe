//! A picture of everything around a place, as engines take it for their sky: equirectangular.

use super::surface::{direction, place};
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Placement, camera::Camera, image::RgbImage, mesh::Mesh};

/// Samples per pixel along each axis.
const SAMPLES: u32 = 2;

/// `mesh` as it is seen from `center`: `rows` rows, twice as many columns.
pub(super) fn panorama(mesh: &Mesh, center: Vec3, rows: u32) -> RgbImage {
    let near = mesh.positions.iter().map(|v| v.distance(center)).fold(f32::INFINITY, f32::min) * 1e-3;
    let options =
        SolidRasterOptions { background: [0.0; 3], samples: SAMPLES, near: near.max(f32::MIN_POSITIVE) };
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
        lens.looking(center, center + ahead, up)
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
pub(super) fn turned(picture: &RgbImage, how: &Placement) -> RgbImage {
    let (size, back) = (picture.size, how.rotation().transpose());
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
    let at = (seen.truncate() / seen.z * camera.focal + camera.center - 0.5).clamp(Vec2::ZERO, last);
    let (corner, part) = (at.as_uvec2(), at.fract());
    let next = (corner + 1).min(picture.size - 1);
    mixed(picture, [(corner.x, corner.y), (next.x, corner.y), (corner.x, next.y), (next.x, next.y)], part)
}

/// The colour between four pixels, left and right above and left and right below, `part` of the way from the first.
fn mixed(picture: &RgbImage, corners: [(u32, u32); 4], part: Vec2) -> [u8; 3] {
    let pixel = |x: u32, y: u32| picture.rgb[(y * picture.size.x + x) as usize].map(f32::from);
    let [a, b, c, d] = corners.map(|(x, y)| pixel(x, y));
    let mix = |i: usize| {
        let (above, below) = (a[i] + part.x * (b[i] - a[i]), c[i] + part.x * (d[i] - c[i]));
        above + part.y * (below - above)
    };
    [mix(0), mix(1), mix(2)].map(|code| (code + 0.5) as u8)
}
