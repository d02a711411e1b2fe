//! The end of the recipe: a painted mesh made ready for a file.

use super::Recipe;
use super::shared::{Frame, Seen};
use crate::bvh::bvh;
use crate::chunk::{ChunkDetails, chunk};
use crate::counts::count_mesh;
use crate::lit::lit;
use crate::order::{FaceOrder, order};
use crate::place::under::placement_of;
use crate::place::up::Evidence;
use crate::place::{PlaceDetails, place};
use crate::viewpoint::viewpoint;
use crate::weld::weld;
use glam::DVec3;
use trisplat_scene::{
    Asset, Placement, Provenance, Result,
    camera::Camera,
    mesh::Mesh,
    placed,
    report::{Outcome, generator},
};

impl Recipe<'_> {
    /// The part of the recipe that prepares a mesh for a file. Levels are given the frame of their scene.
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
        let mesh = self.report.stage(self.observer, mesh, count_mesh, |mesh, details| {
            lit(mesh, seen.watching, seen.facing, &options.lit, details)
        })?;

        // Before placing, while equal corners are still bitwise equal.
        let mesh = self
            .report
            .stage(self.observer, mesh, count_mesh, |mesh, details| weld(mesh, &options.weld, details))?;

        // Before stages with boxes, which must use the coordinates of the file.
        let mut how = of_scene.map(|frame| frame.placement);
        let subject = options.crop.is_subject();
        let mesh = self.report.stage(self.observer, mesh, count_mesh, |mesh, details| {
            let estimated = || placement_of(subject, mesh, &provenance, evidence, &options.place, details);
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
        let cameras = cameras.iter().map(|camera| placed::to_file(camera, placement, DVec3::ZERO));
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
