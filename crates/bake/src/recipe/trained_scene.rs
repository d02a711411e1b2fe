//! The scene as it was trained: the part to bake, and the pictures and surfaces that need all its
//! triangles.

use super::Recipe;
use super::values::TargetPictures;
use crate::background::{BackgroundDetails, BackgroundFrom, background};
use crate::crop::{CropDetails, crop};
use crate::lit::{Lit, SURFACE};
use crate::order::arrange;
use crate::reshape::{ReshapeWhen, SceneTraits};
use crate::simplify::simplify;
use crate::teacher::{TeacherDetails, TeacherWhen, is_solid, solid_views, stored_cameras, teacher};
use crate::views::Views;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::stored_cameras::decode_cameras;
use trisplat_scene::{ImportedScene, Limits, Result, Scene};
use trisplat_surface::{SurfaceDetails, collision, surface};

impl Recipe<'_> {
    /// Finds the colour behind the scene: on all of it, as it was trained, because the borders of
    /// its pictures show the background. `known`: found by hardening before it trained.
    pub(super) fn background(
        &mut self,
        loaded: ImportedScene,
        known: Option<BackgroundDetails>,
        pictures: &TargetPictures<'_>,
    ) -> Result<(ImportedScene, BackgroundDetails)> {
        if let Some(known) = known {
            return Ok((loaded, known));
        }
        let options = &self.options.background;
        let has_photos = pictures.photo_views.is_some();
        let draws_none = self.options.teacher.teacher == TeacherWhen::Off
            && options.background == BackgroundFrom::Auto;
        self.report.stage(self.observer, loaded, ImportedScene::counts, |loaded, details| {
            Ok(if draws_none {
                Outcome::Skipped("`teacher` off: no pictures are drawn")
            } else {
                background(loaded, has_photos, options, details)
            })
        })
    }

    /// Before all that costs: a budget of triangles is for the region, and removed parts must not
    /// hide it in pictures.
    pub(super) fn crop(
        &mut self,
        loaded: ImportedScene,
        pictures: &TargetPictures<'_>,
    ) -> Result<(ImportedScene, CropDetails)> {
        let options = &self.options.crop;
        let named = decode_cameras(&loaded.provenance.cameras);
        let (mut loaded, details) = self.report.stage(
            self.observer,
            loaded,
            ImportedScene::counts,
            |loaded, details| {
                let stored = if loaded.cameras.is_empty() { &named } else { &loaded.cameras };
                let cameras = pictures.photo_views.as_deref().map_or(&stored[..], Views::cameras);
                let up = loaded.provenance.up;
                let (outcome, _) = crop(&mut loaded.scene, cameras, up, options, details)?;
                Ok(outcome)
            },
        )?;
        if let Scene::Mesh(Mesh { texture: Some(texture), .. }) = &mut loaded.scene
            && options.is_cropped()
        {
            *texture = texture.excerpt(0, self.options.texture.texture_size);
        }
        Ok((loaded, details))
    }

    /// Before cameras rank triangles: edges of connected ones collapse until the limit leaves
    /// nothing to drop.
    pub(super) fn simplify(
        &mut self,
        loaded: ImportedScene,
        input_backdrop: Option<&Mesh>,
        pictures: &TargetPictures<'_>,
    ) -> Result<ImportedScene> {
        let backdrop = self.counted_triangles(input_backdrop) as u64;
        let backdrop = backdrop.min(self.budget.surroundings.unwrap_or(0));
        // Photos may ask for a sphere behind holes.
        let limit = if pictures.photo_views.is_some() && backdrop == 0 {
            self.options.backdrop.scene_budget(self.budget.total)
        } else {
            self.budget.total.map(|total| (total - backdrop).max(1))
        };
        self.stage(loaded, ImportedScene::counts, |loaded, details| {
            simplify(&mut loaded.scene, limit, details)
        })
    }

    /// Cameras that rank the triangles of a mesh without any, for a limit that it exceeds: those of
    /// the viewpoint in its file. Its triangles share no vertices then, if hardly any do.
    pub(super) fn viewpoint_cameras(
        &self,
        mut loaded: ImportedScene,
        input_backdrop: Option<&Mesh>,
        pictures: &TargetPictures<'_>,
    ) -> (ImportedScene, Vec<Camera>) {
        let backdrop_triangles = input_backdrop.map_or(0, Mesh::face_count);
        let all = (loaded.scene.triangle_count() + backdrop_triangles) as u64;
        let exceeds_limit = self.budget.total.is_some_and(|total| total < all);
        let is_ranked = exceeds_limit && self.options.teacher.teacher == TeacherWhen::Auto;
        let has_cameras = pictures.photo_views.is_some() || !loaded.cameras.is_empty();
        let cameras = match &loaded.scene {
            Scene::Mesh(_) if is_ranked && !has_cameras => stored_cameras(&loaded),
            _ => Vec::new(),
        };
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && !cameras.is_empty()
            && 2 * mesh.vertex_count() > 5 * mesh.face_count()
        {
            *mesh = std::mem::take(mesh).unshared();
        }
        (loaded, cameras)
    }

    /// Draws the scene as it was trained: all later stages try to keep this look.
    pub(super) fn teacher(
        &mut self,
        loaded: &ImportedScene,
        input_backdrop: Option<&Mesh>,
        background: &BackgroundDetails,
        pictures: &TargetPictures<'_>,
        viewpoint_cameras: &[Camera],
    ) -> Result<Option<Views>> {
        let options = self.options;
        let has_photos = pictures.photo_views.is_some();
        let color = background.object_color();
        let measure = |_: &Option<Views>| loaded.scene.counts();
        let backdrop = input_backdrop.filter(|_| !self.drops_surroundings());
        let solid = solid_views(&loaded.scene, backdrop, viewpoint_cameras)?;
        self.stage(None, measure, |views, details: &mut TeacherDetails| {
            let Some(solid) = solid else {
                let solid_options = &options.solid;
                let options = &options.teacher;
                return teacher(views, loaded, has_photos, color, options, solid_options, details);
            };
            details.pictures = Some(solid.len() as u64);
            details.size_px = viewpoint_cameras.first().map(|camera| camera.size.to_array());
            *views = Some(solid);
            Ok(Outcome::Changed(()))
        })
    }

    /// Orders triangles so that they draw fast: before stages that draw repeatedly, but after
    /// viewpoints are chosen from a sample of the triangles in their original order.
    pub(super) fn arrange(
        &mut self,
        loaded: ImportedScene,
        pictures: &TargetPictures<'_>,
    ) -> Result<ImportedScene> {
        let has_pictures = pictures.photo_views.is_some() || pictures.drawn_views.is_some();
        let order = self.options.order.order;
        self.stage(loaded, ImportedScene::counts, |loaded, details| {
            let is_drawn = has_pictures || !loaded.cameras.is_empty();
            Ok(arrange(&mut loaded.scene, is_drawn, order, details))
        })
    }

    /// Properties of the scene that decide how triangles are fitted; not computed when that is off.
    pub(super) fn traits(
        &self,
        loaded: &ImportedScene,
        pictures: &TargetPictures<'_>,
    ) -> SceneTraits {
        let is_auto = self.options.reshape.reshape == ReshapeWhen::Auto;
        let is_soup = matches!(loaded.scene, Scene::Soup(_));
        let looks_soft = || matches!(&loaded.scene, Scene::Soup(soup) if !is_solid(soup));
        SceneTraits {
            // Only soft scenes have a teacher.
            is_soft: pictures.drawn_views.is_some() && is_soup || is_auto && looks_soft(),
            is_closed: loaded.scene.shell_count() > 0,
        }
    }

    /// On the scene as it was trained, because all its triangles give better depths than fewer
    /// would.
    pub(super) fn collision(
        &mut self,
        loaded: &ImportedScene,
        pictures: &TargetPictures<'_>,
    ) -> Result<Option<Mesh>> {
        let options = &self.options.collision;
        let cameras = pictures.photo_cameras();
        let counts = loaded.scene.counts();
        let measure = |collider: &Option<Mesh>| collider.as_ref().map_or(counts, Mesh::counts);
        self.long_stage(None, measure, |collider, details, progress| {
            collision(collider, loaded, cameras, options, details, progress)
        })
    }

    /// The surface for smooth normals, from the scene as it was trained.
    pub(super) fn normal_surface(
        &mut self,
        loaded: &ImportedScene,
        pictures: &TargetPictures<'_>,
    ) -> Result<Option<Mesh>> {
        if self.options.lit.lit != Lit::Smooth {
            return Ok(None);
        }
        let cameras = pictures.photo_cameras();
        let counts = loaded.scene.counts();
        let measure = |found: &Option<Mesh>| found.as_ref().map_or(counts, Mesh::counts);
        self.long_stage(None, measure, |found, details: &mut SurfaceDetails, progress| {
            let options = SURFACE.for_scene(loaded.scene.triangle_count());
            *found = surface(loaded, cameras, &options, &Limits::DEFAULT, details, progress)?;
            Ok(match found {
                Some(_) => Outcome::Changed(()),
                None => Outcome::Skipped("the cameras see no connected surface"),
            })
        })
    }
}
