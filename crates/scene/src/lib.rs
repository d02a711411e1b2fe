//! Scenes, cameras, pictures and numbers of trisplat.
//!
//! In: nothing. Out: soups, meshes, scenes, splats, cameras, pictures, assets, rays; numbers,
//! errors, reports; files that are read within limits and appear whole.

mod asset;
pub mod atlas;
pub mod atomic;
mod bounds;
pub mod camera;
mod error;
mod face_sh;
mod floaters;
pub mod frames;
pub mod image;
mod imported_splats;
pub mod input;
mod kept_rows;
pub mod layered;
mod limits;
pub mod math;
pub mod mesh;
mod normalization;
pub mod parallel;
pub mod process;
pub mod ranges;
mod raycast;
mod region;
pub mod report;
mod rng;
mod scene;
mod soup;
mod splats;
pub mod stored_cameras;
mod texture;

pub use asset::{
    Asset, Chunk, Placement, Provenance, SurroundingsStorage, Tile, UpAxis, UpDirection,
};
pub use bounds::Bounds;
pub use error::{Error, Result, cut, excerpt, first_of};
pub use face_sh::{FaceSh, MAX_SH_DEGREE, MAX_SH_PICTURE_SIDE};
pub use floaters::Floaters;
pub use imported_splats::ImportedSplats;
pub use limits::{Budget, BudgetClock, Limits, Seconds, Spending};
pub use normalization::SceneNormalization;
pub use raycast::{Hit, RayTree};
pub use region::Region;
pub use rng::Rng;
pub use scene::{ImportedScene, Scene};
pub use soup::{SH_C0, Soup, rgb_from_sh0, sh_count, sh0_from_rgb};
pub use splats::{ScreenFilter, Splats};
pub use texture::{
    FaceTexture, StoredPicture, TexelFilter, Texture, TextureStyle, pack_rectangles,
};
