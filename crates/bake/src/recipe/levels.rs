//! Levels of detail, each painted and packaged like its scene.

use super::Recipe;
use super::values::{FrameSource, LevelContext, SceneCameras};
use crate::chunk::ChunkOptions;
use crate::lod::{FinishedLevel, LevelSource, LodOptions, lod};
use crate::options::BakeOptions;
use crate::views::Views;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Counts, Report, StageProgress};
use trisplat_scene::{Asset, Provenance, Result};

/// Photos that a level of detail is evaluated on.
const EVALUATION_VIEWS: usize = 12;
/// Minimum texels per pixel of a level.
const MIN_DENSITY: f64 = 0.05;

/// Levels that will be made.
pub(super) struct LevelPlan {
    options: LodOptions,
    /// The scene before it is painted; empty without levels.
    unpainted: Mesh,
    /// The painted backdrop, before placement.
    backdrop: Option<Mesh>,
}

impl LevelPlan {
    /// Keeps the backdrop of `mesh`, its faces from `scene_faces` on, for the levels.
    pub(super) fn keep_backdrop(&mut self, mesh: &Mesh, scene_faces: usize) {
        if mesh.face_count() > scene_faces && !self.options.lod.is_empty() {
            self.backdrop = Some(mesh.clone().split_off(scene_faces));
        }
    }
}

/// Number of times that the texture of a scene is halved for a level with this share of its
/// triangles, which is seen from farther away.
fn texture_halvings(share: f64) -> usize {
    (-0.5 * share.clamp(1e-6, 1.0).log2()).round() as usize
}

impl Recipe<'_> {
    /// Levels are made from the scene at this point, and placed like it.
    pub(super) fn level_plan(&self, mesh: &Mesh) -> LevelPlan {
        let options = if self.options.tiles.tiles {
            LodOptions { lod: self.options.tiles.shares(mesh.face_count()) }
        } else {
            self.options.lod.clone()
        };
        let unpainted = if options.lod.is_empty() { Mesh::default() } else { mesh.clone() };
        LevelPlan { options, unpainted, backdrop: None }
    }

    /// Coarser copies of the scene. `cameras` decide the importance of triangles.
    pub(super) fn levels(
        &mut self,
        plan: &LevelPlan,
        context: &LevelContext<'_>,
        cameras: &SceneCameras,
        mut views: Option<&mut Views>,
    ) -> Result<Vec<Asset>> {
        let source = LevelSource {
            mesh: &plan.unpainted,
            cameras: &cameras.visibility,
            enlarge: self.options.unseen.enlarge,
            is_soup: self.is_soup,
        };
        let level_options = if self.options.tiles.tiles {
            // They are cut again into tiles.
            BakeOptions { chunk: ChunkOptions::FAST, ..self.options.clone() }
        } else {
            self.options.clone()
        };
        let faces = source.mesh.face_count().max(1);
        let backdrop = plan.backdrop.as_ref();
        let finish = |level: Mesh, mut progress: StageProgress<'_>| {
            let mut discarded_report = Report::default();
            let mut options = level_options.clone();
            // As many texels for a triangle as the scene has: seen from farther away, they are as
            // large in a picture.
            let share = level.face_count() as f64 / faces as f64;
            options.texture.texels_per_pixel =
                (options.texture.texels_per_pixel * share.sqrt()).max(MIN_DENSITY);
            let mut observer = progress.inner();
            let recipe = Recipe::new(&options, &mut discarded_report, &mut observer);
            let halvings = source.mesh.texture.as_ref().map(|_| texture_halvings(share));
            recipe.level(level, backdrop, context, halvings, views.as_deref_mut())
        };
        let measure = |levels: &Vec<Asset>| Counts {
            triangles: levels.iter().map(|level| level.counts().triangles).sum(),
            vertices: levels.iter().map(|level| level.counts().vertices).sum(),
        };
        self.long_stage(Vec::new(), measure, |levels, details, progress| {
            lod(levels, &source, &plan.options, finish, details, progress)
        })
    }

    /// A level, whose texture is halved `halvings` times if its scene had one.
    fn level(
        mut self,
        mut level: Mesh,
        backdrop: Option<&Mesh>,
        context: &LevelContext<'_>,
        halvings: Option<usize>,
        mut views: Option<&mut Views>,
    ) -> Result<FinishedLevel> {
        let in_tiles = self.options.tiles.tiles;
        // A level drawn alone must look like the scene, so it has the same backdrop; only tiles
        // share one.
        let faces = level.face_count();
        if let Some(backdrop) = backdrop {
            level.append(backdrop.clone())?;
        }
        let (level, unseen_colors) = self.refit(level, faces, views.as_deref_mut())?;
        let level = self.sh(level, faces, views.as_deref_mut())?;
        let mut level = self.texture(level, unseen_colors, views.as_deref_mut())?;
        if let (Some(halvings), Some(texture)) = (halvings, &mut level.texture) {
            *texture = texture.excerpt(halvings, self.options.texture.texture_size);
        }
        let psnr = evaluate(&level, views)?;
        let backdrop_faces = (level.face_count() - faces) as u32;
        let mut provenance = Provenance { backdrop_faces, ..context.provenance.clone() };
        // A texture holds the backdrop of its level.
        if level.texture.is_none() || in_tiles {
            level.split_off(faces);
            provenance.backdrop_faces = 0;
            if let Some(backdrop) = backdrop.filter(|_| !in_tiles) {
                provenance.backdrop_faces = backdrop.face_count() as u32;
                level.append(backdrop.clone())?;
            }
        }
        let frame = FrameSource::Scene(context.frame);
        let (asset, ..) = self.package(level, provenance, context.normals, frame)?;
        Ok(FinishedLevel { asset, psnr })
    }
}

/// Mean PSNR of `mesh` on some of the pictures, dB, if there are any.
fn evaluate(mesh: &Mesh, views: Option<&mut Views>) -> Result<Option<f64>> {
    let Some(views) = views.filter(|views| !views.is_empty()) else { return Ok(None) };
    let chosen = views.evenly_spaced(EVALUATION_VIEWS);
    views.mean_psnr(mesh, &chosen).map(Some)
}
