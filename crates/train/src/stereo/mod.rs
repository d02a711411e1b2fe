//! Multi-view stereo: surfaces that are measured in the photos and not trained.
//!
//! ```text
//! tracked points ──► propagation ──► anchors: what blocks, misses or leaves open a measured surface
//!                └──► photo_depths: the depths of each photo, for a surface
//! no points      ──► sparse_points: the same matching, searched over all depths
//! depth maps     ──► both: planes to begin with, and planes where photos have no texture
//! ```

mod anchors;
mod color_agreement;
mod consistency;
mod gray_image;
mod matching;
mod photo_depths;
mod propagation;
mod sparse_points;

pub(crate) use anchors::{DepthAnchors, DepthRepair};
pub use photo_depths::{DepthsDetails, measure_depths};
pub use sparse_points::reconstruct_points;
