//! The end of the recipe: a painted mesh made ready for a file.

use super::Recipe;
use super::values::{FileFrame, FrameSource, NormalSources};
use crate::chunk::chunk;
use crate::lit::lit;
use crate::order::order;
use crate::place::evidence::Evidence;
use crate::place::{place, placement_of};
use crate::viewpoint::{ViewpointDetails, viewpoint};
use crate::weld::weld;
use glam::DVec3;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, generator};
use trisplat_scene::{Asset, Placement, Provenance, Result, frames};

impl Recipe<'_> {
    /// The part of the recipe that prepares a mesh for a file.
    pub(super) fn package(
        &mut self,
        mesh: Mesh,
        mut provenance: Provenance,
        normals: NormalSources<'_>,
        frame: FrameSource<'_>,
    ) -> Result<(Asset, FileFrame, ViewpointDetails)> {
        let (evidence, scene_frame) = match frame {
            FrameSource::Evidence(evidence) => (evidence, None),
            FrameSource::Scene(frame) => (Evidence::default(), Some(frame)),
        };
        let options = self.options;
        // In the frame of the cameras, and before stages that order faces.
        let mesh = self.stage(mesh, Mesh::counts, |mesh, details| {
            lit(mesh, normals.cameras, normals.surface, &options.lit, details)
        })?;

        // Before placing, while equal corners are still bitwise equal.
        let mesh =
            self.stage(mesh, Mesh::counts, |mesh, details| weld(mesh, &options.weld, details))?;

        // Before stages with boxes, which must use the coordinates of the file.
        let mut placement = scene_frame.map(|frame| frame.placement);
        let is_subject = options.crop.is_subject();
        let (mesh, place_details) =
            self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| {
                let options = &options.place;
                let estimate =
                    || placement_of(is_subject, mesh, &provenance, evidence, options, details);
                let placement = *placement.get_or_insert_with(estimate);
                place(mesh, &mut provenance, placement, details)
            })?;
        let placement = placement.unwrap_or_default();
        self.report.warnings.extend(place_details.warning());

        provenance.generator = Some(generator());
        let asset = Asset { mesh, provenance, ..Asset::default() };

        // Before cuts, which change nothing visible.
        let (asset, viewpoint_details) =
            self.viewpoint(asset, evidence.cameras, &placement, scene_frame)?;
        let viewpoint = asset.provenance.viewpoint;

        let asset = self.chunk(asset)?;
        debug_assert!(asset.mesh.validate().is_ok(), "{:?}", asset.mesh.validate());
        Ok((asset, FileFrame { placement, viewpoint }, viewpoint_details))
    }

    /// The first viewpoint; levels share that of the scene.
    fn viewpoint(
        &mut self,
        asset: Asset,
        cameras: &[Camera],
        placement: &Placement,
        scene_frame: Option<FileFrame>,
    ) -> Result<(Asset, ViewpointDetails)> {
        let scene_viewpoint = scene_frame.and_then(|frame| frame.viewpoint);
        let cameras = cameras.iter().map(|camera| frames::to_file(camera, placement, DVec3::ZERO));
        let cameras: Vec<Camera> = cameras.collect();
        self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
            if scene_viewpoint.is_some() {
                asset.provenance.viewpoint = scene_viewpoint;
                return Ok(Outcome::Changed(()));
            }
            Ok(viewpoint(asset, &cameras, details))
        })
    }

    /// Cuts first: an order is only useful inside the runs that an engine skips.
    fn chunk(&mut self, asset: Asset) -> Result<Asset> {
        let options = self.options;
        let (asset, chunks) =
            self.report.stage(self.observer, asset, Asset::counts, |asset, details| {
                chunk(asset, &options.chunk, options.order.order, details)
            })?;
        self.stage(asset, Asset::counts, |asset, details| {
            if chunks.ordered {
                return Ok(Outcome::Skipped("`chunk` has put near faces near"));
            }
            order(asset, &options.order, details)
        })
    }
}
