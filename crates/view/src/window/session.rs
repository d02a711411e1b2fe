//! The present content of the window, and its settings.

use super::super::model::Model;
use super::super::renderer::{DrawStats, FrameParams};
use super::controls::{CameraControls, Pane};
use super::scene::{SceneFiles, ShownScene, WindowOptions};
use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use glam::{UVec2, Vec2, Vec3};
use std::collections::HashSet;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trisplat_scene::Region;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::geometry::bounds;
use winit::keyboard::KeyCode;

/// Duration of a note.
const NOTE_TIME: Duration = Duration::from_secs(4);

/// Settings of the user.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Settings {
    /// The soup as it was trained instead of the solid triangles.
    pub(super) soft: bool,
    pub(super) wireframe: bool,
    pub(super) photo: PhotoPlacement,
    /// The panel is hidden.
    pub(super) no_panel: bool,
}

/// Place of a photo in the window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum PhotoPlacement {
    #[default]
    Off,
    Beside,
    Over,
}

/// The state of the window, except what is on the graphics card.
pub(super) struct Session {
    pub(super) settings: Settings,
    pub(super) controls: CameraControls,
    /// The held keys.
    pub(super) keys: HashSet<KeyCode>,
    pub(super) shown: Option<Box<ShownScene>>,
    /// The files shown, or loaded first.
    pub(super) files: SceneFiles,
    /// The number of the shown scene or state: 0 for the first.
    pub(super) scene: u32,
    /// The last assigned number.
    last_number: u32,
    /// The number of the scene that is being loaded.
    pub(super) loading: Option<u32>,
    /// The present state of the scene.
    pub(super) status: Option<String>,
    /// The shown note, and its start time.
    pub(super) note: Option<(String, Instant)>,
    /// The photo whose camera was taken last.
    pub(super) current: Option<usize>,
    /// The photo that is decoded.
    pub(super) photo: Option<(usize, TextureHandle)>,
    /// The photo being decoded.
    pub(super) decoding: Option<usize>,
    /// The soft picture and the camera it was drawn for.
    pub(super) soft: Option<(Camera, TextureHandle, RgbImage)>,
    /// True if that picture shows an older state of the scene.
    pub(super) soft_is_old: bool,
    /// The renderer of soft pictures works or rests.
    pub(super) drawing_soft: bool,
    /// The triangles in the region.
    pub(super) cropped: Option<Arc<Model>>,
    /// The region of these, or of those being uploaded.
    pub(super) cropped_to: Option<Region>,
    /// True during their upload.
    pub(super) cropping: bool,
    /// True to save the region.
    pub(super) saving_crop: bool,
    pub(super) meter: Meter,
    pub(super) drawn: DrawStats,
    pub(super) gpu_name: String,
    /// The camera of the last picture.
    pub(super) camera: Option<Camera>,
    /// The part of the window for the picture.
    pub(super) pane: Pane,
}

impl Session {
    pub(super) fn new(gpu_name: String, files: SceneFiles) -> Self {
        Self {
            settings: Settings::default(),
            controls: CameraControls::new(&[Vec3::NEG_ONE, Vec3::ONE], Vec3::Y),
            keys: HashSet::new(),
            shown: None,
            files,
            scene: 0,
            last_number: 0,
            loading: Some(0),
            status: None,
            note: Some(("loading".into(), Instant::now())),
            current: None,
            photo: None,
            decoding: None,
            soft: None,
            soft_is_old: false,
            drawing_soft: false,
            cropped: None,
            cropped_to: None,
            cropping: false,
            saving_crop: false,
            meter: Meter::default(),
            drawn: DrawStats::default(),
            gpu_name,
            camera: None,
            pane: Pane { min: Vec2::ZERO, size: Vec2::ONE },
        }
    }

    /// Shows a scene: from the photo nearest to its first viewpoint, from there, or as a whole.
    pub(super) fn show(&mut self, mut loaded: Box<ShownScene>) {
        // The same scene may come again with other photos.
        if let Some(before) = self.shown.take_if(|_| self.files.file == loaded.files.file) {
            loaded.crop = before.crop;
        }
        self.files = loaded.files.clone();
        self.photo = None;
        self.soft = None;
        self.current = None;
        self.note = None;
        self.controls = CameraControls::new(&loaded.bounds, loaded.scene.up);
        let viewpoint = loaded.viewpoint;
        let nearest = loaded.first_photo();
        self.put(loaded);
        if let Some(nearest) = nearest {
            self.jump(nearest);
        } else if let Some((viewpoint, _)) = viewpoint {
            self.controls.move_to(&viewpoint.camera(UVec2::new(1600, 1000)));
            self.controls.set_pivot_distance(viewpoint.distance());
        }
    }

    /// Shows the new state of the scene, from the present view.
    pub(super) fn change(&mut self, mut changed: Box<ShownScene>) {
        // Another file may have been dropped on the window meanwhile.
        let Some(before) = self.shown.take_if(|_| self.files == changed.files) else { return };
        self.scene = self.next_number();
        self.soft_is_old = true;
        self.controls.change_frame(&before.scene.placement, &changed.scene.placement);
        changed.crop = before.crop;
        self.put(changed);
    }

    /// Shows a scene or a state of it, and forgets the work on the one before.
    fn put(&mut self, mut shown: Box<ShownScene>) {
        self.cropped = None;
        self.cropped_to = None;
        self.cropping = false;
        self.decoding = None;
        self.drawing_soft = false;
        self.status = shown.scene.status.take();
        if let Some((viewpoint, _)) = &shown.viewpoint {
            self.controls.stay_within(viewpoint);
        }
        self.shown = Some(shown);
    }

    /// The number of the next scene or state.
    pub(super) fn next_number(&mut self) -> u32 {
        self.last_number += 1;
        self.last_number
    }

    /// The region to draw; `None` for everything.
    pub(super) fn region(&self) -> Option<Region> {
        self.shown.as_ref().and_then(|shown| shown.crop.region())
    }

    /// The triangles to draw: those of the region once they are uploaded.
    pub(super) fn model(&self) -> Option<&Arc<Model>> {
        let cropped = self.region().and(self.cropped.as_ref());
        cropped.or(self.shown.as_ref().map(|shown| &shown.model))
    }

    /// Moves the region to the pivot of the view.
    pub(super) fn move_crop_here(&mut self) {
        if let Some(shown) = &mut self.shown {
            shown.crop.move_to(shown.scene.placement.to_world_f64(self.controls.pivot()));
        }
    }

    /// Shows a note for a while.
    pub(super) fn notify(&mut self, what: String) {
        self.note = Some((what, Instant::now()));
    }

    /// Removes an expired note; returns the remaining time of a shown one.
    pub(super) fn expire_note(&mut self) -> Option<Duration> {
        let (_, since) = self.note.as_ref().filter(|_| self.shown.is_some())?;
        let left = NOTE_TIME.checked_sub(since.elapsed());
        if left.is_none() {
            self.note = None;
        }
        left
    }

    /// Takes the camera of photo `index`.
    pub(super) fn jump(&mut self, index: usize) {
        let Some(photo) = self.shown.as_ref().and_then(|s| s.scene.photos.get(index)) else {
            return;
        };
        self.controls.move_to(&photo.camera);
        if let Some((viewpoint, _)) = self.shown.as_ref().and_then(|shown| shown.viewpoint) {
            self.controls.orbit_at_depth_of(glam::DVec3::from(viewpoint.target).as_vec3());
        }
        self.current = Some(index);
    }

    /// Jumps to the next photo, or with -1 to the previous one.
    pub(super) fn step(&mut self, by: isize) {
        let count = self.shown.as_ref().map_or(0, |s| s.scene.photos.len());
        if count > 0 {
            let from = self.current.map_or(if by > 0 { -1 } else { 0 }, |i| i as isize);
            self.jump((from + by).rem_euclid(count as isize) as usize);
        }
    }

    /// Brings the subject, or the cropped region, into view.
    pub(super) fn frame(&mut self) {
        if let Some(shown) = &self.shown {
            let of_crop = || {
                let ends = shown.crop.lines().into_iter().flatten();
                let at = |p: glam::DVec3| shown.scene.placement.to_file(p.as_vec3());
                bounds(ends.map(at)).unwrap_or_default()
            };
            let subject =
                shown.viewpoint.and_then(|(v, room)| Some((v.target, v.radius? as f32, room)));
            match subject.filter(|_| !shown.crop.on) {
                Some((target, radius, room)) => {
                    self.controls.frame_ball(glam::DVec3::from(target).as_vec3(), radius, room);
                }
                None => self.controls.frame(&if shown.crop.on { of_crop() } else { shown.bounds }),
            }
            self.current = None;
        }
    }

    /// Switches to the next placement of the photo.
    pub(super) fn next_photo_placement(&mut self) {
        self.settings.photo = match self.settings.photo {
            PhotoPlacement::Off => PhotoPlacement::Beside,
            PhotoPlacement::Beside => PhotoPlacement::Over,
            PhotoPlacement::Over => PhotoPlacement::Off,
        };
    }

    /// Drawing options of a picture of `size`.
    pub(super) fn frame_params(&self, size: UVec2, window: &WindowOptions) -> FrameParams {
        let camera = self.controls.camera(size, self.pane);
        let near = self.controls.near();
        let WindowOptions { background, msaa, .. } = *window;
        FrameParams { camera, near, background, wireframe: self.settings.wireframe, msaa }
    }

    /// The part of a pane for the picture beside a photo.
    pub(super) fn picture_pane(&self, pane: Pane) -> Pane {
        let beside = self.settings.photo == PhotoPlacement::Beside && self.current.is_some();
        let share = if beside { Vec2::new(0.5, 1.0) } else { Vec2::ONE };
        Pane { size: pane.size * share, ..pane }
    }
}

/// Uploads a picture as a texture of the panel.
pub(super) fn texture(context: &Context, name: &str, picture: &RgbImage) -> TextureHandle {
    let limit = context.input(|i| i.max_texture_side) as u32;
    let shrink = picture.size.max_element().div_ceil(limit.clamp(1, 4096));
    let small = picture.downscaled((picture.size / shrink.max(1)).max(UVec2::ONE));
    let size = small.size.as_usizevec2().to_array();
    let image = ColorImage::from_rgb(size, small.rgb.as_flattened());
    context.load_texture(name, image, TextureOptions::LINEAR)
}

/// Pictures per second.
#[derive(Debug, Default)]
pub(super) struct Meter {
    last: Option<Instant>,
    frame_secs: Option<f64>,
}

impl Meter {
    /// Call this for each picture; `moving` if it follows the last one without pause. Returns the
    /// seconds since the last.
    pub(super) fn tick(&mut self, moving: bool) -> f64 {
        let now = Instant::now();
        let secs = self.last.replace(now).map_or(0.0, |last| (now - last).as_secs_f64());
        if !moving {
            self.frame_secs = None;
        } else if secs > 0.0 {
            self.frame_secs = Some(self.frame_secs.map_or(secs, |mean| mean + 0.1 * (secs - mean)));
        }
        secs
    }

    /// Pictures per second; `None` while nothing moves.
    pub(super) fn fps(&self) -> Option<f64> {
        self.frame_secs.map(|secs| 1.0 / secs)
    }
}
