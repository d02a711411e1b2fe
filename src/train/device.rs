//! Where a run trains and soft pictures are drawn: on the CPU or on a graphics card.

use super::backend::{RunSize, TrainBackend};
use super::cpu::CpuBackend;
use crate::error::{Error, Result};
use crate::raster::soft::SoftOptions;

/// Where a run trains.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum BackendKind {
    /// On a graphics card if there is a real one, else on the CPU.
    #[default]
    Auto,
    /// On all cores of the CPU.
    Cpu,
    /// On a graphics card, or on a software renderer if there is nothing else.
    Gpu,
}

/// Where a run trains and soft pictures are drawn, and on which graphics card.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct BackendOptions {
    /// Where soft triangles are trained and drawn.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub backend: BackendKind,
    /// Which graphics card.
    #[cfg(feature = "gpu")]
    #[cfg_attr(feature = "cli", command(flatten))]
    pub adapter: crate::gpu::AdapterOptions,
}

/// A backend that is ready for a scene.
pub struct OpenBackend {
    /// The backend.
    pub backend: Box<dyn TrainBackend>,
    /// Card, graphics API and driver, and the memory it will take; `None` on the CPU.
    pub card: Option<String>,
    /// What the user should know: why the card is not used, or that it is none.
    pub warnings: Vec<String>,
}

impl OpenBackend {
    fn cpu(drawing: SoftOptions, warnings: Vec<String>) -> Self {
        Self { backend: Box::new(CpuBackend::new(drawing)), card: None, warnings }
    }
}

impl BackendOptions {
    /// Where a run with a budget trains: on the CPU, as its plan is made of steps that were timed there.
    ///
    /// Errors: `gpu`.
    pub fn of_budget(&self) -> Result<Self> {
        match self.backend {
            BackendKind::Auto | BackendKind::Cpu => {
                let mut on_cpu = self.clone();
                on_cpu.backend = BackendKind::Cpu;
                Ok(on_cpu)
            }
            BackendKind::Gpu => Err(Error::invalid(
                "backend",
                "gpu",
                "auto or cpu with a budget, which is planned by steps timed on the CPU; or `steps` in place of the budget",
            )),
        }
    }
}

/// A card that is to be used, and what the user should know: why none is, or that it is none.
#[cfg(feature = "gpu")]
pub struct OpenCard {
    /// The card; `None`: the CPU.
    pub gpu: Option<crate::gpu::Gpu>,
    /// One sentence each.
    pub warnings: Vec<String>,
}

#[cfg(not(feature = "gpu"))]
impl BackendOptions {
    /// Opens the backend of a run that draws with `drawing`.
    ///
    /// Errors: `gpu`, which this build lacks.
    pub fn open(&self, drawing: SoftOptions, _size: RunSize) -> Result<OpenBackend> {
        self.check().map(|()| OpenBackend::cpu(drawing, Vec::new()))
    }

    /// An error of `gpu`, which this build lacks.
    pub fn check(&self) -> Result<()> {
        match self.backend {
            BackendKind::Auto | BackendKind::Cpu => Ok(()),
            BackendKind::Gpu => Err(Error::invalid(
                "backend",
                "gpu",
                "auto or cpu; this build has no graphics card in it, one with the feature `gpu` has \
                 (cargo install --path . --features gpu, in the folder of its sources)",
            )),
        }
    }
}

#[cfg(feature = "gpu")]
impl BackendOptions {
    /// Opens the backend of a run that draws with `drawing`.
    ///
    /// Errors: `gpu` where there is no card as asked for, or where it cannot be opened.
    pub fn open(&self, drawing: SoftOptions, size: RunSize) -> Result<OpenBackend> {
        let OpenCard { gpu, mut warnings } = self.open_card()?;
        let Some(gpu) = gpu else { return Ok(OpenBackend::cpu(drawing, warnings)) };
        match (self::gpu(gpu, drawing, size), self.backend) {
            (Ok((backend, card)), _) => Ok(OpenBackend { backend, card: Some(card), warnings }),
            (Err(error), BackendKind::Auto) => {
                warnings.push(on_the_cpu(&error));
                Ok(OpenBackend::cpu(drawing, warnings))
            }
            (Err(error), _) => Err(error),
        }
    }

    /// The card, if one is to be used.
    ///
    /// Errors: `gpu` where there is no card as asked for, or where it cannot be opened.
    pub fn open_card(&self) -> Result<OpenCard> {
        use crate::gpu::Gpu;
        let (gpu, mut warnings) = match self.backend {
            BackendKind::Cpu => (None, Vec::new()),
            BackendKind::Gpu => (Some(Gpu::headless(&self.adapter)?), Vec::new()),
            BackendKind::Auto => match self.adapter.find_real().map(|adapter| Gpu::open(&adapter)) {
                None => (None, Vec::new()),
                Some(Ok(gpu)) => (Some(gpu), Vec::new()),
                Some(Err(error)) => (None, vec![on_the_cpu(&error)]),
            },
        };
        warnings.extend(gpu.iter().filter(|gpu| gpu.is_software()).map(|gpu| {
            format!("{} is no graphics card but software, slower than the CPU (`backend` cpu)", gpu.info.name)
        }));
        Ok(OpenCard { gpu, warnings })
    }
}

/// What is said where a card is not used because of an error.
#[cfg(feature = "gpu")]
pub fn on_the_cpu(error: &Error) -> String {
    format!("{error}; going on on the CPU (`backend`)")
}

/// The backend on an open card, and what it is.
#[cfg(feature = "gpu")]
fn gpu(gpu: crate::gpu::Gpu, drawing: SoftOptions, size: RunSize) -> Result<(Box<dyn TrainBackend>, String)> {
    let limits = super::gpu::GpuLimits::of(&gpu);
    let megabytes = super::gpu::expected_bytes(&size, &limits) / 1_000_000;
    let card = format!("{}, about {megabytes} MB of its memory", gpu.describe());
    Ok((Box::new(super::gpu::GpuBackend::with_limits(gpu, drawing, limits)?), card))
}
