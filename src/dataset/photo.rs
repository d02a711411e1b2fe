//! One photo, on disk with what to do to it on the way in, or drawn and in memory.

use super::options::{Background, Masks};
use super::undistort::Undistort;
use crate::error::{Error, Result};
use crate::image::Pixels;
use glam::UVec2;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A photo that is decoded when asked for, or a picture that is there already.
#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// The picture file; empty for a picture in memory.
    pub path: PathBuf,
    /// The mask: which of its pixels count, as large as the photo.
    pub mask: Option<PathBuf>,
    /// Width and height as delivered, px.
    pub size: UVec2,
    /// Width and height of the file, px.
    pub stored: UVec2,
    pub(super) undistort: Option<Undistort>,
    pub(super) background: Background,
    pub(super) masks: Masks,
    pub(super) drawn: Option<Arc<Pixels>>,
}

impl Photo {
    /// A picture in memory, as if it had been decoded.
    pub fn drawn(pixels: Pixels) -> Self {
        Self {
            path: PathBuf::new(),
            mask: None,
            size: pixels.size,
            stored: pixels.size,
            undistort: None,
            background: Background([0; 3]),
            masks: Masks::Off,
            drawn: Some(Arc::new(pixels)),
        }
    }

    /// The photo as training wants it: blended with the background, masked, undistorted, shrunk.
    /// `alpha` is then the weight of each pixel in the loss, `None` where all count.
    pub fn decode(&self) -> Result<Pixels> {
        if let Some(drawn) = &self.drawn {
            return Ok(Pixels::clone(drawn));
        }
        let mut pixels = Pixels::load(&self.path)?;
        self.check_size(&self.path, pixels.size)?;
        pixels = pixels.over(self.background.0);
        if let Some(mask) = &self.mask {
            let (size, weights) = Pixels::load_mask(mask)?;
            self.check_size(mask, size)?;
            pixels.alpha = Some(weights);
            if self.masks == Masks::Cut {
                pixels = pixels.over(self.background.0);
            }
        }
        if let Some(undistort) = &self.undistort {
            pixels = undistort.apply(&pixels);
        }
        if pixels.size != self.size {
            pixels = pixels.downscaled(self.size);
        }
        Ok(pixels)
    }

    fn check_size(&self, path: &Path, size: UVec2) -> Result<()> {
        if size == self.stored {
            return Ok(());
        }
        let (want, photo) = (self.stored, self.path.display());
        let reason = format!("is {}x{}, the photo {photo} is {}x{}", size.x, size.y, want.x, want.y);
        Err(Error::malformed(path, "size", format!("{reason}; a mask must be as large as its photo")))
    }
}
