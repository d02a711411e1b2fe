//! A posed data set made from an analytic scene: exact images, known poses, points on the surfaces.
//!
//! It contains no camera's data, so it can be distributed, and every number in it can be checked.

mod colmap;
mod depth;
mod phone;
mod scene;
pub mod soups;
mod studio;

use colmap::{ImageRow, PointRow};
pub use phone::{PhoneTruth, PhotoTruth, TRUTH_FILE};
pub use scene::{Ray, SurfaceHit, trace, visible};

use glam::{DMat3, DVec2, DVec3, UVec2, Vec2};
use std::path::Path;
use trisplat_dataset::{Distortion, Lens};
use trisplat_scene::{
    Error, Result, Rng,
    camera::Camera,
    image::{Image, RgbImage},
    parallel,
};

/// What to make.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
#[command(next_help_heading = "Synthetic data set")]
pub struct SyntheticOptions {
    /// Photos, on a spiral around the scene.
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub views: u32,
    /// Width of a photo, px; the height is three quarters of it.
    #[arg(long, value_name = "PX", default_value_t = 160, value_parser = clap::value_parser!(u32).range(4..=8192))]
    pub width: u32,
    /// Points of the sparse cloud.
    #[arg(long, value_name = "N", default_value_t = 1500, value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
    pub points: u32,
    /// Seed of the camera jitter and of the points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Show only the objects on the ground, in photos that are transparent around them.
    #[arg(long)]
    pub transparent: bool,
    /// Disturb the photos as a phone does: varying exposure and white balance, darker corners,
    /// noise, and poses half a pixel off. `truth.json` has the true values.
    #[arg(long, conflicts_with = "transparent")]
    pub phone: bool,
    /// Write depth maps as a phone measures them: half as wide, 1% of noise, with holes.
    #[arg(long)]
    pub depth: bool,
}

impl Default for SyntheticOptions {
    fn default() -> Self {
        Self {
            views: 40,
            width: 160,
            points: 1500,
            seed: 0,
            transparent: false,
            phone: false,
            depth: false,
        }
    }
}

/// Maximum number of photos in a point's track.
const LONGEST_TRACK: usize = 6;
/// Minimum photos of a point, as in real reconstructions.
const SHORTEST_TRACK: usize = 3;
/// Colour difference within a pixel that counts as an edge.
const EDGE: f64 = 0.1;
/// Standard deviation of a point's image positions, px.
const OBSERVATION_NOISE_PX: f64 = 0.25;

/// Writes the data set in COLMAP's layout: `images/view_0000.png`..., `sparse/0/*.txt`, and
/// `test.txt` with every 8th photo. Other files in `folder` are left alone.
pub fn write(folder: &Path, options: &SyntheticOptions) -> Result<()> {
    write_poses(folder, options)?;
    if options.depth {
        depth::write(folder, options)?;
    }
    let images = folder.join("images");
    std::fs::create_dir_all(&images).map_err(|e| Error::io(&images, e))?;
    (0..options.views).try_for_each(|index| {
        let camera = camera(options, index);
        let photo = match (options.transparent, options.phone) {
            (true, _) => render_things(&camera),
            (false, true) => {
                truth(options, index).take(options.seed, index, &render(&camera)).to_pixels()
            }
            (false, false) => render(&camera).to_pixels(),
        };
        photo.save_png(images.join(photo_name(index)))
    })
}

/// The phone's disturbance of photo `index`.
fn truth(options: &SyntheticOptions, index: u32) -> PhotoTruth {
    PhotoTruth::new(options.seed, index, options.views, photo_name(index), pose(options, index))
}

/// Writes all files of [`write()`] except the photos.
pub fn write_poses(folder: &Path, options: &SyntheticOptions) -> Result<()> {
    let sparse = folder.join("sparse/0");
    std::fs::create_dir_all(&sparse).map_err(|e| Error::io(&sparse, e))?;
    let (mut images, points) = model(options);
    if options.phone {
        for (index, image) in (0..).zip(&mut images) {
            let pose = (image.rotation, image.translation);
            let focal = lens(options).focal.x;
            (image.rotation, image.translation) = phone::found(options.seed, index, focal, pose);
        }
        phone::write(folder, (0..options.views).map(|index| truth(options, index)).collect())?;
    }
    colmap::write(&sparse, &lens(options), &images, &points)?;
    let held_out: String = (0..options.views).step_by(8).map(|i| photo_name(i) + "\n").collect();
    let list = folder.join("test.txt");
    std::fs::write(&list, held_out).map_err(|e| Error::io(&list, e))
}

fn photo_name(index: u32) -> String {
    format!("view_{index:04}.png")
}

/// The camera of photo `index`. The photos go up a spiral, so that neighbours in number are
/// neighbours in space; jitter keeps the poses from being regular.
pub fn camera(options: &SyntheticOptions, index: u32) -> Camera {
    let lens = lens(options);
    let (rotation, translation) = pose(options, index);
    Camera {
        rotation: rotation.as_mat3(),
        translation: translation.as_vec3(),
        focal: lens.focal.as_vec2(),
        center: lens.center.as_vec2(),
        size: lens.size,
    }
}

/// A camera's view, averaged over every pixel's square: 16 rays where the colour is smooth, 256 at
/// and beside edges.
pub fn render(camera: &Camera) -> Image {
    let rays = RayCamera::new(camera);
    let [width, height] = camera.size.to_array();
    let pixels = camera.size.element_product() as usize;
    let place = |i: usize| (i as u32 % width, i as u32 / width);
    let coarse: Vec<Average> = parallel::collect(pixels, 1, |i| {
        let (x, y) = place(i);
        rays.average(x, y, 4)
    });
    let smooth_around = |x: u32, y: u32| {
        let own = &coarse[(y * width + x) as usize];
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let mut around = rows
            .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        around.all(|i| coarse[i as usize].smooth && coarse[i as usize].object == own.object)
    };
    let pixel = |i: usize| {
        let (x, y) = place(i);
        let own = &coarse[(y * width + x) as usize];
        let rgb = if smooth_around(x, y) { own.rgb } else { rays.average(x, y, 16).rgb };
        rgb.as_vec3().to_array()
    };
    Image { size: camera.size, pixels: parallel::collect(pixels, 1, pixel) }
}

/// A camera's view of only the objects: alpha is the share of 64 rays that hit one, and the colour
/// is the mean of these rays.
pub fn render_things(camera: &Camera) -> RgbImage {
    let rays = RayCamera::new(camera);
    let width = camera.size.x;
    let pixel = |i: usize| {
        let i = i as u32;
        let at = |k: u32| DVec2::new(f64::from(k % 8) + 0.5, f64::from(k / 8) + 0.5) / 8.0;
        let corner = DVec2::new(f64::from(i % width), f64::from(i / width));
        let hits = (0..64).filter_map(|k| rays.trace(corner + at(k)).filter(|hit| hit.thing));
        let (count, sum) = hits.fold((0u32, DVec3::ZERO), |(n, sum), hit| (n + 1, sum + hit.rgb));
        let rgb = (255.0 * sum / f64::from(count.max(1))).round().as_u8vec3().to_array();
        (rgb, (f64::from(count) * 255.0 / 64.0).round() as u8)
    };
    let pixels = parallel::collect(camera.size.element_product() as usize, 1, pixel);
    let (rgb, alpha) = pixels.into_iter().unzip();
    RgbImage { size: camera.size, rgb, alpha: Some(alpha) }
}

/// What a camera at the place of `camera` sees through `lens`, 16 rays a pixel; black where the
/// lens shows nothing.
pub fn render_lens(camera: &Camera, lens: &Lens) -> RgbImage {
    let rays = RayCamera::new(camera);
    let pixel = |i: usize| {
        let i = i as u32;
        let width = lens.size.x;
        let corner = DVec2::new(f64::from(i % width), f64::from(i / width));
        let at = |k: u32| (DVec2::new(f64::from(k % 4), f64::from(k / 4)) + 0.5) / 4.0;
        let ray = |k: u32| {
            let direction = rays.to_world * lens.ray(corner + at(k))?;
            trace(Ray { origin: rays.position, direction }).map(|hit| hit.rgb)
        };
        let sum: DVec3 = (0..16).filter_map(ray).sum();
        (sum * (255.0 / 16.0)).round().as_u8vec3().to_array()
    };
    RgbImage {
        size: lens.size,
        rgb: parallel::collect(lens.size.element_product() as usize, 1, pixel),
        alpha: None,
    }
}

/// [`write()`], with photos of `lens`, a camera model of COLMAP, that `draw` makes of a lens and a
/// pose.
pub fn write_lens(
    folder: &Path,
    options: &SyntheticOptions,
    model: &str,
    lens: &Lens,
    draw: &dyn Fn(&Lens, &Camera) -> RgbImage,
) -> Result<()> {
    write_poses(folder, options)?;
    let file = folder.join("sparse/0/cameras.txt");
    std::fs::write(&file, colmap::camera_line(model, lens)).map_err(|e| Error::io(&file, e))?;
    // Points and their places in photos are those of the pinhole.
    colmap::forget_observations(&folder.join("sparse/0/images.txt"))?;
    let images = folder.join("images");
    std::fs::create_dir_all(&images).map_err(|e| Error::io(&images, e))?;
    let photo =
        |index| draw(lens, &camera(options, index)).save_png(images.join(photo_name(index)));
    (0..options.views).try_for_each(photo)
}

/// What a pixel's rays saw.
struct Average {
    rgb: DVec3,
    /// All hit one object, in similar colours.
    smooth: bool,
    /// The hit of the first ray.
    object: Option<usize>,
}

/// A camera in f64 that traces rays.
struct RayCamera {
    to_world: DMat3,
    position: DVec3,
    focal: DVec2,
    center: DVec2,
}

impl RayCamera {
    fn new(camera: &Camera) -> Self {
        let rotation = camera.rotation.as_dmat3();
        Self {
            to_world: rotation.transpose(),
            position: -(rotation.transpose() * camera.translation.as_dvec3()),
            focal: camera.focal.as_dvec2(),
            center: camera.center.as_dvec2(),
        }
    }

    fn trace(&self, pixel: DVec2) -> Option<SurfaceHit> {
        let direction = self.to_world * ((pixel - self.center) / self.focal).extend(1.0);
        trace(Ray { origin: self.position, direction })
    }

    /// Mean colour of `grid`² rays through a pixel. The grid is sheared both ways, so that no two
    /// rays share a row or a column: an upright edge is then resolved to 1/grid² of a pixel, not to
    /// 1/grid.
    fn average(&self, x: u32, y: u32, grid: u32) -> Average {
        let mut sum = DVec3::ZERO;
        let mut low = DVec3::ONE;
        let mut high = DVec3::ZERO;
        let mut first = None;
        let mut one_object = true;
        for k in 0..grid * grid {
            let i = f64::from(k % grid);
            let j = f64::from(k / grid);
            let n = f64::from(grid);
            let offset = DVec2::new(i + (j + 0.5) / n, j + (i + 0.5) / n) / n;
            let hit = self.trace(DVec2::new(f64::from(x), f64::from(y)) + offset);
            let rgb = hit.map_or(DVec3::ZERO, |hit| hit.rgb);
            sum += rgb;
            low = low.min(rgb);
            high = high.max(rgb);
            let object = hit.map(|hit| hit.object);
            one_object &= *first.get_or_insert(object) == object;
        }
        let smooth = one_object && (high - low).max_element() < EDGE;
        Average { rgb: sum / f64::from(grid * grid), smooth, object: first.flatten() }
    }
}

/// One pinhole for all, its principal point off the middle as real ones are.
fn lens(options: &SyntheticOptions) -> Lens {
    let size = UVec2::new(options.width, options.width * 3 / 4);
    let width = f64::from(options.width);
    Lens {
        size,
        focal: DVec2::new(1.05, 1.045) * width,
        center: size.as_dvec2() * DVec2::new(0.512, 0.491),
        distortion: Distortion::default(),
    }
}

/// World to camera.
fn pose(options: &SyntheticOptions, index: u32) -> (DMat3, DVec3) {
    let rng = Rng::new(options.seed, "camera", u64::from(index));
    let jitter = |k: u64| 2.0 * rng.uniform_f64(k) - 1.0;
    let turn = f64::from(index) / f64::from(options.views);
    // Twice around, from low to high; half a step more, so that the second round looks between the
    // places of the first.
    let angle =
        std::f64::consts::TAU * (2.0 * turn + turn / f64::from(options.views)) + 0.06 * jitter(0);
    let height = 1.2 + 1.1 * turn + 0.08 * jitter(1);
    let radius = 4.3 - 0.7 * turn + 0.15 * jitter(2);
    let position = DVec3::new(radius * angle.cos(), -height, radius * angle.sin());
    let target = DVec3::new(0.1 * jitter(3), -0.55 + 0.08 * jitter(4), 0.1 + 0.1 * jitter(5));
    let forward = (target - position).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    (rotation, -(rotation * position))
}

/// Cameras, poses, points and the photos that show them.
fn model(options: &SyntheticOptions) -> (Vec<ImageRow>, Vec<PointRow>) {
    let lens = lens(options);
    let image = |index| {
        let (rotation, translation) = pose(options, index);
        ImageRow { name: photo_name(index), rotation, translation, observations: Vec::new() }
    };
    let mut images: Vec<ImageRow> = (0..options.views).map(image).collect();
    let tracks: Vec<Track> =
        parallel::map(0..options.points, |_, id| track(options, &lens, &images, id))
            .into_iter()
            .flatten()
            .collect();
    let mut points = Vec::with_capacity(tracks.len());
    for Track { point, observations } in tracks {
        for (image, place) in observations {
            images[image].observations.push((point.id, place));
        }
        points.push(point);
    }
    (images, points)
}

struct Track {
    point: PointRow,
    observations: Vec<(usize, Vec2)>,
}

/// A point that some photo shows, and the photos that show it. Attempts are repeated until enough
/// photos do.
fn track(options: &SyntheticOptions, lens: &Lens, images: &[ImageRow], id: u32) -> Option<Track> {
    let size = lens.size.as_dvec2();
    (0..64).find_map(|attempt| {
        let rng = Rng::new(options.seed, "point", u64::from(id) * 64 + attempt);
        let first = (rng.bits(0) % u64::from(options.views)) as usize;
        let pixel = DVec2::new(rng.uniform_f64(1), rng.uniform_f64(2)) * size;
        let rays = RayCamera::new(&camera(options, first as u32));
        // The sky fills much of every photo, but a reconstruction finds few points there.
        let wanted = |hit: &SurfaceHit| {
            if options.transparent { hit.thing } else { !hit.sky || rng.uniform(3) < 0.15 }
        };
        let hit = rays.trace(pixel).filter(wanted)?;
        let position = (hit.position * 1e6).round() / 1e6;
        let mut observations = Vec::new();
        let mut error = 0.0;
        // Neighbours first, on both sides: 0, 1, -1, 2, -2, ...
        for k in 0..images.len() {
            let aside = if k % 2 == 1 { k.div_ceil(2) } else { images.len() - k / 2 };
            let at = (first + aside) % images.len();
            let image = &images[at];
            if observations.len() == LONGEST_TRACK {
                break;
            }
            let v = image.rotation * position + image.translation;
            let place = lens.project(v.truncate() / v.z);
            let eye = -(image.rotation.transpose() * image.translation);
            let inside = v.z > 0.0 && place.cmpge(DVec2::ZERO).all() && place.cmplt(size).all();
            // Slightly towards the eye, so that rounding does not hide the point behind its own
            // surface.
            if inside && visible(position.lerp(eye, 1e-4), eye) {
                let noise = Rng::new(options.seed, "sighting", u64::from(id));
                let noise = |axis| f64::from(noise.normal(2 * at as u64 + axis));
                let off = OBSERVATION_NOISE_PX * DVec2::new(noise(0), noise(1));
                error += off.length();
                observations.push((at, ((place + off) * 100.0).round().as_vec2() / 100.0));
            }
        }
        let rgb = (hit.rgb * 255.0).round().as_u8vec3().to_array();
        let error = (error / observations.len() as f64 * 1e4).round() / 1e4;
        let point = PointRow { id: u64::from(id) + 1, position, rgb, error };
        (observations.len() >= SHORTEST_TRACK.min(images.len()))
            .then_some(Track { point, observations })
    })
}
