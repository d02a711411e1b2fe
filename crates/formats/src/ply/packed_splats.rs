//! PlayCanvas's compressed PLY: 16 bytes per Gaussian, relative to the ranges of its chunk of 256.

use super::column::Column;
use super::header::Header;
use super::splats::{rest_columns, rest_count};
use super::table::Table;
use super::tables;
use crate::splats::build::{sh0, unit, zeroed};
use crate::{ReadOptions, Source};
use glam::DVec3;
use std::f64::consts::SQRT_2;
use trisplat_scene::{Error, Result, Splats};

/// Gaussians that share their ranges.
const CHUNK: usize = 256;
/// Lower and upper ends of a chunk's ranges: positions, logarithms of scales, and in newer files colours.
const RANGES: [[&str; 2]; 9] = [
    ["min_x", "max_x"],
    ["min_y", "max_y"],
    ["min_z", "max_z"],
    ["min_scale_x", "max_scale_x"],
    ["min_scale_y", "max_scale_y"],
    ["min_scale_z", "max_scale_z"],
    ["min_r", "max_r"],
    ["min_g", "max_g"],
    ["min_b", "max_b"],
];

/// The ranges of a chunk.
type Ranges = [[f64; 2]; RANGES.len()];

/// The Gaussians.
pub(super) fn read(source: &Source, header: &Header, options: &ReadOptions) -> Result<Splats> {
    let path = &source.path;
    let missing = |name: &str| Error::malformed(path, "header", format!("has no element {name}"));
    let [chunks, vertices, sh] = tables::some(source, header, ["chunk", "vertex", "sh"], &options.limits)?;
    let (chunks, vertices) =
        (chunks.ok_or_else(|| missing("chunk"))?, vertices.ok_or_else(|| missing("vertex"))?);
    let count = vertices.rows();
    if chunks.rows() != count.div_ceil(CHUNK) {
        let reason = format!("{} chunks of {CHUNK} cannot hold exactly {count} Gaussians", chunks.rows());
        return Err(Error::malformed(path, "element chunk", reason));
    }
    let rest = header.element("sh").map_or(0, rest_count);
    let higher = sh.map(|table| rest_columns(source, &table, rest, options.sh_degree).map(|c| (table, c)));
    let higher = higher.transpose()?;
    let degree = higher.as_ref().map_or(0, |(_, (_, degree))| *degree);
    let mut splats = zeroed(path, count, degree, &options.limits)?;
    read_shapes(&vertices, &read_ranges(&chunks)?, &mut splats)?;
    if let Some((table, (columns, _))) = &higher {
        if table.rows() != count {
            let reason = format!("has {} rows for {count} Gaussians", table.rows());
            return Err(Error::malformed(path, "element sh", reason));
        }
        read_sh(table, columns, &mut splats)?;
    }
    Ok(splats)
}

fn read_ranges(chunks: &Table) -> Result<Vec<Ranges>> {
    let has_colors = chunks.find("min_r").is_some();
    let mut columns = Vec::new();
    for [low, high] in &RANGES[..if has_colors { RANGES.len() } else { 6 }] {
        columns.push([chunks.column(low)?, chunks.column(high)?]);
    }
    let mut out = Vec::new();
    each_row(chunks, |_, row| {
        let mut ranges = [[0.0, 1.0]; RANGES.len()];
        ranges.iter_mut().zip(&columns).for_each(|(range, c)| *range = c.map(|column| column.f64(row)));
        out.push(ranges);
    })?;
    Ok(out)
}

fn read_shapes(vertices: &Table, ranges: &[Ranges], splats: &mut Splats) -> Result<()> {
    let column = |name: &str| vertices.column(name);
    let [position, rotation, scale, color] = [
        column("packed_position")?,
        column("packed_rotation")?,
        column("packed_scale")?,
        column("packed_color")?,
    ];
    let k = splats.sh_count();
    each_row(vertices, |i, row| {
        let word = |column: Column| column.int(row) as u32;
        let ranges = &ranges[i / CHUNK];
        let between = |range: usize, t: f64| ranges[range][0] * (1.0 - t) + ranges[range][1] * t;
        let three = |first: usize, t: [f64; 3]| {
            DVec3::new(between(first, t[0]), between(first + 1, t[1]), between(first + 2, t[2]))
        };
        splats.positions[i] = three(0, unpack_11_10_11(word(position))).as_vec3();
        splats.scales[i] = three(3, unpack_11_10_11(word(scale))).exp().as_vec3();
        splats.rotations[i] = unit(unpack_rotation(word(rotation)));
        let color = word(color);
        let rgb = [24, 16, 8].map(|shift| share(color >> shift, 8));
        splats.sh[i * k] = three(6, rgb).to_array().map(sh0);
        splats.opacity[i] = share(color, 8) as f32;
    })
}

fn read_sh(table: &Table, columns: &[[Column; 3]], splats: &mut Splats) -> Result<()> {
    let k = splats.sh_count();
    each_row(table, |i, row| {
        for (columns, out) in columns.iter().zip(&mut splats.sh[i * k + 1..(i + 1) * k]) {
            *out = columns.map(|column| coefficient(column.int(row)));
        }
    })
}

/// A coefficient of a byte: 256 steps between -4 and 4, whose ends are exact.
fn coefficient(byte: i64) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        _ => (byte as f64 + 0.5) / 256.0,
    };
    ((share - 0.5) * 8.0) as f32
}

/// Calls `each` with the number and bytes of every row.
fn each_row(table: &Table, mut each: impl FnMut(usize, &[u8])) -> Result<()> {
    let (step, mut buffer) = (table.rows_per_block(), Vec::new());
    for first in (0..table.rows()).step_by(step) {
        let rows = table.block(first, step.min(table.rows() - first), &mut buffer)?;
        rows.chunks_exact(table.stride()).enumerate().for_each(|(i, row)| each(first + i, row));
    }
    Ok(())
}

/// The lowest bits as a share of their largest number.
fn share(word: u32, bits: u32) -> f64 {
    let most = (1 << bits) - 1;
    f64::from(word & most) / f64::from(most)
}

fn unpack_11_10_11(word: u32) -> [f64; 3] {
    [share(word >> 21, 11), share(word >> 11, 10), share(word, 11)]
}

/// w, x, y, z: three of them in 10 bits each, between ±√½; the largest, whose number has 2 bits, follows from them.
fn unpack_rotation(word: u32) -> [f64; 4] {
    let others = [20, 10, 0].map(|shift| (share(word >> shift, 10) - 0.5) * SQRT_2);
    let largest = (1.0 - others.iter().map(|x| x * x).sum::<f64>()).max(0.0).sqrt();
    let mut all = others.to_vec();
    all.insert((word >> 30) as usize, largest);
    [all[0], all[1], all[2], all[3]]
}
