//! Gaussians in a PLY, as the trainers of 3DGS, 2DGS and Mip-Splatting write them.

use super::corners::{first_error, read_positions};
use super::header::{Column, Element, Header};
use super::table::Table;
use super::{corners, tables};
use crate::splats::{sh0, unit, zeroed};
use crate::{ReadOptions, Source};
use glam::{DVec3, Quat, Vec3};
use std::f64::consts::SQRT_2;
use trisplat_scene::{Error, Result, ScreenFilter, Splats, parallel};

/// Whether these vertices are Gaussians.
pub(super) fn are_in(vertices: &Element) -> bool {
    ["scale_0", "rot_0", "packed_position"].iter().any(|p| vertices.has(p))
}

/// The Gaussians, and the origin that was subtracted from their positions.
pub(super) fn read(source: &Source, header: &Header, options: &ReadOptions) -> Result<(Splats, DVec3)> {
    let vertices = tables::points(source, header, &options.limits)?;
    let rest = header.element("vertex").map_or(0, rest_count);
    let columns = Columns::of(source, &vertices, rest, options.sh_degree)?;
    let origin = corners::origin(&vertices)?;
    let mut splats = zeroed(&source.path, vertices.rows(), columns.sh_degree, &options.limits)?;
    read_positions(&vertices, origin, &mut splats.positions)?;
    columns.read(&vertices, &mut splats)?;
    if columns.filter.is_some() {
        splats.filter = ScreenFilter::MIP;
    }
    Ok((splats, origin))
}

/// Number of coefficients above degree 0, of all three channels.
pub(super) fn rest_count(element: &Element) -> usize {
    element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count()
}

/// Red, green and blue of each coefficient above degree 0, at most up to a degree, and the degree. The file has all of red
/// first, then green, then blue.
pub(super) fn rest_columns(
    source: &Source,
    table: &Table,
    rest: usize,
    highest: u8,
) -> Result<(Vec<[Column; 3]>, u8)> {
    let count = |degree: u8| (usize::from(degree) + 1).pow(2) - 1;
    let Some(degree) = (0..=3u8).find(|d| 3 * count(*d) == rest) else {
        let reason = format!("has {rest} properties f_rest_*; expected 0, 9, 24 or 45 (SH degree 0 to 3)");
        return Err(Error::malformed(&source.path, "header", reason));
    };
    let kept = degree.min(highest);
    let column = |channel: usize, k: usize| table.column(&format!("f_rest_{}", channel * count(degree) + k));
    let all = (0..count(kept)).map(|k| Ok([column(0, k)?, column(1, k)?, column(2, k)?]));
    Ok((all.collect::<Result<_>>()?, kept))
}

/// The places of a Gaussian's numbers in its row.
struct Columns {
    opacity: Column,
    /// Two for a disc (2DGS).
    scales: Vec<Column>,
    /// w, x, y, z.
    rotation: [Column; 4],
    /// The size of Mip-Splatting's filter in the world.
    filter: Option<Column>,
    /// Red, green and blue of each coefficient. `[K]`
    sh: Vec<[Column; 3]>,
    sh_degree: u8,
}

impl Columns {
    fn of(source: &Source, vertices: &Table, rest: usize, highest: u8) -> Result<Self> {
        let column = |name: &str| vertices.column(name);
        let (higher, sh_degree) = rest_columns(source, vertices, rest, highest)?;
        let mut sh = vec![[column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?]];
        sh.extend(higher);
        let mut scales = vec![column("scale_0")?, column("scale_1")?];
        scales.extend(vertices.find("scale_2"));
        Ok(Self {
            opacity: column("opacity")?,
            scales,
            rotation: [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?],
            filter: vertices.find("filter_3D"),
            sh,
            sh_degree,
        })
    }

    /// Fills in everything except the positions.
    fn read(&self, vertices: &Table, splats: &mut Splats) -> Result<()> {
        let (per_block, k) = (vertices.rows_per_block(), self.sh.len());
        let read = |buffer: &mut Vec<u8>, block: usize, (((scales, rotations), opacity), sh): Block| {
            let rows = vertices.block(block * per_block, opacity.len(), buffer)?;
            for (i, row) in rows.chunks_exact(vertices.stride()).enumerate() {
                (scales[i], rotations[i], opacity[i]) = self.shape(row);
                for (columns, out) in self.sh.iter().zip(&mut sh[i * k..(i + 1) * k]) {
                    *out = columns.map(|column| column.f32(row));
                }
            }
            Ok(())
        };
        let blocks = splats
            .scales
            .chunks_mut(per_block)
            .zip(splats.rotations.chunks_mut(per_block))
            .zip(splats.opacity.chunks_mut(per_block))
            .zip(splats.sh.chunks_mut(per_block * k));
        first_error(parallel::map_with(blocks, Vec::new, read))
    }

    /// Physical scales, rotation and opacity of one Gaussian; in f64 and rounded once.
    fn shape(&self, row: &[u8]) -> (Vec3, Quat, f32) {
        let mut scales = [0.0; 3];
        scales.iter_mut().zip(&self.scales).for_each(|(scale, column)| *scale = column.f64(row).exp());
        let mut opacity = 1.0 / (1.0 + (-self.opacity.f64(row)).exp());
        if let Some(filter) = self.filter {
            let variance = filter.f64(row).powi(2);
            let widened = scales.map(|scale: f64| (scale * scale + variance).sqrt());
            opacity *= scales.iter().zip(widened).map(|(scale, wide)| scale / wide).product::<f64>();
            scales = widened;
        }
        let rotation = unit(self.rotation.map(|column| column.f64(row)));
        (DVec3::from(scales).as_vec3(), rotation, opacity as f32)
    }
}

/// Scales, rotations, opacities and coefficients of the Gaussians of a block.
type Block<'a> = (((&'a mut [Vec3], &'a mut [Quat]), &'a mut [f32]), &'a mut [[f32; 3]]);

// ---- PlayCanvas's compressed PLY: 16 bytes per Gaussian, relative to the ranges of its chunk -----------

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
pub(super) fn read_packed(source: &Source, header: &Header, options: &ReadOptions) -> Result<Splats> {
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
