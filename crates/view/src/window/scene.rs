//! Appearance of a window, its content and its loader.

use super::crop::CropEditor;
use crate::model::Model;
use crate::model::ModelLayouts;
use crate::renderer::{AssetRenderer, Canvas, FrameParams};
use glam::{UVec2, Vec3};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use trisplat_gpu::{AdapterOptions, Gpu};
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Asset, Error, Placement, Region, Result};
use winit::event_loop::EventLoopProxy;

/// Appearance of a window.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// Initial width and height, px.
    pub size: UVec2,
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// Samples per pixel at edges (MSAA): 1 or 4.
    pub msaa: u32,
    /// Show pictures at the vertical blank of the screen.
    pub vsync: bool,
    /// Folder for screenshots.
    pub screenshots: PathBuf,
    /// The remedy when no window can be opened.
    pub remedy: &'static str,
    /// Graphics card.
    pub adapter: AdapterOptions,
}

/// Content of a window.
pub struct WindowScene {
    /// The triangles.
    pub asset: Arc<Asset>,
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

/// The files to open: a scene, and photos of it.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFiles {
    /// A scene of any format that is read.
    pub file: PathBuf,
    /// A data set, if any.
    pub dataset: Option<PathBuf>,
}

impl SceneFiles {
    /// The files to open when `path` is dropped on the window: a folder or a `.json` is a data set
    /// of the same scene, any other file is another scene.
    pub fn with_dropped(&self, path: &Path) -> Self {
        let is_dataset =
            path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        if is_dataset {
            Self { dataset: Some(path.to_owned()), ..self.clone() }
        } else {
            Self { file: path.to_owned(), dataset: None }
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
#[derive(Clone)]
pub struct SoupSource {
    /// Draws it with the soft rasteriser for a camera in the frame of the asset; called on a thread
    /// of its own.
    pub renderer: SoftRenderer,
    /// Pause after a picture, as a multiple of its duration: more than 0 if other work needs the
    /// CPU.
    pub rest: f64,
}

/// Saves a region of a file for the bake; returns a note for the user. Called on a thread of its
/// own.
pub(super) type CropSaver = Arc<dyn Fn(&Region) -> Result<String> + Send + Sync>;

/// Draws what a camera sees.
pub(super) type SoftRenderer = Arc<Mutex<dyn FnMut(&Camera) -> RgbImage + Send>>;

/// Loads what a window shows.
#[derive(Clone)]
pub struct SceneLoader {
    /// Makes the scene of some files and reports its progress; called on a thread of its own.
    #[allow(clippy::type_complexity, reason = "it is called once, here")]
    pub load: Arc<dyn Fn(&SceneFiles, &dyn Fn(&str)) -> Result<WindowScene> + Send + Sync>,
    /// Waits for the next change of the first scene; `None` for a static one. Called repeatedly on
    /// a thread of its own, until the scene has ended.
    pub follow: Option<SceneFollower>,
}

/// Waits for the changes of a scene.
pub(super) type SceneFollower = Arc<dyn Fn() -> Result<SceneChange> + Send + Sync>;

/// A change of a shown scene.
pub enum SceneChange {
    /// Changed content.
    Changed(Box<WindowScene>),
    /// Final content, with a note.
    Final(String),
    /// There is nothing more to show: the window closes.
    Gone,
}

// ---- Work on other threads than the window's, and their messages --------------------------------

/// A message from a thread to the window.
pub(super) enum Message {
    /// Present work of the loader.
    Progress(String),
    /// The scene is loaded and in GPU memory.
    ImportedScene(Result<Box<ShownScene>>),
    /// The first scene has changed; the new state is in GPU memory.
    Changed(Result<Box<ShownScene>>),
    /// The scene will not change any more, with a final note; `None`: there is nothing more to
    /// show.
    Final(Option<String>),
    /// A photo is decoded.
    Photo(usize, Result<RgbImage>),
    /// A soft picture is drawn.
    Soft(Camera, RgbImage),
    /// The renderer of soft pictures is free again.
    Rested,
    /// The triangles in a region are in GPU memory.
    Cropped(Result<Box<Model>>),
    /// A region is saved.
    SavedCrop(Result<String>),
    /// A screenshot is saved.
    Saved(Result<PathBuf>),
}

/// A scene in GPU memory.
pub(super) struct ShownScene {
    pub(super) files: SceneFiles,
    pub(super) scene: WindowScene,
    pub(super) model: Arc<Model>,
    /// The box of most of it, without outliers.
    pub(super) bounds: [Vec3; 2],
    /// The first viewpoint, if the file has one, and the distance from its target at which the
    /// scene is closed.
    pub(super) viewpoint: Option<(Viewpoint, f32)>,
    pub(super) crop: CropEditor,
}

impl ShownScene {
    /// The photo taken nearest to the first viewpoint; the first one when there is none.
    pub(super) fn first_photo(&self) -> Option<usize> {
        let eye = self.viewpoint.map(|(viewpoint, _)| glam::DVec3::from(viewpoint.eye).as_vec3());
        let away = |i: &usize| {
            eye.map_or(0.0, |eye| self.scene.photos[*i].camera.position().distance(eye))
        };
        (0..self.scene.photos.len()).min_by(|a, b| away(a).total_cmp(&away(b)))
    }
}

/// Sends messages of other threads to the window.
#[derive(Clone)]
pub(super) struct MessageSender {
    pub(super) proxy: EventLoopProxy<SceneMessage>,
    /// The scene it works on.
    pub(super) scene: u32,
}

/// A message and the number of its scene; messages about an earlier scene are ignored.
pub(super) struct SceneMessage {
    pub(super) scene: u32,
    pub(super) message: Message,
}

impl MessageSender {
    /// Runs `work` on another thread and sends its message.
    pub(super) fn spawn(&self, work: impl FnOnce() -> Message + Send + 'static) {
        let sender = self.clone();
        std::thread::spawn(move || sender.send(work()));
    }

    pub(super) fn send(&self, message: Message) {
        // The receiver no longer exists if the window was closed meanwhile.
        let _ = self.proxy.send_event(SceneMessage { scene: self.scene, message });
    }

    /// Loads the scene and uploads it to GPU memory.
    pub(super) fn load(
        &self,
        gpu: Arc<Gpu>,
        groups: ModelLayouts,
        loader: SceneLoader,
        files: SceneFiles,
    ) {
        let sender = self.clone();
        self.spawn(move || {
            let progress = |what: &str| sender.send(Message::Progress(what.to_owned()));
            let load = || {
                let scene = (loader.load)(&files, &progress)?;
                progress("uploading to the graphics card");
                uploaded(&gpu, &groups, files, scene)
            };
            Message::ImportedScene(load())
        });
    }

    /// Shows changes of the scene of `files`, until it has ended.
    pub(super) fn follow(
        &self,
        gpu: Arc<Gpu>,
        groups: ModelLayouts,
        loader: &SceneLoader,
        files: SceneFiles,
    ) {
        let sender = self.clone();
        let Some(follow) = loader.follow.clone() else { return };
        self.spawn(move || {
            loop {
                let changed = match follow() {
                    Ok(SceneChange::Changed(scene)) => {
                        uploaded(&gpu, &groups, files.clone(), *scene)
                    }
                    Ok(SceneChange::Final(what)) => return Message::Final(Some(what)),
                    Ok(SceneChange::Gone) => return Message::Final(None),
                    Err(error) => Err(error),
                };
                sender.send(Message::Changed(changed));
            }
        });
    }
}

/// `scene` in GPU memory.
fn uploaded(
    gpu: &Gpu,
    groups: &ModelLayouts,
    files: SceneFiles,
    scene: WindowScene,
) -> Result<Box<ShownScene>> {
    let model = Arc::new(Model::upload(gpu, groups, &scene.asset)?);
    let bounds = central_box(&scene.asset);
    let room =
        |v: Viewpoint| scene.asset.distance_to_backdrop(glam::DVec3::from(v.target).as_vec3());
    let viewpoint = scene.asset.provenance.viewpoint.map(|viewpoint| (viewpoint, room(viewpoint)));
    let crop = CropEditor::around(&bounds, |point| scene.placement.to_world_f64(point));
    Ok(Box::new(ShownScene { files, scene, model, bounds, viewpoint, crop }))
}

/// The triangles of `asset` in a region of its file, in GPU memory.
pub(super) fn cropped(
    gpu: &Gpu,
    groups: &ModelLayouts,
    asset: &Asset,
    placement: &Placement,
    region: &Region,
) -> Result<Model> {
    let inside =
        |face: &u32| region.holds(placement.to_world_f64(asset.mesh.centroid(*face as usize)), &[]);
    let mut mesh = asset.mesh.clone();
    mesh.select(&(0..mesh.face_count() as u32).filter(inside).collect::<Vec<_>>());
    Model::upload(gpu, groups, &Asset::from(mesh))
}

/// The box that holds the middle 96% of the scene's corners on each axis, without the backdrop,
/// estimated from a sample of them.
fn central_box(asset: &Asset) -> [Vec3; 2] {
    let faces = asset.scene_faces();
    let step = (faces / 33_333).max(1);
    let corners = || (0..faces).step_by(step).flat_map(|face| asset.mesh.corners(face));
    let axis = |axis: usize| {
        let mut values: Vec<f32> = corners().map(|p| p[axis]).collect();
        values.sort_unstable_by(f32::total_cmp);
        let last = values.len().saturating_sub(1);
        let at = |i: usize| values.get(i).copied().unwrap_or(0.0);
        (at(last / 50), at(last - last / 50))
    };
    let [x, y, z] = [0, 1, 2].map(axis);
    [Vec3::new(x.0, y.0, z.0), Vec3::new(x.1, y.1, z.1)]
}

/// Draws the scene again, without the panel.
pub(super) fn draw_screenshot(gpu: &Gpu, model: &Model, params: &FrameParams) -> Result<RgbImage> {
    let mut renderer = AssetRenderer::new(gpu)?;
    let canvas = Canvas::new(gpu, params.camera.size, params.msaa)?;
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    renderer.draw(gpu, &mut encoder, canvas.output(), model, params)?;
    gpu.queue.submit([encoder.finish()]);
    canvas.pixels(gpu)
}

/// Saves a picture under the first free name of trisplat-0001.png, trisplat-0002.png, …
pub(super) fn save(folder: &Path, picture: &RgbImage) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let free =
        (1..10_000).map(|i| folder.join(format!("trisplat-{i:04}.png"))).find(|p| !p.exists());
    let path = free.ok_or_else(|| {
        Error::invalid("screenshots", folder.display(), "a folder with fewer screenshots")
    })?;
    picture.save_png(&path)?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drop_of_a_folder_is_a_data_set_and_of_a_file_a_scene() {
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
