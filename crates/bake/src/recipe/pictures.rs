//! What a bake fits its triangles to, and the cameras that see them.

use crate::views::Views;
use glam::Vec3;
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Placement, Provenance};

/// The photos, and the pictures of a soft scene that replace them where none were given.
pub(super) struct Pictures<'a> {
    pub photos: Option<&'a mut Views>,
    pub drawn: Option<Views>,
}

impl Pictures<'_> {
    pub(super) fn any(&mut self) -> Option<&mut Views> {
        self.photos.as_deref_mut().or(self.drawn.as_mut())
    }

    /// Cameras of the photos.
    pub(super) fn of_photos(&self) -> &[Camera] {
        self.photos.as_deref().map_or(&[], Views::cameras)
    }

    /// Points of the photos' reconstruction.
    pub(super) fn points(&self) -> &[Vec3] {
        self.photos.as_deref().map_or(&[], Views::points)
    }
}

/// Cameras of a scene, in the frame of the input.
pub(super) struct Cameras {
    /// Those of its photos, as far as they are known.
    pub of_photos: Vec<Camera>,
    /// Those that see it: of photos, or chosen ones.
    pub watching: Vec<Camera>,
}

impl Cameras {
    /// `stored` are those in the file of the scene; `own` watch a scene without any.
    pub(super) fn new(stored: Vec<Camera>, pictures: &Pictures<'_>, own: Vec<Camera>) -> Self {
        let of_photos = match pictures.photos.as_deref() {
            // Pictures may be drawn for some of the cameras only.
            Some(photos) if stored.is_empty() || !photos.is_drawn() => photos.cameras().to_vec(),
            _ => stored,
        };
        let watching = match &pictures.drawn {
            Some(drawn) if of_photos.is_empty() => drawn.cameras().to_vec(),
            None if of_photos.is_empty() => own,
            _ => of_photos.clone(),
        };
        Self { of_photos, watching }
    }
}

// ---- What a scene and its levels of detail have in common ---------------------------------------

/// What is known of a scene besides its triangles, in the frame of the input.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    /// Cameras that see it.
    pub watching: &'a [Camera],
    /// The surface for smooth normals.
    pub facing: Option<&'a Mesh>,
}

/// The frame of a file, and its first viewpoint.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub placement: Placement,
    pub viewpoint: Option<Viewpoint>,
}

/// What levels have in common with their scene.
pub(super) struct Shared<'a> {
    pub provenance: Provenance,
    pub seen: Seen<'a>,
    pub frame: Frame,
    /// Before placement.
    pub backdrop: Option<Mesh>,
}
