//! A mesh for engines: positions, linear colours, maybe indices.

use crate::error::{Error, Result};
use crate::face_sh::FaceSh;
use crate::kept_rows::KeptRows;
use crate::math::lists::{all_finite, all_in_unit, median};
use crate::parallel::{self, GRAIN};
use crate::report::Counts;
use crate::texture::FaceTexture;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Linear-light RGB per face or per vertex. Values in [0, 1]; alpha is always 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Colors {
    /// One colour per face. `[F]`
    Face(Vec<[f32; 3]>),
    /// One colour per vertex. `[V]`
    Vertex(Vec<[f32; 3]>),
}

/// Drawing state of a face beside its colours: faces with the same one share a draw call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct FaceMaterial {
    /// The page of the texture; 0 without one.
    pub page: usize,
    /// True for a face that is drawn from its front only.
    pub single_sided: bool,
}

/// A triangle mesh. Non-indexed when `indices` is empty: then face i owns vertices 3i, 3i+1, 3i+2.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Vertex positions. `[V]`
    pub positions: Vec<Vec3>,
    /// Linear-light colours.
    pub colors: Colors,
    /// Vertex indices, three per face; empty = non-indexed. `[F * 3]`
    pub indices: Vec<u32>,
    /// Opacity of every face in [0, 1]; empty = all opaque. `[F]`
    pub opacity: Vec<f32>,
    /// Unit normal of every face, for lighting; empty = unlit. `[F]`
    pub normals: Vec<Vec3>,
    /// True for faces of the shell of a trained scene, which is its backdrop; empty without a
    /// shell. `[F]`
    pub shell: Vec<bool>,
    /// True for faces that are drawn from their front only, where their corners run
    /// counter-clockwise; empty = all from both sides. `[F]`
    pub single_sided: Vec<bool>,
    /// The texture, which replaces the faces' colours; these are its means. Most meshes have none.
    pub texture: Option<FaceTexture>,
    /// View-dependent colours, of a mesh without indices. Most meshes have none.
    pub sh: Option<FaceSh>,
}

impl Default for Mesh {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            colors: Colors::Face(Vec::new()),
            indices: Vec::new(),
            opacity: Vec::new(),
            normals: Vec::new(),
            shell: Vec::new(),
            single_sided: Vec::new(),
            texture: None,
            sh: None,
        }
    }
}

impl Mesh {
    /// Opaque triangles, each of one colour in [0, 1]: linear light, not sRGB.
    ///
    /// # Errors
    ///
    /// Another number of colours than of triangles; numbers that are not finite or out of range.
    pub fn from_triangles(triangles: &[[Vec3; 3]], linear_rgb: &[[f32; 3]]) -> Result<Self> {
        let positions = triangles.as_flattened().to_vec();
        let colors = Colors::Face(linear_rgb.to_vec());
        let mesh = Self { positions, colors, ..Self::default() };
        mesh.validate()?;
        Ok(mesh)
    }

    /// Number of triangles.
    pub fn face_count(&self) -> usize {
        if self.indices.is_empty() { self.positions.len() / 3 } else { self.indices.len() / 3 }
    }

    /// Triangles and vertices, for reports.
    pub fn counts(&self) -> Counts {
        Counts { triangles: self.face_count() as u64, vertices: self.vertex_count() as u64 }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Vertex indices of a face.
    #[inline]
    pub fn face(&self, face: usize) -> [u32; 3] {
        if self.indices.is_empty() {
            let first = 3 * face as u32;
            [first, first + 1, first + 2]
        } else {
            [self.indices[3 * face], self.indices[3 * face + 1], self.indices[3 * face + 2]]
        }
    }

    /// Corner positions of a face.
    #[inline]
    pub fn corners(&self, face: usize) -> [Vec3; 3] {
        self.face(face).map(|v| self.positions[v as usize])
    }

    /// Middle of a face.
    pub fn centroid(&self, face: usize) -> Vec3 {
        (self.corners(face).iter().map(|v| v.as_dvec3()).sum::<DVec3>() / 3.0).as_vec3()
    }

    /// Area of a face.
    pub fn area(&self, face: usize) -> f64 {
        let [a, b, c] = self.corners(face).map(|v| v.as_dvec3());
        (b - a).cross(c - a).length() / 2.0
    }

    /// The size of the mesh's detail: the side of a square with the area of its median face.
    pub fn detail(&self) -> f64 {
        self.detail_of_first(self.face_count())
    }

    /// The same for only its first `faces` faces.
    pub(crate) fn detail_of_first(&self, faces: usize) -> f64 {
        let areas = (0..faces).map(|f| self.area(f)).collect();
        median(areas, f64::total_cmp).unwrap_or(0.0).sqrt()
    }

    /// True for a face of the shell, which belongs to the backdrop instead of the scene.
    pub fn is_shell(&self, face: usize) -> bool {
        self.shell.get(face).is_some_and(|shell| *shell)
    }

    /// True for a face that is drawn from its front only.
    #[inline]
    pub fn is_single_sided(&self, face: usize) -> bool {
        self.single_sided.get(face).is_some_and(|single| *single)
    }

    /// The material of a face: faces of one material can be drawn together.
    #[inline]
    pub fn material(&self, face: usize) -> FaceMaterial {
        let page = self.texture.as_ref().map_or(0, |texture| texture.page(face));
        FaceMaterial { page, single_sided: self.is_single_sided(face) }
    }

    /// Takes the faces of the shell out of the mesh, as a mesh of their own.
    pub fn take_shell(&mut self) -> Mesh {
        let flags = std::mem::take(&mut self.shell);
        let of_shell: Vec<u32> =
            (0..flags.len() as u32).filter(|face| flags[*face as usize]).collect();
        let shell = self.part(&of_shell);
        if !of_shell.is_empty() {
            self.retain(|face| !flags[face]);
        }
        shell
    }

    /// Linear colour of each corner of a face.
    pub fn corner_colors(&self, face: usize) -> [[f32; 3]; 3] {
        match &self.colors {
            Colors::Face(colors) => [colors[face]; 3],
            Colors::Vertex(colors) => self.face(face).map(|v| colors[v as usize]),
        }
    }

    /// Colours of the vertices of a mesh without indices, made from its faces' colours if
    /// necessary.
    pub fn vertex_colors(&mut self) -> &mut [[f32; 3]] {
        self.make_vertex_colors();
        match &mut self.colors {
            Colors::Face(colors) | Colors::Vertex(colors) => colors,
        }
    }

    /// The same triangles without shared vertices.
    pub fn unshared(self) -> Mesh {
        if self.indices.is_empty() {
            return self;
        }
        let corner = |v: &u32| self.positions[*v as usize];
        let positions = self.indices.iter().map(corner).collect();
        let colors = match self.colors {
            Colors::Vertex(colors) => {
                Colors::Vertex(self.indices.iter().map(|v| colors[*v as usize]).collect())
            }
            colors => colors,
        };
        Mesh { positions, colors, indices: Vec::new(), ..self }
    }

    /// Makes old face `faces[i]` the new face i. Shared vertices keep their order. `[F']`
    pub fn select(&mut self, faces: &[u32]) {
        if faces.is_empty() {
            // Vertices without indices would be read as triangles.
            return self.clear();
        }
        if self.indices.is_empty() {
            self.positions = gather_corners(&self.positions, faces);
        } else {
            self.indices = gather_corners(&self.indices, faces);
        }
        match &mut self.colors {
            Colors::Face(colors) => *colors = gather(colors, faces),
            Colors::Vertex(colors) if self.indices.is_empty() => {
                *colors = gather_corners(colors, faces)
            }
            Colors::Vertex(_) => {}
        }
        self.opacity = gather_if_present(&self.opacity, faces);
        self.normals = gather_if_present(&self.normals, faces);
        self.shell = gather_if_present(&self.shell, faces);
        self.single_sided = gather_if_present(&self.single_sided, faces);
        if let Some(texture) = &mut self.texture {
            *texture = texture.of_faces(faces);
        }
        if let Some(sh) = &mut self.sh {
            *sh = sh.of_faces(faces);
        }
    }

    /// Puts faces of one material next to each other, in their order.
    pub fn group_materials(&mut self) {
        let mut faces: Vec<u32> = (0..self.face_count() as u32).collect();
        if faces
            .windows(2)
            .any(|pair| self.material(pair[1] as usize) < self.material(pair[0] as usize))
        {
            faces.sort_by_key(|face| self.material(*face as usize));
            self.select(&faces);
        }
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        let colors = match self.colors {
            Colors::Face(_) => Colors::Face(Vec::new()),
            Colors::Vertex(_) => Colors::Vertex(Vec::new()),
        };
        *self = Self { colors, ..Self::default() };
    }

    /// Some of the faces as a mesh of their own, with the vertices that they use. `faces` ascend.
    /// `[F']`
    pub fn part(&self, faces: &[u32]) -> Mesh {
        let opacity = gather_if_present(&self.opacity, faces);
        let normals = gather_if_present(&self.normals, faces);
        let shell = gather_if_present(&self.shell, faces);
        let single_sided = gather_if_present(&self.single_sided, faces);
        let mut vertices: Vec<u32> =
            faces.iter().flat_map(|face| self.face(*face as usize)).collect();
        let mut indices = Vec::new();
        if !self.indices.is_empty() {
            let corners = vertices.clone();
            vertices.par_sort_unstable();
            vertices.dedup();
            let new_index = |v: u32| vertices.partition_point(|other| *other < v) as u32;
            indices = parallel::collect(corners.len(), GRAIN, |at| new_index(corners[at]));
        }
        let colors = match &self.colors {
            Colors::Face(colors) => Colors::Face(gather(colors, faces)),
            Colors::Vertex(colors) => Colors::Vertex(gather(colors, &vertices)),
        };
        let texture = self.texture.as_ref().map(|texture| texture.of_faces(faces));
        let sh = self.sh.as_ref().map(|sh| sh.of_faces(faces));
        let positions = gather(&self.positions, &vertices);
        Mesh { positions, colors, indices, opacity, normals, shell, single_sided, texture, sh }
    }

    /// Keeps `faces`, given in any order, in the mesh's order, and drops unused vertices.
    pub fn keep(&mut self, faces: &[u32]) {
        let mut kept = vec![false; self.face_count()];
        for face in faces {
            kept[*face as usize] = true;
        }
        self.retain(|f| kept[f]);
    }

    /// Keeps the faces for which `keep` returns true, in order, and drops unused vertices.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let indexed = !self.indices.is_empty();
        if !indexed && self.texture.is_none() && self.sh.is_none() {
            return self.retain_in_place(&KeptRows::new(self.face_count(), keep));
        }
        let faces: Vec<u32> =
            (0..self.face_count()).filter(|&f| keep(f)).map(|f| f as u32).collect();
        self.select(&faces);
        if !indexed {
            return;
        }
        let mut used = vec![false; self.vertex_count()];
        for v in &self.indices {
            used[*v as usize] = true;
        }
        let kept: Vec<u32> = (0..used.len()).filter(|&v| used[v]).map(|v| v as u32).collect();
        let mut new_index = vec![0; used.len()];
        for (new, old) in (0..).zip(&kept) {
            new_index[*old as usize] = new;
        }
        for v in &mut self.indices {
            *v = new_index[*v as usize];
        }
        self.positions = gather(&self.positions, &kept);
        if let Colors::Vertex(colors) = &mut self.colors {
            *colors = gather(colors, &kept);
        }
    }

    /// Drops the other faces of a mesh without indices, texture and harmonics.
    fn retain_in_place(&mut self, kept: &KeptRows) {
        kept.keep_in(&mut self.positions, 3);
        match &mut self.colors {
            Colors::Face(colors) => kept.keep_in(colors, 1),
            Colors::Vertex(colors) => kept.keep_in(colors, 3),
        }
        kept.keep_if_present(&mut self.opacity);
        kept.keep_if_present(&mut self.normals);
        kept.keep_if_present(&mut self.shell);
        kept.keep_if_present(&mut self.single_sided);
    }

    /// Takes the faces from `first` on out of the mesh, as a mesh of their own.
    pub fn split_off(&mut self, first: usize) -> Mesh {
        let mut rest = self.clone();
        rest.retain(|face| face >= first);
        self.retain(|face| face < first);
        rest
    }

    /// Appends the faces of `other`. The result has indices if either has them, colours per face
    /// only if both have these, and a texture only if both have one.
    ///
    /// # Errors
    ///
    /// More vertices than 32 bits count.
    pub fn append(&mut self, mut other: Mesh) -> Result<()> {
        if self.sh.is_some() || other.sh.is_some() {
            *self = std::mem::take(self).unshared();
            other = other.unshared();
        }
        if !self.opacity.is_empty() || !other.opacity.is_empty() {
            self.opacity.resize(self.face_count(), 1.0);
            other.opacity.resize(other.face_count(), 1.0);
        }
        if !self.normals.is_empty() || !other.normals.is_empty() {
            self.make_flat_normals();
            other.make_flat_normals();
        }
        if !self.shell.is_empty() || !other.shell.is_empty() {
            self.shell.resize(self.face_count(), false);
            other.shell.resize(other.face_count(), false);
        }
        if !self.single_sided.is_empty() || !other.single_sided.is_empty() {
            self.single_sided.resize(self.face_count(), false);
            other.single_sided.resize(other.face_count(), false);
        }
        match (&mut self.texture, &other.texture) {
            (Some(a), Some(b)) => a.append(b),
            // Without faces there is nothing that a texture lacks.
            (None, Some(texture)) if self.positions.is_empty() => {
                let mut own = texture.of_faces(&[]);
                own.append(texture);
                self.texture = Some(own);
            }
            (Some(_), None) if other.positions.is_empty() => {}
            _ => {
                self.drop_texture();
                other.drop_texture();
            }
        }
        self.sh = FaceSh::joined(
            (self.sh.take(), self.face_count()),
            (other.sh.as_ref(), other.face_count()),
        );
        if matches!(self.colors, Colors::Vertex(_)) || matches!(other.colors, Colors::Vertex(_)) {
            self.make_vertex_colors();
            other.make_vertex_colors();
        }
        if self.indices.is_empty() != other.indices.is_empty() {
            self.make_indices();
            other.make_indices();
        }
        if self.vertex_count() + other.vertex_count() > u32::MAX as usize {
            return Err(Error::invalid_data(
                "the inputs have more than 4,294,967,295 vertices together; give fewer or smaller files",
            ));
        }
        let first = self.vertex_count() as u32;
        self.indices.extend(other.indices.iter().map(|i| i + first));
        self.positions.append(&mut other.positions);
        self.opacity.append(&mut other.opacity);
        self.normals.append(&mut other.normals);
        self.shell.append(&mut other.shell);
        self.single_sided.append(&mut other.single_sided);
        if let (Colors::Face(a), Colors::Face(b)) | (Colors::Vertex(a), Colors::Vertex(b)) =
            (&mut self.colors, &mut other.colors)
        {
            a.append(b);
        }
        Ok(())
    }

    /// Unit normal of a face by its winding; up for a face without area.
    pub fn flat_normal(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.corners(face).map(|v| v.as_dvec3());
        (b - a).cross(c - a).normalize_or(DVec3::Y).as_vec3()
    }

    /// Unit normal of every vertex: the mean of its faces', by their area; none when faces have
    /// none. `[V]`
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut sums =
            vec![Vec3::ZERO; if self.normals.is_empty() { 0 } else { self.vertex_count() }];
        for (face, normal) in self.normals.iter().enumerate() {
            let area = self.area(face).max(f64::from(f32::MIN_POSITIVE)) as f32;
            for v in self.face(face) {
                sums[v as usize] += *normal * area;
            }
        }
        sums.iter().map(|sum| sum.normalize_or(Vec3::Y)).collect()
    }

    /// Gives a mesh without normals its faces' normals.
    fn make_flat_normals(&mut self) {
        if self.normals.is_empty() {
            self.normals = (0..self.face_count()).map(|face| self.flat_normal(face)).collect();
        }
    }

    /// Replaces the texture by each face's mean colour of it. Returns whether there was one.
    pub fn drop_texture(&mut self) -> bool {
        let Some(texture) = self.texture.take() else { return false };
        self.colors =
            Colors::Face(parallel::collect(self.face_count(), 1, |face| texture.mean(face)));
        true
    }

    /// Reverses the winding of a face. Its normal stays.
    pub fn flip(&mut self, face: usize) {
        if let Some(texture) = &mut self.texture {
            texture.uvs[face].swap(1, 2);
        }
        if !self.indices.is_empty() {
            return self.indices.swap(3 * face + 1, 3 * face + 2);
        }
        self.positions.swap(3 * face + 1, 3 * face + 2);
        if let Colors::Vertex(colors) = &mut self.colors {
            colors.swap(3 * face + 1, 3 * face + 2);
        }
    }

    /// Writes out the indices 0, 1, 2, … of a mesh that has none.
    fn make_indices(&mut self) {
        if self.indices.is_empty() {
            self.indices = (0..self.vertex_count() as u32).collect();
        }
    }

    /// Turns colours per face into colours per vertex by giving every corner its own vertex.
    fn make_vertex_colors(&mut self) {
        if let Colors::Face(colors) = &self.colors {
            let of_corners =
                parallel::collect(colors.len(), GRAIN, |face| [colors[face]; 3]).into_flattened();
            if !self.indices.is_empty() {
                let corners =
                    parallel::collect(self.face_count(), GRAIN, |face| self.corners(face));
                self.positions = corners.into_flattened();
                self.indices.clear();
            }
            self.colors = Colors::Vertex(of_corners);
        }
    }

    /// Checks that there are whole faces, colours and opacities for all, and no index out of range.
    pub fn validate_shape(&self) -> Result<()> {
        let v = self.vertex_count();
        let f = self.face_count();
        let shape = |what: &str, got: usize, wants: String| Err(Error::invalid(what, got, wants));
        if self.indices.is_empty() && !v.is_multiple_of(3) {
            return shape(
                "mesh vertex count",
                v,
                "a multiple of 3 when there are no indices".into(),
            );
        }
        if !self.indices.len().is_multiple_of(3) {
            return shape("mesh index count", self.indices.len(), "a multiple of 3".into());
        }
        let (colors, wants) = match &self.colors {
            Colors::Face(c) => (c, f),
            Colors::Vertex(c) => (c, v),
        };
        if colors.len() != wants {
            return shape("mesh color count", colors.len(), format!("{wants}"));
        }
        if self.sh.is_some() && !self.indices.is_empty() {
            let wants = "a mesh without indices".to_owned();
            return shape("spherical harmonics", self.face_count(), wants);
        }
        let per_face = [
            ("opacity", self.opacity.len()),
            ("normal", self.normals.len()),
            ("shell flag", self.shell.len()),
            ("side flag", self.single_sided.len()),
            ("sh", self.sh.as_ref().map_or(0, FaceSh::face_count)),
        ];
        for (what, got) in per_face {
            if got != 0 && got != f {
                return shape(&format!("mesh {what} count"), got, format!("{f}"));
            }
        }
        if let Some(texture) = &self.texture {
            if texture.uvs.len() != f {
                return shape("mesh texture coordinate count", texture.uvs.len(), format!("{f}"));
            }
            if !texture.page_of.is_empty() && texture.page_of.len() != f {
                return shape("mesh texture page count", texture.page_of.len(), format!("{f}"));
            }
            let last = texture.page_of.iter().copied().max().map_or(0, usize::from);
            if last >= texture.pages.len() {
                return shape("mesh texture page", last, format!("below {}", texture.pages.len()));
            }
        }
        let is_bad = |i: usize| (self.indices[i] as usize >= v).then_some(i);
        match parallel::find_first(self.indices.len(), 1 << 16, is_bad) {
            Some(i) => {
                shape("mesh index", self.indices[i] as usize, format!("below {v} (face {})", i / 3))
            }
            None => Ok(()),
        }
    }

    /// Checks shapes and ranges: whole faces, indices in range, finite positions, colours in [0,
    /// 1]. A valid mesh costs one parallel scan.
    pub fn validate(&self) -> Result<()> {
        self.validate_shape()?;
        let (Colors::Face(colors) | Colors::Vertex(colors)) = &self.colors;
        let valid = all_finite(bytemuck::cast_slice(&self.positions))
            && all_in_unit(bytemuck::cast_slice(colors))
            && all_in_unit(&self.opacity)
            && all_finite(bytemuck::cast_slice(&self.normals))
            && self
                .texture
                .iter()
                .all(|one| all_finite(bytemuck::cast_slice(one.uvs.as_flattened())));
        if valid {
            return Ok(());
        }
        if let Some(i) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(Error::invalid(
                format!("mesh position {i}"),
                self.positions[i],
                "finite numbers",
            ));
        }
        let in_unit = |x: &f32| (0.0..=1.0).contains(x);
        if let Some(i) = colors.iter().position(|c| !c.iter().all(in_unit)) {
            let value = format!("{:?}", colors[i]);
            return Err(Error::invalid(format!("mesh color {i}"), value, "values in [0, 1]"));
        }
        match self.opacity.iter().position(|o| !in_unit(o)) {
            Some(i) => Err(Error::invalid(
                format!("mesh opacity {i}"),
                self.opacity[i],
                "a value in [0, 1]",
            )),
            None => Err(Error::invalid_data(
                "normals or texture coordinates of the mesh are not finite",
            )),
        }
    }
}

/// `values[order[i]]` for every i.
fn gather<T: Copy + Send + Sync>(values: &[T], order: &[u32]) -> Vec<T> {
    parallel::collect(order.len(), 1 << 13, |at| values[order[at] as usize])
}

/// [`gather`] for a list that may be empty instead of having a value for each face.
fn gather_if_present<T: Copy + Send + Sync>(values: &[T], faces: &[u32]) -> Vec<T> {
    if values.is_empty() { Vec::new() } else { gather(values, faces) }
}

/// [`gather`] for three values per face.
fn gather_corners<T: Copy + Send + Sync>(values: &[T], faces: &[u32]) -> Vec<T> {
    gather(values.as_chunks::<3>().0, faces).into_flattened()
}
