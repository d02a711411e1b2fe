//! Shares vertices where position and colour agree bit for bit, when that makes the file smaller.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Result, parallel};
use xxhash_rust::xxh3::xxh3_64;

/// When corners are shared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WeldWhen {
    /// When the file gets smaller
    Auto,
    /// Always
    On,
    /// Never
    Off,
}

/// Options of merging equal corners into one vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WeldOptions {
    /// When corners of equal position and colour become one vertex
    pub weld: WeldWhen,
}

impl WeldOptions {
    /// When it makes the file smaller.
    pub const DEFAULT: Self = Self { weld: WeldWhen::Auto };
    /// Does not try, because a trained soup never has shared corners.
    pub const FAST: Self = Self { weld: WeldWhen::Off };
}

trisplat_scene::default!(WeldOptions);

/// Measurements of corners.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WeldDetails {
    /// Share of distinct corners, in a sample when there are many; only when `weld` is auto.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unique_corners: Option<f64>,
}

trisplat_scene::stage!(WeldDetails, "weld");

/// Welds `mesh`. With any options, an engine can draw the result: it has no indices, or indices
/// with colours per vertex. A mesh whose faces share vertices already keeps its indices.
pub fn weld(
    mesh: &mut Mesh,
    options: &WeldOptions,
    details: &mut WeldDetails,
) -> Result<Outcome<()>> {
    if mesh.positions.is_empty() {
        return Ok(Outcome::Skipped("there are no corners"));
    }
    if mesh.texture.is_some() {
        return Ok(Outcome::Skipped("corners show different parts of the texture"));
    }
    if mesh.sh.is_some() {
        return Ok(Outcome::Skipped("each triangle has harmonics of its own"));
    }
    if !mesh.indices.is_empty() {
        if matches!(mesh.colors, Colors::Vertex(_)) {
            return Ok(Outcome::Skipped("faces share their vertices already"));
        }
        unweld(mesh);
        if !pays(mesh, options, details) {
            return Ok(Outcome::Changed(()));
        }
    } else if options.weld == WeldWhen::Off {
        return Ok(Outcome::Skipped("it was not asked for"));
    } else if !pays(mesh, options, details) {
        return Ok(Outcome::Skipped("too few corners agree in position and colour"));
    }
    share(mesh);
    Ok(Outcome::Changed(()))
}

/// Bytes of a vertex in a GLB: three f32 of position, four u16 of colour.
const VERTEX_BYTES: f64 = 20.0;
/// Bytes of an index in a GLB of more than 65,535 vertices.
const INDEX_BYTES: f64 = 4.0;
/// Up to this number all corners are counted; beyond it, only those whose hash starts with six zero
/// bits.
const SAMPLED_ABOVE: usize = 1 << 16;

/// True when `mesh`, which has no indices, gets smaller with them, or when welding was requested.
///
/// Counts the corners that hash to a 64th of all values: equal corners are all in the sample or all
/// outside it, so their share is unbiased and needs no welding.
fn pays(mesh: &Mesh, options: &WeldOptions, details: &mut WeldDetails) -> bool {
    match options.weld {
        WeldWhen::On => return true,
        WeldWhen::Off => return false,
        WeldWhen::Auto => {}
    }
    let corners = mesh.vertex_count();
    let shift = if corners > SAMPLED_ABOVE { 6 } else { 0 };
    let sampled = |i: usize| {
        let hash = hash(&key(mesh, i));
        (hash.checked_shr(64 - shift).unwrap_or(0) == 0).then_some(hash)
    };
    let mut sample = parallel::filter_map(corners, 1 << 14, sampled);
    let seen = sample.len();
    sample.par_sort_unstable();
    sample.dedup();
    let unique = if seen == 0 { 1.0 } else { sample.len() as f64 / seen as f64 };
    details.unique_corners = Some(unique);
    unique * VERTEX_BYTES + INDEX_BYTES < VERTEX_BYTES
}

/// Gives every face its own three vertices.
fn unweld(mesh: &mut Mesh) {
    let indices = std::mem::take(&mut mesh.indices);
    let positions = &mesh.positions;
    mesh.positions =
        parallel::collect(indices.len(), 1 << 13, |at| positions[indices[at] as usize]);
}

/// Makes equal corners of a mesh without indices one vertex; vertices come in the order of first
/// use.
fn share(mesh: &mut Mesh) {
    let corners = mesh.vertex_count();
    let slots = (2 * corners).next_power_of_two();
    let mut table = vec![u32::MAX; slots]; // vertex numbers, open addressing
    let mut first: Vec<u32> = Vec::new(); // the corner each vertex was first seen at // [V]
    let mut indices = Vec::with_capacity(corners);
    for corner in 0..corners {
        let wanted = key(mesh, corner);
        let mut slot = hash(&wanted) as usize & (slots - 1);
        while table[slot] != u32::MAX && key(mesh, first[table[slot] as usize] as usize) != wanted {
            slot = (slot + 1) & (slots - 1);
        }
        if table[slot] == u32::MAX {
            table[slot] = first.len() as u32;
            first.push(corner as u32);
        }
        indices.push(table[slot]);
    }
    let colors = first.iter().map(|&corner| corner_color(mesh, corner as usize)).collect();
    mesh.positions = first.iter().map(|&corner| mesh.positions[corner as usize]).collect();
    mesh.colors = Colors::Vertex(colors);
    mesh.indices = indices;
}

/// The bits of a corner's position and colour.
fn key(mesh: &Mesh, corner: usize) -> [u32; 6] {
    let [x, y, z] = mesh.positions[corner].to_array();
    let [r, g, b] = corner_color(mesh, corner);
    [x, y, z, r, g, b].map(f32::to_bits)
}

fn corner_color(mesh: &Mesh, corner: usize) -> [f32; 3] {
    match &mesh.colors {
        Colors::Face(colors) => colors[corner / 3],
        Colors::Vertex(colors) => colors[corner],
    }
}

fn hash(key: &[u32; 6]) -> u64 {
    xxh3_64(bytemuck::bytes_of(key))
}
