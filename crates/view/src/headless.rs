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
    /// The card's multisampling: 1 or 4 samples per pixel at edges.
    pub msaa: u32,
    /// Least depth that is drawn, world units.
    pub near: f32,
    /// What the triangles show.
    pub display: DisplayMode,
}

impl Default for HeadlessOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], msaa: 1, near: 0.01, display: DisplayMode::Color }
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
        if ![1, 4].contains(&options.msaa) {
            return Err(Error::invalid("msaa", options.msaa, "1 or 4"));
        }
        let canvas = Canvas::new(&self.gpu, camera.size, options.msaa)?;
        let params = FrameParams {
            camera: *camera,
            near: options.near,
            background: options.background,
            display: options.display,
            wireframe: false,
        };
        let mut encoder = self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let stats = canvas.draw(&self.gpu, &mut self.renderer, &mut encoder, model, &params, None)?;
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
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
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
    pub(crate) fn pixels(&self, gpu: &Gpu) -> Result<RgbImage> {
        let Extent3d { width, height, .. } = self.picture.size();
        let rgb = readback::texels(gpu, &self.picture)?.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
        Ok(RgbImage { size: UVec2::new(width, height), rgb, alpha: None })
    }
}
