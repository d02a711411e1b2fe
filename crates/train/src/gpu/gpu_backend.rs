//! The backend of a training scene on a graphics card.

use super::limits::{COUNTS, REMEDY};
use super::passes::{Passes, Variants};
use super::scene::{GpuPhotos, SceneBuffers, VISIBILITY_NUMBERS, VisibilityBuffer, row_count};
use super::sequence::{BindGroups, GROUPS, Jobs, Sequence, self_test};
use super::step_buffers::{GpuLimits, SLOT_PARTS, StepBuffers, StepCapacity, missing_capacity};
use super::step_passes::StepPasses;
use super::uniform::{
    GEOMETRY_SLOT_NUMBERS, Look, PendingStep, StepPlan, StepUniform, first_counts,
};
use crate::backend::{BackendVisibility, RunSize, StepPhoto, StepStats, TrainBackend};
use crate::params::{OptimizerState, Params};
use crate::schedule::StepParams;
use std::borrow::Cow;
use std::collections::VecDeque;
use trisplat_gpu::readback::{Readback, elements};
use trisplat_gpu::{Gpu, storage, uniform};
use trisplat_raster::soft::{Frame, SoftOptions};
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, Result, sh_count};
use wgpu::{Buffer, CommandEncoder};

/// Storage buffers that one pass binds.
const STORAGE_BUFFERS: u32 = 14;

/// A training scene on a graphics card.
///
/// Steps are recorded without waiting for earlier ones; their figures are read some steps later. A
/// step that does not fit its buffers changes nothing, nor do the steps after it: all are repeated
/// in order with larger buffers.
#[derive(Debug)]
pub struct GpuBackend {
    gpu: Gpu,
    limits: GpuLimits,
    options: SoftOptions,
    passes: Passes,
    variants: Variants,
    jobs: Jobs,
    bind_groups: BindGroups,
    step: Buffer,
    counts: Buffer,
    groups: Buffer,
    /// Not 0: a step did not fit its buffers.
    halted: Buffer,
    scene: Option<SceneBuffers>,
    visibility: Option<VisibilityBuffer>,
    buffers: Option<StepBuffers>,
    photos: GpuPhotos,
    /// Steps under way, the oldest first.
    pending_steps: VecDeque<PendingStep>,
    /// Readbacks of steps that are done.
    spare: Vec<Readback>,
    figures: Vec<StepStats>,
    repeats: u64,
    /// The last loaded state, which survives the loss of the card.
    loaded: Option<OptimizerState>,
    /// Reason why begun steps never finish.
    failure: Option<String>,
}

impl GpuBackend {
    /// A backend without a scene, on an open card; draws with `options`, within `limits`.
    ///
    /// # Errors
    ///
    /// The card or its driver cannot run the passes, or computes something wrong.
    pub fn new(gpu: Gpu, options: SoftOptions, limits: GpuLimits) -> Result<Self> {
        let max_buffers = gpu.device.limits().max_storage_buffers_per_shader_stage;
        if max_buffers < STORAGE_BUFFERS {
            let name = &gpu.info.name;
            let what = format!(
                "{name} binds {max_buffers} buffers at once, training needs {STORAGE_BUFFERS}"
            );
            return Err(Error::Gpu(format!("{what}; train on the CPU (`backend` cpu)")));
        }
        let small = |what, numbers: usize| storage(&gpu, what, 4 * numbers as u64, REMEDY);
        let passes = Passes::new(&gpu)?;
        let jobs = Jobs::new(&gpu)?;
        self_test(&gpu, &passes, &jobs)?;
        Ok(Self {
            passes,
            variants: Variants::default(),
            jobs,
            bind_groups: BindGroups::default(),
            step: uniform(&gpu, "step", size_of::<StepUniform>() as u64),
            counts: small("counts", COUNTS)?,
            groups: small("workgroups", 3 * GROUPS)?,
            halted: small("halted", 1)?,
            scene: None,
            visibility: None,
            buffers: None,
            photos: GpuPhotos::new(limits.photo_bytes),
            pending_steps: VecDeque::new(),
            spare: Vec::new(),
            figures: Vec::new(),
            repeats: 0,
            loaded: None,
            failure: None,
            limits,
            options,
            gpu,
        })
    }

    /// Forgets the scene, its visibility and its photos; draws with `options` from now on, within
    /// `limits`.
    pub fn restart(&mut self, options: SoftOptions, limits: GpuLimits) {
        self.scene = None;
        self.visibility = None;
        self.options = options;
        self.limits = limits;
        self.buffers = None;
        self.photos = GpuPhotos::new(limits.photo_bytes);
        self.bind_groups.clear();
        self.pending_steps.clear();
        self.figures.clear();
        self.loaded = None;
        self.failure = None;
        self.clear_halt();
    }

    /// The card.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The memory that it may take of the card.
    pub fn limits(&self) -> GpuLimits {
        self.limits
    }

    /// Number of repeated steps, because one did not fit its buffers.
    pub fn repeats(&self) -> u64 {
        self.repeats
    }

    /// The scene.
    pub(super) fn scene(&self) -> Result<&SceneBuffers> {
        self.scene.as_ref().ok_or_else(|| Error::Gpu("a step without a scene".into()))
    }

    /// Has room for `needed`.
    pub(super) fn reserve(&mut self, needed: StepCapacity) -> Result<()> {
        if self.buffers.as_ref().is_some_and(|buffers| buffers.size.union(needed) == buffers.size) {
            return Ok(());
        }
        // Steps under way keep their buffers until they finish, and may need larger ones.
        self.settle_all()?;
        let size = match self.buffers.take() {
            Some(buffers) => buffers.size,
            None => StepCapacity {
                pairs: self.first_pairs(needed.triangles),
                binding_bytes: self.limits.binding_bytes,
                ..StepCapacity::default()
            },
        };
        // The old buffers are freed before the new ones are made.
        self.bind_groups.clear();
        let size = size.union(needed);
        let buffers = with_room(&self.gpu, &mut self.photos, |gpu| StepBuffers::new(gpu, size))?;
        self.buffers = Some(buffers);
        Ok(())
    }

    /// First capacity for pairs, at most what the card can bind.
    fn first_pairs(&self, triangles: u32) -> u32 {
        let GpuLimits { pairs_per_triangle, min_pairs, binding_bytes, .. } = self.limits;
        let max_pairs =
            u64::from(SLOT_PARTS) * (binding_bytes / (4 * u64::from(GEOMETRY_SLOT_NUMBERS)));
        triangles
            .saturating_mul(pairs_per_triangle)
            .max(min_pairs)
            .min(u32::try_from(max_pairs).unwrap_or(u32::MAX))
    }

    /// Submits a step to the card.
    fn launch(&mut self, mut pending: PendingStep) -> Result<()> {
        let mut encoder = self.begin(&mut pending.step, &pending.counts)?;
        pending.photo.copy(&self.gpu, &mut encoder, &self.buffers()?.photo);
        self.record(&pending.plan, pending.regularised, &mut encoder, |passes, to| {
            passes.record(to)
        })?;
        pending.readback.record(&mut encoder, &self.counts);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        pending.readback.submitted(submission);
        self.pending_steps.push_back(pending);
        self.gpu.check()
    }

    /// Uploads the inputs of passes before recording.
    pub(super) fn begin(
        &self,
        step: &mut StepUniform,
        counts: &[u32; COUNTS],
    ) -> Result<CommandEncoder> {
        step.set_slot_pairs(self.buffers()?.size.slot_pairs());
        let Gpu { queue, device, .. } = &self.gpu;
        queue.write_buffer(&self.step, 0, bytemuck::bytes_of(step));
        queue.write_buffer(&self.counts, 0, bytemuck::cast_slice(counts));
        Ok(device.create_command_encoder(&Default::default()))
    }

    /// Records the passes of a step that `what` selects.
    pub(super) fn record(
        &mut self,
        plan: &StepPlan,
        regularised: bool,
        encoder: &mut CommandEncoder,
        what: impl FnOnce(&StepPasses<'_>, &mut Sequence<'_>),
    ) -> Result<()> {
        let (Some(buffers), Some(visibility), Some(scene)) =
            (&self.buffers, &self.visibility, &self.scene)
        else {
            return Err(Error::Gpu("a step without buffers".into()));
        };
        let passes = StepPasses {
            passes: &self.passes,
            tile_passes: self.variants.of(&self.gpu, plan)?,
            scene,
            visibility,
            buffers,
            step: &self.step,
            counts: &self.counts,
            halted: &self.halted,
            plan,
            regularised,
        };
        let gpu = &self.gpu;
        let jobs = &self.jobs;
        let groups = &self.groups;
        let bind_groups = &mut self.bind_groups;
        what(&passes, &mut Sequence { gpu, bind_groups, jobs, groups, encoder, pass: None });
        Ok(())
    }

    /// Reads the counts after all submitted passes.
    pub(super) fn read_counts(&self) -> Result<Vec<u32>> {
        elements(&self.gpu, &self.counts, COUNTS)
    }

    /// All buffers of a step.
    pub(super) fn buffers(&self) -> Result<&StepBuffers> {
        self.buffers.as_ref().ok_or_else(|| Error::Gpu("a step without buffers".into()))
    }

    /// Takes the figures of the oldest step under way if it has finished, or with `wait` when it
    /// finishes; true when there was one. A step that did not fit is under way again.
    fn settle(&mut self, wait: bool) -> Result<bool> {
        let Some(pending) = self.pending_steps.front_mut() else { return Ok(false) };
        let counts = pending.readback.take::<u32>(&self.gpu, wait);
        let Some(counts) = self.keep_error(counts)? else { return Ok(false) };
        let pending = self.pending_steps.front();
        match missing_capacity(&counts) {
            Some(more) => {
                let repeated = self.repeat(more);
                self.keep_error(repeated)?;
            }
            None => {
                self.figures.extend(pending.map(|pending| pending.stats(&counts)));
                self.spare.extend(self.pending_steps.pop_front().map(|pending| pending.readback));
            }
        }
        Ok(true)
    }

    /// Waits for all steps under way.
    pub(super) fn settle_all(&mut self) -> Result<()> {
        self.check()?;
        while !self.pending_steps.is_empty() {
            self.settle(true)?;
        }
        Ok(())
    }

    /// An error when steps that were begun got lost.
    fn check(&self) -> Result<()> {
        self.failure.as_ref().map_or(Ok(()), |why| Err(Error::Gpu(why.clone())))
    }

    /// Keeps the error of a begun step or a failed upload: the state on the card is useless from
    /// then on.
    fn keep_error<T>(&mut self, outcome: Result<T>) -> Result<T> {
        if let Err(error) = &outcome {
            let why = match error {
                Error::Gpu(why) => why.clone(),
                other => other.to_string(),
            };
            self.failure.get_or_insert(why);
            self.pending_steps.clear();
        }
        outcome
    }

    /// Uploads the state in main memory to the card.
    fn load_again(&mut self) -> Result<()> {
        self.scene = None;
        self.bind_groups.clear();
        let Some(state) = &self.loaded else { return Ok(()) };
        let triangles = state.params.len();
        let binding_bytes = self.limits.binding_bytes;
        let scene = with_room(&self.gpu, &mut self.photos, |gpu| {
            SceneBuffers::load(gpu, state, binding_bytes)
        })?;
        self.scene = Some(scene);
        // A scene that returns unchanged keeps its visibility.
        if self.visibility.as_ref().is_none_or(|visibility| visibility.triangles != triangles) {
            self.visibility = Some(VisibilityBuffer::new(&self.gpu, triangles)?);
        }
        Ok(())
    }

    /// Repeats the steps under way, which changed nothing, with the capacity `more`.
    fn repeat(&mut self, more: StepCapacity) -> Result<()> {
        self.repeats += 1;
        let mut pending_steps = std::mem::take(&mut self.pending_steps);
        for later in pending_steps.iter_mut().skip(1) {
            later.readback.take::<u32>(&self.gpu, true)?;
        }
        self.reserve(more)?;
        self.clear_halt();
        pending_steps.into_iter().try_for_each(|pending| self.launch(pending))
    }

    /// Clears the halt that a pass sets when a buffer is too small: later steps run again.
    pub(super) fn clear_halt(&self) {
        self.gpu.queue.write_buffer(&self.halted, 0, &[0; 4]);
    }
}

impl TrainBackend for GpuBackend {
    fn load(&mut self, state: OptimizerState) -> Result<()> {
        let lost = self.check();
        self.loaded = Some(state);
        lost?;
        let loaded = self.load_again();
        self.keep_error(loaded)
    }

    fn store(&mut self) -> Result<OptimizerState> {
        self.settle_all()?;
        let state = self.scene()?.store(&self.gpu)?;
        self.scene = None;
        self.loaded = None;
        self.bind_groups.clear();
        Ok(state)
    }

    fn params(&mut self) -> Result<Cow<'_, Params>> {
        self.settle_all()?;
        Ok(Cow::Owned(self.scene()?.params(&self.gpu)?))
    }

    fn can_be_lost(&self) -> bool {
        true
    }

    fn rescued(&mut self) -> Option<OptimizerState> {
        self.loaded.take()
    }

    fn draws(&self) -> bool {
        true
    }

    fn picture(
        &mut self,
        camera: &Camera,
        drawing: &SoftOptions,
        rates: &StepParams,
    ) -> Result<Frame> {
        self.draw(camera, drawing, &Look::of(rates))
    }

    fn len(&self) -> usize {
        self.scene.as_ref().map_or(0, |scene| scene.shape.triangles as usize)
    }

    fn take_visibility(&mut self) -> Result<BackendVisibility> {
        self.settle_all()?;
        self.visibility
            .as_ref()
            .map_or_else(|| Ok(BackendVisibility::default()), |v| v.take(&self.gpu))
    }

    fn figures(&mut self, all: bool) -> Result<Vec<StepStats>> {
        self.check()?;
        while self.settle(all)? {}
        Ok(std::mem::take(&mut self.figures))
    }

    fn step(&mut self, photo: &StepPhoto<'_>, rates: &StepParams) -> Result<()> {
        self.check()?;
        let shape = self.scene()?.shape;
        let plan = StepPlan::new(photo, rates, &self.options);
        self.reserve(StepCapacity::of(&plan, shape.triangles, self.limits.near_plane_splats))?;
        let readback =
            self.spare.pop().unwrap_or_else(|| Readback::new(&self.gpu, 4 * COUNTS as u64));
        let source = self.photos.get(&self.gpu, photo);
        let launched = self.launch(PendingStep {
            step: StepUniform::new(&plan, photo, rates, shape),
            counts: first_counts(&plan, shape),
            photo: source,
            regularised: rates.beta_size > 0.0,
            readback,
            dssim: rates.dssim,
            plan,
        });
        self.keep_error(launched)?;
        while self.pending_steps.len() > self.limits.ahead {
            self.settle(true)?;
        }
        Ok(())
    }
}

/// Runs `make` on the card; without room again without the photos there, which only save time.
fn with_room<T>(gpu: &Gpu, photos: &mut GpuPhotos, make: impl Fn(&Gpu) -> Result<T>) -> Result<T> {
    match make(gpu) {
        Err(Error::Gpu(_)) if photos.give_up() => {
            gpu.wait(None)?;
            make(gpu)
        }
        made => made,
    }
}

/// Memory of a card with `limits` that a full-grown run takes, bytes.
pub(crate) fn expected_bytes(size: &RunSize, limits: &GpuLimits) -> u64 {
    let triangles = u32::try_from(size.triangles).unwrap_or(u32::MAX);
    let numbers = row_count(sh_count(size.sh_degree)) as u64;
    // Parameters, two moments, visibility.
    let scene = 4 * (3 * numbers + VISIBILITY_NUMBERS as u64) * u64::from(triangles);
    let photos = (4 * size.photo_pixels).min(limits.photo_bytes);
    let pairs = triangles.saturating_mul(limits.pairs_per_triangle).max(limits.min_pairs);
    let binding_bytes = limits.binding_bytes;
    let buffers = StepCapacity {
        pairs,
        binding_bytes,
        ..StepCapacity::new(triangles, limits.near_plane_splats, size.photo)
    };
    scene + photos + buffers.bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    #[test]
    fn three_million_triangles_take_three_and_a_half_gigabytes() {
        let limits = GpuLimits {
            ahead: 2,
            binding_bytes: (2 << 30) - 1,
            photo_bytes: 0,
            pairs_per_triangle: GpuLimits::PAIRS_PER_TRIANGLE,
            min_pairs: 0,
            near_plane_splats: 256,
        };
        let photo = UVec2::new(1600, 1000);
        let size = |triangles| RunSize { triangles, sh_degree: 3, photo, photo_pixels: 0 };
        let gigabytes = |triangles| expected_bytes(&size(triangles), &limits) as f64 * 1e-9;
        let three = gigabytes(3_000_000);
        let ten = gigabytes(10_000_000);
        assert!((3.45..3.6).contains(&three), "{three}");
        assert!((11.0..11.6).contains(&ten), "{ten}");
    }
}
