//! An asset in GPU memory.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, DVec4, Vec3};
use std::ops::Range;
use trisplat_gpu::{Gpu, buffer};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{
    Asset, Chunk, Error, FaceSh, FaceTexture, Result, TexelFilter, Texture, parallel,
};
use wgpu::*;

/// An asset in GPU memory.
#[derive(Debug)]
pub struct Model {
    /// Bytes of GPU memory that it takes.
    pub bytes: u64,
    /// Runs of faces that are drawn or culled as a whole, each from one side or from both, and
    /// their boxes.
    pub chunks: Vec<(Chunk, [Vec3; 2])>,
    /// True for a run whose faces are drawn from their front only. `[chunks]`
    single_sided: Vec<bool>,
    vertices: Buffer,
    indices: Option<Buffer>,
    texture: Option<BindGroup>,
    /// Spherical harmonics of the faces, and their degree.
    harmonics: Option<(BindGroup, u8)>,
}

impl Model {
    /// Uploads the faces of `asset`.
    ///
    /// # Errors
    ///
    /// The card has no room; one colour per face of a mesh with indices.
    pub(crate) fn upload(gpu: &Gpu, layouts: &ModelLayouts, asset: &Asset) -> Result<Self> {
        let mesh = &asset.mesh;
        mesh.validate_shape()?;
        // One picture, also of a file with several.
        let texture = mesh.texture.as_ref().map(FaceTexture::joined);
        let indexed = !mesh.indices.is_empty() && texture.is_none();
        let vertices = match &texture {
            None => corners(gpu, mesh)?,
            Some(texture) => texture_corners(gpu, mesh, texture)?,
        };
        let usage = BufferUsages::INDEX;
        let index = |i: usize| mesh.indices[i];
        let indices = indexed
            .then(|| buffer::filled(gpu, "indices", usage, mesh.indices.len(), index))
            .transpose()?;
        let mut bytes = vertices.size() + indices.as_ref().map_or(0, Buffer::size);
        let texture = texture
            .map(|texture| page_group(gpu, &layouts.texture, &texture.pages[0]))
            .transpose()?;
        bytes += texture.as_ref().map_or(0, |(_, size)| *size);
        let texture = texture.map(|(group, _)| group);
        let sh = mesh.sh.as_ref().filter(|_| texture.is_none());
        let harmonics = sh.map(|sh| harmonics_group(gpu, &layouts.harmonics, sh)).transpose()?;
        bytes += harmonics.as_ref().map_or(0, |(_, size)| *size);
        let harmonics = harmonics.zip(sh).map(|((group, _), sh)| (group, sh.degree()));
        let chunks = bounds(asset);
        let is_single_sided = |(chunk, _): &(Chunk, _)| mesh.is_single_sided(chunk.first as usize);
        let single_sided = chunks.iter().map(is_single_sided).collect();
        Ok(Self { bytes, chunks, single_sided, vertices, indices, texture, harmonics })
    }

    /// Degree of its spherical harmonics; 0 without any.
    pub(crate) fn sh_degree(&self) -> u8 {
        self.harmonics.as_ref().map_or(0, |(_, degree)| *degree)
    }

    /// True with a texture.
    pub(crate) fn is_textured(&self) -> bool {
        self.texture.is_some()
    }

    /// Number of triangles.
    pub fn triangles(&self) -> u64 {
        self.chunks.iter().map(|(chunk, _)| u64::from(chunk.count)).sum()
    }

    /// The draw calls for the view of `camera`: runs of faces, of those that are `single_sided` or
    /// of the others.
    pub(crate) fn draw_calls(
        &self,
        camera: &Camera,
        near: f32,
        single_sided: bool,
    ) -> Vec<Range<u32>> {
        let frustum = Frustum::new(camera, near);
        let mut draws: Vec<Range<u32>> = Vec::new();
        for ((chunk, bounds), of_chunk) in self.chunks.iter().zip(&self.single_sided) {
            if *of_chunk != single_sided || chunk.count == 0 || !frustum.sees(bounds) {
                continue;
            }
            let faces = chunk.first..chunk.first + chunk.count;
            match draws.last_mut() {
                Some(run) if run.end == faces.start => run.end = faces.end,
                _ => draws.push(faces),
            }
        }
        draws
    }

    /// Draws with a pipeline for such a model and such faces; returns the number of triangles.
    pub(crate) fn draw(&self, pass: &mut RenderPass<'_>, draws: &[Range<u32>]) -> u64 {
        for faces in draws {
            let corners = 3 * faces.start..3 * faces.end;
            match &self.indices {
                Some(_) => pass.draw_indexed(corners, 0, 0..1),
                None => pass.draw(corners, 0..1),
            }
        }
        draws.iter().map(|faces| u64::from(faces.end - faces.start)).sum()
    }

    /// Binds its buffers and its texture.
    pub(crate) fn bind(&self, pass: &mut RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        if let Some(indices) = &self.indices {
            pass.set_index_buffer(indices.slice(..), IndexFormat::Uint32);
        }
        if let Some(group) = &self.texture {
            pass.set_bind_group(1, group, &[]);
        }
        if let Some((group, _)) = &self.harmonics {
            pass.set_bind_group(1, group, &[]);
        }
    }
}

/// Position and colour of every vertex, or of every corner with one colour per face.
fn corners(gpu: &Gpu, mesh: &Mesh) -> Result<Buffer> {
    let corner = |position: Vec3, linear| CornerVertex {
        position: position.to_array(),
        color: pack_color(linear),
    };
    let usage = BufferUsages::VERTEX;
    match &mesh.colors {
        Colors::Vertex(colors) => buffer::filled(gpu, "corners", usage, mesh.vertex_count(), |v| {
            corner(mesh.positions[v], colors[v])
        }),
        Colors::Face(colors) if mesh.indices.is_empty() => {
            buffer::filled(gpu, "corners", usage, mesh.vertex_count(), |v| {
                corner(mesh.positions[v], colors[v / 3])
            })
        }
        Colors::Face(_) => {
            let wants = "one colour per vertex where there are indices (bake it first)";
            Err(Error::invalid("mesh colors", "one per face", wants))
        }
    }
}

/// Position and place on the picture of every corner.
fn texture_corners(gpu: &Gpu, mesh: &Mesh, texture: &FaceTexture) -> Result<Buffer> {
    let uvs = texture.uvs.as_flattened();
    buffer::filled(gpu, "corners", BufferUsages::VERTEX, uvs.len(), |corner| TextureVertex {
        position: mesh.positions[mesh.face(corner / 3)[corner % 3] as usize].to_array(),
        uv: uvs[corner].to_array(),
    })
}

/// Bytes of a texel.
const TEXEL: u32 = 4;

/// Layouts of the second bind group.
#[derive(Debug, Clone)]
pub(crate) struct ModelLayouts {
    /// Of a texture.
    pub(super) texture: BindGroupLayout,
    /// Of spherical harmonics.
    pub(super) harmonics: BindGroupLayout,
}

impl ModelLayouts {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let entry = BindGroupLayoutEntry {
            binding: 2,
            visibility: ShaderStages::VERTEX,
            ty: BindingType::Buffer {
                ty: BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let harmonics = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("harmonics"),
            entries: &[entry],
        });
        Self { texture: page_layout(gpu), harmonics }
    }
}

/// The bind group of the harmonics of all faces, and its bytes.
///
/// # Errors
///
/// The card has no room.
fn harmonics_group(gpu: &Gpu, layout: &BindGroupLayout, sh: &FaceSh) -> Result<(BindGroup, u64)> {
    let values = sh.coefficients();
    let buffer =
        buffer::filled(gpu, "harmonics", BufferUsages::STORAGE, values.len(), |i| values[i])?;
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("harmonics"),
        layout,
        entries: &[BindGroupEntry { binding: 2, resource: buffer.as_entire_binding() }],
    });
    Ok((group, buffer.size()))
}

/// Layout of the bind group of a texture.
fn page_layout(gpu: &Gpu) -> BindGroupLayout {
    let entry = |binding, ty| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    let picture = BindingType::Texture {
        sample_type: TextureSampleType::Float { filterable: true },
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = BindingType::Sampler(SamplerBindingType::Filtering);
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
        label: Some("page"),
        entries: &[entry(0, picture), entry(1, sampler)],
    })
}

/// Beyond the last mip level of any picture.
const LAST_LEVEL: f32 = 32.0;

/// The bind group of a texture, and its bytes.
///
/// # Errors
///
/// The card has no room.
fn page_group(gpu: &Gpu, layout: &BindGroupLayout, page: &Texture) -> Result<(BindGroup, u64)> {
    let (mag_filter, mipmap_filter, lod_max_clamp) = match page.style.filter {
        TexelFilter::Linear => (FilterMode::Linear, MipmapFilterMode::Linear, LAST_LEVEL),
        TexelFilter::Nearest => (FilterMode::Nearest, MipmapFilterMode::Nearest, 0.0),
        TexelFilter::NearestOfLevel => (FilterMode::Nearest, MipmapFilterMode::Nearest, LAST_LEVEL),
    };
    let sampler = gpu.device.create_sampler(&SamplerDescriptor {
        label: Some("texels"),
        mag_filter,
        min_filter: mag_filter,
        mipmap_filter,
        lod_max_clamp,
        ..SamplerDescriptor::default()
    });
    let (view, bytes) = picture(gpu, page)?;
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("page"),
        layout,
        entries: &[
            BindGroupEntry { binding: 0, resource: BindingResource::TextureView(&view) },
            BindGroupEntry { binding: 1, resource: BindingResource::Sampler(&sampler) },
        ],
    });
    Ok((group, bytes))
}

/// A page with its mip levels, and its bytes. Of one that is larger than the card's textures, the
/// levels that fit.
fn picture(gpu: &Gpu, page: &Texture) -> Result<(TextureView, u64)> {
    let limit = gpu.device.limits().max_texture_dimension_2d;
    let last = page.size().max_element().ilog2() as usize;
    let first =
        (0..last).find(|level| page.level(*level).size.max_element() <= limit).unwrap_or(last);
    let size = page.level(first).size;
    let texture = gpu.device.create_texture(&TextureDescriptor {
        label: Some("page"),
        size: Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: (last - first + 1) as u32,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format: TextureFormat::Rgba8UnormSrgb,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.check()?;
    let mut bytes = 0;
    for level in first..=last {
        let pixels = page.level(level);
        let texels: Vec<[u8; 4]> = pixels.rgb.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect();
        bytes += texels.len() as u64 * u64::from(TEXEL);
        let width = pixels.size.x;
        let height = pixels.size.y;
        gpu.queue.write_texture(
            TexelCopyTextureInfo {
                texture: &texture,
                mip_level: (level - first) as u32,
                origin: Origin3d::ZERO,
                aspect: TextureAspect::All,
            },
            bytemuck::cast_slice(&texels),
            TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(TEXEL * width),
                rows_per_image: Some(height),
            },
            Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
    gpu.check()?;
    Ok((texture.create_view(&TextureViewDescriptor::default()), bytes))
}

// ---- How vertices are stored in GPU memory; boxes of chunks, and their culling ------------------

/// A corner with its colour.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct CornerVertex {
    /// World position.
    pub position: [f32; 3],
    /// See [`pack_color`].
    pub color: u32,
}

/// A corner of a textured face.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct TextureVertex {
    /// World position.
    pub position: [f32; 3],
    /// Place on the page: (0, 0) is the upper left corner.
    pub uv: [f32; 2],
}

/// Linear light to 10 bits per channel, red lowest, stored as the square root.
pub(crate) fn pack_color(linear: [f32; 3]) -> u32 {
    let [r, g, b] = linear.map(|c| (c.clamp(0.0, 1.0).sqrt() * 1023.0 + 0.5) as u32);
    r | g << 10 | b << 20
}

/// The chunks of an asset, cut where faces with one side and with both meet, and their boxes; one
/// chunk of everything when it has none. `[chunks]`
pub(crate) fn bounds(asset: &Asset) -> Vec<(Chunk, [Vec3; 2])> {
    let mesh = &asset.mesh;
    let whole = [Chunk { first: 0, count: mesh.face_count() as u32 }];
    let chunks = if asset.chunks.is_empty() { &whole[..] } else { &asset.chunks };
    let chunks: Vec<Chunk> = chunks.iter().flat_map(|chunk| of_one_kind(*chunk, mesh)).collect();
    parallel::map(chunks, |_, chunk| {
        let faces = chunk.first as usize..(chunk.first + chunk.count) as usize;
        let corners = faces.flat_map(|face| mesh.corners(face));
        (chunk, geometry::bounds(corners).unwrap_or_default())
    })
}

/// The runs of a chunk whose faces are all drawn from one side, or all from both.
fn of_one_kind(chunk: Chunk, mesh: &Mesh) -> Vec<Chunk> {
    if mesh.single_sided.is_empty() {
        return vec![chunk];
    }
    let mut first = chunk.first;
    let flags = &mesh.single_sided[chunk.first as usize..][..chunk.count as usize];
    let run = |run: &[bool]| {
        let cut = Chunk { first, count: run.len() as u32 };
        first += cut.count;
        cut
    };
    flags.chunk_by(|a, b| a == b).map(run).collect()
}

/// The view pyramid of a camera, cut off at the near plane.
#[derive(Debug, Clone)]
pub(crate) struct Frustum {
    /// Inside: `plane.xyz · p + plane.w >= 0`.
    planes: [DVec4; 5],
}

impl Frustum {
    /// The view of `camera` beyond `near`.
    pub(crate) fn new(camera: &Camera, near: f32) -> Self {
        let axis =
            |row: usize| camera.rotation.row(row).as_dvec3().extend(camera.translation[row].into());
        let x = axis(0);
        let y = axis(1);
        let z = axis(2);
        let focal = camera.focal.as_dvec2();
        let center = camera.center.as_dvec2();
        let size = camera.size.as_dvec2();
        // 0 <= focal x / z + center <= size, times z.
        let planes = [
            x * focal.x + z * center.x,
            z * (size.x - center.x) - x * focal.x,
            y * focal.y + z * center.y,
            z * (size.y - center.y) - y * focal.y,
            z - DVec4::W * f64::from(near),
        ];
        Self { planes }
    }

    /// False only when the box is outside the view.
    pub(crate) fn sees(&self, bounds: &[Vec3; 2]) -> bool {
        let [min, max] = bounds.map(|corner| corner.as_dvec3());
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), max, min);
            // A box that touches the plane is kept, despite rounding.
            let slack = 1e-6 * (normal.abs().dot(farthest.abs()) + plane.w.abs());
            normal.dot(farthest) + plane.w >= -slack
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};
    use trisplat_scene::Rng;
    use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};

    #[test]
    fn ten_bits_of_square_root_keep_every_8_bit_colour() {
        for code in 0..=255u32 {
            let linear = linear_from_srgb(code as f32 / 255.0);
            let bits = pack_color([linear, 0.0, linear]);
            assert_eq!(bits & 1023, bits >> 20);
            let root = (bits & 1023) as f32 / 1023.0;
            let off = srgb_from_linear(root * root) * 255.0 - code as f32;
            assert!(off.abs() < 0.2, "code {code} moved by {off}");
        }
        assert_eq!(pack_color([2.0, -1.0, f32::NAN]), 1023);
    }

    #[test]
    fn no_box_with_a_visible_point_is_left_out() {
        let rng = Rng::new(5, "cull", 0);
        let draw = |i: u64, scale: f32| (rng.uniform_f64(i) as f32 - 0.5) * scale;
        let vec =
            |i: u64, scale: f32| Vec3::new(draw(i, scale), draw(i + 1, scale), draw(i + 2, scale));
        let base = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::new(300.0, 310.0),
            center: Vec2::new(220.0, 100.0),
            size: UVec2::new(400, 260),
        };
        let mut kept = 0;
        let mut dropped = 0;
        for k in 0..4000 {
            let camera = base.with_look_at(vec(k * 100, 4.0), vec(k * 100 + 3, 4.0), Vec3::NEG_Y);
            let frustum = Frustum::new(&camera, 0.1);
            let a = vec(k * 100 + 6, 6.0);
            let b = vec(k * 100 + 9, 1.0);
            let bounds @ [min, max] = [a.min(a + b), a.max(a + b)];
            let visible = (0..27u32).any(|i| {
                let at = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) / 2.0;
                let seen = camera.rotation * (min + at * (max - min)) + camera.translation;
                let pixel = seen.truncate() / seen.z * camera.focal + camera.center;
                seen.z >= 0.1
                    && pixel.cmpge(Vec2::ZERO).all()
                    && pixel.cmple(camera.size.as_vec2()).all()
            });
            let sees = frustum.sees(&bounds);
            assert!(sees || !visible, "{bounds:?} left out");
            kept += u32::from(sees);
            dropped += u32::from(!sees);
        }
        assert!(kept > 300 && dropped > 1500, "{kept} kept, {dropped} dropped");
        assert!(!Frustum::new(&base, 0.1).sees(&[Vec3::splat(-2.0), Vec3::splat(-1.0)]));
    }
}
