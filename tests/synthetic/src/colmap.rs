//! A COLMAP model in text, written.

use glam::{DMat3, DQuat, DVec3, Vec2};
use std::collections::HashMap;
use std::path::Path;
use trisplat_dataset::{Distortion, Lens};
use trisplat_scene::{Error, Result};

/// A row of images.txt.
pub(crate) struct ImageRow {
    pub(crate) name: String,
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// Observed points and their image positions, px.
    pub(crate) observations: Vec<(u64, Vec2)>,
}

/// A row of points3D.txt.
pub(crate) struct PointRow {
    pub(crate) id: u64,
    pub(crate) position: DVec3,
    pub(crate) rgb: [u8; 3],
    pub(crate) error: f64,
}

/// Writes the three files of a model into `folder`; tracks are made from the observations.
pub(crate) fn write(
    folder: &Path,
    lens: &Lens,
    images: &[ImageRow],
    points: &[PointRow],
) -> Result<()> {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let [w, h] = lens.size.to_array();
    let [fx, fy] = lens.focal.to_array();
    let [cx, cy] = lens.center.to_array();
    cameras += &format!("1 PINHOLE {w} {h} {fx} {fy} {cx} {cy}\n");
    let mut rows = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    let mut tracks: HashMap<u64, String> = HashMap::new();
    for (index, image) in images.iter().enumerate() {
        let id = index + 1;
        let q = DQuat::from_mat3(&image.rotation);
        let t = image.translation;
        let name = &image.name;
        rows += &format!("{id} {} {} {} {} {} {} {} 1 {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
        let seen = |(k, (point, at)): (usize, &(u64, Vec2))| {
            *tracks.entry(*point).or_default() += &format!(" {id} {k}");
            format!("{} {} {point}", at.x, at.y)
        };
        rows += &image.observations.iter().enumerate().map(seen).collect::<Vec<_>>().join(" ");
        rows.push('\n');
    }
    let mut cloud =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    for PointRow { id, position: p, rgb: [r, g, b], error } in points {
        let track = tracks.get(id).map_or("", String::as_str);
        cloud += &format!("{id} {} {} {} {r} {g} {b} {error}{track}\n", p.x, p.y, p.z);
    }
    for (name, text) in [("cameras.txt", cameras), ("images.txt", rows), ("points3D.txt", cloud)] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| Error::io(&path, e))?;
    }
    Ok(())
}

/// The line of a camera in cameras.txt.
pub(crate) fn camera_line(model: &str, lens: &Lens) -> String {
    let [w, h] = lens.size.to_array();
    let [fx, fy] = lens.focal.to_array();
    let [cx, cy] = lens.center.to_array();
    let Distortion { radial: [k1, k2, k3, k4], tangential: [p1, p2], prism: [s1, s2], .. } =
        lens.distortion;
    let numbers = match model {
        "SPHERICAL" => vec![f64::from(w), f64::from(h)],
        "SIMPLE_RADIAL_FISHEYE" => vec![fx, cx, cy, k1],
        "RADIAL_FISHEYE" => vec![fx, cx, cy, k1, k2],
        "FISHEYE" => vec![fx, fy, cx, cy],
        "OPENCV_FISHEYE" => vec![fx, fy, cx, cy, k1, k2, k3, k4],
        _ => vec![fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, s1, s2],
    };
    let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
    format!("1 {model} {w} {h} {}\n", numbers.join(" "))
}

/// Empties every second line.
pub(crate) fn forget_observations(images: &Path) -> Result<()> {
    let text = std::fs::read_to_string(images).map_err(|e| Error::io(images, e))?;
    let poses: String = text.lines().skip(2).step_by(2).map(|line| format!("{line}\n\n")).collect();
    std::fs::write(images, poses).map_err(|e| Error::io(images, e))
}
