//! Compares a hardened scene with the original; only the better file is written.

use trisplat_bake::{BackgroundDetails, Bake, BakeOptions, Views, pictures};
use trisplat_dataset::{Dataset, DatasetOptions, ShrunkSize, View};
use trisplat_scene::math::evenly_spaced::evenly_spaced;
use trisplat_scene::{
    Asset, ImportedScene, Placement, Result,
    report::{Report, StageDetails, StageReport, counted},
};
use trisplat_teacher::{Viewpoints, between};
use trisplat_train::{HardenedGain, TrainDetails};

/// Most views that are compared.
const JUDGED: usize = 16;

/// A scene before hardening, and views that hardening does not train on.
pub(super) struct Unhardened {
    scene: ImportedScene,
    views: Views,
    placement: Placement,
    /// The size that photos were shrunk to, if the views are photos.
    photo_size: Option<ShrunkSize>,
}

impl Unhardened {
    /// Of `scene`, which may be an object before the colour `behind` it: with the held-out photos of `photos`, or with its soft pictures from places between those that hardening looks from.
    pub(super) fn new(
        scene: &ImportedScene,
        behind: Option<[f32; 3]>,
        photos: Option<&Dataset>,
        how: &DatasetOptions,
    ) -> Self {
        let placement = scene.provenance.placement;
        let views = match photos.filter(|photos| photos.views.iter().any(|view| view.test)) {
            Some(photos) => {
                let held_out = photos.views.iter().filter(|view| view.test);
                let views = held_out.map(|view| View { test: false, ..view.clone() }).collect();
                let mut views = Views::new(&Dataset { views, ..photos.clone() }, how);
                views.transform(&placement);
                views
            }
            None => {
                let known = Viewpoints::of(scene, 0).map_or(Vec::new(), |viewpoints| viewpoints.cameras);
                let cameras = between(&between(&known));
                let judged = evenly_spaced(cameras.len(), JUDGED).map(|i| cameras[i]);
                pictures(scene, behind, judged.collect())
            }
        };
        let photo_size =
            photos.and_then(|photos| ShrunkSize::of(photos.views.iter().filter(|view| view.test)));
        Self { scene: scene.clone(), views, placement, photo_size }
    }

    /// Mean PSNR of `asset`, in the frame of the scene, dB.
    fn psnr(&mut self, asset: &Asset) -> Result<f64> {
        let back = self.placement.inverse().then(&asset.provenance.placement);
        let mut mesh = asset.mesh.clone();
        mesh.positions.iter_mut().for_each(|position| *position = back.to_world(*position));
        let chosen = self.views.evenly_spaced(JUDGED);
        self.views.mean_psnr(&mesh, &chosen)
    }

    /// Bakes the scene without hardening and returns the better of the two; `report` is then that of its bake, with the comparison in the
    /// details of the training.
    ///
    /// Errors: those of the bake.
    pub(super) fn better(
        mut self,
        hardened: Asset,
        photos: Option<&mut Views>,
        options: &BakeOptions,
        report: &mut Report,
    ) -> Result<Asset> {
        if self.views.is_empty() {
            return Ok(hardened);
        }
        let mut plain_report = Report::new("bake");
        plain_report
            .stages
            .extend(report.stages.iter().filter(|stage| stage.name == BackgroundDetails::STAGE).cloned());
        let plain = Bake::new(options).photos(photos).report(&mut plain_report).run([self.scene.clone()])?;
        let (psnr_before, psnr_after) = (self.psnr(&plain)?, self.psnr(&hardened)?);
        let views = self.views.len().min(JUDGED) as u64;
        let (photo_size, kept) = (self.photo_size, psnr_after >= psnr_before);
        let gain = HardenedGain { views, psnr_before, psnr_after, photo_size, kept };
        let is_training = |stage: &StageReport| stage.name == TrainDetails::STAGE;
        let is_earlier = |stage: &StageReport| is_training(stage) || stage.name == BackgroundDetails::STAGE;
        if let Some(training) = report.stages.iter_mut().find(|stage| is_training(stage)) {
            let value = serde_json::to_value(gain).unwrap_or_default();
            training.details.insert("hardened".to_owned(), value);
        }
        if gain.kept {
            return Ok(hardened);
        }
        report.stages.retain(is_earlier);
        report.stages.append(&mut plain_report.stages);
        report.warnings.append(&mut plain_report.warnings);
        report.warnings.push(format!(
            "`harden` made it worse: {psnr_after:.1} dB, {psnr_before:.1} dB without, on {} not trained on{}; the file holds the \
             scene baked without it",
            counted(views, "view"),
            ShrunkSize::beside(photo_size)
        ));
        Ok(plain)
    }
}
