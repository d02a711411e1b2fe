//! View-dependent colours in a glTF file: coefficients of spherical harmonics as texels.
//!
//! ```text
//! COLOR_0            the plain colours, which every viewer shows
//! TEXCOORD_0         equal at the corners of a triangle: the middle of its first texel
//! occlusionTexture   strength 0, so that plain viewers do not see it: a PNG of a triangle's
//!                    coefficients in a row, by degree, (code - 128) / 127 · scale of the degree
//! extras             {"trisplat_sh": {"degree", "scale"}}
//! ```
//!
//! The colour of a corner is its COLOR_0, sRGB-encoded, plus Σ_j c_j Y_j(d), bounded to 0 to 1,
//! with d from the camera to the corner in the frame of the file: see [`FaceSh`] and
//! docs/formats.md. The picture is found by coordinates alone, because importers order vertices and
//! flip pictures anew.

use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Asset, Error, FaceSh, MAX_SH_DEGREE, MAX_SH_PICTURE_SIDE, Result, sh_count};

/// The code of 0.
const ZERO: f32 = 128.0;
/// The codes from 0 to the largest coefficient.
const STEPS: f32 = 127.0;

/// Key of [`ShExtras`] in the extras of a material.
pub(crate) const KEY: &str = "trisplat_sh";

/// View-dependent colours of a material, as `extras.trisplat_sh` in a glTF file: degree and scales
/// of the picture of its `occlusionTexture`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat_sh")]
pub struct ShExtras {
    /// Degree of the harmonics: a triangle has (degree + 1)² texels.
    #[schemars(range(min = 1, max = 3))]
    pub degree: u8,
    /// The coefficient of code 255, for each degree from 0 on.
    #[schemars(length(min = 2, max = 4), inner(range(min = 0.0)))]
    pub scale: Vec<f32>,
}

/// Places of the triangles of a scene in its picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ShLayout {
    /// Texels per triangle.
    width: u32,
    /// Triangles in a row.
    columns: u32,
    size: UVec2,
}

impl ShLayout {
    /// For the first `faces` triangles, in the smallest picture whose sides are powers of two,
    /// which every engine takes as it is.
    ///
    /// # Errors
    ///
    /// More triangles than a picture of 2048² holds.
    fn new(degree: u8, faces: usize) -> Result<Self> {
        let width = sh_count(degree) as u32;
        let layout = |across: u32| {
            let columns = across / width;
            let rows = (faces.div_ceil(columns as usize).max(1) as u32).next_power_of_two();
            Self { width, columns, size: UVec2::new(across, rows) }
        };
        let layouts = (width.next_power_of_two().ilog2()..=MAX_SH_PICTURE_SIDE.ilog2())
            .map(|power| layout(1 << power))
            .filter(|layout| layout.size.y <= MAX_SH_PICTURE_SIDE);
        layouts
            .min_by_key(|layout| (layout.size.element_product(), layout.size.max_element()))
            .ok_or_else(|| {
                let most = FaceSh::max_faces(degree);
                let wants = format!("at most {most} triangles, or a lower degree");
                Error::invalid("sh", format!("{degree} of {faces} triangles"), wants)
            })
    }

    /// Texture coordinates of a face: the middle of its first texel.
    pub(crate) fn coordinates(&self, face: usize) -> Vec2 {
        let face = face as u32;
        let texel = UVec2::new(face % self.columns * self.width, face / self.columns);
        (texel.as_vec2() + 0.5) / self.size.as_vec2()
    }
}

/// The harmonics of an asset, as they are stored.
pub(crate) struct StoredSh {
    pub(crate) extras: ShExtras,
    pub(crate) layout: ShLayout,
    pub(crate) picture: RgbImage,
}

impl StoredSh {
    /// The harmonics of the scene's triangles, which come before a backdrop; `None` without any.
    ///
    /// # Errors
    ///
    /// Too many triangles for a picture.
    pub(crate) fn of(asset: &Asset) -> Result<Option<Self>> {
        let Some(sh) = asset.mesh.sh.as_ref().filter(|_| asset.mesh.texture.is_none()) else {
            return Ok(None);
        };
        let faces = asset.scene_faces();
        let layout = ShLayout::new(sh.degree(), faces)?;
        let scale = scales(sh, faces);
        let mut rgb = vec![[ZERO as u8; 3]; layout.size.element_product() as usize];
        for face in 0..faces {
            let column = face % layout.columns as usize * layout.width as usize;
            let first = face / layout.columns as usize * layout.size.x as usize + column;
            for (j, coefficient) in sh.face(face).iter().enumerate() {
                rgb[first + j] = coefficient.map(|value| code(value, scale[degree_of(j)]));
            }
        }
        let picture = RgbImage { size: layout.size, rgb, alpha: None };
        Ok(Some(Self { extras: ShExtras { degree: sh.degree(), scale }, layout, picture }))
    }
}

/// Degree of coefficient `j`.
fn degree_of(j: usize) -> usize {
    j.isqrt()
}

/// The largest coefficient of each degree. A scale of 0 would divide by 0 in readers.
fn scales(sh: &FaceSh, faces: usize) -> Vec<f32> {
    let mut scales = vec![f32::MIN_POSITIVE; usize::from(sh.degree()) + 1];
    for face in 0..faces {
        for (j, coefficient) in sh.face(face).iter().enumerate() {
            let scale = &mut scales[degree_of(j)];
            *scale = coefficient.iter().fold(*scale, |most, value| most.max(value.abs()));
        }
    }
    scales
}

fn code(value: f32, scale: f32) -> u8 {
    ((value / scale).clamp(-1.0, 1.0) * STEPS + ZERO).round() as u8
}

/// The coefficients of a face whose first texel is at `coordinates`; `None` outside of the picture.
pub(crate) fn coefficients(
    extras: &ShExtras,
    picture: &RgbImage,
    coordinates: Vec2,
    out: &mut Vec<[f32; 3]>,
) -> Option<()> {
    let width = sh_count(extras.degree) as u32;
    let texel = coordinates * picture.size.as_vec2();
    if !(texel.cmpge(Vec2::ZERO).all() && texel.cmplt(picture.size.as_vec2()).all()) {
        return None;
    }
    let texel = texel.as_uvec2();
    if texel.x + width > picture.size.x {
        return None;
    }
    let first = (texel.y * picture.size.x + texel.x) as usize;
    for (j, codes) in picture.rgb[first..first + width as usize].iter().enumerate() {
        let scale = extras.scale[degree_of(j)];
        out.push(codes.map(|code| (f32::from(code) - ZERO) / STEPS * scale));
    }
    Some(())
}

impl ShExtras {
    /// True for numbers that can be of harmonics.
    pub(crate) fn is_possible(&self) -> bool {
        (1..=MAX_SH_DEGREE).contains(&self.degree)
            && self.scale.len() == usize::from(self.degree) + 1
            && self.scale.iter().all(|scale| scale.is_finite() && *scale >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_scene::mesh::Mesh;

    #[test]
    fn read_what_was_written_within_half_a_code() {
        for (degree, faces) in [(1, 1), (2, 7), (3, 1000)] {
            let width = sh_count(degree);
            let value = |i: usize| ((i * 37 % 101) as f32 - 50.0) * 0.004;
            let values = (0..faces * width).map(|i| [value(i), value(i + 5), 0.0]).collect();
            let triangles = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; faces];
            let mut mesh = Mesh::from_triangles(&triangles, &vec![[0.5; 3]; faces]).unwrap();
            mesh.sh = Some(FaceSh::new(degree, values).unwrap());
            let asset = Asset::from(mesh);
            let stored = StoredSh::of(&asset).unwrap().unwrap();
            assert!(stored.extras.is_possible());
            let mut read = Vec::new();
            for face in 0..faces {
                // As 16 bits hold it.
                let at = (stored.layout.coordinates(face) * 65535.0).round() / 65535.0;
                coefficients(&stored.extras, &stored.picture, at, &mut read).unwrap();
            }
            let own = asset.mesh.sh.as_ref().unwrap().coefficients();
            for (i, (read, own)) in read.iter().zip(own).enumerate() {
                let half = 0.51 * stored.extras.scale[degree_of(i % width)] / STEPS;
                for c in 0..3 {
                    assert!((read[c] - own[c]).abs() <= half, "{degree} {i} {read:?} {own:?}");
                }
            }
        }
    }

    #[test]
    fn coordinates_outside_the_picture_have_no_coefficients() {
        let extras = ShExtras { degree: 1, scale: vec![1.0; 2] };
        let picture = RgbImage { size: UVec2::new(8, 2), rgb: vec![[128; 3]; 16], alpha: None };
        let mut out = Vec::new();
        for at in [Vec2::new(0.9, 0.1), Vec2::new(1.5, 0.1), Vec2::NAN, Vec2::new(0.1, -0.1)] {
            assert_eq!(coefficients(&extras, &picture, at, &mut out), None, "{at}");
        }
        assert_eq!(coefficients(&extras, &picture, Vec2::new(0.51, 0.6), &mut out), Some(()));
        assert_eq!(out, vec![[0.0; 3]; 4]);
    }

    #[test]
    fn more_triangles_than_texels_are_refused() {
        assert!(ShLayout::new(1, 1_048_576).is_ok() && ShLayout::new(1, 1_048_577).is_err());
        assert!(ShLayout::new(2, 464_896).is_ok() && ShLayout::new(2, 464_897).is_err());
    }
}
