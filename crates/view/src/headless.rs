//! Pictures drawn on a graphics card without a window or a display.

use super::layout::VertexLayout;
use super::model::Model;
use super::renderer::{Attachments, DisplayMode, DrawStats, FrameOutput, FrameParams, Renderer, texture};
use glam::UVec2;
use trisplat_gpu::{AdapterOptions, Gpu, readback};
use trisplat_scene::{Asset, Error, Result, camera::Camera, image::RgbImage};
use wgpu::*;

/// The format of pictures: four bytes per pixel, sRGB-encoded by the card.
pub(crate) const FORMAT: TextureFormat = TextureFormat::Rgba8UnormSrgb;

/// How a picture is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadlessOptions {
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// Samples per pixel along each axis, averaged in linear light: 4 = 16 per pixel.
    pub samples: u32,
    /// The card's multisampling: 1 or 4 samples per pixel at edges.
    pub msaa: u32,
    /// Least depth that is drawn, world units.
    pub near: f32,
    /// What the triangles show.
    pub display: DisplayMode,
}

impl Default for HeadlessOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], samples: 1, msaa: 1, near: 0.01, display: DisplayMode::Color }
    }
}

/// Draws to memory.
#[derive(Debug)]
pub struct Headless {
    /// The card.
    pub gpu: Gpu,
    renderer: Renderer,
}

impl Headless {
    /// Opens a card; needs no display. Errors: no matching card.
    pub fn new(options: &AdapterOptions) -> Result<Self> {
        let gpu = Gpu::headless(options)?;
        let renderer = Renderer::new(&gpu)?;
        Ok(Self { gpu, renderer })
    }

    /// Uploads an asset to GPU memory; `None` chooses the layout.
    pub fn upload(&self, asset: &Asset, layout: Option<VertexLayout>) -> Result<Model> {
        self.renderer.upload(&self.gpu, asset, layout)
    }

    /// The picture of `model` by `camera`.
    ///
    /// Errors: a picture larger than the card draws, no memory, the card is lost.
    pub fn render(
        &mut self,
        model: &Model,
        camera: &Camera,
        options: &HeadlessOptions,
    ) -> Result<(RgbImage, DrawStats)> {
        camera.validate(&trisplat_scene::Limits::DEFAULT)?;
        if !(1..=16).contains(&options.samples) {
            return Err(Error::invalid("samples", options.samples, "1 to 16 per axis"));
        }
        if ![1, 4].contains(&options.msaa) {
            return Err(Error::invalid("msaa", options.msaa, "1 or 4"));
        }
        let fine = camera.resized(camera.size * options.samples);
        let canvas = Canvas::new(&self.gpu, fine.size, options.msaa)?;
        let params = FrameParams {
            camera: fine,
            near: options.near,
            background: options.background,
            display: options.display,
            wireframe: false,
            level_bias: (options.samples as f32).log2(),
        };
        let mut encoder = self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let stats = canvas.draw(&self.gpu, &mut self.renderer, &mut encoder, model, &params, None)?;
        let picture = if options.samples > 1 {
            averaged(&self.gpu, &mut encoder, &canvas, camera.size, options.samples)
        } else {
            canvas.picture
        };
        self.gpu.queue.submit([encoder.finish()]);
        Ok((pixels(&self.gpu, &picture)?, stats))
    }

    /// Records one frame into `canvas`.
    pub fn draw(
        &mut self,
        encoder: &mut CommandEncoder,
        canvas: &Canvas,
        model: &Model,
        params: &FrameParams,
        timestamps: Option<RenderPassTimestampWrites<'_>>,
    ) -> Result<DrawStats> {
        canvas.draw(&self.gpu, &mut self.renderer, encoder, model, params, timestamps)
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
        let usage =
            TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let picture = texture(gpu, "picture", size, FORMAT, 1, usage);
        gpu.check()?;
        let view = picture.create_view(&TextureViewDescriptor::default());
        Ok(Self { picture, view, attachments })
    }

    /// Records one frame.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        encoder: &mut CommandEncoder,
        model: &Model,
        params: &FrameParams,
        timestamps: Option<RenderPassTimestampWrites<'_>>,
    ) -> Result<DrawStats> {
        let output = FrameOutput { picture: &self.view, attachments: &self.attachments, timestamps };
        renderer.draw(gpu, encoder, output, model, params)
    }

    /// The last drawn picture.
    pub fn pixels(&self, gpu: &Gpu) -> Result<RgbImage> {
        pixels(gpu, &self.picture)
    }
}

fn pixels(gpu: &Gpu, picture: &Texture) -> Result<RgbImage> {
    let Extent3d { width, height, .. } = picture.size();
    let rgb = readback::texels(gpu, picture)?.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
    Ok(RgbImage { size: UVec2::new(width, height), rgb, alpha: None })
}

/// Records the averaging of `samples` x `samples` texels per pixel.
fn averaged(gpu: &Gpu, encoder: &mut CommandEncoder, canvas: &Canvas, size: UVec2, samples: u32) -> Texture {
    let pipeline = average_pipeline(gpu, samples);
    let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
    let picture = texture(gpu, "averaged", size, FORMAT, 1, usage);
    let view = picture.create_view(&TextureViewDescriptor::default());
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("samples"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[BindGroupEntry { binding: 0, resource: BindingResource::TextureView(&canvas.view) }],
    });
    let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("average"),
        color_attachments: &[Some(RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: Operations { load: LoadOp::Clear(Color::BLACK), store: StoreOp::Store },
        })],
        ..RenderPassDescriptor::default()
    });
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
    drop(pass);
    picture
}

fn average_pipeline(gpu: &Gpu, samples: u32) -> RenderPipeline {
    let source = ShaderSource::Wgsl(include_str!("pass_average.wgsl").into());
    let shader =
        gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some("pass_average"), source });
    let constants = [("PER_AXIS", f64::from(samples))];
    let compilation_options =
        PipelineCompilationOptions { constants: &constants, ..PipelineCompilationOptions::default() };
    gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
        label: Some("average"),
        layout: None,
        vertex: VertexState {
            module: &shader,
            entry_point: Some("whole_screen"),
            compilation_options: compilation_options.clone(),
            buffers: &[],
        },
        primitive: PrimitiveState::default(),
        depth_stencil: None,
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState {
            module: &shader,
            entry_point: Some("average"),
            compilation_options,
            targets: &[Some(FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
