//! The element `view` of a soup PLY: the cameras of the photos that a scene was trained on, after its faces.
//!
//! The name lets MeshLab skip it, which has a `camera` with other properties.

use super::column::Column;
use super::header::{Element, Header};
use super::table::Table;
use crate::blocks::write_blocks;
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::io::{self, Write};
use trisplat_scene::{Limits, Result, camera::Camera};

pub(super) const NAME: &str = "view";
/// R by rows, t, focal lengths and principal point; then the size, as integers.
const FLOATS: [&str; 16] =
    ["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22", "tx", "ty", "tz", "fx", "fy", "cx", "cy"];
const WHOLE: [&str; 2] = ["width", "height"];

/// The element, if it exists with all properties of a camera.
pub(super) fn element(header: &Header) -> Option<&Element> {
    header.element(NAME).filter(|e| FLOATS.iter().chain(&WHOLE).all(|p| e.has(p)))
}

/// The element's lines in the header; none without cameras.
pub(super) fn header(cameras: &[Camera]) -> String {
    if cameras.is_empty() {
        return String::new();
    }
    let mut header = format!("element {NAME} {}\n", cameras.len());
    FLOATS.iter().for_each(|name| header += &format!("property float {name}\n"));
    WHOLE.iter().for_each(|name| header += &format!("property uint {name}\n"));
    header
}

/// Writes the rows.
pub(super) fn write(out: &mut dyn Write, cameras: &[Camera]) -> io::Result<()> {
    write_blocks(out, cameras.len(), |i, block| {
        let Camera { rotation, translation, focal, center, size } = cameras[i];
        let rows = rotation.transpose().to_cols_array();
        let rest = translation.to_array().into_iter().chain(focal.to_array()).chain(center.to_array());
        rows.into_iter().chain(rest).for_each(|x| block.extend_from_slice(&x.to_le_bytes()));
        size.to_array().into_iter().for_each(|n| block.extend_from_slice(&n.to_le_bytes()));
    })
}

/// The cameras. An error names the first row that is invalid, or whose pictures are too large.
pub(super) fn read(table: &Table, limits: &Limits) -> Result<Vec<Camera>> {
    let columns = |names: &[&str]| names.iter().map(|n| table.column(n)).collect::<Result<Vec<Column>>>();
    let (floats, whole) = (columns(&FLOATS)?, columns(&WHOLE)?);
    let (mut cameras, mut buffer) = (Vec::new(), Vec::new());
    let step = table.rows_per_block();
    for first in (0..table.rows()).step_by(step) {
        let rows = table.block(first, step.min(table.rows() - first), &mut buffer)?;
        for (i, row) in rows.chunks_exact(table.stride()).enumerate() {
            let mut x = [0.0; FLOATS.len()];
            x.iter_mut().zip(&floats).for_each(|(x, column)| *x = column.f32(row));
            let mut size = [0; WHOLE.len()];
            size.iter_mut().zip(&whole).for_each(|(n, c)| *n = u32::try_from(c.int(row)).unwrap_or(0));
            let [rotation @ .., tx, ty, tz, fx, fy, cx, cy] = x;
            let camera = Camera {
                rotation: Mat3::from_cols_array(&rotation).transpose(),
                translation: Vec3::new(tx, ty, tz),
                focal: Vec2::new(fx, fy),
                center: Vec2::new(cx, cy),
                size: UVec2::from(size),
            };
            limits.camera(table.place(first + i), camera.size)?;
            let turns = (camera.rotation.determinant() - 1.0).abs() < 0.01;
            if camera.validate(limits).is_err() || !turns {
                let wants =
                    "is no camera: expected finite numbers, a rotation, focal lengths and a size above 0";
                return Err(table.error(first + i, wants));
            }
            cameras.push(camera);
        }
    }
    Ok(cameras)
}
