//! An open graphics card.

use super::adapter::AdapterOptions;
use crate::error::{Error, Result};
use std::sync::{Arc, Mutex, PoisonError};
use wgpu::{Adapter, AdapterInfo, Device, DeviceDescriptor, Features, PollType, Queue, SubmissionIndex};

/// What we make use of where it is there; nothing here is needed.
const WELCOME: Features = Features::TIMESTAMP_QUERY.union(Features::POLYGON_MODE_LINE);

/// An open graphics card. What goes wrong on it is kept until [`Gpu::check`] is asked.
#[derive(Debug)]
pub struct Gpu {
    /// Makes buffers, textures and pipelines.
    pub device: Device,
    /// Takes work.
    pub queue: Queue,
    /// Its name, driver and backend.
    pub info: AdapterInfo,
    /// The first thing that went wrong since the last check.
    fault: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens a card without any window.
    ///
    /// Errors: there is none as asked for, or it cannot be opened.
    pub fn headless(options: &AdapterOptions) -> Result<Self> {
        let instance = options.instance(None);
        Self::open(&options.choose(&instance, None)?)
    }

    /// Opens `adapter` with all it can do.
    pub fn open(adapter: &Adapter) -> Result<Self> {
        let info = adapter.get_info();
        let request = adapter.request_device(&DeviceDescriptor {
            label: Some("trisplat"),
            required_features: adapter.features() & WELCOME,
            required_limits: adapter.limits(),
            ..DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|e| Error::Gpu(format!("{} ({}) cannot be opened: {e}", info.name, info.backend)))?;
        let fault = Arc::new(Mutex::new(None));
        let keep = |fault: &Arc<Mutex<Option<String>>>| {
            let fault = fault.clone();
            move |what: String| {
                fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(what);
            }
        };
        let (error, lost) = (keep(&fault), keep(&fault));
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| error(one_line(&e.to_string()))));
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                lost(format!("the graphics card was lost ({}); start again", one_line(&message)));
            }
        });
        Ok(Self { device, queue, info, fault })
    }

    /// An error when anything went wrong since the last check: lost, out of memory, refused.
    pub fn check(&self) -> Result<()> {
        match self.fault.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(what) => Err(Error::Gpu(format!("{}: {what}", self.info.name))),
            None => Ok(()),
        }
    }

    /// Waits until the work up to `submission` is done, or all of it; errors as [`Gpu::check`].
    pub fn wait(&self, submission: Option<SubmissionIndex>) -> Result<()> {
        let waited = self.device.poll(PollType::Wait { submission_index: submission, timeout: None });
        self.check()?;
        waited.map(drop).map_err(|e| Error::Gpu(format!("{}: {e}", self.info.name)))
    }

    /// "llvmpipe (LLVM 15.0.6, 256 bits), vulkan, llvmpipe Mesa 22.3.6 (LLVM 15.0.6)": card, interface, driver.
    pub fn describe(&self) -> String {
        let AdapterInfo { name, backend, driver, driver_info, .. } = &self.info;
        format!("{name}, {backend}, {driver} {driver_info}").trim_end().to_owned()
    }

    /// True for software on the processor.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
