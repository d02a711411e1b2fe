//! From camera photos or a video to a data set with poses. COLMAP or pycolmap finds the poses, if
//! one is installed.
//!
//! In: photos and videos without poses. Out: a folder with photos and poses, found by another program, and a verdict.

mod collect;
mod exif;
mod exposure;
mod folder;
mod frames;
mod logged;
mod names;
mod options;
mod poses;
mod program;
mod recipe;
mod sheet;
mod source;
mod step;
mod stored;
mod verdict;
mod video;

pub use collect::PhotosDetails;
pub use options::{CaptureOptions, Mapper};
pub use poses::{FeaturesDetails, MatchesDetails, ModelDetails};
pub use recipe::{Capture, check_apart};
pub use source::{camera_files, is_camera_file};
pub use verdict::{Gap, Verdict, VerdictDetails};
