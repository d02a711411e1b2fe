//! `cameras.json`: the cameras of the photos that Gaussians were trained on, as the trainers of 3DGS and OpenSplat write them.
//!
//! ```text
//! [{"img_name", "width", "height", "position": eye, "rotation": rows of camera to world, "fx", "fy", "cx"?, "cy"?}]
//! ```
//! The principal point is the middle of the picture unless the file has one.

use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, ImportedSplats, Limits, Result, camera::Camera, input};

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

/// Names and cameras of the photos in the list at `path`; `origin` is subtracted from their positions.
///
/// Errors: no such list; a camera that is none; pictures beyond the limits.
pub fn read(path: &Path, origin: DVec3, limits: &Limits) -> Result<Vec<(String, Camera)>> {
    let text = input::read_text(path, limits)?;
    let entries: Vec<Entry> = serde_json::from_str(&text).map_err(|e| {
        let reason = format!("{e}; expected a list of cameras as the trainer of 3DGS writes it");
        Error::malformed(path, "cameras", reason)
    })?;
    if entries.is_empty() {
        return Err(Error::malformed(path, "cameras", "there are none in the list"));
    }
    limits.nodes(path.display(), entries.len() as u64)?;
    entries.into_iter().enumerate().map(|(i, entry)| entry.camera(path, i, origin, limits)).collect()
}

impl Entry {
    fn camera(self, path: &Path, i: usize, origin: DVec3, limits: &Limits) -> Result<(String, Camera)> {
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
        let turns = (rotation * to_world).abs_diff_eq(DMat3::IDENTITY, 0.01) && rotation.determinant() > 0.0;
        if !turns || camera.validate(limits).is_err() {
            let reason =
                "is no camera: expected finite numbers, a rotation, focal lengths and a size above 0";
            return Err(Error::malformed(path, format!("camera {i}"), reason));
        }
        Ok((self.img_name, camera))
    }
}

/// Adds the cameras of a list beside the file; a warning says why one is not used.
pub fn add_beside(path: &Path, loaded: &mut ImportedSplats, limits: &Limits) {
    let Some(list) = beside(path) else { return };
    match read(&list, DVec3::from(loaded.provenance.placement.center), limits) {
        Ok(cameras) => loaded.cameras = cameras,
        Err(error) => loaded.warnings.push(format!("the cameras beside the file are not used: {error}")),
    }
}

/// The list of a file's cameras: `NAME.cameras.json`, else `cameras.json` in its folder, or in that of the trainer's output.
pub fn beside(path: &Path) -> Option<PathBuf> {
    let folder = path.parent()?;
    let is_named = |folder: &Path, start: &str| {
        folder.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.starts_with(start))
    };
    let output =
        folder.parent().filter(|above| is_named(folder, "iteration_") && is_named(above, "point_cloud"));
    let lists = [
        Some(path.with_extension("cameras.json")),
        Some(folder.join("cameras.json")),
        output.and_then(Path::parent).map(|output| output.join("cameras.json")),
    ];
    lists.into_iter().flatten().find(|list| list.is_file())
}
