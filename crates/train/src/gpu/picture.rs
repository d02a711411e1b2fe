//! Draws a soup on the graphics card, with the passes of a training step up to the frame.

use super::gpu_backend::GpuBackend;
use super::step_buffers::{GpuLimits, StepCapacity, missing_capacity};
use super::uniform::{Look, SceneShape, StepPlan, StepUniform, first_counts};
use crate::backend::TrainBackend;
use crate::params::{OptimizerState, Params};
use trisplat_gpu::Gpu;
use trisplat_gpu::readback::elements;
use trisplat_raster::soft::{Frame, SoftOptions};
use trisplat_scene::camera::Camera;
use trisplat_scene::{Result, Soup};

/// A soup on a graphics card, for drawing.
#[derive(Debug)]
pub struct CardScene {
    backend: GpuBackend,
    look: Look,
}

impl CardScene {
    /// Moves `soup`, in training space, to an open card.
    ///
    /// # Errors
    ///
    /// The card or its driver cannot run the passes, or lacks memory.
    pub fn new(gpu: Gpu, soup: &Soup) -> Result<Self> {
        let limits = GpuLimits::of(&gpu);
        Self::with_limits(gpu, soup, limits)
    }

    /// As [`CardScene::new`], within `limits`.
    pub fn with_limits(gpu: Gpu, soup: &Soup, limits: GpuLimits) -> Result<Self> {
        let Soup { vertices, opacity, sigma, sh, sh_degree, .. } = soup.clone();
        let look = Look { anneal: None, frozen_flat: false, sh_degree };
        let params = Params { vertices, opacity, sigma, sh, sh_degree };
        let mut backend = GpuBackend::new(gpu, SoftOptions::default(), limits)?;
        backend.load(OptimizerState { params, ..OptimizerState::default() })?;
        Ok(Self { backend, look })
    }

    /// The card.
    pub fn gpu(&self) -> &Gpu {
        self.backend.gpu()
    }

    /// The view of `camera`, as
    /// [`SoftRasterizer::render`](trisplat_raster::soft::SoftRasterizer::render) draws it: colour
    /// and transmittance.
    ///
    /// # Errors
    ///
    /// The card is lost, or lacks memory.
    pub fn frame(&mut self, camera: &Camera, options: &SoftOptions) -> Result<Frame> {
        self.backend.draw(camera, options, &self.look)
    }
}

impl GpuBackend {
    /// The view of `camera`, in training space: colour and transmittance. Waits for the card.
    pub(super) fn draw(
        &mut self,
        camera: &Camera,
        options: &SoftOptions,
        look: &Look,
    ) -> Result<Frame> {
        self.settle_all()?;
        let shape = self.scene()?.shape;
        let plan = StepPlan::of_picture(camera, options);
        let mut needed =
            StepCapacity::of_picture(&plan, shape.triangles, self.limits().near_plane_splats);
        loop {
            self.reserve(needed)?;
            let counts = self.submit_picture(&plan, look, shape)?;
            match missing_capacity(&counts) {
                Some(more) => needed = needed.union(more),
                None => break,
            }
            self.clear_halt();
        }
        let pixels: Vec<[f32; 4]> =
            elements(self.gpu(), &self.buffers()?.frame, plan.pixels() as usize)?;
        Ok(Frame {
            size: camera.size,
            rgb: pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            transmittance: pixels.iter().map(|&[.., t]| t).collect(),
            ..Frame::default()
        })
    }

    /// Draws into the frame of the step buffers; returns the counts, which tell whether it fitted.
    fn submit_picture(
        &mut self,
        plan: &StepPlan,
        look: &Look,
        shape: SceneShape,
    ) -> Result<Vec<u32>> {
        let mut step = StepUniform::of_picture(plan, look, shape);
        let mut encoder = self.begin(&mut step, &first_counts(plan, shape))?;
        let regularised = false;
        self.record(plan, regularised, &mut encoder, |passes, to| passes.draw(to))?;
        self.gpu().queue.submit([encoder.finish()]);
        self.read_counts()
    }
}
