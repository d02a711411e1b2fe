//! The content of a file: counts, bounds, distributions, origin.

use crate::gltf::{GltfInfo, gltf_info};
use crate::read::{Content, FileKind, detect, kind_of, read_as, read_splats};
use crate::{Format, ReadOptions, Source, html};
use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::math::lists::{median, quantile};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{
    FaceTexture, ImportedScene, Provenance, Result, Scene, Soup, Splats, StoredPicture,
};

/// Share of the Gaussians that lie outside the inner box at each end of an axis.
const OUTER_SHARE: f32 = 0.01;

/// Content of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat info")]
pub struct Info {
    /// The file as given.
    pub path: String,
    /// Its format.
    pub format: Format,
    /// Its size in bytes.
    pub bytes: u64,
    /// A soup of soft triangles, a mesh of solid ones, or Gaussians.
    pub kind: SceneKind,
    /// Number of Gaussians.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub splats: u64,
    /// Number of triangles.
    pub triangles: u64,
    /// Number of vertices; three per triangle when they are not shared.
    pub vertices: u64,
    /// True when triangles share vertices.
    pub indexed: bool,
    /// Degree of the spherical harmonics of a soup or of Gaussians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sh_degree: Option<u8>,
    /// Cameras of the training photos, if the file or a list beside it stores them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub cameras: u64,
    /// Triangles of the shell that closes a trained soup, its backdrop.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub shell: u64,
    /// The box around all triangles, or around the middles of all Gaussians.
    pub bounds: BoundingBox,
    /// The box around the middles of Gaussians without the outermost hundredth at each end of each
    /// axis, where many float far outside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inner_bounds: Option<BoundingBox>,
    /// σ of a soup.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Distribution>,
    /// Opacity of a soup, of Gaussians, or of a mesh that is not opaque.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<Distribution>,
    /// Colours, sRGB-encoded.
    pub colors: ColorStats,
    /// The texture, if the mesh has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureInfo>,
    /// Facts about a glTF file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gltf: Option<GltfInfo>,
    /// The provenance of the scene, if the file states it.
    pub provenance: Provenance,
    /// Repairs and omissions of reading.
    pub warnings: Vec<String>,
    /// The result that `trisplat bake` would give.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bake: Option<BakeInfo>,
    /// The loss of a soft scene as solid triangles; absent when it is solid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub softness: Option<Softness>,
}

/// The kinds of scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SceneKind {
    /// Unconnected triangles with opacity, σ and spherical harmonics.
    Soup,
    /// Coloured triangles.
    #[default]
    Mesh,
    /// Gaussians with opacity and spherical harmonics.
    Splats,
}

/// The loss of a scene when its triangles are just made solid.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Softness {
    /// Mean PSNR of the solid triangles against the scene's soft pictures, dB. Above some 35 dB
    /// they look alike.
    pub psnr: f64,
    /// Number of pictures that were compared.
    pub pictures: u64,
}

/// A box along the axes, in file units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BoundingBox {
    /// Lowest corner.
    pub min: [f32; 3],
    /// Highest corner.
    pub max: [f32; 3],
}

/// Distribution of numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Distribution {
    /// Smallest.
    pub min: f32,
    /// Half are below.
    pub median: f32,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f32,
}

/// Colours of all triangles or Gaussians, sRGB-encoded, 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ColorStats {
    /// Mean of each channel.
    pub mean: [f32; 3],
    /// Smallest of each channel.
    pub min: [f32; 3],
    /// Largest of each channel.
    pub max: [f32; 3],
    /// Triangles with a channel outside 0 to 1, which the bake clamps; Gaussians with one.
    pub outside: u64,
}

/// The texture of a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TextureInfo {
    /// Width and height of the largest page, texels.
    pub size: [u32; 2],
    /// Number of pictures.
    #[serde(default = "one_page", skip_serializing_if = "is_one_page")]
    pub pages: u32,
    /// Format and size in the file, all pages together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stored: Option<StoredPicture>,
}

impl TextureInfo {
    fn of(texture: &FaceTexture) -> Self {
        let sizes = texture.pages.iter().map(|page| page.size());
        let size = sizes.max_by_key(|size| size.element_product()).unwrap_or_default();
        let stored: Option<Vec<&StoredPicture>> =
            texture.pages.iter().map(|page| page.stored()).collect();
        let stored =
            stored.filter(|pages| pages.windows(2).all(|pair| pair[0].format == pair[1].format));
        let together = |pages: Vec<&StoredPicture>| {
            let bytes = pages.iter().map(|page| page.bytes).sum();
            pages.first().map(|first| StoredPicture { bytes, ..(*first).clone() })
        };
        Self {
            size: size.to_array(),
            pages: texture.pages.len() as u32,
            stored: stored.and_then(together),
        }
    }
}

fn one_page() -> u32 {
    1
}

fn is_one_page(pages: &u32) -> bool {
    *pages == 1
}

/// The triangles that would pass the bake's first stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BakeInfo {
    /// Triangles that stay.
    pub kept: u64,
    /// Triangles dropped by cause.
    pub dropped: serde_json::Map<String, serde_json::Value>,
}

/// The content of a file of triangles or Gaussians at `path`, and the parts of the scene that
/// `options` select. The caller fills in `bake`.
///
/// # Errors
/// Errors of reading.
pub fn info_of_content(path: &Path, options: &ReadOptions) -> Result<(Info, Content)> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    let format = match kind_of(format, &mut source, &options.limits)? {
        FileKind::Splats(format) => format,
        FileKind::Scene(format) => {
            return info_of_scene(path, format, source, options)
                .map(|(info, loaded)| (info, Content::Scene(loaded)));
        }
    };
    let bytes = source.len;
    let loaded = read_splats(format, source, options)?;
    let info = Info {
        path: path.display().to_string(),
        format,
        bytes,
        provenance: loaded.provenance.clone(),
        cameras: loaded.cameras.len() as u64,
        warnings: loaded.warnings.clone(),
        ..splats_info(&loaded.splats)
    };
    Ok((info, Content::Splats(loaded)))
}

fn info_of_scene(
    path: &Path,
    format: Format,
    source: Source,
    options: &ReadOptions,
) -> Result<(Info, ImportedScene)> {
    let bytes = source.len;
    let (inner, source) = html::inside(format, source)?;
    let is_gltf = matches!(inner, Format::Glb | Format::Gltf);
    let gltf = if is_gltf { Some(gltf_info(source.again()?, &options.limits)?) } else { None };
    let loaded = read_as(inner, source.again()?, options)?;
    let mut info = match &loaded.scene {
        Scene::Soup(soup) => soup_info(soup),
        Scene::Mesh(mesh) => mesh_info(mesh),
    };
    info.path = path.display().to_string();
    info.format = format;
    info.bytes = bytes;
    info.gltf = gltf;
    info.provenance = loaded.provenance.clone();
    info.shell = loaded.scene.shell_count() as u64;
    info.cameras = loaded.cameras.len() as u64;
    info.warnings.clone_from(&loaded.warnings);
    Ok((info, loaded))
}

fn soup_info(soup: &Soup) -> Info {
    Info {
        kind: SceneKind::Soup,
        triangles: soup.len() as u64,
        vertices: 3 * soup.len() as u64,
        sh_degree: Some(soup.sh_degree),
        bounds: BoundingBox::of(soup.vertices.iter().flatten().copied()),
        sigma: Distribution::of(soup.sigma.clone()),
        opacity: Distribution::of(soup.opacity.clone()),
        colors: ColorStats::of((0..soup.len()).map(|i| soup.rgb(i)), 1),
        ..Info::default()
    }
}

fn splats_info(splats: &Splats) -> Info {
    Info {
        kind: SceneKind::Splats,
        splats: splats.len() as u64,
        sh_degree: Some(splats.sh_degree),
        bounds: BoundingBox::of(splats.positions.iter().copied()),
        inner_bounds: BoundingBox::inner(&splats.positions),
        opacity: Distribution::of(splats.opacity.clone()),
        colors: ColorStats::of((0..splats.len()).map(|i| splats.rgb(i)), 1),
        ..Info::default()
    }
}

fn mesh_info(mesh: &Mesh) -> Info {
    let faces = || 0..mesh.face_count();
    let encoded = |c: [f32; 3]| c.map(srgb_from_linear);
    let colors = match &mesh.colors {
        Colors::Face(colors) => ColorStats::of(colors.iter().map(|c| encoded(*c)), 1),
        Colors::Vertex(_) => {
            ColorStats::of(faces().flat_map(|f| mesh.corner_colors(f)).map(encoded), 3)
        }
    };
    Info {
        kind: SceneKind::Mesh,
        triangles: mesh.face_count() as u64,
        vertices: mesh.vertex_count() as u64,
        indexed: !mesh.indices.is_empty(),
        bounds: BoundingBox::of(faces().flat_map(|face| mesh.corners(face))),
        opacity: Distribution::of(mesh.opacity.clone()),
        colors,
        texture: mesh.texture.as_ref().map(TextureInfo::of),
        ..Info::default()
    }
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

impl BoundingBox {
    fn of(points: impl Iterator<Item = Vec3>) -> Self {
        let [min, max] = bounds(points).unwrap_or_default().map(|corner| corner.to_array());
        Self { min, max }
    }

    /// The box around the middle 98% of `points` along each axis; `None` of no points.
    fn inner(points: &[Vec3]) -> Option<Self> {
        let end = |axis: usize, share: f32| {
            let values: Vec<f32> = points.iter().map(|point| point[axis]).collect();
            quantile(values, share)
        };
        let corner = |share: f32| Some([end(0, share)?, end(1, share)?, end(2, share)?]);
        Some(Self { min: corner(OUTER_SHARE)?, max: corner(1.0 - OUTER_SHARE)? })
    }
}

impl Distribution {
    /// Distribution of `values`; `None` for an empty list.
    fn of(values: Vec<f32>) -> Option<Self> {
        if values.is_empty() {
            return None;
        }
        let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
        let min = values.iter().copied().fold(f32::MAX, f32::min);
        let max = values.iter().copied().fold(f32::MIN, f32::max);
        let median = median(values, f32::total_cmp)?;
        Some(Self { min, median, mean, max })
    }
}

impl ColorStats {
    /// Over colours, `corners` per triangle.
    fn of(colors: impl Iterator<Item = [f32; 3]>, corners: u64) -> Self {
        let mut sum = [0.0f64; 3];
        let mut count = 0u64;
        let mut outside = 0u64;
        let mut min = [f32::MAX; 3];
        let mut max = [f32::MIN; 3];
        for color in colors {
            for (i, channel) in color.into_iter().enumerate() {
                sum[i] += f64::from(channel);
                min[i] = min[i].min(channel);
                max[i] = max[i].max(channel);
            }
            count += 1;
            outside += u64::from(!color.iter().all(|c| (0.0..=1.0).contains(c)));
        }
        let mean = sum.map(|s| (s / count.max(1) as f64) as f32);
        Self { mean, min, max, outside: outside / corners }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_of_all_numbers() {
        let spread = Distribution::of(vec![1.0, 0.0, 0.1, 0.0999, 0.5]).expect("numbers");
        assert_eq!((spread.min, spread.median, spread.max), (0.0, 0.1, 1.0));
        assert_eq!(Distribution::of(Vec::new()), None);
    }

    #[test]
    fn inner_bounds_leave_out_what_floats() {
        let mut points: Vec<Vec3> = (0..200).map(|i| Vec3::splat(i as f32)).collect();
        points[0] = Vec3::splat(-1e6);
        points[199] = Vec3::new(1e6, 198.5, 1e6);
        let BoundingBox { min, max } = BoundingBox::inner(&points).expect("points");
        assert!(min.iter().all(|x| (0.0..=4.0).contains(x)), "{min:?}");
        assert!(max.iter().all(|x| (195.0..=198.5).contains(x)), "{max:?}");
        assert_eq!(BoundingBox::inner(&[]), None);
    }
}
