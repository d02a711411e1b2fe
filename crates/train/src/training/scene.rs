//! The scene of a training between two steps: its triangles, pictures of it, provenance and cameras.

use super::Training;
use crate::eval::solid_samples;
use crate::params::Anneal;
use crate::schedule::Schedule;
use crate::trained::provenance;
use trisplat_raster::soft::{SoftOptions, Window};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::report::generator;
use trisplat_scene::{Error, ImportedScene, Provenance, Result, Soup};

impl Training<'_> {
    /// Drawing options of the present scene: window, order and alpha cap of the last step.
    pub(super) fn drawing(&self) -> SoftOptions {
        let last = self.meta.step.max(1) - 1;
        let rates = Schedule::new(&self.meta.options).rates(last);
        let window = Window::Coverage { width_px: 1.0 };
        if self.ends_solid() {
            SoftOptions { window, ..self.drawing }
        } else {
            rates.drawing(&self.drawing)
        }
    }

    /// True when the run is over and its triangles are opaque from now on.
    pub(super) fn ends_solid(&self) -> bool {
        self.is_done() && self.meta.options.ends_solid()
    }

    /// True if [`Training::picture`] draws faster than the CPU: soft pictures of the whole scene
    /// on a graphics card.
    pub(super) fn draws(&self, drawing: &SoftOptions) -> bool {
        self.backend.draws()
            && self.meta.frozen == 0
            && solid_samples(drawing).is_none()
            && !self.ends_solid()
    }

    /// The view of `camera`, in the world, of the present scene.
    ///
    /// # Errors
    ///
    /// Errors of the backend; a backend that does not draw.
    pub(super) fn picture(&mut self, camera: &Camera, drawing: &SoftOptions) -> Result<RgbImage> {
        let rates = Schedule::new(&self.meta.options).rates(self.meta.step.max(1) - 1);
        let camera = self.space().camera_to_training(camera);
        Ok(self.backend.picture(&camera, drawing, &rates)?.to_pixels())
    }

    /// The present scene, in the data set's world.
    pub(super) fn soup(&mut self) -> Result<Soup> {
        let schedule = Schedule::new(&self.meta.options);
        let last = self.meta.step.max(1) - 1;
        let anneal = if self.ends_solid() { Anneal::SOLID } else { schedule.anneal(last) };
        let mut soup = self.backend.params()?.to_soup(&anneal, schedule.sh_degree(last));
        self.space().soup_to_world(&mut soup);
        Ok(soup)
    }

    /// The present scene, as in its file.
    pub(super) fn scene(&mut self) -> Result<ImportedScene> {
        let (provenance, cameras) = self.origin();
        let (soup, _) = self.final_soup()?;
        Ok(ImportedScene { provenance, cameras, ..ImportedScene::from(soup) })
    }

    /// The trained triangles, with the shell flagged. Triangles that are no longer finite are left
    /// out and counted in a note.
    ///
    /// # Errors
    ///
    /// As [`Training::soup`]; no triangle is left.
    pub(super) fn final_soup(&mut self) -> Result<(Soup, Option<String>)> {
        let frozen = self.meta.frozen;
        let pinned = self.meta.pinned;
        let mut soup = self.soup()?.split_off(frozen);
        soup.set_shell(0..pinned - frozen);
        let all = soup.len();
        if all == 0 && self.meta.core.is_none() {
            let reason = "gives a scene without triangles: its photos show nothing in the same place; check their poses";
            return Err(Error::unsupported(&self.dataset.path, reason));
        }
        let gone = soup.retain_finite();
        if gone == all && all > 0 {
            let expected = "lower ones: no triangle has finite numbers any more";
            return Err(Error::invalid("rates", "too high for this scene", expected));
        }
        let lost = (gone > 0).then(|| {
            format!(
                "{gone} of {all} triangles, whose numbers are no longer finite: lower the rates"
            )
        });
        Ok((soup, lost))
    }

    /// Provenance and cameras of the scene; if it teaches itself, from its file.
    pub(super) fn origin(&self) -> (Provenance, Vec<Camera>) {
        match self.own_origin.clone() {
            Some((provenance, cameras)) => {
                let ours = Some(generator());
                (Provenance { generator: ours.clone(), trainer: ours, ..provenance }, cameras)
            }
            None => {
                let exposure =
                    self.meta.exposure.verdict.map(|verdict| verdict.strengths.to_array());
                let provenance = Provenance { exposure, ..provenance(self.dataset) };
                (provenance, self.dataset.train().map(|view| view.camera).collect())
            }
        }
    }
}
