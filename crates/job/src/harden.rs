//! Hardening: a soft scene is trained solid before its bake.

use super::event::{Observer, TrainBegins, begin, on_drawn};
use super::renderer::NEAR;
use std::path::Path;
use std::time::Instant;
use trisplat_bake::{Views, is_solid, pictures};
use trisplat_dataset::{Dataset, DatasetOptions, View};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{StageDetails, StageReport};
use trisplat_scene::{Error, ImportedScene, Result, Scene, SceneNormalization, Soup};
use trisplat_teacher as teacher;
use trisplat_train::{TrainDetails, TrainInputs, TrainOptions, TrainPreset};

/// Maximum number of triangles of a hardened scene, unless the soft one has more.
const DEFAULT_MAX_TRIANGLES: u64 = 60_000;
/// Largest share of steps on soft pictures when there are photos too.
pub const MAX_TEACHER_SHARE: f64 = 0.9;
/// Maximum number of triangles of a hardened scene, as a multiple of the soft scene's.
const GROWTH: f64 = 1.25;

/// Steps of hardening that suit most soft scenes.
pub const HARDEN_STEPS: u64 = 2000;

/// Training options of `steps` for a scene of `triangles`; the file may have `max_triangles`. The
/// training comes down to them early: a scene that is trained with all of its triangles and cut
/// afterwards loses up to 0.9 dB and takes a third more seconds.
pub(super) fn training(steps: u64, triangles: usize, max_triangles: Option<u64>) -> TrainOptions {
    let grown = (triangles as f64 * GROWTH) as u64;
    let max_triangles = max_triangles.unwrap_or(DEFAULT_MAX_TRIANGLES.max(grown));
    TrainOptions { steps, max_triangles, ..TrainOptions::from_scene(TrainPreset::Solid) }
}

/// A hardened scene.
pub(super) struct Hardened {
    /// The solid scene.
    pub(super) scene: ImportedScene,
    /// Soft pictures of the original scene, when there are no photos.
    pub(super) pictures: Option<Views>,
    /// Report stage of the training.
    pub(super) stage: StageReport,
}

impl Hardened {
    /// The unchanged `scene`, with the reason.
    pub(super) fn unneeded(scene: ImportedScene, why: &str) -> Self {
        let counts = scene.scene.counts();
        let stage = StageReport {
            before: counts,
            after: counts,
            ..StageReport::skipped(TrainDetails::STAGE, why.to_owned())
        };
        Self { scene, pictures: None, stage }
    }
}

/// Reason not to harden `scene`, if it is solid.
pub(crate) fn reason_to_skip(scene: &ImportedScene) -> Option<&'static str> {
    match &scene.scene {
        Scene::Mesh(_) => Some("the input is a mesh: its triangles are solid"),
        Scene::Soup(soup) => is_solid(soup).then_some("the scene is solid already"),
    }
}

/// Trains `soft`, read from `path`, solid: on `photos` if there are any, otherwise on its own soft
/// pictures, which are transparent where they show the colour `behind` an object.
///
/// # Errors
///
/// No cameras to draw from, undecodable photos, a stopped run.
pub(super) fn harden(
    (path, soft): (&Path, ImportedScene),
    behind: Option<[f32; 3]>,
    photos: Option<&Dataset>,
    how: &DatasetOptions,
    options: &TrainOptions,
    observer: Observer<'_>,
) -> Result<Hardened> {
    let clock = Instant::now();
    let drawing = options.drawing(how.background.to_f32());
    let mut own_pictures = None;
    let drawn = match photos {
        Some(_) => None,
        None => {
            let drawn = teacher::dataset(
                path,
                &soft,
                &drawing,
                behind,
                how.photo_bytes(),
                &mut on_drawn(observer),
            )?;
            let cameras = drawn.views.iter().map(|view| view.camera).collect();
            own_pictures = Some(pictures(&soft, behind, cameras));
            Some(drawn)
        }
    };
    let Some(dataset) = drawn.as_ref().or(photos) else {
        unreachable!("pictures are drawn where there are no photos");
    };
    let (scene, stage) = train(soft, dataset, how, options, clock, observer)?;
    Ok(Hardened { scene, pictures: own_pictures, stage })
}

/// Trains `soft` solid on `dataset`; `clock` began with the stage.
///
/// # Errors
///
/// Undecodable photos, a stopped run.
pub(super) fn train(
    soft: ImportedScene,
    dataset: &Dataset,
    how: &DatasetOptions,
    options: &TrainOptions,
    clock: Instant,
    observer: Observer<'_>,
) -> Result<(ImportedScene, StageReport)> {
    let run = TrainInputs::new(dataset, options).with_dataset_options(how);
    let run = TrainInputs { from: Some(soft), shrink_initial_scene: true, ..run }.start()?;
    let triangles = run.triangles();
    let begins = TrainBegins { steps: options.steps, ..TrainBegins::default() };
    let trained = run.finish(&mut begin(observer, &begins)?)?;
    if trained.stopped {
        let value = format!("stopped after {} of {} steps", trained.steps, options.steps);
        return Err(Error::invalid("harden", value, "all of its steps; nothing was written"));
    }
    if options.steps >= MIN_STEPS {
        check_shown(&trained.soup, dataset)?;
    }
    let stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
    Ok((trained.into(), stage))
}

/// Minimum steps that make triangles opaque: the rest after fewer steps tells nothing of the input.
const MIN_STEPS: u64 = 1000;
/// Pictures that tell whether a scene is still there, and their longer side, px.
const LOOKS: usize = 12;
const LOOK_SIDE: u32 = 96;

/// Refuses a scene that has nearly vanished: in most of the drawn pictures that it was trained on,
/// it covers less than half of what they show.
///
/// # Errors
/// Such a scene; pictures that cannot be read.
fn check_shown(soup: &Soup, dataset: &Dataset) -> Result<()> {
    let drawn: Vec<&View> = dataset.train().filter(|view| view.photo.is_drawn()).collect();
    let looks: Vec<&View> = evenly_spaced(drawn.len(), LOOKS).map(|i| drawn[i]).collect();
    let cameras: Vec<Camera> = looks.iter().map(|view| view.camera.fit_within(LOOK_SIDE)).collect();
    let middle = |i: usize| centroid(soup.vertices[i]);
    let space = SceneNormalization::of(&cameras, soup.len(), middle);
    let options = SolidRasterOptions { near: NEAR / space.scale, ..SolidRasterOptions::default() };
    let mesh = Mesh { positions: soup.vertices.concat(), ..Mesh::default() };
    let mut solid = SolidRasterizer::new();
    let mut lost = 0;
    for (view, camera) in looks.iter().zip(&cameras) {
        let picture = view.photo.decode()?;
        let wanted = picture.alpha.map_or(1.0, |alpha| {
            alpha.iter().map(|a| f64::from(*a) / 255.0).sum::<f64>() / alpha.len() as f64
        });
        let faces = &solid.visibility(&mesh, camera, &options).face;
        let covered =
            faces.iter().filter(|face| **face != NO_FACE).count() as f64 / faces.len() as f64;
        lost += usize::from(covered < wanted / 2.0);
    }
    if 2 * lost <= looks.len() {
        return Ok(());
    }
    let value =
        format!("{} triangles, which cover less than half of what most pictures show", soup.len());
    let wants = "a scene that stays whole in training: give photos of it (`dataset`), its cameras in `cameras.json` beside it, or a file without Gaussians or triangles far around it";
    Err(Error::invalid("inputs", value, wants))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{UVec2, Vec3};
    use std::path::PathBuf;
    use trisplat_scene::image::RgbImage;

    #[test]
    fn a_scene_that_vanished_in_training_is_refused() {
        let corner = |turn: f32| Vec3::new(turn.cos(), turn.sin(), 0.0);
        let disc = |radius: f32| Soup {
            vertices: (0..9)
                .map(|i| [Vec3::ZERO, corner(0.7 * i as f32), corner(0.7 * i as f32 + 0.71)])
                .map(|t| t.map(|v| v * radius))
                .collect(),
            ..Soup::default()
        };
        for unit in [1e-4, 1.0, 1e5] {
            let eye = |i: usize| unit * Vec3::new(0.2 * i as f32, 0.1, 3.0);
            let camera = |i| Camera::look_at(eye(i), Vec3::ZERO, Vec3::Y, 0.9, UVec2::splat(60));
            let cameras: Vec<Camera> = (0..5).map(camera).collect();
            // A disc of radius 1 covers about a third of each picture.
            let picture = |_: &Camera| RgbImage {
                size: UVec2::splat(60),
                rgb: vec![[9; 3]; 3600],
                alpha: Some([[255; 1200].as_slice(), &[0; 2400]].concat()),
            };
            let dataset = teacher::dataset_of_pictures(
                &PathBuf::from("disc"),
                &cameras,
                1 << 24,
                picture,
                &mut |_, _| (),
            )
            .unwrap();
            assert!(check_shown(&disc(unit), &dataset).is_ok());
            for left in [
                disc(0.3 * unit),
                Soup {
                    vertices: vec![[Vec3::ZERO, Vec3::X * unit, Vec3::Y * unit]],
                    ..Soup::default()
                },
                Soup::default(),
            ] {
                let message =
                    check_shown(&left, &dataset).expect_err("hardly anything").to_string();
                assert!(message.contains("cameras.json"), "{message}");
            }
        }
    }
}
