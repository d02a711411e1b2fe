//! Chunks of a scene for the file: vertices, bounds, grid and streams of each.

use super::document::MAX_SHORT_VERTICES;
use super::options::{GltfOptions, PositionEncoding};
use super::sh::ShLayout;
use glam::{DVec3, I64Vec3, U16Vec3, Vec2, Vec3};
use gltf_json::accessor::{ComponentType, Type};
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use trisplat_scene::math::geometry;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Asset, Chunk, Error, Result, parallel};

/// Name of the node, the mesh and the material of the backdrop.
pub(crate) const BACKDROP: &str = "backdrop";

/// End of the names of the material and of the node of faces that are drawn from their front only.
pub(crate) const FRONT: &str = "_front";

/// Purpose of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PartKind {
    /// The scene, or a chunk of it.
    Scene,
    /// A far sphere that is visible from inside.
    Backdrop,
    /// The collider, which engines do not draw.
    Collision,
}

/// A chunk of faces with its own vertices: one glTF mesh and node.
#[derive(Debug)]
pub(crate) struct ScenePart<'a> {
    pub(crate) name: String,
    pub(crate) kind: PartKind,
    /// The mesh of the faces.
    pub(crate) mesh: &'a Mesh,
    pub(crate) faces: Range<usize>,
    /// The page of the texture that all of them are on.
    pub(crate) page: usize,
    /// True when all of them are drawn from their front only, false when all from both sides.
    pub(crate) single_sided: bool,
    pub(crate) vertices: PartVertices<'a>,
    /// True when faces share vertices and an index stream is written.
    pub(crate) indexed: bool,
    /// Normals of all vertices of the mesh, if faces share vertices and the material is lit.
    pub(crate) vertex_normals: Arc<Vec<Vec3>>,
    /// Texture coordinates of all vertices, if faces share vertices.
    pub(crate) vertex_uvs: Arc<Vec<Vec2>>,
    /// Places of its faces' spherical harmonics, if they have any.
    pub(crate) sh: Option<ShLayout>,
    /// True when normals are written.
    pub(crate) lit: bool,
    /// Lowest and highest corner of the box around its vertices.
    pub(crate) bounds: [Vec3; 2],
    /// The grid of 16-bit positions; none when positions are floats, for example because no grid is
    /// fine enough.
    pub(crate) grid: Option<PositionGrid>,
    pub(crate) loss: QuantizationLoss,
}

/// The vertices of a part, in order.
#[derive(Debug)]
pub(crate) enum PartVertices<'a> {
    /// Consecutive vertices.
    Run(Range<usize>),
    /// Vertices by their numbers in the mesh.
    Listed(Cow<'a, [u32]>),
}

/// One array of a part, in its own buffer view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stream {
    Positions,
    Normals,
    Colors,
    TexCoords,
    Indices,
}

impl PartVertices<'_> {
    /// Number of vertices.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Run(run) => run.len(),
            Self::Listed(ids) => ids.len(),
        }
    }
}

impl ScenePart<'_> {
    /// Its arrays, in file order.
    pub(crate) fn streams(&self) -> impl Iterator<Item = Stream> + use<> {
        let normals = self.lit.then_some(Stream::Normals);
        let sh = self.sh.map(|_| Stream::TexCoords);
        // A colour would be multiplied with the texture.
        let painted = match self.mesh.texture {
            Some(_) => Stream::TexCoords,
            None => Stream::Colors,
        };
        let painted = (self.kind != PartKind::Collision).then_some(painted);
        let indices = self.indexed.then_some(Stream::Indices);
        [Some(Stream::Positions), normals, painted, sh, indices].into_iter().flatten()
    }

    /// Number of elements of a stream.
    pub(crate) fn count(&self, stream: Stream) -> usize {
        match stream {
            Stream::Indices => 3 * self.faces.len(),
            _ => self.vertices.len(),
        }
    }

    /// The numbers of an element of a stream.
    pub(crate) fn kind(&self, stream: Stream, options: &GltfOptions) -> (ComponentType, Type) {
        match stream {
            Stream::Positions if self.grid.is_some() => (ComponentType::U16, Type::Vec3),
            Stream::Normals if self.grid.is_some() => (ComponentType::I8, Type::Vec3),
            Stream::Positions | Stream::Normals => (ComponentType::F32, Type::Vec3),
            Stream::Colors => (options.colors.component(), Type::Vec4),
            // 1/16 of a texel of the largest texture.
            Stream::TexCoords => (ComponentType::U16, Type::Vec2),
            Stream::Indices if self.has_short_indices() => (ComponentType::U16, Type::Scalar),
            Stream::Indices => (ComponentType::U32, Type::Scalar),
        }
    }

    /// Bytes of an element of a stream, padding included: vertices begin at multiples of 4.
    pub(crate) fn stride(&self, stream: Stream, options: &GltfOptions) -> u64 {
        let (component, shape) = self.kind(stream, options);
        let bytes = (component.size() * shape.multiplicity()) as u64;
        if stream == Stream::Indices { bytes } else { bytes.next_multiple_of(4) }
    }

    /// Bytes of a stream before compression.
    pub(crate) fn bytes(&self, stream: Stream, options: &GltfOptions) -> u64 {
        self.count(stream) as u64 * self.stride(stream, options)
    }

    /// True when every index fits 16 bits.
    pub(crate) fn has_short_indices(&self) -> bool {
        self.vertices.len() as u64 <= MAX_SHORT_VERTICES
    }

    /// Number of a vertex of the mesh within this part.
    pub(crate) fn local(&self, vertex: u32) -> usize {
        match &self.vertices {
            PartVertices::Run(run) => vertex as usize - run.start,
            PartVertices::Listed(ids) => ids.partition_point(|&id| id < vertex),
        }
    }
}

/// Cuts an asset into parts; faces that share vertices but not colours get separate vertices,
/// because glTF has no other way to draw a flat colour.
pub(crate) fn parts<'a>(
    path: &Path,
    asset: &'a Asset,
    sh: Option<ShLayout>,
    options: &GltfOptions,
) -> Result<Vec<ScenePart<'a>>> {
    let mesh = &asset.mesh;
    mesh.validate_shape()?;
    if mesh.face_count() == 0 {
        return Err(Error::unsupported(
            path,
            "there is no triangle to write, and a glTF mesh may not be empty; \
             give a scene with triangles or loosen the prune options",
        ));
    }
    let ranges = named_ranges(asset, &options.node_name)?;
    let lit = options.lit && !mesh.normals.is_empty();
    let vertex_uvs =
        mesh.texture.as_ref().and_then(|t| t.of_vertices(&mesh.indices, mesh.vertex_count()));
    let shared = !mesh.indices.is_empty()
        && match mesh.texture {
            // Faces that share corners may have different places on the texture there.
            Some(_) => vertex_uvs.is_some(),
            None => matches!(mesh.colors, Colors::Vertex(_)),
        };
    let vertex_uvs = Arc::new(vertex_uvs.unwrap_or_default());
    let vertex_normals = Arc::new(if lit && shared { mesh.vertex_normals() } else { Vec::new() });
    let make_part = |_, (kind, name, faces)| {
        let lit = lit && kind == PartKind::Scene;
        let part = part(name, mesh, faces, lit, shared, options)?;
        Ok(ScenePart {
            kind,
            vertex_normals: vertex_normals.clone(),
            vertex_uvs: vertex_uvs.clone(),
            sh: sh.filter(|_| kind == PartKind::Scene),
            ..part
        })
    };
    // Always returns the first of several errors, independent of threads.
    let of_mesh: Vec<Result<ScenePart<'_>>> = parallel::map(ranges, make_part);
    of_mesh.into_iter().chain(collision(asset, options)).collect()
}

/// The purpose, name and faces of every node; the collider has a mesh of its own.
fn named_ranges(asset: &Asset, node_name: &str) -> Result<Vec<(PartKind, String, Range<usize>)>> {
    let scene = asset.scene_faces();
    let ranges = face_ranges(&asset.chunks, asset.mesh.face_count(), scene)?;
    let ranges = of_one_material(ranges, &asset.mesh);
    let of_scene = ranges.iter().filter(|faces| faces.start < scene).count();
    let with_one_side = |faces: &&Range<usize>| asset.mesh.is_single_sided(faces.start);
    let fronts = ranges[..of_scene].iter().filter(with_one_side).count();
    let double_sided = of_scene - fronts;
    let named = |(i, faces): (usize, Range<usize>)| {
        let (kind, name) = if faces.start >= scene {
            (PartKind::Backdrop, backdrop_name(i - of_scene))
        } else if fronts > 1 || double_sided > 1 {
            (PartKind::Scene, format!("chunk_{i:04}"))
        } else if double_sided == 1 && with_one_side(&&faces) {
            (PartKind::Scene, format!("{node_name}{FRONT}"))
        } else {
            (PartKind::Scene, node_name.to_owned())
        };
        (kind, name, faces)
    };
    Ok(ranges.into_iter().enumerate().map(named).collect())
}

/// The name of a backdrop's node; it has several when its texture has several pages.
fn backdrop_name(number: usize) -> String {
    if number == 0 { BACKDROP.to_owned() } else { format!("{BACKDROP}_{number}") }
}

/// True for the name of a backdrop's node.
pub(crate) fn is_backdrop(name: &str) -> bool {
    let rest = name.strip_prefix(BACKDROP);
    rest.is_some_and(|rest| {
        rest.is_empty() || rest.strip_prefix('_').is_some_and(|n| n.parse::<u32>().is_ok())
    })
}

/// The ranges cut where the page of the texture or the number of sides changes: a primitive has one
/// material.
fn of_one_material(ranges: Vec<Range<usize>>, mesh: &Mesh) -> Vec<Range<usize>> {
    let has_pages = mesh.texture.as_ref().is_some_and(|texture| !texture.page_of.is_empty());
    if !has_pages && mesh.single_sided.is_empty() {
        return ranges;
    }
    let mut cut = Vec::with_capacity(ranges.len());
    for range in ranges {
        let mut first = range.start;
        for face in range.clone().skip(1) {
            if mesh.material(face) != mesh.material(face - 1) {
                cut.push(first..face);
                first = face;
            }
        }
        cut.push(first..range.end);
    }
    cut
}

/// Node names: scene, backdrop.
///
/// # Errors
///
/// Chunks that do not hold every face once.
pub(crate) fn node_names(asset: &Asset, node_name: &str) -> Result<[Vec<String>; 2]> {
    let named = named_ranges(asset, node_name)?;
    let names = |of: PartKind| {
        named.iter().filter(|(kind, ..)| *kind == of).map(|(_, name, _)| name.clone()).collect()
    };
    Ok([names(PartKind::Scene), names(PartKind::Backdrop)])
}

/// The collider, if it has a node.
fn collision<'a>(asset: &'a Asset, options: &GltfOptions) -> Option<Result<ScenePart<'a>>> {
    let name = options.collision_name.clone()?;
    let mesh = asset.collision.as_ref()?;
    let whole = || {
        mesh.validate_shape()?;
        let shared = !mesh.indices.is_empty();
        let part = part(name, mesh, 0..mesh.face_count(), false, shared, options)?;
        Ok(ScenePart { kind: PartKind::Collision, ..part })
    };
    (mesh.face_count() > 0).then(whole)
}

fn part<'a>(
    name: String,
    mesh: &'a Mesh,
    faces: Range<usize>,
    lit: bool,
    indexed: bool,
    options: &GltfOptions,
) -> Result<ScenePart<'a>> {
    let corners = 3 * faces.start..3 * faces.end;
    let vertices = if mesh.indices.is_empty() {
        PartVertices::Run(corners)
    } else if indexed {
        used_vertices(&mesh.indices[corners])
    } else {
        PartVertices::Listed(Cow::Borrowed(&mesh.indices[corners]))
    };
    let bounds = bounds(mesh, &vertices);
    if !bounds.iter().all(|corner| corner.is_finite()) {
        return Err(Error::invalid_data(format!(
            "the position of a vertex in {name} is not finite"
        )));
    }
    let mut part = ScenePart {
        name,
        kind: PartKind::Scene,
        mesh,
        page: mesh.material(faces.start).page,
        single_sided: mesh.is_single_sided(faces.start),
        faces,
        vertices,
        indexed,
        vertex_normals: Arc::default(),
        vertex_uvs: Arc::default(),
        sh: None,
        lit,
        bounds,
        grid: None,
        loss: QuantizationLoss::default(),
    };
    if options.positions == PositionEncoding::ChunkU16 {
        quantise(&mut part, mesh)?;
    }
    Ok(part)
}

fn quantise(part: &mut ScenePart, mesh: &Mesh) -> Result<()> {
    let [low, high] = part.bounds;
    let extent = high - low;
    if !extent.is_finite() {
        return Err(Error::invalid_data(format!(
            "the extent of {}, {extent}, is too large for f32; crop the scene or write f32 positions",
            part.name
        )));
    }
    // If steps differ between axes, an engine corrects normals by the scale of the node, and 8 bits
    // do not suffice.
    let grid = if part.lit { PositionGrid::even(low, high) } else { PositionGrid::new(low, high) };
    const BLOCK: usize = 1 << 14;
    let first = part.faces.start;
    let count = part.faces.len();
    let losses =
        parallel::ranges(count, BLOCK, |range| grid.loss(range.map(|at| mesh.corners(first + at))));
    let loss = losses.into_iter().fold(QuantizationLoss::default(), QuantizationLoss::and);
    let areas = parallel::collect(count, BLOCK, |at| mesh.area(first + at));
    let detail = median(areas, f64::total_cmp).unwrap_or(0.0).sqrt();
    if loss.is_allowed(part.faces.len(), detail) {
        part.grid = Some(grid);
        part.loss = loss;
    }
    Ok(())
}

/// The vertices that some faces use, each once, in the order of the mesh.
fn used_vertices<'a>(indices: &[u32]) -> PartVertices<'a> {
    let mut ids = indices.to_vec();
    ids.sort_unstable();
    ids.dedup();
    let whole_run = match (ids.first(), ids.last()) {
        (Some(&first), Some(&last)) if (last - first) as usize + 1 == ids.len() => {
            Some(first..last + 1)
        }
        _ => None,
    };
    match whole_run {
        Some(run) => PartVertices::Run(run.start as usize..run.end as usize),
        None => PartVertices::Listed(Cow::Owned(ids)),
    }
}

/// The box around these vertices; not finite when any of them is not.
fn bounds(mesh: &Mesh, vertices: &PartVertices) -> [Vec3; 2] {
    let positions = &mesh.positions;
    let finite = |p: Vec3| if p.is_finite() { p } else { Vec3::INFINITY };
    let bounds = parallel::ranges(vertices.len(), 1 << 16, |range| match vertices {
        PartVertices::Run(run) => {
            let run = &positions[run.start + range.start..run.start + range.end];
            geometry::bounds(run.iter().map(|position| finite(*position)))
        }
        PartVertices::Listed(ids) => {
            geometry::bounds(ids[range].iter().map(|id| finite(positions[*id as usize])))
        }
    });
    let bounds = geometry::bounds(bounds.into_iter().flatten().flatten()).unwrap_or_default();
    // -0.0 and 0.0 are equal, so the minimum could be either, depending on the order. Adding zero
    // makes both 0.0, and the file independent of the number of threads.
    bounds.map(|corner| corner + Vec3::ZERO)
}

/// The faces of each chunk that has any; the chunks must hold every face once and in order. Faces
/// from `scene` on are the backdrop, and no chunk holds faces of both.
fn face_ranges(chunks: &[Chunk], faces: usize, scene: usize) -> Result<Vec<Range<usize>>> {
    if chunks.is_empty() {
        return Ok([0..scene, scene..faces]
            .into_iter()
            .filter(|range| !range.is_empty())
            .collect());
    }
    let mut next = 0;
    for (i, chunk) in chunks.iter().enumerate() {
        if chunk.first as usize != next {
            return Err(Error::invalid_data(format!(
                "chunk {i} begins with face {}, but the chunk before it ends at face {next}",
                chunk.first
            )));
        }
        next += chunk.count as usize;
    }
    if next != faces {
        return Err(Error::invalid_data(format!(
            "the chunks have {next} faces together, but the mesh has {faces}"
        )));
    }
    let range = |c: &Chunk| c.first as usize..c.first as usize + c.count as usize;
    let across = |range: &Range<usize>| range.start < scene && scene < range.end;
    if let Some(chunk) = chunks.iter().map(range).position(|range| across(&range)) {
        return Err(Error::invalid_data(format!(
            "chunk {chunk} holds faces of both the scene and the backdrop"
        )));
    }
    Ok(chunks.iter().filter(|c| c.count > 0).map(range).collect())
}

/// Every stream of every part, in file order.
pub(crate) fn all_streams<'a, 'b>(
    parts: &'b [ScenePart<'a>],
) -> impl Iterator<Item = (&'b ScenePart<'a>, Stream)> {
    parts.iter().flat_map(|part| part.streams().map(move |stream| (part, stream)))
}

// ---- The 16-bit grid of one chunk, and its loss -------------------------------------------------

/// Number of steps of the grid along an axis: the largest code.
const STEPS: f64 = u16::MAX as f64;

/// From codes to positions: the scale and translation of a chunk's node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PositionGrid {
    /// File units per step.
    pub(crate) scale: Vec3,
    /// Position of code 0.
    pub(crate) origin: Vec3,
    /// Steps per file unit.
    density: DVec3,
}

/// Error that quantisation causes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct QuantizationLoss {
    /// Largest distance between a vertex and its place in an engine, in file units.
    pub(crate) worst: f32,
    /// Triangles with an area before and none after.
    pub(crate) collapsed: u64,
}

impl PositionGrid {
    /// The finest grid that covers the box from `min` to `max`; an axis without extent gets steps
    /// of 1.
    pub(crate) fn new(min: Vec3, max: Vec3) -> Self {
        let step = (max.as_dvec3() - min.as_dvec3()) / STEPS;
        // A step below the smallest normal number would be zero in an engine that flushes
        // denormals.
        let scale =
            step.to_array().map(|s| if s > 0.0 { (s as f32).max(f32::MIN_POSITIVE) } else { 1.0 });
        let scale = Vec3::from(scale);
        Self { scale, origin: min, density: scale.as_dvec3().recip() }
    }

    /// The finest grid with the same steps along all axes that covers the box from `min` to `max`.
    pub(crate) fn even(min: Vec3, max: Vec3) -> Self {
        Self::new(min, min + Vec3::splat((max - min).max_element()))
    }

    /// The code nearest to `position`.
    pub(crate) fn code(&self, position: Vec3) -> U16Vec3 {
        let steps = (position.as_dvec3() - self.origin.as_dvec3()) * self.density;
        // The cast truncates and saturates at 0..=65535; `round` would be a library call on plain
        // x86-64.
        (steps + 0.5).as_u16vec3()
    }

    /// The position of `code` in an engine's f32 arithmetic.
    pub(crate) fn position(&self, code: U16Vec3) -> Vec3 {
        self.scale * code.as_vec3() + self.origin
    }

    /// The loss of these triangles on the grid.
    pub(crate) fn loss(&self, triangles: impl Iterator<Item = [Vec3; 3]>) -> QuantizationLoss {
        let mut worst = 0.0f64;
        let mut collapsed = 0;
        for corners in triangles {
            let codes = corners.map(|p| self.code(p));
            for (p, code) in corners.into_iter().zip(codes) {
                worst = worst.max(p.as_dvec3().distance_squared(self.position(code).as_dvec3()));
            }
            collapsed += u64::from(is_flat(codes) && has_area(corners));
        }
        QuantizationLoss { worst: worst.sqrt() as f32, collapsed }
    }
}

impl QuantizationLoss {
    /// Maximum error of a grid, as a share of the median triangle's size (the root of its area).
    const MAX_ERROR_SHARE: f64 = 1.0 / 16.0;
    /// Minimum number of triangles per flattened one.
    const MIN_FACES_PER_COLLAPSED: u64 = 200;

    /// True when the loss is acceptable for a chunk of this many faces with the median size
    /// `detail`. If not, for example because one huge triangle stretches the grid, positions stay
    /// floats.
    pub(crate) fn is_allowed(&self, faces: usize, detail: f64) -> bool {
        f64::from(self.worst) <= Self::MAX_ERROR_SHARE * detail
            && self.collapsed * Self::MIN_FACES_PER_COLLAPSED <= faces as u64
    }

    /// The combined loss of two sets of triangles.
    pub(crate) fn and(self, other: QuantizationLoss) -> QuantizationLoss {
        QuantizationLoss {
            worst: self.worst.max(other.worst),
            collapsed: self.collapsed + other.collapsed,
        }
    }
}

fn is_flat(codes: [U16Vec3; 3]) -> bool {
    let [a, b, c] = codes.map(|code| code.as_i64vec3());
    (b - a).cross(c - a) == I64Vec3::ZERO
}

fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(min: [f32; 3], max: [f32; 3]) -> PositionGrid {
        PositionGrid::new(min.into(), max.into())
    }

    #[test]
    fn the_corners_of_the_box_get_the_first_and_last_code() {
        for (min, max) in [
            ([-1.0, 2.0, -3.0], [4.0, 2.5, 1e3]),
            ([1e30, -1e30, 0.0], [1.1e30, 1e30, f32::MIN_POSITIVE]),
            ([1000.0, 1000.0, 1000.0], [1000.0001, 1000.0002, 1000.0003]),
        ] {
            let grid = grid(min, max);
            assert_eq!(grid.code(min.into()), U16Vec3::ZERO);
            let last = grid.code(max.into());
            for axis in 0..3 {
                assert!(
                    last[axis] == u16::MAX || grid.scale[axis] == f32::MIN_POSITIVE,
                    "{min:?} {max:?}"
                );
            }
        }
    }

    #[test]
    fn an_axis_without_extent_is_exact() {
        let grid = grid([1.0, 7.5, 3.0], [2.0, 7.5, 4.0]);
        let p = Vec3::new(1.5, 7.5, 3.25);
        assert_eq!(grid.position(grid.code(p)).y, 7.5);
        assert!(grid.scale.is_finite() && grid.scale.min_element() > 0.0);
    }

    #[test]
    fn a_vertex_moves_at_most_half_a_step_and_a_rounding() {
        let grid = grid([-8.0, -8.0, -8.0], [8.0, 4.0, 2.0]);
        for i in 0..1000u32 {
            let t = |k: u32| (i.wrapping_mul(k) % 1009) as f32 / 1009.0;
            let p = Vec3::new(-8.0 + 16.0 * t(7), -8.0 + 12.0 * t(13), -8.0 + 10.0 * t(29));
            let error = (grid.position(grid.code(p)) - p).abs();
            assert!((error - grid.scale * 0.5).max_element() < 1e-6, "{p} {error}");
        }
    }

    #[test]
    fn only_triangles_that_had_an_area_can_lose_it() {
        let grid = grid([0.0; 3], [65535.0; 3]);
        let tiny =
            [Vec3::new(10.1, 10.0, 10.0), Vec3::new(10.2, 10.0, 10.0), Vec3::new(10.1, 10.2, 10.0)];
        let line = [Vec3::ZERO, Vec3::ONE, Vec3::splat(2.0)];
        let large = [Vec3::ZERO, Vec3::X * 9.0, Vec3::Y * 9.0];
        let loss = grid.loss([tiny, line, large].into_iter());
        assert_eq!(loss.collapsed, 1);
        assert!((loss.worst - (0.2f32).hypot(0.0)).abs() < 0.03, "{}", loss.worst);
    }
}
