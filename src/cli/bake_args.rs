//! The flags of `trisplat bake`.

use super::bake_bytes::ByteSize;
use super::harden::HardenArgs;
use std::path::PathBuf;
use trisplat_bake::BakeOptions;
use trisplat_dataset::DatasetOptions;
use trisplat_formats::output::OutputFormat;

/// Files, layers and the options of every stage.
#[derive(Debug, clap::Args)]
pub struct BakeArgs {
    /// Files to bake: .ply .pt .off .obj .glb .gltf .html; several are merged; "-" is standard input. Gaussian splats (.ply .splat .spz .sog
    /// .glb) are drawn, and triangles are trained on the pictures: about two minutes, with --preset fast less, with --harden more. The folder
    /// of a plan whose blocks are trained is baked into tiles, block by block.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// File to write: .glb .gltf .obj .ply .usdz .html .tileset.json; "-" is standard output.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Format to write, when the name of OUT does not tell it.
    #[arg(long, value_enum)]
    pub format: Option<OutputFormat>,
    /// Replace OUT if it exists.
    #[arg(short, long)]
    pub force: bool,
    /// Do everything but write.
    #[arg(long)]
    pub dry_run: bool,
    /// JSON file with options; --set and flags override it (schema: trisplat schema bake).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any option of the bake by its key, as in refit=flat; may be given often.
    ///
    /// `trisplat schema bake` and docs/bake.md describe all keys.
    #[arg(long = "set", value_name = "KEY=VALUE", allow_hyphen_values = true)]
    pub sets: Vec<String>,
    /// Write what every stage did as JSON (schema: trisplat schema report).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write at most this many bytes, all files together, as in 5MB.
    ///
    /// The scene keeps the most triangles that fit. A trial measures the size, then the scene is baked once
    /// or twice.
    #[arg(long, value_name = "SIZE")]
    pub max_bytes: Option<ByteSize>,
    /// Posed photos of the scene: removes triangles hidden in all of them, and fits colours to them
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Whether the scene is trained solid first.
    #[command(flatten)]
    pub harden: HardenArgs,
    /// The options of the stages.
    #[command(flatten)]
    pub options: BakeOptions,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}
