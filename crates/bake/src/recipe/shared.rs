//! What a scene and its levels of detail have in common.

use trisplat_scene::{
    Placement, Provenance,
    camera::{Camera, Viewpoint},
    mesh::Mesh,
};

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
