//! Data sets from outside: the same scene told in two formats, real photos, and files that lie.

use std::path::{Path, PathBuf};
use trisplat::dataset::{Dataset, DatasetOptions};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data");

#[test]
fn peek() {
    for name in ["banana", "bonsai", "brighton_beach", "dtu_scan24", "fox", "fox480"] {
        let path = Path::new(DATA).join(name);
        let t = std::time::Instant::now();
        let d = Dataset::load(&path, &DatasetOptions::default()).unwrap();
        let e: Vec<f32> = d.points.iter().filter_map(|p| p.error).collect();
        eprintln!("{name} {} {} views {} test {} points {:?} {:?} stated {} {:?} {:.3}s", d.kind, d.views.len(), d.test().count(), d.points.len(), d.reprojection, d.origin, e.iter().sum::<f32>() / e.len() as f32, d.warnings, t.elapsed().as_secs_f64());
        let j = Dataset::load(&path.join("transforms.json"), &DatasetOptions::default()).unwrap();
        let mut worst = [0f32; 4];
        for (a, b) in d.views.iter().zip(&j.views) {
            assert_eq!((&a.name, a.test, a.camera.size), (&b.name, b.test, b.camera.size));
            worst[0] = worst[0].max((a.camera.rotation - b.camera.rotation).to_cols_array().iter().fold(0.0, |m, x| x.abs().max(m)));
            worst[1] = worst[1].max(a.camera.position().distance(b.camera.position()));
            worst[2] = worst[2].max(a.camera.focal.distance(b.camera.focal));
            worst[3] = worst[3].max(a.camera.center.distance(b.camera.center));
        }
        eprintln!("   json {} views {} points {:?} {worst:?}", j.views.len(), j.points.len(), j.warnings);
    }
}
