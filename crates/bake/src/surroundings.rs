//! Surroundings of a scene: the background of its photos, behind its triangles.
//!
//! They come from the scene itself (`shell`), from its input, from photos (`backdrop`), or are a
//! picture in place of triangles (`sky`). They are a mesh of their own until colours are fitted.

mod backdrop;
mod closed_surface;
mod panorama_colors;
mod shell;
mod sky;

pub(crate) use backdrop::keep_backdrop;
pub use backdrop::{BackdropDetails, BackdropOptions, BackdropWhen, backdrop};
pub(crate) use shell::{
    has_room_for_quarters, protected_faces, quarter_faces, recognise_shell, shell_center,
    simplified_shell, take_shell,
};
pub(crate) use sky::{Sky, close_surface, is_scattered, replace_backdrop};
use trisplat_scene::Result;
use trisplat_scene::mesh::Mesh;

/// Surroundings that a scene or its input had.
#[derive(Default)]
pub(crate) struct Surroundings {
    /// Triangles, their fronts inside.
    pub mesh: Option<Mesh>,
    /// The panorama in place of the triangles, if one is requested.
    pub sky: Sky,
}

impl Surroundings {
    /// The backdrop of the input with the shell of the scene.
    ///
    /// # Errors
    ///
    /// More vertices than 32 bits count.
    pub(crate) fn join(input_backdrop: Option<Mesh>, shell: Mesh) -> Result<Self> {
        let mut mesh = input_backdrop;
        if shell.face_count() > 0 {
            match &mut mesh {
                Some(backdrop) => backdrop.append(shell)?,
                None => mesh = Some(shell),
            }
        }
        Ok(Self { mesh, sky: Sky::default() })
    }
}
