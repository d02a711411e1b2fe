//! A soft scene whose own pictures take the place of photos.

use glam::Vec3;
use trisplat_bake::{
    Bake, BakeOptions, BakePreset, ReshapeOptions, SOLID_SIGMA, SolidOptions, TeacherDetails,
    TeacherOptions, UpChoice, Views, is_solid, softness, teacher,
};
use trisplat_fixtures::soups::soup_of;
pub(crate) use trisplat_fixtures::soups::{ball, ball_cameras as cameras};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{
    Asset, Error, ImportedScene, Region, Scene, UpAxis, UpDirection,
    camera::Camera,
    math::metric,
    report::{Outcome, Report},
};
use trisplat_teacher::{Teacher, ViewpointKind};

pub(crate) fn soft(cameras: Vec<Camera>) -> ImportedScene {
    ImportedScene { cameras, ..ImportedScene::from(ball()) }
}

fn baked(scene: ImportedScene, teacher: TeacherOptions) -> (Asset, Report) {
    // Fitting triangles has tests of its own.
    baked_with(
        scene,
        BakeOptions { teacher, reshape: ReshapeOptions::OFF, ..BakeOptions::default() },
    )
}

pub(crate) fn baked_with(scene: ImportedScene, mut options: BakeOptions) -> (Asset, Report) {
    // The frame of the input, so that its cameras see the output.
    options.place.up = UpChoice::Given(UpDirection::Axis(UpAxis::Y));
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([scene]).unwrap();
    (asset, report)
}

pub(crate) fn skipped<'r>(report: &'r Report, stage: &str) -> Option<&'r str> {
    report
        .stages
        .iter()
        .find(|s| s.name == stage)
        .unwrap_or_else(|| panic!("no {stage}"))
        .skipped
        .as_deref()
}

/// PSNR of the baked scene against soft pictures from cameras between those it was taught from, dB.
pub(crate) fn psnr(asset: &Asset) -> f64 {
    let eyes: Vec<Camera> = cameras();
    let mut teacher = Teacher::new(ball(), &eyes, &SoftOptions::default());
    let drawing = SolidRasterOptions { samples: 4, ..SolidRasterOptions::default() };
    let between = |i: u32| {
        let eye = Vec3::new((i as f32 * 0.4 + 0.2).sin(), 0.1, (i as f32 * 0.4 + 0.2).cos()) * 3.0;
        eyes[0].with_look_at(eye, Vec3::ZERO, Vec3::NEG_Y)
    };
    let one = |i| {
        let soft = teacher.picture(&between(i));
        let solid = SolidRasterizer::new().render(&asset.mesh, &between(i), &drawing);
        metric::psnr(&soft.rgb, &solid.rgb, None)
    };
    (0..15).map(one).sum::<f64>() / 15.0
}

#[test]
fn refit_of_a_soft_scene_improves_on_its_pictures() {
    for stored in [cameras(), Vec::new()] {
        let kind = if stored.is_empty() { ViewpointKind::Around } else { ViewpointKind::Stored };
        let (without, report) = baked(soft(stored.clone()), TeacherOptions::OFF);
        assert_eq!(skipped(&report, "teacher"), Some("`teacher` off"));
        let (with, report) = baked(soft(stored), TeacherOptions::DEFAULT);
        let details: TeacherDetails = report.details().unwrap();
        assert_eq!((skipped(&report, "teacher"), details.viewpoints), (None, Some(kind)));
        assert!(details.pictures.unwrap() >= 16 && details.covered.unwrap() < 0.9, "{details:?}");
        assert!(details.softness.unwrap().psnr < 25.0, "{details:?}");
        assert_eq!(skipped(&report, "refit"), None);
        // Nothing is put behind an object.
        assert!(skipped(&report, "backdrop").unwrap().contains("object"));
        let before = psnr(&without);
        let after = psnr(&with);
        assert!(after > before + 3.0, "{kind:?}: {before:.2} dB, {after:.2} dB taught");
        if kind != ViewpointKind::Stored {
            // Cameras that we chose drop nothing.
            assert_eq!(with.mesh.face_count(), without.mesh.face_count());
        }
    }
}

#[test]
fn a_solid_scene_and_a_fast_bake_are_not_taught() {
    let mut solid = ball();
    solid.opacity.fill(1.0);
    solid.sigma.fill(SOLID_SIGMA);
    assert!(is_solid(&solid) && !is_solid(&ball()));
    let loaded = ImportedScene { cameras: cameras(), ..ImportedScene::from(solid) };
    assert_eq!(softness(&loaded, &SolidOptions::DEFAULT).unwrap(), None);
    let (with, report) = baked(loaded.clone(), TeacherOptions::DEFAULT);
    assert_eq!(skipped(&report, "teacher"), Some("the scene is solid already"));
    assert!(with.mesh == baked(loaded, TeacherOptions::OFF).0.mesh);
    assert_eq!(BakeOptions::preset(BakePreset::Fast).teacher, TeacherOptions::OFF);
    let mesh = ImportedScene { cameras: cameras(), ..ImportedScene::from(Scene::Mesh(with.mesh)) };
    assert!(skipped(&baked(mesh, TeacherOptions::DEFAULT).1, "teacher").unwrap().contains("mesh"));
}

#[test]
fn pictures_that_are_given_win() {
    let eyes = cameras();
    let mut teacher = Teacher::new(ball(), &eyes, &SoftOptions::default());
    let pictures: Vec<_> = eyes.iter().map(|camera| teacher.weighted_picture(camera)).collect();
    let mut report = Report::default();
    let mut views = Views::drawn(eyes.clone(), pictures);
    let options = BakeOptions::default();
    Bake::new(&options).photos(&mut views).report(&mut report).run([soft(eyes)]).unwrap();
    assert!(skipped(&report, "teacher").unwrap().contains("already"));
    // The report has its softness all the same.
    assert!(report.details::<TeacherDetails>().unwrap().softness.is_some());
}

#[test]
fn what_a_crop_cuts_off_is_not_in_the_pictures() {
    // A wall of one grey before the ball.
    let mut soup = ball();
    let wall = [[Vec3::new(-9.0, -9.0, 2.0), Vec3::new(9.0, -9.0, 2.0), Vec3::new(0.0, 9.0, 2.0)]];
    soup.append(soup_of(wall.map(|corners| (corners, 1.0, SOLID_SIGMA))));
    let loaded = ImportedScene { cameras: cameras(), ..ImportedScene::from(soup) };
    let mut options = BakeOptions { reshape: ReshapeOptions::OFF, ..BakeOptions::default() };
    options.crop.crop = vec![Region::Box([-1.5; 3], [1.5; 3])];
    options.place.up = UpChoice::Given(UpDirection::Axis(UpAxis::Y));
    let cropped = Bake::new(&options).run([loaded]).unwrap();
    let (alone, _) = baked(soft(cameras()), TeacherOptions::DEFAULT);
    assert!((psnr(&cropped) - psnr(&alone)).abs() < 0.2, "{} {}", psnr(&cropped), psnr(&alone));
}

#[test]
fn hostile_scenes_are_drawn_or_refused_with_an_error() {
    for (name, soup) in super::hostile::finite().into_iter().chain(super::hostile::poison()) {
        for stored in [cameras(), Vec::new()] {
            let scene = ImportedScene { cameras: stored, ..ImportedScene::from(soup.clone()) };
            let mut views = None;
            let mut details = TeacherDetails::default();
            let options = TeacherOptions::DEFAULT;
            match teacher(
                &mut views,
                &scene,
                false,
                None,
                &options,
                &SolidOptions::DEFAULT,
                &mut details,
            ) {
                Ok(Outcome::Changed(())) => {
                    assert!(views.is_some_and(|views| views.covered() > 0.0), "{name}")
                }
                Ok(Outcome::Skipped(_)) => assert!(views.is_none(), "{name}"),
                Err(Error::Invalid { .. } | Error::InvalidData(_)) => {}
                Err(error) => panic!("{name}: {error}"),
            }
        }
    }
}

#[test]
fn any_number_of_threads_draws_the_same_pictures() {
    let bake = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| baked(soft(Vec::new()), TeacherOptions::DEFAULT).0.mesh)
    };
    assert!(bake(1) == bake(3));
}
