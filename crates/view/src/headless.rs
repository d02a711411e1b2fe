//! Pictures drawn on a graphics card without a window or a display.

use super::model::Model;
use super::renderer::{Attachments, DrawStats, FrameOutput, FrameParams, Renderer, texture};
use glam::UVec2;
use trisplat_gpu::{AdapterOptions, Gpu, readback};
use trisplat_scene::{Asset, Error, Result, image::RgbImage};
use wgpu::*;

/// The format of pictures: four bytes per pixel, sRGB-encoded by the card.
pub(crate) const FORMAT: TextureFormat = TextureFormat::Rgba8UnormSrgb;

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

    /// Uploads an asset to GPU memory. Errors: the card has no room.
    pub fn upload(&self, asset: &Asset) -> Result<Model> {
        Model::upload(&self.gpu, &self.renderer.texture_layout, asset)
    }

    /// The picture of `model`.
    ///
    /// Errors: a picture larger than the card draws, no memory, the card is lost.
    pub fn render(&mut self, model: &Model, params: &FrameParams) -> Result<(RgbImage, DrawStats)> {
        params.camera.validate(&trisplat_scene::Limits::DEFAULT)?;
        if ![1, 4].contains(&params.msaa) {
            return Err(Error::invalid("msaa", params.msaa, "1 or 4"));
        }
        let canvas = Canvas::new(&self.gpu, params.camera.size, params.msaa)?;
        let mut encoder = self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let stats = self.draw(&mut encoder, &canvas, model, params, None)?;
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
        self.renderer.draw(&self.gpu, encoder, canvas.output(timestamps), model, params)
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

    /// Where a frame goes.
    pub(crate) fn output<'a>(&'a self, timestamps: Option<RenderPassTimestampWrites<'a>>) -> FrameOutput<'a> {
        FrameOutput { picture: &self.view, attachments: &self.attachments, timestamps }
    }

    /// The last drawn picture.
    pub(crate) fn pixels(&self, gpu: &Gpu) -> Result<RgbImage> {
        let Extent3d { width, height, .. } = self.picture.size();
        let rgb = readback::texels(gpu, &self.picture)?.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
        Ok(RgbImage { size: UVec2::new(width, height), rgb, alpha: None })
    }
}
