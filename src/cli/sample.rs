//! `trisplat sample NAME -o OUT`: synthetic soups and data sets to try things on.

use super::inputs::Inputs;
use super::outputs::Outputs;
use std::path::{Path, PathBuf};
use trisplat_dataset::synthetic::{self, SyntheticOptions};
use trisplat_formats::ply;
use trisplat_sample::scenes::{self, SampleScene};
#[cfg(feature = "bench")]
use trisplat_sample::town_photos::{self, TownOptions};
use trisplat_scene::{
    Error, Result,
    atomic::{self, AtomicFolder},
};

/// What to make.
#[derive(Debug, clap::Args)]
pub struct SampleArgs {
    /// The sample.
    #[command(subcommand)]
    pub sample: SampleCommand,
}

/// The samples.
#[derive(Debug, clap::Subcommand)]
pub enum SampleCommand {
    /// Soup of balls, a ring, a chest, poles and a colour chart on a chequered stage under a dome.
    Studio(SoupArgs),
    /// Soup of every degenerate triangle that a reader may accept; its number of triangles is fixed.
    Degenerate(SoupArgs),
    /// Posed photos of an analytic scene, in COLMAP's layout.
    Dataset(DatasetArgs),
    /// Posed photos of a town, too large for one run, and the town itself.
    #[cfg(feature = "bench")]
    Town(TownArgs),
    /// Posed photos of a town (not in this build).
    #[cfg(not(feature = "bench"))]
    Town(super::missing::MissingArgs),
}

/// A town and its folder.
#[cfg(feature = "bench")]
#[derive(Debug, clap::Args)]
pub struct TownArgs {
    /// Folder to write: images/, transforms.json, points.ply, test.txt and truth.ply.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Write into DIR although it holds something.
    #[arg(short, long)]
    pub force: bool,
    /// What to make.
    #[command(flatten)]
    pub options: TownOptions,
}

/// A soup and its file.
#[derive(Debug, clap::Args)]
pub struct SoupArgs {
    /// Soup to write; "-" is standard output.
    #[arg(short, long, value_name = "FILE.ply")]
    pub output: PathBuf,
    /// Number of triangles (fixed for degenerate).
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

/// A data set and its folder.
#[derive(Debug, clap::Args)]
pub struct DatasetArgs {
    /// Folder to write: images/, sparse/0/ and test.txt.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Write into DIR although it holds something.
    #[arg(short, long)]
    pub force: bool,
    /// What to make.
    #[command(flatten)]
    pub options: SyntheticOptions,
}

/// Makes the sample and writes it.
pub fn run(args: &SampleArgs, inputs: &Inputs) -> Result<()> {
    match &args.sample {
        SampleCommand::Studio(args) => write_soup(SampleScene::Studio, args, inputs),
        SampleCommand::Degenerate(args) => write_soup(SampleScene::Degenerate, args, inputs),
        SampleCommand::Dataset(args) => {
            // Undoes what a killed run began there.
            let folder = AtomicFolder::create(&args.output)?;
            check_folder(&args.output, args.force)?;
            synthetic::write(folder.path(), &args.options)?;
            folder.publish("sparse")
        }
        #[cfg(not(feature = "bench"))]
        SampleCommand::Town(_) => Err(super::missing::error("bench")),
        #[cfg(feature = "bench")]
        SampleCommand::Town(args) => {
            // Undoes what a killed run began there.
            let folder = AtomicFolder::create(&args.output)?;
            check_folder(&args.output, args.force)?;
            town_photos::write(folder.path(), &args.options)?;
            folder.publish("transforms.json")
        }
    }
}

fn write_soup(scene: SampleScene, args: &SoupArgs, inputs: &Inputs) -> Result<()> {
    let mut outputs = Outputs::new(inputs, args.force);
    outputs.claim("--output", &args.output)?;
    let triangles = args.triangles as usize;
    let mut soup = scenes::soup(scene, triangles, args.seed);
    scenes::raise_sh(&mut soup, args.sh_degree, args.seed);
    let provenance = scenes::provenance(scene, triangles, args.seed, args.sh_degree);
    let mut file = outputs.take(&args.output)?;
    ply::write_soup(&mut file, &soup, &provenance, &[]).map_err(|e| Error::io(&args.output, e))?;
    file.commit().map(drop)
}

/// Refuses a folder that is not empty, unless permitted.
fn check_folder(folder: &Path, force: bool) -> Result<()> {
    let counts = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| !atomic::is_leftover(&entry.file_name().to_string_lossy()))
    };
    let holds_something = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(counts));
    if holds_something && !force {
        let wants = "a new or empty folder, or --force to write into it";
        return Err(Error::invalid("--output", folder.display(), wants));
    }
    Ok(())
}
