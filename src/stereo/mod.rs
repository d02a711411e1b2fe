//! Surfaces from posed photos before any training: depth, normal and confidence of each pixel by patch match
//! with slanted planes (Bleyer et al. 2011), in chequerboard order (Galliani et al. 2015), with consistent
//! depths (Schönberger et al. 2016), from small to large pictures (Xu and Tao 2019).

mod agree;
pub mod depth_map;
mod details;
mod estimate;
mod facets;
mod fuse;
mod neighbors;
pub mod options;
mod patch;
mod picture;
mod pictures;
mod plane;
pub mod points;
mod smooth;
mod sweep;
mod warp;

pub use depth_map::DepthMap;
pub use details::StereoDetails;
pub use estimate::estimate;
pub use facets::{Facet, facets};
pub use fuse::{SurfacePoint, fuse};
pub use options::StereoOptions;
pub use pictures::picture;
