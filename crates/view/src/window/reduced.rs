//! A picture of fewer pixels than the window, which the panel stretches over it.

use super::super::renderer::{Attachments, texture};
use egui::{Color32, LayerId, Pos2, Rect, TextureId, Ui, Vec2};
use glam::UVec2;
use trisplat_gpu::Gpu;
use trisplat_scene::Result;
use wgpu::*;

/// The format for the panel's renderer: encoded colours.
const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// The picture, and its name in the panel.
pub(super) struct Reduced {
    pub(super) id: TextureId,
    pub(super) view: TextureView,
    pub(super) attachments: Attachments,
}

impl Reduced {
    /// Of `size`, with one sample per pixel. Errors: no memory on the card.
    pub(super) fn new(gpu: &Gpu, panel: &mut egui_wgpu::Renderer, size: UVec2) -> Result<Self> {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
        let attachments = Attachments::new(gpu, size, FORMAT, 1)?;
        let view =
            texture(gpu, "reduced", size, FORMAT, 1, usage).create_view(&TextureViewDescriptor::default());
        gpu.check()?;
        let id = panel.register_native_texture(&gpu.device, &view, FilterMode::Linear);
        Ok(Self { id, view, attachments })
    }

    pub(super) fn size(&self) -> UVec2 {
        self.attachments.size
    }
}

/// Shows the picture in the whole window, behind everything.
pub(super) fn show(ui: &Ui, id: TextureId) {
    let all = ui.ctx().content_rect();
    let whole = Rect::from_min_size(Pos2::ZERO, Vec2::splat(1.0));
    ui.ctx().layer_painter(LayerId::background()).image(id, all, whole, Color32::WHITE);
}
