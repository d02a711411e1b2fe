//! One photo: on disk with its processing steps, or drawn, in memory or in a temporary file.

use super::depth::{DepthFile, DepthPicture, PlaceInFile};
use super::lens::Undistort;
use super::options::PhotoBackground;
use glam::UVec2;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Limits, Result};

/// A photo that is decoded on request, or a picture in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// The picture file; empty for a picture in memory.
    pub path: PathBuf,
    /// The mask, as large as the photo.
    pub mask: Option<PathBuf>,
    /// The depth map, with the shape of the photo.
    pub(super) depth: Option<DepthFile>,
    /// Width and height as delivered, px.
    pub size: UVec2,
    /// Width and height of the file, px.
    pub stored: UVec2,
    pub(super) undistort: Option<Undistort>,
    pub(super) background: PhotoBackground,
    /// Limits on its files.
    pub limits: Limits,
    pub(super) drawn: Option<PreparedPhoto>,
    /// True when it shows an object without background, cut out by its alpha or mask.
    pub(super) cut: bool,
    /// The selected part of it.
    pub(super) crop: Option<Crop>,
    /// Maximum bytes that decoding its file takes.
    pub(super) decoding: u64,
}

/// A part of a photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crop {
    /// Its upper left corner, px of the whole.
    pub(super) corner: UVec2,
    /// Width and height of the whole, px.
    pub(super) whole: UVec2,
}

/// A picture that needs no decoding.
#[derive(Debug, Clone)]
pub(super) enum PreparedPhoto {
    /// In memory.
    Held(Arc<RgbImage>),
    /// In a temporary file.
    Stored(Arc<PictureFile>, StoredPhoto),
}

impl PartialEq for PreparedPhoto {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (PreparedPhoto::Held(a), PreparedPhoto::Held(b)) => a == b,
            (PreparedPhoto::Stored(a, at), PreparedPhoto::Stored(b, other)) => {
                Arc::ptr_eq(a, b) && at == other
            }
            _ => false,
        }
    }
}

impl Photo {
    /// A picture in memory, like a decoded photo.
    pub fn drawn(pixels: RgbImage) -> Self {
        Self::of(pixels.size, PreparedPhoto::Held(Arc::new(pixels)))
    }

    /// A picture stored in `file`, like a decoded photo. Fails when the disk is full.
    pub fn stored(pixels: &RgbImage, file: &Arc<PictureFile>) -> Result<Self> {
        let place = file.put(pixels).map_err(Error::temporary)?;
        Ok(Self::of(pixels.size, PreparedPhoto::Stored(Arc::clone(file), place)))
    }

    /// The same as a picture of an object without background: see [`Photo::is_cut`].
    pub fn cut_out(self) -> Self {
        Self { cut: true, ..self }
    }

    fn of(size: UVec2, drawn: PreparedPhoto) -> Self {
        Self {
            path: PathBuf::new(),
            mask: None,
            depth: None,
            size,
            stored: size,
            undistort: None,
            background: PhotoBackground([0; 3]),
            limits: Limits::DEFAULT,
            drawn: Some(drawn),
            cut: false,
            crop: None,
            decoding: 0,
        }
    }

    /// The part of `size` px whose upper left corner is at `corner`.
    pub(super) fn cropped(&self, corner: UVec2, size: UVec2) -> Self {
        let whole = self.crop.map_or(self.size, |crop| crop.whole);
        let corner = corner + self.crop.map_or(UVec2::ZERO, |crop| crop.corner);
        Self { crop: Some(Crop { corner, whole }), size, ..self.clone() }
    }

    /// True for a photo of an object without background: it has transparent pixels, or a mask that
    /// cuts.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// True for a picture in memory or in a temporary file, false for a photo.
    pub fn is_drawn(&self) -> bool {
        self.drawn.is_some()
    }

    /// True for a photo that `max_size` shrinks.
    pub(super) fn is_shrunk(&self) -> bool {
        let full = self.undistort.map_or(self.stored, |plan| plan.pinhole.size);
        self.crop.map_or(self.size, |crop| crop.whole) != full
    }

    /// The photo for training: blended with the background, masked, undistorted, shrunk. `alpha` is
    /// the weight of each pixel in the loss, `None` when all are 1. In a [cut](Photo::is_cut) photo
    /// it is the share of the pixel that the object covers, and the colours are over black.
    pub fn decode(&self) -> Result<RgbImage> {
        let whole = match &self.drawn {
            Some(PreparedPhoto::Held(pixels)) => RgbImage::clone(pixels),
            Some(PreparedPhoto::Stored(file, place)) => {
                file.get(*place).map_err(Error::temporary)?
            }
            None => self.decode_file()?,
        };
        Ok(match self.crop {
            Some(crop) => whole.part(crop.corner, self.size),
            None => whole,
        })
    }

    /// The file of its depth map.
    pub fn depth(&self) -> Option<&DepthFile> {
        self.depth.as_ref()
    }

    /// Its depth map, decoded; `None` without one.
    ///
    /// # Errors
    ///
    /// A file that cannot be decoded, or is no grey PNG.
    pub fn decode_depth(&self) -> Result<Option<DepthPicture>> {
        let crop = self.crop.unwrap_or(Crop { corner: UVec2::ZERO, whole: self.size });
        let place =
            PlaceInFile { whole: crop.whole, corner: crop.corner, undistort: self.undistort };
        self.depth.as_ref().map(|map| map.decode(place, &self.limits)).transpose()
    }

    /// The mask alone, undistorted but not shrunk: its size and weights. `None` without a mask.
    pub(super) fn decode_mask(&self) -> Result<Option<(UVec2, Vec<u8>)>> {
        let Some(mask) = &self.mask else { return Ok(None) };
        let (size, weights) = RgbImage::load_mask(mask, &self.limits)?;
        self.check_size(mask, size)?;
        let Some(undistort) = &self.undistort else { return Ok(Some((size, weights))) };
        let rgb = vec![[0; 3]; weights.len()];
        let straight = undistort.apply(&RgbImage { size, rgb, alpha: Some(weights) });
        Ok(straight.alpha.map(|weights| (straight.size, weights)))
    }

    /// The whole photo, from its file.
    fn decode_file(&self) -> Result<RgbImage> {
        let (mut pixels, full) = self.load()?;
        self.check_size(&self.path, full)?;
        if self.mask.is_some() || !self.cut {
            pixels = pixels.over(self.background.0);
        }
        if let Some(mask) = &self.mask {
            let (size, weights) = RgbImage::load_mask(mask, &self.limits)?;
            self.check_size(mask, size)?;
            pixels.alpha = Some(weights);
        }
        if self.cut {
            // Over black, so that shrinking and undistorting mix in no invisible colour.
            let alpha = pixels.alpha.clone();
            pixels = RgbImage { alpha, ..pixels.over([0; 3]) };
        }
        if let Some(undistort) = &self.undistort {
            pixels = undistort.apply(&pixels);
        }
        let size = self.crop.map_or(self.size, |crop| crop.whole);
        if pixels.size != size {
            pixels = pixels.downscaled(size);
        }
        Ok(pixels)
    }

    /// The file's picture, decoded smaller if it is shrunk to less than half; and its full size.
    fn load(&self) -> Result<(RgbImage, UVec2)> {
        // A mask is as large as the whole photo.
        if self.mask.is_none() && !self.cut && self.is_shrunk() {
            let whole = self.undistort.map_or(self.stored, |plan| plan.pinhole.size);
            let size = self.crop.map_or(self.size, |crop| crop.whole);
            let ratio = size.as_dvec2() / whole.as_dvec2();
            // Averages of at least two by two pixels are those of the whole photo, closely
            // (docs/benchmarks/figures.md).
            let min_size = (2.0 * self.stored.as_dvec2() * ratio).ceil().as_uvec2();
            return RgbImage::load_reduced(&self.path, min_size, &self.limits);
        }
        let pixels = RgbImage::load_within(&self.path, &self.limits)?;
        let size = pixels.size;
        Ok((pixels, size))
    }

    /// The picture, if it is in memory.
    pub(super) fn pixels_in_memory(&self) -> Option<Arc<RgbImage>> {
        match &self.drawn {
            Some(PreparedPhoto::Held(pixels)) if self.crop.is_none() => Some(Arc::clone(pixels)),
            _ => None,
        }
    }

    /// True when its pixels are in a temporary file already.
    pub(super) fn is_stored(&self) -> bool {
        matches!(self.drawn, Some(PreparedPhoto::Stored(..)))
    }

    /// Maximum bytes in memory while it is decoded, the result included; of a picture in a
    /// temporary file, the result.
    pub(super) fn decoding_bytes(&self) -> u64 {
        // Beside the picture: its mask, or the same without distortion.
        let stored = u64::from(self.stored.x) * u64::from(self.stored.y);
        let second_picture =
            if self.mask.is_some() || self.undistort.is_some() { 4 * stored } else { 0 };
        let whole = if self.is_drawn() { 0 } else { self.decoding + second_picture };
        whole.max(self.most_bytes())
    }

    /// Maximum bytes of the decoded photo in memory.
    pub fn most_bytes(&self) -> u64 {
        4 * u64::from(self.size.x) * u64::from(self.size.y)
    }

    fn check_size(&self, path: &Path, size: UVec2) -> Result<()> {
        check_mask(path, &self.path, size, self.stored)
    }
}

/// Refuses a mask of `size`, or a photo changed since, that is not as large as the `photo` was.
pub(super) fn check_mask(path: &Path, photo: &Path, size: UVec2, photo_size: UVec2) -> Result<()> {
    if size == photo_size {
        return Ok(());
    }
    let photo = photo.display();
    let want = photo_size;
    let reason = format!("is {}x{}, the photo {photo} is {}x{}", size.x, size.y, want.x, want.y);
    Err(Error::malformed(path, "size", format!("{reason}; a mask must be as large as its photo")))
}

/// A temporary file without a name, made for the first picture, and where it ends.
#[derive(Debug, Default)]
pub struct PictureFile(Mutex<(Option<File>, u64)>);

/// The place of a picture in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredPhoto {
    at: u64,
    size: UVec2,
    alpha: bool,
}

impl PictureFile {
    /// Adds a picture. Fails when the disk is full.
    pub fn put(&self, pixels: &RgbImage) -> io::Result<StoredPhoto> {
        let (file, end) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at = *end;
        let file = match file {
            Some(file) => file,
            empty => empty.insert(tempfile::tempfile()?),
        };
        file.seek(SeekFrom::Start(at))?;
        file.write_all(bytemuck::cast_slice(&pixels.rgb))?;
        file.write_all(pixels.alpha.as_deref().unwrap_or_default())?;
        *end = at + pixels.bytes();
        Ok(StoredPhoto { at, size: pixels.size, alpha: pixels.alpha.is_some() })
    }

    /// A picture of this file.
    pub fn get(&self, place: StoredPhoto) -> io::Result<RgbImage> {
        let (file, _) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let file = file.as_mut().ok_or(io::ErrorKind::NotFound)?;
        let count = place.size.x as usize * place.size.y as usize;
        let mut rgb = vec![[0u8; 3]; count];
        let mut alpha = place.alpha.then(|| vec![0u8; count]);
        file.seek(SeekFrom::Start(place.at))?;
        file.read_exact(bytemuck::cast_slice_mut(&mut rgb))?;
        if let Some(alpha) = &mut alpha {
            file.read_exact(alpha)?;
        }
        Ok(RgbImage { size: place.size, rgb, alpha })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_as_they_were() {
        let picture = |seed: u8, size: UVec2, alpha: bool| {
            let count = (size.x * size.y) as usize;
            let rgb = (0..count).map(|i| [seed, i as u8, (i / 3) as u8]).collect();
            RgbImage {
                size,
                rgb,
                alpha: alpha.then(|| (0..count).map(|i| (7 * i) as u8).collect()),
            }
        };
        let a = picture(1, UVec2::new(5, 3), false);
        let b = picture(2, UVec2::new(2, 9), true);
        let file = PictureFile::default();
        let at_a = file.put(&a).unwrap();
        let at_b = file.put(&b).unwrap();
        for _ in 0..2 {
            assert_eq!(file.get(at_b).unwrap(), b);
            assert_eq!(file.get(at_a).unwrap(), a);
        }
        assert!(PictureFile::default().get(at_a).is_err(), "of another file");
    }
}
