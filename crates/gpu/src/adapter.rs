//! Which graphics card draws.

use trisplat_scene::{Error, Result};
use wgpu::{Adapter, Backends, DeviceType, Instance, InstanceDescriptor, InstanceFlags, Surface};

/// The choice of graphics card and graphics API.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct AdapterOptions {
    /// Graphics API [default: the best available]
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "NAME"))]
    pub graphics_api: Option<GraphicsApi>,
    /// Use the graphics card whose name contains TEXT; case does not matter [default: the fastest kind]
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
    /// Errors: no adapter fits; the message names those that were found.
    pub fn choose(&self, instance: &Instance, surface: Option<&Surface<'_>>) -> Result<Adapter> {
        let mut found = pollster::block_on(instance.enumerate_adapters(Backends::all()));
        found.sort_by_key(rank);
        let names: Vec<String> = found.iter().map(describe).collect();
        let wanted = self.adapter.as_deref().unwrap_or_default().to_lowercase();
        let mut named: Vec<Adapter> =
            found.into_iter().filter(|a| a.get_info().name.to_lowercase().contains(&wanted)).collect();
        if named.is_empty() {
            return Err(match names.as_slice() {
                [] => Error::Gpu(nothing_found(self.graphics_api)),
                names => Error::invalid("adapter", &wanted, format!("part of one of: {}", names.join(", "))),
            });
        }
        if let Some(surface) = surface {
            named.retain(|a| a.is_surface_supported(surface));
        }
        named.into_iter().next().ok_or_else(|| {
            Error::Gpu(format!("none of {} can show pictures in a window here", names.join(", ")))
        })
    }
}

impl AdapterOptions {
    /// The best real card that fits the options: no software, and no OpenGL, whose compute shaders differ from driver
    /// to driver. Without a card it is silent.
    pub fn find_real(&self) -> Option<Adapter> {
        if !may_have_card() {
            return None;
        }
        let modern = Backends::VULKAN | Backends::METAL | Backends::DX12;
        let mut descriptor = InstanceDescriptor::new_without_display_handle().with_env();
        descriptor.flags.remove(InstanceFlags::VALIDATION_INDIRECT_CALL);
        descriptor.backends = self.graphics_api.map_or(descriptor.backends, GraphicsApi::backends) & modern;
        let backends = descriptor.backends;
        let wanted = self.adapter.as_deref().unwrap_or_default().to_lowercase();
        let found = pollster::block_on(Instance::new(descriptor).enumerate_adapters(backends));
        found
            .into_iter()
            .filter(|adapter| is_real(adapter.get_info().device_type))
            .filter(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted))
            .min_by_key(rank)
    }
}

/// False if there can be no card. Then no driver is loaded, because loading takes time and, without a
/// desktop, prints messages of Mesa's layers. On Linux a card has a file of its kernel driver: Mesa's,
/// NVIDIA's, WSL's, Tegra's, Arm's or Qualcomm's.
fn may_have_card() -> bool {
    let files = ["dri", "nvidia0", "nvidiactl", "dxg", "nvhost-gpu", "mali0", "kgsl-3d0"];
    !cfg!(target_os = "linux") || files.iter().any(|file| std::path::Path::new("/dev").join(file).exists())
}

fn is_real(kind: DeviceType) -> bool {
    matches!(kind, DeviceType::DiscreteGpu | DeviceType::IntegratedGpu | DeviceType::VirtualGpu)
}

fn nothing_found(api: Option<GraphicsApi>) -> String {
    let asked = match api {
        Some(api) => format!("no graphics card answers through {api:?}; try another `graphics_api`, or"),
        None => "no graphics card answers;".to_owned(),
    };
    format!("{asked} install its driver, or Mesa's software Vulkan (Debian: mesa-vulkan-drivers)")
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
