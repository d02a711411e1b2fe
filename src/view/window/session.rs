//! What the window shows at the moment, and what was chosen.

use super::super::model::{Model, Subset};
use super::super::renderer::{Drawn, Look};
use super::background::Loaded;
use super::controls::{Controls, Keys, Pane};
use super::pick::Picked;
use super::{Painter, Photo, Source};
use crate::asset::Asset;
use crate::camera::Camera;
use crate::image::Pixels;
use crate::soup::Soup;
use crate::view::layout::Bounds;
use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use glam::{UVec2, Vec2, Vec3};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long something told is to be seen.
const READING: Duration = Duration::from_secs(4);

/// What can be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Choices {
    /// The soup as it was trained instead of the solid triangles.
    pub(super) soft: bool,
    pub(super) look: Look,
    pub(super) wire: bool,
    /// Only a random share of the triangles.
    pub(super) some: bool,
    /// That share, of 1.
    pub(super) share: f64,
    /// Draw where the photos were taken.
    pub(super) cameras: bool,
    pub(super) photo: PhotoPlace,
    /// How much of the photo is seen when it lies over.
    pub(super) cover: f32,
    pub(super) panel: bool,
    /// Draw without pause.
    pub(super) always: bool,
}

impl Default for Choices {
    fn default() -> Self {
        Self {
            soft: false,
            look: Look::Color,
            wire: false,
            some: false,
            share: 0.1,
            cameras: false,
            photo: PhotoPlace::Off,
            cover: 0.5,
            panel: true,
            always: false,
        }
    }
}

/// Where a photo is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PhotoPlace {
    Off,
    Beside,
    Over,
}

/// The scene that is shown.
pub(super) struct Shown {
    pub(super) model: Arc<Model>,
    pub(super) bounds: Bounds,
    pub(super) photos: Vec<Photo>,
    pub(super) soup: Option<Arc<Soup>>,
    pub(super) to_soup: Option<Arc<dyn Fn(Vec3) -> Vec3 + Send + Sync>>,
    /// Away while it paints.
    pub(super) painter: Option<Painter>,
    pub(super) has_painter: bool,
    /// The asset with its hierarchy, once it is built.
    pub(super) asset: Option<Arc<Asset>>,
}

/// Everything about the picture but the card.
pub(super) struct Session {
    pub(super) choices: Choices,
    pub(super) controls: Controls,
    pub(super) keys: Keys,
    pub(super) shown: Option<Shown>,
    /// What the loader is at, or what there is to tell, and since when.
    pub(super) note: Option<(String, Instant)>,
    /// The photo jumped to.
    pub(super) current: Option<usize>,
    /// The photo that is decoded.
    pub(super) photo: Option<(usize, TextureHandle)>,
    /// The photo being decoded.
    pub(super) decoding: Option<usize>,
    /// The soft picture, and for which camera it was drawn.
    pub(super) soft: Option<(Camera, TextureHandle, Pixels)>,
    pub(super) subset: Option<Arc<Subset>>,
    pub(super) subset_wanted: Option<f64>,
    pub(super) picked: Option<Box<Picked>>,
    pub(super) meter: Meter,
    pub(super) drawn: Drawn,
    pub(super) card: String,
    /// The camera of the last picture.
    pub(super) camera: Option<Camera>,
    /// The part of the window that the picture is in.
    pub(super) pane: Pane,
}

impl Session {
    pub(super) fn new(card: String) -> Self {
        let bounds = Bounds { min: Vec3::NEG_ONE, max: Vec3::ONE };
        Self {
            choices: Choices::default(),
            controls: Controls::new(&bounds, Vec3::Y),
            keys: Keys::default(),
            shown: None,
            note: Some(("loading".into(), Instant::now())),
            current: None,
            photo: None,
            decoding: None,
            soft: None,
            subset: None,
            subset_wanted: None,
            picked: None,
            meter: Meter::default(),
            drawn: Drawn::default(),
            card,
            camera: None,
            pane: Pane { min: Vec2::ZERO, size: Vec2::ONE },
        }
    }

    /// Shows a scene: from its first photo, or as a whole.
    pub(super) fn show(&mut self, loaded: Loaded) {
        let Loaded { scene, model, bounds } = loaded;
        self.controls = Controls::new(&bounds, scene.up);
        let (soup, to_soup, painter) = match scene.source {
            Some(Source { soup, to_soup, paint }) => (Some(soup), Some(to_soup), Some(paint)),
            None => (None, None, None),
        };
        self.shown = Some(Shown {
            model: Arc::new(model),
            bounds,
            photos: scene.photos,
            soup,
            to_soup,
            has_painter: painter.is_some(),
            painter,
            asset: None,
        });
        self.note = None;
        if self.shown.as_ref().is_some_and(|s| !s.photos.is_empty()) {
            self.jump(0);
        }
    }

    /// Tells something.
    pub(super) fn tell(&mut self, what: String) {
        self.note = Some((what, Instant::now()));
    }

    /// Forgets what has been told for long enough; returns how long the rest is to be seen.
    pub(super) fn forget(&mut self) -> Option<Duration> {
        let (_, since) = self.note.as_ref().filter(|_| self.shown.is_some())?;
        let left = READING.checked_sub(since.elapsed());
        if left.is_none() {
            self.note = None;
        }
        left
    }

    /// Stands where photo `index` was taken.
    pub(super) fn jump(&mut self, index: usize) {
        let Some(photo) = self.shown.as_ref().and_then(|s| s.photos.get(index)) else { return };
        self.controls.jump(&photo.camera);
        self.current = Some(index);
    }

    /// Jumps to the next photo, or with -1 to the one before.
    pub(super) fn step(&mut self, by: isize) {
        let count = self.shown.as_ref().map_or(0, |s| s.photos.len());
        if count > 0 {
            let from = self.current.map_or(if by > 0 { -1 } else { 0 }, |i| i as isize);
            self.jump((from + by).rem_euclid(count as isize) as usize);
        }
    }

    /// Has the whole scene in view.
    pub(super) fn frame(&mut self) {
        if let Some(shown) = &self.shown {
            self.controls.frame(&shown.bounds);
            self.current = None;
        }
    }

    /// The photo place after this one.
    pub(super) fn next_photo_place(&mut self) {
        self.choices.photo = match self.choices.photo {
            PhotoPlace::Off => PhotoPlace::Beside,
            PhotoPlace::Beside => PhotoPlace::Over,
            PhotoPlace::Over => PhotoPlace::Off,
        };
    }

    /// The part of a pane that is left for the picture when a photo stands beside it.
    pub(super) fn picture_pane(&self, pane: Pane) -> Pane {
        let beside = self.choices.photo == PhotoPlace::Beside && self.current.is_some();
        let share = if beside { Vec2::new(0.5, 1.0) } else { Vec2::ONE };
        Pane { size: pane.size * share, ..pane }
    }

    /// Whether the next picture will differ from this one.
    pub(super) fn is_moving(&self) -> bool {
        self.choices.always || self.keys.any()
    }
}

/// A picture as a texture of the panel's.
pub(super) fn texture(context: &Context, name: &str, picture: &Pixels) -> TextureHandle {
    let limit = context.input(|i| i.max_texture_side) as u32;
    let shrink = picture.size.max_element().div_ceil(limit.clamp(1, 4096));
    let small = picture.downscaled((picture.size / shrink.max(1)).max(UVec2::ONE));
    let size = small.size.as_usizevec2().to_array();
    let image = ColorImage::from_rgb(size, small.rgb.as_flattened());
    context.load_texture(name, image, TextureOptions::LINEAR)
}

/// Pictures a second, and the card's own time.
#[derive(Debug, Default)]
pub(super) struct Meter {
    last: Option<Instant>,
    frame_secs: Option<f64>,
    /// Milliseconds the card worked on the last picture.
    pub(super) gpu_ms: Option<f64>,
}

impl Meter {
    /// A picture was drawn; `moving` when it follows the last one without pause. Returns the seconds since.
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

    /// Pictures a second; `None` while nothing moves.
    pub(super) fn fps(&self) -> Option<f64> {
        self.frame_secs.map(|secs| 1.0 / secs)
    }
}
