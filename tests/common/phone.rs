//! The sample data set, disturbed as a phone does.

use glam::{DMat3, DVec3};
use std::path::Path;
use trisplat_scene::image::{Image, RgbImage};
use trisplat_synthetic::PhotoTruth;

/// Writes the photos of the sample into `folder` as a phone would have taken them from the same
/// places, with the sample's poses. Returns what was done, photo by photo in order of name.
pub(crate) fn phone_sample(folder: &Path) -> Vec<PhotoTruth> {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let files = |part: &str| {
        std::fs::create_dir_all(folder.join(part)).unwrap();
        let entries = std::fs::read_dir(sample.join(part)).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    for name in files("sparse/0") {
        let path = Path::new("sparse/0").join(name);
        std::fs::copy(sample.join(&path), folder.join(&path)).unwrap();
    }
    std::fs::copy(sample.join("test.txt"), folder.join("test.txt")).unwrap();
    let names = files("images");
    let count = names.len() as u32;
    let photo = |(index, name): (u32, String)| {
        let path = Path::new("images").join(&name);
        let scene = RgbImage::load(&sample.join(&path)).unwrap();
        let pixels = scene.rgb.iter().map(|p| p.map(|c| f32::from(c) * (1.0 / 255.0))).collect();
        let scene = Image { size: scene.size, pixels };
        let truth = PhotoTruth::new(0, index, count, name, (DMat3::IDENTITY, DVec3::ZERO));
        truth.take(0, index, &scene).to_pixels().save_png(folder.join(&path)).unwrap();
        truth
    };
    (0..).zip(names).map(photo).collect()
}

/// The mean of how far `found` is from what was done to the photos of these names, both less their
/// mean, per channel.
pub(crate) fn error_of_gains(truth: &[PhotoTruth], names: &[&str], found: &[[f32; 3]]) -> f64 {
    assert_eq!(names.len(), found.len());
    let wanted: Vec<[f64; 3]> = names
        .iter()
        .map(|name| truth.iter().find(|photo| photo.name == *name).unwrap().gains)
        .collect();
    let count = names.len() as f64;
    let of_channel = |c: usize| {
        let mean =
            wanted.iter().zip(found).map(|(w, f)| w[c] - f64::from(f[c])).sum::<f64>() / count;
        wanted.iter().zip(found).map(|(w, f)| (w[c] - f64::from(f[c]) - mean).abs()).sum::<f64>()
            / count
    };
    (0..3).map(of_channel).sum::<f64>() / 3.0
}

/// The standard deviation of what was done to the exposure of these photos, as a logarithm.
pub(crate) fn true_spread(truth: &[PhotoTruth], names: &[&str]) -> f64 {
    let of = |name: &&str| {
        truth.iter().find(|photo| photo.name == *name).unwrap().gains.iter().sum::<f64>() / 3.0
    };
    let gains: Vec<f64> = names.iter().map(of).collect();
    let mean = gains.iter().sum::<f64>() / gains.len() as f64;
    (gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (gains.len() - 1) as f64).sqrt()
}

/// A tenth of a stop, as a logarithm.
pub(crate) const TENTH_OF_A_STOP: f64 = 0.069;
