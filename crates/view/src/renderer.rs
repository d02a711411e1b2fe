//! Draws a model as an engine does, by the definition of the solid rasteriser on the CPU: opaque triangles,
//! z-buffer, both sides, clipped at the near plane, colours interpolated perspective-correctly in linear
//! light and sRGB-encoded when written.

use super::model::{Model, ModelGroups, page_layout};
use crate::model::{CornerVertex, TextureVertex, VertexLayout};
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec4, Mat4};
use std::collections::HashMap;
use trisplat_gpu::Gpu;
use trisplat_scene::{Asset, Error, Result, camera::Camera, math::color::linear_from_srgb};
use wgpu::*;

/// How one frame is drawn.
#[derive(Debug, Clone, Copy)]
pub struct FrameParams {
    /// The camera, at the size of the picture.
    pub camera: Camera,
    /// Least depth that is drawn, world units.
    pub near: f32,
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// What the triangles show.
    pub display: DisplayMode,
    /// Edges only.
    pub wireframe: bool,
    /// The card's multisampling: 1 or 4 samples per pixel at edges.
    pub msaa: u32,
}

impl FrameParams {
    /// Colours over black, one sample per pixel.
    pub fn new(camera: &Camera) -> Self {
        let (camera, background, display) = (*camera, [0.0; 3], DisplayMode::Color);
        Self { camera, near: 0.01, background, display, wireframe: false, msaa: 1 }
    }
}

/// What the triangles show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum DisplayMode {
    /// Their colour.
    #[default]
    Color,
    /// Their normal: red to the right, green up, blue to the viewer.
    Normals,
}

/// Counts of a drawn frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DrawStats {
    /// Triangles in the chunks that were drawn.
    pub triangles: u64,
    /// Draw calls.
    pub draws: u32,
}

/// The depth buffer and, with multisampling, the samples of a frame; the picture is separate.
#[derive(Debug)]
pub(crate) struct Attachments {
    /// Width and height, px.
    pub(crate) size: glam::UVec2,
    format: TextureFormat,
    samples: u32,
    depth: TextureView,
    multisampled: Option<TextureView>,
}

impl Attachments {
    /// For pictures of `size` and `format`, with `samples` (1 or 4) per pixel.
    ///
    /// Errors: larger than the card can draw, or more memory than it has.
    pub(crate) fn new(gpu: &Gpu, size: glam::UVec2, format: TextureFormat, samples: u32) -> Result<Self> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if size.min_element() == 0 || size.max_element() > limit {
            let wants = format!("1 to {limit} px per side on {}", gpu.info.name);
            return Err(Error::invalid("picture size", format!("{}x{}", size.x, size.y), wants));
        }
        let usage = TextureUsages::RENDER_ATTACHMENT;
        let depth = texture(gpu, "depth", size, TextureFormat::Depth32Float, samples, usage);
        let multisampled = (samples > 1).then(|| texture(gpu, "samples", size, format, samples, usage));
        gpu.check()?;
        let view = |t: Texture| t.create_view(&TextureViewDescriptor::default());
        Ok(Self { size, format, samples, depth: view(depth), multisampled: multisampled.map(view) })
    }
}

/// Where a frame goes.
#[derive(Debug)]
pub(crate) struct FrameOutput<'a> {
    /// The picture, of the attachments' size and format.
    pub(crate) picture: &'a TextureView,
    /// Its depth and samples.
    pub(crate) attachments: &'a Attachments,
    /// The buffers of timestamps.
    pub(crate) timestamps: Option<RenderPassTimestampWrites<'a>>,
}

/// A texture to draw to.
pub(crate) fn texture(
    gpu: &Gpu,
    label: &str,
    size: glam::UVec2,
    format: TextureFormat,
    samples: u32,
    usage: TextureUsages,
) -> Texture {
    gpu.device.create_texture(&TextureDescriptor {
        label: Some(label),
        size: Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// The first bind group of the shader.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FrameUniform {
    clip: Mat4,
    view: Mat4,
}

/// The key of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct PipelineKey {
    layout: VertexLayout,
    display: DisplayMode,
    wireframe: bool,
    format: TextureFormat,
    samples: u32,
}

/// Draws models.
#[derive(Debug)]
pub(crate) struct Renderer {
    shader: ShaderModule,
    frame: Buffer,
    frame_group: BindGroup,
    frame_layout: BindGroupLayout,
    groups: ModelGroups,
    pipelines: HashMap<PipelineKey, RenderPipeline>,
}

impl Renderer {
    /// A renderer on `gpu`; all calls must pass the same `gpu`.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self> {
        let source = ShaderSource::Wgsl(include_str!("pass_mesh.wgsl").into());
        let shader =
            gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some("pass_mesh"), source });
        let frame = gpu.device.create_buffer(&BufferDescriptor {
            label: Some("frame"),
            size: size_of::<FrameUniform>() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let frame_layout =
            group_layout(gpu, "frame", ShaderStages::VERTEX_FRAGMENT, &[BufferBindingType::Uniform]);
        let storage = BufferBindingType::Storage { read_only: true };
        let groups = ModelGroups {
            faces: group_layout(gpu, "faces", ShaderStages::VERTEX, &[storage]),
            page: page_layout(gpu),
        };
        let frame_group = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("frame"),
            layout: &frame_layout,
            entries: &[BindGroupEntry { binding: 0, resource: frame.as_entire_binding() }],
        });
        gpu.check()?;
        Ok(Self { shader, frame, frame_group, frame_layout, groups, pipelines: HashMap::new() })
    }

    /// The layouts of bind groups, for [`Model::upload`].
    pub(crate) fn groups(&self) -> &ModelGroups {
        &self.groups
    }

    /// The best layout for `asset` on this card.
    pub(crate) fn best_layout(gpu: &Gpu, asset: &Asset) -> VertexLayout {
        let limits = gpu.device.limits();
        let color_bytes = 4 * asset.mesh.face_count() as u64;
        let room = limits.max_storage_buffers_per_shader_stage >= 1
            && color_bytes <= limits.max_storage_buffer_binding_size;
        if room || asset.mesh.texture.is_some() {
            VertexLayout::exact(&asset.mesh)
        } else {
            VertexLayout::Corner
        }
    }

    /// Uploads an asset to GPU memory; `None` chooses the layout. Errors: see [`Model::upload`].
    pub(crate) fn upload(&self, gpu: &Gpu, asset: &Asset, layout: Option<VertexLayout>) -> Result<Model> {
        let layout = layout.unwrap_or_else(|| Self::best_layout(gpu, asset));
        Model::upload(gpu, &self.groups, asset, layout)
    }

    /// Records the drawing of `model` onto a picture, which is cleared first.
    ///
    /// Errors: a display mode that the card cannot draw.
    pub(crate) fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        output: FrameOutput<'_>,
        model: &Model,
        params: &FrameParams,
    ) -> Result<DrawStats> {
        let Attachments { format, samples, .. } = *output.attachments;
        let FrameParams { display, wireframe, .. } = *params;
        let key = PipelineKey { layout: model.layout, display, wireframe, format, samples };
        self.prepare(gpu, key)?;
        let uniform = frame_uniform(params);
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&uniform));
        let draws = model.draw_calls(&params.camera, params.near);
        let mut pass = begin(encoder, output, params.background);
        let Some(pipeline) = self.pipelines.get(&key) else { return Ok(DrawStats::default()) };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &self.frame_group, &[]);
        let triangles = model.draw(&mut pass, &draws);
        Ok(DrawStats { triangles, draws: draws.len() as u32 })
    }

    /// Makes the pipeline for a key, once.
    fn prepare(&mut self, gpu: &Gpu, key: PipelineKey) -> Result<()> {
        if self.pipelines.contains_key(&key) {
            return Ok(());
        }
        if key.wireframe && !gpu.device.features().contains(Features::POLYGON_MODE_LINE) {
            return Err(Error::Gpu(format!("{} cannot draw wireframes", gpu.info.name)));
        }
        let pipeline = self.pipeline(gpu, key);
        gpu.check()?;
        self.pipelines.insert(key, pipeline);
        Ok(())
    }

    fn pipeline(&self, gpu: &Gpu, key: PipelineKey) -> RenderPipeline {
        let plain = key.display == DisplayMode::Color;
        let (vertex, light) = match (key.layout, plain) {
            (VertexLayout::Corner, true) => ("corner_color", "smooth_light"),
            (VertexLayout::Corner, false) => ("corner_display", "display_light"),
            (VertexLayout::Face, true) => ("face_color", "flat_light"),
            (VertexLayout::Face, false) => ("face_display", "display_light"),
            (VertexLayout::Texture, true) => ("texture_color", "texture_light"),
            (VertexLayout::Texture, false) => ("texture_display", "texture_display_light"),
        };
        let constants = [
            ("DISPLAY", f64::from(key.display as u8)),
            ("ENCODE", f64::from(u8::from(!key.format.is_srgb()))),
        ];
        let compilation_options =
            PipelineCompilationOptions { constants: &constants, ..PipelineCompilationOptions::default() };
        let groups: &[Option<&BindGroupLayout>] = match key.layout {
            VertexLayout::Corner => &[Some(&self.frame_layout)],
            VertexLayout::Face => &[Some(&self.frame_layout), Some(&self.groups.faces)],
            VertexLayout::Texture => &[Some(&self.frame_layout), Some(&self.groups.page)],
        };
        let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: Some("mesh"),
            bind_group_layouts: groups,
            immediate_size: 0,
        });
        gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
            label: Some(vertex),
            layout: Some(&layout),
            vertex: VertexState {
                module: &self.shader,
                entry_point: Some(vertex),
                compilation_options: compilation_options.clone(),
                buffers: &[Some(vertex_buffer(key.layout))],
            },
            primitive: PrimitiveState {
                polygon_mode: if key.wireframe { PolygonMode::Line } else { PolygonMode::Fill },
                ..PrimitiveState::default()
            },
            depth_stencil: Some(DepthStencilState {
                format: TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                // near / depth: the nearer one is greater, and ties keep the first.
                depth_compare: Some(CompareFunction::Greater),
                stencil: StencilState::default(),
                bias: DepthBiasState::default(),
            }),
            multisample: MultisampleState { count: key.samples, ..MultisampleState::default() },
            fragment: Some(FragmentState {
                module: &self.shader,
                entry_point: Some(light),
                compilation_options,
                targets: &[Some(key.format.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// A pass that clears picture and depth.
fn begin<'e>(
    encoder: &'e mut CommandEncoder,
    output: FrameOutput<'_>,
    background: [f32; 3],
) -> RenderPass<'e> {
    let FrameOutput { picture, attachments, timestamps } = output;
    let encoded = !attachments.format.is_srgb();
    let [r, g, b] = background.map(|c| f64::from(if encoded { c } else { linear_from_srgb(c) }));
    let (view, resolve_target) = match &attachments.multisampled {
        Some(samples) => (samples, Some(picture)),
        None => (picture, None),
    };
    // The samples are not needed once they are averaged.
    let store = if attachments.multisampled.is_some() { StoreOp::Discard } else { StoreOp::Store };
    encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("mesh"),
        color_attachments: &[Some(RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target,
            ops: Operations { load: LoadOp::Clear(Color { r, g, b, a: 1.0 }), store },
        })],
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: &attachments.depth,
            depth_ops: Some(Operations { load: LoadOp::Clear(0.0), store: StoreOp::Discard }),
            stencil_ops: None,
        }),
        timestamp_writes: timestamps,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}

/// Records a picture of only background.
#[cfg(feature = "view")]
pub(crate) fn clear(
    encoder: &mut CommandEncoder,
    picture: &TextureView,
    attachments: &Attachments,
    background: [f32; 3],
) {
    drop(begin(encoder, FrameOutput { picture, attachments, timestamps: None }, background));
}

/// A group of buffers.
fn group_layout(
    gpu: &Gpu,
    label: &str,
    visibility: ShaderStages,
    kinds: &[BufferBindingType],
) -> BindGroupLayout {
    let entry = |(binding, &ty): (u32, &BufferBindingType)| BindGroupLayoutEntry {
        binding,
        visibility,
        ty: BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let entries: Vec<BindGroupLayoutEntry> = (0..).zip(kinds).map(entry).collect();
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn vertex_buffer(layout: VertexLayout) -> VertexBufferLayout<'static> {
    const CORNER: [VertexAttribute; 2] = vertex_attr_array![0 => Float32x3, 1 => Unorm10_10_10_2];
    const FACE: [VertexAttribute; 1] = vertex_attr_array![0 => Float32x3];
    const TEXTURE: [VertexAttribute; 2] = vertex_attr_array![0 => Float32x3, 1 => Float32x2];
    let (stride, attributes): (usize, &[VertexAttribute]) = match layout {
        VertexLayout::Corner => (size_of::<CornerVertex>(), &CORNER),
        VertexLayout::Face => (size_of::<[f32; 3]>(), &FACE),
        VertexLayout::Texture => (size_of::<TextureVertex>(), &TEXTURE),
    };
    VertexBufferLayout { array_stride: stride as u64, step_mode: VertexStepMode::Vertex, attributes }
}

/// World to clip space, multiplied in f64 and rounded once.
///
/// ```text
/// (x, y, z, w) = (2 (fx X + cx Z) / W - Z,  Z - 2 (fy Y + cy Z) / H,  near,  Z)   of the camera's X, Y, Z
/// ```
fn frame_uniform(params: &FrameParams) -> FrameUniform {
    let (camera, near) = (&params.camera, params.near);
    let row = |r: usize| camera.rotation.row(r).as_dvec3().extend(camera.translation[r].into());
    let (x, y, z) = (row(0), row(1), row(2));
    let (f, c, s) = (camera.focal.as_dvec2(), camera.center.as_dvec2(), camera.size.as_dvec2());
    let clip = DMat4::from_cols(
        x * (2.0 * f.x / s.x) + z * (2.0 * c.x / s.x - 1.0),
        y * (-2.0 * f.y / s.y) + z * (1.0 - 2.0 * c.y / s.y),
        DVec4::W * f64::from(near),
        z,
    );
    let view = DMat4::from_cols(x, y, z, DVec4::W);
    FrameUniform { clip: clip.transpose().as_mat4(), view: view.transpose().as_mat4() }
}
