//! Triangles that no photo needs: `unseen`.

use super::*;

#[test]
fn unseen_drops_triangles_behind_masks_only() {
    const THING: u32 = 60;
    let mesh = scene();
    let (folder, _) = photograph(&mesh, |_, photo| photo);
    let masks = folder.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    let one_sample = SolidRasterOptions { samples: 1, ..SolidRasterOptions::default() };
    for view in 0..VIEWS {
        let mut solid = SolidRasterizer::new();
        let seen = solid.visibility(&mesh, &camera(view), &one_sample);
        let rgb = seen.face.iter().map(|&face| [if face < THING { 255 } else { 0 }; 3]).collect();
        let mask = RgbImage { size: seen.size, rgb, alpha: None };
        mask.save_png(masks.join(format!("{view:02}.png"))).unwrap();
    }
    let dataset = load(folder.path());
    let cameras: Vec<Camera> = (0..VIEWS).map(camera).collect();
    let drop = |options: &UnseenOptions, masks| {
        let mut kept = mesh.clone();
        let mut details = UnseenDetails::default();
        let how = DatasetOptions { masks, test_every: 0, ..DatasetOptions::default() };
        let mut views = Views::new(&Dataset::load(folder.path(), &how).unwrap(), &how);
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let progress = &mut StageProgress::new(&mut nobody);
        details.masked = unseen::masked(&mut kept, Some(&mut views), options, progress).unwrap();
        unseen(&mut kept, &cameras, Some(&mut views), options, None, &mut details).unwrap();
        (kept, details.masked)
    };
    let (kept, masked) = drop(&UnseenOptions::default(), Masks::Ignore);
    let is_thing = |face: usize| {
        let corners = kept.corners(face);
        (0..THING as usize).any(|of| mesh.corners(of) == corners)
    };
    let things = (0..kept.face_count()).filter(|face| is_thing(*face)).count();
    assert_eq!(
        things, THING as usize,
        "a part of the thing is gone, though some show in half a pixel only"
    );
    // And a few of the rest, which show in pixels of its outline.
    let others = kept.face_count() - things;
    assert!(others <= 5, "{others} of the rest are left");
    assert_eq!(masked, Some((mesh.face_count() - kept.face_count()) as u64));

    // There is nothing behind a thing that was masked, unless one asks for it.
    let behind = |when| {
        let mut with = kept.clone();
        let mut details = BackdropDetails::default();
        let options = BackdropOptions { backdrop: when };
        backdrop(&mut with, Some(&mut views(&dataset)), &options, None, &mut details).unwrap();
        with.face_count() - kept.face_count()
    };
    assert_eq!(behind(BackdropWhen::Auto), 0);
    assert!(behind(BackdropWhen::Sphere) > 0);

    // Masks that cut drop what lies mostly beside the thing; those that are not read drop nothing;
    // and who keeps what is unseen keeps this.
    assert!(drop(&UnseenOptions::default(), Masks::Cut).1 >= masked);
    assert_eq!(drop(&UnseenOptions::default(), Masks::Off).1, None);
    let keep = UnseenOptions { keep_unseen: true, ..UnseenOptions::default() };
    assert_eq!(drop(&keep, Masks::Ignore).0.face_count(), mesh.face_count());
}

#[test]
fn hidden_triangles_are_dropped_and_pictures_stay_the_same() {
    let mut mesh = scene();
    let core = mesh.face_count();
    mesh.positions.extend(room(1.35));
    mesh.colors = Colors::Face((0..mesh.face_count()).map(|f| [f as f32 / 200.0; 3]).collect());
    let (_folder, dataset) = photograph(&mesh, |_, photo| photo);
    let mut left = mesh.clone();
    let mut details = UnseenDetails::default();
    cull(&mut left, &dataset, &UnseenOptions::DEFAULT, None, &mut details).unwrap();
    assert!(
        (8..20).contains(&left.face_count()),
        "{} of {core}: the sides of the box",
        left.face_count()
    );
    assert!(difference(&left, &mesh) < 1.0);
    let again = cull(&mut left, &dataset, &UnseenOptions::DEFAULT, None, &mut details);
    assert!(matches!(again, Ok(Outcome::Skipped(_))));

    let keep = UnseenOptions { keep_unseen: true, ..UnseenOptions::DEFAULT };
    let mut all = mesh.clone();
    assert!(matches!(
        cull(&mut all, &dataset, &keep, None, &mut UnseenDetails::default()),
        Ok(Outcome::Skipped(_))
    ));
    cull(&mut all, &dataset, &keep, Some(20), &mut UnseenDetails::default()).unwrap();
    assert_eq!(all.face_count(), 20);
}

#[test]
fn triangles_outside_every_picture_are_kept() {
    let mut mesh = scene();
    let (_folder, dataset) = photograph(&mesh, |_, photo| photo);
    let far = [Vec3::new(0.0, 1e4, 0.0), Vec3::new(1.0, 1e4, 0.0), Vec3::new(0.0, 1e4, 1.0)];
    mesh.positions.extend(far);
    mesh.colors = Colors::Face(vec![[0.2; 3]; mesh.face_count()]);
    let mut details = UnseenDetails::default();
    let outcome = cull(&mut mesh, &dataset, &UnseenOptions::DEFAULT, None, &mut details);
    assert!(outcome.is_ok() && details.seen_by_none >= Some(1));
    assert_eq!(details.outside, Some(1));
    assert!((0..mesh.face_count()).any(|face| mesh.corners(face) == far));
}

#[test]
fn cameras_of_the_file_drop_what_photos_would() {
    let mut mesh = scene();
    mesh.positions.extend(room(1.35));
    mesh.colors = Colors::Face((0..mesh.face_count()).map(|f| [f as f32 / 200.0; 3]).collect());
    let (_folder, dataset) = photograph(&mesh, |_, photo| photo);
    let cameras: Vec<_> = dataset.train().map(|v| v.camera).collect();
    let options = UnseenOptions::DEFAULT;
    for most in [None, Some(9)] {
        let mut by_photos = mesh.clone();
        let mut by_cameras = mesh.clone();
        cull(&mut by_photos, &dataset, &options, most, &mut UnseenDetails::default()).unwrap();
        let alone =
            unseen(&mut by_cameras, &cameras, None, &options, most, &mut UnseenDetails::default())
                .unwrap();
        assert_eq!(alone, Outcome::Changed(()));
        assert_eq!(by_photos, by_cameras);
    }
    let away = Camera { translation: Vec3::Z * -1e6, ..cameras[0] };
    let mut left = mesh.clone();
    let nothing =
        unseen(&mut left, &[away], None, &options, None, &mut UnseenDetails::default()).unwrap();
    assert!(matches!(nothing, Outcome::Skipped(_)), "cameras that see nothing drop nothing");
    unseen(&mut left, &[away], None, &options, Some(9), &mut UnseenDetails::default()).unwrap();
    assert_eq!(left.face_count(), 9, "the largest");
}

#[test]
fn a_greater_error_allows_fewer_triangles() {
    let mesh = scene();
    let (_folder, dataset) = photograph(&mesh, |_, photo| photo);
    let left: Vec<usize> = [0.0, 3.0, 40.0]
        .map(|db| {
            let mut mesh = mesh.clone();
            let mut details = UnseenDetails::default();
            let options = UnseenOptions { max_error: Some(db), ..UnseenOptions::DEFAULT };
            cull(&mut mesh, &dataset, &options, None, &mut details).unwrap();
            mesh.face_count()
        })
        .to_vec();
    assert!(left[0] > left[1] && left[1] > left[2], "{left:?}");
}
