//! Turns options into a run: the decisions between options and work, for every user of the library.
//!
//! ```text
//! options in layers ──► plan ──► preparation ──► run ──► report
//!  preset < file < given   teacher, budget   its teacher, pictures
//! ```
//!
//! In: a request and options in layers. Out: a finished run with its report.

mod baking;
mod evaluate;
mod event;
mod exposure;
mod fitted;
mod gaussians;
mod harden;
mod inputs;
mod making;
mod meshing;
mod off_camera;
mod photo_check;
mod plain;
mod renderer;
mod rendering;
mod scores;
mod steps;
mod teacher;
mod training;

pub use baking::{BakeDone, BakeInput, BakeJob};
pub use evaluate::{EvalJob, ReadyEval};
pub use event::{Event, MakePart, Observer, TrainBegins, TrainPart};
pub use harden::{HARDEN_STEPS, MAX_TEACHER_SHARE};
pub use inputs::{describe, files_of};
pub use making::{MakeDone, MakeJob};
pub use meshing::MeshJob;
pub use off_camera::{BesideScores, DepthScores};
pub use plain::{Baked, Renderer, bake, read, read_bytes, score};
pub use renderer::{BakedScene, RenderOptions, SceneRenderer};
pub use rendering::{PictureKind, ReadyRender, RenderJob, WIDTH};
pub use scores::{EvalReport, ScoredPicture, Scores, StepScore};
pub use teacher::{TEACHER_FILE, TeacherPlan, TeacherSource};
pub use training::{TrainDone, TrainJob, reading, train};
