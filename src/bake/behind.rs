//! The background of a connected surface that must look like its photos: the scene's shell or backdrop.

use super::color::{ColorDetails, color};
use super::shell::take_shell;
use crate::camera::Camera;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::scene::{Loaded, Scene};

/// Takes the shell or backdrop out of the scene. Empty when there is none, or when it is the whole scene.
pub(super) fn take_behind(scene: &mut Loaded, cameras: &[Camera]) -> Result<Mesh> {
    if let Some(backdrop) = scene.take_backdrop() {
        return Ok(backdrop);
    }
    if scene.scene.shell_count() == scene.scene.triangle_count() {
        return Ok(Mesh::default());
    }
    let mut shell = match &mut scene.scene {
        Scene::Soup(soup) => color(soup.take_shell(), &mut ColorDetails::default())?,
        Scene::Mesh(mesh) => mesh.take_shell(),
    };
    shell.shell = vec![true; shell.face_count()];
    Ok(take_shell(&mut shell, cameras))
}
