//! Every option of the bake, and the presets.

use super::background::BackgroundOptions;
use super::chunk::ChunkOptions;
use super::crop::CropOptions;
use super::erase::EraseOptions;
use super::exposure::ExposureOptions;
use super::lit::LitOptions;
use super::lod::LodOptions;
use super::order::OrderOptions;
use super::place::PlaceOptions;
use super::prune::PruneOptions;
use super::refit::RefitOptions;
use super::reshape::ReshapeOptions;
use super::sh::ShOptions;
use super::sides::{Sides, SidesOptions};
use super::solid::SolidOptions;
use super::surroundings::{BackdropOptions, BackdropWhen};
use super::teacher::TeacherOptions;
use super::texture::TextureOptions;
use super::tiles::TilesOptions;
use super::unseen::UnseenOptions;
use super::weld::WeldOptions;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_formats::OutputTarget;
use trisplat_formats::output::{Output, OutputFormat, OutputOptions, SideFiles};
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{Error, Result};
use trisplat_surface::CollisionOptions;

/// A complete set of options to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum BakePreset {
    /// Only prune and make solid: one mesh in the order of the input.
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
    /// Complete set of options to start from; config file and flags override it.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub preset: BakePreset,
    /// Bake with photos that do not seem to show the scene. They decide visibility and colours.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub force_dataset: bool,
    /// The background that the scene was trained on.
    #[cfg_attr(feature = "cli", arg(skip = BackgroundOptions::DEFAULT))]
    pub background: BackgroundOptions,
    /// Region of the scene to keep.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub crop: CropOptions,
    /// Triangles to erase.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub erase: EraseOptions,
    /// Pictures of the soft scene in place of photos.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub teacher: TeacherOptions,
    /// The surface for collisions.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub collision: CollisionOptions,
    /// Triangles to drop.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub prune: PruneOptions,
    /// Conversion of soft triangles to solid ones.
    #[cfg_attr(feature = "cli", arg(skip = SolidOptions::DEFAULT))]
    pub solid: SolidOptions,
    /// Removal of triangles that photos do not show.
    #[cfg_attr(feature = "cli", arg(skip = UnseenOptions::DEFAULT))]
    pub unseen: UnseenOptions,
    /// Correction of the photos.
    #[cfg_attr(feature = "cli", arg(skip = ExposureOptions::DEFAULT))]
    pub exposure: ExposureOptions,
    /// Fitting of triangles to pictures.
    #[cfg_attr(feature = "cli", arg(skip = ReshapeOptions::DEFAULT))]
    pub reshape: ReshapeOptions,
    /// Sides from which triangles are drawn.
    #[cfg_attr(feature = "cli", arg(skip = SidesOptions::DEFAULT))]
    pub sides: SidesOptions,
    /// Levels of detail.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub lod: LodOptions,
    /// Tiles.
    #[cfg_attr(feature = "cli", arg(skip = TilesOptions::DEFAULT))]
    pub tiles: TilesOptions,
    /// The backdrop of the scene.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub backdrop: BackdropOptions,
    /// Colours from the photos.
    #[cfg_attr(feature = "cli", arg(skip = RefitOptions::DEFAULT))]
    pub refit: RefitOptions,
    /// Colours that depend on the direction.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub sh: ShOptions,
    /// Texture.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub texture: TextureOptions,
    /// Normals and a lit material.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub lit: LitOptions,
    /// Merging of equal corners into one vertex.
    #[cfg_attr(feature = "cli", arg(skip = WeldOptions::DEFAULT))]
    pub weld: WeldOptions,
    /// The frame of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub place: PlaceOptions,
    /// Chunks.
    #[cfg_attr(feature = "cli", arg(skip = ChunkOptions::DEFAULT))]
    pub chunk: ChunkOptions,
    /// The order of triangles.
    #[cfg_attr(feature = "cli", arg(skip = OrderOptions::DEFAULT))]
    pub order: OrderOptions,
    /// The files to write, for the writer of the asset.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: OutputOptions,
}

impl BakeOptions {
    /// Every option at its default.
    pub const DEFAULT: Self = Self {
        preset: BakePreset::Default,
        force_dataset: false,
        background: BackgroundOptions::DEFAULT,
        crop: CropOptions::DEFAULT,
        erase: EraseOptions::DEFAULT,
        teacher: TeacherOptions::DEFAULT,
        collision: CollisionOptions::DEFAULT,
        prune: PruneOptions::DEFAULT,
        solid: SolidOptions::DEFAULT,
        unseen: UnseenOptions::DEFAULT,
        exposure: ExposureOptions::DEFAULT,
        reshape: ReshapeOptions::DEFAULT,
        sides: SidesOptions::DEFAULT,
        lod: LodOptions::DEFAULT,
        tiles: TilesOptions::DEFAULT,
        backdrop: BackdropOptions::DEFAULT,
        refit: RefitOptions::DEFAULT,
        sh: ShOptions::DEFAULT,
        texture: TextureOptions::DEFAULT,
        lit: LitOptions::DEFAULT,
        weld: WeldOptions::DEFAULT,
        place: PlaceOptions::DEFAULT,
        chunk: ChunkOptions::DEFAULT,
        order: OrderOptions::DEFAULT,
        output: OutputOptions::DEFAULT,
    };

    /// The options of a preset: how it differs from the default.
    pub fn preset(preset: BakePreset) -> Self {
        match preset {
            BakePreset::Fast => Self {
                preset,
                background: BackgroundOptions::OFF,
                teacher: TeacherOptions::OFF,
                exposure: ExposureOptions::OFF,
                reshape: ReshapeOptions::OFF,
                sides: SidesOptions::FAST,
                weld: WeldOptions::FAST,
                chunk: ChunkOptions::FAST,
                order: OrderOptions::FAST,
                ..Self::DEFAULT
            },
            BakePreset::Default => Self::DEFAULT,
            BakePreset::Small => Self {
                preset,
                prune: PruneOptions::SMALL,
                output: OutputOptions::SMALL,
                ..Self::DEFAULT
            },
        }
    }

    /// The same for a scene of photos: view-dependent colours, where photos gain by them.
    pub fn preset_for_photos(preset: BakePreset) -> Self {
        Self { sh: ShOptions::AUTO, ..Self::preset(preset) }
    }

    /// The options of the preset `fast`.
    pub fn fast() -> Self {
        Self::preset(BakePreset::Fast)
    }

    /// The options of the preset `small`.
    pub fn small() -> Self {
        Self::preset(BakePreset::Small)
    }

    /// With files for this engine.
    pub fn target(mut self, target: OutputTarget) -> Self {
        self.output.target = target;
        self
    }

    /// With at most this many triangles, the ones that add most to the picture.
    pub fn max_triangles(mut self, count: u64) -> Self {
        self.prune.max_triangles = Some(count);
        self
    }

    /// The files of a bake to `path`; `format` decides where the name has no known ending. Sets
    /// `tiles`, because a scene is cut into tiles exactly when tiles are written, and both `sides`
    /// where the format says nothing of them.
    ///
    /// # Errors
    ///
    /// A name without a known ending; tiles in another format; one file where the options need
    /// several.
    pub fn plan_output(&mut self, path: &Path, format: Option<OutputFormat>) -> Result<Output> {
        let format = format.map_or_else(|| OutputFormat::of(path), Ok)?;
        if self.tiles.tiles && format != OutputFormat::Tiles {
            let wants = "a name ending in .tileset.json, which `tiles` writes";
            return Err(Error::invalid("output", path.display(), wants));
        }
        self.texture.check_format(path, format)?;
        self.tiles.tiles = format == OutputFormat::Tiles;
        if !format.has_sides() {
            self.sides.sides = Sides::Both;
        }
        self.validate()?;
        let side_files = SideFiles {
            levels: self.lod.lod.len(),
            backdrop: self.backdrop.backdrop == BackdropWhen::File,
            sky: self.backdrop.backdrop == BackdropWhen::Sky,
            collision: self.collision.collision,
            texture: self.texture.is_wanted(),
        };
        Output::of_scene(path, Some(format), &self.output, &side_files)
    }

    /// Checks the ranges that need no scene; stages check the rest.
    pub fn validate(&self) -> Result<()> {
        self.lod.validate()?;
        self.erase.validate()?;
        ranges::check(self, OptionNaming::Flag)?;
        ranges::check_finite("max_error", self.unseen.max_error)?;
        if self.tiles.tiles && !self.lod.lod.is_empty() {
            let wants = "nothing: `tiles` makes levels of its own";
            return Err(Error::invalid("lod", "given with `tiles`", wants));
        }
        self.place.validate()
    }
}
