//! Gaussians in a PLY, as the trainers of 3DGS, 2DGS and Mip-Splatting write them.

use super::header::{Column, Element, PlyHeader};
use super::table::{self, PlyTable};
use crate::splats::{sh0, unit, with_largest, zeroed};
use crate::{ReadOptions, Source};
use glam::{DVec3, Quat, Vec3};
use std::f64::consts::SQRT_2;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Result, ScreenFilter, Splats};

/// True when these vertices are Gaussians.
pub(super) fn are_in(vertices: &Element) -> bool {
    ["scale_0", "rot_0", "packed_position"].iter().any(|p| vertices.has(p))
}

/// The Gaussians, and the origin that was subtracted from their positions. A warning names a
/// dialect other than the trainers'.
pub(super) fn read(
    source: &Source,
    header: &PlyHeader,
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<(Splats, DVec3)> {
    let vertices = table::points(source, header, &options.limits)?;
    let mut columns = SplatColumns::of(&vertices, options.sh_degree)?;
    let origin = vertices.origin()?;
    let mut splats = zeroed(&source.path, vertices.rows, columns.sh_degree, &options.limits)?;
    vertices.read_positions(origin, &mut splats.positions)?;
    columns.read(&vertices, &mut splats)?;
    columns.are_lengths = are_lengths(&splats);
    columns.are_shares = are_shares(&splats);
    let dialects = [
        (columns.are_lengths, "its scales are lengths, not logarithms"),
        (columns.are_shares, "its opacities are shares, not logits"),
    ];
    let dialects: Vec<&str> =
        dialects.into_iter().filter_map(|(is, text)| is.then_some(text)).collect();
    if !dialects.is_empty() {
        columns.read(&vertices, &mut splats)?;
        warnings.push(format!("{}: read as such; trainers write the others", dialects.join(", ")));
    }
    if columns.filter.is_some() {
        splats.filter = ScreenFilter::MIP;
    }
    Ok((splats, origin))
}

/// The places of a Gaussian's numbers in its row.
struct SplatColumns {
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
    /// The number that stands for full red, green and blue, where they stand in place of the first
    /// coefficient.
    full_color: Option<f64>,
    /// Scales are no logarithms.
    are_lengths: bool,
    /// Opacities are no logits.
    are_shares: bool,
}

impl SplatColumns {
    fn of(vertices: &PlyTable, highest: u8) -> Result<Self> {
        let (higher, sh_degree) = vertices.sh_columns(highest)?;
        let has_colors = vertices.find("f_dc_0").is_none() && vertices.find("red").is_some();
        let first =
            if has_colors { ["red", "green", "blue"] } else { ["f_dc_0", "f_dc_1", "f_dc_2"] };
        let mut sh = vec![vertices.columns(first)?];
        let full_color = has_colors.then(|| if sh[0][0].is_byte() { 255.0 } else { 1.0 });
        sh.extend(higher);
        // Balls have one.
        let names = if vertices.find("scale_1").is_some() {
            ["scale_0", "scale_1"]
        } else {
            ["scale_0"; 2]
        };
        let mut scales = vertices.columns(names)?.to_vec();
        scales.extend(
            vertices.find("scale_2").or(vertices.find("scale_0").filter(|_| names[0] == names[1])),
        );
        Ok(Self {
            opacity: vertices.column("opacity")?,
            scales,
            rotation: vertices.columns(["rot_0", "rot_1", "rot_2", "rot_3"])?,
            filter: vertices.find("filter_3D"),
            sh,
            sh_degree,
            full_color,
            are_lengths: false,
            are_shares: false,
        })
    }

    /// Fills in everything except the positions.
    fn read(&self, vertices: &PlyTable, splats: &mut Splats) -> Result<()> {
        let step = vertices.rows_per_block();
        let k = self.sh.len();
        let shapes = splats.scales.chunks_mut(step).zip(splats.rotations.chunks_mut(step));
        let colors = splats.opacity.chunks_mut(step).zip(splats.sh.chunks_mut(step * k));
        vertices.blocks(shapes.zip(colors), |_, rows, ((scales, rotations), (opacity, sh))| {
            for (i, row) in rows.enumerate() {
                (scales[i], rotations[i], opacity[i]) = self.shape(row);
                for (columns, out) in self.sh.iter().zip(&mut sh[i * k..]) {
                    *out = columns.map(|column| column.f32(row));
                }
                if let Some(full) = self.full_color {
                    sh[i * k] = self.sh[0].map(|column| sh0(column.f64(row) / full));
                }
            }
            Ok(())
        })?;
        Ok(())
    }

    /// Physical scales, rotation and opacity of one Gaussian; in f64 and rounded once.
    fn shape(&self, row: &[u8]) -> (Vec3, Quat, f32) {
        let mut scales = [0.0; 3];
        let length = |scale: f64| if self.are_lengths { scale } else { scale.exp() };
        for (scale, column) in scales.iter_mut().zip(&self.scales) {
            *scale = length(column.f64(row));
        }
        let opacity = self.opacity.f64(row);
        let mut opacity = if self.are_shares { opacity } else { 1.0 / (1.0 + (-opacity).exp()) };
        if let Some(filter) = self.filter {
            let variance = filter.f64(row).powi(2);
            let widened = scales.map(|scale: f64| (scale * scale + variance).sqrt());
            opacity *=
                scales.iter().zip(widened).map(|(scale, wide)| scale / wide).product::<f64>();
            scales = widened;
        }
        let rotation = unit(self.rotation.map(|column| column.f64(row)));
        (DVec3::from(scales).as_vec3(), rotation, opacity as f32)
    }
}

// ---- Dialects: some programs write the numbers that are drawn, lengths and shares ---------------

/// Minimum number of Gaussians from which a dialect is recognised.
const MIN_GAUSSIANS: usize = 16;
/// Maximum size of a Gaussian, in extents of the scene.
const MAX_SIZE: f64 = 1000.0;
/// Typical size of a Gaussian, as a share of the distance of neighbours.
const TYPICAL_SIZE: f64 = 0.35;
/// Share of the Gaussians along an axis that are outliers, on each side.
const OUTLIERS: f64 = 0.1;

/// True when opacities that were read as logits are shares already: all logits are from 0 to 1, and
/// not one number.
fn are_shares(splats: &Splats) -> bool {
    let highest = (1.0 / (1.0 + (-1.0f64).exp())) as f32;
    let all =
        splats.len() >= MIN_GAUSSIANS && splats.opacity.iter().all(|o| (0.5..=highest).contains(o));
    all && splats.opacity.iter().any(|o| *o != splats.opacity[0])
}

/// True when scales that were read as logarithms are lengths already: none is negative, and lengths
/// fit the distance of neighbours better.
fn are_lengths(splats: &Splats) -> bool {
    let all =
        splats.scales.iter().flat_map(|scales| scales.to_array()).filter(|scale| *scale != 0.0);
    if splats.len() < MIN_GAUSSIANS || all.clone().any(|scale| scale < 1.0) {
        return false;
    }
    let positions = |axis: usize| {
        let mut all: Vec<f32> =
            splats.positions.iter().map(|p| p[axis]).filter(|x| x.is_finite()).collect();
        all.sort_unstable_by(f32::total_cmp);
        let cut = (OUTLIERS * all.len() as f64) as usize;
        all.get(cut)
            .zip(all.get(all.len().saturating_sub(cut + 1)))
            .map_or(0.0, |(a, b)| f64::from(b - a))
    };
    let extent = DVec3::new(positions(0), positions(1), positions(2)).length();
    let typical = TYPICAL_SIZE * extent / (splats.len() as f64).sqrt();
    let largest = all.clone().fold(0.0, f32::max);
    let middle = median(all.collect(), f32::total_cmp);
    let middle = f64::from(middle.unwrap_or(1.0));
    let off = |size: f64| (size / typical).ln().abs();
    f64::from(largest) > MAX_SIZE * extent || off(middle.ln()) < off(middle)
}

// ---- PlayCanvas's compressed PLY: 16 bytes per Gaussian, relative to the ranges of its chunk

/// Gaussians that share their ranges.
const CHUNK: usize = 256;
/// Quantities with a range, from `min_x` to `max_x`: positions, logarithms of scales, and in newer
/// files colours.
const RANGES: [&str; 9] = ["x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"];

/// The ranges of a chunk.
type Ranges = [[f64; 2]; RANGES.len()];

/// The Gaussians.
pub(super) fn read_packed(
    source: &Source,
    header: &PlyHeader,
    options: &ReadOptions,
) -> Result<Splats> {
    let path = &source.path;
    let limits = &options.limits;
    let [chunks, vertices, sh] =
        table::open(source, header, ["chunk", "vertex", "sh"], false, limits)?;
    let chunks = table::required(chunks, source, "chunk")?;
    let vertices = table::required(vertices, source, "vertex")?;
    let count = vertices.rows;
    if chunks.rows != count.div_ceil(CHUNK) {
        let reason =
            format!("{} chunks of {CHUNK} cannot hold exactly {count} Gaussians", chunks.rows);
        return Err(Error::malformed(path, "element chunk", reason));
    }
    let (higher, degree) =
        sh.as_ref().map_or(Ok((Vec::new(), 0)), |table| table.sh_columns(options.sh_degree))?;
    let mut splats = zeroed(path, count, degree, limits)?;
    read_shapes(&vertices, &read_ranges(&chunks)?, &mut splats)?;
    if let Some(table) = &sh {
        if table.rows != count {
            let reason = format!("has {} rows for {count} Gaussians", table.rows);
            return Err(Error::malformed(path, "element sh", reason));
        }
        let k = splats.sh_count();
        table.each_row(|i, row| {
            for (columns, out) in higher.iter().zip(&mut splats.sh[i * k + 1..(i + 1) * k]) {
                *out = columns.map(|column| coefficient(column.int(row)));
            }
            Ok(())
        })?;
    }
    Ok(splats)
}

fn read_ranges(chunks: &PlyTable) -> Result<Vec<Ranges>> {
    let has_colors = chunks.find("min_r").is_some();
    let mut columns = Vec::new();
    for name in &RANGES[..if has_colors { RANGES.len() } else { 6 }] {
        columns
            .push([chunks.column(&format!("min_{name}"))?, chunks.column(&format!("max_{name}"))?]);
    }
    let mut out = Vec::new();
    chunks.each_row(|_, row| {
        let mut ranges = [[0.0, 1.0]; RANGES.len()];
        for (range, columns) in ranges.iter_mut().zip(&columns) {
            *range = columns.map(|column| column.f64(row));
        }
        out.push(ranges);
        Ok(())
    })?;
    Ok(out)
}

fn read_shapes(vertices: &PlyTable, ranges: &[Ranges], splats: &mut Splats) -> Result<()> {
    let [position, rotation, scale, color] =
        vertices.columns(["packed_position", "packed_rotation", "packed_scale", "packed_color"])?;
    let k = splats.sh_count();
    vertices.each_row(|i, row| {
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
        Ok(())
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

/// The lowest `bits` as a share of their largest number.
fn share(word: u32, bits: u32) -> f64 {
    let max = (1 << bits) - 1;
    f64::from(word & max) / f64::from(max)
}

fn unpack_11_10_11(word: u32) -> [f64; 3] {
    [share(word >> 21, 11), share(word >> 11, 10), share(word, 11)]
}

/// Smallest-three quaternion w, x, y, z: 2 bits for the index of the largest, 10 bits for each
/// other in ±√½.
fn unpack_rotation(word: u32) -> [f64; 4] {
    let others = [20, 10, 0].map(|shift| (share(word >> shift, 10) - 0.5) * SQRT_2);
    with_largest(others, (word >> 30) as u8)
}
