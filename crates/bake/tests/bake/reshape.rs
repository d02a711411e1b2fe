//! Opaque triangles that are fitted to the pictures of a soft scene, or to photos.

use super::teacher::{baked_with, ball, cameras, psnr, skipped, soft};
use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    BakeOptions, BakePreset, ReshapeDetails, ReshapeOptions, ReshapeWhen, SceneTraits, Views,
    reshape,
};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{NO_FACE, SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{
    ImportedScene,
    image::Image,
    mesh::{Colors, Mesh},
    report::{Outcome, StageEvent, StageProgress},
};
use trisplat_teacher::Teacher;

fn options(reshape: ReshapeOptions) -> BakeOptions {
    BakeOptions { reshape, ..BakeOptions::default() }
}

/// Soft pictures of the ball.
fn pictures() -> Views {
    let eyes = cameras();
    let mut teacher = Teacher::new(ball(), &eyes, &SoftOptions::default());
    let pictures = eyes.iter().map(|camera| teacher.weighted_picture(camera)).collect();
    Views::drawn(eyes, pictures)
}

/// The triangles of the ball, opaque.
fn opaque() -> Mesh {
    let soup = ball();
    let colors = soup.sh.iter().map(|rgb| rgb.map(|c| (0.5 + 0.28 * c).clamp(0.0, 1.0))).collect();
    Mesh {
        positions: soup.vertices.into_iter().flatten().collect(),
        colors: Colors::Face(colors),
        ..Mesh::default()
    }
}

/// The stage alone.
fn reshaped(
    mesh: &mut Mesh,
    is_soft: bool,
    options: &ReshapeOptions,
) -> (Outcome<()>, ReshapeDetails) {
    let mut details = ReshapeDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let mut progress = StageProgress::new(&mut nobody);
    let traits = SceneTraits { is_soft, is_closed: false };
    let outcome =
        reshape(mesh, Some(&mut pictures()), traits, options, &mut details, &mut progress);
    (outcome.unwrap(), details)
}

#[test]
fn reshape_improves_held_out_pictures() {
    let (without, report) = baked_with(soft(cameras()), options(ReshapeOptions::OFF));
    assert_eq!(skipped(&report, "reshape"), Some("`reshape` off"));
    let (with, report) = baked_with(soft(cameras()), options(ReshapeOptions::DEFAULT));
    let before = psnr(&without);
    let after = psnr(&with);
    assert!(after > before + 0.5, "{before:.2} dB, fitted {after:.2} dB");
    assert!(with.mesh.face_count() <= without.mesh.face_count());
    let details: ReshapeDetails = report.details().unwrap();
    assert!(details.psnr_last.unwrap() > details.psnr_first.unwrap() + 3.0, "{details:?}");
    assert_eq!(details.rounds, Some(16));
    assert!(
        [details.dropped, details.corners_moved, details.cut].iter().all(|n| n.unwrap() > 100),
        "{details:?}"
    );
}

#[test]
fn a_closed_scene_stays_closed() {
    // A box around the ball and the cameras, in a colour that the pictures do not have: they are
    // black there.
    let corner = |i: usize| {
        Vec3::from([i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| 9.0 * (2.0 * b as f32 - 1.0)))
    };
    let sides =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let shell = sides.iter().flat_map(|[a, b, c, d]| [a, b, c, a, c, d].map(|i| corner(*i)));
    let soup = ball();
    let mut mesh = Mesh {
        positions: shell.chain(soup.vertices.into_iter().flatten()).collect(),
        ..Mesh::default()
    };
    mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
    let eyes = cameras();
    let black =
        eyes.iter().map(|camera| Image::filled(camera.size, [0.0; 3]).to_pixels()).collect();
    let mut views = Views::drawn(eyes.clone(), black);
    let mut details = ReshapeDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let traits = SceneTraits { is_soft: true, is_closed: true };
    let mut progress = StageProgress::new(&mut nobody);
    reshape(
        &mut mesh,
        Some(&mut views),
        traits,
        &ReshapeOptions::DEFAULT,
        &mut details,
        &mut progress,
    )
    .unwrap();
    let drawing = SolidRasterOptions::default();
    for camera in eyes {
        let seen = SolidRasterizer::new().visibility(&mesh, &camera, &drawing).face.clone();
        assert!(!seen.contains(&NO_FACE), "a hole");
    }
}

#[test]
fn what_no_picture_shows_stays_as_it_is() {
    let mut mesh = opaque();
    let far = [[1e3, 0.0, 0.0], [1e3, 1.0, 0.0], [1e3, 0.0, 1.0]].map(Vec3::from);
    mesh.positions.extend(far);
    let Colors::Face(colors) = &mut mesh.colors else { unreachable!() };
    colors.push([0.1, 0.7, 0.3]);
    let (outcome, _) = reshaped(&mut mesh, true, &ReshapeOptions::DEFAULT);
    assert_eq!(outcome, Outcome::Changed(()));
    let face = (0..mesh.face_count()).find(|&f| mesh.corners(f) == far).expect("it is still there");
    assert_eq!(mesh.corner_colors(face)[0], [0.1, 0.7, 0.3]);
}

#[test]
fn solid_scenes_and_shared_vertices_are_left_alone() {
    let always = ReshapeOptions { reshape: ReshapeWhen::Always, ..ReshapeOptions::DEFAULT };
    let before = opaque();
    let mut mesh = before.clone();
    let (outcome, details) = reshaped(&mut mesh, false, &ReshapeOptions::DEFAULT);
    assert_eq!(outcome, Outcome::Skipped("the scene is solid already"));
    assert!(mesh == before && details == ReshapeDetails::default());
    assert_eq!(reshaped(&mut mesh, false, &always).0, Outcome::Changed(()));
    assert!(mesh != before);

    let mut shared = before.clone();
    shared.indices = (0..shared.positions.len() as u32).collect();
    assert!(
        matches!(reshaped(&mut shared, true, &always).0, Outcome::Skipped(why) if why.contains("shared"))
    );
    let loaded = ImportedScene { cameras: cameras(), ..ImportedScene::from(before) };
    let (_, report) = baked_with(loaded, BakeOptions::default());
    assert_eq!(skipped(&report, "reshape"), Some("the scene is solid already"));
    assert_eq!(BakeOptions::preset(BakePreset::Fast).reshape, ReshapeOptions::OFF);
}

#[test]
fn no_rounds_are_refused_with_the_remedy() {
    let options = ReshapeOptions { reshape_rounds: 0, ..ReshapeOptions::DEFAULT };
    let mut mesh = opaque();
    let mut details = ReshapeDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let mut progress = StageProgress::new(&mut nobody);
    let error =
        reshape(&mut mesh, None, SceneTraits::default(), &options, &mut details, &mut progress)
            .unwrap_err()
            .to_string();
    assert!(error.starts_with("reshape_rounds ") && error.contains("`reshape` off"), "{error}");
}

#[test]
fn any_number_of_threads_fits_the_same_triangles() {
    let fit = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| baked_with(soft(cameras()), options(ReshapeOptions::DEFAULT)).0.mesh)
    };
    assert!(fit(1) == fit(3));
}
