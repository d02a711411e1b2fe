//! Photos of wide lenses train as well as photos of pinholes in their place.

use super::*;
use glam::{DVec2, UVec2};
use trisplat_dataset::{Distortion, Lens, LensProjection, Photo};

#[test]
fn a_wide_lens_trains_like_its_pinhole_twin() {
    let fisheye = |size: UVec2, focal: f64| Lens {
        size,
        focal: DVec2::splat(focal),
        center: size.as_dvec2() / 2.0,
        distortion: Distortion {
            radial: [-0.02, 0.003, 0.0, 0.0],
            projection: LensProjection::Fisheye,
            ..Distortion::default()
        },
    };
    for (model, lens, views) in [
        ("RADIAL_FISHEYE", fisheye(UVec2::new(96, 72), 56.0), 1),
        ("RADIAL_FISHEYE", fisheye(UVec2::new(120, 60), 45.0), 2),
        ("SPHERICAL", Lens::spherical(UVec2::new(160, 80)), 6),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let made = SyntheticOptions { views: 9, points: 300, ..SyntheticOptions::default() };
        let draw = |lens: &Lens, camera: &_| trisplat_synthetic::render_lens(camera, lens);
        trisplat_synthetic::write_lens(folder.path(), &made, model, &lens, &draw).unwrap();
        let wide = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        assert_eq!(wide.views.len(), 9 * views, "{model}");
        let mut twin = wide.clone();
        for view in &mut twin.views {
            view.photo = Photo::drawn(trisplat_synthetic::render(&view.camera).to_pixels());
        }
        let [wide, twin] = [wide, twin].map(|dataset| psnr(&trained(&dataset, &options(100))));
        assert!(wide > twin - 0.5, "{model}: {wide:.2} dB, its pinhole twin {twin:.2}");
    }
}
