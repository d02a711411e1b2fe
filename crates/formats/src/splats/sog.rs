//! SOG version 2 (playcanvas/splat-transform): a zip archive of `meta.json` and WebP pictures, a
//! pixel per Gaussian.
//!
//! ```text
//! means    two pictures, low and high bytes of 16-bit shares between mins and maxs of sign(x) ln(1 + |x|)
//! scales   a byte per axis into a codebook of logarithms      sh0  rgb into a codebook of sh[0], alpha is the opacity
//! quats    alpha - 252 is the number of the largest of w, x, y, z; the others are (2 byte / 255 - 1) / √2
//! shN      a 16-bit number per Gaussian in a list of coefficients, 64 a row, each a byte into a codebook
//! ```

use super::{finish, read_all, unit, with_largest, zeroed};
use crate::gltf::MAX_UNPACK_RATIO;
use crate::{ReadOptions, Source, format};
use glam::{DVec3, UVec2, Vec3};
use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder, RgbaImage};
use serde::Deserialize;
use std::borrow::Cow;
use std::f64::consts::FRAC_1_SQRT_2;
use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;
use trisplat_scene::{
    Error, ImportedSplats, Limits, Provenance, Result, ScreenFilter, Splats, sh_count,
};

/// Maximum bytes of `meta.json`: three codebooks take some 20 kB.
const MAX_META: u64 = 1 << 20;
/// Lists of coefficients side by side in their picture.
const LISTS_PER_ROW: usize = 64;
/// Lists that a number of 16 bits tells apart.
const MAX_LISTS: usize = 1 << 16;
/// Pixels that may be added to four times as many as Gaussians: some writers fill squares of a
/// power of two.
const SPARE_PIXELS: usize = 1 << 12;
/// Bytes of a picture without pixels, at most: colour profiles and texts.
const SPARE_BYTES: u64 = 1 << 16;
/// Bytes of a Gaussian in the pictures that every file has.
const PER_SPLAT: u64 = 20;

#[derive(Deserialize)]
struct Version {
    version: Option<u32>,
}

#[derive(Deserialize)]
struct Meta {
    count: usize,
    #[serde(default)]
    antialias: bool,
    means: Means,
    scales: Coded,
    quats: Quats,
    sh0: Coded,
    #[serde(rename = "shN")]
    higher: Option<Higher>,
}

#[derive(Deserialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Coded {
    codebook: Vec<f64>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Quats {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Higher {
    bands: u8,
    codebook: Vec<f64>,
    files: [String; 2],
}

/// An open archive.
struct Archive<'a> {
    path: &'a Path,
    zip: zip::ZipArchive<BufReader<&'a File>>,
    /// The folder of `meta.json` in it.
    folder: String,
    /// Bytes of the file.
    len: u64,
    limits: Limits,
}

/// A picture, RGBA.
struct SogPicture {
    name: String,
    rgba: RgbaImage,
}

impl SogPicture {
    fn pixels(&self) -> &[[u8; 4]] {
        self.rgba.as_raw().as_chunks().0
    }
}

/// True for an open zip archive that is a scene in SOG; false for a broken one.
pub(crate) fn is_sog(source: &mut Source) -> Result<bool> {
    let names = zip::ZipArchive::new(BufReader::new(&*source.file))
        .map(|zip| names(&zip))
        .unwrap_or_default();
    source.rewind()?;
    Ok(format::is_sog(&names))
}

/// The names of an archive's entries.
pub(crate) fn names(zip: &zip::ZipArchive<BufReader<&File>>) -> Vec<String> {
    zip.file_names().flatten().map(Cow::into_owned).collect()
}

/// The Gaussians of the archive.
pub(crate) fn read(source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let path = &source.path;
    let mut archive = Archive::open(&source, &options.limits)?;
    let json = archive.bytes("meta.json", MAX_META)?;
    let parse = |e: serde_json::Error| Error::malformed(path, "meta.json", e.to_string());
    match serde_json::from_slice::<Version>(&json).map_err(parse)?.version {
        Some(2) => {}
        other => {
            let version = other.unwrap_or(1);
            return Err(format::unread(path, &format!("SOG version {version}")));
        }
    }
    let meta: Meta = serde_json::from_slice(&json).map_err(parse)?;
    let splats = archive.splats(&meta, options.sh_degree)?;
    finish(path, splats, Provenance::default(), Vec::new(), DVec3::ZERO)
}

impl<'a> Archive<'a> {
    fn open(source: &'a Source, limits: &Limits) -> Result<Self> {
        let path = &source.path;
        let zip = zip::ZipArchive::new(BufReader::new(&*source.file))
            .map_err(|e| Error::malformed(path, "zip directory", e.to_string()))?;
        let meta =
            names(&zip).into_iter().find(|name| name.rsplit('/').next() == Some("meta.json"));
        let folder = meta.and_then(|name| name.strip_suffix("meta.json").map(str::to_owned));
        Ok(Self { path, zip, folder: folder.unwrap_or_default(), len: source.len, limits: *limits })
    }

    /// The bytes of an entry, at most `max_bytes`.
    fn bytes(&mut self, name: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let entry = self
            .zip
            .by_name(&format!("{}{name}", self.folder))
            .map_err(|e| Error::malformed(self.path, name, format!("cannot be read: {e}")))?;
        let promised = entry.size();
        if promised > max_bytes {
            let reason = format!(
                "unpacks to {promised} bytes; what it stands for needs at most {max_bytes}"
            );
            return Err(Error::malformed(self.path, name, reason));
        }
        let bytes = read_all(self.path, entry, promised, &self.limits)
            .map_err(|e| Error::malformed(self.path, name, format!("cannot be read: {e}")))?;
        if bytes.len() as u64 != promised {
            return Err(Error::malformed(
                self.path,
                name,
                "is shorter or longer than the archive says",
            ));
        }
        Ok(bytes)
    }

    /// A picture of `min_pixels` to `max_pixels` pixels.
    fn picture(&mut self, name: &str, min_pixels: usize, max_pixels: usize) -> Result<SogPicture> {
        let bytes = self.bytes(name, SPARE_BYTES + 4 * max_pixels as u64)?;
        let broken = |e: image::ImageError| {
            Error::malformed(self.path, name, format!("is no whole WebP picture: {e}"))
        };
        let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(broken)?;
        let size = UVec2::from(decoder.dimensions());
        self.limits.picture(format!("{}: {name}", self.path.display()), size)?;
        let pixels = size.as_usizevec2().element_product();
        if !(min_pixels..=max_pixels).contains(&pixels) {
            let reason = format!("has {pixels} pixels; expected {min_pixels} to {max_pixels}");
            return Err(Error::malformed(self.path, name, reason));
        }
        let rgba = DynamicImage::from_decoder(decoder).map_err(broken)?.into_rgba8();
        Ok(SogPicture { name: name.to_owned(), rgba })
    }

    /// A picture with a pixel for each of `count` Gaussians.
    fn picture_of(&mut self, name: &str, count: usize) -> Result<SogPicture> {
        self.picture(name, count, 4 * count + SPARE_PIXELS)
    }

    fn splats(&mut self, meta: &Meta, highest: u8) -> Result<Splats> {
        let count = meta.count;
        let len = self.len;
        self.limits.vertices(self.path.display(), count as u64)?;
        if count as u64 * PER_SPLAT > MAX_UNPACK_RATIO.saturating_mul(len) {
            let reason =
                format!("promises {count} Gaussians, more than a file of {len} bytes can hold");
            return Err(Error::malformed(self.path, "meta.json", reason));
        }
        let scale_codes = self.codes(&meta.scales.codebook)?;
        let color_codes = self.codes(&meta.sh0.codebook)?;
        // No more than two pictures are in memory at once.
        let [low, high] = [&meta.means.files[0], &meta.means.files[1]];
        let low = self.picture_of(low, count)?;
        let high = self.picture_of(high, count)?;
        let degree = meta.higher.as_ref().map_or(0, |higher| higher.bands.min(highest));
        let mut splats = zeroed(self.path, count, degree.min(3), &self.limits)?;
        let k = splats.sh_count();
        for (position, (low, high)) in
            splats.positions.iter_mut().zip(low.pixels().iter().zip(high.pixels()))
        {
            let mean = |axis: usize| {
                let share = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65535.0;
                let min = meta.means.mins[axis];
                let max = meta.means.maxs[axis];
                let logarithm = min + (max - min) * share;
                (logarithm.abs().exp() - 1.0) * logarithm.signum()
            };
            *position = DVec3::new(mean(0), mean(1), mean(2)).as_vec3();
        }
        drop((low, high));
        let quats = self.picture_of(&meta.quats.files[0], count)?;
        for (i, (rotation, pixel)) in splats.rotations.iter_mut().zip(quats.pixels()).enumerate() {
            *rotation = unit(self.rotation(*pixel, i)?);
        }
        drop(quats);
        let scales = self.picture_of(&meta.scales.files[0], count)?;
        for (scale, [x, y, z, _]) in splats.scales.iter_mut().zip(scales.pixels()) {
            *scale = Vec3::from([x, y, z].map(|code| scale_codes[usize::from(*code)].exp() as f32));
        }
        drop(scales);
        let colors = self.picture_of(&meta.sh0.files[0], count)?;
        for (i, [r, g, b, opacity]) in colors.pixels().iter().take(count).enumerate() {
            splats.sh[i * k] = [r, g, b].map(|code| color_codes[usize::from(*code)] as f32);
            splats.opacity[i] = f32::from(*opacity) / 255.0;
        }
        drop(colors);
        if let Some(higher) = &meta.higher {
            self.add_higher(higher, &mut splats)?;
        }
        if meta.antialias {
            splats.filter = ScreenFilter::ANTIALIASED;
        }
        Ok(splats)
    }

    /// A codebook with all the codes of a byte.
    fn codes(&self, codebook: &[f64]) -> Result<[f64; 256]> {
        codebook.try_into().map_err(|_| {
            let reason = format!("has a codebook of {} numbers; expected 256", codebook.len());
            Error::malformed(self.path, "meta.json", reason)
        })
    }

    /// w, x, y, z.
    fn rotation(&self, [a, b, c, tag]: [u8; 4], splat: usize) -> Result<[f64; 4]> {
        let Some(largest) = tag.checked_sub(252) else {
            let reason = format!("Gaussian {splat} has alpha {tag}; expected 252 to 255");
            return Err(Error::malformed(self.path, "quats", reason));
        };
        let others = [a, b, c].map(|byte| (f64::from(byte) / 255.0 * 2.0 - 1.0) * FRAC_1_SQRT_2);
        Ok(with_largest(others, largest))
    }

    /// Coefficients above degree 0.
    fn add_higher(&mut self, higher: &Higher, splats: &mut Splats) -> Result<()> {
        let count = splats.len();
        let k = splats.sh_count();
        if !(1..=3).contains(&higher.bands) {
            let reason = format!("has shN of {} bands; expected 1 to 3", higher.bands);
            return Err(Error::malformed(self.path, "meta.json", reason));
        }
        let codes = self.codes(&higher.codebook)?;
        let per_list = sh_count(higher.bands) - 1;
        let lists = self.picture(&higher.files[0], 0, MAX_LISTS * per_list)?;
        let labels = self.picture_of(&higher.files[1], count)?;
        if lists.rgba.width() as usize != LISTS_PER_ROW * per_list {
            let reason =
                format!("is {} px wide; expected {}", lists.rgba.width(), LISTS_PER_ROW * per_list);
            return Err(Error::malformed(self.path, lists.name, reason));
        }
        for (i, [low, high, ..]) in labels.pixels().iter().take(count).enumerate() {
            let first = usize::from(u16::from_le_bytes([*low, *high])) * per_list;
            let Some(list) = lists.pixels().get(first..first + per_list) else {
                let reason = format!("Gaussian {i} names a list of coefficients that is not there");
                return Err(Error::malformed(self.path, labels.name, reason));
            };
            for (out, [r, g, b, _]) in splats.sh[i * k + 1..(i + 1) * k].iter_mut().zip(list) {
                *out = [*r, *g, *b].map(|code| codes[usize::from(code)] as f32);
            }
        }
        Ok(())
    }
}
