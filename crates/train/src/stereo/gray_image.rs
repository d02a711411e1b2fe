//! Photos in shades of gray, with their depth maps, as they are matched.

use crate::pyramid::Pyramid;
use glam::{UVec2, Vec2, Vec3};
use std::sync::Arc;
use trisplat_dataset::{DepthPicture, View};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;

/// Maximum number of pixels of all these photos together.
const MAX_TOTAL_PIXELS: f64 = 32e6;

/// A photo in shades of gray.
#[derive(Debug)]
pub(crate) struct GrayImage {
    pub(super) camera: Camera,
    /// Greys in [0, 1]. `[H * W]`
    pub(super) value: Vec<f32>,
    pub(super) photo: Arc<RgbImage>,
    /// Its depth map.
    pub(super) depth: Option<MeasuredDepth>,
}

impl GrayImage {
    /// `photo`, taken by `camera` at any size.
    pub(crate) fn new(camera: &Camera, photo: Arc<RgbImage>) -> Self {
        let gray = |[r, g, b]: [u8; 3]| {
            (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / 255.0
        };
        let value = photo.rgb.iter().map(|rgb| gray(*rgb)).collect();
        Self { camera: camera.resized(photo.size), value, photo, depth: None }
    }

    /// Index of the pixel at a place within the photo.
    pub(super) fn index(&self, at: Vec2) -> usize {
        let last = self.camera.size - 1;
        let at = at.as_uvec2().min(last);
        (at.y * self.camera.size.x + at.x) as usize
    }

    /// Colour of a place, if it is within the picture.
    pub(crate) fn color(&self, place: Vec3) -> Option<Vec3> {
        let (at, _) = self.camera.project(place)?;
        Some(Vec3::from(self.photo.rgb[self.index(at)].map(f32::from)) / 255.0)
    }

    /// True for a pixel that no mask excludes.
    pub(super) fn is_unmasked(&self, at: Vec2) -> bool {
        self.photo.alpha.as_ref().is_none_or(|alpha| alpha[self.index(at)] > 127)
    }

    /// Bilinear grays; `None` if one is outside.
    pub(super) fn sample<const N: usize>(&self, at: &[Vec2; N]) -> Option<[f32; N]> {
        let width = self.camera.size.x as usize;
        let last = self.camera.size.as_vec2() - 1.0;
        let mut out = [0.0; N];
        for (out, at) in out.iter_mut().zip(at) {
            let p = *at - 0.5;
            if !(p.x >= 0.0 && p.y >= 0.0 && p.x < last.x && p.y < last.y) {
                return None;
            }
            let i = p.x as usize;
            let j = p.y as usize;
            let u = p.x - i as f32;
            let v = p.y - j as f32;
            let row = &self.value[j * width + i..][..2];
            let next = &self.value[(j + 1) * width + i..][..2];
            let top = row[0] + u * (row[1] - row[0]);
            let bottom = next[0] + u * (next[1] - next[0]);
            *out = top + v * (bottom - top);
        }
        Some(out)
    }

    /// The measured depth at a pixel.
    pub(super) fn measured_depth(&self, at: Vec2) -> Option<f32> {
        let depth = self.depth.as_ref()?;
        Some(depth.scale * depth.picture.depth(at * depth.pixel)?)
    }
}

/// The depth map of a photo.
#[derive(Debug)]
pub(super) struct MeasuredDepth {
    picture: DepthPicture,
    /// Pixels of the delivered photo per pixel.
    pixel: Vec2,
    /// Units of the world's depths.
    scale: f32,
}

/// The ray of a pixel, with z = 1.
pub(super) fn ray(camera: &Camera, at: Vec2) -> Vec3 {
    ((at - camera.center) / camera.focal).extend(1.0)
}

/// Gray images of the photos, with sides of at most `longest` px; decoded at `level`.
pub(super) fn gray_images(
    photos: &mut Pyramid,
    level: u32,
    cameras: &[Camera],
    longest: f64,
) -> Result<Vec<GrayImage>> {
    let sizes = (0..cameras.len()).map(|i| photos.size(i, level).as_dvec2());
    let sizes: Vec<_> = sizes.map(|size| size * (longest / size.max_element()).min(1.0)).collect();
    let pixels: f64 = sizes.iter().map(|size| size.element_product()).sum();
    let share = (MAX_TOTAL_PIXELS / pixels).sqrt().min(1.0);
    let mut images = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let photo = photos.take(i, level)?;
        let size = (sizes[i] * share).round().as_uvec2().max(UVec2::ONE);
        images.push(GrayImage::new(camera, photo.shared_at(size)));
    }
    Ok(images)
}

/// Reads the depth maps of `views` for their `images`, in units of 1 / `scale`.
///
/// # Errors
///
/// Maps that cannot be decoded.
pub(super) fn read_depths(images: &mut [GrayImage], views: &[&View], scale: f32) -> Result<()> {
    for (image, view) in images.iter_mut().zip(views) {
        let pixel = view.camera.size.as_vec2() / image.camera.size.as_vec2();
        let picture = view.photo.decode_depth()?;
        image.depth = picture.map(|picture| MeasuredDepth { picture, pixel, scale });
    }
    Ok(())
}
