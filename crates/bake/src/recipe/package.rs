//! The end of the recipe: a painted mesh made ready for a file.

use super::Recipe;
use super::pictures::{Frame, Seen, Shared};
use crate::chunk::{ChunkDetails, ChunkOptions, chunk};
use crate::lit::lit;
use crate::lod::{FinishedLevel, LevelSource, LodOptions, lod};
use crate::options::BakeOptions;
use crate::order::order;
use crate::place::up::Evidence;
use crate::place::{PlaceDetails, place, placement_of};
use crate::viewpoint::viewpoint;
use crate::views::Views;
use crate::weld::weld;
use glam::DVec3;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Counts, Outcome, Report, StageProgress, generator};
use trisplat_scene::{Asset, Placement, Provenance, Result, frames};

impl Recipe<'_> {
    /// The part of the recipe that prepares a mesh for a file. Levels are given the frame of their
    /// scene.
    pub(super) fn package(
        &mut self,
        mesh: Mesh,
        mut provenance: Provenance,
        evidence: Evidence<'_>,
        seen: Seen<'_>,
        of_scene: Option<Frame>,
    ) -> Result<(Asset, Frame)> {
        let options = self.options;
        // In the frame of the cameras, and before stages that order faces.
        let mesh = self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| {
            lit(mesh, seen.watching, seen.facing, &options.lit, details)
        })?;

        // Before placing, while equal corners are still bitwise equal.
        let mesh = self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| {
            weld(mesh, &options.weld, details)
        })?;

        // Before stages with boxes, which must use the coordinates of the file.
        let mut how = of_scene.map(|frame| frame.placement);
        let subject = options.crop.is_subject();
        let mesh = self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| {
            let estimated =
                || placement_of(subject, mesh, &provenance, evidence, &options.place, details);
            let how = *how.get_or_insert_with(estimated);
            place(mesh, &mut provenance, how, details)
        })?;
        let placement = how.unwrap_or_default();
        let warning = self.report.details::<PlaceDetails>().and_then(|details| details.warning());
        self.report.warnings.extend(warning);

        provenance.generator = Some(generator());
        let asset = Asset { mesh, provenance, ..Asset::default() };

        // Before cuts, which change nothing visible.
        let asset = self.viewpoint(asset, evidence.cameras, &placement, of_scene)?;
        let viewpoint = asset.provenance.viewpoint;

        // Cuts first: an order is only useful inside the runs that an engine skips.
        let asset = self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            chunk(asset, &options.chunk, options.order.order, details)
        })?;
        let ordered = self.report.details::<ChunkDetails>().is_some_and(|details| details.ordered);
        let asset = self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            if ordered {
                Ok(Outcome::Skipped("`chunk` has put near faces near"))
            } else {
                order(asset, &options.order, details)
            }
        })?;
        debug_assert!(asset.mesh.validate().is_ok(), "{:?}", asset.mesh.validate());
        Ok((asset, Frame { placement, viewpoint }))
    }

    /// The first viewpoint; levels share that of the scene.
    fn viewpoint(
        &mut self,
        asset: Asset,
        cameras: &[Camera],
        placement: &Placement,
        of_scene: Option<Frame>,
    ) -> Result<Asset> {
        let known = of_scene.and_then(|frame| frame.viewpoint);
        let cameras = cameras.iter().map(|camera| frames::to_file(camera, placement, DVec3::ZERO));
        let cameras: Vec<Camera> = cameras.collect();
        self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            Ok(match known {
                Some(known) => {
                    asset.provenance.viewpoint = Some(known);
                    Outcome::Changed(())
                }
                None => viewpoint(asset, &cameras, details),
            })
        })
    }
}

// ---- Levels of detail, each painted and packaged like its scene ---------------------------------

/// Photos that a level of detail is evaluated on.
const EVALUATION_VIEWS: usize = 12;
/// Texels per pixel that a level has at least.
const MIN_DENSITY: f64 = 0.05;

/// How often the texture of a scene is halved for a level with this share of its triangles: it is
/// seen from farther away.
fn halvings(share: f64) -> usize {
    (-0.5 * share.clamp(1e-6, 1.0).log2()).round() as usize
}

impl Recipe<'_> {
    /// Coarser copies of the scene.
    pub(super) fn levels(
        &mut self,
        source: &LevelSource<'_>,
        options: &LodOptions,
        shared: &Shared<'_>,
        mut views: Option<&mut Views>,
    ) -> Result<Vec<Asset>> {
        let of_levels = if self.options.tiles.tiles {
            // They are cut again into tiles.
            BakeOptions { chunk: ChunkOptions::FAST, ..self.options.clone() }
        } else {
            self.options.clone()
        };
        let faces = source.mesh.face_count().max(1);
        let finish = |level: Mesh, mut progress: StageProgress<'_>| {
            let mut unread = Report::default();
            let mut own = of_levels.clone();
            // As many texels for a triangle as the scene has: seen from farther away, they are as
            // large in a picture.
            let share = level.face_count() as f64 / faces as f64;
            own.texture.texels_per_pixel =
                (own.texture.texels_per_pixel * share.sqrt()).max(MIN_DENSITY);
            let mut observer = progress.inner();
            let of_level = Recipe::new(&own, &mut unread, &mut observer);
            let excerpt = source.mesh.texture.as_ref().map(|_| halvings(share));
            of_level.level(level, shared, excerpt, views.as_deref_mut())
        };
        let measure = |levels: &Vec<Asset>| {
            let all = |of: fn(Counts) -> u64| levels.iter().map(|level| of(level.counts())).sum();
            Counts {
                triangles: all(|counts| counts.triangles),
                vertices: all(|counts| counts.vertices),
            }
        };
        self.report.long_stage(self.observer, Vec::new(), measure, |levels, details, progress| {
            lod(levels, source, options, finish, details, progress)
        })
    }

    /// A level, whose texture is halved `excerpt` times if its scene had one.
    fn level(
        mut self,
        mut level: Mesh,
        shared: &Shared<'_>,
        excerpt: Option<usize>,
        mut views: Option<&mut Views>,
    ) -> Result<FinishedLevel> {
        let in_tiles = self.options.tiles.tiles;
        // A level drawn alone must look like the scene, so it has the same backdrop; only tiles
        // share one.
        let faces = level.face_count();
        shared.backdrop.clone().map_or(Ok(()), |backdrop| level.append(backdrop))?;
        let (level, unseen) = self.refit(level, faces, views.as_deref_mut())?;
        let mut level = self.texture(level, unseen, views.as_deref_mut())?;
        if let (Some(times), Some(texture)) = (excerpt, &mut level.texture) {
            *texture = texture.excerpt(times, self.options.texture.texture_size);
        }
        let psnr = evaluate(&level, views)?;
        let backdrop = (level.face_count() - faces) as u32;
        let mut provenance = Provenance { backdrop, ..shared.provenance.clone() };
        // A texture holds the backdrop of its level.
        if level.texture.is_none() || in_tiles {
            level.split_off(faces);
            provenance.backdrop = 0;
            if let Some(backdrop) = shared.backdrop.clone().filter(|_| !in_tiles) {
                provenance.backdrop = backdrop.face_count() as u32;
                level.append(backdrop)?;
            }
        }
        let frame = Some(shared.frame);
        let (asset, _) =
            self.package(level, provenance, Evidence::default(), shared.seen, frame)?;
        Ok(FinishedLevel { asset, psnr })
    }
}

/// Mean PSNR of `mesh` on some of the pictures, dB, if there are any.
fn evaluate(mesh: &Mesh, views: Option<&mut Views>) -> Result<Option<f64>> {
    let views = views.filter(|views| !views.is_empty());
    views.map(|views| views.mean_psnr(mesh, &views.evenly_spaced(EVALUATION_VIEWS))).transpose()
}
