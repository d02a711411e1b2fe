//! The recipe: the stages in their order, with reasons.

mod behind;
mod package;
mod pictures;

use super::backdrop::BackdropWhen;
use super::background::{BackgroundDetails, BackgroundFrom, background};
use super::crop::crop;
use super::exposure::exposure;
use super::lit::{Lit, SURFACE};
use super::lod::{LevelSource, LodOptions};
use super::merge::{merge, share_world};
use super::misfit::misfit;
use super::options::BakeOptions;
use super::place::PlaceOptions;
use super::place::up::Evidence;
use super::prune::{PruneDetails, PruneOptions, prune};
use super::refit::{UnseenColors, refit};
use super::reshape::{ReshapeWhen, SceneTraits, reshape};
use super::shell::{joined, recognise_shell, spared};
use super::sides::sides;
use super::solid::solid;
use super::teacher::{TeacherDetails, TeacherWhen, is_solid, own_cameras, solid_views, teacher};
use super::texture::{TextureDetails, texture};
use super::tiles::tiles;
use super::unseen::{FaceLimit, UnseenDetails, UnseenOptions, masked, unseen};
use super::views::Views;
use crate::order::arrange;
use crate::solid::color;
use pictures::{Cameras, Pictures, Seen, Shared};
use std::ops::ControlFlow::Continue;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, Report, StageDetails, StageEvent, StageObserver, counted};
use trisplat_scene::stored_cameras::{decode_cameras, encode_cameras};
use trisplat_scene::{Asset, Error, ImportedScene, Limits, Placement, Provenance, Result, Scene};
use trisplat_surface::{SurfaceDetails, collision, surface};

/// Calls the stages: what one finds out reaches the next as an argument.
pub(super) struct Recipe<'a> {
    options: &'a BakeOptions,
    report: &'a mut Report,
    observer: StageObserver<'a>,
}

impl<'a> Recipe<'a> {
    pub(super) fn new(
        options: &'a BakeOptions,
        report: &'a mut Report,
        observer: StageObserver<'a>,
    ) -> Self {
        Self { options, report, observer }
    }

    /// Bakes inputs, merged. `photos` are left in the frame of the scene.
    pub(super) fn run(
        mut self,
        inputs: Vec<ImportedScene>,
        mut photos: Option<&mut Views>,
    ) -> Result<Asset> {
        let is_single = inputs.len() == 1;
        let mut loaded = self.merged(inputs, photos.is_some())?;
        let Provenance { generator, trainer, up, .. } = &loaded.provenance;
        let says_nothing = generator.is_none() && trainer.is_none() && up.is_none();
        let silent = says_nothing && matches!(loaded.scene, Scene::Mesh(_));
        let given = loaded.take_backdrop();
        if let Some(photos) = photos.as_deref_mut() {
            photos.transform(&loaded.provenance.placement);
            photos.show_part(self.is_cropped());
        }
        let mut pictures = Pictures { photos, drawn: None };
        let loaded = self.background(loaded, &pictures)?;
        let loaded = self.crop(loaded, &pictures)?;
        let (loaded, own) = self.own_cameras(loaded, given.as_ref(), &pictures);
        let given = self.few_given(given, &loaded.scene, &own)?;
        let apart = self.counted(given.as_ref());
        pictures.drawn = self.teacher(&loaded, given.as_ref(), &pictures, &own)?;
        let loaded = self.arrange(loaded, &pictures)?;
        let traits = self.traits(&loaded, &pictures);
        let collision = self.collision(&loaded, &pictures)?;
        let facing = self.surface(&loaded, &pictures)?;
        let ImportedScene { mut scene, mut provenance, warnings, cameras } = loaded;
        self.report.warnings.extend(warnings);
        let cameras = Cameras::new(cameras, &pictures, own);
        if let Scene::Soup(soup) = &mut scene {
            // Only the teacher draws more.
            soup.truncate_sh(0);
        }
        let mesh = self.solidify(scene, apart, &cameras.watching)?;
        let mesh = self.few_shell(mesh, apart, &cameras.watching)?;
        let mesh = self.unseen(mesh, given.as_ref(), pictures.any(), &cameras, traits.is_soft)?;
        self.misfit(&mesh, pictures.photos.as_deref_mut())?;
        let mesh = self.exposure(mesh, provenance.exposure, pictures.photos.as_deref_mut())?;
        let mesh = self.reshape(mesh, pictures.any(), traits)?;
        let mesh = self.sides(mesh, &cameras.of_photos)?;
        let (mesh, shell) = self.part_shell(mesh, &cameras.watching);
        let shell = if is_single {
            self.whole_shell(shell, &mesh, apart, &cameras.watching)
        } else {
            shell
        };
        let shell = self.soft_shell(shell, mesh.face_count() + apart, pictures.any().is_some());
        let behind = joined(given, shell)?;

        // Levels are made from the scene at this point, and placed like it.
        let faces = mesh.face_count();
        let lod = if self.options.tiles.tiles {
            LodOptions { lod: self.options.tiles.shares(faces) }
        } else {
            self.options.lod.clone()
        };
        let unpainted = if lod.lod.is_empty() { Mesh::default() } else { mesh.clone() };
        let sky = self.sky(&mesh, behind.as_ref(), pictures.any(), &cameras.watching)?;
        let mesh = self.backdrop(mesh, behind, pictures.any())?;
        let (mesh, unseen) = self.refit(mesh, faces, pictures.any())?;
        let of_levels = mesh.face_count() > faces && !lod.lod.is_empty();
        let behind = of_levels.then(|| mesh.clone().split_off(faces));
        let count_behind = (mesh.face_count() - faces) as u32;
        let mesh = self.texture(mesh, unseen, pictures.any())?;
        let closer = self.report.details::<TextureDetails>().and_then(|details| details.warning());
        self.report.warnings.extend(closer.filter(|_| mesh.texture.is_some()));

        let seen = Seen { watching: &cameras.watching, facing: facing.as_ref() };
        if !cameras.of_photos.is_empty() {
            provenance.cameras = encode_cameras(&cameras.of_photos);
        }
        let from = Provenance { backdrop: count_behind, ..provenance.clone() };
        let evidence = Evidence { cameras: &cameras.of_photos, points: pictures.points() };
        let (asset, frame) = self.package(mesh, from, evidence, seen, None)?;
        if silent
            && self.options.place.up == PlaceOptions::DEFAULT.up
            && cameras.of_photos.is_empty()
        {
            let hint = "the file does not say what is up, taken as −y: `up` y if it lies on its head, z if it lies on its side";
            self.report.warnings.push(hint.to_owned());
        }
        let source = LevelSource {
            mesh: &unpainted,
            cameras: &cameras.watching,
            enlarge: self.options.unseen.enlarge,
        };
        let shared = Shared { provenance, seen, frame, backdrop: behind };
        let levels = self.levels(&source, &lod, &shared, pictures.any())?;
        // From the finished scene: tiles hold final triangles.
        let collision = collision.map(|mesh| placed(mesh, &frame.placement));
        let backdrop_apart = self.options.backdrop.backdrop == BackdropWhen::File;
        let mut asset = Asset { levels, collision, backdrop_apart, ..asset };
        self.put_sky(&mut asset, sky, &frame.placement);
        let options = &self.options.tiles;
        self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            tiles(asset, options, details)
        })
    }

    /// The inputs as one scene.
    fn merged(&mut self, inputs: Vec<ImportedScene>, photos: bool) -> Result<ImportedScene> {
        let inputs = inputs.into_iter().map(|loaded| self.untextured(loaded, photos));
        let mut inputs: Vec<ImportedScene> = inputs.collect();
        // For each input separately: two scenes side by side have no common middle.
        let when = self.options.backdrop.backdrop;
        inputs.iter_mut().for_each(|loaded| recognise_shell(&mut loaded.scene, when));
        merge(self.of_one_kind(inputs)?)
    }

    /// A mesh keeps its texture unless photos decide what triangles show: then its faces get the
    /// mean of their texels first.
    fn untextured(&mut self, mut loaded: ImportedScene, photos: bool) -> ImportedScene {
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && photos
            && mesh.drop_texture()
            && !self.options.texture.is_wanted()
        {
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
        if inputs.iter().any(|loaded| loaded.provenance.placement != inputs[0].provenance.placement)
        {
            share_world(&mut inputs);
        }
        let mut options = self.options.clone();
        options.prune.max_triangles = None;
        let mut unread = Report::default();
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let mut of_soup = Recipe::new(&options, &mut unread, &mut nobody);
        let mut solidified = |mut loaded: ImportedScene| match &mut loaded.scene {
            Scene::Soup(soup) => {
                soup.truncate_sh(0);
                Ok(ImportedScene {
                    scene: Scene::Mesh(of_soup.solidify(loaded.scene, 0, &[])?),
                    ..loaded
                })
            }
            Scene::Mesh(_) => Ok(loaded),
        };
        inputs.into_iter().map(&mut solidified).collect()
    }

    /// On the scene as it was trained and in full, because the borders of its pictures show the
    /// background.
    fn background(
        &mut self,
        loaded: ImportedScene,
        pictures: &Pictures<'_>,
    ) -> Result<ImportedScene> {
        // Hardening looked for it before it trained.
        if self.report.stages.iter().any(|stage| stage.name == BackgroundDetails::STAGE) {
            return Ok(loaded);
        }
        let options = &self.options.background;
        let photos = pictures.photos.is_some();
        let draws_none = self.options.teacher.teacher == TeacherWhen::Off
            && options.background == BackgroundFrom::Auto;
        self.report.stage(self.observer, loaded, ImportedScene::counts, |loaded, details| {
            Ok(if draws_none {
                Outcome::Skipped("`teacher` off: no pictures are drawn")
            } else {
                background(loaded, photos, options, details)
            })
        })
    }

    /// Before all that costs: a budget of triangles is for the region, and removed parts must not
    /// hide it in pictures.
    fn crop(&mut self, loaded: ImportedScene, pictures: &Pictures<'_>) -> Result<ImportedScene> {
        let options = &self.options.crop;
        let of_file = decode_cameras(&loaded.provenance.cameras);
        let mut loaded = self.report.stage(
            self.observer,
            loaded,
            ImportedScene::counts,
            |loaded, details| {
                let stored = if loaded.cameras.is_empty() { &of_file } else { &loaded.cameras };
                let seen_by = pictures.photos.as_deref().map_or(&stored[..], Views::cameras);
                let cropped =
                    crop(&mut loaded.scene, seen_by, loaded.provenance.up, options, details);
                cropped.map(|(outcome, _)| outcome)
            },
        )?;
        if let Scene::Mesh(Mesh { texture: Some(texture), .. }) = &mut loaded.scene
            && !options.crop.is_empty()
        {
            *texture = texture.excerpt(0, self.options.texture.texture_size);
        }
        Ok(loaded)
    }

    /// Before stages that draw repeatedly, but after viewpoints are chosen from a sample of the
    /// triangles in their original order.
    fn arrange(&mut self, loaded: ImportedScene, pictures: &Pictures<'_>) -> Result<ImportedScene> {
        let has_pictures = pictures.photos.is_some() || pictures.drawn.is_some();
        let order = self.options.order.order;
        self.report.stage(self.observer, loaded, ImportedScene::counts, |loaded, details| {
            let is_drawn = has_pictures || !loaded.cameras.is_empty();
            Ok(arrange(&mut loaded.scene, is_drawn, order, details))
        })
    }

    /// Cameras that rank the triangles of a mesh without any, for a limit that it exceeds: where
    /// its file says that one looks from. Its triangles share no vertices then, if hardly any do.
    fn own_cameras(
        &self,
        mut loaded: ImportedScene,
        given: Option<&Mesh>,
        pictures: &Pictures<'_>,
    ) -> (ImportedScene, Vec<Camera>) {
        let all = (loaded.scene.triangle_count() + given.map_or(0, Mesh::face_count)) as u64;
        let is_limited = self.options.prune.max_triangles.is_some_and(|most| most < all);
        let is_ranked = is_limited && self.options.teacher.teacher == TeacherWhen::Auto;
        let knows = pictures.photos.is_some() || !loaded.cameras.is_empty();
        let own = match &loaded.scene {
            Scene::Mesh(_) if is_ranked && !knows => own_cameras(&loaded),
            _ => Vec::new(),
        };
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && !own.is_empty()
            && 2 * mesh.vertex_count() > 5 * mesh.face_count()
        {
            *mesh = std::mem::take(mesh).unshared();
        }
        (loaded, own)
    }

    /// On the scene as it was trained: all other stages try to keep this look.
    fn teacher(
        &mut self,
        loaded: &ImportedScene,
        given: Option<&Mesh>,
        pictures: &Pictures<'_>,
        own: &[Camera],
    ) -> Result<Option<Views>> {
        let options = self.options;
        let photos = pictures.photos.is_some();
        let measure = |_: &Option<Views>| loaded.scene.counts();
        let solid = solid_views(&loaded.scene, given.filter(|_| !self.is_cropped()), own)?;
        let behind = self.report.details::<BackgroundDetails>().and_then(|found| found.behind());
        self.report.stage(self.observer, None, measure, |views, details: &mut TeacherDetails| {
            match solid {
                Some(solid) => {
                    details.pictures = Some(solid.len() as u64);
                    details.size_px = own.first().map(|camera| camera.size.to_array());
                    *views = Some(solid);
                    Ok(Outcome::Changed(()))
                }
                None => teacher(
                    views,
                    loaded,
                    photos,
                    behind,
                    &options.teacher,
                    &options.solid,
                    details,
                ),
            }
        })
    }

    /// On the scene as it was trained, because all its triangles give better depths than fewer
    /// would.
    fn collision(
        &mut self,
        loaded: &ImportedScene,
        pictures: &Pictures<'_>,
    ) -> Result<Option<Mesh>> {
        let options = &self.options.collision;
        let observer = &mut *self.observer;
        let cameras = pictures.of_photos();
        let measure =
            |found: &Option<Mesh>| found.as_ref().map_or(loaded.scene.counts(), Mesh::counts);
        self.report.long_stage(observer, None, measure, |found, details, progress| {
            collision(found, loaded, cameras, options, details, progress)
        })
    }

    /// The surface for smooth normals, from the scene as it was trained.
    fn surface(&mut self, loaded: &ImportedScene, pictures: &Pictures<'_>) -> Result<Option<Mesh>> {
        if self.options.lit.lit != Lit::Smooth {
            return Ok(None);
        }
        let cameras = pictures.of_photos();
        let measure =
            |found: &Option<Mesh>| found.as_ref().map_or(loaded.scene.counts(), Mesh::counts);
        self.report.long_stage(
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
        )
    }

    /// The part of the recipe that turns the input into opaque, coloured triangles.
    fn solidify(&mut self, scene: Scene, apart: usize, cameras: &[Camera]) -> Result<Mesh> {
        let options = self.options;
        // Cameras judge the importance of triangles better than size does.
        let most = options.prune.max_triangles.filter(|_| cameras.is_empty());
        let max_triangles = most.map(|most| most.saturating_sub(apart as u64).max(1));
        let pruning = PruneOptions { max_triangles, ..options.prune.clone() };

        // Early, because every later stage costs per triangle and relies on finite geometry.
        let is_mesh = matches!(scene, Scene::Mesh(_));
        let scene = self
            .report
            .stage(self.observer, scene, Scene::counts, |scene, d| prune(scene, &pruning, d))?;
        let details = self.report.details::<PruneDetails>();
        let faint = details.as_ref().map_or(0, |details| details.faint);
        self.report.warnings.extend(details.and_then(|details| details.warning()));
        // A soup sheds its faint triangles as its trainer does.
        if is_mesh && faint > 0 {
            let faint = counted(faint, "triangle");
            let least = pruning.min_opacity;
            self.report.warnings.push(format!(
                "removed {faint} whose alpha is below {least}; `min_opacity` 0 keeps them"
            ));
        }

        // On the soup, because it needs opacity and σ, which `color` drops.
        let scene =
            self.report.stage(
                self.observer,
                scene,
                Scene::counts,
                |scene, details| match scene {
                    Scene::Soup(soup) => solid(soup, &options.solid, details),
                    Scene::Mesh(_) => {
                        Ok(Outcome::Skipped("the input is a mesh: its triangles are solid"))
                    }
                },
            )?;

        // From here on an ordinary mesh in linear light.
        let scene = self.report.stage(self.observer, scene, Scene::counts, |scene, details| {
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

    /// As soon as triangles are opaque and hide each other, before later stages work on hidden
    /// ones.
    fn unseen(
        &mut self,
        mut mesh: Mesh,
        given: Option<&Mesh>,
        mut views: Option<&mut Views>,
        cameras: &Cameras,
        is_soft: bool,
    ) -> Result<Mesh> {
        let options = self.options;
        let apart = self.counted(given);
        // Chosen cameras have not seen everything: they rank triangles, but drop none as unseen.
        let chosen = cameras.of_photos.is_empty();
        let mut left =
            options.prune.max_triangles.map(|most| most.saturating_sub(apart as u64).max(1));
        // Gaps show what is behind them.
        let is_limited = apart > 0 && left.is_some_and(|left| left < mesh.face_count() as u64);
        let is_plain = |mesh: &Mesh| {
            mesh.indices.is_empty() && mesh.texture.is_none() && mesh.shell.is_empty()
        };
        let behind =
            given.filter(|given| is_limited && is_plain(given) && is_plain(&mesh)).cloned();
        let is_behind = behind.is_some();
        if let Some(behind) = behind {
            mesh.append(Mesh { shell: vec![true; apart], ..behind })?;
            left = options.prune.max_triangles;
        }
        let budget = match &views {
            Some(_) if apart == 0 => options.backdrop.scene_budget(left),
            _ => left,
        };
        let unseen_options = UnseenOptions {
            keep_unseen: options.unseen.keep_unseen || chosen,
            ..options.unseen.clone()
        };
        let cameras = if chosen && budget.is_none() { &[] } else { &cameras.watching[..] };
        let mut kept = self.report.long_stage(
            self.observer,
            mesh,
            Mesh::counts,
            |mesh, details: &mut UnseenDetails, progress| {
                // In a soft scene, `reshape` will still move the triangles that hide others.
                if !is_soft {
                    let progress = &mut progress.part(0.0, 0.5);
                    details.masked = masked(mesh, views.as_deref_mut(), &unseen_options, progress)?;
                }
                let spared = spared(mesh, left);
                // A scene that keeps its shell gets no sphere, so its budget leaves no room for
                // one.
                let most = if spared.is_empty() { budget } else { left };
                let limit = FaceLimit { most, spared };
                let outcome =
                    unseen(mesh, cameras, views, &unseen_options, &limit, details, progress)?;
                Ok(if details.masked.is_some_and(|dropped| dropped > 0) {
                    Outcome::Changed(())
                } else {
                    outcome
                })
            },
        )?;
        if is_behind {
            kept.take_shell();
        }
        Ok(kept)
    }

    /// On the first opaque triangles, so that photos of another scene cost no more than this. Drawn
    /// pictures always show their scene.
    fn misfit(&mut self, mesh: &Mesh, photos: Option<&mut Views>) -> Result<()> {
        let Some(photos) = photos.filter(|photos| !photos.is_drawn()) else {
            return Ok(());
        };
        let Some(misfit) = misfit(mesh, !self.options.crop.crop.is_empty(), photos)? else {
            return Ok(());
        };
        if self.options.force_dataset {
            self.report.warnings.push(format!("`dataset` has {misfit}"));
            return Ok(());
        }
        let wants = "the data set it was trained on, in the same coordinates, or `force_dataset`";
        Err(Error::invalid("dataset", misfit, wants))
    }

    /// Before anything is fitted to the photos.
    fn exposure(
        &mut self,
        mesh: Mesh,
        trained: Option<[f32; 3]>,
        photos: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.exposure;
        self.report.stage(self.observer, mesh, Mesh::counts, |_, details| {
            exposure(trained, photos, options, details)
        })
    }

    /// Inputs of the fitting; not computed when it is off.
    fn traits(&self, loaded: &ImportedScene, pictures: &Pictures<'_>) -> SceneTraits {
        let asks = self.options.reshape.reshape == ReshapeWhen::Auto;
        let is_soup = matches!(loaded.scene, Scene::Soup(_));
        let looks_soft = || matches!(&loaded.scene, Scene::Soup(soup) if !is_solid(soup));
        SceneTraits {
            // Only soft scenes have a teacher.
            is_soft: pictures.drawn.is_some() && is_soup || asks && looks_soft(),
            is_closed: loaded.scene.shell_count() > 0,
        }
    }

    /// On the remaining triangles, by the cameras' pictures: before the backdrop, and before
    /// colours are fitted exactly.
    fn reshape(
        &mut self,
        mesh: Mesh,
        views: Option<&mut Views>,
        traits: SceneTraits,
    ) -> Result<Mesh> {
        let options = &self.options.reshape;
        self.report.long_stage(self.observer, mesh, Mesh::counts, |mesh, details, progress| {
            reshape(mesh, views, traits, options, details, progress)
        })
    }

    /// On triangles that no longer move, and before levels are made and colours are fitted to what
    /// is drawn.
    fn sides(&mut self, mesh: Mesh, cameras: &[Camera]) -> Result<Mesh> {
        let options = &self.options.sides;
        self.report.long_stage(self.observer, mesh, Mesh::counts, |mesh, details, progress| {
            sides(mesh, cameras, options, details, progress)
        })
    }

    /// On the remaining triangles, because colours depend on which parts of them are visible. Faces
    /// from `behind` on are the backdrop.
    fn refit(
        &mut self,
        mesh: Mesh,
        behind: usize,
        views: Option<&mut Views>,
    ) -> Result<(Mesh, Option<UnseenColors>)> {
        let options = &self.options.refit;
        let mut unseen = None;
        let mesh = self.report.long_stage(
            self.observer,
            mesh,
            Mesh::counts,
            |mesh, details, progress| {
                let found = refit(mesh, behind, views, options, details, progress)?;
                unseen = found.unseen;
                Ok(found.outcome)
            },
        )?;
        Ok((mesh, unseen))
    }

    /// On fitted colours: texels store differences from them.
    fn texture(
        &mut self,
        mesh: Mesh,
        unseen: Option<UnseenColors>,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.texture;
        self.report.long_stage(self.observer, mesh, Mesh::counts, |mesh, details, progress| {
            texture(mesh, views, unseen, options, details, progress)
        })
    }
}

/// Moves a result of an earlier stage to where the scene was placed.
fn placed(mut mesh: Mesh, placement: &Placement) -> Mesh {
    let transform = placement.transform();
    mesh.positions.iter_mut().for_each(|position| *position = transform(*position));
    mesh
}
