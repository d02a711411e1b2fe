//! Depth picture of one camera: distance and colour of the nearest surface.

use glam::{UVec2, Vec2, Vec3};
use trisplat_raster::soft::SoftOptions;
use trisplat_raster::solid::{Barycentrics, NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::srgb8_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::report::StageProgress;
use trisplat_scene::{Scene, SceneNormalization, Soup};
use trisplat_teacher::Teacher;

/// Depth of a pixel whose ray hits nothing.
pub(super) const FREE: f32 = f32::INFINITY;
/// Depth of a pixel without observation.
pub(super) const UNKNOWN: f32 = 0.0;
/// Minimum share of the full distance that an observation at a grazing angle keeps.
const MIN_SLANT: f32 = 0.1;
/// Weight of an observation beside an outline, where it is not sure which pixel a ray belongs to.
const OUTLINE_WEIGHT: f32 = 0.05;
/// Weight of an observation of empty space: it does not say how near the surface is.
const FREE_WEIGHT: f32 = 0.5;

/// A picture of depths.
#[derive(Debug)]
pub(super) struct DepthPicture {
    pub(super) camera: Camera,
    /// Depth z in the camera's frame, units of the scene; [`FREE`] or [`UNKNOWN`]. `[height *
    /// width]`
    pub(super) depth: Vec<f32>,
    /// sRGB codes. `[height * width]`
    pub(super) rgb: Vec<[u8; 3]>,
    /// Weight of its observations.
    pub(super) weight: f32,
}

/// A picture's observation at a place on one of its rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observation {
    /// Depth of the surface there, or [`FREE`].
    pub(super) depth: f32,
    /// Distance from the surface's plane per difference of depth: small where the surface is seen
    /// at a grazing angle.
    pub(super) slant: f32,
    /// Weight in the fusion.
    pub(super) weight: f32,
    /// The pixel nearest to it.
    pub(super) pixel: usize,
}

impl DepthPicture {
    /// A point of the scene in the camera's frame.
    pub(super) fn to_camera(&self, point: Vec3) -> Vec3 {
        self.camera.rotation * point + self.camera.translation
    }

    /// The middle of a pixel, px.
    pub(super) fn middle(&self, pixel: usize) -> Vec2 {
        let width = self.camera.size.x;
        UVec2::new(pixel as u32 % width, pixel as u32 / width).as_vec2() + 0.5
    }

    /// The pixel at a place of the picture; `None` beyond its right and lower side.
    pub(super) fn pixel_at(&self, place: Vec2) -> Option<usize> {
        let at = place.as_uvec2();
        at.cmplt(self.camera.size).all().then_some((at.y * self.camera.size.x + at.x) as usize)
    }

    /// The pixel nearest to a place.
    pub(super) fn nearest(&self, place: Vec2) -> usize {
        let at = place.as_uvec2().min(self.camera.size - 1);
        (at.y * self.camera.size.x + at.x) as usize
    }

    /// The point of the scene that a pixel shows; `None` where it shows none.
    pub(super) fn point(&self, pixel: usize) -> Option<Vec3> {
        let depth = self.depth[pixel];
        if !(depth > 0.0 && depth.is_finite()) {
            return None;
        }
        let ray = ((self.middle(pixel) - self.camera.center) / self.camera.focal).extend(1.0);
        let point = self.camera.rotation.transpose() * (ray * depth - self.camera.translation);
        point.is_finite().then_some(point)
    }

    /// Observe the surface on the ray to `q`, a point in the camera's frame. Between pixels whose
    /// depths differ by less than `step` the surface is a plane, on which 1/z is linear in the
    /// picture; elsewhere the nearest pixel is taken.
    pub(super) fn observe(&self, q: Vec3, step: f32) -> Option<Observation> {
        let Camera { focal, center, size, .. } = self.camera;
        if !(q.z > 0.0) {
            return None;
        }
        let at = q.truncate() / q.z * focal + center;
        if !(at.cmpge(Vec2::ZERO).all() && at.cmplt(size.as_vec2()).all()) {
            return None;
        }
        let width = size.x as usize;
        let pixel = at.y as usize * width + at.x as usize;
        let depth = self.depth[pixel];
        if depth == UNKNOWN {
            return None;
        }
        let nearest = Observation { depth, slant: 1.0, weight: OUTLINE_WEIGHT, pixel };
        let corner = (at - 0.5).floor();
        let inside = corner.cmpge(Vec2::ZERO).all() && (corner + 1.0).cmplt(size.as_vec2()).all();
        if !inside {
            return Some(nearest);
        }
        let first = corner.y as usize * width + corner.x as usize;
        let around = [first, first + 1, first + width, first + width + 1].map(|i| self.depth[i]);
        let smooth = around.iter().all(|d| (*d - depth).abs() < step);
        Some(match depth {
            FREE if around == [FREE; 4] => Observation { weight: FREE_WEIGHT, ..nearest },
            _ if smooth => self.on_plane(around, at, at - 0.5 - corner, pixel),
            _ => nearest,
        })
    }

    /// The plane through four pixels, at a place between them.
    ///
    /// ```text
    /// 1/z = n · r r = ((x - cx) / fx, (y - cy) / fy, 1) a point p in front of the plane is (1 - n
    /// · p) / |n| away from it
    /// ```
    fn on_plane(&self, around: [f32; 4], at: Vec2, share: Vec2, pixel: usize) -> Observation {
        let [a, b, c, d] = around.map(f32::recip);
        let top = a + (b - a) * share.x;
        let bottom = c + (d - c) * share.x;
        let inverse = top + (bottom - top) * share.y;
        let across = ((b - a) * (1.0 - share.y) + (d - c) * share.y) * self.camera.focal.x;
        let down = (bottom - top) * self.camera.focal.y;
        let ray = (at - self.camera.center) / self.camera.focal;
        let normal = Vec3::new(across, down, inverse - across * ray.x - down * ray.y);
        let depth = inverse.recip();
        let slant = (inverse / normal.length()).clamp(MIN_SLANT, ray.extend(1.0).length());
        // A surface that is seen at a grazing angle is seen badly.
        Observation { depth, slant, weight: slant, pixel }
    }
}

/// A picture and the sides of its pyramid of view.
#[derive(Debug)]
pub(super) struct ViewFrustum<'a> {
    pub(super) picture: &'a DepthPicture,
    /// Unit normals, inwards, of the four sides, in the camera's frame.
    sides: [Vec3; 4],
}

impl<'a> ViewFrustum<'a> {
    pub(super) fn new(picture: &'a DepthPicture) -> Self {
        let camera = &picture.camera;
        let low = -camera.center / camera.focal;
        let high = (camera.size.as_vec2() - camera.center) / camera.focal;
        let sides = [
            Vec3::new(1.0, 0.0, -low.x),
            Vec3::new(-1.0, 0.0, high.x),
            Vec3::new(0.0, 1.0, -low.y),
            Vec3::new(0.0, -1.0, high.y),
        ];
        Self { picture, sides: sides.map(Vec3::normalize) }
    }

    /// True if some of a ball may be in view.
    pub(super) fn sees(&self, center: Vec3, radius: f32) -> bool {
        let center = self.picture.to_camera(center);
        center.z > -radius && self.sides.iter().all(|side| side.dot(center) > -radius)
    }
}

// ---- Draws the depth pictures of a scene --------------------------------------------------------

/// Pixels of all pictures together: they are in memory at once, with 7 bytes each.
const MAX_PIXELS: f64 = 48_000_000.0;
/// From this transmittance on a pixel counts as empty.
const FREE_FROM: f32 = 0.9;
/// Pixels to each side of a pixel that tell whether it shows a crack.
const CRACK_PX: i32 = 3;
/// Pairs of opposite ones.
const PAIRS: usize = (2 * CRACK_PX * (CRACK_PX + 1)) as usize;
/// Share of the pairs that are before a crack, ...
const CRACK_SHARE: f32 = 0.25;
/// ... by this share of the depth, ...
const CRACK_BEHIND: f32 = 0.02;
/// ... and whose depths differ by less than this share: two things beside each other have no crack
/// between them.
const SAME_SURFACE: f32 = 0.05;
/// Depth of the near plane in units of training space, as in training.
const NEAR: f32 = 0.01;

/// Draw the depth pictures of `scene`, with its `shell` or without. Where all pictures together
/// would be too large, each is smaller.
pub(super) fn pictures(
    scene: &Scene,
    shell: bool,
    cameras: &[Camera],
    progress: StageProgress<'_>,
) -> Vec<DepthPicture> {
    let pixels: f64 = cameras.iter().map(|c| f64::from(c.size.x) * f64::from(c.size.y)).sum();
    let ratio = (MAX_PIXELS / pixels).sqrt().min(1.0);
    let smaller = |camera: &Camera| {
        camera.resized((camera.size.as_dvec2() * ratio).as_uvec2().max(UVec2::ONE))
    };
    let cameras: Vec<Camera> =
        cameras.iter().map(|c| if ratio < 1.0 { smaller(c) } else { *c }).collect();
    let mut pictures = match scene {
        Scene::Soup(soup) => of_soup(soup, shell, &cameras, progress),
        Scene::Mesh(mesh) => {
            let mut mesh = mesh.clone();
            // A surface has both sides.
            mesh.single_sided.clear();
            if !shell {
                mesh.take_shell();
            }
            of_mesh(&mesh, &cameras, progress)
        }
    };
    for DepthPicture { camera, depth, .. } in &mut pictures {
        *depth = close_cracks(depth, camera.size);
    }
    pictures
}

/// Closes the cracks of a surface of unconnected triangles. Where many pairs of opposite pixels
/// around a pixel are before it, it becomes as far as a surface through the pairs: on a slope one
/// of a pair is behind, beyond a straight outline both are, and a thin thing is before.
fn close_cracks(depth: &[f32], size: UVec2) -> Vec<f32> {
    let [width, height] = size.as_ivec2().to_array();
    let offsets: Vec<(i32, i32, isize)> = (0..=CRACK_PX)
        .flat_map(|y| (-CRACK_PX..=CRACK_PX).map(move |x| (x, y, (y * width + x) as isize)))
        .filter(|(x, y, _)| *y > 0 || *x > 0)
        .collect();
    let is_in_picture = |x: i32, y: i32| (0..width).contains(&x) && (0..height).contains(&y);
    parallel::collect(depth.len(), GRAIN, |pixel| {
        let x = pixel as i32 % width;
        let y = pixel as i32 / width;
        let here = depth[pixel];
        let inside =
            is_in_picture(x - CRACK_PX, y - CRACK_PX) && is_in_picture(x + CRACK_PX, y + CRACK_PX);
        let before = here / (1.0 + CRACK_BEHIND);
        let mut pairs = 0;
        let mut valid_pairs = 0;
        let mut through = [0.0; PAIRS];
        for &(dx, dy, step) in &offsets {
            let is_pair =
                inside || (is_in_picture(x - dx, y - dy) && is_in_picture(x + dx, y + dy));
            if !is_pair {
                continue;
            }
            let [a, b] = [-step, step].map(|step| depth[pixel.wrapping_add_signed(step)]);
            pairs += 1;
            if a < before && b < before && a.max(b) < (1.0 + SAME_SURFACE) * a.min(b) {
                // 1/z is linear on a plane.
                through[valid_pairs] = 2.0 * a * b / (a + b);
                valid_pairs += 1;
            }
        }
        if valid_pairs == 0 || (valid_pairs as f32) < CRACK_SHARE * pairs as f32 {
            return here;
        }
        *through[..valid_pairs].select_nth_unstable_by(valid_pairs / 2, f32::total_cmp).1
    })
}

/// Median depths of the soft drawing.
fn of_soup(
    soup: &Soup,
    shell: bool,
    cameras: &[Camera],
    mut progress: StageProgress<'_>,
) -> Vec<DepthPicture> {
    let mut soup = soup.clone();
    if !shell {
        soup.take_shell();
    }
    let options = SoftOptions { geometry: true, ..SoftOptions::default() };
    let mut teacher = Teacher::new(soup, cameras, &options);
    let unit = teacher.depth_unit();
    let mut one = |(i, camera): (usize, &Camera)| {
        progress.set(i, cameras.len());
        let frame = teacher.frame(camera);
        let depth = frame.median_depth.iter().zip(&frame.transmittance).map(|(depth, through)| {
            if *depth > 0.0 {
                depth * unit
            } else if *through >= FREE_FROM {
                FREE
            } else {
                UNKNOWN
            }
        });
        DepthPicture {
            camera: *camera,
            depth: depth.collect(),
            rgb: frame.to_pixels().rgb,
            weight: 1.0,
        }
    };
    cameras.iter().enumerate().map(&mut one).collect()
}

/// Depths of the nearest faces.
fn of_mesh(mesh: &Mesh, cameras: &[Camera], mut progress: StageProgress<'_>) -> Vec<DepthPicture> {
    let centroids: Vec<Vec3> = (0..mesh.face_count()).map(|face| mesh.centroid(face)).collect();
    let near = NEAR / SceneNormalization::new(cameras, &centroids).scale;
    let options = SolidRasterOptions { near, ..SolidRasterOptions::default() };
    let mut solid = SolidRasterizer::new();
    let mut one = |(i, camera): (usize, &Camera)| {
        progress.set(i, cameras.len());
        let visibility = solid.visibility(mesh, camera, &options);
        let weights = Barycentrics::new(mesh, camera, 1);
        let color = |(pixel, face): (usize, &u32)| {
            if *face == NO_FACE {
                return [0; 3];
            }
            let x = pixel as u32 % camera.size.x;
            let y = pixel as u32 / camera.size.x;
            let weights = weights.weights(&weights.face(*face), x, y);
            let corners = mesh.corner_colors(*face as usize).map(Vec3::from);
            let linear =
                corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            linear.to_array().map(srgb8_from_linear)
        };
        let rgb = visibility.face.iter().enumerate().map(color).collect();
        DepthPicture { camera: *camera, depth: visibility.depth.clone(), rgb, weight: 1.0 }
    };
    cameras.iter().enumerate().map(&mut one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2};

    /// A camera at the origin before the plane `normal · p = distance`.
    fn before(normal: Vec3, distance: f32) -> DepthPicture {
        let camera = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::new(60.0, 55.0),
            center: Vec2::new(17.0, 15.0),
            size: UVec2::new(32, 30),
        };
        let ray = |x: u32, y: u32| {
            ((Vec2::new(x as f32, y as f32) + 0.5 - camera.center) / camera.focal).extend(1.0)
        };
        let depth = (0..30).flat_map(|y| (0..32).map(move |x| (x, y)));
        let depth: Vec<f32> = depth.map(|(x, y)| distance / normal.dot(ray(x, y))).collect();
        DepthPicture { camera, rgb: vec![[9; 3]; depth.len()], depth, weight: 1.0 }
    }

    #[test]
    fn distances_from_a_plane_are_exact() {
        let normal = Vec3::new(0.5, -0.3, 0.8).normalize();
        let picture = before(normal, 2.0);
        for point in
            [Vec3::new(0.1, 0.2, 2.0), Vec3::new(-0.2, 0.1, 2.5), Vec3::new(0.2, -0.2, 1.2)]
        {
            let observation = picture.observe(point, 1.0).unwrap();
            let got = (observation.depth - point.z) * observation.slant;
            let wants = 2.0 - normal.dot(point);
            assert!((got - wants).abs() < 1e-4, "{got} is not {wants}");
        }
    }

    #[test]
    fn a_crack_is_closed_and_outlines_and_thin_things_stay() {
        let whole = before(Vec3::new(0.3, 0.0, 0.9).normalize(), 3.0);
        let size = whole.camera.size;
        let changed = |change: &dyn Fn(usize, usize) -> Option<f32>| -> Vec<f32> {
            let at = |(i, depth): (usize, &f32)| change(i % 32, i / 32).unwrap_or(*depth);
            whole.depth.iter().enumerate().map(at).collect()
        };
        let cracked = changed(&|x, y| {
            ((9..12).contains(&x) || (x > 18 && x < 26 && y == x)).then_some([9.0, FREE][y % 2])
        });
        for (closed, wants) in close_cracks(&cracked, size).iter().zip(&whole.depth) {
            assert!((closed / wants - 1.0).abs() < 0.05, "{closed} is not {wants}");
        }
        for stays in [
            changed(&|x, _| (x >= 16).then_some(FREE)),
            changed(&|x, y| ((12..20).contains(&x) && (12..20).contains(&y)).then_some(9.0)),
            changed(&|x, _| (x == 7).then_some(1.0)),
            changed(&|x, _| (x != 7).then_some(UNKNOWN)),
        ] {
            let closed = close_cracks(&stays, size);
            let same = closed.iter().zip(&stays).filter(|(a, b)| a == b).count();
            assert!(same > stays.len() - 13, "{same} of {}: only corners are rounded", stays.len());
        }
    }

    #[test]
    fn a_pixel_shows_the_point_it_sees() {
        let picture = before(Vec3::Z, 3.0);
        let point = picture.point(32 * 7 + 20).unwrap();
        let observation = picture.observe(point, 1.0).unwrap();
        assert!(
            (observation.depth - 3.0).abs() < 1e-5 && observation.pixel == 32 * 7 + 20,
            "{observation:?}"
        );
        assert_eq!(picture.observe(-point, 1.0), None, "behind");
        assert_eq!(picture.observe(Vec3::new(9.0, 0.0, 1.0), 1.0), None, "beside");
    }

    #[test]
    fn nothing_is_made_up_between_near_and_far() {
        let mut picture = before(Vec3::Z, 3.0);
        for i in (0..picture.depth.len()).filter(|i| i % 32 >= 16) {
            picture.depth[i] = 9.0;
        }
        for x in [-0.1, -0.06, -0.05, -0.04, 0.0, 0.02] {
            let depth = picture.observe(Vec3::new(x, 0.0, 3.0), 1.0).unwrap().depth;
            assert!((depth - 3.0).abs() < 1e-5 || (depth - 9.0).abs() < 1e-5, "{depth} at {x}");
        }
        picture.depth.fill(UNKNOWN);
        assert_eq!(picture.observe(Vec3::Z, 1.0), None);
    }
}
