//! Triangles fitted to pictures.

use super::Recipe;
use super::values::TargetPictures;
use crate::check_dataset::check_dataset;
use crate::exposure::exposure;
use crate::reshape::{SceneTraits, reshape};
use crate::sides::sides;
use crate::views::Views;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Error, Result};

impl Recipe<'_> {
    /// Fits triangles to the pictures; later stages move none of them. `trained_exposure`: the
    /// shares of gain, white balance and falloff by which the training of the scene corrected its
    /// photos.
    pub(super) fn fit(
        &mut self,
        mesh: Mesh,
        backdrop: Option<&Mesh>,
        trained_exposure: Option<[f32; 3]>,
        pictures: &mut TargetPictures<'_>,
        traits: SceneTraits,
        photo_cameras: &[Camera],
    ) -> Result<Mesh> {
        self.check_dataset(&mesh, pictures.photo_views.as_deref_mut())?;
        let mesh = self.exposure(mesh, trained_exposure, pictures.photo_views.as_deref_mut())?;
        let mesh = self.reshape(mesh, pictures.any(), traits)?;
        self.sides(mesh, backdrop, photo_cameras, pictures.photo_views.as_deref_mut())
    }

    /// Refuses photos of another scene, before any work is done with them. Drawn pictures always
    /// show their scene.
    fn check_dataset(&mut self, mesh: &Mesh, photos: Option<&mut Views>) -> Result<()> {
        let Some(photos) = photos.filter(|photos| !photos.is_drawn()) else {
            return Ok(());
        };
        let Some(fault) = check_dataset(mesh, self.options.crop.is_cropped(), photos)? else {
            return Ok(());
        };
        if self.options.force_dataset {
            self.report.warnings.push(format!("`dataset` has {fault}"));
            return Ok(());
        }
        let wants = "the data set it was trained on, in the same coordinates, or `force_dataset`";
        Err(Error::ForeignPhotos { fault: fault.to_string(), wants: wants.to_owned() })
    }

    /// Corrects the exposure of photos, before anything is fitted to them.
    fn exposure(
        &mut self,
        mesh: Mesh,
        trained_exposure: Option<[f32; 3]>,
        photos: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.exposure;
        self.stage(mesh, Mesh::counts, |_, details| {
            exposure(trained_exposure, photos, options, details)
        })
    }

    /// Moves the corners of the remaining triangles by the pictures: before the backdrop, and
    /// before colours are fitted exactly.
    fn reshape(
        &mut self,
        mesh: Mesh,
        views: Option<&mut Views>,
        traits: SceneTraits,
    ) -> Result<Mesh> {
        let options = &self.options.reshape;
        self.long_stage(mesh, Mesh::counts, |mesh, details, progress| {
            reshape(mesh, views, traits, options, details, progress)
        })
    }

    /// Chooses the sides of triangles, after they moved, and before levels are made and colours are
    /// fitted to the drawn sides.
    fn sides(
        &mut self,
        mesh: Mesh,
        backdrop: Option<&Mesh>,
        cameras: &[Camera],
        photos: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.sides;
        self.long_stage(mesh, Mesh::counts, |mesh, details, progress| {
            sides(mesh, backdrop, cameras, photos, options, details, progress)
        })
    }
}
