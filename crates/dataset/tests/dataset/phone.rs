//! The sample data set as a phone takes it: what its file says was done is what was done.

use glam::{DQuat, DVec3, Vec2};
use trisplat_scene::{Limits, camera::Camera, math::color::linear_from_srgb, math::lists::median};
use trisplat_synthetic::{PhoneTruth, SyntheticOptions, TRUTH_FILE};

#[test]
fn a_phone_does_to_photos_what_its_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let options = SyntheticOptions {
        views: 4,
        width: 64,
        points: 200,
        phone: true,
        ..SyntheticOptions::default()
    };
    trisplat_synthetic::write(folder.path(), &options).unwrap();
    let text = std::fs::read_to_string(folder.path().join(TRUTH_FILE)).unwrap();
    let truth: PhoneTruth = serde_json::from_str(&text).unwrap();
    let dataset = super::load(folder.path());
    assert_eq!(dataset.views.len(), 4);
    let mut off = Vec::new();
    for (i, (view, photo)) in dataset.views.iter().zip(&truth.photos).enumerate() {
        assert_eq!(view.name, photo.name);
        let exact = trisplat_synthetic::camera(&options, i as u32);
        let [w, x, y, z] = photo.rotation;
        let rotation = glam::DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)).as_mat3();
        assert!(exact.rotation.abs_diff_eq(rotation, 1e-6), "{}", view.name);
        assert!(exact.translation.abs_diff_eq(DVec3::from(photo.translation).as_vec3(), 1e-6));
        // A thing in the middle of the scene, by the pose.
        let place = |camera: &Camera| {
            let p = camera.rotation * glam::Vec3::new(0.0, -0.5, 0.0) + camera.translation;
            p.truncate() / p.z * camera.focal + camera.center
        };
        off.push(place(&exact).distance(place(&view.camera)));
        // Light, away from edges: in the middle and in a corner.
        let scene = trisplat_synthetic::render(&exact);
        let taken = view.photo.decode().unwrap();
        let middle = taken.size.as_vec2() / 2.0;
        for c in 0..3 {
            let ratios = (0..taken.rgb.len()).filter_map(|p| {
                let at = Vec2::new((p % 64) as f32 + 0.5, (p / 64) as f32 + 0.5);
                let r2 = at.distance_squared(middle) / middle.length_squared();
                let light = linear_from_srgb(f32::from(taken.rgb[p][c]) / 255.0);
                let kept = (20..245).contains(&taken.rgb[p][c]);
                kept.then(|| {
                    (light / linear_from_srgb(scene.pixels[p][c])).ln() + truth.falloff as f32 * r2
                })
            });
            let found = median(ratios.collect(), f32::total_cmp).unwrap();
            let wanted = photo.gains[c] as f32;
            assert!((found - wanted).abs() < 0.015, "{} {c}: {found} {wanted}", view.name);
        }
    }
    let mean = off.iter().sum::<f32>() / 4.0;
    assert!((0.2..0.9).contains(&mean), "poses are {off:?} px off");
    let gains: Vec<f64> = truth.photos.iter().map(|photo| photo.gains[1]).collect();
    assert!(gains.iter().any(|g| *g > 0.15) && gains.iter().any(|g| *g < -0.15), "{gains:?}");
    // The points were seen where they are: the poses do not fit them by as much.
    let reprojection = dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap().mean_px;
    assert!((0.3..1.2).contains(&reprojection), "{reprojection}");
}
