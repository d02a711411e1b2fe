//! A scene of any kind, from a file or from memory.

use glam::Vec3;
use trisplat_formats::Content;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{
    Bounds, Hit, ImportedScene, ImportedSplats, Provenance, RayTree, Scene, Soup, Splats,
};
use trisplat_train::Trained;

/// A scene of any kind, from a file or from memory: a soup, a mesh or Gaussian splats.
#[derive(Debug, Clone)]
pub struct AnyScene {
    pub(super) content: Content,
    /// Built by the first ray.
    rays: RayTree,
}

impl AnyScene {
    /// Number of triangles; 0 of Gaussians.
    pub fn triangle_count(&self) -> usize {
        match &self.content {
            Content::Scene(loaded) => loaded.scene.triangle_count(),
            Content::Splats(_) => 0,
        }
    }

    /// The triangles; `None` of Gaussians.
    pub fn triangles(&self) -> Option<&Scene> {
        match &self.content {
            Content::Scene(loaded) => Some(&loaded.scene),
            Content::Splats(_) => None,
        }
    }

    /// The Gaussians; `None` of triangles.
    pub fn splats(&self) -> Option<&Splats> {
        match &self.content {
            Content::Scene(_) => None,
            Content::Splats(loaded) => Some(&loaded.splats),
        }
    }

    /// Provenance, placement and first viewpoint.
    pub fn provenance(&self) -> &Provenance {
        match &self.content {
            Content::Scene(loaded) => &loaded.provenance,
            Content::Splats(loaded) => &loaded.provenance,
        }
    }

    /// Cameras of its training photos, in the frame of the file; empty when unknown.
    pub fn cameras(&self) -> Vec<Camera> {
        match &self.content {
            Content::Scene(loaded) => loaded.cameras.clone(),
            Content::Splats(loaded) => loaded.cameras.iter().map(|(_, camera)| *camera).collect(),
        }
    }

    /// Repairs and omissions of reading, one sentence each.
    pub fn warnings(&self) -> &[String] {
        match &self.content {
            Content::Scene(loaded) => &loaded.warnings,
            Content::Splats(loaded) => &loaded.warnings,
        }
    }

    /// The box around the scene, without its backdrop; around the centres of Gaussians.
    pub fn bounds(&self) -> Bounds {
        match &self.content {
            Content::Scene(loaded) => {
                let backdrop = loaded.provenance.backdrop_faces as usize;
                let count = loaded.scene.triangle_count().saturating_sub(backdrop);
                let scene = &loaded.scene;
                let inside = (0..count).filter(|triangle| !scene.is_shell(*triangle));
                Bounds::of(inside.flat_map(|triangle| scene.corners(triangle)))
            }
            Content::Splats(loaded) => Bounds::of(loaded.splats.positions.iter().copied()),
        }
    }

    /// The first face of a mesh on a ray: see [`trisplat_scene::Asset::raycast`]. `None` for soups and Gaussians,
    /// which have no solid surface before a bake.
    pub fn raycast(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let Content::Scene(ImportedScene { scene: Scene::Mesh(mesh), provenance, .. }) =
            &self.content
        else {
            return None;
        };
        let faces = mesh.face_count().saturating_sub(provenance.backdrop_faces as usize);
        self.rays.first_hit(mesh, faces, origin, direction)
    }
}

impl From<Content> for AnyScene {
    fn from(content: Content) -> Self {
        Self { content, rays: RayTree::default() }
    }
}

impl From<AnyScene> for Content {
    fn from(scene: AnyScene) -> Self {
        scene.content
    }
}

impl From<ImportedScene> for AnyScene {
    fn from(scene: ImportedScene) -> Self {
        Content::Scene(scene).into()
    }
}

macro_rules! from_triangles {
    ($($kind:ty),*) => {$(
        impl From<$kind> for AnyScene {
            fn from(triangles: $kind) -> Self {
                ImportedScene::from(triangles).into()
            }
        }
    )*};
}
from_triangles!(Scene, Soup, Mesh, Trained);

impl From<ImportedSplats> for AnyScene {
    fn from(splats: ImportedSplats) -> Self {
        Content::Splats(splats).into()
    }
}

impl From<Splats> for AnyScene {
    fn from(splats: Splats) -> Self {
        let provenance = Provenance::default();
        ImportedSplats { splats, provenance, warnings: Vec::new(), cameras: Vec::new() }.into()
    }
}

impl From<&AnyScene> for AnyScene {
    fn from(scene: &AnyScene) -> Self {
        scene.clone()
    }
}
