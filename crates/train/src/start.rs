//! The state before the first step: triangles at the points of a data set, or those of a scene.

use super::budget::BudgetControl;
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::exposure::ExposureEstimates;
use super::identity::RunIdentity;
use super::init::{InitPoint, first_soup};
use super::options::TrainOptions;
use super::params::{Core, OptimizerState, Params};
use super::pyramid::Pyramid;
use super::schedule::Schedule;
use super::shell;
use super::visibility::VisibilityStats;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use trisplat_dataset::{Dataset, DatasetKind, DatasetOptions, Point, View, random_points};
use trisplat_scene::camera::Camera;
use trisplat_scene::report::generator;
use trisplat_scene::{Error, ImportedScene, Placement, Result, SceneNormalization, Soup};

/// Points drawn at random inside the views of the cameras when the data set has none.
const RANDOM_POINTS: usize = 10_000;

/// A run that trains a part of a scene, in agreement with the runs of the other parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainedPart {
    /// Training space of the whole scene, so that lengths and rates agree in all parts.
    pub space: SceneNormalization,
    /// Number of triangles at the front of the starting scene that are drawn but not trained;
    /// `max_triangles` does not count them. The shell follows them.
    pub frozen: usize,
    /// The box of the part that stays after merging, with its own limit of triangles.
    pub core: Option<Core>,
    /// The first step of its schedule; earlier ones trained the whole scene.
    pub first_step: u64,
}

/// The outputs during a run; none of them changes the result.
#[derive(Debug, Clone, Default)]
pub struct TrainOutputs {
    /// Where checkpoints go.
    pub checkpoint: Option<PathBuf>,
    /// Number of last checkpoints to keep, in separate files; 0 means 1.
    pub keep: u32,
    /// Steps between checkpoints; 0 writes one only when the run is stopped.
    pub checkpoint_every: u64,
    /// Steps between samples of the curve; 0 chooses 100 samples per run.
    pub sample_every: u64,
    /// Steps between evaluations on the held-out photos; 0 evaluates once, at the end.
    pub evaluate_every: u64,
    /// Pictures of the first held-out photo.
    pub preview: Option<Preview>,
    /// Stop after this many CPU seconds, as on request; 0 never.
    pub max_cpu_secs: f64,
}

/// Prefix of the file names of previews.
pub const PREVIEW_PREFIX: &str = "step-";

/// Pictures of the first held-out photo while a scene trains.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Preview {
    /// Their folder; files are called `step-000500.png`.
    pub folder: PathBuf,
    /// Time between two previews.
    pub interval: Duration,
}

/// All inputs of a run. [`TrainInputs::new`] has the plain values; any field can be set before the
/// start.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_synthetic::SyntheticOptions;
/// use trisplat_dataset::{Dataset, DatasetOptions};
/// use trisplat_train::{TrainOutputs, TrainOptions, TrainInputs, checkpoint};
///
/// let folder = tempfile::tempdir().unwrap();
/// trisplat_synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let options = TrainOptions { steps: 20, max_triangles: 100, ..TrainOptions::default() };
///
/// // A run that writes checkpoints ...
/// let path = folder.path().join("scene.checkpoint");
/// let outputs = TrainOutputs { checkpoint: Some(path.clone()), checkpoint_every: 10, ..TrainOutputs::default() };
/// let trained = TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) }.run(&mut |_| Continue(()))?;
///
/// // ... and one that goes on from the last of them: the same bits, since it was made after the last step.
/// let resumed = TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path)?).run(&mut |_| Continue(()))?;
/// assert_eq!(trained.soup, resumed.soup);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TrainInputs<'a> {
    /// The photos; those held out evaluate the scene.
    pub dataset: &'a Dataset,
    /// The options of the training; a resumed run has those of its checkpoint.
    pub options: TrainOptions,
    /// The colour behind everything, sRGB-encoded in [0, 1]; the same as for reading the data set.
    pub background: [f32; 3],
    /// Memory for decoded photos, bytes; others are kept on disk.
    pub photo_bytes: u64,
    /// The outputs during the run.
    pub outputs: TrainOutputs,
    /// The scene to start from instead of the data set's points, as a reader returns it; suitable
    /// options are those of [`TrainOptions::from_scene`].
    pub from: Option<ImportedScene>,
    /// Whether that scene may have more triangles than `max_triangles`: a solid run cuts it as it
    /// goes on, by up to a tenth per densification, and has some left if it ends before.
    pub shrink_initial_scene: bool,
    /// The part of that scene to train, if not all; a resumed run has the part of its checkpoint.
    pub part: Option<TrainedPart>,
    /// End after this step, without finishing the schedule. `None`: after the last step.
    pub until_step: Option<u64>,
    /// The checkpoint to resume from.
    pub resume: Option<Checkpoint>,
    /// Keeps the run to a budget; `None` makes the steps of the options. A resumed run has the pace
    /// of its checkpoint, and its spending is counted from here.
    pub paced: Option<BudgetControl>,
    /// Start of the process that resumes a run with a budget; `None`: now.
    pub began: Option<Instant>,
    /// Resume even if photos, cameras, points or the background differ from those of the
    /// checkpoint.
    pub force_resume: bool,
}

impl<'a> TrainInputs<'a> {
    /// A run from its beginning without outputs, with the background and the memory for photos of
    /// [`DatasetOptions::default`].
    pub fn new(dataset: &'a Dataset, options: &TrainOptions) -> Self {
        let run = Self {
            dataset,
            options: options.clone(),
            background: [0.0; 3],
            photo_bytes: 0,
            outputs: TrainOutputs::default(),
            from: None,
            shrink_initial_scene: false,
            part: None,
            until_step: None,
            resume: None,
            paced: None,
            began: None,
            force_resume: false,
        };
        run.with_dataset_options(&DatasetOptions::default())
    }

    /// The rest of the run of `checkpoint`.
    pub fn from_checkpoint(dataset: &'a Dataset, checkpoint: Checkpoint) -> Self {
        let run = Self::new(dataset, &checkpoint.meta.options);
        Self { resume: Some(checkpoint), ..run }
    }

    /// With the data set's background and memory for photos.
    pub fn with_dataset_options(self, options: &DatasetOptions) -> Self {
        let photo_bytes = options.photo_bytes();
        Self { background: options.background.to_f32(), photo_bytes, ..self }
    }
}

/// The state of `run` before its first step, from the triangles of a scene or from the points of
/// the data set.
///
/// # Errors
///
/// Those of [`from_points`] and [`from_scene`].
pub(super) fn first(
    views: &[&View],
    run: &TrainInputs<'_>,
    identity: RunIdentity,
    photos: &mut Pyramid,
) -> Result<Checkpoint> {
    let options = &run.options;
    let (space, state) = match &run.from {
        Some(scene) => from_scene(views, scene, run)?,
        None => from_points(views, &not_judging(run.dataset), photos, options)?,
    };
    let level = Schedule::new(options).level(0);
    let exposure = ExposureEstimates::new(run.dataset, options, |i| photos.take(i, level))?;
    let first_step = run.part.filter(|_| run.from.is_some()).map_or(0, |part| part.first_step);
    let meta = CheckpointMeta {
        generator: generator(),
        step: first_step.min(options.steps.saturating_sub(1)),
        options: options.clone(),
        space: (space.center.to_array(), space.scale),
        pinned: state.pinned,
        frozen: state.frozen,
        core: run.part.filter(|_| run.from.is_some()).and_then(|part| part.core),
        exposure,
        identity,
        dropped: 0,
        curve: Vec::new(),
        cpu_secs: 0.0,
        pace: None,
    };
    Ok(Checkpoint {
        visibility: VisibilityStats::new(state.params.len(), views.len()),
        state,
        meta,
    })
}

/// The points to start from: where photos track points, a fifth of them judges the depth of the
/// result.
fn not_judging(dataset: &Dataset) -> Cow<'_, [Point]> {
    if dataset.has_tracks() {
        let kept =
            dataset.points.iter().enumerate().filter(|(i, _)| !Dataset::is_validation_point(*i));
        Cow::Owned(kept.map(|(_, point)| *point).collect())
    } else {
        Cow::Borrowed(&dataset.points)
    }
}

/// The first triangles: one per point of the sparse or a random cloud, and the shell around a
/// cloud.
///
/// # Errors
///
/// Photos that cannot be decoded.
fn from_points(
    views: &[&View],
    points: &[Point],
    photos: &mut Pyramid,
    options: &TrainOptions,
) -> Result<(SceneNormalization, OptimizerState)> {
    let random;
    let cloud = if points.is_empty() {
        random = random_points(views, RANDOM_POINTS, options.seed);
        &random
    } else {
        points
    };
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    let space = SceneNormalization::of(&cameras, cloud.len(), |i| cloud[i].position);
    // Points are first thinned to the limit of triangles, because sizes come from the gaps between
    // the remaining points.
    let cloud = thinned(cloud, usize::try_from(options.max_triangles).unwrap_or(usize::MAX));
    let init_points: Vec<InitPoint> = cloud
        .iter()
        .map(|p| InitPoint {
            position: space.to_training(p.position),
            rgb: p.rgb.map(|c| f32::from(c) / 255.0),
        })
        .collect();
    let mut soup = match shell::subdivisions(options) {
        Some(subdivisions) => {
            let cameras: Vec<Camera> =
                cameras.iter().map(|c| space.camera_to_training(c)).collect();
            let positions: Vec<Vec3> = init_points.iter().map(|p| p.position).collect();
            shell::shell(&positions, &cameras, photos, subdivisions)?
        }
        None => Soup::default(),
    };
    let pinned = soup.len();
    let mut first = first_soup(&init_points, &options.init, options.seed);
    let most =
        usize::try_from(options.max_triangles).unwrap_or(usize::MAX).saturating_sub(soup.len());
    let count = first.len();
    first.retain(|i| is_among(i, most, count));
    soup.append(first);
    Ok((
        space,
        OptimizerState {
            pinned,
            ..OptimizerState::new(Params::from_soup(&soup, options.sh_degree))
        },
    ))
}

/// At most `most` of the items, evenly.
pub(super) fn thinned<T: Copy>(items: &[T], most: usize) -> Cow<'_, [T]> {
    if items.len() > most {
        let kept = items.iter().enumerate().filter(|(i, _)| is_among(*i, most, items.len()));
        Cow::Owned(kept.map(|(_, item)| *item).collect())
    } else {
        Cow::Borrowed(items)
    }
}

/// Whether entry `i` of `count` is in an even selection of `most`; the order of points in files has
/// no meaning.
pub(super) fn is_among(i: usize, most: usize, count: usize) -> bool {
    count <= most
        || (i as u128 + 1) * most as u128 / count as u128 > i as u128 * most as u128 / count as u128
}

/// The triangles of an existing scene.
///
/// # Errors
///
/// More triangles than the options permit, unless they are cut; none at all.
fn from_scene(
    views: &[&View],
    scene: &ImportedScene,
    run: &TrainInputs<'_>,
) -> Result<(SceneNormalization, OptimizerState)> {
    let TrainInputs { dataset, options, part, .. } = run;
    let frozen = part.map_or(0, |part| part.frozen);
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    // Pictures drawn of the scene are in the frame of its file.
    let placement = match dataset.kind {
        DatasetKind::Drawn => Placement::IDENTITY,
        _ => scene.provenance.placement,
    };
    let positions = || {
        if dataset.points.is_empty() {
            centers(scene, &placement, dataset.origin)
        } else {
            dataset.points.iter().map(|p| p.position).collect()
        }
    };
    let space =
        part.map_or_else(|| SceneNormalization::new(&cameras, &positions()), |part| part.space);
    let most =
        (!run.shrink_initial_scene).then_some(options.max_triangles.saturating_add(frozen as u64));
    let mut soup = placed_soup(scene, &placement, dataset.origin, &space, most)?;
    // Those of a part come in this order: frozen ones, its part of the shell, the rest.
    let shell = if part.is_some() { soup.shell_count() } else { soup.put_shell_first() };
    let mut state = OptimizerState::new(Params::from_soup(&soup, options.sh_degree));
    state.frozen = frozen.min(soup.len());
    state.pinned = (frozen + shell).min(soup.len());
    let first_step = part.map_or(0, |part| part.first_step).min(options.steps.saturating_sub(1));
    if let Some(last) = first_step.checked_sub(1) {
        state.params.go_on_at(&Schedule::new(options).anneal(last), frozen);
    }
    Ok((space, state))
}

/// The triangles of `scene` in training space. Undoes the `placement` of its file, and moves it
/// like the data set: `origin` is the world point at (0, 0, 0) of the data set.
///
/// # Errors
///
/// More triangles than `most`, if given, or none at all.
fn placed_soup(
    scene: &ImportedScene,
    placement: &Placement,
    origin: DVec3,
    space: &SceneNormalization,
    most: Option<u64>,
) -> Result<Soup> {
    let mut soup = scene.scene.to_soup();
    if soup.is_empty() {
        return Err(Error::invalid("from", "a scene without triangles", "one or more triangles"));
    }
    if let Some(most) = most.filter(|most| soup.len() as u64 > *most) {
        let wants = format!("{} or more, as many as the scene to start from has", soup.len());
        return Err(Error::invalid("max_triangles", most, wants));
    }
    for corner in soup.vertices.iter_mut().flatten() {
        let world: Vec3 = (placement.to_world_f64(*corner) - origin).as_vec3();
        *corner = space.to_training(world);
    }
    Ok(soup)
}

/// Replaces the points of a data set without points: places of the triangles of `scene`, in its
/// world.
fn centers(scene: &ImportedScene, placement: &Placement, origin: DVec3) -> Vec<Vec3> {
    let center = |i: usize| {
        let sum: DVec3 =
            scene.scene.corners(i).iter().map(|corner| placement.to_world_f64(*corner)).sum();
        (sum / 3.0 - origin).as_vec3()
    };
    (0..scene.scene.triangle_count()).map(center).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_is_thinned_evenly_and_only_where_it_has_too_many_points() {
        let point = |i: usize| Point { position: Vec3::X * i as f32, rgb: [0; 3], error: None };
        let cloud: Vec<Point> = (0..1000).map(point).collect();
        assert!(matches!(thinned(&cloud, 1000), Cow::Borrowed(_)));
        let kept = thinned(&cloud, 130);
        assert_eq!(kept.len(), 130);
        let gaps = kept.windows(2).map(|pair| pair[1].position.x - pair[0].position.x);
        assert!(gaps.into_iter().all(|gap| (7.0..=8.0).contains(&gap)));
        assert!(thinned(&cloud, 0).is_empty());
    }
}
