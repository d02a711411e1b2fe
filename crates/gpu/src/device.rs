//! An open graphics card.

use super::adapter::AdapterOptions;
use std::sync::{Arc, Mutex, PoisonError};
use trisplat_scene::{Error, Result};
use wgpu::{
    Adapter, AdapterInfo, Device, DeviceDescriptor, Features, Limits, PollType, Queue, SubmissionIndex,
};

/// Features that are used if the card has them; none is required.
const OPTIONAL_FEATURES: Features = Features::TIMESTAMP_QUERY.union(Features::POLYGON_MODE_LINE);

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
    /// Errors: no such card, or it cannot be opened.
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
    /// Errors: the card's limits are below these.
    pub fn open_within(adapter: &Adapter, limits: Limits) -> Result<Self> {
        let info = adapter.get_info();
        let request = adapter.request_device(&DeviceDescriptor {
            label: Some("trisplat"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: limits,
            ..DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|e| Error::Gpu(format!("{} ({}) cannot be opened: {e}", info.name, info.backend)))?;
        let first_error = Arc::new(Mutex::new(None));
        let keep = |first: &Arc<Mutex<Option<String>>>| {
            let first = first.clone();
            move |what: String| {
                first.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(what);
            }
        };
        let (error, lost) = (keep(&first_error), keep(&first_error));
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
        let waited = self.device.poll(PollType::Wait { submission_index: submission, timeout: None });
        if waited.is_err() {
            // A lost device reports it when polled, and has no submissions after that.
            let _ = self.device.poll(PollType::Poll);
        }
        self.check()?;
        waited.map(drop).map_err(|e| Error::Gpu(format!("{}: {e}", self.info.name)))
    }

    /// "llvmpipe (LLVM 15.0.6, 256 bits), vulkan, llvmpipe Mesa 22.3.6 (LLVM 15.0.6)": card, graphics API, driver.
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
