//! Removes the triangles that an engine cannot draw or that cannot be seen.
//!
//! The stage comes first because every later stage costs per triangle. Geometry after it is finite
//! and within ±[`REACH`], as the hierarchy and engines' culling require.

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::{Outcome, counted, to_json};
use trisplat_scene::{Error, Result, Scene, Soup};
use trisplat_surface::connected_faces;

/// Largest permitted coordinate. A few million squares or areas of larger ones overflow an f32 in
/// an engine or a hierarchy, so such triangles cannot be drawn.
pub const REACH: f32 = 1e15;

/// If the median triangle is nearer than this share of the reach, triangles out of reach are
/// strays, not the scene.
const MAX_SCENE_SHARE: f32 = 1e-3;

/// A triangle with at most this ratio of height to longest edge is a line: the ratio is the
/// rounding error of that edge.
const MAX_FLATNESS: f64 = f32::EPSILON as f64;

/// Limits below or beyond which triangles are dropped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct PruneOptions {
    /// Drop triangles of lower opacity (0 keeps all; engine-mode training itself drops below 0.1,
    /// then 0.7)
    #[cfg_attr(feature = "cli", arg(skip = PruneOptions::DEFAULT.min_opacity))]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_opacity: f64,
    /// Drop triangles of higher sigma, the softest ones (0 keeps all; engine-mode training drops
    /// from 1)
    #[cfg_attr(feature = "cli", arg(skip = PruneOptions::DEFAULT.max_sigma))]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub max_sigma: f64,
    /// Keep at most this many triangles: of a soup those with the largest opacity times area times
    /// mean window; where triangles share edges, edges collapse
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub max_triangles: Option<u64>,
}

impl PruneOptions {
    /// The authors' trainer drops triangles of opacity 0.014 (`opacity_dead`). At σ = 10 an opaque
    /// triangle covers as little, 2 / ((σ + 1)(σ + 2)) = 0.015 of its area. Removing either changes
    /// nothing visible in a soft scene.
    pub const DEFAULT: Self = Self { min_opacity: 0.014, max_sigma: 10.0, max_triangles: None };
    /// Also removes triangles that are hardly visible, to save bytes.
    pub const SMALL: Self = Self { min_opacity: 0.05, max_sigma: 5.0, ..Self::DEFAULT };

    /// Checks the ranges.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(PruneOptions);

/// Triangles dropped, by cause.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PruneDetails {
    /// Triangles with a number that is NaN or infinite.
    pub non_finite: u64,
    /// Triangles with a coordinate beyond 1e15, which engines cannot draw.
    #[serde(default)]
    pub out_of_reach: u64,
    /// Triangles whose corners lie on a line or a point.
    pub degenerate: u64,
    /// Triangles below `min_opacity`.
    pub faint: u64,
    /// Triangles above `max_sigma`.
    pub soft: u64,
    /// Triangles beyond `max_triangles`.
    pub over_budget: u64,
}

trisplat_scene::stage!(PruneDetails, "prune");

/// Drops triangles by the rules of `options` and counts them by cause in `details`.
///
/// The rules look at one triangle each; the budget of `max_triangles` applies to their result. So a
/// second run finds nothing to drop.
///
/// # Errors
///
/// An option out of range; nothing left; a scene that reaches farther than [`REACH`].
pub fn prune(
    scene: &mut Scene,
    options: &PruneOptions,
    details: &mut PruneDetails,
) -> Result<Outcome<()>> {
    options.validate()?;
    let verdicts = match &*scene {
        Scene::Soup(soup) => classify(soup.len(), |i| soup_face(soup, i), &[], options),
        Scene::Mesh(mesh) => {
            let exceeds = options.max_triangles.is_some_and(|n| mesh.face_count() as u64 > n);
            let kept = if exceeds { connected_flags(mesh) } else { Vec::new() };
            classify(mesh.face_count(), |i| mesh_face(mesh, i), &kept, options)
        }
    };
    let counts = PruneDetails::of(&verdicts);
    if counts.out_of_reach > 0 {
        check_scale(&verdicts, counts.out_of_reach, |i| scene.corners(i))?;
    }
    if verdicts.iter().all(|verdict| *verdict != PruneDecision::Keep) {
        return Err(nothing_left(options, &counts, verdicts.len()));
    }
    if counts == PruneDetails::default() {
        return Ok(Outcome::Skipped("every triangle can be seen"));
    }
    *details = counts;
    let keep = |i: usize| verdicts[i] == PruneDecision::Keep;
    match scene {
        Scene::Soup(soup) => soup.retain(keep),
        Scene::Mesh(mesh) => mesh.retain(keep),
    }
    Ok(Outcome::Changed(()))
}

/// Refuses a scene that is too large to be drawn; strays far from a scene of ordinary size are
/// dropped.
fn check_scale(
    verdicts: &[PruneDecision],
    far: u64,
    corners: impl Fn(usize) -> [Vec3; 3],
) -> Result<()> {
    let finite = (0..verdicts.len()).filter(|i| verdicts[*i] != PruneDecision::NonFinite);
    let reaches: Vec<f32> = finite.map(|i| reach(&corners(i))).collect();
    let farthest = reaches.iter().copied().fold(0.0, f32::max);
    let typical = median(reaches, f32::total_cmp).unwrap_or(0.0);
    if typical < MAX_SCENE_SHARE * REACH {
        return Ok(());
    }
    let what =
        format!("{far} of {} triangles farther than {REACH:e} from the origin", verdicts.len());
    let exponent = -f64::from(farthest).log10().ceil() as i32;
    let wants = format!(
        "coordinates that engines can draw; multiply those of the file by 1e{exponent}, say"
    );
    Err(Error::invalid("the scene", what, wants))
}

impl PruneDetails {
    /// Warning of triangles that engines cannot draw.
    pub fn warning(&self) -> Option<String> {
        let far = self.out_of_reach;
        (far > 0).then(|| {
            format!(
                "dropped {} farther than {REACH:e} from the origin: engines cannot draw them",
                counted(far, "triangle")
            )
        })
    }

    /// The number of triangles of each [`PruneDecision`].
    fn of(verdicts: &[PruneDecision]) -> Self {
        let mut counts = Self::default();
        for verdict in verdicts {
            *match verdict {
                PruneDecision::Keep => continue,
                PruneDecision::NonFinite => &mut counts.non_finite,
                PruneDecision::OutOfReach => &mut counts.out_of_reach,
                PruneDecision::Degenerate => &mut counts.degenerate,
                PruneDecision::Faint => &mut counts.faint,
                PruneDecision::Soft => &mut counts.soft,
                PruneDecision::OverBudget => &mut counts.over_budget,
            } += 1;
        }
        counts
    }
}

/// Decision about a triangle, with its reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PruneDecision {
    Keep,
    NonFinite,
    OutOfReach,
    Degenerate,
    Faint,
    Soft,
    OverBudget,
}

/// Properties that decide about a triangle.
struct Face {
    corners: [Vec3; 3],
    opacity: f32,
    sigma: f32,
    color: [f32; 3],
}

#[inline(always)]
fn soup_face(soup: &Soup, i: usize) -> Face {
    Face {
        corners: soup.vertices[i],
        opacity: soup.opacity[i],
        sigma: soup.sigma[i],
        color: soup.sh[i * soup.sh_count()],
    }
}

#[inline(always)]
fn mesh_face(mesh: &Mesh, i: usize) -> Face {
    let opacity = mesh.opacity.get(i).copied().unwrap_or(1.0);
    Face { corners: mesh.corners(i), opacity, sigma: 0.0, color: mesh.corner_colors(i)[0] }
}

/// The verdict on every face; the limit of triangles drops those last that are `connected`, empty
/// for none. `[N]`
fn classify(
    count: usize,
    face: impl Fn(usize) -> Face + Sync,
    connected: &[bool],
    options: &PruneOptions,
) -> Vec<PruneDecision> {
    let mut verdicts: Vec<PruneDecision> =
        parallel::collect(count, GRAIN, |i| classify_alone(&face(i), options));
    let contribution = |i: usize| match connected.get(i) {
        Some(true) => f32::INFINITY,
        _ => contribution(&face(i)) as f32,
    };
    drop_over_budget(&mut verdicts, &contribution, options);
    verdicts
}

/// The verdict by the rules that need one face only.
#[inline(always)]
fn classify_alone(face: &Face, options: &PruneOptions) -> PruneDecision {
    let has_finite_values = face.opacity.is_finite()
        && face.sigma.is_finite()
        && face.color.iter().all(|c| c.is_finite());
    if !has_finite_values {
        PruneDecision::NonFinite
    } else if !is_in_reach(&face.corners) {
        let is_finite = face.corners.iter().all(|v| v.is_finite());
        if is_finite { PruneDecision::OutOfReach } else { PruneDecision::NonFinite }
    } else if is_degenerate(&face.corners) {
        PruneDecision::Degenerate
    } else if f64::from(face.opacity) < options.min_opacity {
        PruneDecision::Faint
    } else if options.max_sigma > 0.0 && f64::from(face.sigma) > options.max_sigma {
        PruneDecision::Soft
    } else {
        PruneDecision::Keep
    }
}

/// True if an engine can place these corners; false for NaN too.
#[inline(always)]
fn is_in_reach(corners: &[Vec3; 3]) -> bool {
    corners.iter().all(|v| v.abs().cmple(Vec3::splat(REACH)).all())
}

/// The largest coordinate of some corners.
fn reach(corners: &[Vec3; 3]) -> f32 {
    corners.iter().map(|v| v.abs().max_element()).fold(0.0, f32::max)
}

/// True for faces of connected parts that an engine can draw. `[F]`
pub(crate) fn connected_flags(mesh: &Mesh) -> Vec<bool> {
    let flags = connected_faces(mesh).into_iter().enumerate();
    flags.map(|(face, is_connected)| is_connected && is_in_reach(&mesh.corners(face))).collect()
}

/// True when the corners lie on a line or a point, to the rounding of the longest edge; also for
/// NaN.
///
/// ```text
/// |(b - a) x (c - a)| / longest^2 = height / longest <= 2^-23
/// ```
#[inline]
pub(super) fn is_degenerate(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = *corners;
    // At least the square of the longest side, without its comparisons.
    let sides2 = (b - a).length_squared() + (c - a).length_squared() + (c - b).length_squared();
    // Far from the limit f32 is enough; NaN, overflow and underflow fail this test and are tested
    // again in f64.
    if (b - a).cross(c - a).length_squared() > 1e-6 * sides2 * sides2 {
        return false;
    }
    is_degenerate_f64(corners)
}

/// The same where f32 cannot tell.
#[cold]
fn is_degenerate_f64(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let longest2 =
        (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    !((b - a).cross(c - a).length_squared() > (MAX_FLATNESS * longest2).powi(2))
}

/// Keeps the `max_triangles` faces that add most to the picture; ties go to the earlier face.
fn drop_over_budget(
    verdicts: &mut [PruneDecision],
    contribution: &(impl Fn(usize) -> f32 + Sync),
    options: &PruneOptions,
) {
    let Some(budget) = options.max_triangles.and_then(|n| usize::try_from(n).ok()) else { return };
    let kept = |i: usize| (verdicts[i] == PruneDecision::Keep).then(|| (contribution(i), i as u32));
    let mut contributions: Vec<(f32, u32)> = parallel::filter_map(verdicts.len(), GRAIN, kept);
    if contributions.len() <= budget {
        return;
    }
    let largest_first = |a: &(f32, u32), b: &(f32, u32)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    contributions.select_nth_unstable_by(budget, largest_first);
    for &(_, i) in &contributions[budget..] {
        verdicts[i as usize] = PruneDecision::OverBudget;
    }
}

/// The contribution of a face to a picture: its alpha, integrated over its area.
///
/// ```text
/// area * o * mean(window) = area * o * 2 / ((sigma + 1) (sigma + 2))
/// ```
fn contribution(face: &Face) -> f64 {
    let [a, b, c] = face.corners.map(|v| v.as_dvec3());
    let sigma = f64::from(face.sigma);
    0.5 * (b - a).cross(c - a).length() * f64::from(face.opacity) * 2.0
        / ((sigma + 1.0) * (sigma + 2.0))
}

/// Names the rule that dropped most, and its remedy.
fn nothing_left(options: &PruneOptions, counts: &PruneDetails, total: usize) -> Error {
    if total == 0 {
        return Error::invalid("the scene", "empty", "at least one triangle");
    }
    let by_cause = to_json(counts);
    let worst = by_cause.iter().max_by_key(|(_, count)| count.as_u64());
    let (cause, count) = worst
        .map_or(("non_finite", 0), |(cause, count)| (cause.as_str(), count.as_u64().unwrap_or(0)));
    let dropped = format!("it drops {count} of {total} triangles and nothing is left");
    match cause {
        "faint" => {
            Error::invalid("min_opacity", options.min_opacity, format!("a lower value: {dropped}"))
        }
        "soft" => Error::invalid(
            "max_sigma",
            options.max_sigma,
            format!("a higher value, or 0: {dropped}"),
        ),
        cause => {
            let what = format!("{count} of {total} triangles {cause}");
            Error::invalid("the scene", what, "at least one triangle of finite, non-zero size")
        }
    }
}
