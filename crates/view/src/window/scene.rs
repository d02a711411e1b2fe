//! How a window looks, its content, and what loads it.

use glam::{DVec3, UVec2, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_gpu::AdapterOptions;
use trisplat_scene::{Asset, Placement, Region, Result, camera::Camera, image::RgbImage};

/// How a window looks.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// Initial width and height, px.
    pub size: UVec2,
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// Samples per pixel at edges (MSAA): 1 or 4.
    pub msaa: u32,
    /// Frames per second to hold while something moves; `None` to draw every pixel always.
    pub fps: Option<f64>,
    /// Show pictures at the vertical blank of the screen.
    pub vsync: bool,
    /// Folder for screenshots.
    pub screenshots: PathBuf,
    /// The remedy when no window can be opened.
    pub remedy: &'static str,
    /// Which graphics card draws.
    pub adapter: AdapterOptions,
}

/// What a window shows.
pub struct WindowScene {
    /// The triangles.
    pub asset: Asset,
    /// The axis of the asset that points up.
    pub up: Vec3,
    /// Posed photos, in the frame of the asset.
    pub photos: Vec<WindowPhoto>,
    /// Its original soup, if any.
    pub source: Option<SoupSource>,
    /// The placement from the file's frame to the asset's.
    pub placement: Placement,
    /// Saves a region of the file for the bake; returns a note for the user.
    pub save_crop: CropSaver,
    /// Its present state, as a line of the panel.
    pub status: Option<String>,
}

impl WindowScene {
    /// From the frame of the asset to that of the file.
    pub(super) fn to_file(&self) -> impl Fn(Vec3) -> DVec3 + use<> {
        let placement = self.placement;
        move |point| placement.to_world_f64(point)
    }
}

/// The files to open: a scene, and photos of it.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFiles {
    /// A scene of any format that is read.
    pub file: PathBuf,
    /// A data set, if any.
    pub dataset: Option<PathBuf>,
}

impl SceneFiles {
    /// The files to open when `path` is dropped on the window: a folder or a `.json` is a data set of the
    /// same scene, any other file is another scene.
    pub fn with_dropped(&self, path: &Path) -> Self {
        let is_dataset = path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        match is_dataset {
            true => Self { dataset: Some(path.to_owned()), ..self.clone() },
            false => Self { file: path.to_owned(), dataset: None },
        }
    }

    /// The title of their window.
    pub fn title(&self) -> String {
        let name = self.file.file_name().unwrap_or(self.file.as_os_str()).to_string_lossy();
        format!("{name} – trisplat")
    }
}

/// A posed photo.
#[derive(Clone)]
pub struct WindowPhoto {
    /// Its name.
    pub name: String,
    /// Its camera, in the frame of the asset.
    pub camera: Camera,
    /// Decodes it; called on a thread of its own.
    pub load: Arc<dyn Fn() -> Result<RgbImage> + Send + Sync>,
}

/// The soup behind an asset.
pub struct SoupSource {
    /// Draws it with the soft rasteriser for a camera in the frame of the asset; called on a thread of its own.
    pub renderer: SoftRenderer,
    /// Pause after a picture, as a multiple of its duration: more than 0 if other work needs the CPU.
    pub rest: f64,
}

/// Saves a region of a file for the bake; returns a note for the user. Called on a thread of its own.
pub type CropSaver = Arc<dyn Fn(&Region) -> Result<String> + Send + Sync>;

/// Draws what a camera sees.
pub type SoftRenderer = Box<dyn FnMut(&Camera) -> RgbImage + Send>;

/// Loads what a window shows.
#[derive(Clone)]
pub struct SceneLoader {
    /// Makes the scene of some files and reports its progress; called on a thread of its own.
    #[allow(clippy::type_complexity, reason = "it is called once, here")]
    pub load: Arc<dyn Fn(&SceneFiles, &dyn Fn(&str)) -> Result<WindowScene> + Send + Sync>,
    /// Waits for the next change of the first scene; `None` for a static one. Called repeatedly on a thread
    /// of its own, until the scene has ended.
    pub follow: Option<SceneFollower>,
}

/// Waits for the changes of a scene.
pub type SceneFollower = Arc<dyn Fn() -> Result<SceneChange> + Send + Sync>;

/// A change of a shown scene.
pub enum SceneChange {
    /// It has changed.
    Changed(Box<WindowScene>),
    /// It will not change any more, with a final note.
    Final(String),
    /// There is nothing more to show: the window closes.
    Gone,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_dropped_is_a_data_set_of_the_same_scene_and_a_file_another_scene() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = SceneFiles { file: "a.glb".into(), dataset: Some("photos".into()) };
        let with = files.with_dropped(folder.path());
        assert_eq!(with, SceneFiles { dataset: Some(folder.path().into()), ..files.clone() });
        let with = files.with_dropped(Path::new("x/transforms.JSON"));
        assert_eq!(with.dataset.as_deref(), Some(Path::new("x/transforms.JSON")));
        let with = files.with_dropped(Path::new("x/b.ply"));
        assert_eq!(with, SceneFiles { file: "x/b.ply".into(), dataset: None });
        assert_eq!(with.title(), "b.ply – trisplat");
    }
}
