//! Pictures instead of photos: a soft scene is drawn as it was trained, and later stages use these
//! pictures like photos.
//!
//! A solid triangle keeps its own colour, but soft pictures blend many triangles. The soft
//! rasteriser still draws the scene as it was trained, without photos.

use super::prune::{PruneDetails, PruneOptions, prune};
use super::solid::{SolidOptions, area_factor, solid};
use super::views::{SAMPLES, Views, drawing};
use crate::solid::color;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_formats::info::Softness;
use trisplat_raster::soft::SoftOptions;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::Outcome;
use trisplat_scene::stored_cameras::decode_cameras;
use trisplat_scene::{ImportedScene, Result, Scene, Soup};
use trisplat_teacher::{Teacher, ViewpointKind, Viewpoints};

/// Pixels of all pictures together; with many or large cameras not all are drawn.
const MAX_PIXELS: u64 = 12_000_000;
/// Number of pictures from chosen viewpoints: enough for colours, few enough for every bake.
const CHOSEN_PICTURES: usize = 32;
/// Pictures that softness is measured on.
const SOFTNESS_VIEWS: usize = 4;
/// Longer side of these pictures, px.
const SOFTNESS_PX: u32 = 240;
/// Pictures with a smaller share of scene are not used.
const MIN_COVERED: f64 = 0.001;
/// A scene is solid when its triangles cover this share of their area.
const SOLID_COVER: f64 = 0.95;

/// Condition for pictures of the soft scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum TeacherWhen {
    /// When the scene is soft and no photos are given
    Auto,
    /// Never
    Off,
}

/// Options of pictures that replace photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct TeacherOptions {
    /// When the soft scene is drawn as it was trained, and its pictures replace photos
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = TeacherOptions::DEFAULT.teacher, value_name = "WHEN"))]
    pub teacher: TeacherWhen,
    /// Draw at most N pictures [default: 32 from chosen viewpoints; from stored cameras as many as
    /// fit 12 million pixels]
    #[cfg_attr(feature = "cli", arg(skip))]
    #[schemars(range(min = 1, max = 100_000))]
    pub teacher_pictures: Option<u32>,
}

impl TeacherOptions {
    /// Draws pictures if there are no photos.
    pub const DEFAULT: Self = Self { teacher: TeacherWhen::Auto, teacher_pictures: None };
    /// Draws none.
    pub const OFF: Self = Self { teacher: TeacherWhen::Off, ..Self::DEFAULT };

    fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(TeacherOptions);

/// The drawn pictures, and the softness of the scene; empty when it is solid.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TeacherDetails {
    /// Similarity to the soft pictures when each triangle is just made solid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub softness: Option<Softness>,
    /// Source of the viewpoints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viewpoints: Option<ViewpointKind>,
    /// Pictures drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<u64>,
    /// Width and height of the first of them, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_px: Option<[u32; 2]>,
    /// Share of the pictures that triangles cover.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covered: Option<f64>,
}

trisplat_scene::stage!(TeacherDetails, "teacher");

/// Draws the pictures of a soft scene into `views`, unless there are `photos`. With a colour that
/// is `behind` an object, they are transparent where they show it.
///
/// # Errors
///
/// An option out of range; options of the stages that make a scene solid out of range.
pub fn teacher(
    views: &mut Option<Views>,
    scene: &ImportedScene,
    has_photos: bool,
    object_background: Option<[f32; 3]>,
    options: &TeacherOptions,
    solid_options: &SolidOptions,
    details: &mut TeacherDetails,
) -> Result<Outcome<()>> {
    options.validate()?;
    if options.teacher == TeacherWhen::Off {
        return Ok(Outcome::Skipped("`teacher` off"));
    }
    let soup = match soft_soup(&scene.scene) {
        Ok(soup) => soup,
        Err(why) => return Ok(Outcome::Skipped(why)),
    };
    if has_photos {
        let stored = (!scene.cameras.is_empty()).then(|| viewpoints(scene)).flatten();
        details.softness =
            softness_from(soup, &stored.map_or(Vec::new(), |all| all.cameras), solid_options)?;
        return Ok(Outcome::Skipped(HAS_PHOTOS));
    }
    let Some(viewpoints) = viewpoints(scene) else {
        return Ok(Outcome::Skipped("the scene stores no cameras and shows nothing from anywhere"));
    };
    details.softness = softness_from(soup, &viewpoints.cameras, solid_options)?;
    details.viewpoints = Some(viewpoints.kind);
    let drawn = at_most(options.teacher_pictures, scene, object_background, viewpoints.cameras);
    if drawn.covered() < MIN_COVERED {
        return Ok(Outcome::Skipped("the scene's cameras see nothing of it"));
    }
    details.pictures = Some(drawn.len() as u64);
    details.size_px = drawn.cameras().first().map(|camera| camera.size.to_array());
    details.covered = Some(drawn.covered());
    *views = Some(drawn);
    Ok(Outcome::Changed(()))
}

/// Reason to skip the stage in a scene with photos.
pub(super) const HAS_PHOTOS: &str = "there are photos, or pictures already";

/// The soup of a soft scene, or why there is none.
pub(super) fn soft_soup(scene: &Scene) -> std::result::Result<&Soup, &'static str> {
    match scene {
        Scene::Mesh(_) => Err("the input is a mesh: its triangles are solid"),
        Scene::Soup(soup) if is_solid(soup) => Err("the scene is solid already"),
        Scene::Soup(soup) => Ok(soup),
    }
}

/// The cameras for a bake's pictures; of chosen viewpoints the most telling ones.
pub(super) fn viewpoints(scene: &ImportedScene) -> Option<Viewpoints> {
    let mut viewpoints = Viewpoints::of(scene, 3 * MAX_PIXELS)?;
    if viewpoints.kind != ViewpointKind::Stored {
        viewpoints.cameras.truncate(CHOSEN_PICTURES);
    }
    Some(viewpoints)
}

/// Cameras of the photos that a mesh's file stores or, without any, cameras chosen by its first
/// viewpoint; none without that.
pub(super) fn stored_cameras(scene: &ImportedScene) -> Vec<Camera> {
    let named = decode_cameras(&scene.provenance.cameras);
    let is_seen = scene.provenance.viewpoint.is_some_and(|first| first.is_possible());
    if !named.is_empty() || !is_seen {
        return named;
    }
    viewpoints(scene).map_or(Vec::new(), |viewpoints| viewpoints.cameras)
}

/// The pictures of a solid `scene` and of its `backdrop` from `cameras`, to which fewer triangles are
/// fitted. `None` without cameras, and of a mesh whose triangles are connected or textured, which
/// keeps its colours.
///
/// # Errors
///
/// More vertices than 32 bits count.
pub(super) fn solid_views(
    scene: &Scene,
    backdrop: Option<&Mesh>,
    cameras: &[Camera],
) -> Result<Option<Views>> {
    let Scene::Mesh(mesh) = scene else { return Ok(None) };
    if cameras.is_empty() || !mesh.indices.is_empty() || mesh.texture.is_some() {
        return Ok(None);
    }
    let mut whole = mesh.clone();
    if let Some(backdrop) = backdrop {
        whole.append(backdrop.clone())?;
    }
    let drawing = drawing(cameras, &whole, SAMPLES);
    let mut solid = SolidRasterizer::new();
    let picture = |camera: &Camera| {
        let [black, white] = [0.0, 1.0].map(|grey| {
            solid.render(&whole, camera, &SolidRasterOptions { background: [grey; 3], ..drawing })
        });
        let covered = |(over, under): (&[u8; 3], &[u8; 3])| 255 - under[1].saturating_sub(over[1]);
        RgbImage { alpha: Some(black.rgb.iter().zip(&white.rgb).map(covered).collect()), ..black }
    };
    let views = Views::drawn(cameras.to_vec(), cameras.iter().map(picture).collect());
    Ok(Some(if backdrop.is_some() { views } else { views.of_object() }))
}

/// The soft pictures of `scene` from `cameras` in its frame, or from an evenly spaced selection
/// when these are too many. With a colour that is `behind` an object, they are transparent where
/// they show it.
pub fn pictures(
    scene: &ImportedScene,
    object_background: Option<[f32; 3]>,
    cameras: Vec<Camera>,
) -> Views {
    at_most(None, scene, object_background, cameras)
}

/// The same, limited in number.
fn at_most(
    max_pictures: Option<u32>,
    scene: &ImportedScene,
    object_background: Option<[f32; 3]>,
    cameras: Vec<Camera>,
) -> Views {
    let cameras = within_budget(cameras);
    let max_pictures =
        max_pictures.map_or(cameras.len(), |max_pictures| cameras.len().min(max_pictures as usize));
    let mut teacher = Teacher::new(scene.scene.to_soup(), &cameras, &SoftOptions::default());
    let mut chosen: Vec<usize> = spread(cameras.len()).take(max_pictures).collect();
    chosen.sort_unstable();
    let picture = |view: usize| {
        let camera = &cameras[view];
        let picture = match object_background {
            Some(object_background) => teacher.object_picture(camera, object_background),
            None => teacher.weighted_picture(camera),
        };
        (*camera, picture)
    };
    let (chosen, pictures) = chosen.into_iter().map(picture).unzip();
    let views = Views::drawn(chosen, pictures);
    if object_background.is_some() { views.of_object() } else { views }
}

/// The numbers below `count` in bit-reversed order, in which every prefix is spread evenly.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    let bits = count.next_power_of_two().trailing_zeros();
    let reversed = move |i: usize| i.reverse_bits().checked_shr(usize::BITS - bits).unwrap_or(0);
    (0..1usize << bits).map(reversed).filter(move |i| *i < count)
}

/// An evenly spaced selection of `cameras` when their pictures would be too many.
fn within_budget(cameras: Vec<Camera>) -> Vec<Camera> {
    let pixels: u64 = cameras.iter().map(|c| u64::from(c.size.x) * u64::from(c.size.y)).sum();
    if pixels <= MAX_PIXELS {
        return cameras;
    }
    let share = MAX_PIXELS as f64 / pixels as f64;
    let count = ((cameras.len() as f64 * share) as usize).max(1);
    evenly_spaced(cameras.len(), count).map(|i| no_larger(&cameras[i])).collect()
}

/// The camera, with a smaller picture where one of its own size would alone be too large.
fn no_larger(camera: &Camera) -> Camera {
    let pixels = u64::from(camera.size.x) * u64::from(camera.size.y);
    if pixels <= MAX_PIXELS {
        return *camera;
    }
    let ratio = (MAX_PIXELS as f64 / pixels as f64).sqrt();
    camera.resized((camera.size.as_dvec2() * ratio).floor().as_uvec2().max(UVec2::ONE))
}

/// True when making the triangles of `soup` solid loses nothing: nearly all of their area is
/// opaque.
pub fn is_solid(soup: &Soup) -> bool {
    let mut all = 0.0;
    let mut covered = 0.0;
    for (i, [a, b, c]) in soup.vertices.iter().enumerate() {
        let area = f64::from((*b - *a).cross(*c - *a).length());
        if area.is_finite() {
            all += area;
            covered += area * area_factor(soup.opacity[i].into(), soup.sigma[i].into()).powi(2);
        }
    }
    !(covered < SOLID_COVER * all)
}

/// The loss of `scene`, on a few small pictures, when its triangles are just made solid. `None`
/// when it is solid, or cannot be seen.
///
/// # Errors
///
/// Options out of range.
pub fn softness(scene: &ImportedScene, solidly: &SolidOptions) -> Result<Option<Softness>> {
    let Scene::Soup(soup) = &scene.scene else { return Ok(None) };
    if is_solid(soup) {
        return Ok(None);
    }
    match viewpoints(scene) {
        Some(viewpoints) => softness_from(soup, &viewpoints.cameras, solidly),
        None => Ok(None),
    }
}

fn softness_from(
    soup: &Soup,
    cameras: &[Camera],
    solidly: &SolidOptions,
) -> Result<Option<Softness>> {
    if cameras.is_empty() {
        return Ok(None);
    }
    let Some(mesh) = solid_mesh(soup, solidly)? else { return Ok(None) };
    let mut teacher = Teacher::new(soup.clone(), cameras, &SoftOptions::default());
    let drawing = drawing(cameras, &mesh, SAMPLES);
    let mut solid = SolidRasterizer::new();
    let count = SOFTNESS_VIEWS.min(cameras.len());
    let psnr = |i: usize| {
        let camera = small(&cameras[i]);
        let soft = teacher.picture(&camera);
        let solid = solid.render(&mesh, &camera, &drawing);
        metric::psnr(&soft.rgb, &solid.rgb, None)
    };
    let psnr = evenly_spaced(cameras.len(), count).map(psnr).sum::<f64>() / count as f64;
    Ok(Some(Softness { psnr, pictures: count as u64 }))
}

/// The triangles of `soup`, made solid; `None` when none is left.
fn solid_mesh(soup: &Soup, options: &SolidOptions) -> Result<Option<Mesh>> {
    let mut scene = Scene::Soup(soup.clone());
    if prune(&mut scene, &PruneOptions::DEFAULT, &mut PruneDetails::default()).is_err() {
        return Ok(None);
    }
    let Scene::Soup(mut soup) = scene else { return Ok(None) };
    soup.truncate_sh(0);
    solid(&mut soup, options, &mut Default::default())?;
    Ok(Some(color(soup, &mut Default::default())?))
}

/// The same camera with a small picture.
fn small(camera: &Camera) -> Camera {
    let longer = camera.size.max_element();
    if longer <= SOFTNESS_PX {
        return *camera;
    }
    camera.resized((camera.size * SOFTNESS_PX / longer).max(UVec2::ONE))
}
