//! The input of the bake: a soup or a mesh, and its provenance.

use crate::asset::Provenance;
use crate::camera::Camera;
use crate::error::Result;
use crate::math::color::srgb_from_linear;
use crate::math::geometry::bounds;
use crate::mesh::Mesh;
use crate::report::Counts;
use crate::soup::{Soup, sh0_from_rgb};
use glam::Vec3;

/// σ of a mesh's triangles in a soup: solid, but with a slope that gradients pass.
const MESH_SIGMA: f32 = 0.05;
/// Opacity of a mesh's triangles in a soup: high, but below 1, where the logit has no slope.
const MESH_OPACITY: f32 = 0.95;

/// The two kinds of input of the bake.
#[derive(Debug, Clone, PartialEq)]
pub enum Scene {
    /// Unconnected triangles with opacity, σ and SH: a trained scene.
    Soup(Soup),
    /// Triangles with linear colours, perhaps connected: another tool's output, or our own.
    Mesh(Mesh),
}

impl Scene {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        match self {
            Scene::Soup(soup) => soup.len(),
            Scene::Mesh(mesh) => mesh.face_count(),
        }
    }

    /// Triangles and vertices, for reports.
    pub fn counts(&self) -> Counts {
        match self {
            Scene::Soup(soup) => {
                Counts { triangles: soup.len() as u64, vertices: 3 * soup.len() as u64 }
            }
            Scene::Mesh(mesh) => mesh.counts(),
        }
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        match self {
            Scene::Soup(soup) => soup.vertices[triangle],
            Scene::Mesh(mesh) => mesh.corners(triangle),
        }
    }

    /// Lowest and highest corner of the first `count` triangles; none when there are none.
    pub fn bounds(&self, count: usize) -> Option<[Vec3; 2]> {
        bounds((0..count).flat_map(|i| self.corners(i)))
    }

    /// True for a triangle of the shell, which belongs to the backdrop instead of the scene.
    pub fn is_shell(&self, triangle: usize) -> bool {
        match self {
            Scene::Soup(soup) => soup.is_shell(triangle),
            Scene::Mesh(mesh) => mesh.is_shell(triangle),
        }
    }

    /// True for a triangle that is drawn from its front only.
    pub fn is_single_sided(&self, triangle: usize) -> bool {
        match self {
            Scene::Soup(_) => false,
            Scene::Mesh(mesh) => mesh.is_single_sided(triangle),
        }
    }

    /// Triangles of the shell.
    pub fn shell_count(&self) -> usize {
        let (Scene::Soup(Soup { shell, .. }) | Scene::Mesh(Mesh { shell, .. })) = self;
        shell.iter().filter(|is_shell| **is_shell).count()
    }

    /// A copy as a soup; the triangles of a mesh are nearly solid in it, each of the mean colour of
    /// its corners.
    pub fn to_soup(&self) -> Soup {
        match self {
            Scene::Soup(soup) => soup.clone(),
            Scene::Mesh(mesh) => nearly_solid(mesh),
        }
    }

    /// Checks its content: see [`Soup::validate`] and [`Mesh::validate`].
    pub fn validate(&self) -> Result<()> {
        match self {
            Scene::Soup(soup) => soup.validate(),
            Scene::Mesh(mesh) => mesh.validate(),
        }
    }
}

/// A mesh as nearly solid triangles.
fn nearly_solid(mesh: &Mesh) -> Soup {
    let count = mesh.face_count();
    let sh = |face: usize| {
        let corners = mesh.corner_colors(face).map(Vec3::from);
        let mean = (corners[0] + corners[1] + corners[2]) / 3.0;
        mean.to_array().map(|channel| sh0_from_rgb(srgb_from_linear(channel)))
    };
    let opacity =
        |face: usize| mesh.opacity.get(face).map_or(MESH_OPACITY, |o| o.min(MESH_OPACITY));
    Soup {
        vertices: (0..count).map(|face| mesh.corners(face)).collect(),
        opacity: (0..count).map(opacity).collect(),
        sigma: vec![MESH_SIGMA; count],
        sh: (0..count).map(sh).collect(),
        sh_degree: 0,
        shell: mesh.shell.clone(),
    }
}

/// A scene as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedScene {
    /// The triangles.
    pub scene: Scene,
    /// Their provenance and placement.
    pub provenance: Provenance,
    /// Repairs and omissions of reading, one sentence each.
    pub warnings: Vec<String>,
    /// Cameras of its training photos, in the frame of the file; empty when unknown.
    pub cameras: Vec<Camera>,
}

impl ImportedScene {
    /// Triangles and vertices, for reports.
    pub fn counts(&self) -> Counts {
        self.scene.counts()
    }

    /// Takes the backdrop out of the mesh, when it has one.
    pub fn take_backdrop(&mut self) -> Option<Mesh> {
        let count = std::mem::take(&mut self.provenance.backdrop_faces) as usize;
        match &mut self.scene {
            Scene::Mesh(mesh) if (1..mesh.face_count()).contains(&count) => {
                Some(mesh.split_off(mesh.face_count() - count))
            }
            _ => None,
        }
    }

    /// Appends a backdrop to the mesh; a soup has none.
    ///
    /// # Errors
    ///
    /// More vertices than 32 bits count.
    pub fn put_backdrop(&mut self, backdrop: Mesh) -> Result<()> {
        if let Scene::Mesh(mesh) = &mut self.scene {
            self.provenance.backdrop_faces += backdrop.face_count() as u32;
            mesh.append(backdrop)?;
        }
        Ok(())
    }
}

impl From<Scene> for ImportedScene {
    /// A scene from memory instead of a file.
    fn from(scene: Scene) -> Self {
        ImportedScene {
            scene,
            provenance: Provenance::default(),
            warnings: Vec::new(),
            cameras: Vec::new(),
        }
    }
}

impl From<Soup> for ImportedScene {
    fn from(soup: Soup) -> Self {
        Scene::Soup(soup).into()
    }
}

impl From<Mesh> for ImportedScene {
    fn from(mesh: Mesh) -> Self {
        Scene::Mesh(mesh).into()
    }
}
