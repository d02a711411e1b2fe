//! Posed photos in: COLMAP models and `transforms.json` files become cameras, lazily decoded photos
//! and a sparse cloud of points.
//!
//! In: folders of photos with poses. Out: cameras, photos decoded on demand, points, exposures.

pub mod capture;
mod colmap;
mod colmap_binary;
mod colmap_model;
mod colmap_text;
mod describe;
mod exif;
pub mod exposure;
mod found;
mod lens;
mod load;
mod options;
mod photo;
mod photos;
mod points;
mod posed;
mod transforms;

pub use describe::{Description, describe};
pub use lens::{Distortion, Lens};
pub use options::{Background, DatasetOptions, Masks};
pub use photo::{Photo, PictureFile, StoredPicture};
pub use photos::Photos;
pub use points::random_points;
pub use posed::{Dataset, DatasetKind, Point, Reprojection, ShrunkSize, Split, View};
