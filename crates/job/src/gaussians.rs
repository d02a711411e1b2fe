//! Gaussian splats become a solid scene: triangles in their place are trained on pictures drawn of
//! them.

use super::event::{Observer, on_drawn};
use super::harden::{Hardened, train};
use glam::{UVec2, Vec3};
use std::path::Path;
use std::time::Instant;
use trisplat_bake::{BakePreset, Views};
use trisplat_dataset::{Dataset, DatasetOptions, View};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::report::Report;
use trisplat_scene::{Error, ImportedSplats, Result, Soup, frames};
use trisplat_teacher::{
    GaussianTeacher, ViewpointKind, Viewpoints, between, dataset_of_pictures, with_pictures_of,
};
use trisplat_train::{TrainOptions, TrainPreset, shell_around};

/// Share of the triangles that the training begins with; it adds the others where they are missing.
const FIRST_SHARE: f64 = 0.5;
/// Maximum number of triangles per Gaussian: each is one ellipse, so more gain little
/// (docs/benchmarks/splats.md).
const TRIANGLES_PER_SPLAT: u64 = 24;
/// Share of the training pictures that are drawn between the photos, if there are photos.
const SHARE_BETWEEN: f64 = 0.5;

/// Rate of the corners, as a share of that from points: the first triangles lie about right. Three
/// times as much costs one object up to 1.6 dB and another up to 5.5, half as much up to 0.4
/// (docs/benchmarks/splats.md).
const CORNER_RATE_SHARE: f64 = 0.5;

/// Steps of hardening from Gaussians, as a multiple of those from soft triangles: their first
/// triangles are only near the surface.
const STEP_FACTOR: u64 = 4;

/// Maximum number of times that cameras are put between neighbours.
const ROUNDS_BETWEEN: usize = 3;

/// Pictures, steps and triangles of a training on Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrainingEffort {
    /// Maximum number of pictures.
    pictures: usize,
    surroundings: EffortLimits,
    /// An object has fewer surfaces, and its cut-out pictures cost less.
    object: EffortLimits,
}

/// How Gaussians become triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SplatTraining {
    pub(super) effort: TrainingEffort,
    /// Maximum number of triangles; `None`: that of the effort.
    pub(super) max_triangles: Option<u64>,
    /// Degree of the view-dependent colours to train.
    pub(super) sh_degree: u8,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct EffortLimits {
    steps: u64,
    /// Maximum number of triangles, unless they are given.
    triangles: u64,
    /// Longer side of the pictures, px.
    longer_px: u32,
}

impl TrainingEffort {
    pub(super) const FAST: Self =
        Self::alike(60, EffortLimits { steps: 2000, triangles: 20_000, longer_px: 400 });
    const DEFAULT: Self = Self {
        pictures: 140,
        surroundings: EffortLimits { steps: 3000, triangles: 80_000, longer_px: 640 },
        // Smaller pictures: splats are drawn with a blur of a pixel, and finer triangles show less
        // of it than the splats from far away.
        object: EffortLimits { steps: 5000, triangles: 40_000, longer_px: 560 },
    };

    const fn alike(pictures: usize, work: EffortLimits) -> Self {
        Self { pictures, surroundings: work, object: work }
    }

    /// Of a bake with this preset, hardened or not.
    pub(super) fn of(preset: BakePreset, harden: Option<u64>) -> Self {
        match (harden, preset) {
            (Some(harden), _) => {
                let steps = harden.saturating_mul(STEP_FACTOR);
                Self::alike(200, EffortLimits { steps, triangles: 100_000, longer_px: 800 })
            }
            (None, BakePreset::Fast) => Self::FAST,
            (None, _) => Self::DEFAULT,
        }
    }
}

impl EffortLimits {
    /// The training is that of photos, not that of a soft scene: the first triangles lie about
    /// right but overlap, so they must move.
    fn training(&self, of: SplatTraining, splats: usize) -> TrainOptions {
        let preset = TrainOptions::preset(TrainPreset::Solid);
        let enough = TRIANGLES_PER_SPLAT.saturating_mul(splats as u64);
        let max_triangles = of.max_triangles.unwrap_or(self.triangles.min(enough));
        TrainOptions { steps: self.steps, max_triangles, sh_degree: of.sh_degree, ..preset }
    }

    fn limited(&self, camera: &Camera) -> Camera {
        let longer = camera.size.max_element();
        if longer <= self.longer_px {
            return *camera;
        }
        camera.resized((camera.size * self.longer_px / longer).max(UVec2::ONE))
    }
}

/// The solid scene of `splats`, read from `path`, as `training` says. It is trained on pictures from
/// the cameras beside the file, those of `photos`, or chosen ones; with photos, on these too.
///
/// # Errors
///
/// Nothing to see from anywhere; undecodable photos; a stopped run.
pub(super) fn solid(
    (path, mut splats): (&Path, ImportedSplats),
    photos: Option<&Dataset>,
    how: &DatasetOptions,
    training: SplatTraining,
    report: &mut Report,
    observer: Observer<'_>,
) -> Result<Hardened> {
    let clock = Instant::now();
    let effort = training.effort;
    if photos.is_none() && splats.cameras.is_empty() {
        // Cameras of photos look past what floats; chosen ones would show it.
        splats.remove_floaters();
    }
    let has_cameras = photos.is_some() || !splats.cameras.is_empty();
    report.warnings.append(&mut splats.warnings);
    let placement = splats.provenance.placement;
    let to_file =
        |camera: &Camera| photos.map_or(*camera, |p| frames::to_file(camera, &placement, p.origin));
    let cameras = match photos {
        Some(photos) => {
            photos.train().map(|view| effort.surroundings.limited(&to_file(&view.camera))).collect()
        }
        None => effort.cameras(path, &splats)?,
    };
    let mut teacher = GaussianTeacher::new(&splats.splats, &cameras);
    let max_bytes = how.photo_bytes();
    let dataset = match photos {
        Some(photos) => {
            // The contribution of each Gaussian to the photos.
            for camera in &cameras {
                drop(teacher.picture(camera));
            }
            let picture = |camera: &Camera| teacher.picture(&to_file(camera));
            with_pictures_of(photos, SHARE_BETWEEN, max_bytes, picture, &mut on_drawn(observer))?
        }
        None => {
            let picture = |camera: &Camera| teacher.picture(camera);
            dataset_of_pictures(path, &cameras, max_bytes, picture, &mut on_drawn(observer))?
        }
    };
    let surroundings = teacher.shows_surroundings();
    let work = if surroundings { effort.surroundings } else { effort.object };
    let mut options = work.training(training, splats.splats.len());
    let mut first = teacher.first_triangles((options.max_triangles as f64 * FIRST_SHARE) as usize);
    if first.is_empty() {
        return Err(shows_nothing(path));
    }
    options.rates.corners *= CORNER_RATE_SHARE;
    if surroundings {
        let shell = far_shell(&first, &dataset, to_file, &options, max_bytes)?;
        first.append(shell);
    }
    let (scene, stage) = train(splats.with(first), &dataset, how, &options, clock, observer)?;
    let pictures = || Views::of_pictures(&dataset, how, teacher.covered());
    let pictures = photos.is_none().then(|| pictures().of_chosen_cameras(!has_cameras));
    Ok(Hardened { scene, pictures, stage })
}

/// A shell behind the `first` triangles: without one, few viewpoints would have the far background
/// close in front of them.
///
/// # Errors
///
/// A photo that cannot be decoded.
fn far_shell(
    first: &Soup,
    dataset: &Dataset,
    to_file: impl Fn(&Camera) -> Camera,
    options: &TrainOptions,
    max_bytes: u64,
) -> Result<Soup> {
    let view = |view: &View| View { camera: to_file(&view.camera), ..view.clone() };
    let views: Vec<View> = dataset.train().map(view).collect();
    let centroids: Vec<Vec3> = first.vertices.iter().copied().map(centroid).collect();
    shell_around(&centroids, &views.iter().collect::<Vec<_>>(), options, max_bytes)
}

impl TrainingEffort {
    /// The cameras of the pictures, in the frame of the file: those that it stores with others
    /// between them, or chosen ones.
    fn cameras(&self, path: &Path, splats: &ImportedSplats) -> Result<Vec<Camera>> {
        let stand_in = splats.stand_in();
        let stored = self.sample_cameras(&stand_in.cameras);
        // The size is that of pictures from around an object.
        let sizes = (self.pictures, self.object.longer_px);
        let viewpoints = Viewpoints::of_splats(&splats.splats, &stand_in, &stored, sizes);
        let mut viewpoints = viewpoints.ok_or_else(|| shows_nothing(path))?;
        if viewpoints.kind != ViewpointKind::Stored {
            // The most telling ones come first.
            viewpoints.cameras.truncate(self.pictures);
            return Ok(self.sample_cameras(&viewpoints.cameras));
        }
        for _ in 0..ROUNDS_BETWEEN {
            let room = self.pictures.saturating_sub(viewpoints.cameras.len());
            let more = between(&viewpoints.cameras);
            let earlier = viewpoints.cameras.clone();
            viewpoints
                .cameras
                .extend(more.into_iter().filter(|camera| !earlier.contains(camera)).take(room));
        }
        Ok(viewpoints.cameras)
    }

    /// At most as many of `cameras` as there are pictures, evenly spaced, with pictures of at most
    /// the allowed size.
    fn sample_cameras(&self, cameras: &[Camera]) -> Vec<Camera> {
        evenly_spaced(cameras.len(), self.pictures)
            .map(|i| self.surroundings.limited(&cameras[i]))
            .collect()
    }
}

fn shows_nothing(path: &Path) -> Error {
    let wants = "photos of it (`dataset`), or its cameras in `cameras.json` beside it: nothing is seen of it from anywhere";
    Error::invalid("inputs", path.display(), wants)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_gaussians_get_few_triangles_unless_a_number_is_given() {
        let limits = TrainingEffort::DEFAULT.object;
        let count = |max_triangles, splats| {
            let effort = TrainingEffort::DEFAULT;
            let of = SplatTraining { effort, max_triangles, sh_degree: 2 };
            let options = limits.training(of, splats);
            assert_eq!(options.sh_degree, 2);
            options.max_triangles
        };
        assert_eq!(count(None, 400), 400 * TRIANGLES_PER_SPLAT);
        assert_eq!(count(None, 100_000), limits.triangles);
        assert_eq!(count(Some(30_000), 400), 30_000);
    }
}
