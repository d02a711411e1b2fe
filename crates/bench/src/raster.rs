//! `trisplat bench raster`: what a frame costs on this CPU, soft and solid, and how that grows with threads,
//! pixels and triangles.
//!
//! Soft steps are drawn forward and backward, as training does; solid frames as evaluation does, with one
//! colour per corner.

mod soft;
mod solid;
mod timing;

use super::machine::Machine;
use glam::UVec2;
use serde::{Deserialize, Serialize};
use timing::{CaseCost, RasterCase};
use trisplat_scene::{Error, Result};

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct RasterBenchArgs {
    /// Frames of every case; the least of each figure is kept.
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,
    /// Numbers of threads, in addition to one and all cores.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = trisplat_scene::ranges::count)]
    pub thread_counts: Vec<usize>,
    /// Divide triangles and pixels by this, for a quick look.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub smaller: u32,
    /// Print rows as JSON.
    #[arg(long)]
    pub json: bool,
}

/// One case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RasterRow {
    /// Where it was measured.
    #[serde(flatten)]
    pub machine: Machine,
    /// "soft", forward and backward, or "solid".
    pub rasteriser: String,
    /// Threads that drew.
    pub threads: u64,
    /// Triangles of the scene, all in view.
    pub triangles: u64,
    /// Width and height, px.
    pub size: [u32; 2],
    /// Fastest frame, ms.
    pub wall_ms: f64,
    /// User and system time of the frame that used least, ms; on a loaded machine the figure to compare.
    pub cpu_ms: f64,
    /// Frames per second, from `wall_ms`.
    pub per_second: f64,
    /// Where the time goes, in order of work.
    pub parts: Vec<PartRow>,
}

/// A part of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartRow {
    /// Its name.
    pub name: String,
    /// Its share of the time, of 1.
    pub share: f64,
}

/// Measures every case; calls `on_row` with each row as soon as it is there.
pub fn run(args: &RasterBenchArgs, mut on_row: impl FnMut(&RasterRow)) -> Result<Vec<RasterRow>> {
    let machine = Machine::here();
    let mut rows = Vec::new();
    for case in cases(args) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(case.threads).build();
        let pool = pool.map_err(|e| Error::invalid("thread_counts", case.threads, e.to_string()))?;
        let frames = args.frames as usize;
        let cost =
            pool.install(|| if case.solid { solid::cost(&case, frames) } else { soft::cost(&case, frames) });
        let row = row(&machine, &case, &cost);
        on_row(&row);
        rows.push(row);
    }
    Ok(rows)
}

fn row(machine: &Machine, case: &RasterCase, cost: &CaseCost) -> RasterRow {
    let total: f64 = cost.parts.iter().map(|(_, ms)| ms).sum();
    let part = |(name, ms): &(&'static str, f64)| PartRow { name: (*name).to_owned(), share: ms / total };
    RasterRow {
        machine: machine.clone(),
        rasteriser: if case.solid { "solid" } else { "soft" }.to_owned(),
        threads: case.threads as u64,
        triangles: case.triangles as u64,
        size: case.size.to_array(),
        wall_ms: cost.wall_ms,
        cpu_ms: cost.cpu_ms,
        per_second: 1e3 / cost.wall_ms,
        parts: cost.parts.iter().map(part).collect(),
    }
}

/// A base case, and variants of it that differ in threads, pixels or triangles alone.
fn cases(args: &RasterBenchArgs) -> Vec<RasterCase> {
    let all = std::thread::available_parallelism().map_or(1, |n| n.get());
    let mut counts = [&[1, all][..], &args.thread_counts].concat();
    counts.sort_unstable();
    counts.dedup();
    counts.retain(|n| *n > 0);
    let small = |n: u32| (n / args.smaller).max(16);
    let base = |solid: bool| RasterCase {
        solid,
        threads: all,
        triangles: small(if solid { 1_000_000 } else { 50_000 }) as usize,
        size: if solid { UVec2::new(small(1280), small(720)) } else { UVec2::new(small(480), small(270)) },
    };
    let mut cases = Vec::new();
    for base in [base(false), base(true)] {
        cases.extend(counts.iter().map(|&threads| RasterCase { threads, ..base }));
        cases.extend([base.size / 2, base.size * 2].map(|size| RasterCase { size, ..base }));
        cases.extend(
            [base.triangles / 4, base.triangles * 4].map(|triangles| RasterCase { triangles, ..base }),
        );
    }
    cases
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_what_they_say() {
        let args = RasterBenchArgs { frames: 1, thread_counts: vec![2], smaller: 20, json: false };
        let mut called = 0;
        let rows = run(&args, |_| called += 1).unwrap();
        assert_eq!(rows.len(), called);
        for rasteriser in ["soft", "solid"] {
            let rows: Vec<&RasterRow> = rows.iter().filter(|r| r.rasteriser == rasteriser).collect();
            assert!(rows.iter().any(|r| r.threads == 1) && rows.iter().any(|r| r.threads == 2));
            for row in rows {
                assert!((row.parts.iter().map(|p| p.share).sum::<f64>() - 1.0).abs() < 1e-9, "{row:?}");
                assert!((row.per_second * row.wall_ms - 1e3).abs() < 1e-6, "{row:?}");
            }
        }
    }
}
