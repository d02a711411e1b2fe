//! Poses of training photos, from the tracks of a COLMAP model: where its photos show its points.
//!
//! A camera that stands elsewhere than its photo's points say blurs the scene. Poses and points are found in turn, by
//! robust Gauss-Newton steps on the reprojection error, from those of the model. A bundle adjustment has done the same
//! before, so its poses stay as they are. Held-out photos are neither used nor changed.

use super::colmap;
use super::colmap_model::Model;
use super::kind::DatasetKind;
use super::options::DatasetOptions;
use super::posed::{Dataset, View};
use glam::{DMat3, DQuat, DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use trisplat_scene::{
    Result,
    camera::Camera,
    math::median::median,
    math::normal_equations,
    report::{StageDetails, counted},
};

/// Fewest points that place a photo.
const LEAST_POINTS: usize = 15;
/// Rounds of poses and points in turn.
const ROUNDS: u32 = 40;
/// Rounds of points alone.
const POINT_ROUNDS: u32 = 6;
/// Smaller motions end the rounds, px.
const SETTLED_PX: f64 = 0.002;
/// Mean motion that counts, px.
const LEAST_PX: f32 = 0.1;
/// How often larger than by chance the gain of six numbers per photo must be (the statistic of an F-test): then motions are
/// about three times their uncertainty. Of 24 photos, a gain of 4 made poses worse that 292 photos had found together
/// (docs/benchmarks/poses.md).
const LEAST_GAIN: f64 = 10.0;
/// Largest motion of a photo, as a share of its longest side: others have wrong tracks, or poses of another model.
const MOST_SHARE: f64 = 0.02;
/// Errors above this multiple of the median count by their size instead of its square (Huber).
const ROBUST: f64 = 2.0;
/// Least error from which they do, px: below it, observations are rounded.
const LEAST_ROBUST_PX: f64 = 0.3;

/// What the tracks say about the poses of the training photos.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackedPoses {
    /// Observations of points that at least two training photos show.
    pub observations: u64,
    /// Median reprojection error with the given poses and with the found ones, px of the photos as decoded; points are at
    /// their best places for each.
    pub error_px: [f32; 2],
    /// How often larger than by chance the gain by the found poses is.
    pub gain: f32,
    /// Mean over the photos of how far their points move, root mean square, px.
    pub moved_px: f32,
    /// Photos that moved.
    pub moved: u64,
    /// Photos that keep their pose because the tracks place them too far away.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub kept: Vec<String>,
}

impl StageDetails for TrackedPoses {
    const STAGE: &'static str = "poses";
}

impl TrackedPoses {
    /// The result in words, for people; `None` if nothing moved.
    pub fn summary(&self) -> Option<String> {
        let [before, after] = self.error_px;
        (self.moved > 0).then(|| {
            format!(
                "{} moved by {:.2} px on average to where their tracks see them: reprojection error {before:.2} → {after:.2} px",
                counted(self.moved, "photo"),
                self.moved_px
            )
        })
    }

    /// The photos whose tracks contradict their poses; `None` without any.
    pub fn warning(&self) -> Option<String> {
        let first = self.kept.first()?;
        let more = match self.kept.len() {
            1 => String::new(),
            count => format!(" and {} more", count - 1),
        };
        Some(format!(
            "the tracks of `{first}`{more} contradict their poses by more than {:.0}% of the picture: the poses stay; find them again",
            100.0 * MOST_SHARE
        ))
    }
}

/// A posed photo and its observations.
struct Photo {
    rotation: DMat3,
    translation: DVec3,
    focal: f64,
    /// Point, and direction (x / z, y / z).
    seen: Vec<(usize, DVec2)>,
}

/// Moves the training photos of `dataset` to where their tracks see their points, unless they are there already; says
/// what was found. `None`: the data set has no tracks.
///
/// Errors: a model that cannot be read.
pub fn follow_tracks(dataset: &mut Dataset, options: &DatasetOptions) -> Result<Option<TrackedPoses>> {
    let is_model = matches!(dataset.kind, DatasetKind::ColmapBinary | DatasetKind::ColmapText);
    let Some(files) = colmap::locate(&dataset.path).filter(|_| is_model) else { return Ok(None) };
    let (model, places) = (files.model(&options.limits, true)?, files.places(&options.limits)?);
    let views: Vec<&View> = dataset.train().collect();
    let (mut photos, mut points) = tracks(&model, &places, dataset.origin, &views);
    let observations: u64 = photos.iter().map(|photo| photo.seen.len() as u64).sum();
    if observations == 0 {
        return Ok(None);
    }
    let given: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let first_points = points.clone();
    let first: Vec<_> = photos.iter().map(|photo| photo.directions(&points)).collect();
    let mut settled = points.clone();
    adjust(&mut photos, &mut settled, false);
    let before = median_px(&photos, &settled);
    let robust_px = robust_px(before);
    let cost_before = cost(&photos, &settled, robust_px);
    adjust(&mut photos, &mut points, true);
    let (after, cost_after) = (median_px(&photos, &points), cost(&photos, &points, robust_px));
    back_to_frame(&mut photos, &first_points, &points);
    let unknowns = 6 * photos.len() as u64;
    let free = (2 * observations).saturating_sub(3 * points.len() as u64 + unknowns);
    let gain = (cost_before - cost_after) / unknowns as f64 * free as f64 / cost_after.max(f64::MIN_POSITIVE);
    let mut found = TrackedPoses { observations, gain: gain as f32, ..TrackedPoses::default() };
    found.error_px = [before as f32, after as f32];
    let mut cameras = given.clone();
    let mut moved = Vec::new();
    for (k, photo) in photos.iter().enumerate() {
        let by = photo.moved_px(&first[k], &first_points);
        let most = MOST_SHARE * f64::from(given[k].size.max_element());
        if photo.seen.len() >= LEAST_POINTS && by <= most {
            moved.push(by);
            cameras[k] = photo.camera(&given[k]);
        } else if !(by <= most) {
            found.kept.push(views[k].name.clone());
        }
    }
    found.moved_px = (moved.iter().sum::<f64>() / moved.len().max(1) as f64) as f32;
    if found.moved_px >= LEAST_PX && gain >= LEAST_GAIN {
        found.moved = moved.len() as u64;
        let training = dataset.views.iter_mut().filter(|view| !view.test);
        training.zip(cameras).for_each(|(view, camera)| view.camera = camera);
    }
    Ok(Some(found))
}

/// The photos of `views` with their observations, and the points that at least two of them show.
fn tracks(
    model: &Model,
    places: &HashMap<u64, DVec3>,
    origin: DVec3,
    views: &[&View],
) -> (Vec<Photo>, Vec<DVec3>) {
    let rows: HashMap<String, _> =
        model.images.iter().map(|image| (image.name.replace('\\', "/"), image)).collect();
    let rows: Vec<_> = views.iter().map(|view| rows.get(&view.name)).collect();
    let mut times: HashMap<u64, u32> = HashMap::new();
    for (id, _) in rows.iter().flatten().flat_map(|image| &image.observations) {
        *times.entry(*id).or_default() += 1;
    }
    let (mut index, mut points) = (HashMap::new(), Vec::new());
    let mut photo = |view: &View, k: usize| {
        let lens = rows[k].and_then(|image| model.cameras.get(&image.camera));
        let mut seen = Vec::new();
        for (id, at) in rows[k].iter().flat_map(|image| &image.observations) {
            let (Some(place), Some(lens), true) = (places.get(id), lens, times[id] > 1) else { continue };
            let Some(direction) = lens.direction(at.as_dvec2()).filter(|d| d.is_finite()) else { continue };
            let point = *index.entry(*id).or_insert_with(|| {
                points.push(*place - origin);
                points.len() - 1
            });
            seen.push((point, direction));
        }
        Photo::of(&view.camera, seen)
    };
    let photos = views.iter().enumerate().map(|(k, view)| photo(view, k)).collect();
    (photos, points)
}

impl Photo {
    fn of(camera: &Camera, seen: Vec<(usize, DVec2)>) -> Self {
        let (rotation, translation) = (camera.rotation.as_dmat3(), camera.translation.as_dvec3());
        Self { rotation, translation, focal: camera.mean_focal(), seen }
    }

    fn camera(&self, given: &Camera) -> Camera {
        let (rotation, translation) = (self.rotation.as_mat3(), self.translation.as_vec3());
        Camera { rotation, translation, ..*given }
    }

    /// Where the photo shows a point, as a direction; `None` behind it.
    fn direction(&self, point: DVec3) -> Option<DVec2> {
        let q = self.rotation * point + self.translation;
        let direction = q.truncate() / q.z;
        (q.z > 0.0 && direction.is_finite()).then_some(direction)
    }

    /// Where the photo shows each of its points.
    fn directions(&self, points: &[DVec3]) -> Vec<Option<DVec2>> {
        self.seen.iter().map(|(point, _)| self.direction(points[*point])).collect()
    }

    /// How far its points have moved since they were at `from`, root mean square, px.
    fn moved_px(&self, from: &[Option<DVec2>], points: &[DVec3]) -> f64 {
        let moved = self.seen.iter().zip(from).filter_map(|((point, _), from)| {
            Some(self.direction(points[*point])?.distance_squared((*from)?))
        });
        let (sum, count) = moved.fold((0.0, 0u32), |(sum, count), moved| (sum + moved, count + 1));
        self.focal * (sum / f64::from(count.max(1))).sqrt()
    }

    /// The sum of the robust costs of its errors, px².
    fn cost(&self, points: &[DVec3], robust_px: f64) -> f64 {
        // A point behind the photo costs more than any before it.
        let error = |(point, at): &(usize, DVec2)| {
            self.direction(points[*point]).map_or(1e6, |direction| self.focal * direction.distance(*at))
        };
        self.seen.iter().map(|seen| robust(error(seen), robust_px)[1]).sum()
    }
}

/// Reprojection errors of all observations, px.
fn errors_px<'a>(photos: &'a [Photo], points: &'a [DVec3]) -> impl Iterator<Item = f64> + 'a {
    photos.iter().flat_map(move |photo| {
        let error = |(point, at): &(usize, DVec2)| Some(photo.direction(points[*point])?.distance(*at));
        photo.seen.iter().filter_map(error).map(|error| error * photo.focal)
    })
}

fn median_px(photos: &[Photo], points: &[DVec3]) -> f64 {
    median(errors_px(photos, points).collect(), f64::total_cmp).unwrap_or(0.0)
}

fn cost(photos: &[Photo], points: &[DVec3], robust_px: f64) -> f64 {
    photos.iter().map(|photo| photo.cost(points, robust_px)).sum()
}

/// The error above which errors count by their size, from the median one.
fn robust_px(median_px: f64) -> f64 {
    (ROBUST * median_px).max(LEAST_ROBUST_PX)
}

/// Points in turn with poses, if these are `free`, until all stay.
fn adjust(photos: &mut [Photo], points: &mut [DVec3], free: bool) {
    let mut rays: Vec<Vec<(usize, DVec2)>> = vec![Vec::new(); points.len()];
    for (k, photo) in photos.iter().enumerate() {
        photo.seen.iter().for_each(|(point, direction)| rays[*point].push((k, *direction)));
    }
    for round in 1..=ROUNDS {
        let robust_px = robust_px(median_px(photos, points));
        let mut largest = 0f64;
        for photo in photos.iter_mut().filter(|photo| free && photo.seen.len() >= LEAST_POINTS) {
            largest = largest.max(place_photo(photo, points, robust_px));
        }
        for (point, rays) in points.iter_mut().zip(&rays) {
            place_point(point, rays, photos, robust_px);
        }
        if largest < SETTLED_PX && (free || round == POINT_ROUNDS) {
            break;
        }
    }
}

/// Takes out of the poses the motion, rotation and scale that all points have in common, which no photo shows: held-out
/// photos stay in the given frame.
fn back_to_frame(photos: &mut [Photo], given: &[DVec3], found: &[DVec3]) {
    let center = given.iter().sum::<DVec3>() / given.len().max(1) as f64;
    let (mut matrix, mut right) = ([[0.0; 7]; 7], [0.0; 7]);
    for photo in &*photos {
        for (point, _) in &photo.seen {
            let arm = given[*point] - center;
            let q = photo.rotation * given[*point] + photo.translation;
            let (Some(from), Some(to)) = (photo.direction(given[*point]), photo.direction(found[*point]))
            else {
                continue;
            };
            let [weight, _] = robust(photo.focal * from.distance(to), LEAST_ROBUST_PX);
            for (axis, slope) in slopes(q).into_iter().enumerate() {
                let slope = photo.focal * (photo.rotation.transpose() * slope);
                let turn = arm.cross(slope);
                let row = [turn.x, turn.y, turn.z, slope.x, slope.y, slope.z, arm.dot(slope)];
                let wanted = photo.focal * (to[axis] - from[axis]);
                normal_equations::add(&mut matrix, &mut right, &row, wanted, weight);
            }
        }
    }
    let step = normal_equations::solved(matrix, right);
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&step[..3])));
    let (motion, growth) = (DVec3::from_slice(&step[3..6]), 1.0 + step[6]);
    // A given point p is at growth · turn (p - center) + center + motion now, which the photos see as before.
    for photo in photos {
        let middle = photo.rotation * (center + motion) + photo.translation;
        photo.rotation *= turn;
        photo.translation = middle / growth - photo.rotation * center;
    }
}

/// The weight of an error of this size, and its cost (Huber).
fn robust(error_px: f64, robust_px: f64) -> [f64; 2] {
    match error_px <= robust_px {
        true => [1.0, error_px * error_px],
        false => [robust_px / error_px, robust_px * (2.0 * error_px - robust_px)],
    }
}

/// The slope of a direction by a motion of the point in the camera's frame, both rows.
fn slopes(q: DVec3) -> [DVec3; 2] {
    [DVec3::new(1.0, 0.0, -q.x / q.z) / q.z, DVec3::new(0.0, 1.0, -q.y / q.z) / q.z]
}

/// One step of a photo's pose towards its observations; how far it moved, px. A step that raises the error is not made.
fn place_photo(photo: &mut Photo, points: &[DVec3], robust_px: f64) -> f64 {
    let (mut matrix, mut right, focal) = ([[0.0; 6]; 6], [0.0; 6], photo.focal);
    for (point, at) in &photo.seen {
        let q = photo.rotation * points[*point] + photo.translation;
        let Some(direction) = photo.direction(points[*point]) else { continue };
        let [weight, _] = robust(focal * direction.distance(*at), robust_px);
        for (axis, slope) in slopes(q).into_iter().enumerate() {
            // Of turn × q + motion.
            let turn = q.cross(slope);
            let row = [turn.x, turn.y, turn.z, slope.x, slope.y, slope.z].map(|s| focal * s);
            let wanted = focal * (at[axis] - direction[axis]);
            normal_equations::add(&mut matrix, &mut right, &row, wanted, weight);
        }
    }
    let step = normal_equations::solved(matrix, right);
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&step[..3])));
    let translation = turn * photo.translation + DVec3::from_slice(&step[3..]);
    let before = (photo.rotation, photo.translation, photo.cost(points, robust_px));
    let places = photo.directions(points);
    (photo.rotation, photo.translation) = (turn * photo.rotation, translation);
    let better = photo.cost(points, robust_px) < before.2;
    if !better {
        (photo.rotation, photo.translation) = (before.0, before.1);
        return 0.0;
    }
    photo.moved_px(&places, points)
}

/// One step of a point towards its observations; a step that raises the error is not made.
fn place_point(point: &mut DVec3, rays: &[(usize, DVec2)], photos: &[Photo], robust_px: f64) {
    let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    let mut before = 0.0;
    for (k, at) in rays {
        let photo = &photos[*k];
        let Some(direction) = photo.direction(*point) else { return };
        let [weight, cost] = robust(photo.focal * direction.distance(*at), robust_px);
        before += cost;
        let q = photo.rotation * *point + photo.translation;
        for (axis, slope) in slopes(q).into_iter().enumerate() {
            let row = (photo.focal * (photo.rotation.transpose() * slope)).to_array();
            let wanted = photo.focal * (at[axis] - direction[axis]);
            normal_equations::add(&mut matrix, &mut right, &row, wanted, weight);
        }
    }
    let next = *point + DVec3::from_array(normal_equations::solved(matrix, right));
    let after: Option<f64> = rays
        .iter()
        .map(|(k, at)| {
            let photo = &photos[*k];
            let error = photo.focal * photo.direction(next)?.distance(*at);
            Some(robust(error, robust_px)[1])
        })
        .sum();
    if after.is_some_and(|after| after < before) {
        *point = next;
    }
}
