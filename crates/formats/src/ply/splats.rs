//! Gaussians in a PLY, as the trainers of 3DGS, 2DGS and Mip-Splatting write them.

use super::column::Column;
use super::corners::{self, first_error, read_positions};
use super::header::{Element, Header};
use super::table::Table;
use super::tables;
use crate::splats::build::{unit, zeroed};
use crate::{ReadOptions, Source};
use glam::{DVec3, Quat, Vec3};
use trisplat_scene::parallel;
use trisplat_scene::{Error, Result, ScreenFilter, Splats};

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
