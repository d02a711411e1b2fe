//! From camera photos or a video to a data set with poses. COLMAP or pycolmap finds the poses, if
//! one is installed.

mod collect;
mod heic;
mod kind;
mod log;
mod poses;
mod program;
mod recipe;
mod source;
mod verdict;
mod video;

pub use collect::PhotosDetails;
pub use poses::{FeaturesDetails, MatchesDetails, ModelDetails};
pub use program::{CaptureOptions, Mapper};
pub use recipe::{Capture, check_apart};
pub use source::{camera_files, is_camera_file};
pub use verdict::{CaptureVerdict, Gap, VerdictDetails};
