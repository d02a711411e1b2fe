//! An asset in GPU memory.

use super::layout::{self, Aabb, CornerVertex, Frustum, TextureVertex, VertexLayout};
use glam::Vec3;
use std::ops::Range;
use trisplat_gpu::{Gpu, buffer};
use trisplat_scene::{
    Asset, Chunk, Error, FaceTexture, Result, Texture,
    camera::Camera,
    mesh::{Colors, Mesh},
};
use wgpu::*;

/// An asset in GPU memory.
#[derive(Debug)]
pub struct Model {
    /// How its vertices are stored.
    pub layout: VertexLayout,
    /// Bytes of GPU memory that it takes.
    pub bytes: u64,
    /// Runs of faces that are drawn or culled as a whole, and their boxes.
    pub chunks: Vec<(Chunk, Aabb)>,
    vertices: Buffer,
    indices: Option<Buffer>,
    /// Face colours.
    faces: Option<BindGroup>,
    pages: Option<Pages>,
}

/// The layouts of the bind groups that models have.
#[derive(Debug, Clone)]
pub(crate) struct ModelGroups {
    /// Face colours.
    pub(crate) faces: BindGroupLayout,
    /// A page of a texture.
    pub(crate) page: BindGroupLayout,
}

/// One draw call: a run of faces, and the chunk that it (or its first face) is in.
pub(crate) type DrawCall = (Range<u32>, u32);

impl Model {
    /// Uploads the faces of `asset`.
    ///
    /// Errors: the layout does not fit the mesh, or the card has no room.
    pub(crate) fn upload(
        gpu: &Gpu,
        groups: &ModelGroups,
        asset: &Asset,
        layout: VertexLayout,
    ) -> Result<Self> {
        let mesh = &asset.mesh;
        mesh.validate_shape()?;
        if !layout.fits(mesh) {
            let wants =
                "texture for a textured mesh, corner for another with indices or one colour per vertex";
            return Err(Error::invalid("layout", format!("{layout:?}"), wants));
        }
        let mut chunks = layout::bounds(asset);
        let mut pages = None;
        if let Some(texture) = mesh.texture.as_ref().filter(|_| layout == VertexLayout::Texture) {
            chunks = runs(mesh, texture, chunks);
            pages = Some(Pages::upload(gpu, &groups.page, texture, &chunks)?);
        }
        let indexed = !mesh.indices.is_empty() && pages.is_none();
        let vertices = match layout {
            VertexLayout::Corner => corners(gpu, mesh)?,
            VertexLayout::Face => {
                let at = |v: usize| mesh.positions[v].to_array();
                buffer::filled(gpu, "corners", BufferUsages::VERTEX, mesh.vertex_count(), at)?
            }
            VertexLayout::Texture => texture_corners(gpu, mesh)?,
        };
        let usage = BufferUsages::INDEX;
        let index = |i: usize| mesh.indices[i];
        let indices =
            indexed.then(|| buffer::filled(gpu, "indices", usage, mesh.indices.len(), index)).transpose()?;
        let mut bytes = vertices.size() + indices.as_ref().map_or(0, Buffer::size);
        bytes += pages.as_ref().map_or(0, |pages| pages.bytes);
        let faces = match &mesh.colors {
            Colors::Face(colors) if layout == VertexLayout::Face => {
                let (group, size) = face_group(gpu, &groups.faces, colors)?;
                bytes += size;
                Some(group)
            }
            _ => None,
        };
        Ok(Self { layout, bytes, chunks, vertices, indices, faces, pages })
    }

    /// Number of triangles.
    pub fn triangles(&self) -> u64 {
        self.chunks.iter().map(|(chunk, _)| u64::from(chunk.count)).sum()
    }

    /// The draw calls for the view of `camera`.
    pub(crate) fn draw_calls(&self, camera: &Camera, near: f32) -> Vec<DrawCall> {
        let frustum = Frustum::new(camera, near);
        let mut draws: Vec<DrawCall> = Vec::new();
        for (i, (chunk, bounds)) in self.chunks.iter().enumerate() {
            if chunk.count == 0 || !frustum.sees(bounds) {
                continue;
            }
            let faces = chunk.first..chunk.first + chunk.count;
            match draws.last_mut() {
                Some((run, last)) if run.end == faces.start && self.page(*last) == self.page(i as u32) => {
                    run.end = faces.end;
                }
                _ => draws.push((faces, i as u32)),
            }
        }
        draws
    }

    /// The page that a chunk is on.
    fn page(&self, chunk: u32) -> u16 {
        self.pages.as_ref().map_or(0, |pages| pages.page(chunk))
    }

    /// Draws with a pipeline of this model's layout; returns the number of triangles.
    pub(crate) fn draw(&self, pass: &mut RenderPass<'_>, draws: &[DrawCall]) -> u64 {
        self.bind(pass);
        for (faces, chunk) in draws {
            let corners = 3 * faces.start..3 * faces.end;
            self.pages.iter().for_each(|pages| pages.bind(pass, *chunk));
            match &self.indices {
                Some(_) => pass.draw_indexed(corners, 0, 0..1),
                None => pass.draw(corners, 0..1),
            }
        }
        draws.iter().map(|(faces, _)| u64::from(faces.end - faces.start)).sum()
    }

    fn bind(&self, pass: &mut RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        if let Some(indices) = &self.indices {
            pass.set_index_buffer(indices.slice(..), IndexFormat::Uint32);
        }
        if let Some(faces) = &self.faces {
            pass.set_bind_group(1, faces, &[]);
        }
    }
}

/// Position and colour of every vertex, or of every corner with one colour per face.
fn corners(gpu: &Gpu, mesh: &Mesh) -> Result<Buffer> {
    let corner = |position: Vec3, linear| CornerVertex {
        position: position.to_array(),
        color: layout::pack_color(linear),
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
fn texture_corners(gpu: &Gpu, mesh: &Mesh) -> Result<Buffer> {
    let uvs = mesh.texture.as_ref().map_or(&[][..], |texture| texture.uvs.as_flattened());
    buffer::filled(gpu, "corners", BufferUsages::VERTEX, uvs.len(), |corner| TextureVertex {
        position: mesh.positions[mesh.face(corner / 3)[corner % 3] as usize].to_array(),
        uv: uvs[corner].to_array(),
    })
}

/// The bind group of face colours, and its bytes.
fn face_group(gpu: &Gpu, groups: &BindGroupLayout, colors: &[[f32; 3]]) -> Result<(BindGroup, u64)> {
    let usage = BufferUsages::STORAGE;
    let colors = buffer::filled(gpu, "face colours", usage, colors.len(), |f| layout::pack_color(colors[f]))?;
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("faces"),
        layout: groups,
        entries: &[BindGroupEntry { binding: 0, resource: colors.as_entire_binding() }],
    });
    Ok((group, colors.size()))
}

/// Bytes of a texel.
const TEXEL: u32 = 4;

/// The bind group of each page, and the page of each chunk.
#[derive(Debug)]
struct Pages {
    /// `[pages]`
    groups: Vec<BindGroup>,
    /// `[chunks]`
    page_of: Vec<u16>,
    /// Bytes of GPU memory.
    bytes: u64,
}

/// Layout of the bind group of a page.
pub(super) fn page_layout(gpu: &Gpu) -> BindGroupLayout {
    let entry =
        |binding, ty| BindGroupLayoutEntry { binding, visibility: ShaderStages::FRAGMENT, ty, count: None };
    let picture = BindingType::Texture {
        sample_type: TextureSampleType::Float { filterable: true },
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = BindingType::Sampler(SamplerBindingType::Filtering);
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
        label: Some("page"),
        entries: &[entry(2, picture), entry(3, sampler)],
    })
}

impl Pages {
    /// Uploads the pages of `texture`, for chunks that [`runs`] made.
    ///
    /// Errors: the card has no room.
    fn upload(
        gpu: &Gpu,
        layout: &BindGroupLayout,
        texture: &FaceTexture,
        chunks: &[(Chunk, Aabb)],
    ) -> Result<Self> {
        let sampler = gpu.device.create_sampler(&SamplerDescriptor {
            label: Some("trilinear"),
            mag_filter: FilterMode::Linear,
            min_filter: FilterMode::Linear,
            mipmap_filter: MipmapFilterMode::Linear,
            ..SamplerDescriptor::default()
        });
        let (mut groups, mut bytes) = (Vec::with_capacity(texture.pages.len()), 0);
        for page in &texture.pages {
            let (view, size) = picture(gpu, page)?;
            bytes += size;
            groups.push(gpu.device.create_bind_group(&BindGroupDescriptor {
                label: Some("page"),
                layout,
                entries: &[
                    BindGroupEntry { binding: 2, resource: BindingResource::TextureView(&view) },
                    BindGroupEntry { binding: 3, resource: BindingResource::Sampler(&sampler) },
                ],
            }));
        }
        let page_of = chunks.iter().map(|(chunk, _)| texture.page(chunk.first as usize) as u16).collect();
        Ok(Self { groups, page_of, bytes })
    }

    /// Number of a chunk's page.
    fn page(&self, chunk: u32) -> u16 {
        self.page_of.get(chunk as usize).copied().unwrap_or(0)
    }

    /// Binds the page of a chunk.
    fn bind(&self, pass: &mut RenderPass<'_>, chunk: u32) {
        if let Some(group) = self.groups.get(usize::from(self.page(chunk))) {
            pass.set_bind_group(1, group, &[]);
        }
    }
}

/// Chunks cut where the page changes.
fn runs(mesh: &Mesh, texture: &FaceTexture, chunks: Vec<(Chunk, Aabb)>) -> Vec<(Chunk, Aabb)> {
    if texture.pages.len() < 2 {
        return chunks;
    }
    let mut cut = Vec::with_capacity(chunks.len());
    for (chunk, bounds) in chunks {
        let mut first = chunk.first;
        let end = chunk.first + chunk.count;
        for face in first + 1..=end {
            if face == end || texture.page(face as usize) != texture.page(first as usize) {
                let run = Chunk { first, count: face - first };
                cut.push((run, if run == chunk { bounds } else { Aabb::of(mesh, &run) }));
                first = face;
            }
        }
    }
    cut
}

/// A page with its mip levels, and its bytes. Of one that is larger than the card's textures, the levels that fit.
fn picture(gpu: &Gpu, page: &Texture) -> Result<(TextureView, u64)> {
    let limit = gpu.device.limits().max_texture_dimension_2d;
    let last = page.size().max_element().ilog2() as usize;
    let first = (0..last).find(|level| page.level(*level).size.max_element() <= limit).unwrap_or(last);
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
        let (width, height) = (pixels.size.x, pixels.size.y);
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
