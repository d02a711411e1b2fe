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
mod kind;
mod lens;
mod load;
mod options;
mod paths;
mod phone;
mod photo;
mod photos;
mod picture_file;
mod point_file;
mod point_ply;
mod posed;
mod shrunk;
mod silhouettes;
mod split;
pub mod synthetic;
mod synthetic_scene;
mod tracks;
mod transforms;
mod undistort;

pub use describe::{Description, describe};
pub use kind::DatasetKind;
pub use lens::{Distortion, Lens};
pub use options::{Background, DatasetOptions, Masks};
pub use phone::{PhoneTruth, PhotoTruth, TRUTH_FILE};
pub use photo::Photo;
pub use photos::Photos;
pub use picture_file::{PictureFile, StoredPicture};
pub use posed::{Dataset, Point, Reprojection, View};
pub use shrunk::ShrunkSize;
pub use split::Split;
pub use synthetic_scene::{Ray, trace, visible};
pub use tracks::{TrackedPhoto, Tracks, tracks};
