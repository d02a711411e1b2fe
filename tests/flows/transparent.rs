//! Photos of an object that are transparent around it.

use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat::{Asset, Dataset, DatasetOptions, TrainOptions, TrainPreset};
use trisplat_bake::{BackdropDetails, Bake, BakeOptions, Views};
use trisplat_dataset::Masks;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Soup, image::RgbImage, math::metric, report::Report};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::{Quality, TrainInputs, Trained};

/// A run without a teacher.
fn trained(dataset: &Dataset, options: &TrainOptions) -> Trained {
    TrainInputs::new(dataset, options).run(&mut |_| Continue(())).unwrap()
}

fn written(folder: &Path) {
    let options = SyntheticOptions {
        views: 24,
        width: 64,
        points: 600,
        transparent: true,
        ..SyntheticOptions::default()
    };
    trisplat_synthetic::write(folder, &options).unwrap();
}

fn options() -> TrainOptions {
    TrainOptions { steps: 400, max_triangles: 2000, ..TrainOptions::preset(TrainPreset::Solid) }
}

/// Mean PSNR over the held-out photos with `background` behind the object, dB.
fn psnr_over(code: u8, asset: &Asset, dataset: &Dataset) -> f64 {
    let back = asset.provenance.placement;
    let mut mesh = asset.mesh.clone();
    mesh.positions.iter_mut().for_each(|p| *p = back.to_world(*p));
    let options =
        SolidRasterOptions { background: [f32::from(code) / 255.0; 3], samples: 2, near: 0.01 };
    let held_out: Vec<_> = dataset.views.iter().filter(|view| view.test).collect();
    let psnr = |view: &&trisplat_dataset::View| {
        let photo = view.photo.decode().unwrap().recomposited([code; 3]);
        metric::psnr(
            &photo.rgb,
            &SolidRasterizer::new().render(&mesh, &view.camera, &options).rgb,
            None,
        )
    };
    held_out.iter().map(psnr).sum::<f64>() / held_out.len() as f64
}

fn baked(soup: Soup, dataset: &Dataset, how: &DatasetOptions) -> (Asset, Report) {
    let options = BakeOptions::default();
    let mut report = Report::default();
    let mut views = Views::new(dataset, how);
    let asset = Bake::new(&options).photos(&mut views).report(&mut report).run([soup]).unwrap();
    (asset, report)
}

#[test]
fn an_object_of_transparent_photos_stands_before_any_background() {
    let folder = tempfile::tempdir().unwrap();
    written(folder.path());
    let cut = DatasetOptions::default();
    let dataset = Dataset::load(folder.path(), &cut).unwrap();
    assert!(dataset.views.iter().all(|view| view.photo.is_cut()));
    let Trained { soup, scores, .. } = trained(&dataset, &options());
    assert_eq!(soup.shell_count(), 0, "there is nothing behind it");
    let (asset, report) = baked(soup, &dataset, &cut);
    assert_eq!(asset.provenance.backdrop_faces, 0);
    let [black, white] = [0, 255].map(|code| psnr_over(code, &asset, &dataset));

    // As it was: photos over black, so that black triangles do for nothing.
    let over = DatasetOptions { masks: Masks::Off, ..cut.clone() };
    let opaque = Dataset::load(folder.path(), &over).unwrap();
    assert!(!opaque.views.iter().any(|view| view.photo.is_cut()));
    let (before, _) = baked(trained(&opaque, &options()).soup, &opaque, &over);
    let white_before = psnr_over(255, &before, &dataset);
    assert!(white > white_before + 3.0, "{white:.2} dB over white, {white_before:.2} dB as it was");
    assert!((black - white).abs() < 5.0, "{black:.2} dB over black, {white:.2} dB over white");
    // What training reports is judged on both.
    let reported = scores.iter().map(|score| score.psnr).sum::<f64>() / scores.len() as f64;
    assert!((reported - (black + white) / 2.0).abs() < 3.0, "{reported:.2} {black:.2} {white:.2}");
    let details: BackdropDetails = report.details().unwrap_or_default();
    assert!(!details.kept);
}

#[test]
fn an_object_is_judged_over_black_and_over_white() {
    let size = glam::UVec2::new(16, 16);
    let alpha: Vec<u8> = (0..256).map(|i| if i % 16 < 8 { 255 } else { 0 }).collect();
    let rgb: Vec<[u8; 3]> =
        alpha.iter().map(|a| if *a > 0 { [200, 100, 50] } else { [0; 3] }).collect();
    let photo = RgbImage { size, rgb: rgb.clone(), alpha: Some(alpha) };
    // A black slab where nothing is shows over white only.
    let slab = |_: [f32; 3]| Ok(RgbImage { size, rgb: rgb.clone(), alpha: None });
    let exact =
        |background: [f32; 3]| Ok(photo.recomposited(background.map(|c| (255.0 * c) as u8)));
    let slab = Quality::over_two(&photo, slab).unwrap();
    let exact = Quality::over_two(&photo, exact).unwrap();
    assert!(exact.psnr > 60.0 && slab.psnr < exact.psnr - 20.0, "{slab:?} {exact:?}");
}
