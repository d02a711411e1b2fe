//! Finds a graphics card and opens it.

use std::sync::{Arc, Mutex, PoisonError};
use trisplat_scene::{Error, Result};
use wgpu::{
    Adapter, AdapterInfo, Backends, Device, DeviceDescriptor, DeviceType, Features, Instance,
    InstanceDescriptor, InstanceFlags, Limits, PollType, Queue, SubmissionIndex, Surface,
};

/// The choice of graphics card and graphics API.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct AdapterOptions {
    /// Graphics API [default: the best available]
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "NAME"))]
    pub graphics_api: Option<GraphicsApi>,
    /// Use the graphics card whose name contains TEXT; case does not matter [default: the fastest
    /// kind]
    #[cfg_attr(feature = "cli", arg(long, value_name = "TEXT"))]
    pub adapter: Option<String>,
}

/// A graphics API.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum GraphicsApi {
    /// Vulkan: Linux, Windows, Android.
    Vulkan,
    /// Metal: macOS, iOS.
    Metal,
    /// Direct3D 12: Windows.
    Dx12,
    /// OpenGL (ES), as the last resort.
    Gl,
}

impl GraphicsApi {
    fn backends(self) -> Backends {
        match self {
            GraphicsApi::Vulkan => Backends::VULKAN,
            GraphicsApi::Metal => Backends::METAL,
            GraphicsApi::Dx12 => Backends::DX12,
            GraphicsApi::Gl => Backends::GL,
        }
    }
}

/// The graphics APIs in use, the preferred first.
const PREFERRED: [wgpu::Backend; 4] =
    [wgpu::Backend::Vulkan, wgpu::Backend::Metal, wgpu::Backend::Dx12, wgpu::Backend::Gl];

impl AdapterOptions {
    /// The entry to the drivers. `display` is that of the windows; without windows none is needed.
    pub fn instance(&self, display: Option<Box<dyn wgpu::wgt::WgpuHasDisplayHandle>>) -> Instance {
        let mut descriptor = InstanceDescriptor::new_without_display_handle();
        descriptor.display = display;
        // Otherwise it would check every indirect draw with a compute pass.
        descriptor.flags.remove(InstanceFlags::VALIDATION_INDIRECT_CALL);
        let mut descriptor = descriptor.with_env();
        if let Some(api) = self.graphics_api {
            descriptor.backends = api.backends();
        }
        Instance::new(descriptor)
    }

    /// The best adapter that fits the options; one that can present to `surface` when it is given.
    ///
    /// # Errors
    ///
    /// No adapter fits; the message names those that were found.
    pub fn choose(&self, instance: &Instance, surface: Option<&Surface<'_>>) -> Result<Adapter> {
        let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
        adapters.sort_by_key(rank);
        let names: Vec<String> = adapters.iter().map(describe).collect();
        let name_part = self.adapter.as_deref().unwrap_or_default().to_lowercase();
        let mut named: Vec<Adapter> = adapters
            .into_iter()
            .filter(|a| a.get_info().name.to_lowercase().contains(&name_part))
            .collect();
        if named.is_empty() {
            return Err(match names.as_slice() {
                [] => Error::Gpu(nothing_found(self.graphics_api)),
                names => Error::invalid(
                    "adapter",
                    &name_part,
                    format!("part of one of: {}", names.join(", ")),
                ),
            });
        }
        if let Some(surface) = surface {
            named.retain(|a| a.is_surface_supported(surface));
        }
        named.into_iter().next().ok_or_else(|| {
            Error::Gpu(format!("none of {} can show pictures in a window here", names.join(", ")))
        })
    }

    /// The best real card that fits the options: no software, and no OpenGL, whose compute shaders
    /// differ from driver to driver. Prints nothing without a card.
    pub fn find_real(&self) -> Option<Adapter> {
        if !may_have_card() {
            return None;
        }
        let modern = Backends::VULKAN | Backends::METAL | Backends::DX12;
        let mut descriptor = InstanceDescriptor::new_without_display_handle().with_env();
        descriptor.flags.remove(InstanceFlags::VALIDATION_INDIRECT_CALL);
        descriptor.backends =
            self.graphics_api.map_or(descriptor.backends, GraphicsApi::backends) & modern;
        let backends = descriptor.backends;
        let name_part = self.adapter.as_deref().unwrap_or_default().to_lowercase();
        let adapters = pollster::block_on(Instance::new(descriptor).enumerate_adapters(backends));
        adapters
            .into_iter()
            .filter(|adapter| is_real(adapter.get_info().device_type))
            .filter(|adapter| adapter.get_info().name.to_lowercase().contains(&name_part))
            .min_by_key(rank)
    }
}

/// False if there can be no card. Then no driver is loaded, because loading takes time and, without
/// a desktop, prints messages of Mesa's layers. On Linux a card has a file of its kernel driver:
/// Mesa's, NVIDIA's, WSL's, Tegra's, Arm's or Qualcomm's.
fn may_have_card() -> bool {
    let files = ["dri", "nvidia0", "nvidiactl", "dxg", "nvhost-gpu", "mali0", "kgsl-3d0"];
    !cfg!(target_os = "linux")
        || files.iter().any(|file| std::path::Path::new("/dev").join(file).exists())
}

fn is_real(kind: DeviceType) -> bool {
    matches!(kind, DeviceType::DiscreteGpu | DeviceType::IntegratedGpu | DeviceType::VirtualGpu)
}

fn nothing_found(api: Option<GraphicsApi>) -> String {
    let failure = match api {
        Some(api) => {
            format!("no graphics card answers through {api:?}; try another `graphics_api`, or")
        }
        None => "no graphics card answers;".to_owned(),
    };
    format!("{failure} install its driver, or Mesa's software Vulkan (Debian: mesa-vulkan-drivers)")
}

/// Rank of an adapter: hardware before software, then the preferred graphics API first.
fn rank(adapter: &Adapter) -> (u8, usize) {
    let info = adapter.get_info();
    let kind = match info.device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    };
    let backend = PREFERRED.iter().position(|&b| b == info.backend);
    (kind, backend.unwrap_or(PREFERRED.len()))
}

/// "llvmpipe (LLVM 15.0.6, 256 bits) (vulkan)".
fn describe(adapter: &Adapter) -> String {
    let info = adapter.get_info();
    format!("{} ({})", info.name, info.backend)
}

/// Optional features of a card.
const OPTIONAL_FEATURES: Features = Features::POLYGON_MODE_LINE;

/// An open graphics card. Its first error is kept until [`Gpu::check`] returns it.
#[derive(Debug)]
pub struct Gpu {
    /// Makes buffers, textures and pipelines.
    pub device: Device,
    /// Takes work.
    pub queue: Queue,
    /// Its name, driver and graphics API.
    pub info: AdapterInfo,
    /// The first error since the last check.
    first_error: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens a card without any window.
    ///
    /// # Errors
    ///
    /// No such card, or it cannot be opened.
    pub fn headless(options: &AdapterOptions) -> Result<Self> {
        let instance = options.instance(None);
        Self::open(&options.choose(&instance, None)?)
    }

    /// Opens `adapter` with its own limits.
    pub fn open(adapter: &Adapter) -> Result<Self> {
        Self::open_within(adapter, adapter.limits())
    }

    /// Opens `adapter` with no more than `limits`.
    ///
    /// # Errors
    ///
    /// The card's limits are below these.
    pub fn open_within(adapter: &Adapter, limits: Limits) -> Result<Self> {
        let info = adapter.get_info();
        let request = adapter.request_device(&DeviceDescriptor {
            label: Some("trisplat"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: limits,
            ..DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|e| {
            Error::Gpu(format!("{} ({}) cannot be opened: {e}", info.name, info.backend))
        })?;
        let first_error = Arc::new(Mutex::new(None));
        let keep = |first: &Arc<Mutex<Option<String>>>| {
            let first = first.clone();
            move |what: String| {
                first.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(what);
            }
        };
        let error = keep(&first_error);
        let lost = keep(&first_error);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| error(one_line(&e.to_string()))));
        device.set_device_lost_callback(move |reason, message| {
            let why = if message.is_empty() { format!("{reason:?}") } else { one_line(&message) };
            lost(format!("the graphics card was lost ({why})"));
        });
        Ok(Self { device, queue, info, first_error })
    }

    /// Any error since the last check: device lost, out of memory, validation.
    pub fn check(&self) -> Result<()> {
        match self.first_error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(what) => Err(Error::Gpu(format!("{}: {what}", self.info.name))),
            None => Ok(()),
        }
    }

    /// Waits until the work up to `submission`, or all work, is done; errors as [`Gpu::check`].
    pub fn wait(&self, submission: Option<SubmissionIndex>) -> Result<()> {
        let waited =
            self.device.poll(PollType::Wait { submission_index: submission, timeout: None });
        if waited.is_err() {
            // A lost device reports it when polled, and has no submissions after that.
            let _ = self.device.poll(PollType::Poll);
        }
        self.check()?;
        waited.map(drop).map_err(|e| Error::Gpu(format!("{}: {e}", self.info.name)))
    }

    /// "llvmpipe (LLVM 15.0.6, 256 bits), vulkan, llvmpipe Mesa 22.3.6 (LLVM 15.0.6)": card,
    /// graphics API, driver.
    pub fn describe(&self) -> String {
        let AdapterInfo { name, backend, driver, driver_info, .. } = &self.info;
        format!("{name}, {backend}, {driver} {driver_info}").trim_end().to_owned()
    }

    /// True for a software renderer on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
