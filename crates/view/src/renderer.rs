//! Draws a model as an engine does, by the definition of the solid rasteriser on the CPU: opaque
//! triangles, z-buffer, both sides, clipped at the near plane, colours interpolated
//! perspective-correctly in linear light and sRGB-encoded when written.

use crate::model::{CornerVertex, Model, ModelLayouts, TextureVertex};
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec4, Mat4, UVec2};
use std::collections::HashMap;
use trisplat_gpu::{AdapterOptions, Gpu, readback};
use trisplat_raster::kernel::sh;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::{Asset, Error, Result};
use wgpu::*;

/// Drawing options of one frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameParams {
    /// The camera, at the size of the picture.
    pub camera: Camera,
    /// Minimum depth that is drawn, world units.
    pub near: f32,
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// Edges only.
    pub wireframe: bool,
    /// The card's multisampling: 1 or 4 samples per pixel at edges.
    pub msaa: u32,
}

impl FrameParams {
    /// Colours over black, one sample per pixel.
    pub fn new(camera: &Camera) -> Self {
        Self { camera: *camera, near: 0.01, background: [0.0; 3], wireframe: false, msaa: 1 }
    }
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
    format: TextureFormat,
    samples: u32,
    depth: TextureView,
    multisampled: Option<TextureView>,
}

impl Attachments {
    /// For pictures of `size` and `format`, with `samples` (1 or 4) per pixel.
    ///
    /// # Errors
    ///
    /// Larger than the card can draw, or more memory than it has.
    pub(crate) fn new(
        gpu: &Gpu,
        size: glam::UVec2,
        format: TextureFormat,
        samples: u32,
    ) -> Result<Self> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if size.min_element() == 0 || size.max_element() > limit {
            let wants = format!("1 to {limit} px per side on {}", gpu.info.name);
            return Err(Error::invalid("picture size", format!("{}x{}", size.x, size.y), wants));
        }
        let usage = TextureUsages::RENDER_ATTACHMENT;
        let depth = texture(gpu, "depth", size, TextureFormat::Depth32Float, samples, usage);
        let multisampled =
            (samples > 1).then(|| texture(gpu, "samples", size, format, samples, usage));
        gpu.check()?;
        let view = |t: Texture| t.create_view(&TextureViewDescriptor::default());
        Ok(Self { format, samples, depth: view(depth), multisampled: multisampled.map(view) })
    }
}

/// Target of a frame.
#[derive(Debug)]
pub(crate) struct FrameOutput<'a> {
    /// The picture, of the attachments' size and format.
    pub(crate) picture: &'a TextureView,
    /// Its depth and samples.
    pub(crate) attachments: &'a Attachments,
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

/// The key of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct PipelineKey {
    is_textured: bool,
    has_harmonics: bool,
    single_sided: bool,
    wireframe: bool,
    format: TextureFormat,
    samples: u32,
}

/// Draws models.
#[derive(Debug)]
pub(crate) struct AssetRenderer {
    shader: ShaderModule,
    frame: Buffer,
    frame_group: BindGroup,
    frame_layout: BindGroupLayout,
    pub(crate) layouts: ModelLayouts,
    pipelines: HashMap<PipelineKey, RenderPipeline>,
}

impl AssetRenderer {
    /// A renderer on `gpu`; all calls must pass the same `gpu`.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self> {
        let source = ShaderSource::Wgsl((sh::wgsl() + include_str!("pass_mesh.wgsl")).into());
        let shader = gpu
            .device
            .create_shader_module(ShaderModuleDescriptor { label: Some("pass_mesh"), source });
        let frame = gpu.device.create_buffer(&BufferDescriptor {
            label: Some("frame"),
            size: size_of::<FrameUniforms>() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let entry = BindGroupLayoutEntry {
            binding: 0,
            visibility: ShaderStages::VERTEX,
            ty: BindingType::Buffer {
                ty: BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let descriptor = BindGroupLayoutDescriptor { label: Some("frame"), entries: &[entry] };
        let frame_layout = gpu.device.create_bind_group_layout(&descriptor);
        let layouts = ModelLayouts::new(gpu);
        let frame_group = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("frame"),
            layout: &frame_layout,
            entries: &[BindGroupEntry { binding: 0, resource: frame.as_entire_binding() }],
        });
        gpu.check()?;
        Ok(Self { shader, frame, frame_group, frame_layout, layouts, pipelines: HashMap::new() })
    }

    /// Records the drawing of `model` onto a picture, which is cleared first.
    ///
    /// # Errors
    ///
    /// A display mode that the card cannot draw.
    pub(crate) fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        output: FrameOutput<'_>,
        model: &Model,
        params: &FrameParams,
    ) -> Result<DrawStats> {
        let Attachments { format, samples, .. } = *output.attachments;
        let key = |single_sided| PipelineKey {
            is_textured: model.is_textured(),
            has_harmonics: model.sh_degree() > 0,
            single_sided,
            wireframe: params.wireframe,
            format,
            samples,
        };
        gpu.queue.write_buffer(
            &self.frame,
            0,
            bytemuck::bytes_of(&FrameUniforms::new(params, model)),
        );
        let mut draws = Vec::new();
        for single_sided in [false, true] {
            let runs = model.draw_calls(&params.camera, params.near, single_sided);
            if !runs.is_empty() {
                self.prepare(gpu, key(single_sided))?;
                draws.push((key(single_sided), runs));
            }
        }
        let mut pass = begin(encoder, output, params.background);
        pass.set_bind_group(0, &self.frame_group, &[]);
        model.bind(&mut pass);
        let mut stats = DrawStats::default();
        for (key, runs) in draws {
            let Some(pipeline) = self.pipelines.get(&key) else { continue };
            pass.set_pipeline(pipeline);
            stats.triangles += model.draw(&mut pass, &runs);
            stats.draws += runs.len() as u32;
        }
        Ok(stats)
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
        let (vertex, light) = if key.is_textured {
            ("texture_color", "texture_light")
        } else if key.has_harmonics {
            ("harmonic_color", "smooth_light")
        } else {
            ("corner_color", "smooth_light")
        };
        let constants = [("ENCODE", f64::from(u8::from(!key.format.is_srgb())))];
        let compilation_options = PipelineCompilationOptions {
            constants: &constants,
            ..PipelineCompilationOptions::default()
        };
        let second =
            if key.has_harmonics { &self.layouts.harmonics } else { &self.layouts.texture };
        let groups = [Some(&self.frame_layout), Some(second)];
        let count = if key.is_textured || key.has_harmonics { 2 } else { 1 };
        let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: Some("mesh"),
            bind_group_layouts: &groups[..count],
            immediate_size: 0,
        });
        gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
            label: Some(vertex),
            layout: Some(&layout),
            vertex: VertexState {
                module: &self.shader,
                entry_point: Some(vertex),
                compilation_options: compilation_options.clone(),
                buffers: &[Some(vertex_buffer(key.is_textured))],
            },
            primitive: PrimitiveState {
                cull_mode: key.single_sided.then_some(Face::Back),
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
    let FrameOutput { picture, attachments } = output;
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
        timestamp_writes: None,
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
    drop(begin(encoder, FrameOutput { picture, attachments }, background));
}

fn vertex_buffer(is_textured: bool) -> VertexBufferLayout<'static> {
    const CORNER: [VertexAttribute; 2] = vertex_attr_array![0 => Float32x3, 1 => Unorm10_10_10_2];
    const TEXTURE: [VertexAttribute; 2] = vertex_attr_array![0 => Float32x3, 1 => Float32x2];
    let (stride, attributes) = if !is_textured {
        (size_of::<CornerVertex>(), &CORNER)
    } else {
        (size_of::<TextureVertex>(), &TEXTURE)
    };
    VertexBufferLayout {
        array_stride: stride as u64,
        step_mode: VertexStepMode::Vertex,
        attributes,
    }
}

/// Numbers of a frame for the shader.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FrameUniforms {
    /// World to clip space, by columns.
    clip: [f32; 16],
    /// The place of the camera, and the degree of the model's spherical harmonics.
    eye: [f32; 4],
}

impl FrameUniforms {
    fn new(params: &FrameParams, model: &Model) -> Self {
        let eye = params.camera.position().extend(f32::from(model.sh_degree()));
        Self { clip: to_clip_space(params).to_cols_array(), eye: eye.to_array() }
    }
}

/// World to clip space, multiplied in f64 and rounded once.
///
/// ```text
/// (x, y, z, w) = (2 (fx X + cx Z) / W - Z,  Z - 2 (fy Y + cy Z) / H,  near,  Z)   of the camera's X, Y, Z
/// ```
fn to_clip_space(params: &FrameParams) -> Mat4 {
    let camera = &params.camera;
    let near = params.near;
    let row = |r: usize| camera.rotation.row(r).as_dvec3().extend(camera.translation[r].into());
    let x = row(0);
    let y = row(1);
    let z = row(2);
    let f = camera.focal.as_dvec2();
    let c = camera.center.as_dvec2();
    let s = camera.size.as_dvec2();
    let clip = DMat4::from_cols(
        x * (2.0 * f.x / s.x) + z * (2.0 * c.x / s.x - 1.0),
        y * (-2.0 * f.y / s.y) + z * (1.0 - 2.0 * c.y / s.y),
        DVec4::W * f64::from(near),
        z,
    );
    clip.transpose().as_mat4()
}

// ---- Pictures drawn on a graphics card without a window or a display ----------------------------

/// The format of pictures: four bytes per pixel, sRGB-encoded by the card.
pub(crate) const FORMAT: TextureFormat = TextureFormat::Rgba8UnormSrgb;

/// Draws to memory.
#[derive(Debug)]
pub struct Headless {
    /// The card.
    pub gpu: Gpu,
    renderer: AssetRenderer,
}

impl Headless {
    /// Opens a card; needs no display.
    ///
    /// # Errors
    ///
    /// No matching card.
    pub fn new(options: &AdapterOptions) -> Result<Self> {
        let gpu = Gpu::headless(options)?;
        let renderer = AssetRenderer::new(&gpu)?;
        Ok(Self { gpu, renderer })
    }

    /// Uploads an asset to GPU memory.
    ///
    /// # Errors
    ///
    /// The card has no room.
    pub fn upload(&self, asset: &Asset) -> Result<Model> {
        Model::upload(&self.gpu, &self.renderer.layouts, asset)
    }

    /// The picture of `model`.
    ///
    /// # Errors
    ///
    /// A picture larger than the card draws, no memory, the card is lost.
    pub fn render(&mut self, model: &Model, params: &FrameParams) -> Result<(RgbImage, DrawStats)> {
        params.camera.validate(&trisplat_scene::Limits::DEFAULT)?;
        if ![1, 4].contains(&params.msaa) {
            return Err(Error::invalid("msaa", params.msaa, "1 or 4"));
        }
        let canvas = Canvas::new(&self.gpu, params.camera.size, params.msaa)?;
        let mut encoder =
            self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let stats = self.draw(&mut encoder, &canvas, model, params)?;
        self.gpu.queue.submit([encoder.finish()]);
        Ok((canvas.pixels(&self.gpu)?, stats))
    }

    /// Records one frame into `canvas`.
    pub fn draw(
        &mut self,
        encoder: &mut CommandEncoder,
        canvas: &Canvas,
        model: &Model,
        params: &FrameParams,
    ) -> Result<DrawStats> {
        self.renderer.draw(&self.gpu, encoder, canvas.output(), model, params)
    }
}

/// A picture in GPU memory, with its attachments.
#[derive(Debug)]
pub struct Canvas {
    picture: Texture,
    view: TextureView,
    attachments: Attachments,
}

impl Canvas {
    /// Of `size` pixels, with `msaa` samples each.
    pub fn new(gpu: &Gpu, size: UVec2, msaa: u32) -> Result<Self> {
        let attachments = Attachments::new(gpu, size, FORMAT, msaa)?;
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        let picture = texture(gpu, "picture", size, FORMAT, 1, usage);
        gpu.check()?;
        let view = picture.create_view(&TextureViewDescriptor::default());
        Ok(Self { picture, view, attachments })
    }

    /// Target of a frame.
    pub(crate) fn output(&self) -> FrameOutput<'_> {
        FrameOutput { picture: &self.view, attachments: &self.attachments }
    }

    /// The last drawn picture.
    pub(crate) fn pixels(&self, gpu: &Gpu) -> Result<RgbImage> {
        let Extent3d { width, height, .. } = self.picture.size();
        let rgb = readback::texels(gpu, &self.picture)?
            .into_iter()
            .map(|[r, g, b, _]| [r, g, b])
            .collect();
        Ok(RgbImage { size: UVec2::new(width, height), rgb, alpha: None })
    }
}
