//! The passes of one step, in order.

use super::job::{Count, DIGIT_BITS, Groups, Job, digit, scan, sum, turn};
use super::passes::Passes;
use super::room::Room;
use super::scene::{SceneBuffers, VisibilityBuffer};
use super::sequence::{Sequence, Spread, all};
use super::source::{GROUP, SCAN_ITEMS};
use super::uniform::StepPlan;
use super::work::tile_digits;
use wgpu::{BindingResource, Buffer};

/// What the passes of a step work on.
#[derive(Clone, Copy)]
pub(super) struct StepPasses<'a> {
    pub(super) passes: &'a Passes,
    pub(super) scene: &'a SceneBuffers,
    pub(super) visibility: &'a VisibilityBuffer,
    pub(super) room: &'a Room,
    pub(super) step: &'a Buffer,
    pub(super) counts: &'a Buffer,
    /// Set when a step found no room.
    pub(super) halted: &'a Buffer,
    pub(super) plan: &'a StepPlan,
    /// Means over the scene are needed.
    pub(super) regularised: bool,
}

/// Counts what is to be done, or does it.
const COUNT: Job = turn(0);
const WRITE: Job = turn(1);
const WRITE_LAYERS: Job = turn(2);

impl StepPasses<'_> {
    /// Records them all.
    pub(super) fn record(&self, to: &mut Sequence<'_>) {
        self.draw(to);
        to.stage("loss");
        self.loss(to);
        if self.plan.options.geometry {
            to.stage("geometry");
            self.geometry(to);
        }
        to.stage("backward");
        self.backward(to);
        to.stage("gather");
        self.gather(to);
        to.stage("update");
        self.update(to);
    }

    /// Records those that end with the frame.
    pub(super) fn draw(&self, to: &mut Sequence<'_>) {
        to.stage("project");
        self.project(to);
        to.stage("sort by depth");
        self.sort_by_depth(to);
        to.stage("bin");
        self.bin(to);
        to.stage("sort by tile");
        self.sort_by_tile(to);
        to.stage("forward");
        self.forward(to);
    }

    fn project(&self, to: &mut Sequence<'_>) {
        let (room, triangles) = (self.room, self.scene.shape.triangles);
        let project = |to: &mut Sequence<'_>, writes| {
            for (at, chunk) in self.scene.chunks.iter().enumerate() {
                let bindings = [
                    all(self.step),
                    self.scene.part(at, writes),
                    all(&chunk.x),
                    all(&room.splat_starts),
                    all(&room.records),
                    all(&room.bounds),
                    all(&room.planes),
                    all(&room.pieces),
                    all(&room.depths[0]),
                ];
                to.run(&self.passes.project, Spread::Over(chunk.count + 1, GROUP), &bindings);
            }
        };
        project(to, 0);
        let blocks = Spread::Over(triangles + 1, GROUP * SCAN_ITEMS);
        self.scan(to, Count::Triangles1, blocks, &room.splat_starts);
        self.plan(to, COUNT, &room.splat_starts);
        project(to, 1);
    }

    fn sort_by_depth(&self, to: &mut Sequence<'_>) {
        let sort = Sort {
            length: Count::Splats,
            digits: Count::SplatDigits,
            blocks: Groups::SplatSort,
            scan: Groups::SplatDigitScan,
            keys: &self.room.depths,
            values: &self.room.order,
        };
        self.sort(to, &sort, u32::BITS / DIGIT_BITS);
    }

    fn bin(&self, to: &mut Sequence<'_>) {
        let room = self.room;
        let bin = |to: &mut Sequence<'_>, job| {
            let bindings = [
                all(self.step),
                to.job(job),
                all(self.counts),
                all(&room.order[0]),
                all(&room.records),
                all(&room.bounds),
                all(&room.pair_starts),
                all(&room.tiles[0]),
                all(&room.owners),
            ];
            to.run(&self.passes.bin, Spread::Found(Groups::Splats), &bindings);
        };
        bin(to, COUNT);
        self.scan(to, Count::Splats1, Spread::Found(Groups::SplatScan), &room.pair_starts);
        self.plan(to, WRITE, &room.pair_starts);
        bin(to, WRITE);
    }

    /// Which of the two buffers the sorted pairs are in.
    fn sorted(&self) -> usize {
        tile_digits(self.plan) as usize % 2
    }

    fn sort_by_tile(&self, to: &mut Sequence<'_>) {
        let room = self.room;
        let sort = Sort {
            length: Count::Pairs,
            digits: Count::PairDigits,
            blocks: Groups::PairSort,
            scan: Groups::PairDigitScan,
            keys: &room.tiles,
            values: &room.pairs,
        };
        self.sort(to, &sort, tile_digits(self.plan));
        let tiles = self.plan.tiles.element_product();
        let bindings =
            [all(self.step), all(self.counts), all(&room.tiles[self.sorted()]), all(&room.tile_starts)];
        to.run(&self.passes.tile_starts, Spread::Over(tiles + 1, GROUP), &bindings);
    }

    /// What every pass over the tiles has first: the splats of each, front to back.
    fn of_tiles(&self) -> Vec<BindingResource<'_>> {
        let room = self.room;
        vec![
            all(self.step),
            all(&room.tile_starts),
            all(&room.pairs[self.sorted()]),
            all(&room.owners),
            all(&room.records),
            all(&room.planes),
        ]
    }

    fn forward(&self, to: &mut Sequence<'_>) {
        let room = self.room;
        if self.plan.by_pixel() {
            self.forward_by_pixel(to, COUNT);
            let blocks = Spread::Over(self.plan.frame_pixels() + 1, GROUP * SCAN_ITEMS);
            self.scan(to, Count::Pixels1, blocks, &room.layer_starts);
            self.plan(to, WRITE_LAYERS, &room.layer_starts);
            return;
        }
        let mut bindings = self.of_tiles();
        bindings.extend([all(&room.frame), all(&room.geometry), all(&room.tile_ends)]);
        to.run(&self.passes.forward, Spread::Tiles(self.plan.tiles), &bindings);
    }

    fn forward_by_pixel(&self, to: &mut Sequence<'_>, job: Job) {
        let room = self.room;
        let mut bindings = self.of_tiles();
        bindings.extend([
            all(&room.frame),
            all(&room.geometry),
            all(&room.layer_starts),
            all(&room.layers),
            all(&room.d_frame),
            all(&room.d_geometry),
            to.job(job),
        ]);
        to.run(&self.passes.forward_by_pixel, Spread::Tiles(self.plan.tiles), &bindings);
    }

    fn loss(&self, to: &mut Sequence<'_>) {
        let (room, passes) = (self.room, self.passes);
        let tiles = Spread::Tiles(crate::raster::soft::tile_count(self.plan.photo));
        let pixels = Spread::Over(self.plan.photo_pixels(), GROUP);
        to.run(&passes.resolve, pixels, &[all(self.step), all(&room.frame), all(&room.picture)]);
        let (picture, photo, maps) = (all(&room.picture), all(&room.photo), all(&room.maps));
        let ssim = [all(self.step), picture.clone(), photo.clone(), maps.clone(), all(&room.partial_sums)];
        to.run(&passes.loss_ssim, tiles, &ssim);
        let [step, .., partial_sums] = ssim;
        to.run(&passes.loss_grad, tiles, &[step, picture, photo, maps, partial_sums, all(&room.d_frame)]);
        self.sum(to, sum(Count::LossL1, Count::PhotoTiles, 3));
    }

    fn geometry(&self, to: &mut Sequence<'_>) {
        let (room, pixels) = (self.room, Spread::Over(self.plan.frame_pixels(), GROUP));
        let maps = [all(self.step), all(&room.frame), all(&room.geometry), all(&room.d_geometry)];
        let [step, frame, geometry, d_geometry] = maps.clone();
        let bindings = [step, frame, geometry, d_geometry, all(&room.slopes), all(&room.partial_sums)];
        to.run(&self.passes.normal_slopes, pixels, &bindings);
        self.sum(to, sum(Count::LossGeometry, Count::FrameGroups, 1));
        let [step, frame, geometry, d_geometry] = maps;
        let bindings = [step, frame, geometry, d_geometry, all(&room.slopes)];
        to.run(&self.passes.normal_grad, pixels, &bindings);
    }

    fn backward(&self, to: &mut Sequence<'_>) {
        let (room, tiles) = (self.room, Spread::Tiles(self.plan.tiles));
        let mut bindings = self.of_tiles();
        let d_pixels = [all(&room.geometry), all(&room.d_frame), all(&room.d_geometry)];
        if self.plan.by_pixel() {
            self.forward_by_pixel(to, WRITE);
            bindings.extend(d_pixels);
            bindings.extend([all(&room.layer_starts), all(&room.layers)]);
            bindings.extend(room.slots.iter().map(all));
            to.run(&self.passes.backward_by_pixel, tiles, &bindings);
        } else {
            bindings.push(all(&room.frame));
            bindings.extend(d_pixels);
            bindings.push(all(&room.tile_ends));
            bindings.extend(room.slots.iter().map(all));
            to.run(&self.passes.backward, tiles, &bindings);
        }
    }

    fn gather(&self, to: &mut Sequence<'_>) {
        let room = self.room;
        let mut bindings =
            vec![all(self.step), all(self.counts), all(&room.order[0]), all(&room.pair_starts)];
        bindings.extend(room.slots.iter().map(all));
        bindings.push(all(&room.splat_sums));
        to.run(&self.passes.gather, Spread::Found(Groups::Gather), &bindings);
    }

    fn update(&self, to: &mut Sequence<'_>) {
        let (room, scene) = (self.room, self.scene);
        if self.regularised {
            for (at, chunk) in scene.chunks.iter().enumerate() {
                let bindings = [all(self.step), scene.part(at, 0), all(&chunk.x), all(&room.partial_sums)];
                to.run(&self.passes.regularise, Spread::Over(chunk.count, GROUP), &bindings);
            }
            self.sum(to, sum(Count::SumArea, Count::SceneGroups, 2));
        }
        for (at, chunk) in scene.chunks.iter().enumerate() {
            let bindings = [
                all(self.step),
                all(self.counts),
                all(&room.splat_starts),
                all(&room.records),
                all(&room.pieces),
                all(&room.splat_sums),
                all(&chunk.x),
                all(&chunk.first_moments),
                all(&chunk.second_moments),
                all(&self.visibility.buffer),
                scene.part(at, 0),
            ];
            to.run(&self.passes.update, Spread::Found(Groups::Update), &bindings);
        }
    }

    /// Sums what the workgroups of the pass before left.
    fn sum(&self, to: &mut Sequence<'_>, job: Job) {
        let bindings = [to.job(job), all(&self.room.partial_sums), all(self.counts)];
        to.run(&self.passes.sum_partials, Spread::Once, &bindings);
    }

    fn plan(&self, to: &mut Sequence<'_>, job: Job, starts: &Buffer) {
        let bindings = [
            all(self.step),
            to.job(job),
            all(self.counts),
            all(starts),
            all(to.groups),
            all(&self.room.most),
            all(self.halted),
        ];
        to.run(&self.passes.plan, Spread::Once, &bindings);
    }

    /// An exclusive prefix sum in place.
    fn scan(&self, to: &mut Sequence<'_>, length: Count, blocks: Spread, data: &Buffer) {
        let (passes, sums) = (self.passes, all(&self.room.block_sums));
        let (job, counts) = (to.job(scan(length)), all(self.counts));
        let bindings = [job.clone(), counts.clone(), all(data), sums.clone()];
        to.run(&passes.scan_reduce, blocks, &bindings);
        to.run(&passes.scan_sums, Spread::Once, &[job, counts, sums]);
        to.run(&passes.scan_apply, blocks, &bindings);
    }

    /// A stable sort by the lowest `digits` of the keys; after an even number of them the result is in the first buffers.
    fn sort(&self, to: &mut Sequence<'_>, sort: &Sort<'_>, digits: u32) {
        let histogram = &self.room.histogram;
        for at in 0..digits {
            let (from, into) = (at as usize % 2, 1 - at as usize % 2);
            let job = to.job(digit(sort.length, at * DIGIT_BITS));
            let (blocks, counts) = (Spread::Found(sort.blocks), all(self.counts));
            let bindings = [job.clone(), counts.clone(), all(&sort.keys[from]), all(histogram)];
            to.run(&self.passes.sort_count, blocks, &bindings);
            self.scan(to, sort.digits, Spread::Found(sort.scan), histogram);
            let bindings = [
                job,
                counts,
                all(&sort.keys[from]),
                all(&sort.values[from]),
                all(histogram),
                all(&sort.keys[into]),
                all(&sort.values[into]),
            ];
            to.run(&self.passes.sort_scatter, blocks, &bindings);
        }
    }
}

/// What is sorted.
struct Sort<'a> {
    length: Count,
    digits: Count,
    blocks: Groups,
    scan: Groups,
    keys: &'a [Buffer; 2],
    values: &'a [Buffer; 2],
}
