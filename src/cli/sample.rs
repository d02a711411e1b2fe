//! `trisplat sample NAME -o FILE`: soups made from nothing, to try things on.

use crate::bench::scenes::{self, SampleScene};
use crate::error::{Error, Result};
use crate::formats::atomic::AtomicFile;
use crate::formats::ply;
use std::path::PathBuf;

/// What to make.
#[derive(Debug, clap::Args)]
pub struct SampleArgs {
    /// The scene.
    #[arg(value_enum)]
    pub name: SampleScene,
    /// Soup to write; "-" is standard output.
    #[arg(short, long, value_name = "FILE.ply")]
    pub output: PathBuf,
    /// Number of triangles (degenerate has its own).
    #[arg(long, default_value_t = 8000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub triangles: u32,
    /// Highest degree of the spherical harmonics.
    #[arg(long, default_value_t = 0, value_name = "DEGREE", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub sh_degree: u8,
    /// Seed of the random numbers; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub seed: u64,
    /// Replace FILE if it is there.
    #[arg(short, long)]
    pub force: bool,
}

/// Makes the soup and writes it.
pub fn run(args: &SampleArgs) -> Result<()> {
    if args.output.is_file() && !args.force {
        return Err(Error::invalid(
            "--output",
            args.output.display(),
            "a new file, or --force to replace it",
        ));
    }
    let triangles = args.triangles as usize;
    let mut soup = scenes::soup(args.name, triangles, args.seed);
    scenes::raise_sh(&mut soup, args.sh_degree, args.seed);
    let provenance = scenes::provenance(args.name, triangles, args.seed, args.sh_degree);
    let mut file = AtomicFile::create(&args.output)?;
    ply::write_soup(&mut file, &soup, &provenance).map_err(|e| Error::io(&args.output, e))?;
    file.commit().map(drop)
}
