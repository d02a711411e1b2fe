//! Everything of one step that is not the scene or the photo, as the passes read it.

use super::limits::{COUNTS, Count, GROUP};
use crate::backend::{StepPhoto, StepStats};
use crate::params::Anneal;
use crate::schedule::StepParams;
use bytemuck::{Pod, Zeroable};
use glam::{UVec2, Vec3};
use trisplat_gpu::Gpu;
use trisplat_gpu::readback::Readback;
use trisplat_raster::kernel::Rate;
use trisplat_raster::kernel::loss::Photometric;
use trisplat_raster::soft::{SoftOptions, Sort, Window, tile_count};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::linear_from_srgb;
use wgpu::{Buffer, CommandEncoder};

/// Numbers of a slot: gradients of a splat summed over the pixels of a tile, and its weights.
pub(super) const SLOT_NUMBERS: u32 = 18;
/// The same, with gradients by the depth plane.
pub(super) const GEOMETRY_SLOT_NUMBERS: u32 = 24;

/// The twin of `Step` in `passes/step.wgsl`, which explains the numbers.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct StepUniform {
    rotation: [[f32; 4]; 3],
    position: [f32; 4],
    lens: [f32; 4],
    frame: [u32; 4],
    limits: [f32; 4],
    edges: [f32; 4],
    modes: [u32; 4],
    background: [f32; 4],
    scene: [u32; 4],
    anneal: [f32; 4],
    rates: [f32; 4],
    update: [f32; 4],
    regularisers: [f32; 4],
    loss: [f32; 4],
    depths: [f32; 4],
    parts: [u32; 4],
}

/// A step's drawing, and its sizes.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepPlan {
    /// Drawing of the scene.
    pub(super) options: SoftOptions,
    /// The photo's camera.
    pub(super) camera: Camera,
    /// Tiles across and down.
    pub(super) tiles: UVec2,
}

impl StepPlan {
    /// A step of `rates` on `photo`, drawn with `options`.
    pub(super) fn new(photo: &StepPhoto<'_>, rates: &StepParams, options: &SoftOptions) -> Self {
        let mut options = rates.drawing(options);
        options.geometry = rates.beta_normal > 0.0 || rates.beta_distortion > 0.0;
        Self { options, camera: *photo.camera, tiles: tile_count(photo.camera.size) }
    }

    /// A picture without a photo to compare with.
    pub(super) fn of_picture(camera: &Camera, options: &SoftOptions) -> Self {
        let options = SoftOptions { geometry: false, ..*options };
        Self { options, camera: *camera, tiles: tile_count(camera.size) }
    }

    /// Pixels of the photo and of the frame.
    pub(super) fn pixels(&self) -> u32 {
        self.camera.size.element_product()
    }

    /// True when every pixel has its own order.
    pub(super) fn by_pixel(&self) -> bool {
        self.options.sort == Sort::Pixel
    }

    /// The window's number in `passes/step.wgsl`.
    pub(super) fn window(&self) -> u32 {
        match self.options.window {
            Window::Soft => 0,
            Window::Coverage { .. } => 1,
        }
    }

    /// Constants of the passes over tiles.
    pub(super) fn constants(&self) -> String {
        let window = self.window();
        let geometry = self.options.geometry;
        let vectors = self.slot_numbers() / 2;
        format!(
            "const WINDOW: u32 = {window}u;\nconst GEOMETRY: bool = {geometry};\nconst SLOT_VECTORS: u32 = {vectors}u;\n"
        )
    }

    /// Numbers of a slot.
    pub(super) fn slot_numbers(&self) -> u32 {
        if self.options.geometry { GEOMETRY_SLOT_NUMBERS } else { SLOT_NUMBERS }
    }
}

/// The meaning of a scene's numbers for drawing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// The map from raw numbers to opacity and σ; `None`: the numbers are physical.
    pub(super) anneal: Option<Anneal>,
    /// Frozen triangles are drawn without a window.
    pub(super) frozen_flat: bool,
    /// Degree of the colour in use.
    pub(super) sh_degree: u8,
}

impl Look {
    /// The look of a step.
    pub(super) fn of(rates: &StepParams) -> Self {
        Self {
            anneal: Some(rates.anneal),
            frozen_flat: rates.engine_shading,
            sh_degree: rates.sh_degree,
        }
    }
}

/// The scene of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct SceneShape {
    pub(super) triangles: u32,
    pub(super) pinned: u32,
    pub(super) frozen: u32,
    pub(super) sh_degree: u8,
    /// Triangles of a chunk; the last may have fewer.
    pub(super) chunk: u32,
}

impl StepUniform {
    pub(super) fn new(
        plan: &StepPlan,
        photo: &StepPhoto<'_>,
        rates: &StepParams,
        scene: SceneShape,
    ) -> Self {
        let rate = |rate: f64| Rate::new(rate, rates.time);
        let flag = |is: bool| f32::from(u8::from(is));
        let drawn = Self::of_picture(plan, &Look::of(rates), scene);
        Self {
            rates: [rates.corners, rates.opacity, rates.sigma, rates.sh].map(|r| rate(r).step),
            update: [
                rate(rates.sh_rest).step,
                rate(1.0).second,
                flag(rates.sparse),
                flag(photo.first),
            ],
            regularisers: regularisers(rates, scene),
            loss: loss(rates, plan),
            ..drawn
        }
    }

    /// For only the passes up to the frame.
    pub(super) fn of_picture(plan: &StepPlan, look: &Look, scene: SceneShape) -> Self {
        let options = &plan.options;
        let camera = &plan.camera;
        let column = |k: usize| camera.rotation.col(k).extend(camera.translation[k]).to_array();
        let width = if let Window::Coverage { width_px } = options.window { width_px } else { 1.0 };
        let decode = |c: f32| if options.linear { linear_from_srgb(c) } else { c };
        let degree = u32::from(look.sh_degree.min(scene.sh_degree));
        let stored = (u32::from(scene.sh_degree) + 1).pow(2);
        let anneal = look.anneal.unwrap_or(Anneal::NONE);
        let [near, far] = options.depth_range;
        let flag = |is: bool| f32::from(u8::from(is));
        let size = camera.size;
        let [fx, fy] = camera.focal.to_array();
        let [cx, cy] = camera.center.to_array();
        Self {
            rotation: [0, 1, 2].map(column),
            position: camera.position().extend(options.near).to_array(),
            lens: [fx, fy, cx, cy],
            frame: [size.x, size.y, plan.tiles.x, plan.tiles.y],
            limits: [
                options.cutoff,
                options.cutoff.log2(),
                options.alpha_cap,
                options.min_transmittance,
            ],
            edges: [options.fade_px, options.min_ratio, width, flag(options.linear)],
            modes: [
                plan.window(),
                u32::from(plan.by_pixel()),
                u32::from(options.geometry),
                plan.slot_numbers(),
            ],
            background: Vec3::from(options.background.map(decode)).extend(0.0).to_array(),
            scene: [scene.triangles, stored, degree, scene.pinned],
            anneal: [
                anneal.opacity_floor,
                anneal.opacity_gain,
                anneal.sigma_scale,
                flag(look.anneal.is_none()),
            ],
            rates: [0.0; 4],
            update: [0.0; 4],
            regularisers: [0.0; 4],
            loss: [0.0; 4],
            depths: [far / (far - near), far * near / (far - near), 0.0, 0.0],
            parts: [scene.frozen, u32::from(look.frozen_flat), scene.chunk, 0],
        }
    }

    /// Number of pairs per binding of slots.
    pub(super) fn set_slot_pairs(&mut self, pairs: u32) {
        self.parts[3] = pairs;
    }
}

/// Weights of the means over the scene; pinned triangles do not count.
fn regularisers(rates: &StepParams, scene: SceneShape) -> [f32; 4] {
    let trained = f64::from((scene.triangles - scene.pinned).max(1));
    [rates.beta_opacity, rates.beta_size, 0.0, 0.0].map(|weight| (weight / trained) as f32)
}

/// Weights of the means over the pixels.
fn loss(rates: &StepParams, plan: &StepPlan) -> [f32; 4] {
    let values = 3.0 * f64::from(plan.pixels());
    let pixels = f64::from(plan.pixels()).max(1.0);
    [
        (1.0 - rates.dssim) / values,
        -rates.dssim / values,
        rates.beta_distortion / pixels,
        rates.beta_normal / pixels,
    ]
    .map(|scale| scale as f32)
}

/// Everything to make a step, once or repeatedly.
#[derive(Debug)]
pub(super) struct PendingStep {
    pub(super) plan: StepPlan,
    pub(super) step: StepUniform,
    /// The counts before the first pass.
    pub(super) counts: [u32; COUNTS],
    pub(super) photo: PhotoSource,
    /// Means over the scene are needed.
    pub(super) regularised: bool,
    /// Reads back the counts after the last pass.
    pub(super) readback: Readback,
    pub(super) dssim: f64,
}

impl PendingStep {
    /// Its figures, from the counts after the last pass.
    pub(super) fn stats(&self, counts: &[u32]) -> StepStats {
        let sum = |count: Count| f64::from(f32::from_bits(counts[count as usize]));
        let values = 3.0 * f64::from(self.plan.pixels().max(1));
        let means = Photometric {
            l1: sum(Count::LossL1) / values,
            ssim: sum(Count::LossSsim) / values,
            mse: sum(Count::LossMse) / values,
        };
        StepStats {
            loss: means.value(self.dssim) + sum(Count::LossGeometry),
            mse: means.mse,
            dropped: counts[Count::Dropped as usize].into(),
            touched: counts[Count::Touched as usize].into(),
        }
    }
}

/// The counts before the first pass.
pub(super) fn first_counts(plan: &StepPlan, shape: SceneShape) -> [u32; COUNTS] {
    let mut counts = [0u32; COUNTS];
    for (count, value) in [
        (Count::Triangles1, shape.triangles + 1),
        (Count::Pixels1, plan.pixels() + 1),
        (Count::PhotoTiles, plan.tiles.element_product()),
        (Count::SceneGroups, shape.triangles.div_ceil(GROUP)),
        (Count::FrameGroups, plan.pixels().div_ceil(GROUP)),
    ] {
        counts[count as usize] = value;
    }
    counts
}

/// A photo of a step: a pixel's colour and weight in 8 bits each, lowest first.
#[derive(Debug)]
pub(super) enum PhotoSource {
    /// On the card.
    Held(Buffer),
    /// In main memory.
    Packed(Vec<u32>),
}

impl PhotoSource {
    /// Copies it to `to`, before all later recorded passes.
    pub(super) fn copy(&self, gpu: &Gpu, encoder: &mut CommandEncoder, to: &Buffer) {
        match self {
            Self::Held(buffer) => encoder.copy_buffer_to_buffer(buffer, 0, to, 0, buffer.size()),
            Self::Packed(pixels) => gpu.queue.write_buffer(to, 0, bytemuck::cast_slice(pixels)),
        }
    }
}
