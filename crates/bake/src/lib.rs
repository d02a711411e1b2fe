//! The bake: a recipe of stages from a scene to an asset.
//!
//! ```text
//! background → crop → simplify → teacher → arrange → collision → prune → solid → color → unseen
//! → exposure → reshape → sides → backdrop → refit → sh → texture → lit → weld → place → viewpoint
//! → chunk → order → lod → tiles
//! ```
//!
//! Each stage is a file with its options, its function and its measurements ([`StageDetails`]); it
//! changes its input or says why there was nothing to do. The recipe calls the stages and explains
//! their order; no stage depends on the recipe. [`bake()`] is the plain case, [`Bake`] takes photos
//! and writes a report.
//!
//! Run twice, a stage has nothing to do the second time. Exceptions: `color` cannot run twice,
//! because it turns a soup into a mesh. `reshape` and `refit` come closer to the photos with every
//! pass. `place` scales again if a scale is given. `unseen` moves corners to meet a budget, and
//! these may hide other triangles.
//!
//! [`StageDetails`]: trisplat_scene::report::StageDetails
//!
//! In: a scene, and photos where there are some. Out: an asset.

mod background;
mod budget;
mod check_dataset;
mod chunk;
mod crop;
mod decimate;
mod erase;
mod exposure;
mod lit;
mod lod;
mod merge;
mod mesh;
mod options;
mod order;
mod place;
mod prune;
mod recipe;
pub mod refit;
mod reshape;
mod run;
mod sh;
mod sides;
mod simplify;
mod solid;
mod surroundings;
mod teacher;
mod texture;
mod tiles;
mod trial;
pub mod unseen;
mod viewpoint;
mod views;
mod weld;

pub use background::{BackgroundDetails, BackgroundFrom, BackgroundOptions, background};
pub use check_dataset::psnr_of_mean_color;
pub use chunk::{ChunkDetails, ChunkOptions, MAX_CHUNK_TRIANGLES, chunk};
pub use crop::{CropDetails, CropOptions};
pub use decimate::{Decimation, enlarge, rank_by_size};
pub use erase::{EraseDetails, EraseOptions};
pub use lit::{Lit, LitDetails, LitOptions, lit};
pub use lod::{FinishedLevel, LevelSource, LodDetails, LodOptions, LodRanking, lod};
pub use merge::merge;
pub use mesh::{MeshOptions, mesh};
pub use options::{BakeOptions, BakePreset};
pub use order::{ArrangeDetails, FaceOrder, OrderDetails, OrderOptions, order};
pub use place::evidence::Evidence;
pub use place::option_values::UpChoice;
pub use place::{PlaceDetails, PlaceOptions, place, placement};
pub use prune::{PruneDetails, PruneOptions, REACH, prune};
pub use recipe::BakeOutcome;
pub use reshape::{ReshapeDetails, ReshapeOptions, ReshapeWhen, SceneTraits, reshape};
pub use run::{Bake, bake};
pub use sh::{ShDegree, ShDetails, ShOptions, sh};
pub use sides::{Sides, SidesDetails, SidesOptions, sides};
pub use simplify::{SimplifyDetails, simplify};
pub use solid::{
    ColorDetails, SOLID_SIGMA, SolidDetails, SolidOptions, Solidify, area_factor, color,
    contour_factor, shrink, solid,
};
pub use surroundings::{BackdropDetails, BackdropOptions, BackdropWhen, backdrop};
pub use teacher::{
    TeacherDetails, TeacherOptions, TeacherWhen, is_solid, pictures, softness, teacher,
};
pub use texture::{TextureDetail, TextureDetails, TextureOptions, TextureWhen, texture};
pub use tiles::{TilesDetails, TilesOptions, tiles};
pub use trisplat_dataset::exposure::ExposureDetails;
pub use unseen::visible_px;
pub use viewpoint::ViewpointDetails;
pub use views::{SAMPLES, Views};
pub use weld::{WeldDetails, WeldOptions, WeldWhen, weld};
