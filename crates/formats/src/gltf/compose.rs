//! The JSON document of a scene, composed of `gltf-json`'s types.

use super::buffers;
use super::container::stream_offsets;
use super::document::{QUANTIZATION, UNLIT};
use super::encode::{self, GltfContent, page_format};
use super::meshopt::{CompressedView, MESHOPT};
use super::options::{ColorEncoding, GltfOptions, PositionEncoding, TextureFormat};
use super::part::{BACKDROP, FRONT, PartKind, ScenePart, Stream, all_streams};
use super::sh;
use glam::{DVec3, Mat3, Quat, UVec2};
use gltf_json::accessor::{ComponentType, GenericComponentType};
use gltf_json::buffer::{Stride, Target, View};
use gltf_json::camera::{Camera, Perspective, Type as CameraType};
use gltf_json::extensions::material::Unlit;
use gltf_json::image::MimeType;
use gltf_json::material::{OcclusionTexture, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::scene::UnitQuaternion;
use gltf_json::texture::{Info, MagFilter, MinFilter, Sampler, Texture, WrappingMode};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{
    Accessor, Asset, Buffer, Image, Index, Material, Mesh, Node, Root, Scene, Value, extensions,
};
use serde::{Deserialize, Serialize};
use serde_json::value::{RawValue, to_raw_value};
use serde_json::{Map, Result};
use std::collections::BTreeMap;
use trisplat_scene::camera::Viewpoint;
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::{FaceTexture, Provenance, TexelFilter, UpAxis};

/// The text of the document for `content`: compact in a GLB, indented beside a buffer of the name
/// `bin_name`.
pub(crate) fn json(content: &GltfContent, bin_name: Option<&str>) -> Result<Vec<u8>> {
    let root = root(content, bin_name)?;
    encode::text(&root, bin_name.is_some())
}

fn root(content: &GltfContent, bin_name: Option<&str>) -> Result<Root> {
    let GltfContent { options, parts, .. } = content;
    let quantised = parts.iter().any(|part| part.grid.is_some());
    let mut required = Vec::new();
    if quantised {
        required.push(QUANTIZATION.to_owned());
    }
    if options.meshopt {
        required.push(MESHOPT.to_owned());
    }
    let (mut buffer_views, buffers) = buffers(content, bin_name)?;
    let mut accessors = Vec::with_capacity(buffer_views.len());
    let streams = buffer_views.len();
    // Pictures are never compressed, so they are in the file's own buffer.
    let pictures = content.pictures.iter();
    buffer_views.extend(pictures.map(|picture| view(0, picture.start, picture.bytes.len() as u64)));
    let pages = 0..content.pictures.len();
    let images = pages.clone().map(|page| image(index(streams + page), page, content)).collect();
    let textures = pages.clone().map(|page| texture(page, content)).collect();
    let samplers = filters(content).into_iter().map(sampler).collect();
    let part_materials = part_materials(parts);
    let materials =
        part_materials.iter().map(|of| material(content, of)).collect::<Result<Vec<_>>>()?;
    let unlit = materials.iter().any(|material| material.extensions.is_some());
    let camera = stored_viewpoint(content);
    let camera_node = camera.map(viewpoint_node);
    let cameras = camera.map(|viewpoint| viewpoint_camera(viewpoint, content));
    let meshes = parts
        .iter()
        .map(|part| {
            let material = part_materials.iter().position(|of| *of == PartMaterial::of(part));
            mesh(part, material, options, &mut accessors)
        })
        .collect::<Result<_>>()?;
    Ok(Root {
        asset: Asset {
            generator: Some(trisplat_scene::report::generator()),
            extras: Some(extras(content, bin_name.is_some())?),
            ..Asset::default()
        },
        extensions_used: unlit
            .then(|| UNLIT.to_owned())
            .into_iter()
            .chain(required.iter().cloned())
            .collect(),
        extensions_required: required,
        scene: Some(index(0)),
        scenes: vec![Scene {
            extensions: None,
            extras: None,
            name: None,
            nodes: (0..parts.len() + usize::from(camera_node.is_some())).map(index).collect(),
        }],
        nodes: parts.iter().enumerate().map(|(i, part)| node(i, part)).chain(camera_node).collect(),
        cameras: cameras.into_iter().collect(),
        meshes,
        materials,
        images,
        samplers,
        textures,
        accessors,
        buffer_views,
        buffers,
        ..Root::default()
    })
}

/// `gltf-json` counts in 32 bits, and so does a mesh.
fn index<T>(number: usize) -> Index<T> {
    Index::new(number as u32)
}

fn extras(content: &GltfContent, pretty: bool) -> Result<Box<RawValue>> {
    let GltfContent { asset, options, .. } = content;
    let extras = SceneExtras {
        provenance: &asset.provenance,
        color_encoding: options.colors,
        position_encoding: options.positions,
        sky: options.sky_name.as_deref(),
        note: (!options.colors.is_linear())
            .then_some("COLOR_0 is sRGB-encoded, not linear as glTF 2.0 requires: for Godot only"),
    };
    if !pretty {
        return to_raw_value(&extras);
    }
    // Existing text is two levels deep and is not indented again.
    RawValue::from_string(serde_json::to_string_pretty(&extras)?.replace('\n', "\n    "))
}

/// Key of a material: parts with the same one share it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct PartMaterial {
    is_backdrop: bool,
    single_sided: bool,
    page: usize,
}

impl PartMaterial {
    /// A backdrop is visible from inside only.
    fn of(part: &ScenePart) -> Self {
        let is_backdrop = part.kind == PartKind::Backdrop;
        Self { is_backdrop, single_sided: is_backdrop || part.single_sided, page: part.page }
    }
}

/// The materials of the drawn parts, the backdrop's last.
fn part_materials(parts: &[ScenePart]) -> Vec<PartMaterial> {
    let drawn = parts.iter().filter(|part| part.kind != PartKind::Collision);
    let mut materials: Vec<PartMaterial> = drawn.map(PartMaterial::of).collect();
    materials.sort_unstable();
    materials.dedup();
    materials
}

/// The material of some parts.
fn material(content: &GltfContent, of: &PartMaterial) -> Result<Material> {
    let name = &content.options.material_name;
    // Godot takes the end of a material's name as a hint.
    let (plain, hint) = name.split_at(name.rfind('-').unwrap_or(name.len()));
    let plain = if of.is_backdrop {
        BACKDROP.to_owned()
    } else if of.single_sided {
        format!("{plain}{FRONT}")
    } else {
        plain.to_owned()
    };
    let page = of.page;
    let number = if page == 0 { String::new() } else { format!("_{page}") };
    // Surfaces far behind a scene have their own light.
    let lit = !of.is_backdrop && content.parts.iter().any(|part| part.lit);
    let sh = content.sh.as_ref().filter(|_| !of.is_backdrop);
    Ok(Material {
        name: Some(format!("{plain}{number}{hint}")),
        double_sided: !of.single_sided,
        // As matt as possible, also for viewers that do not know unlit.
        pbr_metallic_roughness: PbrMetallicRoughness {
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(1.0),
            base_color_texture: content.asset.mesh.texture.as_ref().map(|_| Info {
                index: index(page),
                tex_coord: 0,
                extensions: None,
                extras: None,
            }),
            ..PbrMetallicRoughness::default()
        },
        occlusion_texture: sh.map(|_| OcclusionTexture {
            index: index(0),
            tex_coord: 0,
            strength: StrengthFactor(0.0),
            extensions: None,
            extras: None,
        }),
        extras: sh.map(|sh| to_raw_value(&BTreeMap::from([(sh::KEY, sh)]))).transpose()?,
        extensions: (!lit).then(|| extensions::material::Material {
            unlit: Some(Unlit {}),
            ..extensions::material::Material::default()
        }),
        ..Material::default()
    })
}

/// A view of a range of bytes of a buffer.
fn view(buffer: usize, start: u64, length: u64) -> View {
    View {
        buffer: index(buffer),
        byte_length: USize64(length),
        byte_offset: Some(USize64(start)),
        byte_stride: None,
        name: None,
        target: None,
        extensions: None,
        extras: None,
    }
}

/// The picture of a page, in a view.
fn image(view: Index<View>, page: usize, content: &GltfContent) -> Image {
    let of_page = |texture: &FaceTexture| page_format(&texture.pages[page], content.options);
    let format = content.asset.mesh.texture.as_ref().map_or(TextureFormat::Png, of_page);
    Image {
        buffer_view: Some(view),
        mime_type: Some(MimeType(format.media_type().to_owned())),
        name: Some(page_name(page, content)),
        uri: None,
        extensions: None,
        extras: None,
    }
}

/// The filter of a page; of harmonics, whose texels are numbers, the nearest texel's.
fn filter(page: usize, content: &GltfContent) -> TexelFilter {
    let of_page = |texture: &FaceTexture| texture.pages[page].style.filter;
    content.asset.mesh.texture.as_ref().map_or(TexelFilter::Nearest, of_page)
}

/// The filters of all pages, one per sampler.
fn filters(content: &GltfContent) -> Vec<TexelFilter> {
    let mut filters = Vec::new();
    for page in 0..content.pictures.len() {
        let filter = filter(page, content);
        if !filters.contains(&filter) {
            filters.push(filter);
        }
    }
    filters
}

/// A sampler without repetition.
fn sampler(filter: TexelFilter) -> Sampler {
    let (mag_filter, min_filter) = match filter {
        TexelFilter::Linear => (MagFilter::Linear, MinFilter::LinearMipmapLinear),
        TexelFilter::Nearest => (MagFilter::Nearest, MinFilter::Nearest),
        TexelFilter::NearestOfLevel => (MagFilter::Nearest, MinFilter::NearestMipmapNearest),
    };
    Sampler {
        mag_filter: Some(Valid(mag_filter)),
        min_filter: Some(Valid(min_filter)),
        wrap_s: Valid(WrappingMode::ClampToEdge),
        wrap_t: Valid(WrappingMode::ClampToEdge),
        ..Sampler::default()
    }
}

/// The texture of a page.
fn texture(page: usize, content: &GltfContent) -> Texture {
    Texture {
        name: Some(page_name(page, content)),
        sampler: filters(content).iter().position(|of| *of == filter(page, content)).map(index),
        source: index(page),
        extensions: None,
        extras: None,
    }
}

/// Name of the texture of a page and of its picture.
fn page_name(page: usize, content: &GltfContent) -> String {
    if content.sh.is_some() {
        return "sh".to_owned();
    }
    if page == 0 { "texture".to_owned() } else { format!("texture_{page}") }
}

fn node(mesh: usize, part: &ScenePart) -> Node {
    Node {
        name: Some(part.name.clone()),
        mesh: Some(index(mesh)),
        translation: part.grid.map(|grid| grid.origin.to_array()),
        scale: part.grid.map(|grid| grid.scale.to_array()),
        ..Node::default()
    }
}

/// The viewpoint that becomes a camera of the file. A file with only a backdrop, or a tile, has
/// none.
fn stored_viewpoint<'a>(content: &'a GltfContent) -> Option<&'a Viewpoint> {
    let viewpoint = content.asset.provenance.viewpoint.as_ref();
    viewpoint
        .filter(|viewpoint| viewpoint.is_possible())
        .filter(|viewpoint| content.options.sky_name.is_some() || is_within(content, viewpoint))
}

/// True when the scene surrounds the viewpoint. A camera outside of an object is not written:
/// editors that frame all of a file frame cameras too, and the object becomes small.
fn is_within(content: &GltfContent, viewpoint: &Viewpoint) -> bool {
    let eye = DVec3::from(viewpoint.eye).as_vec3();
    let around = bounds(content.parts.iter().flat_map(|part| part.bounds));
    around.is_some_and(|[low, high]| low.cmplt(eye).all() && eye.cmplt(high).all())
}

/// The node of the camera at the first viewpoint: it looks along -z, with +y up in the picture.
fn viewpoint_node(viewpoint: &Viewpoint) -> Node {
    let rotation = viewpoint.camera(UVec2::ONE).rotation;
    let turned = Mat3::from_cols(rotation.row(0), -rotation.row(1), -rotation.row(2));
    Node {
        name: Some(VIEWPOINT.to_owned()),
        camera: Some(index(0)),
        translation: Some(DVec3::from(viewpoint.eye).as_vec3().to_array()),
        rotation: Some(UnitQuaternion(Quat::from_mat3(&turned).normalize().to_array())),
        ..Node::default()
    }
}

/// The viewpoint's camera; near and far planes enclose the scene.
fn viewpoint_camera(viewpoint: &Viewpoint, content: &GltfContent) -> Camera {
    let eye = DVec3::from(viewpoint.eye);
    let corners = content.parts.iter().flat_map(|part| part.bounds);
    let farthest = corners.map(|corner| corner.as_dvec3().distance(eye)).fold(0.0, f64::max);
    let near = (f64::from(viewpoint.distance()) * NEAR).max(f64::from(f32::MIN_POSITIVE)) as f32;
    Camera {
        name: Some(VIEWPOINT.to_owned()),
        perspective: Some(Perspective {
            aspect_ratio: None,
            yfov: viewpoint.fov.to_radians() as f32,
            zfar: Some((FAR * farthest) as f32).filter(|far| far.is_finite() && *far > near),
            znear: near,
            extensions: None,
            extras: None,
        }),
        orthographic: None,
        type_: Valid(CameraType::Perspective),
        extensions: None,
        extras: None,
    }
}

/// Name of the first viewpoint's node and camera.
const VIEWPOINT: &str = "viewpoint";
/// Near plane of the viewpoint's camera, as a share of the target's distance.
const NEAR: f64 = 0.01;
/// Far plane of the viewpoint's camera, as a multiple of the farthest corner's distance.
const FAR: f64 = 2.0;

/// The mesh of a part; its accessors are appended, one per buffer view.
fn mesh(
    part: &ScenePart,
    material: Option<usize>,
    options: &GltfOptions,
    accessors: &mut Vec<Accessor>,
) -> Result<Mesh> {
    let mut primitive = Primitive {
        attributes: Default::default(),
        extensions: None,
        extras: None,
        indices: None,
        material: material.map(index),
        mode: Valid(Mode::Triangles),
        targets: None,
    };
    for stream in part.streams() {
        let number = index(accessors.len());
        let semantic = match stream {
            Stream::Positions => Some(Semantic::Positions),
            Stream::Normals => Some(Semantic::Normals),
            Stream::Colors => Some(Semantic::Colors(0)),
            Stream::TexCoords => Some(Semantic::TexCoords(0)),
            Stream::Indices => None,
        };
        match semantic {
            Some(semantic) => primitive.attributes.extend([(Valid(semantic), number)]),
            None => primitive.indices = Some(number),
        }
        accessors.push(accessor(accessors.len(), part, stream, options)?);
    }
    let name = Some(part.name.clone());
    Ok(Mesh { extensions: None, extras: None, name, primitives: vec![primitive], weights: None })
}

fn accessor(
    view: usize,
    part: &ScenePart,
    stream: Stream,
    options: &GltfOptions,
) -> Result<Accessor> {
    let (component_type, shape) = part.kind(stream, options);
    let bound = |corner: glam::Vec3| match part.grid {
        Some(grid) => serde_json::to_value(grid.code(corner).to_array()),
        None => corner.to_array().into_iter().map(shortest).collect(),
    };
    let bounds = (stream == Stream::Positions).then_some(part.bounds);
    Ok(Accessor {
        buffer_view: Some(index(view)),
        byte_offset: None,
        count: USize64::from(part.count(stream)),
        component_type: Valid(GenericComponentType(component_type)),
        extensions: None,
        extras: None,
        type_: Valid(shape),
        min: bounds.map(|[low, _]| bound(low)).transpose()?,
        max: bounds.map(|[_, high]| bound(high)).transpose()?,
        name: None,
        normalized: matches!(stream, Stream::Colors | Stream::Normals | Stream::TexCoords)
            && component_type != ComponentType::F32,
        sparse: None,
    })
}

/// A number that prints as the shortest text that reads back as the same f32. JSON numbers are 64
/// bits wide: 0.1 itself would print as 0.10000000149011612.
fn shortest(x: f32) -> Result<Value> {
    serde_json::from_str(&serde_json::to_string(&x)?)
}

/// The views, one per stream, and the buffers: the file's own and, when compressed, the one that
/// exists only after decoding.
fn buffers(content: &GltfContent, bin_name: Option<&str>) -> Result<(Vec<View>, Vec<Buffer>)> {
    let GltfContent { options, parts, .. } = content;
    let (starts, decoded_bytes) =
        stream_offsets(all_streams(parts).map(|(part, stream)| part.bytes(stream, options)));
    let mut views = Vec::with_capacity(starts.len());
    for (i, (part, stream)) in all_streams(parts).enumerate() {
        let strided = matches!(stream, Stream::Positions | Stream::Normals) && part.grid.is_some();
        let target = if stream == Stream::Indices {
            Target::ElementArrayBuffer
        } else {
            Target::ArrayBuffer
        };
        let buffer = usize::from(content.compressed.is_some());
        views.push(View {
            byte_stride: strided.then(|| Stride(part.stride(stream, options) as usize)),
            target: Some(Valid(target)),
            extensions: compressed_view(content, i, part, stream)?,
            ..view(buffer, starts[i], part.bytes(stream, options))
        });
    }
    let buffer = |bytes: u64| Buffer {
        byte_length: USize64(bytes),
        name: None,
        uri: None,
        extensions: None,
        extras: None,
    };
    let mut buffers =
        vec![Buffer { uri: bin_name.map(buffers::from_file_name), ..buffer(content.bin_bytes) }];
    if options.meshopt {
        let others = object(MESHOPT, &serde_json::json!({ "fallback": true }))?;
        let extensions = Some(extensions::buffer::Buffer { others });
        buffers.push(Buffer { extensions, ..buffer(decoded_bytes) });
    }
    Ok((views, buffers))
}

/// The place of the compressed bytes of stream `i`.
fn compressed_view(
    content: &GltfContent,
    i: usize,
    part: &ScenePart,
    stream: Stream,
) -> Result<Option<extensions::buffer::View>> {
    let Some(streams) = &content.compressed else { return Ok(None) };
    let mode = if stream == Stream::Indices { "TRIANGLES" } else { "ATTRIBUTES" };
    let others = object(
        MESHOPT,
        &CompressedView {
            buffer: 0,
            byte_offset: content.starts[i],
            byte_length: streams[i].len() as u64,
            byte_stride: part.stride(stream, content.options),
            count: part.count(stream) as u64,
            mode: mode.to_owned(),
            filter: None,
        },
    )?;
    Ok(Some(extensions::buffer::View { others }))
}

/// The objects of an extension.
fn object(name: &str, object: &impl Serialize) -> Result<Map<String, Value>> {
    Ok(std::iter::once((name.to_owned(), serde_json::to_value(object)?)).collect())
}

// ---- `asset.extras` of files of this program: provenance and storage of a scene -----------------

/// Prefix of this program's versions.
const PROGRAM: &str = "trisplat";

/// Data for undoing the bake's placement and encoding.
#[derive(Debug, Serialize)]
pub(crate) struct SceneExtras<'a> {
    #[serde(flatten)]
    pub(crate) provenance: &'a Provenance,
    pub(crate) color_encoding: ColorEncoding,
    pub(crate) position_encoding: PositionEncoding,
    /// The file of the panorama: who asks a server for one that is not there is told of an error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) sky: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) note: Option<&'static str>,
}

/// The part of [`SceneExtras`] that decides how colours are read.
#[derive(Debug, Default, Deserialize)]
struct StoredColors {
    #[serde(default)]
    color_encoding: ColorEncoding,
}

/// True when a file of this program says that its COLOR_0 is sRGB-encoded.
pub(crate) fn has_srgb_colors(asset: &Asset) -> bool {
    !own_extras::<StoredColors>(asset).color_encoding.is_linear()
}

/// The file's provenance. glTF is Y-up.
pub(crate) fn provenance(asset: &Asset) -> Provenance {
    let mut provenance = own_extras::<Provenance>(asset).possible();
    provenance.generator = provenance.generator.or_else(|| asset.generator.clone());
    provenance.up = Some(UpAxis::Y);
    provenance
}

/// The extras, if this program wrote the file and can read them.
fn own_extras<T: Default + for<'de> Deserialize<'de>>(asset: &Asset) -> T {
    let is_own = asset.generator.as_deref().is_some_and(|generator| generator.starts_with(PROGRAM));
    let extras = asset.extras.as_ref().filter(|_| is_own);
    extras.and_then(|extras| serde_json::from_str(extras.get()).ok()).unwrap_or_default()
}
