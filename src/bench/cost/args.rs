//! What `trisplat bench cost` is asked for.

use super::knobs::CostStage;
use crate::dataset::DatasetOptions;
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct CostArgs {
    /// Posed photos; without them a synthetic scene is made, whose photos are exact.
    #[arg(value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Fewer values and shorter trainings, each with one seed: at most 3 minutes on two idle cores.
    #[arg(long)]
    pub quick: bool,
    /// Only this stage.
    #[arg(long, value_enum)]
    pub stage: Option<CostStage>,
    /// Only this option, by its name in configs, as in refit or warmup.half_until; may be given often.
    #[arg(long, value_name = "NAME")]
    pub knob: Vec<String>,
    /// Steps of a training at its default [default: 600; with --quick 200].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub steps: Option<u64>,
    /// Most triangles of a training at its default [default: 6000; with --quick 3000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub max_triangles: Option<u64>,
    /// Runs of every setting; those of a training have seeds 0, 1, 2, ... [default: 3; trainings with --quick 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=99))]
    pub runs: Option<u64>,
    /// Print rows as JSON (schema: trisplat schema cost).
    #[arg(long)]
    pub json: bool,
    /// Append rows to this CSV file.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write a page of plots, tables and pictures, which opens from disk.
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Draw PSNR against CPU seconds as SVG, one chart per stage.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

impl CostArgs {
    pub(super) fn steps(&self) -> u64 {
        self.steps.unwrap_or(if self.quick { 200 } else { 600 })
    }

    pub(super) fn max_triangles(&self) -> u64 {
        self.max_triangles.unwrap_or(if self.quick { 3000 } else { 6000 })
    }

    pub(super) fn runs(&self, stage: CostStage) -> usize {
        let once = self.quick && stage == CostStage::Train;
        self.runs.map_or(if once { 1 } else { 3 }, |runs| runs as usize)
    }
}
