//! Simulates a phone's photos with known parameters: automatic exposure and white balance, darker
//! corners, noise, and poses with errors of half a pixel.

use glam::{DMat3, DQuat, DVec3, Vec2};
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::{
    Error, Result, Rng,
    image::Image,
    math::color::{linear_from_srgb, srgb_from_linear},
};

/// The file of the true parameters.
pub const TRUTH_FILE: &str = "truth.json";

/// Standard deviation of the exposure from photo to photo, as a logarithm: a third of a stop ...
const EXPOSURE_NOISE: f64 = 0.23;
/// ... around a wave over all photos of this amplitude.
const EXPOSURE_WAVE: f64 = 0.35;
/// Standard deviation of red and blue against green, as a logarithm.
const BALANCE: f64 = 0.06;
/// Loss of light in the corners, as a logarithm.
const FALLOFF: f64 = 0.4;
/// Standard deviation of the noise in linear light: a constant part, and one that grows with the
/// root of the light.
const NOISE: [f32; 2] = [0.002, 0.015];
/// Standard deviation of a pose's error along each axis of the photo, px: for rotation and for
/// position.
const POSE_PX: f64 = 0.25;
/// Viewing distance of the cameras.
const DISTANCE: f64 = 4.0;

/// The true parameters of a data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhoneTruth {
    /// Loss of light in the corners of every photo, as a logarithm; it grows with the square of the
    /// distance from the middle.
    pub falloff: f64,
    /// Photo by photo.
    pub photos: Vec<PhotoTruth>,
}

/// The true parameters of a photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoTruth {
    /// Its name.
    pub name: String,
    /// Gain in linear light, per channel, as a logarithm.
    pub gains: [f64; 3],
    /// The true rotation from world to camera, as w, x, y, z.
    pub rotation: [f64; 4],
    /// The same of the translation.
    pub translation: [f64; 3],
}

impl PhotoTruth {
    /// Photo `index` of `views`, taken with this pose.
    pub fn new(seed: u64, index: u32, views: u32, name: String, pose: (DMat3, DVec3)) -> Self {
        let rng = Rng::new(seed, "light", u64::from(index));
        let turn = std::f64::consts::TAU * f64::from(index) / f64::from(views);
        let exposure =
            EXPOSURE_WAVE * (3.0 * turn).sin() + EXPOSURE_NOISE * f64::from(rng.normal(0));
        let [red, blue] = [1, 2].map(|k| BALANCE * f64::from(rng.normal(k)));
        let q = DQuat::from_mat3(&pose.0);
        Self {
            name,
            gains: [exposure + red, exposure, exposure + blue],
            rotation: [q.w, q.x, q.y, q.z],
            translation: pose.1.to_array(),
        }
    }

    /// The phone's photo of the camera's view.
    pub fn take(&self, seed: u64, index: u32, scene: &Image) -> Image {
        let noise = Rng::new(seed, "noise", u64::from(index));
        let width = scene.size.x as usize;
        let middle = scene.size.as_vec2() / 2.0;
        let pixel = |(i, rgb): (usize, &[f32; 3])| {
            let place = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let r2 = place.distance_squared(middle) / middle.length_squared();
            std::array::from_fn(|c| {
                let by = (self.gains[c] as f32 - FALLOFF as f32 * r2).exp();
                let light = linear_from_srgb(rgb[c]) * by;
                let deviation = NOISE[0].hypot(NOISE[1] * light.sqrt());
                srgb_from_linear(light + deviation * noise.normal(3 * i as u64 + c as u64))
            })
        };
        Image { size: scene.size, pixels: scene.pixels.iter().enumerate().map(pixel).collect() }
    }
}

/// An estimated pose: half a pixel off, for a focal length of `focal` px.
pub(crate) fn found(
    seed: u64,
    index: u32,
    focal: f64,
    (rotation, translation): (DMat3, DVec3),
) -> (DMat3, DVec3) {
    let rng = Rng::new(seed, "pose", u64::from(index));
    let vector = |from: u64| DVec3::from_array([0, 1, 2].map(|k| f64::from(rng.normal(from + k))));
    let angle = POSE_PX / focal;
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(angle * vector(0)));
    (turn * rotation, turn * translation + angle * DISTANCE * vector(3))
}

/// Writes the true parameters into `folder`.
pub(crate) fn write(folder: &Path, photos: Vec<PhotoTruth>) -> Result<()> {
    let path = folder.join(TRUTH_FILE);
    let mut text = serde_json::to_string_pretty(&PhoneTruth { falloff: FALLOFF, photos })
        .expect("plain numbers and names are JSON");
    text.push('\n');
    std::fs::write(&path, text).map_err(|e| Error::io(&path, e))
}
