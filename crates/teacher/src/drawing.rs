//! Draws a scene as it was trained, and finds its background and the triangles that show only it.
//!
//! On a black background, training leaves black triangles around the object. They change no picture
//! of the training, but every picture on another background. The borders of the scene's own
//! pictures show the colour.

use crate::viewpoints::{Viewpoints, between, picture_bytes};
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_dataset::{Dataset, DatasetKind, Photo, PictureFile, View};
use trisplat_raster::soft::{
    Frame, FrameGrad, Importance, SoftOptions, SoftRasterizer, SoupGrad, SoupRef,
};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::{evenly_spaced, median};
use trisplat_scene::{Error, ImportedScene, Result, SceneNormalization, Soup, frames};

/// Largest coordinate of a drawn triangle.
const REACH: f32 = 1e15;

/// Cover of a pixel that counts as 0; 1 minus it counts as 1.
const HAZE: f32 = 0.2;

/// Minimum alpha of a colour that looks like `over` on the colour `behind` it.
fn min_alpha(over: &[f32; 3], behind: &[f32; 3]) -> f32 {
    let channel_alpha = |(over, behind): (&f32, &f32)| match over - behind {
        more if more > 0.0 => more / (1.0 - behind),
        less if less < 0.0 => less / -behind,
        _ => 0.0,
    };
    over.iter().zip(behind).map(channel_alpha).fold(0.0, f32::max).min(1.0)
}

/// True for a triangle that is near enough to be drawn.
pub(super) fn is_drawn(corners: &[Vec3; 3]) -> bool {
    corners.iter().all(|v| v.abs().max_element() < REACH)
}

/// Draws one scene for many cameras.
#[derive(Debug)]
pub struct Teacher {
    soup: Soup,
    space: SceneNormalization,
    options: SoftOptions,
    soft: SoftRasterizer,
}

impl Teacher {
    /// Draws `soup` with `options` for `cameras` in its frame and others near them. Lengths in
    /// `options` are in units of training space.
    pub fn new(mut soup: Soup, cameras: &[Camera], options: &SoftOptions) -> Self {
        if !soup.vertices.iter().all(is_drawn) {
            let keep: Vec<bool> = soup.vertices.iter().map(is_drawn).collect();
            soup.retain(|i| keep[i]);
        }
        let centers: Vec<Vec3> =
            soup.vertices.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0).collect();
        let space = SceneNormalization::new(cameras, &centers);
        space.soup_to_training(&mut soup);
        let options = options.with_cap_for(&soup.opacity);
        Self { soup, space, options, soft: SoftRasterizer::new() }
    }

    /// Units of the soup in a unit of a frame's depths.
    pub fn depth_unit(&self) -> f32 {
        1.0 / self.space.scale
    }

    /// The view of `camera`, in the frame of the soup.
    pub fn frame(&mut self, camera: &Camera) -> &Frame {
        let camera = self.space.camera_to_training(camera);
        self.soft.render(&SoupRef::from(&self.soup), &camera, &self.options)
    }

    /// The picture that `camera` takes.
    pub fn picture(&mut self, camera: &Camera) -> RgbImage {
        self.frame(camera).to_pixels()
    }

    /// The picture of an object from `camera`, over black, with alpha. It is transparent where the
    /// picture shows the colour `behind`, and over that colour it is the picture.
    pub fn object_picture(&mut self, camera: &Camera, behind: [f32; 3]) -> RgbImage {
        let own = self.options.background;
        let frame = self.frame(camera);
        let pixels = frame.rgb.iter().zip(&frame.transmittance).map(|(rgb, through)| {
            let over = [0, 1, 2].map(|c| (rgb[c] + through * (behind[c] - own[c])).clamp(0.0, 1.0));
            // A soft scene leaks a little where it is opaque, and has a haze where it is empty.
            let clear = ((1.0 - through - HAZE) / (1.0 - 2.0 * HAZE)).clamp(0.0, 1.0);
            let alpha = min_alpha(&over, &behind).max(clear);
            ([0, 1, 2].map(|c| over[c] - (1.0 - alpha) * behind[c]), alpha)
        });
        let (rgb, alpha): (Vec<[f32; 3]>, Vec<f32>) = pixels.unzip();
        let alpha = alpha.iter().map(|alpha| (alpha * 255.0).round() as u8).collect();
        RgbImage { alpha: Some(alpha), ..RgbImage::from_rgb(frame.size, &rgb) }
    }

    /// The picture of `camera`, with the covered share of each pixel as its weight.
    pub fn weighted_picture(&mut self, camera: &Camera) -> RgbImage {
        self.frame(camera).to_cut_pixels()
    }

    /// For each triangle, the mean of `values` of the pixels of all pictures, by its blending
    /// weight there; 1 for a triangle that no camera sees. `[N]`
    pub(super) fn shares(&mut self, cameras: &[Camera], values: &[Vec<f32>]) -> Vec<f32> {
        let soup = SoupRef::from(&self.soup);
        let options = SoftOptions { importance: true, ..self.options };
        let mut weights = Importance::new(soup.count());
        let mut sums = vec![0.0; soup.count()];
        let mut of_picture = SoupGrad::default();
        for (camera, values) in cameras.iter().zip(values) {
            let camera = self.space.camera_to_training(camera);
            self.soft.render(&soup, &camera, &options);
            self.soft.accumulate_importance(&mut weights);
            let d_rgb = vec![[0.0; 3]; values.len()];
            let values = FrameGrad { d_rgb, error: values.clone(), ..FrameGrad::default() };
            self.soft.backward(&soup, &camera, &options, &values, &mut of_picture);
            for (sum, value) in sums.iter_mut().zip(&of_picture.error) {
                *sum += value;
            }
        }
        let share = |(sum, weight): (&f32, &f32)| if *weight > 0.0 { sum / weight } else { 1.0 };
        sums.iter().zip(&weights.sum_weight).map(share).collect()
    }
}

/// Maximum number of compared pictures.
const MAX_PICTURES: usize = 48;
/// One picture in this many has its border tested for a background: most scenes have none.
const BORDER_EVERY: usize = 6;
/// Longer side of the pictures, px.
const SIDE: u32 = 240;
/// Largest difference of a channel from the background in a pixel that shows it.
const TOLERANCE: f32 = 4.0 / 255.0;
/// Minimum share of the pixels at the borders that show the background: objects reach over some.
const MIN_UNIFORM: f64 = 0.9;
/// Minimum cover of a pixel whose triangles show the colour of the background.
const MIN_COVER: f32 = 0.1;
/// Minimum share of a triangle's visible area that shows the object, for a triangle of the object.
const MIN_OBJECT: f32 = 0.5;

/// Background of the object of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectBackground {
    /// Its colour, sRGB-encoded; `None` where nothing but the object is in view.
    pub rgb: Option<[f32; 3]>,
    /// False for triangles that show only that colour. `[N]`
    pub is_object: Vec<bool>,
}

impl ObjectBackground {
    /// The background of `soup` for `cameras`; a `given` colour overrules the pictures.
    /// `None` where the borders of the pictures have no common colour, as in a scene that fills
    /// them.
    pub fn of(soup: &Soup, cameras: &[Camera], given: Option<[f32; 3]>) -> Option<Self> {
        let chosen = evenly_spaced(cameras.len(), MAX_PICTURES);
        let cameras: Vec<Camera> = chosen.map(|i| cameras[i].fit_within(SIDE)).collect();
        let drawn: Vec<usize> = (0..soup.len()).filter(|i| is_drawn(&soup.vertices[*i])).collect();
        let part = soup.subset(&drawn);
        let rgb = match given {
            Some(rgb) => Some(rgb),
            None => {
                let sampled: Vec<Camera> = cameras.iter().step_by(BORDER_EVERY).copied().collect();
                background(&border(&part, &sampled))?
            }
        };
        let mut is_object = vec![true; soup.len()];
        if let Some(rgb) = rgb {
            let of_part = objects(&part, &cameras, rgb);
            // No camera sees all of the shell, which stands for the background wherever it is.
            for (i, object) in drawn.iter().zip(of_part) {
                is_object[*i] = object && !soup.is_shell(*i);
            }
        }
        Some(Self { rgb, is_object })
    }
}

/// Colour and cover of the pixels at the borders of pictures over black.
fn border(soup: &Soup, cameras: &[Camera]) -> Vec<([f32; 3], f32)> {
    let mut teacher = Teacher::new(soup.clone(), cameras, &SoftOptions::default());
    let mut pixels = Vec::new();
    for camera in cameras {
        let frame = teacher.frame(camera);
        let last = frame.size - 1;
        let is_border = |i: &usize| {
            let x = *i as u32 % frame.size.x;
            let y = *i as u32 / frame.size.x;
            x == 0 || y == 0 || x == last.x || y == last.y
        };
        let border = (0..frame.rgb.len()).filter(is_border);
        pixels.extend(border.map(|i| (frame.rgb[i], 1.0 - frame.transmittance[i])));
    }
    pixels
}

/// The colour that nearly all border pixels show when it is behind them, if there is one;
/// `Some(None)` for any colour, because no triangle at the border has that of a background.
fn background(pixels: &[([f32; 3], f32)]) -> Option<Option<[f32; 3]>> {
    let covered = || pixels.iter().filter(|(_, cover)| *cover > MIN_COVER);
    let median_color = [0, 1, 2].map(|c| {
        let channel = covered().map(|(rgb, cover)| rgb[c] / cover).collect();
        median(channel, f32::total_cmp).unwrap_or(0.0)
    });
    let shows = |(rgb, cover): &&([f32; 3], f32), behind: &[f32; 3]| {
        let over = [0, 1, 2].map(|c| rgb[c] + (1.0 - cover) * behind[c]);
        !differ(&over, behind)
    };
    // If only a part of the object reaches the border, the median is its colour.
    let candidates = [median_color, [0.0; 3], [1.0; 3]].map(|behind| {
        let all = pixels.iter().filter(|pixel| shows(pixel, &behind)).count();
        (covered().filter(|pixel| shows(pixel, &behind)).count(), all, behind)
    });
    let (showing, all, behind) =
        candidates.into_iter().max_by_key(|(showing, all, _)| (*showing, *all))?;
    let is_uniform = !pixels.is_empty() && all as f64 >= MIN_UNIFORM * pixels.len() as f64;
    is_uniform.then_some((showing > 0).then_some(behind))
}

/// Flags the triangles of `soup` that show an object before a background of this colour. `[N]`
fn objects(soup: &Soup, cameras: &[Camera], rgb: [f32; 3]) -> Vec<bool> {
    let options = SoftOptions { background: rgb, ..SoftOptions::default() };
    let mut whole = Teacher::new(soup.clone(), cameras, &options);
    let pictures: Vec<Vec<[f32; 3]>> = cameras.iter().map(|c| whole.frame(c).rgb.clone()).collect();
    let shows =
        |picture: &Vec<[f32; 3]>| picture.iter().map(|p| f32::from(differ(p, &rgb))).collect();
    let mut shows: Vec<Vec<f32>> = pictures.iter().map(shows).collect();
    let first = whole.shares(cameras, &shows);
    // A part of the object in the colour of the background hides what is behind it: without it,
    // pictures change.
    let kept: Vec<usize> = (0..soup.len()).filter(|i| first[*i] >= MIN_OBJECT).collect();
    let mut without = Teacher::new(soup.subset(&kept), cameras, &options);
    for ((camera, picture), shows) in cameras.iter().zip(&pictures).zip(&mut shows) {
        let pixels = without.frame(camera).rgb.iter().zip(picture);
        for (shows, (now, before)) in shows.iter_mut().zip(pixels) {
            *shows = shows.max(differ(now, before).into());
        }
    }
    whole.shares(cameras, &shows).into_iter().map(|share| share >= MIN_OBJECT).collect()
}

/// True when two colours can be told apart.
fn differ(a: &[f32; 3], b: &[f32; 3]) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > TOLERANCE)
}

// ---- Soft pictures of a scene as a data set for training the solid scene ------------------------

/// One picture in this many is held out, to score the solid scene.
const HELD_OUT: usize = 8;

/// Draws `scene`, read from `path`, with `options` and makes a data set of the pictures, in the
/// frame of its file. With many cameras, fewer pictures are drawn from between them. Above
/// `max_bytes` of memory, pictures are kept in a temporary file. With a colour that is `behind` an
/// object, pictures are transparent where they show it. Calls `drawn` after each picture with the
/// numbers of finished and of all pictures.
///
/// # Errors
///
/// A scene without visible triangles; a full disk.
pub fn dataset(
    path: &Path,
    scene: &ImportedScene,
    options: &SoftOptions,
    behind: Option<[f32; 3]>,
    max_bytes: u64,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let Some(Viewpoints { cameras, .. }) = Viewpoints::of(scene, max_bytes) else {
        let wants = "photos of it: it stores no cameras and shows nothing from anywhere";
        return Err(Error::invalid("from", path.display(), wants));
    };
    let mut teacher = Teacher::new(scene.scene.to_soup(), &cameras, options);
    let picture = |camera: &Camera| match behind {
        Some(behind) => teacher.object_picture(camera, behind),
        None => teacher.picture(camera),
    };
    let mut dataset = dataset_of_pictures(path, &cameras, max_bytes, picture, drawn)?;
    for (i, view) in dataset.views.iter_mut().enumerate() {
        view.test = i % HELD_OUT == HELD_OUT / 2;
    }
    Ok(dataset)
}

/// A data set of the `picture` of each of `cameras`, none held out, for a scene that was read from
/// `path`. `max_bytes` and `drawn` as for [`dataset`].
///
/// # Errors
///
/// A full disk.
pub fn dataset_of_pictures(
    path: &Path,
    cameras: &[Camera],
    max_bytes: u64,
    picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    Ok(Dataset {
        path: PathBuf::from(path),
        kind: DatasetKind::Drawn,
        views: draw(cameras, max_bytes, picture, drawn)?,
        points: Vec::new(),
        origin: DVec3::ZERO,
        warnings: Vec::new(),
    })
}

/// The photos of `photos` and soft pictures from between the training cameras, up to `share`, 0 to
/// 1, of all training pictures. `options`, `max_bytes` and `drawn` as for [`dataset`].
///
/// # Errors
///
/// A full disk.
pub fn with_soft_pictures(
    photos: &Dataset,
    scene: &ImportedScene,
    options: &SoftOptions,
    share: f64,
    max_bytes: u64,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let cameras: Vec<Camera> = photos.train().map(|view| view.camera).collect();
    let to_file =
        |camera: &Camera| frames::to_file(camera, &scene.provenance.placement, photos.origin);
    let near: Vec<Camera> = cameras.iter().map(to_file).collect();
    let mut teacher = Teacher::new(scene.scene.to_soup(), &near, options);
    with_pictures_of(photos, share, max_bytes, |camera| teacher.picture(&to_file(camera)), drawn)
}

/// [`with_soft_pictures`] with any `picture`, of a camera in the world of `photos`.
///
/// # Errors
///
/// A full disk.
pub fn with_pictures_of(
    photos: &Dataset,
    share: f64,
    max_bytes: u64,
    picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let cameras: Vec<Camera> = photos.train().map(|view| view.camera).collect();
    let between = between(&cameras);
    let count = (cameras.len() as f64 * share / (1.0 - share)).round() as usize;
    let chosen: Vec<Camera> = evenly_spaced(between.len(), count).map(|i| between[i]).collect();
    let pictures = draw(&chosen, max_bytes, picture, drawn)?;
    Ok(Dataset { views: [photos.views.clone(), pictures].concat(), ..photos.clone() })
}

/// A view of each of `cameras` with its `picture`, none held out. A picture with an alpha shows an
/// object without background.
fn draw(
    cameras: &[Camera],
    max_bytes: u64,
    mut picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Vec<View>> {
    let fits_memory = cameras.iter().map(picture_bytes).sum::<u64>() <= max_bytes;
    let file = Arc::new(PictureFile::default());
    let mut views = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let picture = picture(camera);
        let is_cut = picture.alpha.is_some();
        let photo =
            if fits_memory { Photo::drawn(picture) } else { Photo::stored(&picture, &file)? };
        let photo = if is_cut { photo.cut_out() } else { photo };
        views.push(View {
            name: format!("teacher_{i:05}"),
            camera: *camera,
            photo,
            test: false,
            tracked: Vec::new(),
        });
        drawn(i + 1, cameras.len());
    }
    Ok(views)
}
