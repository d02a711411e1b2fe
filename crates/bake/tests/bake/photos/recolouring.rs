//! Colours by photos: `refit`.

use super::*;

#[test]
fn refit_finds_the_colours_the_photos_were_drawn_with() {
    let truth = scene();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let many = RefitOptions { refit_passes: 10, refit_flatness: 0.1, ..RefitOptions::DEFAULT };
    let (mesh, details) = fitted(&dataset, &grey(&truth), &many);
    assert_eq!(details.colors, Some(RefitColors::Corner));
    let error = difference(&mesh, &truth);
    assert!(error < 1.5, "{error} codes with corners");
    let (flat, _) =
        fitted(&dataset, &grey(&truth), &RefitOptions { refit: RefitColors::Flat, ..many });
    assert!(matches!(flat.colors, Colors::Face(_)));
    assert!(difference(&flat, &truth) < 0.7 * difference(&grey(&truth), &truth));
}

#[test]
fn more_passes_come_closer() {
    let truth = scene();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let errors: Vec<f64> = [1, 2, 3, 5]
        .map(|refit_passes| {
            let options =
                RefitOptions { refit_passes, refit_flatness: 0.1, ..RefitOptions::DEFAULT };
            difference(&fitted(&dataset, &grey(&truth), &options).0, &truth)
        })
        .to_vec();
    assert!(errors.windows(2).all(|e| e[1] < e[0]), "{errors:?}");
}

#[test]
fn colours_that_are_right_stay() {
    let truth = scene();
    let flat = Mesh {
        colors: Colors::Face((0..100).map(|i| truth.corner_colors(i)[0]).collect()),
        ..truth
    };
    // Sampled as the stage samples, so that they are right to the last code.
    let (_folder, dataset) = photograph_at(&flat, 2, |_, photo| photo);
    let mut mesh = flat.clone();
    let mut details = RefitDetails::default();
    refit(&mut mesh, Some(&mut views(&dataset)), &RefitOptions::DEFAULT, &mut details).unwrap();
    assert!(difference(&mesh, &flat) < 0.5, "{details:?}");
}

/// A truth of one colour per triangle, none of them dark, and the same with the blue of four faces
/// at 0.
fn without_blue() -> (Mesh, Mesh) {
    let truth = scene();
    let color = |face: usize| match face % 25 {
        0 => [0.3, 0.4, 0.45],
        _ => truth.corner_colors(face)[0].map(|c| 0.2 + 0.7 * c),
    };
    let colors: Vec<[f32; 3]> = (0..truth.face_count()).map(color).collect();
    let mut dead = colors.clone();
    dead.iter_mut().step_by(25).for_each(|color| color[2] = 0.0);
    let with = |colors| Mesh { colors: Colors::Face(colors), ..truth.clone() };
    (with(colors), with(dead))
}

/// Faces whose blue is 0 in `start` and the photos' in `mesh`.
fn blue_again(start: &Mesh, mesh: &Mesh) -> usize {
    let blue = |mesh: &Mesh, face: usize| mesh.corner_colors(face)[0][2];
    let is_back =
        |face: &usize| blue(start, *face) == 0.0 && (blue(mesh, *face) - 0.45).abs() < 0.12;
    (0..mesh.face_count()).filter(is_back).count()
}

#[test]
fn refit_fills_a_channel_at_zero_in_one_pass() {
    let (truth, dead) = without_blue();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let options = RefitOptions { refit: RefitColors::Flat, ..RefitOptions::DEFAULT };
    let (mesh, _) = fitted(&dataset, &dead, &options);
    let back = blue_again(&dead, &mesh);
    assert!(back >= 3, "{back} of 4");
}

#[test]
fn refit_restores_a_channel_at_zero() {
    let (truth, dead) = without_blue();
    // Photos that are not held out lack red and green, so that the scene's own colours are better.
    let bluish = |view: usize, mut photo: RgbImage| {
        for rgb in photo.rgb.iter_mut().filter(|_| view % 8 != 4) {
            *rgb = [rgb[0].saturating_sub(60), rgb[1].saturating_sub(60), rgb[2]];
        }
        photo
    };
    let (_folder, dataset) = photograph(&truth, bluish);
    let mut mesh = dead.clone();
    let mut details = RefitDetails::default();
    let outcome =
        refit(&mut mesh, Some(&mut views(&dataset)), &RefitOptions::DEFAULT, &mut details).unwrap();
    assert_eq!((details.colors, outcome), (None, Outcome::Changed(())), "{details:?}");
    let back = blue_again(&dead, &mesh);
    assert!(back >= 3 && details.revived >= Some(3), "{back} of 4, {details:?}");
    for face in 0..mesh.face_count() {
        let [before, after] = [&dead, &mesh].map(|mesh| mesh.corner_colors(face)[0]);
        let kept = if before[2] == 0.0 { 2 } else { 3 };
        assert_eq!(after[..kept], before[..kept], "face {face}");
    }
}

#[test]
fn a_photo_of_another_exposure_is_left_out() {
    let truth = scene();
    let brighten = |view: usize, mut photo: RgbImage| {
        if view == 5 {
            photo.rgb.iter_mut().flatten().for_each(|c| *c = c.saturating_mul(2));
        }
        photo
    };
    let (_folder, dataset) = photograph(&truth, brighten);
    let options = RefitOptions { refit_passes: 4, refit_flatness: 0.1, ..RefitOptions::DEFAULT };
    let (mesh, details) = fitted(&dataset, &grey(&truth), &options);
    assert_eq!(details.photos_out_of_line, Some(1));
    let error = difference(&mesh, &truth);
    assert!(error < 3.0, "{error}");
}

#[test]
fn a_placed_scene_matches_the_same_photos() {
    let truth = scene();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let placement =
        Placement { up: UpAxis::NegY.into(), rotate: 0.0, scale: 2.5, center: [0.5, -1.0, 3.0] };
    let mut placed = grey(&truth);
    placed.positions.iter_mut().for_each(|v| *v = placement.to_file(*v));
    let mut views = views(&dataset);
    views.transform(&placement);
    refit(&mut placed, Some(&mut views), &RefitOptions::DEFAULT, &mut RefitDetails::default())
        .unwrap();
    let here = fitted(&dataset, &grey(&truth), &RefitOptions::DEFAULT).0;
    placed.positions = truth.positions.clone();
    assert!(difference(&placed, &here) < 0.5);
}
