//! Passes one after the other.

use super::job::{Groups, Job, Jobs};
use glam::UVec2;
use std::collections::HashMap;
use trisplat_gpu::{Gpu, Kernel, workgroups};
use wgpu::{BindGroup, BindingResource, Buffer, CommandEncoder, ComputePass, ComputePipeline};

/// The number of workgroups of a pass.
#[derive(Debug, Clone, Copy)]
pub(super) enum Spread {
    /// One.
    Once,
    /// Enough for `items`, `each` per workgroup.
    Over(u32, u32),
    /// One per tile.
    Tiles(UVec2),
    /// A number that the card computed.
    Found(Groups),
}

/// Bind groups of earlier steps, by pass and buffers, because making them takes longer than recording a step.
/// They keep their buffers alive.
#[derive(Debug, Default)]
pub(super) struct BindGroups(HashMap<Bound, BindGroup>);

/// A pass, and its buffers with the places in them.
type Bound = (ComputePipeline, Vec<(Buffer, u64)>);

impl BindGroups {
    /// Forgets them, when buffers go.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    fn get(&mut self, gpu: &Gpu, kernel: &Kernel, bindings: &[BindingResource<'_>]) -> &BindGroup {
        let buffer = |binding: &BindingResource<'_>| match binding {
            BindingResource::Buffer(part) => Some((part.buffer.clone(), part.offset)),
            _ => None,
        };
        let key = (kernel.pipeline().clone(), bindings.iter().filter_map(buffer).collect());
        self.0.entry(key).or_insert_with(|| kernel.bind(gpu, bindings))
    }
}

/// A sequence of passes that is being recorded.
pub(super) struct Sequence<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) bind_groups: &'a mut BindGroups,
    pub(super) jobs: &'a Jobs,
    pub(super) groups: &'a Buffer,
    pub(super) encoder: &'a mut CommandEncoder,
    pub(super) pass: Option<ComputePass<'static>>,
}

impl<'a> Sequence<'a> {
    /// A job as a binding.
    pub(super) fn job(&self, job: Job) -> BindingResource<'a> {
        self.jobs.get(job)
    }

    /// Adds a pass; its bindings are in the order of their numbers.
    pub(super) fn run(&mut self, kernel: &Kernel, spread: Spread, bindings: &[BindingResource<'_>]) {
        let [x, y] = match spread {
            Spread::Once => [1, 1],
            Spread::Over(items, each) => workgroups(items.div_ceil(each)),
            Spread::Tiles(tiles) => tiles.to_array(),
            Spread::Found(_) => [1, 1],
        };
        if x * y == 0 {
            return;
        }
        let encoder = &mut *self.encoder;
        let begin = || encoder.begin_compute_pass(&Default::default()).forget_lifetime();
        let pass = self.pass.get_or_insert_with(begin);
        pass.set_pipeline(kernel.pipeline());
        pass.set_bind_group(0, self.bind_groups.get(self.gpu, kernel, bindings), &[]);
        match spread {
            Spread::Found(groups) => pass.dispatch_workgroups_indirect(self.groups, groups as u64 * 12),
            _ => pass.dispatch_workgroups(x, y, 1),
        }
    }
}

/// A whole buffer as a binding.
pub(super) fn all(buffer: &Buffer) -> BindingResource<'_> {
    buffer.as_entire_binding()
}
