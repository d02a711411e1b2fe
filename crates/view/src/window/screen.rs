//! The window's surface: pictures of the scene with the panel over them.

use super::super::renderer::{AssetRenderer, Attachments, FrameOutput, clear};
use super::panel;
use super::scene::WindowOptions;
use super::session::Session;
use crate::model::ModelLayouts;
use glam::UVec2;
use std::sync::Arc;
use std::time::Duration;
use trisplat_gpu::Gpu;
use trisplat_scene::{Error, Result};
use wgpu::*;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Window, WindowAttributes};

/// A window and its renderers.
pub(super) struct Screen {
    pub(super) window: Arc<Window>,
    pub(super) gpu: Arc<Gpu>,
    pub(super) input: egui_winit::State,
    renderer: AssetRenderer,
    surface: Surface<'static>,
    config: SurfaceConfiguration,
    attachments: Attachments,
    panel: egui_wgpu::Renderer,
    options: WindowOptions,
}

impl Screen {
    /// Opens a window.
    ///
    /// # Errors
    ///
    /// No window, or no card that can draw in it.
    pub(super) fn open(
        events: &ActiveEventLoop,
        options: &WindowOptions,
        title: String,
    ) -> Result<Self> {
        let size = winit::dpi::PhysicalSize::new(options.size.x, options.size.y);
        let attributes = WindowAttributes::default().with_title(title).with_inner_size(size);
        let no_window =
            |e: &dyn std::fmt::Display| Error::Gpu(format!("no window can be opened: {e}"));
        let window = Arc::new(events.create_window(attributes).map_err(|e| no_window(&e))?);
        let instance = options.adapter.instance(Some(Box::new(events.owned_display_handle())));
        let surface = instance.create_surface(window.clone()).map_err(|e| no_window(&e))?;
        let adapter = options.adapter.choose(&instance, Some(&surface))?;
        let gpu = Arc::new(Gpu::open(&adapter)?);
        let config = configuration(&surface, &adapter, &window, options.vsync)?;
        surface.configure(&gpu.device, &config);
        gpu.check()?;
        let attachments = Attachments::new(
            &gpu,
            UVec2::new(config.width, config.height),
            config.format,
            options.msaa,
        )?;
        let context = egui::Context::default();
        let limit = gpu.device.limits().max_texture_dimension_2d as usize;
        let input = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            Some(limit),
        );
        let panel = egui_wgpu::Renderer::new(
            &gpu.device,
            config.format,
            egui_wgpu::RendererOptions::default(),
        );
        let renderer = AssetRenderer::new(&gpu)?;
        Ok(Self {
            window,
            gpu,
            input,
            renderer,
            surface,
            config,
            attachments,
            panel,
            options: options.clone(),
        })
    }

    /// Layouts of the bind groups of models.
    pub(super) fn groups(&self) -> ModelLayouts {
        self.renderer.layouts.clone()
    }

    /// Takes a new size of the window.
    pub(super) fn resize(&mut self, size: UVec2) -> Result<()> {
        if size.min_element() == 0 {
            return Ok(()); // minimised
        }
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        self.config.width = size.x.min(limit);
        self.config.height = size.y.min(limit);
        self.surface.configure(&self.gpu.device, &self.config);
        let size = UVec2::new(self.config.width, self.config.height);
        self.attachments =
            Attachments::new(&self.gpu, size, self.config.format, self.options.msaa)?;
        self.gpu.check()
    }

    /// Draws a picture and shows it. Returns how long the panel can wait for the next.
    pub(super) fn draw(&mut self, session: &mut Session) -> Result<Duration> {
        let mut output = self.run_panel(session);
        for (id, deltas) in output.textures_delta.set.drain() {
            for delta in deltas {
                self.panel.update_texture(&self.gpu.device, &self.gpu.queue, id, &delta);
            }
        }
        let unused = std::mem::take(&mut output.textures_delta.free);
        let again =
            output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        let frame = match self.surface.get_current_texture() {
            CurrentSurfaceTexture::Success(frame) | CurrentSurfaceTexture::Suboptimal(frame) => {
                Some(frame)
            }
            CurrentSurfaceTexture::Outdated | CurrentSurfaceTexture::Lost => {
                self.surface.configure(&self.gpu.device, &self.config);
                self.window.request_redraw();
                None
            }
            CurrentSurfaceTexture::Timeout => {
                self.window.request_redraw();
                None
            }
            // An event says when it can be seen again.
            CurrentSurfaceTexture::Occluded | CurrentSurfaceTexture::Validation => None,
        };
        if let Some(frame) = frame {
            let view = frame.texture.create_view(&TextureViewDescriptor::default());
            let mut encoder =
                self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
            self.draw_scene(&mut encoder, &view, session)?;
            let shapes = std::mem::take(&mut output.shapes);
            let more = self.draw_panel(&mut encoder, &view, shapes, output.pixels_per_point);
            self.gpu.queue.submit(more.into_iter().chain([encoder.finish()]));
            self.window.pre_present_notify();
            self.gpu.queue.present(frame);
        }
        for id in &unused {
            self.panel.free_texture(id);
        }
        self.gpu.check()?;
        Ok(again)
    }

    fn run_panel(&mut self, session: &mut Session) -> egui::FullOutput {
        let input = self.input.take_egui_input(&self.window);
        let context = self.input.egui_ctx().clone();
        let mut output = context.run_ui(input, |ui| panel::draw(ui, session));
        let platform = std::mem::take(&mut output.platform_output);
        self.input.handle_platform_output(&self.window, platform);
        output
    }

    /// Draws the scene with the session's settings, or background.
    fn draw_scene(
        &mut self,
        encoder: &mut CommandEncoder,
        view: &TextureView,
        session: &mut Session,
    ) -> Result<()> {
        let attachments = &self.attachments;
        let size = UVec2::new(self.config.width, self.config.height);
        let params = session.frame_params(size, &self.options);
        session.camera = Some(params.camera);
        let Some(model) = session.model() else {
            clear(encoder, view, attachments, self.options.background);
            return Ok(());
        };
        let output = FrameOutput { picture: view, attachments };
        session.drawn = self.renderer.draw(&self.gpu, encoder, output, model, &params)?;
        Ok(())
    }

    fn draw_panel(
        &mut self,
        encoder: &mut CommandEncoder,
        view: &TextureView,
        shapes: Vec<egui::epaint::ClippedShape>,
        pixels_per_point: f32,
    ) -> Vec<CommandBuffer> {
        let primitives = self.input.egui_ctx().tessellate(shapes, pixels_per_point);
        let size_in_pixels = [self.config.width, self.config.height];
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels, pixels_per_point };
        let Gpu { device, queue, .. } = &*self.gpu;
        let more = self.panel.update_buffers(device, queue, encoder, &primitives, &screen);
        let pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("panel"),
            color_attachments: &[Some(RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: Operations { load: LoadOp::Load, store: StoreOp::Store },
            })],
            ..RenderPassDescriptor::default()
        });
        self.panel.render(&mut pass.forget_lifetime(), &primitives, &screen);
        more
    }
}

/// An sRGB format if available, so that the card encodes, and averages in linear light.
fn configuration(
    surface: &Surface<'_>,
    adapter: &Adapter,
    window: &Window,
    vsync: bool,
) -> Result<SurfaceConfiguration> {
    let size = window.inner_size();
    let limit = adapter.limits().max_texture_dimension_2d;
    let mut config = surface
        .get_default_config(adapter, size.width.clamp(1, limit), size.height.clamp(1, limit))
        .ok_or_else(|| Error::Gpu("the card cannot show pictures in this window".into()))?;
    let formats = surface.get_capabilities(adapter).formats;
    let eight_bits = |f: &&TextureFormat| {
        matches!(f.remove_srgb_suffix(), TextureFormat::Rgba8Unorm | TextureFormat::Bgra8Unorm)
    };
    let best = formats.iter().filter(eight_bits).max_by_key(|f| f.is_srgb());
    config.format = best.copied().unwrap_or(config.format);
    config.present_mode = if vsync { PresentMode::AutoVsync } else { PresentMode::AutoNoVsync };
    Ok(config)
}
