//! What stands behind a connected surface that is to look like its photos: the shell that closes the scene, or the backdrop that it has.

use super::color::{ColorDetails, color};
use super::shell::take_shell;
use crate::camera::Camera;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::scene::{Loaded, Scene};

/// Takes what is behind the scene out of it. Empty when there is nothing, or when it is the whole scene.
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
