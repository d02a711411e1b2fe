//! Work on other threads than the window's, and their messages.

use super::super::layout::{Aabb, VertexLayout};
use super::super::model::{Model, ModelGroups};
use super::super::renderer::{DisplayMode, FrameParams, Renderer};
use super::scene::{SceneChange, SceneFiles, SceneLoader, SoftRenderer, WindowScene};
use crate::headless::Canvas;
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_gpu::Gpu;
use trisplat_scene::{
    Asset, Error, Placement, Region, Result,
    camera::{Camera, Viewpoint},
    image::RgbImage,
};
use winit::event_loop::EventLoopProxy;

/// A message from a thread to the window.
pub(super) enum Message {
    /// What the loader is doing.
    Progress(String),
    /// The scene is loaded and in GPU memory.
    ImportedScene(Result<Box<LoadedScene>>),
    /// The first scene has changed; the new state is in GPU memory.
    Changed(Result<Box<LoadedScene>>),
    /// The scene will not change any more, with a final note; `None`: there is nothing more to show.
    Final(Option<String>),
    /// A photo is decoded.
    Photo(usize, Result<RgbImage>),
    /// A soft picture is drawn.
    Soft(Camera, RgbImage),
    /// Returns the renderer of soft pictures.
    Rested(SoftRenderer),
    /// The triangles in a region are in GPU memory.
    Cropped(Result<Box<Model>>),
    /// A region is saved.
    SavedCrop(Result<String>),
    /// A screenshot is saved.
    Saved(Result<PathBuf>),
}

/// A scene ready to be drawn.
pub(super) struct LoadedScene {
    pub(super) files: SceneFiles,
    pub(super) scene: WindowScene,
    pub(super) model: Model,
    /// The box of most of it, without outliers.
    pub(super) bounds: Aabb,
    /// The first viewpoint, if the file has one, and the distance from its target to the backdrop.
    pub(super) viewpoint: Option<(Viewpoint, f32)>,
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
    pub(super) fn load(&self, gpu: Arc<Gpu>, groups: ModelGroups, loader: SceneLoader, files: SceneFiles) {
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
    pub(super) fn follow(&self, gpu: Arc<Gpu>, groups: ModelGroups, loader: &SceneLoader, files: SceneFiles) {
        let sender = self.clone();
        let Some(follow) = loader.follow.clone() else { return };
        self.spawn(move || {
            loop {
                let changed = match follow() {
                    Ok(SceneChange::Changed(scene)) => uploaded(&gpu, &groups, files.clone(), *scene),
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
    groups: &ModelGroups,
    files: SceneFiles,
    scene: WindowScene,
) -> Result<Box<LoadedScene>> {
    let layout: VertexLayout = Renderer::best_layout(gpu, &scene.asset);
    let model = Model::upload(gpu, groups, &scene.asset, layout)?;
    let bounds = central_box(&scene.asset);
    let room = |v: Viewpoint| scene.asset.room(glam::DVec3::from(v.target).as_vec3());
    let viewpoint = scene.asset.provenance.viewpoint.map(|viewpoint| (viewpoint, room(viewpoint)));
    Ok(Box::new(LoadedScene { files, scene, model, bounds, viewpoint }))
}

/// The triangles of `asset` in a region of its file, in GPU memory.
pub(super) fn cropped(
    gpu: &Gpu,
    groups: &ModelGroups,
    asset: &Asset,
    placement: &Placement,
    region: &Region,
) -> Result<Model> {
    let inside = |face: &u32| region.holds(placement.to_world_f64(asset.mesh.centroid(*face as usize)), &[]);
    let mut mesh = asset.mesh.clone();
    mesh.select(&(0..mesh.face_count() as u32).filter(inside).collect::<Vec<_>>());
    let part = Asset::from(mesh);
    Model::upload(gpu, groups, &part, Renderer::best_layout(gpu, &part))
}

/// The box that holds the middle 96% of the scene's corners on each axis, without the backdrop, estimated from a sample of them.
fn central_box(asset: &Asset) -> Aabb {
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
    Aabb { min: Vec3::new(x.0, y.0, z.0), max: Vec3::new(x.1, y.1, z.1) }
}

/// What a screenshot shows.
pub(super) struct Screenshot {
    pub(super) model: Arc<Model>,
    pub(super) camera: Camera,
    pub(super) near: f32,
    pub(super) background: [f32; 3],
    pub(super) display: DisplayMode,
    pub(super) wireframe: bool,
    pub(super) msaa: u32,
}

/// Draws the scene again, without the panel.
pub(super) fn draw_screenshot(gpu: &Gpu, of: &Screenshot) -> Result<RgbImage> {
    let mut renderer = Renderer::new(gpu)?;
    let canvas = Canvas::new(gpu, of.camera.size, of.msaa)?;
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let params = FrameParams {
        camera: of.camera,
        near: of.near,
        background: of.background,
        display: of.display,
        wireframe: of.wireframe,
    };
    canvas.draw(gpu, &mut renderer, &mut encoder, &of.model, &params, None)?;
    gpu.queue.submit([encoder.finish()]);
    canvas.pixels(gpu)
}

/// Saves a picture under the first free name of trisplat-0001.png, trisplat-0002.png, …
pub(super) fn save(folder: &Path, picture: &RgbImage) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let free = (1..10_000).map(|i| folder.join(format!("trisplat-{i:04}.png"))).find(|p| !p.exists());
    let path = free
        .ok_or_else(|| Error::invalid("screenshots", folder.display(), "a folder with fewer screenshots"))?;
    picture.save_png(&path)?;
    Ok(path)
}
