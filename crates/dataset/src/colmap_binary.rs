//! COLMAP's binary model: cameras.bin, images.bin, points3D.bin (little endian).
//!
//! Every count is compared with the remaining bytes before memory is allocated.

use super::colmap_model::{self, ColmapModel, ImageRow, ListedPoint};
use glam::{DMat3, DVec3, Vec2};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result, input};

/// A 2D point that belongs to no 3D point.
const NO_POINT: u64 = u64::MAX;

/// Reads cameras and images of a folder. Observations are most of the file; they are skipped unless
/// `observations` is set.
pub(super) fn read(folder: &Path, limits: &Limits, observations: bool) -> Result<ColmapModel> {
    let mut model = ColmapModel::default();
    read_cameras(&mut BinaryFile::open(folder.join("cameras.bin"), limits)?, &mut model)?;
    read_images(
        &mut BinaryFile::open(folder.join("images.bin"), limits)?,
        observations,
        &mut model,
    )?;
    Ok(model)
}

fn read_cameras(bytes: &mut BinaryFile, model: &mut ColmapModel) -> Result<()> {
    let count = bytes.count("cameras", 24 + 3 * 8)?;
    for _ in 0..count {
        let id = u32::from_le_bytes(bytes.take()?);
        let number = i32::from_le_bytes(bytes.take()?);
        let size = [u64::from_le_bytes(bytes.take()?), u64::from_le_bytes(bytes.take()?)];
        let Some(name) = colmap_model::camera_model_name(number) else {
            return Err(
                bytes.malformed(format!("camera {id} has model {number}, which does not exist"))
            );
        };
        let params: Vec<f64> = (0..colmap_model::parameter_count(&bytes.path, name)?)
            .map(|_| Ok(f64::from_le_bytes(bytes.take()?)))
            .collect::<Result<_>>()?;
        model.cameras.insert(id, colmap_model::lens(&bytes.path, name, size, &params)?);
    }
    bytes.end()
}

fn read_images(bytes: &mut BinaryFile, observations: bool, model: &mut ColmapModel) -> Result<()> {
    let count = bytes.count("images", 4 + 7 * 8 + 4 + 1 + 8)?;
    for _ in 0..count {
        let _number: [u8; 4] = bytes.take()?;
        let quaternion = bytes.floats::<4>()?;
        let translation = DVec3::from(bytes.floats::<3>()?);
        let camera = u32::from_le_bytes(bytes.take()?);
        let name = bytes.name()?;
        let observation_count = bytes.count("2D points", 24)?;
        let observations = if observations {
            read_observations(bytes, observation_count)?
        } else {
            bytes.skip(24 * observation_count as u64).map(|()| Vec::new())?
        };
        let rotation = DMat3::IDENTITY;
        let image = ImageRow { name, camera, rotation, translation, observations };
        model.add_image(image, quaternion, |reason| bytes.malformed(reason));
    }
    bytes.end()
}

fn read_observations(bytes: &mut BinaryFile, count: usize) -> Result<Vec<(u64, Vec2)>> {
    let mut observations = Vec::new();
    for _ in 0..count {
        let row: [u8; 24] = bytes.take()?;
        let number = |at: usize| row[at..at + 8].try_into().unwrap_or([0; 8]);
        let point = u64::from_le_bytes(number(16));
        if point != NO_POINT {
            let x = f64::from_le_bytes(number(0));
            let y = f64::from_le_bytes(number(8));
            observations.push((point, Vec2::new(x as f32, y as f32)));
        }
    }
    Ok(observations)
}

/// The points of the file at `path`.
pub(super) fn points(path: &Path, limits: &Limits) -> Result<Vec<ListedPoint>> {
    let mut bytes = BinaryFile::open(path.to_owned(), limits)?;
    let count = bytes.count("points", 8 + 3 * 8 + 3 + 8 + 8)?;
    limits.vertices(bytes.path.display(), count as u64)?;
    let mut points = Vec::new();
    limits.reserve(bytes.path.display(), &mut points, count)?;
    for _ in 0..count {
        let id = u64::from_le_bytes(bytes.take()?);
        let position = DVec3::from(bytes.floats::<3>()?);
        let rgb = bytes.take()?;
        let error = f64::from_le_bytes(bytes.take()?);
        let track = bytes.count("track entries", 8)?;
        bytes.skip(track as u64 * 8)?;
        points.push(ListedPoint::of(id, position, rgb, error));
    }
    bytes.end().map(|()| points)
}

/// A file read front to back, with the number of remaining bytes.
struct BinaryFile {
    path: PathBuf,
    reader: BufReader<File>,
    at: u64,
    len: u64,
}

impl BinaryFile {
    fn open(path: PathBuf, limits: &Limits) -> Result<Self> {
        let (file, len) = input::open(&path, limits)?;
        Ok(Self { reader: BufReader::with_capacity(1 << 18, file), path, at: 0, len })
    }

    fn malformed(&self, reason: impl Into<String>) -> Error {
        Error::malformed(&self.path, format!("byte {}", self.at), reason)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        if self.len - self.at < N as u64 {
            return Err(self.malformed("the file ends here, cut short; copy or make it again"));
        }
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes).map_err(|e| Error::io(&self.path, e))?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn floats<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = f64::from_le_bytes(self.take()?);
        }
        Ok(numbers)
    }

    /// A count of items of at least `bytes_each`, which must fit into the rest of the file.
    fn count(&mut self, what: &str, bytes_each: u64) -> Result<usize> {
        let count = u64::from_le_bytes(self.take()?);
        let remaining = self.len - self.at;
        if count > remaining / bytes_each {
            return Err(self
                .malformed(format!("promises {count} {what}, but only {remaining} bytes follow")));
        }
        Ok(count as usize)
    }

    /// A name up to its zero byte.
    fn name(&mut self) -> Result<String> {
        let mut name = Vec::new();
        loop {
            let [byte] = self.take()?;
            if byte == 0 {
                break;
            }
            if name.len() == 4096 {
                return Err(self.malformed("a photo's name does not end within 4096 bytes"));
            }
            name.push(byte);
        }
        String::from_utf8(name)
            .map_err(|e| self.malformed(format!("a photo's name is not UTF-8: {e}")))
    }

    fn skip(&mut self, bytes: u64) -> Result<()> {
        let step = i64::try_from(bytes).map_err(|_| self.malformed("a track too long"))?;
        self.reader.seek_relative(step).map_err(|e| Error::io(&self.path, e))?;
        self.at += bytes;
        Ok(())
    }

    fn end(&self) -> Result<()> {
        if self.at == self.len {
            return Ok(());
        }
        Err(self.malformed(format!(
            "{} bytes follow the last entry; this is not a COLMAP file",
            self.len - self.at
        )))
    }
}
