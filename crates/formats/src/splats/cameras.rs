//! `cameras.json`: the cameras of the photos, as the trainers of 3DGS and OpenSplat write them, and
//! a check that they fit the Gaussians.
//!
//! ```text
//! [{"img_name", "width", "height", "position": eye, "rotation": rows of camera to world, "fx", "fy", "cx"?, "cy"?}]
//! ```
//! The principal point is the middle of the picture unless the file has one.

use glam::{DMat3, DVec2, DVec3, Mat3, UVec2, Vec3};
use serde::Deserialize;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::{Error, ImportedSplats, Limits, Result, Splats, input, parallel};

#[derive(Deserialize)]
struct Entry {
    img_name: String,
    width: u32,
    height: u32,
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    cx: Option<f64>,
    cy: Option<f64>,
}

/// Names and cameras of the photos in the list at `path`; `origin` is subtracted from their
/// positions.
///
/// # Errors
///
/// No such list; a camera that is none; pictures beyond the limits.
pub fn read_cameras(path: &Path, origin: DVec3, limits: &Limits) -> Result<Vec<(String, Camera)>> {
    let text = input::read_text(path, limits)?;
    let entries: Vec<Entry> = serde_json::from_str(&text).map_err(|e| {
        let reason = format!("{e}; expected a list of cameras as the trainer of 3DGS writes it");
        Error::malformed(path, "cameras", reason)
    })?;
    if entries.is_empty() {
        return Err(Error::malformed(path, "cameras", "there are none in the list"));
    }
    limits.nodes(path.display(), entries.len() as u64)?;
    entries
        .into_iter()
        .enumerate()
        .map(|(i, entry)| entry.camera(path, i, origin, limits))
        .collect()
}

/// The fault of numbers that are no camera.
pub(crate) const NO_CAMERA: &str =
    "is no camera: expected finite numbers, a rotation, focal lengths and a size above 0";

impl Entry {
    fn camera(
        self,
        path: &Path,
        i: usize,
        origin: DVec3,
        limits: &Limits,
    ) -> Result<(String, Camera)> {
        let to_world = DMat3::from_cols_array_2d(&self.rotation).transpose();
        let rotation = to_world.transpose();
        let size = UVec2::new(self.width, self.height);
        let middle = size.as_dvec2() / 2.0;
        let center = DVec2::new(self.cx.unwrap_or(middle.x), self.cy.unwrap_or(middle.y));
        let camera = Camera {
            rotation: rotation.as_mat3(),
            translation: -(rotation * (DVec3::from(self.position) - origin)).as_vec3(),
            focal: DVec2::new(self.fx, self.fy).as_vec2(),
            center: center.as_vec2(),
            size,
        };
        limits.camera(format!("{}: camera {i}", path.display()), size)?;
        let turns = (rotation * to_world).abs_diff_eq(DMat3::IDENTITY, 0.01)
            && rotation.determinant() > 0.0;
        if !turns || camera.validate(limits).is_err() {
            return Err(Error::malformed(path, format!("camera {i}"), NO_CAMERA));
        }
        Ok((self.img_name, camera))
    }
}

/// Adds the cameras of a list beside the file, turned to fit the Gaussians; a warning says so, or
/// why they are not used.
pub(crate) fn add_beside(path: &Path, loaded: &mut ImportedSplats, limits: &Limits) {
    let Some(list) = list_path(path) else { return };
    let origin = DVec3::from(loaded.provenance.placement.center);
    let rotated = read_cameras(&list, origin, limits).map(|mut cameras| {
        let turn = fitting_turn(&cameras, &loaded.splats, origin.as_vec3())?;
        if turn != Mat3::IDENTITY {
            for (_, camera) in &mut cameras {
                *camera = turned(camera, turn, origin.as_vec3());
            }
            let list = list.display();
            let axes = rotated_axes(turn);
            let warning = format!(
                "{list}: its cameras are of another frame; turned ({axes}), they fit the Gaussians"
            );
            loaded.warnings.push(warning);
        }
        Some(cameras)
    });
    let why = match rotated {
        Ok(Some(cameras)) => return loaded.cameras = cameras,
        Ok(None) => format!(
            "{}: they do not see what is dense in the file, however the axes are turned; they are of another scene or frame",
            list.display()
        ),
        Err(error) => error.to_string(),
    };
    loaded.warnings.push(format!("the cameras beside the file are not used: {why}"));
}

/// Path of the camera list: `NAME.cameras.json`, else `cameras.json` in its folder or the trainer's
/// output folder.
pub(crate) fn list_path(path: &Path) -> Option<PathBuf> {
    let folder = path.parent()?;
    let is_named = |folder: &Path, start: &str| {
        folder
            .file_name()
            .and_then(|name| name.to_str())
            .is_some_and(|name| name.starts_with(start))
    };
    let output = folder
        .parent()
        .filter(|above| is_named(folder, "iteration_") && is_named(above, "point_cloud"));
    let lists = [
        Some(path.with_extension("cameras.json")),
        Some(folder.join("cameras.json")),
        output.and_then(Path::parent).map(|output| output.join("cameras.json")),
    ];
    lists.into_iter().flatten().find(|list| list.is_file())
}

// ---- A check that cameras fit the Gaussians -----------------------------------------------------
//
// A trained Gaussian was in front of everything else in some photo. So most of them are, for
// cameras in their own frame, and fewer for turned ones: they look past dense regions, or from
// inside of them.

/// Minimum number of cameras that are checked: fewer may show any part of a scene.
const MIN_CAMERAS: usize = 8;
/// Maximum number of sampled cameras.
const MAX_CAMERAS: usize = 24;
/// Maximum number of sampled Gaussians.
const MAX_GAUSSIANS: usize = 1 << 13;
/// Cells along a side of a picture.
const CELLS: u32 = 32;
/// Maximum share of the light that one Gaussian absorbs in a cell.
const MAX_ABSORPTION: f32 = 0.9;
/// Minimum score of the cameras as stored, as a share of the best rotation's.
const MIN_STORED_SCORE: f32 = 0.9;
/// Maximum score of every other rotation, as a share of the best one's.
const MAX_SECOND_SCORE: f32 = 0.9;
/// Minimum share of the Gaussians that are in front for some camera.
const MIN_FRONT_SHARE: f32 = 0.5;

/// The turn of the axes that takes `cameras` into the frame of `splats`; `None` if none does.
fn fitting_turn(cameras: &[(String, Camera)], splats: &Splats, origin: Vec3) -> Option<Mat3> {
    if cameras.len() < MIN_CAMERAS {
        return Some(Mat3::IDENTITY);
    }
    let chosen: Vec<&Camera> =
        evenly_spaced(cameras.len(), MAX_CAMERAS).map(|i| &cameras[i].1).collect();
    let share = splats.len() as f32 / splats.len().min(MAX_GAUSSIANS) as f32;
    let sample = evenly_spaced(splats.len(), MAX_GAUSSIANS).map(|i| {
        let [x, y, z] = splats.scales[i].to_array();
        let area = TAU * (x * y).max(x * z).max(y * z) * splats.opacity[i];
        (splats.positions[i], area * share)
    });
    let sample = sample.collect::<Vec<_>>();
    let turns = turns();
    let scores = parallel::map(&turns, |_, turn| {
        let cameras: Vec<Camera> =
            chosen.iter().map(|camera| turned(camera, *turn, origin)).collect();
        visible_shares(&cameras, &sample)
    });
    let score = |i: usize| scores[i].0 * scores[i].1;
    let best = (0..turns.len()).max_by(|a, b| score(*a).total_cmp(&score(*b)).then(b.cmp(a)))?;
    if score(0) > 0.0 && score(0) >= MIN_STORED_SCORE * score(best) {
        return Some(turns[0]);
    }
    let is_unique =
        (0..turns.len()).all(|i| i == best || score(i) < MAX_SECOND_SCORE * score(best));
    (is_unique && scores[best].0 >= MIN_FRONT_SHARE).then_some(turns[best])
}

/// The share of the Gaussians, given by position and area, that are in front for some camera, and
/// the share of the pictures that they cover.
fn visible_shares(cameras: &[Camera], sample: &[(Vec3, f32)]) -> (f32, f32) {
    let mut front = vec![0.0f32; sample.len()];
    let mut covered = 0.0;
    for camera in cameras {
        let cell_px = camera.size.as_vec2() / CELLS as f32;
        let unit_area = camera.focal.element_product() / cell_px.element_product();
        let shown = sample.iter().enumerate().filter_map(|(i, (position, area))| {
            let (at, depth) = camera.project(*position)?;
            let cell = (at / cell_px).as_uvec2().min(UVec2::splat(CELLS - 1));
            Some((depth, i, (cell.y * CELLS + cell.x) as usize, area * unit_area / (depth * depth)))
        });
        let mut shown: Vec<_> = shown.collect();
        shown.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut light = [1.0f32; (CELLS * CELLS) as usize];
        for (_, i, cell, area) in shown {
            front[i] = front[i].max(light[cell]);
            light[cell] *= 1.0 - area.min(MAX_ABSORPTION);
        }
        covered += 1.0 - light.iter().sum::<f32>() / light.len() as f32;
    }
    (front.iter().sum::<f32>() / front.len() as f32, covered / cameras.len() as f32)
}

/// The camera in a world whose axes are turned; `origin` was subtracted from positions.
fn turned(camera: &Camera, turn: Mat3, origin: Vec3) -> Camera {
    let back = turn.transpose();
    let translation = camera.translation + camera.rotation * (back * origin - origin);
    Camera { rotation: camera.rotation * back, translation, ..*camera }
}

/// All 24 turns that take axes to axes; the first changes nothing.
fn turns() -> Vec<Mat3> {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let pairs = axes.iter().flat_map(|x| axes.iter().map(move |y| (*x, *y)));
    pairs
        .filter(|(x, y)| x.dot(*y) == 0.0)
        .map(|(x, y)| Mat3::from_cols(x, y, x.cross(y)))
        .collect()
}

/// The images of the axes x, y, z under a rotation: "x, -z, y".
fn rotated_axes(turn: Mat3) -> String {
    let name = |row: Vec3| {
        let axis = row.abs().max_position();
        format!("{}{}", if row[axis] < 0.0 { "-" } else { "" }, ["x", "y", "z"][axis])
    };
    [0, 1, 2].map(|i| name(turn.row(i))).join(", ")
}
