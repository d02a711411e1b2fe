//! Decoded pictures in a temporary file, which come back at the speed of a copy.

use glam::UVec2;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::{Mutex, PoisonError};
use trisplat_scene::image::RgbImage;

/// A temporary file without a name, made for the first picture.
#[derive(Debug, Default)]
pub struct PictureFile {
    state: Mutex<PictureFileState>,
}

#[derive(Debug, Default)]
struct PictureFileState {
    file: Option<File>,
    end: u64,
}

/// The place of a picture in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredPicture {
    at: u64,
    size: UVec2,
    alpha: bool,
}

impl PictureFile {
    /// Adds a picture. Fails when the disk is full.
    pub fn put(&self, pixels: &RgbImage) -> io::Result<StoredPicture> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let at = state.end;
        let file = match &mut state.file {
            Some(file) => file,
            empty => empty.insert(tempfile::tempfile()?),
        };
        file.seek(SeekFrom::Start(at))?;
        file.write_all(bytemuck::cast_slice(&pixels.rgb))?;
        file.write_all(pixels.alpha.as_deref().unwrap_or_default())?;
        state.end = at + pixels.bytes();
        Ok(StoredPicture { at, size: pixels.size, alpha: pixels.alpha.is_some() })
    }

    /// A picture of this file.
    pub fn get(&self, place: StoredPicture) -> io::Result<RgbImage> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let file = state.file.as_mut().ok_or(io::ErrorKind::NotFound)?;
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
            RgbImage { size, rgb, alpha: alpha.then(|| (0..count).map(|i| (7 * i) as u8).collect()) }
        };
        let (a, b) = (picture(1, UVec2::new(5, 3), false), picture(2, UVec2::new(2, 9), true));
        let file = PictureFile::default();
        let (at_a, at_b) = (file.put(&a).unwrap(), file.put(&b).unwrap());
        for _ in 0..2 {
            assert_eq!(file.get(at_b).unwrap(), b);
            assert_eq!(file.get(at_a).unwrap(), a);
        }
        assert!(PictureFile::default().get(at_a).is_err(), "of another file");
    }
}
