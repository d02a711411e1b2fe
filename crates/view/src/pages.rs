//! The pages of a texture in GPU memory, and the runs of faces that are on one page.

use super::layout::Aabb;
use trisplat_gpu::Gpu;
use trisplat_scene::{Chunk, FaceTexture, Result, Texture, mesh::Mesh};
use wgpu::*;

/// Bytes of a texel.
const TEXEL: u32 = 4;

/// The bind group of each page, and the page of each chunk.
#[derive(Debug)]
pub(super) struct Pages {
    /// `[pages]`
    groups: Vec<BindGroup>,
    /// `[chunks]`
    page_of: Vec<u16>,
    /// Bytes of GPU memory.
    pub(super) bytes: u64,
}

/// Layout of the bind group of a page.
pub(super) fn group_layout(gpu: &Gpu) -> BindGroupLayout {
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
    pub(super) fn upload(
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
        let page_of =
            chunks.iter().map(|(chunk, _)| texture.page(chunk.first as usize).unwrap_or(0) as u16).collect();
        Ok(Self { groups, page_of, bytes })
    }

    /// Number of a chunk's page.
    pub(super) fn page(&self, chunk: u32) -> u16 {
        self.page_of.get(chunk as usize).copied().unwrap_or(0)
    }

    /// Binds the page of a chunk.
    pub(super) fn bind(&self, pass: &mut RenderPass<'_>, chunk: u32) {
        if let Some(group) = self.groups.get(usize::from(self.page(chunk))) {
            pass.set_bind_group(1, group, &[]);
        }
    }
}

/// Chunks cut where the page changes.
pub(super) fn runs(mesh: &Mesh, texture: &FaceTexture, chunks: Vec<(Chunk, Aabb)>) -> Vec<(Chunk, Aabb)> {
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
