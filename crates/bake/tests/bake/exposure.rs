//! The stage `exposure` on photos that a phone took, against what the phone did.

use std::path::Path;
use trisplat_bake::{Bake, BakeOptions, ExposureDetails, Views, refit::RefitDetails};
use trisplat_dataset::{Dataset, DatasetOptions, exposure::ExposureUse};
use trisplat_fixtures::phone::{TENTH_OF_A_STOP, error_of_gains, phone_sample, true_spread};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_scene::report::{Report, StageDetails};

/// Reports of the stages on the sample scene, baked with these photos as if `trained` on shares of
/// their corrections.
fn baked(photos: &Path, exposure: ExposureUse, trained: Option<[f32; 3]>) -> Report {
    let options = DatasetOptions::default();
    let mut views = Views::new(&Dataset::load(photos, &options).unwrap(), &options);
    let scene = trisplat_fixtures::sample("soups/trained.ply");
    let mut scene = formats::read(&scene, &ReadOptions::default()).unwrap();
    scene.provenance.exposure = trained;
    let mut bake = BakeOptions::default();
    bake.exposure.exposure = exposure;
    let mut report = Report::new("bake");
    Bake::new(&bake).photos(&mut views).report(&mut report).run([scene]).unwrap();
    report
}

#[test]
fn what_a_phone_did_is_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let truth = phone_sample(folder.path());
    let report = baked(folder.path(), ExposureUse::Auto, Some([1.0; 3]));
    let details = report.details::<ExposureDetails>().unwrap();
    let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    let names: Vec<&str> = dataset.train().map(|view| view.name.as_str()).collect();
    let spread = f64::from(details.verdict.unwrap().exposure);
    assert!((spread - true_spread(&truth, &names)).abs() < TENTH_OF_A_STOP, "{spread}");
    let error = error_of_gains(&truth, &names, &details.exposures.gains);
    assert!(error < 0.02, "gains are off by {error}");
    let falloff = details.exposures.falloff[0];
    assert!((falloff - 0.4).abs() < 0.08, "{falloff}");
    // Colours that are fitted agree with photos that were held out.
    let off = baked(folder.path(), ExposureUse::Off, Some([1.0; 3]));
    assert!(off.details::<ExposureDetails>().is_none_or(|details| details.verdict.is_none()));
    let psnr = |report: &Report| report.details::<RefitDetails>().unwrap().psnr_corner.unwrap();
    assert!(psnr(&report) > psnr(&off) + 2.0, "{} {}", psnr(&report), psnr(&off));
}

#[test]
fn photos_are_corrected_as_in_the_training_of_the_scene() {
    let photos = trisplat_fixtures::sample("dataset");
    let stage = |exposure, trained| {
        let report = baked(&photos, exposure, trained);
        report.stages.into_iter().find(|stage| stage.name == ExposureDetails::STAGE).unwrap()
    };
    let skipped = stage(ExposureUse::Auto, None).skipped.unwrap();
    assert!(skipped.contains("trained on photos as they are"), "{skipped}");
    for (exposure, trained) in
        [(ExposureUse::Auto, Some([0.5; 3])), (ExposureUse::Shares([0.5; 3]), None)]
    {
        let details = stage(exposure, trained).details_as::<ExposureDetails>().unwrap();
        let verdict = details.verdict.unwrap();
        assert!(verdict.strengths.to_array() == [0.5; 3] && verdict.exposure < 0.02, "{verdict:?}");
    }
}
