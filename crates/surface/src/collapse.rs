//! Fewer triangles for connected parts of a mesh: edges collapse by the quadric errors of
//! meshoptimizer. Colours and places on the texture count as errors too; their seams and the
//! borders of the surface stay where they are.
//!
//! In: a mesh of connected faces. Out: one of fewer faces with the same kinds of attributes. A
//! *wedge* is a vertex with the attributes of one side of a seam.

use crate::connected::first_with_key;
use glam::{Vec2, Vec3};
use meshopt::{SimplifyOptions, SimplifyVertex, VertexDataAdapter};
use trisplat_scene::FaceTexture;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::math::geometry::place_bits;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel;

/// Weight of a colour change: one from black to white counts as a move by this share of the
/// mesh's size.
pub(super) const COLOR_WEIGHT: f32 = 0.02;
/// Weight of a picture that slides over the surface, as a share of the same move of the surface.
const TEXTURE_WEIGHT: f32 = 0.5;
/// Maximum move of the surface, as a share of its size: what moves farther has lost its shape.
const MAX_ERROR: f32 = 0.25;

/// A mesh after edge collapses.
#[derive(Debug, Clone)]
pub struct Collapsed {
    /// The simplified mesh, with indices.
    pub mesh: Mesh,
    /// Estimated movement of its surface, units of the mesh.
    pub error: f64,
}

/// The simplification of a mesh of [connected faces](crate::connected_faces), to any number.
pub struct EdgeCollapse<'a> {
    mesh: &'a Mesh,
    wedges: Wedges,
}

impl<'a> EdgeCollapse<'a> {
    /// Finds the seams of `mesh`.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, wedges: Wedges::of(mesh) }
    }

    /// Simplifies the mesh to at most `most` faces. Where its topology permits no more collapses,
    /// the smallest faces go.
    pub fn to(&self, most: usize) -> Collapsed {
        let Self { mesh, wedges } = self;
        if mesh.face_count() <= most {
            return Collapsed { mesh: (*mesh).clone(), error: 0.0 };
        }
        let mut best = wedges.collapsed(most, SimplifyOptions::None);
        // Across seams of colours, never of a texture; then without the smallest pieces.
        for options in [SimplifyOptions::None, SimplifyOptions::Prune] {
            if best.faces.len() > most {
                let other = wedges.collapsed(most, SimplifyOptions::Permissive | options);
                if other.faces.len() < best.faces.len() {
                    best = other;
                }
            }
        }
        let CollapsedFaces { mut faces, error } = best;
        if faces.len() > most {
            let area = |face: &[u32; 3]| {
                let [a, b, c] = face.map(|wedge| wedges.positions[wedge as usize].as_dvec3());
                (b - a).cross(c - a).length()
            };
            faces.sort_by(|a, b| area(b).total_cmp(&area(a)));
            faces.truncate(most);
        }
        Collapsed { mesh: wedges.mesh(mesh, &faces), error }
    }
}

/// Positions as meshoptimizer reads them, and their extent, by which its errors are relative.
pub(super) fn vertex_data(positions: &[Vec3]) -> Option<(VertexDataAdapter<'_>, f32)> {
    let bytes = bytemuck::cast_slice(positions);
    let vertices = VertexDataAdapter::new(bytes, size_of::<Vec3>(), 0).ok()?;
    let scale = meshopt::simplify_scale(&vertices);
    Some((vertices, scale))
}

/// Faces after edge collapses.
struct CollapsedFaces {
    /// Wedges of their corners.
    faces: Vec<[u32; 3]>,
    /// Estimated movement of the surface, units of the mesh.
    error: f64,
}

/// The vertices of a mesh, with one set of attributes each.
struct Wedges {
    /// The first corner with these attributes. `[W]`
    corners: Vec<u32>,
    positions: Vec<Vec3>,
    /// Attributes whose change is an error: place on the texture or colour. `[W]`
    attributes: Vec<[f32; 3]>,
    weights: [f32; 3],
    /// Protection of seams that no collapse may cross. `[W]`
    locks: Vec<SimplifyVertex>,
    /// `[F * 3]`
    indices: Vec<u32>,
}

impl Wedges {
    fn of(mesh: &Mesh) -> Self {
        let count = 3 * mesh.face_count();
        let place = |corner: usize| mesh.corners(corner / 3)[corner % 3];
        let attributes = |corner: usize| match &mesh.texture {
            Some(texture) => {
                let uv = texture.uvs[corner / 3][corner % 3];
                [uv.x, uv.y, 0.0]
            }
            None => mesh.corner_colors(corner / 3)[corner % 3].map(srgb_from_linear),
        };
        // Attributes that no collapse may mix.
        let hard = |corner: usize| {
            let face = corner / 3;
            let material = mesh.material(face);
            let opacity = mesh.opacity.get(face).map_or(0, |opacity| opacity.to_bits());
            let uv = if mesh.texture.is_some() { attributes(corner) } else { [0.0; 3] };
            let sides = u32::from(material.single_sided);
            [material.page as u32, sides, opacity, uv[0].to_bits(), uv[1].to_bits()]
        };
        let at = |corner: usize| place_bits(place(corner));
        let bits = |corner: usize| attributes(corner).map(f32::to_bits);
        let first_here = first_with_key(count, at);
        let first_alike = first_with_key(count, |corner| (at(corner), hard(corner)));
        let first = first_with_key(count, |corner| (at(corner), hard(corner), bits(corner)));

        let mut is_seam = vec![false; count];
        for corner in 0..count {
            let here = first_here[corner] as usize;
            is_seam[here] |= first_alike[corner] != first_alike[here];
        }
        let corners: Vec<u32> =
            (0..count as u32).filter(|corner| first[*corner as usize] == *corner).collect();
        let mut numbers = vec![0; count];
        for (number, corner) in (0..).zip(&corners) {
            numbers[*corner as usize] = number;
        }
        let lock = |corner: &u32| {
            let is_seam = is_seam[first_here[*corner as usize] as usize];
            if is_seam { SimplifyVertex::Protect } else { SimplifyVertex::None }
        };
        // Without faces that are lines or points.
        let is_whole = |[a, b, c]: &[usize; 3]| {
            let [a, b, c] = [*a, *b, *c].map(|corner| first_here[corner]);
            a != b && b != c && c != a
        };
        let of_faces = (0..mesh.face_count()).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]);
        let whole = of_faces.filter(is_whole);
        let positions: Vec<Vec3> = corners.iter().map(|corner| place(*corner as usize)).collect();
        Self {
            attributes: corners.iter().map(|corner| attributes(*corner as usize)).collect(),
            locks: corners.iter().map(lock).collect(),
            weights: weights(mesh, &positions),
            indices: whole.flatten().map(|at| numbers[first[at] as usize]).collect(),
            positions,
            corners,
        }
    }

    /// Collapses edges down to `most` faces, or as far as the topology permits; to no fewer than
    /// one face.
    fn collapsed(&self, most: usize, options: SimplifyOptions) -> CollapsedFaces {
        let all = || CollapsedFaces { faces: self.indices.as_chunks().0.to_vec(), error: 0.0 };
        let Some((vertices, scale)) = vertex_data(&self.positions) else { return all() };
        let mut error = 0.0;
        let indices = meshopt::simplify_with_attributes_and_locks(
            &self.indices,
            &vertices,
            self.attributes.as_flattened(),
            &self.weights,
            3 * size_of::<f32>(),
            &self.locks,
            3 * most,
            MAX_ERROR,
            options,
            Some(&mut error),
        );
        if indices.is_empty() {
            return all();
        }
        let faces = indices.as_chunks().0.to_vec();
        CollapsedFaces { faces, error: f64::from(error * scale) }
    }

    /// The face of the source that a wedge was found at, and which of its corners.
    fn source(&self, wedge: u32) -> (usize, usize) {
        let corner = self.corners[wedge as usize] as usize;
        (corner / 3, corner % 3)
    }

    /// The mesh of `faces`, with the attributes that their corners had in `source`.
    fn mesh(&self, source: &Mesh, faces: &[[u32; 3]]) -> Mesh {
        let mut used: Vec<u32> = faces.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        let number = |wedge: &u32| used.partition_point(|other| other < wedge) as u32;
        let source_faces: Vec<u32> =
            faces.iter().map(|face| self.source(face[0]).0 as u32).collect();
        let texture = source.texture.as_ref().map(|texture| {
            let uv = |wedge: u32| {
                let (face, corner) = self.source(wedge);
                texture.uvs[face][corner]
            };
            let uvs = faces.iter().map(|face| face.map(uv)).collect();
            FaceTexture { uvs, ..texture.of_faces(&source_faces) }
        });
        let mut mesh = Mesh {
            positions: used.iter().map(|wedge| self.positions[*wedge as usize]).collect(),
            colors: self.colors(source, faces, &used, texture.as_ref()),
            indices: faces.as_flattened().iter().map(number).collect(),
            texture,
            ..Mesh::default()
        };
        if !source.opacity.is_empty() {
            mesh.opacity = source_faces.iter().map(|face| source.opacity[*face as usize]).collect();
        }
        if !source.single_sided.is_empty() {
            let is_single_sided = |face: &u32| source.is_single_sided(*face as usize);
            mesh.single_sided = source_faces.iter().map(is_single_sided).collect();
        }
        if !source.normals.is_empty() {
            mesh.normals = (0..faces.len()).map(|face| mesh.flat_normal(face)).collect();
        }
        mesh
    }

    /// Colours of the vertices `used` or of `faces`: means of the texture or of the corners.
    fn colors(
        &self,
        source: &Mesh,
        faces: &[[u32; 3]],
        used: &[u32],
        texture: Option<&FaceTexture>,
    ) -> Colors {
        let color = |wedge: u32| {
            let (face, corner) = self.source(wedge);
            source.corner_colors(face)[corner]
        };
        if matches!(source.colors, Colors::Vertex(_)) {
            return Colors::Vertex(used.iter().map(|wedge| color(*wedge)).collect());
        }
        Colors::Face(match texture {
            Some(texture) => parallel::collect(faces.len(), 1, |face| texture.mean(face)),
            None => faces.iter().map(|face| mean(face.map(color))).collect(),
        })
    }
}

/// Weights of the attributes of a mesh.
fn weights(mesh: &Mesh, positions: &[Vec3]) -> [f32; 3] {
    let Some(texture) = &mesh.texture else { return [COLOR_WEIGHT; 3] };
    let uv_area = |[a, b, c]: &[Vec2; 3]| f64::from((*b - *a).perp_dot(*c - *a).abs()) / 2.0;
    let of_texture: f64 = texture.uvs.iter().map(uv_area).sum();
    let of_surface: f64 = (0..mesh.face_count()).map(|face| mesh.area(face)).sum();
    let low = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    // One unit of a place on the texture is as long on the surface.
    let unit = (of_surface / of_texture).sqrt() as f32 / (high - low).max_element();
    let weight = if unit.is_finite() { TEXTURE_WEIGHT * unit } else { 0.0 };
    [weight, weight, 0.0]
}

/// The mean of three colours; of equal ones exactly that.
fn mean([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    if a == b && b == c {
        return a;
    }
    [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0)
}
