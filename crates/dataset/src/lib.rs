//! Posed photos in: COLMAP models, `transforms.json` and the files of photogrammetry programs
//! become cameras, lazily decoded photos and a sparse cloud of points.
//!
//! In: folders of photos with poses. Out: cameras, photos decoded on demand, points, exposures.

pub mod capture;
mod colmap;
mod colmap_binary;
mod colmap_model;
mod colmap_text;
mod depth;
mod depth_scale;
mod describe;
mod exif;
mod extent;
pub mod exposure {
    //! Differences of photos in exposure, white balance, and falloff towards the corners.

    mod correction;
    mod evidence;
    mod light;
    mod own;
    mod relative;
    mod solve;

    pub use correction::{
        ExposureDetails, ExposureUse, Exposures, Solved, Strengths, Verdict, compared_size, differ,
    };
    pub use evidence::{ExposureEvidence, LeftOutPhoto};
    pub use light::{Light, compared_points, points_of};
    pub use own::own_exposures;
    pub use solve::solve;
}
mod dataset;
mod lens;
mod listing;
mod llff;
mod load;
mod masks;
mod metashape;
mod options;
mod phone_apps;
mod photo;
mod photos;
mod points;
mod pose_check;
mod realityscan;
mod silhouettes;
mod transforms;
mod views;

pub use dataset::{Dataset, DatasetKind, Point, Reprojection, ShrunkSize, Split, View};
pub use depth::{DepthFile, DepthPicture};
pub use describe::{Description, describe};
pub use lens::{Distortion, Lens, LensProjection};
pub use options::{DatasetOptions, Masks, PhotoBackground};
pub use photo::{Photo, PictureFile, StoredPhoto};
pub use photos::Photos;
pub use points::{looking_distance, random_points};
