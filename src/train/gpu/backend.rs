//! The backend of a training scene on a graphics card.

use super::job::{COUNTS, Count, GROUPS, Jobs};
use super::passes::Passes;
use super::room::{Room, RoomSize};
use super::rows::row_count;
use super::scene::{REMEDY, SceneBuffers, VisibilityBuffer};
use super::sequence::Sequence;
use super::source::GROUP;
use super::step_passes::StepPasses;
use super::uniform::{StepPlan, StepUniform};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::readback::elements;
use crate::gpu::storage::{storage, uniform};
use crate::kernel::loss::Photometric;
use crate::raster::soft::{SoftOptions, tile_count};
use crate::train::backend::{BackendVisibility, RunSize, StepPhoto, StepStats, TrainBackend};
use crate::train::params::TrainState;
use crate::train::schedule::Rates;
use rayon::prelude::*;
use wgpu::Buffer;

/// Pairs there is room for at first, for each triangle and at least.
const FIRST_PAIRS: (u32, u32) = (4, 1 << 16);
/// Storage buffers that one pass binds.
const STORAGE_BUFFERS: u32 = 11;

/// A training scene on a graphics card.
#[derive(Debug)]
pub struct GpuBackend {
    gpu: Gpu,
    options: SoftOptions,
    passes: Passes,
    jobs: Jobs,
    step: Buffer,
    counts: Buffer,
    groups: Buffer,
    scene: Option<SceneBuffers>,
    visibility: Option<VisibilityBuffer>,
    room: Option<Room>,
    photo: Vec<u32>,
}

impl GpuBackend {
    /// Without a scene yet, on an open card; draws with `options`.
    ///
    /// Errors: the card or its driver cannot run the passes.
    pub fn new(gpu: Gpu, options: SoftOptions) -> Result<Self> {
        let limits = gpu.device.limits();
        if limits.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS {
            let (name, most) = (&gpu.info.name, limits.max_storage_buffers_per_shader_stage);
            let what = format!("{name} binds {most} buffers at once, training needs {STORAGE_BUFFERS}");
            return Err(Error::Gpu(format!("{what}; train on the CPU (`backend` cpu)")));
        }
        let small = |what, numbers: usize| storage(&gpu, what, 4 * numbers as u64, REMEDY);
        Ok(Self {
            passes: Passes::new(&gpu)?,
            jobs: Jobs::new(&gpu)?,
            step: uniform(&gpu, "step", size_of::<StepUniform>() as u64),
            counts: small("counts", COUNTS)?,
            groups: small("workgroups", 3 * GROUPS)?,
            scene: None,
            visibility: None,
            room: None,
            photo: Vec::new(),
            options,
            gpu,
        })
    }

    /// Forgets scene and visibility; draws with `options` from now on.
    pub fn restart(&mut self, options: SoftOptions) {
        (self.scene, self.visibility, self.options) = (None, None, options);
    }

    /// The card.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    fn scene(&self) -> Result<&SceneBuffers> {
        self.scene.as_ref().ok_or_else(|| Error::Gpu("a step without a scene".into()))
    }

    /// Makes room for a step, and for what an earlier try of it `wanted`.
    fn make_room(&mut self, plan: &StepPlan, wanted: RoomSize) -> Result<&Room> {
        let triangles = self.scene()?.shape.triangles;
        let needed = RoomSize::of(plan, triangles).union(wanted);
        let room = match self.room.take() {
            Some(room) if room.size.union(needed) == room.size => room,
            other => {
                let before = other.map_or_else(
                    || RoomSize { pairs: self.first_pairs(triangles), ..RoomSize::default() },
                    |room| room.size,
                );
                // What was there is gone before the new is made.
                Room::new(&self.gpu, before.union(needed))?
            }
        };
        Ok(self.room.insert(room))
    }

    /// Pairs there is room for at first: not more than the card can bind.
    fn first_pairs(&self, triangles: u32) -> u32 {
        let (each, least) = FIRST_PAIRS;
        let limit = self.gpu.device.limits().max_storage_buffer_binding_size;
        let most = limit / (4 * u64::from(super::uniform::GEOMETRY_SLOT_NUMBERS));
        triangles.saturating_mul(each).max(least).min(u32::try_from(most).unwrap_or(u32::MAX))
    }

    /// Moves photo, options and what is known of the counts to the card.
    fn upload(&mut self, photo: &StepPhoto<'_>, rates: &Rates, plan: &StepPlan) -> Result<()> {
        let shape = self.scene()?.shape;
        let step = StepUniform::new(plan, photo, rates, shape);
        let mut counts = [0u32; COUNTS];
        for (count, value) in [
            (Count::Triangles1, shape.triangles + 1),
            (Count::Pixels1, plan.frame_pixels() + 1),
            (Count::PhotoTiles, tile_count(plan.photo).element_product()),
            (Count::SceneGroups, shape.triangles.div_ceil(GROUP)),
            (Count::FrameGroups, plan.frame_pixels().div_ceil(GROUP)),
        ] {
            counts[count as usize] = value;
        }
        pack(photo, &mut self.photo);
        let queue = &self.gpu.queue;
        queue.write_buffer(&self.step, 0, bytemuck::bytes_of(&step));
        queue.write_buffer(&self.counts, 0, bytemuck::cast_slice(&counts));
        if let Some(room) = &self.room {
            queue.write_buffer(&room.photo, 0, bytemuck::cast_slice(&self.photo));
        }
        Ok(())
    }

    /// Runs all passes; returns the counts.
    fn run(&self, rates: &Rates, plan: &StepPlan) -> Result<Vec<u32>> {
        let (Some(room), Some(visibility)) = (&self.room, &self.visibility) else {
            return Err(Error::Gpu("a step without room".into()));
        };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let step = StepPasses {
            passes: &self.passes,
            scene: self.scene()?,
            visibility,
            room,
            step: &self.step,
            counts: &self.counts,
            plan,
            regularised: rates.beta_size > 0.0 || rates.beta_opaque > 0.0,
        };
        let pass = encoder.begin_compute_pass(&Default::default());
        step.record(&mut Sequence { gpu: &self.gpu, jobs: &self.jobs, groups: &self.groups, pass });
        self.gpu.queue.submit([encoder.finish()]);
        elements(&self.gpu, &self.counts, COUNTS)
    }
}

impl TrainBackend for GpuBackend {
    fn load(&mut self, state: TrainState) -> Result<()> {
        let triangles = state.params.len();
        self.scene = None;
        self.scene = Some(SceneBuffers::load(&self.gpu, &state)?);
        // A scene that comes back as it went has been seen as often as before.
        if self.visibility.as_ref().is_none_or(|visibility| visibility.triangles != triangles) {
            self.visibility = Some(VisibilityBuffer::new(&self.gpu, triangles)?);
        }
        Ok(())
    }

    fn store(&mut self) -> Result<TrainState> {
        let state = self.scene()?.store(&self.gpu)?;
        self.scene = None;
        Ok(state)
    }

    fn len(&self) -> usize {
        self.scene.as_ref().map_or(0, |scene| scene.shape.triangles as usize)
    }

    fn take_visibility(&mut self) -> Result<BackendVisibility> {
        self.visibility.as_ref().map_or_else(|| Ok(BackendVisibility::default()), |v| v.take(&self.gpu))
    }

    fn step(&mut self, photo: &StepPhoto<'_>, rates: &Rates) -> Result<StepStats> {
        let plan = StepPlan::new(photo, rates, &self.options);
        let mut wanted = RoomSize::default();
        loop {
            self.make_room(&plan, wanted)?;
            self.upload(photo, rates, &plan)?;
            let counts = self.run(rates, &plan)?;
            match more_room(&counts) {
                Some(more) => wanted = wanted.union(more),
                None => return Ok(stats(&counts, rates, &plan)),
            }
        }
    }
}

/// Memory that a run takes of the card when it has grown, bytes.
pub(in crate::train) fn expected_bytes(size: &RunSize) -> u64 {
    let triangles = u32::try_from(size.triangles).unwrap_or(u32::MAX);
    let numbers = row_count((usize::from(size.sh_degree) + 1).pow(2)) as u64;
    // Parameters and two moments.
    let scene = 3 * 4 * numbers * u64::from(triangles);
    let pairs = triangles.saturating_mul(FIRST_PAIRS.0).max(FIRST_PAIRS.1);
    scene + RoomSize { pairs, ..RoomSize::new(triangles, size.photo, size.photo) }.bytes()
}

/// The photo as the card reads it: a pixel's colour and weight in 8 bits each, lowest first.
fn pack(photo: &StepPhoto<'_>, out: &mut Vec<u32>) {
    let alpha = photo.pixels.alpha.as_deref();
    let pixel = |(i, &[r, g, b]): (usize, &[u8; 3])| {
        u32::from_le_bytes([r, g, b, alpha.map_or(u8::MAX, |alpha| alpha[i])])
    };
    photo.pixels.rgb.par_iter().with_min_len(4096).enumerate().map(pixel).collect_into_vec(out);
}

/// What a step wanted and had no room for, with some to spare.
fn more_room(counts: &[u32]) -> Option<RoomSize> {
    let wanted = |count: Count| {
        let n = counts[count as usize];
        n.saturating_add(n / 4)
    };
    let more = RoomSize {
        splats: wanted(Count::WantedSplats),
        pairs: wanted(Count::WantedPairs),
        layers: wanted(Count::WantedLayers),
        ..RoomSize::default()
    };
    (more != RoomSize::default()).then_some(more)
}

fn stats(counts: &[u32], rates: &Rates, plan: &StepPlan) -> StepStats {
    let sum = |count: Count| f64::from(f32::from_bits(counts[count as usize]));
    let values = 3.0 * f64::from(plan.photo_pixels().max(1));
    let means = Photometric {
        l1: sum(Count::LossL1) / values,
        ssim: sum(Count::LossSsim) / values,
        mse: sum(Count::LossMse) / values,
    };
    StepStats {
        loss: means.value(rates.dssim) + sum(Count::LossGeometry),
        mse: means.mse,
        dropped: counts[Count::Dropped as usize].into(),
        touched: counts[Count::Touched as usize].into(),
    }
}
