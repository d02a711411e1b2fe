//! A file of surface points: PLY, read by every viewer of point clouds and by data sets whose `transforms.json` names it.

use super::fuse::SurfacePoint;
use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use glam::DVec3;
use std::io::Write;

/// Writes the points; world = `origin` + position.
///
/// Errors: those of the operating system.
pub fn write(points: &[SurfacePoint], origin: DVec3, mut file: AtomicFile) -> Result<()> {
    // Single precision would lose the detail of scenes far away from zero.
    let is_far = origin != DVec3::ZERO;
    let mut bytes = header(points.len(), if is_far { "double" } else { "float" }).into_bytes();
    for point in points {
        let place = origin + point.position.as_dvec3();
        match is_far {
            true => place.to_array().iter().for_each(|c| bytes.extend(c.to_le_bytes())),
            false => point.position.to_array().iter().for_each(|c| bytes.extend(c.to_le_bytes())),
        }
        point.normal.to_array().iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend(point.rgb);
        bytes.extend(point.radius.to_le_bytes());
        bytes.extend(point.confidence.to_le_bytes());
    }
    file.write_all(&bytes).map_err(|e| Error::io(file.path(), e))?;
    file.commit().map(drop)
}

fn header(count: usize, place: &str) -> String {
    let mut text = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    ["x", "y", "z"].iter().for_each(|name| text += &format!("property {place} {name}\n"));
    ["nx", "ny", "nz"].iter().for_each(|name| text += &format!("property float {name}\n"));
    ["red", "green", "blue"].iter().for_each(|name| text += &format!("property uchar {name}\n"));
    text + "property float radius\nproperty float confidence\nend_header\n"
}
