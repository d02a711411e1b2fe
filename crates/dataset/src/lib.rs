//! Posed photos in: COLMAP models and `transforms.json` files become cameras, lazily decoded photos
//! and a sparse cloud of points.
//!
//! In: folders of photos with poses. Out: cameras, photos decoded on demand, points, exposures.

pub mod exposure;

pub mod cloud;
mod colmap;
mod colmap_binary;
mod colmap_model;
mod colmap_text;
pub mod describe;
mod files;
mod found;
mod found_point;
mod kind;
pub mod lens;
mod load;
pub mod options;
mod paths;
pub mod phone;
pub mod photo;
pub mod photos;
pub mod picture_file;
mod point_file;
mod point_ply;
mod posed;
mod shrunk;
mod split;
pub mod synthetic;
pub mod synthetic_scene;
pub mod tracked_poses;
pub mod tracks;
mod transforms;
pub mod undistort;

pub use describe::{Description, describe};
pub use kind::DatasetKind;
pub use options::{Background, DatasetOptions, Masks};
pub use photo::Photo;
pub use photos::Photos;
pub use posed::{Dataset, Point, Reprojection, View};
pub use shrunk::ShrunkSize;
pub use split::Split;
