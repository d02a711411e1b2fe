//! The device of a run: the CPU, or a graphics card where there is one.

use super::backend::{RunSize, TrainBackend};
use super::cpu::CpuBackend;
#[cfg(feature = "gpu")]
use trisplat_gpu::Gpu;
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::{Error, Result};

/// The device of a training.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum BackendKind {
    /// On a graphics card if there is a real one, else on the CPU.
    #[default]
    Auto,
    /// On all cores of the CPU.
    Cpu,
    /// On a graphics card, or on a software renderer without one.
    Gpu,
}

/// The device for training and for soft pictures, and the choice of graphics card.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct BackendOptions {
    /// The device that trains and draws soft triangles.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    #[cfg_attr(
        all(feature = "cli", not(feature = "gpu")),
        arg(help = "The device that trains and draws soft triangles; `gpu` is not in this build")
    )]
    pub backend: BackendKind,
    /// Choice of the graphics card.
    #[cfg(feature = "gpu")]
    #[cfg_attr(feature = "cli", command(flatten))]
    pub adapter: trisplat_gpu::AdapterOptions,
}

/// A backend; its card, graphics API, driver and needed memory, `None` on the CPU; notes for the
/// user: the reason why the card is not used, or that it is a software renderer.
type OpenedBackend = (Box<dyn TrainBackend>, Option<String>, Vec<String>);

impl BackendOptions {
    /// The device of a run with a budget: the CPU, because its plan comes from steps timed there.
    ///
    /// # Errors
    ///
    /// `gpu`.
    pub fn of_budget(&self) -> Result<Self> {
        if self.backend == BackendKind::Gpu {
            let wants = "auto or cpu with a budget, because steps timed on the CPU plan it; or `steps` instead of the budget";
            return Err(Error::invalid("backend", "gpu", wants));
        }
        let mut cpu = self.clone();
        cpu.backend = BackendKind::Cpu;
        Ok(cpu)
    }

    /// Checks the options of a build without the feature `gpu`.
    ///
    /// # Errors
    ///
    /// `gpu`, which this build lacks.
    pub fn check(&self) -> Result<()> {
        match self.backend {
            BackendKind::Auto | BackendKind::Cpu => Ok(()),
            BackendKind::Gpu => Err(Error::invalid(
                "backend",
                "gpu",
                "auto or cpu; this build lacks the feature `gpu` \
                 (cargo install --path . --features gpu, in the folder of its sources)",
            )),
        }
    }
}

#[cfg(not(feature = "gpu"))]
impl BackendOptions {
    /// Opens the backend of a run that draws with `drawing`.
    ///
    /// # Errors
    ///
    /// `gpu`, which this build lacks.
    pub(super) fn open(&self, drawing: SoftOptions, _size: RunSize) -> Result<OpenedBackend> {
        self.check()?;
        Ok((Box::new(CpuBackend::new(drawing)), None, Vec::new()))
    }
}

#[cfg(feature = "gpu")]
impl BackendOptions {
    /// Opens the backend of a run that draws with `drawing`.
    ///
    /// # Errors
    ///
    /// `gpu` where there is no card as asked for, or where it cannot be opened.
    pub(super) fn open(&self, drawing: SoftOptions, size: RunSize) -> Result<OpenedBackend> {
        let (made, warnings) = self.with_card(|gpu| self::gpu(gpu, drawing, size))?;
        Ok(match made {
            Some((backend, card)) => (backend, Some(card), warnings),
            None => (Box::new(CpuBackend::new(drawing)), None, warnings),
        })
    }

    /// Builds a backend by `make` on the card, if one is used. Returns notes for the user too: the
    /// reason why none is used, or that it is a software renderer.
    ///
    /// # Errors
    ///
    /// `gpu` where there is no card as asked for, where it cannot be opened, or where nothing can
    /// be made of it.
    pub fn with_card<T>(
        &self,
        make: impl FnOnce(Gpu) -> Result<T>,
    ) -> Result<(Option<T>, Vec<String>)> {
        let opened = match self.backend {
            BackendKind::Cpu => return Ok((None, Vec::new())),
            BackendKind::Gpu => Gpu::headless(&self.adapter),
            BackendKind::Auto => match self.adapter.find_real() {
                None => return Ok((None, Vec::new())),
                Some(adapter) => Gpu::open(&adapter),
            },
        };
        let made = opened.and_then(|gpu| {
            let slow = gpu.is_software().then(|| {
                let name = &gpu.info.name;
                format!("{name} is not a graphics card but software, slower than the CPU (`backend` cpu)")
            });
            Ok((Some(make(gpu)?), slow.into_iter().collect()))
        });
        match (made, self.backend) {
            (Err(error), BackendKind::Auto) => {
                Ok((None, vec![format!("{error}; continuing on the CPU (`backend`)")]))
            }
            (made, _) => made,
        }
    }
}

/// The backend on an open card, and its description.
#[cfg(feature = "gpu")]
fn gpu(gpu: Gpu, drawing: SoftOptions, size: RunSize) -> Result<(Box<dyn TrainBackend>, String)> {
    let limits = super::gpu::GpuLimits::of(&gpu);
    let megabytes = super::gpu::expected_bytes(&size, &limits) / 1_000_000;
    let card = format!("{}, about {megabytes} MB of its memory", gpu.describe());
    Ok((Box::new(super::gpu::GpuBackend::new(gpu, drawing, limits)?), card))
}
