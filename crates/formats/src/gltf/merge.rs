//! Merges the primitives of all meshes into one mesh.

mod appearance;

use super::accessor::{self, Accessors};
use super::document::{DRACO, GltfDocument, MeshInstance, Primitive};
use super::material::GltfMaterial;
use super::skin::{self, JointTransforms};
use crate::finish::{is_far, origin_of, sampled};
use crate::format::GLTF_EXTENSION;
use crate::source::ReadOptions;
use glam::{DMat4, DVec3, Vec3};
use gltf_json::accessor::ComponentType;
use gltf_json::mesh::{TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES};
use std::collections::{BTreeMap, BTreeSet};
use trisplat_scene::atlas::PaintedFaces;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, FaceSh, Limits, Result};

/// Maximum number of warnings about one file.
const MAX_WARNINGS: usize = 100;
/// A mesh that grows by one primitive at a time.
pub(crate) struct MergedMesh<'a> {
    document: &'a GltfDocument,
    accessors: Accessors<'a>,
    /// The file says that every material's COLOR_0 is sRGB-encoded.
    srgb: bool,
    /// Its positions, indices, opacity, which is empty while every face is opaque, and sides.
    mesh: Mesh,
    /// One per face while `flat`, else one per vertex.
    colors: Vec<[f32; 3]>,
    /// No faces share vertices and each has one colour.
    flat: bool,
    /// Number of faces so far.
    pub(crate) faces: usize,
    clamped: usize,
    warnings: Vec<String>,
    limits: Limits,
    painted: Vec<PaintedFaces>,
    /// Spherical harmonics, and their first face.
    sh: Vec<(usize, FaceSh)>,
    /// The joints of skins, by number.
    joints: BTreeMap<usize, JointTransforms>,
    /// Extensions of the materials of its faces that are not read.
    unread: BTreeSet<&'a str>,
    /// Number of Gaussians in its meshes.
    splats: u64,
}

/// The faces of one primitive.
struct PrimitiveFaces {
    /// Vertex numbers of its faces within the primitive; none when they come in order.
    indices: Option<Vec<u32>>,
    /// First vertex in the merged mesh.
    base: usize,
    faces: usize,
}

impl<'a> MergedMesh<'a> {
    pub(crate) fn new(
        document: &'a GltfDocument,
        accessors: Accessors<'a>,
        srgb: bool,
        limits: Limits,
    ) -> Self {
        Self {
            document,
            accessors,
            srgb,
            mesh: Mesh::default(),
            colors: Vec::new(),
            flat: true,
            faces: 0,
            clamped: 0,
            warnings: Vec::new(),
            limits,
            painted: Vec::new(),
            sh: Vec::new(),
            joints: BTreeMap::new(),
            unread: BTreeSet::new(),
            splats: 0,
        }
    }

    fn malformed(&self, place: impl Into<String>, reason: impl Into<String>) -> Error {
        Error::malformed(self.accessors.buffers.path(), place, reason)
    }

    /// Adds a warning once, unless there are [`MAX_WARNINGS`].
    pub(crate) fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if self.warnings.len() < MAX_WARNINGS && !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Reads the joints of all skins; `origin` is subtracted from all positions.
    pub(crate) fn read_skins(&mut self, origin: DVec3) -> Result<()> {
        let limits = self.limits;
        for (number, joints) in
            skin::joints_of_skins(self.document, &mut self.accessors, origin, &limits)?
        {
            match joints {
                Ok(joints) => drop(self.joints.insert(number, joints)),
                Err(why) => self.warn(format!("a skin is not applied: {why}")),
            }
        }
        Ok(())
    }

    /// Reserves memory for all vertices, after checking that they exist and do not exceed the
    /// limit. Returns the origin to subtract from every position: zero, unless a node moves its
    /// mesh too far for f32.
    pub(crate) fn reserve(&mut self, instances: &[MeshInstance]) -> Result<DVec3> {
        let is_far = |transform: DMat4| is_far(transform.w_axis.truncate());
        let far = instances.iter().any(|instance| instance.transform.is_some_and(is_far));
        let mut meshes = Vec::new();
        let mut vertices = 0u64;
        for instance in instances {
            for primitive in self.primitives(instance)? {
                if let Some(position) = self.position(primitive)? {
                    let count = self.accessors.layout(position)?.count;
                    vertices = vertices.saturating_add(count);
                    if far {
                        meshes.push((instance.transform, position, count as usize));
                    }
                }
            }
        }
        let limits = self.limits;
        let path = self.accessors.buffers.path().to_owned();
        limits.triangles(path.display(), vertices / 3)?;
        limits.vertices(path.display(), vertices)?;
        self.accessors.buffers.spend(vertices.saturating_mul(24))?;
        limits.reserve(path.display(), &mut self.mesh.positions, vertices as usize)?;
        if !far {
            return Ok(DVec3::ZERO);
        }
        let mut sampled_vertices = sampled(vertices as usize).peekable();
        let mut sample = Vec::new();
        let mut first = 0;
        for (transform, position, count) in meshes {
            let transform = transform.unwrap_or(DMat4::IDENTITY);
            self.accessors.for_each(position, 0.0, |i, p| {
                if sampled_vertices.next_if_eq(&(first + i)).is_some() {
                    sample.push(transform.transform_point3(DVec3::from(p)));
                }
            })?;
            first += count;
        }
        Ok(origin_of(sample))
    }

    /// The accessor of a primitive's positions; none, with a warning, for a primitive without
    /// triangles.
    fn position(&mut self, primitive: &Primitive) -> Result<Option<usize>> {
        if !(TRIANGLES..=TRIANGLE_FAN).contains(&primitive.mode) {
            if !self.are_splats(primitive) {
                self.warn("points and lines are not read");
            }
            return Ok(None);
        }
        let Some(position) = primitive.attributes.position else {
            self.warn("primitives without POSITION are not read");
            return Ok(None);
        };
        // A file may also contain the plain data.
        let draco = primitive.extensions.contains_key(DRACO);
        if draco && self.accessors.accessor(position)?.buffer_view.is_none() {
            return Err(Error::unsupported(
                self.accessors.buffers.path(),
                "is compressed with Draco; open it in Blender and export it again without compression",
            ));
        }
        Ok(Some(position))
    }

    /// True for the Gaussians of a document that names their extension.
    fn are_splats(&self, primitive: &Primitive) -> bool {
        primitive.extensions.contains_key(GLTF_EXTENSION)
            && self.document.extensions_used.iter().any(|name| name == GLTF_EXTENSION)
    }

    fn check_limit(&self, triangles: u64) -> Result<()> {
        self.limits.triangles(self.accessors.buffers.path().display(), triangles)
    }

    fn primitives(&self, instance: &MeshInstance) -> Result<&'a [Primitive]> {
        let has = self.document.meshes.len();
        match self.document.meshes.get(instance.mesh) {
            Some(mesh) => Ok(&mesh.primitives),
            None => Err(self.malformed(
                format!("node {}", instance.node),
                format!("shows mesh {}, but the file has {has}", instance.mesh),
            )),
        }
    }

    /// Adds every triangle of a mesh, transformed by its node.
    pub(crate) fn add(&mut self, instance: &MeshInstance) -> Result<()> {
        for (i, primitive) in self.primitives(instance)?.iter().enumerate() {
            let place = format!("mesh {} primitive {i}", instance.mesh);
            if self.are_splats(primitive) {
                let position = primitive.attributes.position;
                let layout =
                    position.map(|position| self.accessors.layout(position)).transpose()?;
                self.splats += layout.map_or(0, |layout| layout.count);
            }
            let skin = self.document.nodes[instance.node].skin;
            self.add_primitive(primitive, &place, instance.transform, skin)?;
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        primitive: &Primitive,
        place: &str,
        transform: Option<DMat4>,
        skin: Option<usize>,
    ) -> Result<()> {
        let Some(position) = self.position(primitive)? else { return Ok(()) };
        if !primitive.targets.is_empty() {
            self.warn("morph targets are not applied");
        }
        let base = self.mesh.positions.len();
        let count = self.read_positions(position, place, transform)?;
        let transform = self.apply_skin(primitive, position, skin, base)?.or(transform);
        let mut part = self.read_faces(primitive, place, base, count)?;
        self.mesh
            .positions
            .truncate(base + if part.indices.is_some() { count } else { 3 * part.faces });
        let mirrored = transform.is_some_and(|t| t.determinant() < 0.0);
        if mirrored && let Some(indices) = &mut part.indices {
            reverse_winding(indices);
        }
        self.read_colors(primitive, place, &part, count)?;
        self.read_texture(primitive, place, &part, mirrored)?;
        self.read_sh(primitive, place, &part, transform)?;
        let is_double_sided =
            self.material(primitive, place)?.is_some_and(GltfMaterial::is_double_sided);
        self.push_sides(&part, is_double_sided);
        if mirrored && part.indices.is_none() {
            self.mirror(&part);
        }
        self.add_faces(part);
        Ok(())
    }

    /// Appends the transformed positions of an accessor; returns their number.
    fn read_positions(
        &mut self,
        accessor: usize,
        place: &str,
        transform: Option<DMat4>,
    ) -> Result<usize> {
        let layout = self.accessors.layout(accessor)?;
        if layout.width != 3 || layout.component == ComponentType::U32 {
            return Err(self.malformed(
                place,
                "has a POSITION that is not VEC3 of floats or 8 or 16-bit integers",
            ));
        }
        let base = self.mesh.positions.len();
        let count = layout.count as usize;
        self.mesh.positions.resize(base + count, Vec3::ZERO);
        let added = &mut self.mesh.positions[base..];
        self.accessors.for_each(accessor, 0.0, |i, p| {
            let p = DVec3::from(p);
            added[i] = transform.map_or(p, |t| t.transform_point3(p)).as_vec3();
        })?;
        Ok(count)
    }

    /// Moves the vertices of a primitive, from `base` on, with the joints of a skin. Returns the
    /// transform of one, none if there is no such skin.
    fn apply_skin(
        &mut self,
        primitive: &Primitive,
        position: usize,
        skin: Option<usize>,
        base: usize,
    ) -> Result<Option<DMat4>> {
        let Some(joints) = skin.and_then(|skin| self.joints.get(&skin)) else { return Ok(None) };
        let count = self.mesh.positions.len() - base;
        let attributes = &primitive.attributes;
        let transforms = skin::vertex_transforms(&mut self.accessors, attributes, joints, count)?;
        let Some(transforms) = transforms else {
            self.warn("a skin is not applied: its vertices name no joints of it");
            return Ok(None);
        };
        let moved = &mut self.mesh.positions[base..];
        self.accessors.for_each(position, 0.0, |i, p| {
            moved[i] = transforms[i].transform_point3(DVec3::from(p)).as_vec3();
        })?;
        Ok(transforms.first().copied())
    }

    /// The faces of a primitive of any mode, as lists of vertices.
    fn read_faces(
        &mut self,
        primitive: &Primitive,
        place: &str,
        base: usize,
        count: usize,
    ) -> Result<PrimitiveFaces> {
        let listed_indices = match primitive.indices {
            Some(accessor) => Some(self.read_indices(accessor, place, count)?),
            None if primitive.mode == TRIANGLES => None,
            None => Some((0..count as u32).collect()),
        };
        let indices = listed_indices.map(|list| match primitive.mode {
            TRIANGLE_STRIP => strip_faces(&list),
            TRIANGLE_FAN => fan_faces(&list),
            _ => list,
        });
        let corners = indices.as_ref().map_or(count, Vec::len);
        if corners % 3 != 0 {
            self.warn(format!(
                "{place} has {corners} corners, no multiple of 3: the last are not read"
            ));
        }
        let faces = corners / 3;
        self.check_limit((self.faces + faces) as u64)?;
        let indices = indices.map(|mut list| {
            list.truncate(3 * faces);
            list
        });
        Ok(PrimitiveFaces { indices, base, faces })
    }

    fn read_indices(&mut self, accessor: usize, place: &str, count: usize) -> Result<Vec<u32>> {
        let layout = self.accessors.layout(accessor)?;
        let unsigned =
            matches!(layout.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        if layout.width != 1 || !unsigned {
            return Err(self.malformed(place, "has indices that are not unsigned integers"));
        }
        self.check_limit(layout.count / 3)?;
        self.accessors.buffers.spend(4 * layout.count)?;
        let mut indices = vec![0; layout.count as usize];
        self.accessors.for_each(accessor, 0.0, |i, [index]| indices[i] = index as u32)?;
        match indices.iter().position(|&index| index as usize >= count) {
            Some(at) => Err(self.malformed(
                place,
                format!(
                    "names vertex {} in face {}, but has {count} vertices",
                    indices[at],
                    at / 3
                ),
            )),
            None => Ok(indices),
        }
    }

    /// Reverses the winding of a primitive's faces if its node mirrors it.
    fn mirror(&mut self, part: &PrimitiveFaces) {
        reverse_winding(&mut self.mesh.positions[part.base..]);
        if !self.flat {
            reverse_winding(&mut self.colors[part.base..]);
        }
    }

    fn add_faces(&mut self, part: PrimitiveFaces) {
        let base = part.base as u32;
        match part.indices {
            Some(indices) => {
                if self.mesh.indices.is_empty() && self.faces > 0 {
                    self.mesh.indices = (0..3 * self.faces as u32).collect();
                }
                self.mesh.indices.extend(indices.into_iter().map(|index| base + index));
            }
            None if !self.mesh.indices.is_empty() => {
                self.mesh.indices.extend(base..base + 3 * part.faces as u32)
            }
            None => {}
        }
        self.faces += part.faces;
        if !self.mesh.opacity.is_empty() {
            self.mesh.opacity.resize(self.faces, 1.0);
        }
    }

    /// The merged mesh and notes for the user.
    pub(crate) fn finish(mut self, options: &ReadOptions) -> Result<(Mesh, Vec<String>)> {
        if self.faces == 0 {
            let why = self.warnings.join("; ");
            let why = if why.is_empty() { why } else { format!(" ({why})") };
            return Err(Error::unsupported(
                self.accessors.buffers.path(),
                format!("holds no triangles in its scene{why}; export the mesh itself"),
            ));
        }
        if self.splats > 0 && !options.reads_splats_beside_mesh {
            let count = counted(self.splats, "Gaussian");
            let are = if self.splats == 1 { "is" } else { "are" };
            self.warn(format!(
                "{count} beside the mesh {are} left out; `trisplat bake` makes triangles of them too"
            ));
        }
        if !self.unread.is_empty() {
            let names: Vec<&str> = self.unread.iter().copied().collect();
            self.warn(format!(
                "extensions of materials are not read, surfaces look plainer: {}",
                names.join(", ")
            ));
        }
        if self.clamped > 0 {
            self.warn(format!("{} colours lay outside 0 to 1 and were clamped", self.clamped));
        }
        let mut mesh = self.mesh;
        if mesh.opacity.iter().all(|&o| o == 1.0) {
            mesh.opacity = Vec::new();
        }
        mesh.colors =
            if self.flat { Colors::Face(self.colors) } else { Colors::Vertex(self.colors) };
        let painted = accessor::paint(
            self.painted,
            &mut mesh,
            self.document,
            &mut self.accessors,
            &self.limits,
        );
        self.warnings.extend(painted);
        let faces = mesh.face_count();
        if let Some(sh) = FaceSh::of_ranges(self.sh, faces).filter(|_| mesh.texture.is_none()) {
            mesh = mesh.unshared();
            mesh.sh = Some(sh);
        }
        Ok((mesh, self.warnings))
    }
}

/// Reverse the winding of faces, of three values each.
fn reverse_winding<T>(corners: &mut [T]) {
    for face in corners.chunks_exact_mut(3) {
        face.swap(1, 2);
    }
}

/// Triangles of a strip; triangles with two equal corners only join its pieces.
fn strip_faces(strip: &[u32]) -> Vec<u32> {
    let faces = strip
        .windows(3)
        .enumerate()
        .map(|(i, v)| if i % 2 == 0 { [v[0], v[1], v[2]] } else { [v[0], v[2], v[1]] });
    faces.filter(|[a, b, c]| a != b && b != c && a != c).flatten().collect()
}

/// Triangles of a fan around its first vertex.
fn fan_faces(fan: &[u32]) -> Vec<u32> {
    let Some((&center, rim)) = fan.split_first() else { return Vec::new() };
    rim.windows(2).flat_map(|v| [v[0], v[1], center]).collect()
}
