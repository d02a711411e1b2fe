//! The end of the recipe: a painted mesh made ready for a file, and its levels of detail.

use super::{Recipe, either};
use crate::bvh::{BvhOptions, bvh};
use crate::chunk::{ChunkDetails, ChunkOptions, chunk};
use crate::counts::{count_levels, count_mesh};
use crate::lit::lit;
use crate::lod::{FinishedLevel, LevelSource, LodOptions, lod};
use crate::options::BakeOptions;
use crate::order::{FaceOrder, order};
use crate::place::up::Evidence;
use crate::place::{PlaceDetails, place, placement};
use crate::viewpoint::viewpoint;
use crate::weld::weld;
use glam::DVec3;
use trisplat_scene::{
    Asset, Provenance, Result,
    mesh::Mesh,
    placed,
    report::{Outcome, Report, StageProgress, generator},
};

/// Photos that a level of detail is evaluated on.
const EVALUATION_VIEWS: usize = 12;
/// Texels per pixel that a level has at least.
const LEAST_DENSITY: f64 = 0.05;

/// How often the texture of a scene is halved for a level with this share of its triangles: it is seen from farther away.
fn halvings(share: f64) -> usize {
    (-0.5 * share.clamp(1e-6, 1.0).log2()).round() as usize
}

impl Recipe<'_> {
    /// The part of the recipe that prepares a mesh for a file.
    pub(super) fn package(&mut self, mesh: Mesh, mut provenance: Provenance) -> Result<Asset> {
        let options = self.options;
        // In the frame of the cameras, and before stages that order faces.
        let (watching, facing) = (&self.watching, self.facing.as_deref());
        let mesh = self.report.stage(self.observer, mesh, count_mesh, |mesh, details| {
            lit(mesh, watching, facing, &options.lit, details)
        })?;

        // Before placing, while equal corners are still bitwise equal.
        let mesh = self
            .report
            .stage(self.observer, mesh, count_mesh, |mesh, details| weld(mesh, &options.weld, details))?;

        // Before stages with boxes, which must use the coordinates of the file.
        let placed = &mut self.placement;
        let wanted = options.place.under(options.crop.is_subject());
        let points = self.views.as_deref().map_or(&[][..], |views| views.points());
        let known = Evidence { cameras: &self.cameras, points };
        let mesh = self.report.stage(self.observer, mesh, count_mesh, |mesh, details| {
            let how = *placed.get_or_insert_with(|| placement(mesh, &provenance, known, &wanted, details));
            place(mesh, &mut provenance, how, details)
        })?;
        let warning = self.report.details::<PlaceDetails>().and_then(|details| details.warning());
        self.report.warnings.extend(warning);

        provenance.generator = Some(generator());
        let asset = Asset { mesh, provenance, ..Asset::default() };

        // Before cuts, which change nothing visible.
        let asset = self.look(asset)?;

        // Cuts first: a hierarchy and an order are only useful inside the runs that an engine skips. A hierarchy
        // has an order of its own.
        let within = if options.bvh.bvh { FaceOrder::None } else { options.order.order };
        let asset = self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            chunk(asset, &options.chunk, within, details)
        })?;
        let ordered = self.report.details::<ChunkDetails>().is_some_and(|details| details.ordered);
        let asset = self
            .report
            .stage(self.observer, asset, Asset::counts, |asset, details| bvh(asset, &options.bvh, details))?;
        // Last: it keeps the leaf order of a hierarchy.
        let asset =
            self.report.stage(self.observer, asset, Asset::counts, |asset, details| match ordered {
                true => Ok(Outcome::Skipped("`chunk` has put near faces near")),
                false => order(asset, &options.order, details),
            })?;
        debug_assert!(asset.mesh.validate().is_ok(), "{:?}", asset.mesh.validate());
        Ok(asset)
    }

    /// The first viewpoint; levels share that of the scene.
    fn look(&mut self, asset: Asset) -> Result<Asset> {
        let placement = self.placement.unwrap_or_default();
        let cameras = self.cameras.iter().map(|camera| placed::to_file(camera, &placement, DVec3::ZERO));
        let (cameras, known) = (cameras.collect::<Vec<_>>(), self.viewpoint);
        let asset = self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            Ok(match known {
                Some(known) => {
                    asset.provenance.viewpoint = Some(known);
                    Outcome::Changed(())
                }
                None => viewpoint(asset, &cameras, details),
            })
        })?;
        self.viewpoint = asset.provenance.viewpoint;
        Ok(asset)
    }

    /// Coarser copies of the scene, each painted and packaged like the scene.
    pub(super) fn levels(
        &mut self,
        source: &LevelSource<'_>,
        options: &LodOptions,
        provenance: &Provenance,
    ) -> Result<Vec<Asset>> {
        let in_tiles = self.options.tiles.tiles;
        let of_levels = match in_tiles {
            // They are cut again into tiles, so chunks and a hierarchy would be useless.
            true => {
                BakeOptions { chunk: ChunkOptions::FAST, bvh: BvhOptions::DEFAULT, ..self.options.clone() }
            }
            false => self.options.clone(),
        };
        let (mut views, placement) = (either(&mut self.views, &mut self.taught), self.placement);
        let viewpoint = self.viewpoint;
        let behind = self.backdrop.take();
        let (watching, facing) = (self.watching.clone(), self.facing.clone());
        let density = of_levels.texture.texels_per_pixel;
        let finish = |mut level: Mesh, mut progress: StageProgress<'_>| {
            let mut unread = Report::default();
            let views = views.as_deref_mut();
            let mut own = of_levels.clone();
            // As many texels for a triangle as the scene has: seen from farther away, they are as large in a picture.
            let share = level.face_count() as f64 / source.mesh.face_count().max(1) as f64;
            own.texture.texels_per_pixel = (density * share.sqrt()).max(LEAST_DENSITY);
            let mut observer = progress.inner();
            let of_level = Recipe::new(&own, views, &mut unread, &mut observer);
            let mut of_level = Recipe {
                placement,
                viewpoint,
                watching: watching.clone(),
                facing: facing.clone(),
                ..of_level
            };
            // A level drawn alone must look like the scene, so it has the same backdrop; only tiles share
            // one.
            let faces = level.face_count();
            behind.clone().map_or(Ok(()), |backdrop| level.append(backdrop))?;
            let (level, unseen) = of_level.paint(level, faces)?;
            let mut level = of_level.texture(level, unseen)?;
            if let (Some(_), Some(texture)) = (&source.mesh.texture, &mut level.texture) {
                *texture = texture.excerpt(halvings(share), of_levels.texture.texture_size);
            }
            let psnr = of_level.evaluate(&level)?;
            let mut provenance = provenance.clone();
            provenance.backdrop = (level.face_count() - faces) as u32;
            // A texture holds the backdrop of its level.
            if level.texture.is_none() || in_tiles {
                level.split_off(faces);
                provenance.backdrop = 0;
                if let Some(backdrop) = behind.clone().filter(|_| !in_tiles) {
                    provenance.backdrop = backdrop.face_count() as u32;
                    level.append(backdrop)?;
                }
            }
            Ok(FinishedLevel { asset: of_level.package(level, provenance)?, psnr })
        };
        self.report.long_stage(self.observer, Vec::new(), count_levels, |levels, details, progress| {
            lod(levels, source, options, finish, details, progress)
        })
    }

    /// Mean PSNR of `mesh` on some of the photos, dB, if there are any.
    fn evaluate(&mut self, mesh: &Mesh) -> Result<Option<f64>> {
        let views = either(&mut self.views, &mut self.taught).filter(|views| !views.is_empty());
        views.map(|views| views.mean_psnr(mesh, &views.evenly_spaced(EVALUATION_VIEWS))).transpose()
    }
}
