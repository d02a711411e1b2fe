//! The flags of `trisplat bake`.

use super::bake_bytes::ByteSize;
use super::harden::HardenArgs;
use crate::bake::BakeOptions;
use crate::budget::Seconds;
use crate::dataset::DatasetOptions;
use crate::formats::output::OutputFormat;
use std::path::PathBuf;

/// Files, layers and the options of every stage.
#[derive(Debug, clap::Args)]
pub struct BakeArgs {
    /// Files to bake: .ply .pt .off .obj .glb .gltf .html; several are merged; "-" is standard input. The folder of a plan whose blocks
    /// are trained is baked into tiles, block by block.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// File to write: .glb .gltf .obj .ply .html .tileset.json; "-" is standard output.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Kind of file to write, when the name of OUT does not tell.
    #[arg(long, value_enum)]
    pub format: Option<OutputFormat>,
    /// Replace OUT if it exists.
    #[arg(short, long)]
    pub force: bool,
    /// Do everything but write.
    #[arg(long)]
    pub dry_run: bool,
    /// JSON file with options; --set and flags win over it (schema: trisplat schema bake).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any option of the bake by its key, as in refit=flat; may be given often.
    ///
    /// `trisplat schema bake` has them all, with what they do; so has docs/bake.md.
    #[arg(long = "set", value_name = "KEY=VALUE", allow_hyphen_values = true)]
    pub sets: Vec<String>,
    /// Write what every stage did as JSON (schema: trisplat schema report).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write at most this many bytes, all files together, as in 5MB.
    ///
    /// The scene keeps as many triangles as fit; its size is tried first, and it is baked once or twice.
    #[arg(long, value_name = "SIZE")]
    pub max_bytes: Option<ByteSize>,
    /// CPU time to spend on all cores together, as in 5s or 2m: chooses how many pictures of a soft scene are drawn, how often its
    /// triangles are fitted to them, and whether colours are.
    #[arg(long, value_name = "TIME", conflicts_with_all = ["max_bytes", "harden"])]
    pub budget: Option<Seconds>,
    /// Posed photos of the scene: removes triangles that none shows, and fits colours to them
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
