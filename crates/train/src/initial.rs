//! The state before the first step: triangles at the points of a data set, or those of a scene.

use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::exposure::ExposureEstimates;
use super::identity::RunIdentity;
use super::init::{InitPoint, first_soup};
use super::inputs::TrainInputs;
use super::options::TrainOptions;
use super::params::{OptimizerState, Params};
use super::pyramid::Pyramid;
use super::schedule::Schedule;
use super::shell;
use super::visibility::VisibilityStats;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use trisplat_dataset::{Dataset, DatasetKind, Point, View, random_points};
use trisplat_scene::camera::Camera;
use trisplat_scene::report::generator;
use trisplat_scene::{Error, ImportedScene, Placement, Result, SceneNormalization, Soup};

/// Number of points drawn at random inside the views of the cameras when the data set has none.
const RANDOM_POINTS: usize = 10_000;

/// The checkpoint before the first step, from the triangles of a scene or from the points of the
/// data set.
///
/// # Errors
///
/// As [`from_points`] and [`from_scene`].
pub(super) fn initial_checkpoint(
    views: &[&View],
    inputs: &TrainInputs<'_>,
    identity: RunIdentity,
    photos: &mut Pyramid,
) -> Result<Checkpoint> {
    let options = &inputs.options;
    let (space, state) = match &inputs.from {
        Some(scene) => from_scene(views, scene, inputs)?,
        None => from_points(views, &training_points(inputs.dataset), photos, options)?,
    };
    let level = Schedule::new(options).level(0);
    let exposure = ExposureEstimates::new(inputs.dataset, options, |i| photos.take(i, level))?;
    let part = inputs.part.filter(|_| inputs.from.is_some());
    let first_step = part.map_or(0, |part| part.first_step);
    let meta = CheckpointMeta {
        generator: generator(),
        step: first_step.min(options.steps.saturating_sub(1)),
        options: options.clone(),
        space: (space.center.to_array(), space.scale),
        pinned: state.pinned,
        frozen: state.frozen,
        core: part.and_then(|part| part.core),
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

/// The points to start from. Where photos track points, a fifth of them is left out: it validates
/// the depth of the result.
fn training_points(dataset: &Dataset) -> Cow<'_, [Point]> {
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
    let cloud = even_subset(cloud, usize::try_from(options.max_triangles).unwrap_or(usize::MAX));
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
    let max_triangles = usize::try_from(options.max_triangles).unwrap_or(usize::MAX);
    let kept = max_triangles.saturating_sub(soup.len());
    let count = first.len();
    first.retain(|i| in_even_subset(i, kept, count));
    soup.append(first);
    Ok((
        space,
        OptimizerState {
            pinned,
            ..OptimizerState::new(Params::from_soup(&soup, options.sh_degree))
        },
    ))
}

/// At most `count` of the items, evenly.
pub(super) fn even_subset<T: Copy>(items: &[T], count: usize) -> Cow<'_, [T]> {
    if items.len() > count {
        let kept = items.iter().enumerate().filter(|(i, _)| in_even_subset(*i, count, items.len()));
        Cow::Owned(kept.map(|(_, item)| *item).collect())
    } else {
        Cow::Borrowed(items)
    }
}

/// True if item `i` of `n` is in an even subset of `k`; the order of points in files has no meaning.
pub(super) fn in_even_subset(i: usize, k: usize, n: usize) -> bool {
    n <= k || (i as u128 + 1) * k as u128 / n as u128 > i as u128 * k as u128 / n as u128
}

/// The triangles of an existing scene.
///
/// # Errors
///
/// More triangles than the options permit, unless the scene may shrink; none at all.
fn from_scene(
    views: &[&View],
    scene: &ImportedScene,
    inputs: &TrainInputs<'_>,
) -> Result<(SceneNormalization, OptimizerState)> {
    let TrainInputs { dataset, options, part, .. } = inputs;
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
    let max_triangles = (!inputs.shrink_initial_scene)
        .then_some(options.max_triangles.saturating_add(frozen as u64));
    let mut soup = placed_soup(scene, &placement, dataset.origin, &space, max_triangles)?;
    // A part has its triangles in this order: frozen ones, its part of the shell, the rest.
    let shell = if part.is_some() { soup.shell_count() } else { soup.put_shell_first() };
    let mut state = OptimizerState::new(Params::from_soup(&soup, options.sh_degree));
    state.frozen = frozen.min(soup.len());
    state.pinned = (frozen + shell).min(soup.len());
    let first_step = part.map_or(0, |part| part.first_step).min(options.steps.saturating_sub(1));
    if let Some(last) = first_step.checked_sub(1) {
        state.params.anneal_soft(&Schedule::new(options).anneal(last), frozen);
    }
    Ok((space, state))
}

/// The triangles of `scene` in training space. Undoes the `placement` of its file, and moves it
/// like the data set: `origin` is the world point at (0, 0, 0) of the data set.
///
/// # Errors
///
/// More triangles than `max_triangles`, if it is given, or none at all.
fn placed_soup(
    scene: &ImportedScene,
    placement: &Placement,
    origin: DVec3,
    space: &SceneNormalization,
    max_triangles: Option<u64>,
) -> Result<Soup> {
    let mut soup = scene.scene.to_soup();
    if soup.is_empty() {
        return Err(Error::invalid("from", "a scene without triangles", "one or more triangles"));
    }
    if let Some(limit) = max_triangles.filter(|limit| soup.len() as u64 > *limit) {
        let wants = format!("{} or more, as many as the scene to start from has", soup.len());
        return Err(Error::invalid("max_triangles", limit, wants));
    }
    for corner in soup.vertices.iter_mut().flatten() {
        let world: Vec3 = (placement.to_world_f64(*corner) - origin).as_vec3();
        *corner = space.to_training(world);
    }
    Ok(soup)
}

/// Centres of the triangles of `scene`, in the world of the data set: they replace its points if it
/// has none.
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
    fn point_cloud_is_thinned_evenly_above_the_limit() {
        let point = |i: usize| Point { position: Vec3::X * i as f32, rgb: [0; 3], error: None };
        let cloud: Vec<Point> = (0..1000).map(point).collect();
        assert!(matches!(even_subset(&cloud, 1000), Cow::Borrowed(_)));
        let kept = even_subset(&cloud, 130);
        assert_eq!(kept.len(), 130);
        let gaps = kept.windows(2).map(|pair| pair[1].position.x - pair[0].position.x);
        assert!(gaps.into_iter().all(|gap| (7.0..=8.0).contains(&gap)));
        assert!(even_subset(&cloud, 0).is_empty());
    }
}
