//! Depth maps of photos: metric ones of phones, or inverse ones of networks.

use super::lens::Undistort;
use glam::{DVec2, UVec2, Vec2};
use std::path::PathBuf;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Limits, Result};

/// Largest relative difference between the shapes of a photo and its depth map.
const MAX_SHAPE_DIFFERENCE: f64 = 0.03;
/// Largest difference of neighbouring pixels of one surface, as a share of their depth.
const MAX_SLOPE: f64 = 0.08;

/// A depth map in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFile {
    /// A grey PNG.
    pub path: PathBuf,
    pub(super) unit: DepthUnit,
}

/// Meaning of the codes of a depth map; 0 is no measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DepthUnit {
    /// depth = unit · code, world units.
    Linear(f64),
    /// 1 / depth = scale · code / 2¹⁶ + offset.
    Inverse { scale: f64, offset: f64 },
}

impl DepthFile {
    /// A map whose codes are depths in units of `unit`.
    pub(super) fn linear(path: PathBuf, unit: f64) -> Self {
        Self { path, unit: DepthUnit::Linear(unit) }
    }

    /// Multiplies all depths.
    pub(super) fn rescale(&mut self, factor: f64) {
        self.unit = match self.unit {
            DepthUnit::Linear(unit) => DepthUnit::Linear(unit * factor),
            DepthUnit::Inverse { scale, offset } => {
                DepthUnit::Inverse { scale: scale / factor, offset: offset / factor }
            }
        };
    }

    /// Refuses a map that has not the shape of its photo, `size` px.
    pub(super) fn check_shape(&self, size: UVec2, limits: &Limits) -> Result<()> {
        let own = RgbImage::size_of(&self.path, limits)?;
        let ratio = own.as_dvec2() / size.as_dvec2();
        let rounding = 1.0 / f64::from(own.min_element());
        if (ratio.x / ratio.y - 1.0).abs() <= MAX_SHAPE_DIFFERENCE + rounding {
            return Ok(());
        }
        let reason = format!(
            "is {}x{}, its photo {}x{}; a depth map must have the shape of its photo: export it \
             again, or remove it",
            own.x, own.y, size.x, size.y
        );
        Err(Error::malformed(&self.path, "size", reason))
    }

    /// The decoded map; `place` finds the pixels of its photo.
    ///
    /// # Errors
    ///
    /// A file that cannot be decoded, or is no grey PNG.
    pub(super) fn decode(&self, place: PlaceInFile, limits: &Limits) -> Result<DepthPicture> {
        let (size, codes) = RgbImage::load_codes(&self.path, limits)?;
        Ok(DepthPicture { size, codes, unit: self.unit, place })
    }
}

/// The place of a photo's pixels in its file.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaceInFile {
    /// Size of the whole photo as delivered, px.
    pub(super) whole: UVec2,
    /// Upper left corner of the part of it, px.
    pub(super) corner: UVec2,
    pub(super) undistort: Option<Undistort>,
}

impl PlaceInFile {
    /// The place of a pixel, as shares of the sides of the file.
    fn of(&self, pixel: DVec2) -> Option<DVec2> {
        let share = (pixel + self.corner.as_dvec2()) / self.whole.as_dvec2();
        let Some(plan) = self.undistort else { return Some(share) };
        let pixel = share * plan.pinhole.size.as_dvec2();
        let direction = (pixel - plan.pinhole.center) / plan.pinhole.focal;
        Some(plan.lens.pixel(direction.extend(1.0))? / plan.lens.size.as_dvec2())
    }
}

/// A decoded depth map.
#[derive(Debug, Clone)]
pub struct DepthPicture {
    size: UVec2,
    codes: Vec<u16>,
    unit: DepthUnit,
    place: PlaceInFile,
}

impl DepthPicture {
    /// The depth along the camera's axis at a pixel of the photo as delivered, world units; `None`
    /// where nothing was measured. Between the pixels of a surface the inverse depth is linear, as
    /// that of planes.
    pub fn depth(&self, pixel: Vec2) -> Option<f32> {
        let last = (self.size - 1).as_dvec2();
        let place = self.place.of(pixel.as_dvec2())? * self.size.as_dvec2();
        let place = (place - 0.5).clamp(DVec2::ZERO, last);
        let nearest = self.inverse_depth(place.round().as_uvec2())?;
        let corner = place.floor().min((last - 1.0).max(DVec2::ZERO));
        let share = place - corner;
        let [left, top] = corner.as_uvec2().to_array();
        let mut inverse = 0.0;
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let at = UVec2::new(left + x, top + y).min(self.size - 1);
            let of_surface = |value: &f64| (value / nearest - 1.0).abs() <= MAX_SLOPE;
            let Some(value) = self.inverse_depth(at).filter(of_surface) else {
                return Some(nearest.recip() as f32);
            };
            let weight = DVec2::new(f64::from(x), f64::from(y));
            let weight = (1.0 - weight) + (2.0 * weight - 1.0) * share;
            inverse += weight.element_product() * value;
        }
        Some(inverse.recip() as f32)
    }

    /// The inverse depth of a pixel of the map.
    fn inverse_depth(&self, at: UVec2) -> Option<f64> {
        let code = self.codes[at.y as usize * self.size.x as usize + at.x as usize];
        let inverse = match self.unit {
            // Both ends of the range stand for nothing.
            DepthUnit::Linear(_) if code == u16::MAX => return None,
            DepthUnit::Linear(unit) => (unit * f64::from(code)).recip(),
            DepthUnit::Inverse { scale, offset } => scale * f64::from(code) / 65536.0 + offset,
        };
        (code > 0 && inverse > 0.0 && inverse.is_finite()).then_some(inverse)
    }
}
