//! Every option of the bake, and the presets.

use super::backdrop::BackdropOptions;
use super::bvh::BvhOptions;
use super::chunk::ChunkOptions;
use super::collision::CollisionOptions;
use super::crop::CropOptions;
use super::floaters::FloatersOptions;
use super::lit::LitOptions;
use super::lod::LodOptions;
use super::order::OrderOptions;
use super::place::PlaceOptions;
use super::prune::PruneOptions;
use super::refit::RefitOptions;
use super::reshape::ReshapeOptions;
use super::solid::SolidOptions;
use super::teacher::TeacherOptions;
use super::tiles::TilesOptions;
use super::unseen::UnseenOptions;
use super::weld::WeldOptions;
use crate::error::{Error, Result};
use crate::formats::output::OutputOptions;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A complete set of options to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum BakePreset {
    /// Read, prune, make solid, write: one mesh in the order of the input.
    Fast,
    /// Chunks that an engine can skip, in an order that its caches like.
    #[default]
    Default,
    /// As default, fewer faint triangles, quantised and compressed where the target reads it.
    Small,
}

/// The options of the stages.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
#[schemars(title = "trisplat bake options")]
pub struct BakeOptions {
    /// Complete set of options to start from; config file and flags are laid over it.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub preset: BakePreset,
    /// Which part of the scene is kept.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Crop: keep a region"))]
    pub crop: CropOptions,
    /// Whether pictures of the soft scene take the place of photos.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Teacher, without --dataset: pictures in place of photos")
    )]
    pub teacher: TeacherOptions,
    /// Whether there is something to collide with.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Collision: something to walk on"))]
    pub collision: CollisionOptions,
    /// Which triangles are dropped.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Prune: drop what an engine cannot draw or nobody sees")
    )]
    pub prune: PruneOptions,
    /// How soft triangles become solid.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Solid: soft triangles become opaque"))]
    pub solid: SolidOptions,
    /// Which triangles the photos need.
    #[cfg_attr(
        feature = "cli",
        command(
            flatten,
            next_help_heading = "Unseen, with --dataset or cameras in the file: drop what no photo sees"
        )
    )]
    pub unseen: UnseenOptions,
    /// Whether triangles that hang before cameras stay.
    #[cfg_attr(
        feature = "cli",
        command(
            flatten,
            next_help_heading = "Floaters, with --dataset or cameras in the file: drop shards in the air"
        )
    )]
    pub floaters: FloatersOptions,
    /// Which triangles are fitted to pictures.
    #[cfg_attr(
        feature = "cli",
        command(
            flatten,
            next_help_heading = "Reshape: fit opaque triangles to the soft scene or the photos"
        )
    )]
    pub reshape: ReshapeOptions,
    /// Which levels of detail are made.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "LOD: levels of detail"))]
    pub lod: LodOptions,
    /// How the scene is cut into tiles.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Tiles: pieces that stream"))]
    pub tiles: TilesOptions,
    /// What is put behind the scene.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Backdrop, with --dataset: close holes")
    )]
    pub backdrop: BackdropOptions,
    /// How colours are taken from the photos.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Refit, with --dataset: colours from the photos")
    )]
    pub refit: RefitOptions,
    /// Whether lights fall on the scene.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Lit: normals for an engine's lights"))]
    pub lit: LitOptions,
    /// Which corners become one vertex.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Weld: share vertices"))]
    pub weld: WeldOptions,
    /// The frame of the output.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Place: the frame of the output"))]
    pub place: PlaceOptions,
    /// How the scene is cut.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Chunk: nodes that an engine can skip")
    )]
    pub chunk: ChunkOptions,
    /// The hierarchy beside the output.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "BVH: hierarchy beside the output"))]
    pub bvh: BvhOptions,
    /// The order of triangles.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Order: of triangles in a chunk"))]
    pub order: OrderOptions,
    /// The files written.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Output"))]
    pub output: OutputOptions,
}

impl BakeOptions {
    /// Every option at its default.
    pub const DEFAULT: Self = Self {
        preset: BakePreset::Default,
        crop: CropOptions::DEFAULT,
        teacher: TeacherOptions::DEFAULT,
        collision: CollisionOptions::DEFAULT,
        prune: PruneOptions::DEFAULT,
        solid: SolidOptions::DEFAULT,
        unseen: UnseenOptions::DEFAULT,
        floaters: FloatersOptions::DEFAULT,
        reshape: ReshapeOptions::DEFAULT,
        lod: LodOptions::DEFAULT,
        tiles: TilesOptions::DEFAULT,
        backdrop: BackdropOptions::DEFAULT,
        refit: RefitOptions::DEFAULT,
        lit: LitOptions::DEFAULT,
        weld: WeldOptions::DEFAULT,
        place: PlaceOptions::DEFAULT,
        chunk: ChunkOptions::DEFAULT,
        bvh: BvhOptions::DEFAULT,
        order: OrderOptions::DEFAULT,
        output: OutputOptions::DEFAULT,
    };

    /// The options of a preset: how it differs from the default.
    pub fn preset(preset: BakePreset) -> Self {
        match preset {
            BakePreset::Fast => Self {
                preset,
                teacher: TeacherOptions::OFF,
                floaters: FloatersOptions::OFF,
                reshape: ReshapeOptions::OFF,
                weld: WeldOptions::FAST,
                chunk: ChunkOptions::FAST,
                order: OrderOptions::FAST,
                ..Self::DEFAULT
            },
            BakePreset::Default => Self::DEFAULT,
            BakePreset::Small => {
                Self { preset, prune: PruneOptions::SMALL, output: OutputOptions::SMALL, ..Self::DEFAULT }
            }
        }
    }

    /// Checks the ranges that need no scene; stages check the rest.
    pub fn validate(&self) -> Result<()> {
        self.collision.validate()?;
        self.prune.validate()?;
        self.lod.validate()?;
        self.tiles.validate()?;
        if self.tiles.tiles && !self.lod.lod.is_empty() {
            let wants = "nothing: `tiles` makes levels of its own";
            return Err(Error::invalid("lod", "given with `tiles`", wants));
        }
        self.output.validate()?;
        self.place.validate()
    }
}
