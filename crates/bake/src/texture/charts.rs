//! Charts: places of a connected mesh's faces on the texture. `uvunwrap` makes and packs them.
//!
//! First the mesh is unwrapped. Then its charts are packed once more, each with the number of
//! texels that its size in the photos asks for.

use super::atlas::Layout;
use super::options::TextureOptions;
use glam::{UVec2, Vec2, Vec3};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Error, Result};
use uvunwrap::{Density, MeshInput, Options, Packing};

/// Free texels around each chart: two more mip levels do not bleed.
const PADDING: u32 = 4;
/// Maximum distance of a texel from its face, texels, as samples between texels need.
const REACH: f32 = 1.5;
/// Density of charts that no photo sees, as a share of the mean one.
const UNSEEN_DENSITY: f32 = 0.1;
/// Width and height are multiples of this, so that mip levels are means of whole texels.
const STEP: u32 = 32;

/// Charts and the texture that holds them.
#[derive(Debug)]
pub(super) struct Charts {
    size: UVec2,
    /// Corners of faces, in texels from the middle of the first one. `[F]`
    corners: Vec<[Vec2; 3]>,
    /// The face that a texel belongs to, or [`NO_FACE`]. `[H * W]`
    owner: Vec<u32>,
    /// The requested density, or less where the texture would be too large.
    pub(super) texels_per_pixel: f64,
    /// Number of charts.
    pub(super) count: u64,
}

const NO_FACE: u32 = u32::MAX;

/// A chart of the first unwrapping, as it is packed again.
#[derive(Default)]
struct Chart {
    faces: Vec<u32>,
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    indices: Vec<u32>,
    scale: f32,
}

impl Charts {
    /// Unwraps `mesh`, whose edges have these lengths in photos, px. Its vertices are doubled where
    /// charts end. `[F]`
    ///
    /// # Errors
    ///
    /// A mesh that cannot be unwrapped onto a texture of the largest size.
    pub(super) fn new(
        mesh: &mut Mesh,
        edges: &[[f32; 3]],
        options: &TextureOptions,
    ) -> Result<Self> {
        let refused = |e: uvunwrap::Error| {
            let wants = format!("a texture on which the surface has room ({e})");
            Error::invalid("texture_size", options.texture_size, wants)
        };
        // In rows: packed by their shapes, thousands of charts need 2 to 9% less room, and most of
        // the time of a textured surface (docs/benchmarks/surface.md).
        let unwrap_options =
            Options { padding: PADDING, packing: Packing::Fast, ..Options::default() };
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(Vec3::to_array).collect();
        let whole = MeshInput::new(&positions, &mesh.indices);
        let unwrapped = uvunwrap::generate(&[whole], &unwrap_options);
        let charts = split_into_charts(mesh, &unwrapped.map_err(refused)?.meshes[0], edges);
        let inputs: Vec<MeshInput<'_>> = charts.iter().map(Chart::input).collect();
        let wanted = options.texels_per_pixel as f32;
        let fixed = Options {
            density: Density::Fixed { texels_per_unit: wanted, page_size: None },
            ..unwrap_options
        };
        let max_size = options.texture_size;
        let packed = match uvunwrap::generate(&inputs, &fixed) {
            Ok(packed) if packed.width.max(packed.height) <= max_size => packed,
            _ => {
                let fitting =
                    Options { density: Density::Auto { page_size: max_size }, ..unwrap_options };
                uvunwrap::generate(&inputs, &fitting).map_err(refused)?
            }
        };
        if packed.page_count > 1 {
            let wants = format!("a texture on which {} charts have room", charts.len());
            return Err(Error::invalid("texture_size", max_size, wants));
        }
        let used = UVec2::new(packed.width, packed.height);
        let size =
            used.map(|side| side.next_multiple_of(STEP)).min(UVec2::splat(max_size)).max(used);
        let corners = split(mesh, &charts, &packed.meshes, used.as_vec2());
        let texels_per_pixel = f64::from(packed.texels_per_unit);
        let count = packed.chart_count.into();
        Ok(Self { owner: owners(&corners, size), size, corners, texels_per_pixel, count })
    }
}

impl Chart {
    fn input(&self) -> MeshInput<'_> {
        MeshInput {
            scale: self.scale,
            existing_uvs: Some(&self.uvs),
            ..MeshInput::new(&self.positions, &self.indices)
        }
    }
}

/// The charts of an unwrapped mesh, each with the mean number of pixels per unit of its faces.
fn split_into_charts(
    mesh: &Mesh,
    unwrapped: &uvunwrap::OutputMesh,
    edges: &[[f32; 3]],
) -> Vec<Chart> {
    let mut charts: Vec<Chart> = Vec::new();
    // Faces without a chart, which have no area, are one more.
    let number = |face: usize| unwrapped.vertices[unwrapped.indices[3 * face] as usize].chart;
    let last = (0..mesh.face_count()).filter_map(number).max().map_or(0, |last| last as usize + 1);
    charts.resize_with(last + 1, Chart::default);
    let mut local = vec![(u32::MAX, 0u32); unwrapped.vertices.len()];
    let mut lengths = vec![(0.0f32, 0.0f32); charts.len()];
    for (face, edges) in edges.iter().enumerate() {
        let number = number(face).map_or(last, |number| number as usize);
        let chart = &mut charts[number];
        chart.faces.push(face as u32);
        for &vertex in &unwrapped.indices[3 * face..3 * face + 3] {
            let known = &mut local[vertex as usize];
            if known.0 != number as u32 {
                *known = (number as u32, chart.positions.len() as u32);
                let from = &unwrapped.vertices[vertex as usize];
                chart.positions.push(mesh.positions[from.xref as usize].to_array());
                chart.uvs.push(from.uv);
            }
            chart.indices.push(known.1);
        }
        let px: f32 = edges.iter().sum();
        if px > 0.0 {
            let [a, b, c] = mesh.corners(face);
            lengths[number].0 += px;
            lengths[number].1 += a.distance(b) + b.distance(c) + c.distance(a);
        }
    }
    let (px, units) = lengths.iter().fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
    let usual = if units > 0.0 { px / units } else { 1.0 };
    for (chart, (px, units)) in charts.iter_mut().zip(lengths) {
        chart.scale = if px > 0.0 && units > 0.0 { px / units } else { UNSEEN_DENSITY * usual };
    }
    charts.retain(|chart| !chart.faces.is_empty());
    charts
}

/// Gives `mesh` the vertices of its charts. Returns where the corners of its faces are, in texels
/// from the middle of the first one, on a texture of this size. `[F]`
fn split(
    mesh: &mut Mesh,
    charts: &[Chart],
    packed: &[uvunwrap::OutputMesh],
    size: Vec2,
) -> Vec<[Vec2; 3]> {
    let place = |vertex: &uvunwrap::OutputVertex| Vec2::from(vertex.uv) * size - 0.5;
    // Old vertices of the new ones, and where these are.
    let mut from: Vec<u32> = Vec::new();
    let mut at: Vec<Vec2> = Vec::new();
    let mut indices = vec![0u32; mesh.indices.len()];
    for (chart, packed) in charts.iter().zip(packed) {
        let first = at.len() as u32;
        at.extend(packed.vertices.iter().map(place));
        from.resize(at.len(), 0);
        for (i, &face) in chart.faces.iter().enumerate() {
            for k in 0..3 {
                let old = 3 * face as usize + k;
                let new = first + packed.indices[3 * i + k];
                from[new as usize] = mesh.indices[old];
                indices[old] = new;
            }
        }
    }
    mesh.positions = from.iter().map(|v| mesh.positions[*v as usize]).collect();
    if let Colors::Vertex(colors) = &mut mesh.colors {
        *colors = from.iter().map(|v| colors[*v as usize]).collect();
    }
    mesh.indices = indices;
    mesh.indices.as_chunks::<3>().0.iter().map(|face| face.map(|v| at[v as usize])).collect()
}

/// The face that is nearest to every texel, of those within [`REACH`] of it. `[H * W]`
fn owners(corners: &[[Vec2; 3]], size: UVec2) -> Vec<u32> {
    let mut owner = vec![NO_FACE; size.element_product() as usize];
    let mut distance = vec![REACH * REACH; owner.len()];
    let last = (size - 1).as_vec2();
    for (face, corners) in corners.iter().enumerate() {
        let [a, b, c] = *corners;
        let low = (a.min(b).min(c) - REACH).clamp(Vec2::ZERO, last).as_uvec2();
        let high = (a.max(b).max(c) + REACH).clamp(Vec2::ZERO, last).as_uvec2();
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let at = (y * size.x + x) as usize;
                let away = away(corners, UVec2::new(x, y).as_vec2());
                if away < distance[at] {
                    owner[at] = face as u32;
                    distance[at] = away;
                }
            }
        }
    }
    owner
}

/// Square of the distance of a point from a triangle; 0 within it.
fn away(corners: &[Vec2; 3], point: Vec2) -> f32 {
    let sides = [0, 1, 2].map(|k| {
        let from = corners[k];
        let to = corners[(k + 1) % 3];
        (to - from).perp_dot(point - from)
    });
    if sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0) {
        let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
        if area != 0.0 {
            return 0.0;
        }
    }
    let to_edge = |k: usize| {
        let from = corners[k];
        let along = corners[(k + 1) % 3] - corners[k];
        let share = ((point - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE))
            .clamp(0.0, 1.0);
        point.distance_squared(from + share * along)
    };
    to_edge(0).min(to_edge(1)).min(to_edge(2))
}

/// Weights of the corners at the point, those of points outside moved to the border.
fn weights(corners: &[Vec2; 3], point: Vec2) -> [f32; 3] {
    let [a, b, c] = *corners;
    let area = (b - a).perp_dot(c - a);
    let u = (point - a).perp_dot(c - a) / area;
    let v = (b - a).perp_dot(point - a) / area;
    let kept = [1.0 - u - v, u, v].map(|w| w.clamp(0.0, 1.0));
    let sum: f32 = kept.iter().sum();
    if sum > 0.0 && sum.is_finite() { kept.map(|w| w / sum) } else { [1.0 / 3.0; 3] }
}

impl Layout for Charts {
    fn size(&self) -> UVec2 {
        self.size
    }

    fn face_count(&self) -> usize {
        self.corners.len()
    }

    #[inline(always)]
    fn place(&self, face: usize, weights: &[f32; 3]) -> Vec2 {
        let [a, b, c] = self.corners[face];
        a * weights[0] + b * weights[1] + c * weights[2]
    }

    #[inline(always)]
    fn interpolated(&self, _: usize) -> UVec2 {
        UVec2::ONE
    }

    fn for_each_texel(&self, face: usize, visit: &mut dyn FnMut(UVec2, [f32; 3])) {
        let corners = &self.corners[face];
        let [a, b, c] = *corners;
        let last = (self.size - 1).as_vec2();
        let low = (a.min(b).min(c) - REACH).clamp(Vec2::ZERO, last).as_uvec2();
        let high = (a.max(b).max(c) + REACH).clamp(Vec2::ZERO, last).as_uvec2();
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                if self.owner[(y * self.size.x + x) as usize] == face as u32 {
                    let at = UVec2::new(x, y);
                    visit(at, weights(corners, at.as_vec2()));
                }
            }
        }
    }
}
