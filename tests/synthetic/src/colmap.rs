//! A COLMAP model in text, written.

use glam::{DMat3, DQuat, DVec3, Vec2};
use std::collections::HashMap;
use std::path::Path;
use trisplat_dataset::Lens;
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
pub(crate) fn write(folder: &Path, lens: &Lens, images: &[ImageRow], points: &[PointRow]) -> Result<()> {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let ([w, h], [fx, fy], [cx, cy]) = (lens.size.to_array(), lens.focal.to_array(), lens.center.to_array());
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
