//! The inputs of a bake as one scene.

use super::Recipe;
use super::values::{LoadedScene, TargetPictures};
use crate::merge::{merge, share_world};
use crate::surroundings::recognise_shell;
use crate::views::Views;
use std::ops::ControlFlow::Continue;
use trisplat_scene::report::{Report, StageEvent};
use trisplat_scene::{ImportedScene, Provenance, Result, Scene};

impl Recipe<'_> {
    /// Merges `inputs`, and takes `photos` to the frame of the result.
    pub(super) fn load<'v>(
        &mut self,
        inputs: Vec<ImportedScene>,
        mut photos: Option<&'v mut Views>,
    ) -> Result<LoadedScene<'v>> {
        let mut scene = self.merged(inputs, photos.is_some())?;
        let Provenance { generator, trainer, up, .. } = &scene.provenance;
        let is_anonymous = generator.is_none() && trainer.is_none();
        let is_unknown = is_anonymous && up.is_none() && matches!(scene.scene, Scene::Mesh(_));
        let assumed_up = is_unknown.then(|| scene.provenance.up_axis());
        let input_backdrop = scene.take_backdrop();
        if let Some(photos) = photos.as_deref_mut() {
            photos.transform(&scene.provenance.placement);
            photos.show_part(self.drops_surroundings());
        }
        let pictures = TargetPictures { photo_views: photos, drawn_views: None };
        Ok(LoadedScene { scene, input_backdrop, pictures, assumed_up })
    }

    /// The inputs as one scene.
    fn merged(&mut self, inputs: Vec<ImportedScene>, has_photos: bool) -> Result<ImportedScene> {
        let inputs = inputs.into_iter().map(|loaded| self.untextured(loaded, has_photos));
        let mut inputs: Vec<ImportedScene> = inputs.collect();
        // For each input separately: two scenes side by side have no common middle.
        for loaded in &mut inputs {
            recognise_shell(&mut loaded.scene, self.options.backdrop.backdrop);
        }
        merge(self.of_one_kind(inputs)?)
    }

    /// A mesh keeps its texture and its harmonics unless photos decide colours: then its faces get
    /// the mean of their texels first.
    fn untextured(&mut self, mut loaded: ImportedScene, has_photos: bool) -> ImportedScene {
        let Scene::Mesh(mesh) = &mut loaded.scene else { return loaded };
        if !has_photos {
            return loaded;
        }
        mesh.sh = None;
        if mesh.drop_texture() && !self.options.texture.is_wanted() {
            let warning = "the texture of the input became one colour per triangle, because photos decide colours: give `texture` for a new one";
            self.report.warnings.push(warning.to_owned());
        }
        loaded
    }

    /// Soups among meshes become meshes, because only meshes merge with meshes. A budget of
    /// triangles is for all together.
    fn of_one_kind(&mut self, mut inputs: Vec<ImportedScene>) -> Result<Vec<ImportedScene>> {
        let is_soup = |loaded: &ImportedScene| matches!(loaded.scene, Scene::Soup(_));
        let soups = inputs.iter().filter(|loaded| is_soup(loaded)).count();
        if soups == 0 || soups == inputs.len() {
            return Ok(inputs);
        }
        let placement = inputs[0].provenance.placement;
        if inputs.iter().any(|loaded| loaded.provenance.placement != placement) {
            share_world(&mut inputs);
        }
        let mut options = self.options.clone();
        options.prune.max_triangles = None;
        let mut discarded_report = Report::default();
        let mut no_observer = |_: StageEvent<'_>| Continue(());
        let mut recipe = Recipe::new(&options, &mut discarded_report, &mut no_observer);
        let mut meshes = Vec::with_capacity(inputs.len());
        for mut loaded in inputs {
            if let Scene::Soup(soup) = &mut loaded.scene {
                soup.truncate_sh(0);
                let mesh = recipe.solidify(loaded.scene, &[])?;
                loaded.scene = Scene::Mesh(mesh);
            }
            meshes.push(loaded);
        }
        Ok(meshes)
    }
}
