//! The recipe: the stages in their order, with reasons.

mod package;

use super::arrange::arrange;
use super::backdrop::{BackdropWhen, Sky, backdrop, keep_backdrop, take_sky};
use super::background::{BackgroundDetails, BackgroundFrom, background};
use super::collision::collision;
use super::color::color;
use super::counts::{count, count_mesh};
use super::crop::crop;
use super::exposure::exposure;
use super::lit::{Lit, SURFACE};
use super::lod::{LevelSource, LodOptions};
use super::merge::{merge, share_world};
use super::misfit::misfit;
use super::options::BakeOptions;
use super::prune::{PruneDetails, PruneOptions, prune};
use super::refit::{RefitColors, UnseenColors, refit, smooth_shell};
use super::reshape::{ReshapeWhen, SceneTraits, reshape};
use super::shell::{recognise_shell, spared, take_shell};
use super::solid::solid;
use super::teacher::{TeacherWhen, is_solid, teacher};
use super::texture::{TextureDetails, texture};
use super::tiles::tiles;
use super::unseen::{FaceLimit, UnseenDetails, UnseenOptions, masked, unseen};
use super::views::Views;
use std::ops::ControlFlow::Continue;
use std::sync::Arc;
use trisplat_scene::{
    Asset, Error, ImportedScene, Limits, Placement, Provenance, Result, Scene,
    camera::{Camera, Viewpoint},
    mesh::Mesh,
    report::{Outcome, Report, StageDetails, StageEvent, StageObserver},
};
use trisplat_surface::{SurfaceDetails, surface};

/// The stages, and their shared state.
pub(super) struct Recipe<'a> {
    options: &'a BakeOptions,
    views: Option<&'a mut Views>,
    report: &'a mut Report,
    observer: StageObserver<'a>,
    /// Pictures of the soft scene, instead of photos.
    taught: Option<Views>,
    /// Cameras of photos, in the frame of the input.
    cameras: Vec<Camera>,
    /// Cameras that see the scene: those of photos, or chosen ones.
    watching: Vec<Camera>,
    /// The surface for smooth normals.
    facing: Option<Arc<Mesh>>,
    /// The backdrop of the input, then that of the output before placement.
    backdrop: Option<Mesh>,
    /// What replaces it, if that is asked for.
    sky: Sky,
    /// The scene's placement, which its levels share.
    placement: Option<Placement>,
    /// The first viewpoint, in the frame of the file.
    viewpoint: Option<Viewpoint>,
}

impl<'a> Recipe<'a> {
    pub(super) fn new(
        options: &'a BakeOptions,
        views: Option<&'a mut Views>,
        report: &'a mut Report,
        observer: StageObserver<'a>,
    ) -> Self {
        let (taught, backdrop, placement) = (None, None, None);
        let (cameras, watching) = (Vec::new(), Vec::new());
        let facing = None;
        Self {
            options,
            views,
            report,
            observer,
            taught,
            cameras,
            watching,
            facing,
            backdrop,
            sky: Sky::default(),
            placement,
            viewpoint: None,
        }
    }

    /// Bakes inputs, merged.
    pub(super) fn run(mut self, inputs: Vec<ImportedScene>) -> Result<Asset> {
        let mut inputs: Vec<ImportedScene> =
            inputs.into_iter().map(|loaded| self.untextured(loaded)).collect();
        // For each input separately: two scenes side by side have no common middle.
        let when = self.options.backdrop.backdrop;
        inputs.iter_mut().for_each(|loaded| recognise_shell(&mut loaded.scene, when));
        let inputs = self.of_one_kind(inputs)?;
        let mut loaded = merge(inputs)?;
        self.backdrop = loaded.take_backdrop();
        if let Some(views) = self.views.as_deref_mut() {
            views.transform(&loaded.provenance.placement);
            views.correct_poses(&loaded.cameras);
        }
        let loaded = self.background(loaded)?;
        let loaded = self.crop(loaded)?;
        self.teach(&loaded)?;
        let loaded = self.arrange(loaded)?;
        let traits = self.traits(&loaded);
        let collision = self.collide(&loaded)?;
        self.face(&loaded)?;
        let ImportedScene { mut scene, provenance, warnings, mut cameras } = loaded;
        self.report.warnings.extend(warnings);
        if let Some(views) = self.views.as_deref() {
            // Pictures may be drawn for some of the cameras only.
            if cameras.is_empty() || !views.is_drawn() {
                cameras = views.cameras().to_vec();
            }
        }
        self.cameras = cameras.clone();
        // Chosen cameras have not seen everything: they rank triangles, but drop none as unseen.
        let chosen = cameras.is_empty();
        if let Some(taught) = self.taught.as_ref().filter(|_| chosen) {
            cameras = taught.cameras().to_vec();
        }
        self.watching = cameras.clone();
        if let Scene::Soup(soup) = &mut scene {
            // Only the teacher draws more.
            soup.truncate_sh(0);
        }
        let mesh = self.solidify(scene, &cameras)?;
        let mesh = self.cull(mesh, &cameras, chosen, traits.is_soft)?;
        // Drawn pictures always show their scene, so the check is for photos only.
        if let Some(views) = self.views.as_deref_mut().filter(|views| !views.is_drawn()) {
            match misfit(&mesh, !self.options.crop.crop.is_empty(), views)? {
                Some(misfit) if self.options.force_dataset => {
                    self.report.warnings.push(format!("`dataset` has {misfit}"));
                }
                Some(misfit) => {
                    let wants = "the data set it was trained on, in the same coordinates, or `force_dataset`";
                    return Err(Error::invalid("dataset", misfit, wants));
                }
                None => {}
            }
        }
        let mesh = self.expose(mesh)?;
        let mesh = self.reshape(mesh, traits)?;
        let mesh = self.part_shell(mesh)?;

        // Levels are made from the scene at this point, and placed like it.
        let faces = mesh.face_count();
        let lod = match self.options.tiles.tiles {
            true => LodOptions { lod: self.options.tiles.shares(faces) },
            false => self.options.lod.clone(),
        };
        let unpainted = if lod.lod.is_empty() { Mesh::default() } else { mesh.clone() };
        let mesh = self.back(mesh)?;
        let (mesh, unseen) = self.paint(mesh, faces)?;
        let behind = mesh.face_count() - faces;
        if behind > 0 && !lod.lod.is_empty() {
            self.backdrop = Some(mesh.clone().split_off(faces));
        }
        let mesh = self.texture(mesh, unseen)?;
        let closer = self.report.details::<TextureDetails>().and_then(|details| details.warning());
        self.report.warnings.extend(closer.filter(|_| mesh.texture.is_some()));
        let asset = self.package(mesh, Provenance { backdrop: behind as u32, ..provenance.clone() })?;
        let source =
            LevelSource { mesh: &unpainted, cameras: &cameras, enlarge: self.options.unseen.enlarge };
        let levels = self.levels(&source, &lod, &provenance)?;
        // From the finished scene: tiles hold final triangles.
        let collision = collision.map(|mesh| self.placed(mesh));
        let backdrop_apart = self.options.backdrop.backdrop == BackdropWhen::File;
        let mut asset = Asset { levels, collision, backdrop_apart, ..asset };
        if self.options.backdrop.backdrop == BackdropWhen::Sky {
            let placement = self.placement.unwrap_or_default();
            if !take_sky(&mut asset, std::mem::take(&mut self.sky), &placement) {
                let warning = "no sky is written: it needs photos (`dataset`), or a scene with a shell";
                self.report.warnings.push(warning.to_owned());
            }
        }
        let options = &self.options.tiles;
        self.report
            .stage(self.observer, asset, Asset::counts, |asset, details| tiles(asset, options, details))
    }

    /// A mesh keeps its texture unless photos decide what triangles show: then its faces get the mean of their texels first.
    fn untextured(&mut self, mut loaded: ImportedScene) -> ImportedScene {
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && self.views.is_some()
            && mesh.drop_texture()
            && !self.options.texture.is_wanted()
        {
            let warning = "the texture of the input became one colour per triangle, because photos decide colours: give `texture` for a new one";
            self.report.warnings.push(warning.to_owned());
        }
        loaded
    }

    /// Soups among meshes become meshes, because only meshes merge with meshes. A budget of triangles is for
    /// all together.
    fn of_one_kind(&mut self, mut inputs: Vec<ImportedScene>) -> Result<Vec<ImportedScene>> {
        let is_soup = |loaded: &ImportedScene| matches!(loaded.scene, Scene::Soup(_));
        let soups = inputs.iter().filter(|loaded| is_soup(loaded)).count();
        if soups == 0 || soups == inputs.len() {
            return Ok(inputs);
        }
        if inputs.iter().any(|loaded| loaded.provenance.placement != inputs[0].provenance.placement) {
            share_world(&mut inputs);
        }
        let mut options = self.options.clone();
        options.prune.max_triangles = None;
        let mut unread = Report::default();
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let mut of_soup = Recipe::new(&options, None, &mut unread, &mut nobody);
        let mut solidified = |mut loaded: ImportedScene| match &mut loaded.scene {
            Scene::Soup(soup) => {
                soup.truncate_sh(0);
                Ok(ImportedScene { scene: Scene::Mesh(of_soup.solidify(loaded.scene, &[])?), ..loaded })
            }
            Scene::Mesh(_) => Ok(loaded),
        };
        inputs.into_iter().map(&mut solidified).collect()
    }

    /// On the scene as it was trained and in full, because the borders of its pictures show the background.
    fn background(&mut self, loaded: ImportedScene) -> Result<ImportedScene> {
        // Hardening looked for it before it trained.
        if self.report.stages.iter().any(|stage| stage.name == BackgroundDetails::STAGE) {
            return Ok(loaded);
        }
        let (options, photos) = (&self.options.background, self.views.is_some());
        let draws_none =
            self.options.teacher.teacher == TeacherWhen::Off && options.background == BackgroundFrom::Auto;
        let measure = |loaded: &ImportedScene| count(&loaded.scene);
        self.report.stage(self.observer, loaded, measure, |loaded, details| {
            Ok(match draws_none {
                true => Outcome::Skipped("`teacher` off: no pictures are drawn"),
                false => background(loaded, photos, options, details),
            })
        })
    }

    /// Before all that costs: a budget of triangles is for the region, and removed parts must not hide it in pictures.
    fn crop(&mut self, loaded: ImportedScene) -> Result<ImportedScene> {
        let ImportedScene { scene, provenance, warnings, cameras } = loaded;
        let options = &self.options.crop;
        let seen_by = self.views.as_deref().map_or(&cameras[..], Views::cameras);
        let mut scene = self.report.stage(self.observer, scene, count, |scene, details| {
            crop(scene, seen_by, provenance.up, options, details)
        })?;
        if let Scene::Mesh(Mesh { texture: Some(texture), .. }) = &mut scene
            && !options.crop.is_empty()
        {
            *texture = texture.excerpt(0, self.options.texture.texture_size);
        }
        Ok(ImportedScene { scene, provenance, warnings, cameras })
    }

    /// Before stages that draw repeatedly, but after viewpoints are chosen from a sample of the triangles in
    /// their original order.
    fn arrange(&mut self, loaded: ImportedScene) -> Result<ImportedScene> {
        let ImportedScene { scene, provenance, warnings, cameras } = loaded;
        let is_drawn = self.views.is_some() || self.taught.is_some() || !cameras.is_empty();
        let order = self.options.order.order;
        let scene = self.report.stage(self.observer, scene, count, |scene, details| {
            Ok(arrange(scene, is_drawn, order, details))
        })?;
        Ok(ImportedScene { scene, provenance, warnings, cameras })
    }

    /// On the scene as it was trained: all other stages try to keep this look.
    fn teach(&mut self, loaded: &ImportedScene) -> Result<()> {
        let (options, photos) = (self.options, self.views.is_some());
        let measure = |_: &Option<Views>| count(&loaded.scene);
        let behind = self.report.details::<BackgroundDetails>().and_then(|found| found.behind());
        self.taught = self.report.stage(self.observer, None, measure, |views, details| {
            teacher(views, loaded, photos, behind, &options.teacher, &options.solid, details)
        })?;
        Ok(())
    }

    /// On the scene as it was trained, because all its triangles give better depths than fewer would.
    fn collide(&mut self, loaded: &ImportedScene) -> Result<Option<Mesh>> {
        let (options, observer) = (&self.options.collision, &mut *self.observer);
        let cameras = self.views.as_deref().map_or(&[][..], Views::cameras);
        let measure = |found: &Option<Mesh>| found.as_ref().map_or(count(&loaded.scene), count_mesh);
        self.report.long_stage(observer, None, measure, |found, details, progress| {
            collision(found, loaded, cameras, options, details, progress)
        })
    }

    /// The surface for smooth normals, from the scene as it was trained.
    fn face(&mut self, loaded: &ImportedScene) -> Result<()> {
        if self.options.lit.lit != Lit::Smooth {
            return Ok(());
        }
        let cameras = self.views.as_deref().map_or(&[][..], Views::cameras);
        let measure = |found: &Option<Mesh>| found.as_ref().map_or(count(&loaded.scene), count_mesh);
        let found = self.report.long_stage(
            self.observer,
            None,
            measure,
            |found, details: &mut SurfaceDetails, progress| {
                let how = SURFACE.for_scene(loaded.scene.triangle_count());
                *found = surface(loaded, cameras, &how, &Limits::DEFAULT, details, progress)?;
                Ok(match found {
                    Some(_) => Outcome::Changed(()),
                    None => Outcome::Skipped("the cameras see no connected surface"),
                })
            },
        )?;
        self.facing = found.map(Arc::new);
        Ok(())
    }

    /// Moves results of earlier stages to where the scene was placed.
    fn placed(&self, mut mesh: Mesh) -> Mesh {
        let transform = self.placement.unwrap_or_default().transform();
        mesh.positions.iter_mut().for_each(|position| *position = transform(*position));
        mesh
    }

    /// The part of the recipe that turns the input into opaque, coloured triangles.
    fn solidify(&mut self, scene: Scene, cameras: &[Camera]) -> Result<Mesh> {
        let options = self.options;
        // Cameras judge the importance of triangles better than size does.
        let pruning = match cameras.is_empty() {
            true => options.prune.clone(),
            false => PruneOptions { max_triangles: None, ..options.prune.clone() },
        };

        // Early, because every later stage costs per triangle and relies on finite geometry.
        let scene = self.report.stage(self.observer, scene, count, |scene, d| prune(scene, &pruning, d))?;
        let warning = self.report.details::<PruneDetails>().and_then(|details| details.warning());
        self.report.warnings.extend(warning);

        // On the soup, because it needs opacity and σ, which `color` drops.
        let scene = self.report.stage(self.observer, scene, count, |scene, details| match scene {
            Scene::Soup(soup) => solid(soup, &options.solid, details),
            Scene::Mesh(_) => Ok(Outcome::Skipped("the input is a mesh: its triangles are solid")),
        })?;

        // From here on an ordinary mesh in linear light.
        let scene = self.report.stage(self.observer, scene, count, |scene, details| {
            let Scene::Soup(soup) = scene else {
                return Ok(Outcome::Skipped("the input is a mesh: it has colours"));
            };
            *scene = Scene::Mesh(color(std::mem::take(soup), details)?);
            Ok(Outcome::Changed(()))
        })?;
        match scene {
            Scene::Mesh(mesh) => Ok(mesh),
            Scene::Soup(_) => unreachable!("the color stage makes a mesh of every soup"),
        }
    }

    /// As soon as triangles are opaque and hide each other, before later stages work on hidden ones.
    fn cull(&mut self, mesh: Mesh, cameras: &[Camera], chosen: bool, is_soft: bool) -> Result<Mesh> {
        let options = self.options;
        let mut views = either(&mut self.views, &mut self.taught);
        let budget = match &views {
            Some(_) => options.backdrop.scene_budget(options.prune.max_triangles),
            None => options.prune.max_triangles,
        };
        let unseen_options =
            UnseenOptions { keep_unseen: options.unseen.keep_unseen || chosen, ..options.unseen.clone() };
        let cameras = if chosen && budget.is_none() { &[] } else { cameras };
        self.report.long_stage(
            self.observer,
            mesh,
            count_mesh,
            |mesh, details: &mut UnseenDetails, progress| {
                // In a soft scene, `reshape` will still move the triangles that hide others.
                if !is_soft {
                    let progress = &mut progress.part(0.0, 0.5);
                    details.masked = masked(mesh, views.as_deref_mut(), &unseen_options, progress)?;
                }
                let spared = spared(mesh, budget);
                // A scene that keeps its shell gets no sphere, so its budget leaves no room for one.
                let most = if spared.is_empty() { budget } else { options.prune.max_triangles };
                let limit = FaceLimit { most, spared };
                let outcome = unseen(mesh, cameras, views, &unseen_options, &limit, details, progress)?;
                Ok(if details.masked.is_some_and(|dropped| dropped > 0) {
                    Outcome::Changed(())
                } else {
                    outcome
                })
            },
        )
    }

    /// As soon as drawings resemble the photos, and before anything is fitted to them.
    fn expose(&mut self, mesh: Mesh) -> Result<Mesh> {
        let (views, options) = (self.views.as_deref_mut(), &self.options.exposure);
        self.report
            .stage(self.observer, mesh, count_mesh, |mesh, details| exposure(mesh, views, options, details))
    }

    /// Inputs of the fitting; not computed when it is off.
    fn traits(&self, loaded: &ImportedScene) -> SceneTraits {
        let asks = self.options.reshape.reshape == ReshapeWhen::Auto;
        let looks_soft = || matches!(&loaded.scene, Scene::Soup(soup) if !is_solid(soup));
        SceneTraits {
            // Only soft scenes have a teacher.
            is_soft: self.taught.is_some() || asks && looks_soft(),
            is_closed: loaded.scene.shell_count() > 0,
        }
    }

    /// On the remaining triangles, by the cameras' pictures: before the backdrop, and before colours are
    /// fitted exactly.
    fn reshape(&mut self, mesh: Mesh, traits: SceneTraits) -> Result<Mesh> {
        let (views, options) = (either(&mut self.views, &mut self.taught), &self.options.reshape);
        self.report.long_stage(self.observer, mesh, count_mesh, |mesh, details, progress| {
            reshape(mesh, views, traits, options, details, progress)
        })
    }

    /// The shell counts as backdrop, outside the levels. A scene that is cropped, or baked without a
    /// backdrop, keeps its shell as part of the scene.
    fn part_shell(&mut self, mut mesh: Mesh) -> Result<Mesh> {
        let when = self.options.backdrop.backdrop;
        let cropped = !self.options.crop.crop.is_empty() && when == BackdropWhen::Auto;
        if cropped || when == BackdropWhen::Off {
            // It is part of the scene from here on.
            mesh.shell.clear();
            return Ok(mesh);
        }
        let mut behind = take_shell(&mut mesh, &self.watching);
        if either(&mut self.views, &mut self.taught).is_none() && self.options.refit.refit != RefitColors::Off
        {
            smooth_shell(&mut behind);
        }
        if mesh.face_count() == 0 {
            // Without other triangles the shell is the scene.
            return Ok(behind);
        }
        match &mut self.backdrop {
            Some(backdrop) => backdrop.append(behind)?,
            None => self.backdrop = Some(behind).filter(|behind| behind.face_count() > 0),
        }
        Ok(mesh)
    }

    /// Behind the remaining triangles, and before colours are taken from the photos: colours of holes belong
    /// to the sphere.
    fn back(&mut self, mesh: Mesh) -> Result<Mesh> {
        let options = &self.options.backdrop;
        let (given, mut views) = (self.backdrop.take(), either(&mut self.views, &mut self.taught));
        if options.backdrop == BackdropWhen::Sky {
            self.sky = Sky::behind(&mesh, given.as_ref(), views.as_deref_mut(), &self.watching)?;
        }
        let cropped = !self.options.crop.crop.is_empty() && options.backdrop == BackdropWhen::Auto;
        self.report.stage(self.observer, mesh, count_mesh, |mesh, details| match given {
            _ if cropped => Ok(Outcome::Skipped("the scene is cropped: its surroundings were removed")),
            Some(given) => keep_backdrop(mesh, given, options, details),
            None => backdrop(mesh, views, options, details),
        })
    }

    /// On the remaining triangles, because colours depend on which parts of them are visible. Faces from
    /// `behind` on are the backdrop.
    fn paint(&mut self, mesh: Mesh, behind: usize) -> Result<(Mesh, Option<UnseenColors>)> {
        let (views, options) = (either(&mut self.views, &mut self.taught), &self.options.refit);
        let mut unseen = None;
        let mesh = self.report.long_stage(self.observer, mesh, count_mesh, |mesh, details, progress| {
            let found = refit(mesh, behind, views, options, details, progress)?;
            unseen = found.unseen;
            Ok(found.outcome)
        })?;
        Ok((mesh, unseen))
    }

    /// On fitted colours: texels store differences from them.
    pub(super) fn texture(&mut self, mesh: Mesh, unseen: Option<UnseenColors>) -> Result<Mesh> {
        let (views, options) = (either(&mut self.views, &mut self.taught), &self.options.texture);
        self.report.long_stage(self.observer, mesh, count_mesh, |mesh, details, progress| {
            texture(mesh, views, unseen, options, details, progress)
        })
    }
}

/// The photos, or the pictures that replace them.
fn either<'v>(photos: &'v mut Option<&mut Views>, taught: &'v mut Option<Views>) -> Option<&'v mut Views> {
    photos.as_deref_mut().or(taught.as_mut())
}
