//! Merges the primitives of all meshes into one mesh.

use super::accessor::{self, Accessors};
use super::document::{DRACO, GltfDocument, MeshInstance, Primitive};
use super::material::GltfMaterial;
use super::skin::{self, JointTransforms};
use crate::finish::{is_far, origin_of, sampled};
use crate::format::GLTF_EXTENSION;
use glam::{DMat3, DMat4, DVec3, Vec3};
use gltf_json::accessor::ComponentType;
use gltf_json::mesh::{TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES};
use std::collections::{BTreeMap, BTreeSet};
use trisplat_raster::kernel::sh::ShRotation;
use trisplat_scene::atlas::PaintedFaces;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, FaceSh, Limits, Result, parallel};

/// Materials to choose from for a primitive.
const VARIANTS: &str = "KHR_materials_variants";

/// Maximum number of warnings about one file.
const MAX_WARNINGS: usize = 100;
/// Cosine between the axes of a node from which it shears: rounded numbers stay below.
const MAX_SHEAR: f64 = 1e-4;

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

    /// Appends the colours of a primitive, one per face while all faces so far are flat.
    fn read_colors(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        count: usize,
    ) -> Result<()> {
        let default = GltfMaterial::default();
        let given = self.material(primitive, place)?;
        self.unread.extend(given.into_iter().flat_map(GltfMaterial::unread));
        let material = given.unwrap_or(&default);
        if let Some(extension) = material.transmission() {
            self.warn(format!("{extension} is not read: glass becomes opaque"));
        }
        if primitive.extensions.contains_key(VARIANTS) {
            self.warn(format!("{VARIANTS} is not read: meshes have their default materials"));
        }
        let paint = material.paint();
        let [factor @ .., alpha] = paint.factor;
        if paint.emits_more {
            self.warn("light that materials emit is not added to their base colour");
        }
        let Some(accessor) = primitive.attributes.color else {
            if paint.texture.is_none() {
                self.warn("a primitive has no COLOR_0: it gets the base colour of its material");
            }
            self.push_colors(vec![[1.0; 3]; count], part, false, factor);
            self.push_opacity(part, material, |_| alpha);
            return Ok(());
        };
        self.check_colors(accessor, place, count)?;
        let mut colors = vec![[0.0; 3]; count];
        if material.is_opaque() {
            self.accessors
                .for_each(accessor, 1.0, |i, c: [f64; 3]| colors[i] = c.map(|x| x as f32))?;
        } else {
            let mut alphas = vec![0.0; count];
            self.accessors.for_each(accessor, 1.0, |i, [r, g, b, a]| {
                colors[i] = [r, g, b].map(|x| x as f32);
                alphas[i] = a as f32;
            })?;
            let corner =
                |corner: usize| part.indices.as_ref().map_or(corner, |list| list[corner] as usize);
            let mean =
                |face: usize| (0..3).map(|j| alphas[corner(3 * face + j)]).sum::<f32>() / 3.0;
            self.push_opacity(part, material, |face| alpha * mean(face));
        }
        self.push_colors(colors, part, self.srgb || material.is_srgb(), factor);
        Ok(())
    }

    /// Texture coordinates of a primitive's faces, if textured.
    fn read_texture(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        mirrored: bool,
    ) -> Result<()> {
        let Some(material) = self.material(primitive, place)? else { return Ok(()) };
        let Some(info) = material.paint().texture else { return Ok(()) };
        if !material.is_opaque() {
            self.warn(format!(
                "{place}: the alpha of its picture is not read: its triangles are drawn whole"
            ));
        }
        // Coordinates of a list were reversed with its faces.
        let reversed = mirrored && part.indices.is_none();
        let corner = |corner: usize| match &part.indices {
            Some(list) => list[corner] as usize,
            None if reversed => 3 * (corner / 3) + [0, 2, 1][corner % 3],
            None => corner,
        };
        let faces = self.faces..self.faces + part.faces;
        let attributes = &primitive.attributes;
        match accessor::painted_faces(
            self.document,
            &mut self.accessors,
            info,
            attributes,
            faces,
            corner,
        )? {
            Ok(painted) => self.painted.push(painted),
            Err(why) => self.warn(format!("{}: {place}: {why}", accessor::UNREAD)),
        }
        Ok(())
    }

    /// Spherical harmonics of a primitive's faces, if its material has some.
    fn read_sh(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        transform: Option<DMat4>,
    ) -> Result<()> {
        let Some(material) = self.material(primitive, place)? else { return Ok(()) };
        let Some(sh) = material.sh() else { return Ok(()) };
        let Some(rotation) = transform.map_or(Some(DMat3::IDENTITY), rotation_of) else {
            self.warn("view-dependent colours are not read where a node shears its mesh");
            return Ok(());
        };
        let corner =
            |corner: usize| part.indices.as_ref().map_or(corner, |list| list[corner] as usize);
        let document = self.document;
        let limits = self.limits;
        let found = accessor::harmonics(
            document,
            &mut self.accessors,
            sh,
            &primitive.attributes,
            part.faces,
            corner,
            &limits,
        )?;
        match found {
            Ok(mut found) => {
                ShRotation::turn_harmonics(&mut found, rotation);
                self.sh.push((self.faces, found));
            }
            Err(why) => self.warn(format!("view-dependent colours are not read: {place}: {why}")),
        }
        Ok(())
    }

    /// The material of a primitive; `None` when it names none.
    fn material(&self, primitive: &Primitive, place: &str) -> Result<Option<&'a GltfMaterial>> {
        let materials = &self.document.materials;
        let Some(index) = primitive.material else { return Ok(None) };
        materials.get(index).map(Some).ok_or_else(|| {
            self.malformed(
                place,
                format!("has material {index}, but the file has {}", materials.len()),
            )
        })
    }

    /// Checks that an accessor holds a colour for each of `count` positions.
    fn check_colors(&mut self, accessor: usize, place: &str, count: usize) -> Result<()> {
        let layout = self.accessors.layout(accessor)?;
        if !layout.is_unit() || !(3..=4).contains(&layout.width) {
            return Err(self.malformed(
                place,
                "has a COLOR_0 that is not VEC3 or VEC4 of floats or normalised integers",
            ));
        }
        if layout.count != count as u64 {
            return Err(self
                .malformed(place, format!("has {count} positions and {} colours", layout.count)));
        }
        Ok(())
    }

    fn push_colors(
        &mut self,
        mut colors: Vec<[f32; 3]>,
        part: &PrimitiveFaces,
        srgb: bool,
        factor: [f32; 3],
    ) {
        let flat =
            part.indices.is_none() && colors.chunks_exact(3).all(|c| c[0] == c[1] && c[1] == c[2]);
        if !flat && self.flat {
            self.colors = self.colors.iter().flat_map(|&c| [c; 3]).collect();
            self.flat = false;
        }
        if self.flat {
            for face in 0..part.faces {
                colors[face] = colors[3 * face];
            }
            colors.truncate(part.faces);
        } else if part.indices.is_none() {
            colors.truncate(3 * part.faces);
        }
        let outside = |c: &[f32; 3]| !c.iter().all(|x| (0.0..=1.0).contains(x));
        let clamp = |c: &mut [f32; 3]| {
            let bad = outside(c);
            for (channel, factor) in c.iter_mut().zip(factor) {
                let light = unit(*channel);
                let light = if srgb { linear_from_srgb(light) } else { light };
                *channel = unit(light * factor);
            }
            usize::from(bad)
        };
        let parts = colors.chunks_mut(1 << 14);
        self.clamped += parallel::map(parts, |_, part| part.iter_mut().map(clamp).sum::<usize>())
            .iter()
            .sum::<usize>();
        self.colors.append(&mut colors);
    }

    /// Appends the opacity of a primitive's faces; the list stays empty while everything is opaque.
    fn push_opacity(
        &mut self,
        part: &PrimitiveFaces,
        material: &GltfMaterial,
        alpha: impl Fn(usize) -> f32,
    ) {
        if material.is_opaque() {
            return;
        }
        let cutoff = material.cutoff();
        self.mesh.opacity.resize(self.faces, 1.0);
        self.mesh.opacity.extend((0..part.faces).map(|face| {
            let alpha = unit(alpha(face));
            cutoff.map_or(alpha, |cutoff| f32::from(alpha >= cutoff))
        }));
    }

    /// Appends the sides of a primitive's faces; the list stays empty while everything is drawn
    /// from both.
    fn push_sides(&mut self, part: &PrimitiveFaces, is_double_sided: bool) {
        if is_double_sided && self.mesh.single_sided.is_empty() {
            return;
        }
        self.mesh.single_sided.resize(self.faces, false);
        self.mesh.single_sided.resize(self.faces + part.faces, !is_double_sided);
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
    pub(crate) fn finish(mut self) -> Result<(Mesh, Vec<String>)> {
        if self.faces == 0 {
            let why = self.warnings.join("; ");
            let why = if why.is_empty() { why } else { format!(" ({why})") };
            return Err(Error::unsupported(
                self.accessors.buffers.path(),
                format!("holds no triangles in its scene{why}; export the mesh itself"),
            ));
        }
        if self.splats > 0 {
            self.warn(format!(
                "{} beside the mesh: `trisplat bake` makes triangles of them too, other commands leave them out",
                counted(self.splats, "Gaussian")
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

/// The rotation or reflection of a node that scales, then turns; `None` of one that shears.
fn rotation_of(transform: DMat4) -> Option<DMat3> {
    let linear = DMat3::from_mat4(transform);
    let axes = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.try_normalize());
    let [Some(x), Some(y), Some(z)] = axes else { return None };
    let is_right = |a: DVec3, b: DVec3| a.dot(b).abs() < MAX_SHEAR;
    (is_right(x, y) && is_right(y, z) && is_right(z, x)).then(|| DMat3::from_cols(x, y, z))
}

/// The nearest number in [0, 1]; 0 for NaN.
fn unit(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
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
