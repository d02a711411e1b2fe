//! Opaque, coloured triangles in place of the input's.

use super::Recipe;
use crate::lit::Lit;
use crate::prune::{PruneOptions, prune};
use crate::sh::ShDegree;
use crate::solid::{color_with_sh, solid};
use trisplat_formats::PLAIN_COLOR;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, counted};
use trisplat_scene::{ImportedScene, Provenance, Result, Scene};

impl Recipe<'_> {
    /// The loaded scene as a mesh, with its provenance. `cameras` see it. Without pictures to fit
    /// others to, it keeps its own harmonics.
    pub(super) fn solid_mesh(
        &mut self,
        loaded: ImportedScene,
        cameras: &[Camera],
        has_pictures: bool,
    ) -> Result<(Mesh, Provenance)> {
        let ImportedScene { mut scene, provenance, mut warnings, .. } = loaded;
        if self.options.lit.lit != Lit::Off {
            warnings.retain(|warning| warning != PLAIN_COLOR);
        }
        self.report.warnings.extend(warnings);
        if let Scene::Soup(soup) = &mut scene {
            let own = if has_pictures { ShDegree::Zero } else { self.options.sh.sh };
            soup.truncate_sh(own.max_degree());
        }
        let mesh = self.solidify(scene, cameras)?;
        let mesh = self.simplify_shell(mesh, cameras)?;
        Ok((mesh, provenance))
    }

    /// The part of the recipe that turns the input into opaque, coloured triangles.
    pub(super) fn solidify(&mut self, scene: Scene, cameras: &[Camera]) -> Result<Mesh> {
        let options = self.options;

        // Early, because every later stage costs per triangle and relies on finite geometry.
        let scene = self.prune(scene, cameras)?;

        // On the soup, because it needs opacity and σ, which `color` drops.
        let scene = self.stage(scene, Scene::counts, |scene, details| match scene {
            Scene::Soup(soup) => solid(soup, &options.solid, details),
            Scene::Mesh(_) => Ok(Outcome::Skipped("the input is a mesh: its triangles are solid")),
        })?;

        // From here on an ordinary mesh in linear light.
        let scene = self.stage(scene, Scene::counts, |scene, details| {
            let Scene::Soup(soup) = scene else {
                return Ok(Outcome::Skipped("the input is a mesh: it has colours"));
            };
            let degree = soup.sh_degree;
            *scene = Scene::Mesh(color_with_sh(std::mem::take(soup), degree, details)?);
            Ok(Outcome::Changed(()))
        })?;
        match scene {
            Scene::Mesh(mesh) => Ok(mesh),
            Scene::Soup(_) => unreachable!("the color stage makes a mesh of every soup"),
        }
    }

    /// Within the limit of triangles only where no `cameras` judge their importance, which they do
    /// better than size.
    fn prune(&mut self, scene: Scene, cameras: &[Camera]) -> Result<Scene> {
        let max_triangles = self.budget.scene.filter(|_| cameras.is_empty());
        let options = PruneOptions { max_triangles, ..self.options.prune.clone() };
        let is_mesh = matches!(scene, Scene::Mesh(_));
        let (scene, details) =
            self.report.stage(self.observer, scene, Scene::counts, |scene, details| {
                prune(scene, &options, details)
            })?;
        self.report.warnings.extend(details.warning());
        // A soup sheds its faint triangles as its trainer does.
        if is_mesh && details.faint > 0 {
            let faint = counted(details.faint, "triangle");
            let min_opacity = options.min_opacity;
            self.report.warnings.push(format!(
                "removed {faint} whose alpha is below {min_opacity}; `min_opacity` 0 keeps them"
            ));
        }
        Ok(scene)
    }
}
