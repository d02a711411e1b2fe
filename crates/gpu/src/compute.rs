//! Compute kernels: WGSL that runs on buffers.

use super::device::Gpu;
use trisplat_scene::{Error, Result};
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindingResource, ComputePipeline,
    ComputePipelineDescriptor, PipelineCompilationOptions, ShaderModuleDescriptor, ShaderSource,
};

/// A compute kernel: an entry point whose bindings, all in group 0, are numbered from 0 without
/// gaps.
#[derive(Debug)]
pub struct Kernel {
    name: &'static str,
    pipeline: ComputePipeline,
}

impl Kernel {
    /// Compiles the entry point `name` of `source`.
    ///
    /// # Errors
    ///
    /// The card or its driver rejects it.
    pub fn new(gpu: &Gpu, name: &'static str, source: String) -> Result<Self> {
        let source = ShaderSource::Wgsl(source.into());
        let module =
            gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some(name), source });
        let pipeline = gpu.device.create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &module,
            entry_point: Some(name),
            // Every pass writes workgroup memory before reading it.
            compilation_options: PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..PipelineCompilationOptions::default()
            },
            cache: None,
        });
        gpu.check().map_err(|e| Error::Gpu(format!("{name} cannot be compiled: {e}")))?;
        Ok(Self { name, pipeline })
    }

    /// The name of its entry point.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its pipeline.
    pub fn pipeline(&self) -> &ComputePipeline {
        &self.pipeline
    }

    /// Its bindings, in the order of their numbers.
    pub fn bind(&self, gpu: &Gpu, resources: &[BindingResource<'_>]) -> BindGroup {
        let entries: Vec<BindGroupEntry<'_>> = resources
            .iter()
            .zip(0..)
            .map(|(resource, binding)| BindGroupEntry { binding, resource: resource.clone() })
            .collect();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }
}

/// The two dimensions of a dispatch of `count` workgroups; one dimension has a limit.
pub fn workgroups(count: u32) -> [u32; 2] {
    let down = count.div_ceil(MAX_WORKGROUPS).max(1);
    [count.div_ceil(down), down]
}

/// Workgroups in one dimension that every card supports.
pub(crate) const MAX_WORKGROUPS: u32 = 65_535;
