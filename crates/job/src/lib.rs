//! Turns options into a run: the decisions between options and work, for every user of the library.
//!
//! ```text
//! options in layers ──► plan ──► preparation ──► run ──► report
//!  preset < file < given   teacher, budget   its teacher, pictures
//! ```
//!
//! In: a request and options in layers. Out: a finished run with its report.

mod any_scene;
mod baking;
mod convenience;
mod evaluate;
mod event;
mod exposure;
mod extrapolation;
mod gaussians;
mod grade;
mod harden;
mod inputs;
mod making;
mod meshing;
mod photo_check;
mod renderer;
mod rendering;
mod representations;
mod scores;
mod shine;
mod size_limit;
mod teacher;
mod training;

pub use any_scene::AnyScene;
pub use baking::{BakeInput, BakeJob, Baked};
pub use convenience::{Renderer, bake, read, read_bytes, score, write};
pub use evaluate::{EvalJob, ReadyEval};
pub use event::{Event, MakePart, Observer, TrainBegins, TrainPart};
pub use extrapolation::{CoverageScores, DepthScores};
pub use grade::Grade;
pub use harden::{HARDEN_STEPS, MAX_TEACHER_SHARE};
pub use inputs::{describe, files_of};
pub use making::{MakeDone, MakeJob};
pub use meshing::MeshJob;
pub use renderer::{BakedScene, RenderMode, RenderOptions, SceneRenderer};
pub use rendering::{PictureKind, ReadyRender, RenderJob, WIDTH};
pub use scores::{EvalReport, ImageScore, RepresentationScore, ScoredPicture, Scores};
pub use shine::ShineScores;
pub use teacher::{TEACHER_FILE, TeacherPlan, TeacherSource};
pub use training::{TrainJob, TrainResult, reading, train};
