//! The passes of one step, in order.

use super::limits::{Count, DIGIT_BITS, GROUP, SCAN_ITEMS};
use super::passes::{Passes, TilePasses};
use super::scene::{SceneBuffers, VisibilityBuffer};
use super::sequence::{Groups, Job, Ordering, RadixSort, Sequence, Spread, all, sum, turn};
use super::step_buffers::StepBuffers;
use super::uniform::StepPlan;
use wgpu::{BindingResource, Buffer};

/// The inputs and outputs of a step's passes.
#[derive(Clone, Copy)]
pub(super) struct StepPasses<'a> {
    pub(super) passes: &'a Passes,
    pub(super) tile_passes: &'a TilePasses,
    pub(super) scene: &'a SceneBuffers,
    pub(super) visibility: &'a VisibilityBuffer,
    pub(super) buffers: &'a StepBuffers,
    pub(super) step: &'a Buffer,
    pub(super) counts: &'a Buffer,
    /// Set when a step did not fit its buffers.
    pub(super) halted: &'a Buffer,
    pub(super) plan: &'a StepPlan,
    /// Means over the scene are needed.
    pub(super) regularised: bool,
}

/// Counts the work, or does it.
const COUNT: Job = turn(0);
const WRITE: Job = turn(1);
const WRITE_LAYERS: Job = turn(2);

impl StepPasses<'_> {
    /// Records them all.
    pub(super) fn record(&self, to: &mut Sequence<'_>) {
        self.draw(to);
        self.loss(to);
        if self.plan.options.geometry {
            self.geometry(to);
        }
        self.backward(to);
        self.gather(to);
        self.update(to);
    }

    /// Records the passes up to the frame.
    pub(super) fn draw(&self, to: &mut Sequence<'_>) {
        self.project(to);
        self.sort_by_depth(to);
        self.bin(to);
        self.sort_by_tile(to);
        self.forward(to);
    }

    fn project(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let triangles = self.scene.shape.triangles;
        let project = |to: &mut Sequence<'_>, writes| {
            for (at, chunk) in self.scene.chunks.iter().enumerate() {
                let bindings = [
                    all(self.step),
                    self.scene.part(at, writes),
                    all(&chunk.x),
                    all(&buffers.splat_starts),
                    all(&buffers.records),
                    all(&buffers.bounds),
                    all(&buffers.planes),
                    all(&buffers.pieces),
                    all(&buffers.depths[0]),
                ];
                to.run(&self.passes.project, Spread::Over(chunk.count + 1, GROUP), &bindings);
            }
        };
        project(to, 0);
        let blocks = Spread::Over(triangles + 1, GROUP * SCAN_ITEMS);
        self.ordering().scan(to, Count::Triangles1, blocks, &buffers.splat_starts);
        self.plan(to, COUNT, &buffers.splat_starts);
        project(to, 1);
    }

    fn sort_by_depth(&self, to: &mut Sequence<'_>) {
        let sort = RadixSort {
            length: Count::Splats,
            blocks: Spread::Found(Groups::SplatSort),
            keys: &self.buffers.depths,
            values: &self.buffers.order,
        };
        self.ordering().sort(to, &sort, u32::BITS / DIGIT_BITS);
    }

    fn bin(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let bin = |to: &mut Sequence<'_>, job| {
            let bindings = [
                all(self.step),
                to.job(job),
                all(self.counts),
                all(&buffers.order[0]),
                all(&buffers.records),
                all(&buffers.bounds),
                all(&buffers.pair_starts),
                all(&buffers.tiles[0]),
                all(&buffers.owners),
            ];
            to.run(&self.passes.bin, Spread::Found(Groups::Splats), &bindings);
        };
        bin(to, COUNT);
        self.ordering().scan(
            to,
            Count::Splats1,
            Spread::Found(Groups::SplatScan),
            &buffers.pair_starts,
        );
        self.plan(to, WRITE, &buffers.pair_starts);
        bin(to, WRITE);
    }

    /// Index of the buffer with the sorted pairs, 0 or 1.
    fn sorted_buffer(&self) -> usize {
        tile_digits(self.plan) as usize % 2
    }

    fn sort_by_tile(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let sort = RadixSort {
            length: Count::Pairs,
            blocks: Spread::Found(Groups::PairSort),
            keys: &buffers.tiles,
            values: &buffers.pairs,
        };
        self.ordering().sort(to, &sort, tile_digits(self.plan));
        let tiles = self.plan.tiles.element_product();
        let bindings = [
            all(self.step),
            all(self.counts),
            all(&buffers.tiles[self.sorted_buffer()]),
            all(&buffers.table),
        ];
        to.run(&self.passes.tile_starts, Spread::Over(tiles + 1, GROUP), &bindings);
    }

    /// The first bindings of every pass over tiles: the splats of each tile, front to back.
    fn of_tiles(&self) -> Vec<BindingResource<'_>> {
        let buffers = self.buffers;
        vec![
            all(self.step),
            all(&buffers.table),
            all(&buffers.pairs[self.sorted_buffer()]),
            all(&buffers.owners),
            all(&buffers.records),
            all(&buffers.planes),
        ]
    }

    fn forward(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        if self.plan.by_pixel() {
            self.forward_by_pixel(to, COUNT);
            let blocks = Spread::Over(self.plan.pixels() + 1, GROUP * SCAN_ITEMS);
            self.ordering().scan(to, Count::Pixels1, blocks, &buffers.layer_starts);
            self.plan(to, WRITE_LAYERS, &buffers.layer_starts);
            return;
        }
        let mut bindings = self.of_tiles();
        bindings.extend([all(&buffers.frame), all(&buffers.geometry)]);
        to.run(&self.tile_passes.forward, Spread::Tiles(self.plan.tiles), &bindings);
    }

    fn forward_by_pixel(&self, to: &mut Sequence<'_>, job: Job) {
        let buffers = self.buffers;
        let mut bindings = self.of_tiles();
        bindings.extend([
            all(&buffers.frame),
            all(&buffers.geometry),
            all(&buffers.layer_starts),
            all(&buffers.layers),
            all(&buffers.d_frame),
            all(&buffers.d_geometry),
            all(&buffers.kept),
            to.job(job),
        ]);
        to.run(&self.tile_passes.forward, Spread::Tiles(self.plan.tiles), &bindings);
    }

    fn loss(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let passes = self.passes;
        let tiles = Spread::Tiles(self.plan.tiles);
        let pixels = Spread::Over(self.plan.pixels(), GROUP);
        to.run(
            &passes.resolve,
            pixels,
            &[all(self.step), all(&buffers.frame), all(&buffers.picture)],
        );
        let picture = all(&buffers.picture);
        let photo = all(&buffers.photo);
        let maps = all(&buffers.maps);
        let ssim = [
            all(self.step),
            picture.clone(),
            photo.clone(),
            maps.clone(),
            all(&buffers.partial_sums),
        ];
        to.run(&passes.loss_ssim, tiles, &ssim);
        let [step, .., partial_sums] = ssim;
        to.run(
            &passes.loss_grad,
            tiles,
            &[step, picture, photo, maps, partial_sums, all(&buffers.d_frame)],
        );
        self.sum(to, sum(Count::LossL1, Count::PhotoTiles, 3));
    }

    fn geometry(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let pixels = Spread::Over(self.plan.pixels(), GROUP);
        let maps =
            [all(self.step), all(&buffers.frame), all(&buffers.geometry), all(&buffers.d_geometry)];
        let [step, frame, geometry, d_geometry] = maps.clone();
        let bindings =
            [step, frame, geometry, d_geometry, all(&buffers.slopes), all(&buffers.partial_sums)];
        to.run(&self.passes.normal_slopes, pixels, &bindings);
        self.sum(to, sum(Count::LossGeometry, Count::FrameGroups, 1));
        let [step, frame, geometry, d_geometry] = maps;
        let bindings = [step, frame, geometry, d_geometry, all(&buffers.slopes)];
        to.run(&self.passes.normal_grad, pixels, &bindings);
    }

    fn backward(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let mut bindings = self.of_tiles();
        bindings.extend(buffers.slots.iter().map(all));
        let d_pixels = [all(&buffers.geometry), all(&buffers.d_frame), all(&buffers.d_geometry)];
        if self.plan.by_pixel() {
            self.forward_by_pixel(to, WRITE);
            bindings.extend(d_pixels);
            bindings.extend([all(&buffers.layer_starts), all(&buffers.layers)]);
        } else {
            bindings.push(all(&buffers.frame));
            bindings.extend(d_pixels);
        }
        to.run(&self.tile_passes.backward, Spread::Found(Groups::Buckets), &bindings);
    }

    fn gather(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let mut bindings = vec![
            all(self.step),
            all(self.counts),
            all(&buffers.order[0]),
            all(&buffers.pair_starts),
        ];
        bindings.extend(buffers.slots.iter().map(all));
        bindings.push(all(&buffers.splat_sums));
        to.run(&self.passes.gather, Spread::Found(Groups::Gather), &bindings);
    }

    fn update(&self, to: &mut Sequence<'_>) {
        let buffers = self.buffers;
        let scene = self.scene;
        if self.regularised {
            for (at, chunk) in scene.chunks.iter().enumerate() {
                let bindings =
                    [all(self.step), scene.part(at, 0), all(&chunk.x), all(&buffers.partial_sums)];
                to.run(&self.passes.regularise, Spread::Over(chunk.count, GROUP), &bindings);
            }
            self.sum(to, sum(Count::SumArea, Count::SceneGroups, 1));
        }
        for (at, chunk) in scene.chunks.iter().enumerate() {
            let bindings = [
                all(self.step),
                all(self.counts),
                all(&buffers.splat_starts),
                all(&buffers.records),
                all(&buffers.pieces),
                all(&buffers.splat_sums),
                all(&chunk.x),
                all(&chunk.first_moments),
                all(&chunk.second_moments),
                all(&self.visibility.buffer),
                scene.part(at, 0),
            ];
            to.run(&self.passes.update, Spread::Found(Groups::Update), &bindings);
        }
    }

    /// Sums the partial sums of the previous pass.
    fn sum(&self, to: &mut Sequence<'_>, job: Job) {
        let bindings = [to.job(job), all(&self.buffers.partial_sums), all(self.counts)];
        to.run(&self.passes.sum_partials, Spread::Once, &bindings);
    }

    fn plan(&self, to: &mut Sequence<'_>, job: Job, starts: &Buffer) {
        let bindings = [
            all(self.step),
            to.job(job),
            all(self.counts),
            all(starts),
            all(to.groups),
            all(&self.buffers.most),
            all(self.halted),
        ];
        to.run(&self.passes.plan, Spread::Once, &bindings);
    }

    /// The passes of sums and sorts.
    fn ordering(&self) -> Ordering<'_> {
        let StepBuffers { histogram, block_sums, .. } = self.buffers;
        Ordering { passes: self.passes, counts: self.counts, histogram, block_sums }
    }
}

/// Digits of the largest number of a tile.
fn tile_digits(plan: &StepPlan) -> u32 {
    let last_tile = plan.tiles.element_product().max(2) - 1;
    (u32::BITS - last_tile.leading_zeros()).div_ceil(DIGIT_BITS)
}
