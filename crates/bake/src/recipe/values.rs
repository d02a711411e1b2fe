//! Values that steps of the recipe pass on.

use crate::place::evidence::Evidence;
use crate::views::Views;
use glam::Vec3;
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::stored_cameras::encode_cameras;
use trisplat_scene::{ImportedScene, Placement, Provenance, UpAxis};

/// A scene and the photos of it.
pub(super) struct LoadedScene<'a> {
    /// Without its backdrop.
    pub scene: ImportedScene,
    /// The backdrop of an earlier bake.
    pub input_backdrop: Option<Mesh>,
    pub pictures: TargetPictures<'a>,
    /// The up axis of a mesh whose file names neither one nor its writer.
    pub assumed_up: Option<UpAxis>,
}

/// Pictures that triangles are fitted to: photos or, where none were given, drawings of a soft
/// scene.
pub(super) struct TargetPictures<'a> {
    /// Photos, or pictures that the caller drew in their place.
    pub photo_views: Option<&'a mut Views>,
    /// Pictures that the bake drew.
    pub drawn_views: Option<Views>,
}

impl TargetPictures<'_> {
    /// The photos, or else the drawn pictures.
    pub(super) fn any(&mut self) -> Option<&mut Views> {
        self.photo_views.as_deref_mut().or(self.drawn_views.as_mut())
    }

    /// Cameras of the photos.
    pub(super) fn photo_cameras(&self) -> &[Camera] {
        self.photo_views.as_deref().map_or(&[], Views::cameras)
    }

    /// Points of the photos' reconstruction.
    pub(super) fn points(&self) -> &[Vec3] {
        self.photo_views.as_deref().map_or(&[], Views::points)
    }
}

/// Cameras of a scene, in the frame of the input.
pub(super) struct SceneCameras {
    /// Cameras of its photos, as far as they are known.
    pub photos: Vec<Camera>,
    /// Cameras that decide visibility: of photos, or chosen ones.
    pub visibility: Vec<Camera>,
}

impl SceneCameras {
    /// `stored` are those in the file of the scene; `viewpoint_cameras` look at a scene without
    /// any.
    pub(super) fn new(
        stored: Vec<Camera>,
        pictures: &TargetPictures<'_>,
        viewpoint_cameras: Vec<Camera>,
    ) -> Self {
        let photos = match pictures.photo_views.as_deref() {
            // Pictures may be drawn for some of the cameras only.
            Some(photos) if stored.is_empty() || !photos.is_drawn() => photos.cameras().to_vec(),
            _ => stored,
        };
        let visibility = match &pictures.drawn_views {
            Some(drawn) if photos.is_empty() => drawn.cameras().to_vec(),
            None if photos.is_empty() => viewpoint_cameras,
            _ => photos.clone(),
        };
        Self { photos, visibility }
    }

    /// Stores the cameras of photos for the file, if there are any.
    pub(super) fn store_in(&self, provenance: &mut Provenance) {
        if !self.photos.is_empty() {
            provenance.cameras = encode_cameras(&self.photos);
        }
    }
}

// ---- Shared by a scene and its levels of detail -------------------------------------------------

/// Inputs of normals besides the triangles, in the frame of the input.
#[derive(Clone, Copy)]
pub(super) struct NormalSources<'a> {
    /// Cameras that decide which side is the front.
    pub cameras: &'a [Camera],
    /// The surface for smooth normals.
    pub surface: Option<&'a Mesh>,
}

/// The frame of a file, and its first viewpoint.
#[derive(Clone, Copy)]
pub(super) struct FileFrame {
    pub placement: Placement,
    pub viewpoint: Option<Viewpoint>,
}

/// Source of a file's frame.
#[derive(Clone, Copy)]
pub(super) enum FrameSource<'a> {
    /// Cameras and points of the scene.
    Evidence(Evidence<'a>),
    /// The scene of a level of detail.
    Scene(FileFrame),
}

/// Values that levels share with their scene.
pub(super) struct LevelContext<'a> {
    pub provenance: Provenance,
    pub normals: NormalSources<'a>,
    pub frame: FileFrame,
}
