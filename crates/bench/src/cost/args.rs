//! What `trisplat bench cost` is asked for.

use std::path::PathBuf;
use trisplat_dataset::DatasetOptions;
use trisplat_scene::Seconds;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct CostArgs {
    /// Posed photos; without them a synthetic scene is made, whose photos are exact.
    #[arg(value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// CPU time that the dearest training may take, as in 90s or 10m. All trainings together take about 20 times as long.
    #[arg(long, value_name = "TIME", default_value = "30s")]
    pub budget: Seconds,
    /// Steps to try, ascending [default: 250, 500, 1000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub steps: Vec<u64>,
    /// Most triangles to try, ascending [default: 3000, 10000, 30000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub max_triangles: Vec<u64>,
    /// Trainings of each, with seeds 0, 1, 2, and so on; one alone has no band of confidence.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=99))]
    pub seeds: u64,
    /// Print the report as JSON (schema: trisplat schema cost).
    #[arg(long)]
    pub json: bool,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}
