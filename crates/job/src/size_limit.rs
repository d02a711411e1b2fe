//! A bake whose files take at most a number of bytes.
//!
//! Bytes are nearly in proportion to triangles of any shape. So trials without fitting, which cost
//! little, measure the bytes of a triangle; one or two bakes by proportion follow, and the size of
//! their files decides.

use super::event::{Event, Observer, stages};
use std::ops::ControlFlow::Continue;
use trisplat_bake::refit::RefitColors;
use trisplat_bake::{
    BackgroundDetails, Bake, BakeOptions, BakeOutcome, ReshapeOptions, ShOptions, TeacherOptions,
    TextureWhen, Views,
};
use trisplat_formats::output::{self, Output};
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Error, ImportedScene, Result};

/// Maximum number of bakes, should the later ones be needed.
const MAX_BAKES: u32 = 6;
/// The target size, as a share of the limit: a little less, because a scene that is too large is
/// discarded.
const AIM: f64 = 0.985;
/// Minimum share of the limit that is good enough after the first bake.
const NEAR: f64 = 0.95;
/// Minimum share of the limit that is good enough from the second bake on.
const CLOSE: f64 = 0.9;

/// A bake, its options and its report so far.
pub(super) struct SizedBake {
    pub(super) outcome: BakeOutcome,
    pub(super) options: BakeOptions,
    pub(super) report: Report,
}

/// Inputs of every bake of the search.
#[derive(Clone, Copy)]
pub(super) struct BakeStart<'a> {
    pub(super) scenes: &'a [ImportedScene],
    /// Background of the object, if it is estimated already.
    pub(super) background: &'a Option<BackgroundDetails>,
    /// The report so far.
    pub(super) report: &'a Report,
}

/// Search the bake with the most triangles whose files, all of `output` together, take at most
/// `limit` bytes. The bytes of real files are counted: first of a scene baked without pictures,
/// then of the bake itself, which may be repeated.
///
/// # Errors
///
/// Errors of a bake and of writing; a limit that not even one triangle meets.
pub(super) fn search_triangle_count(
    limit: u64,
    start: BakeStart<'_>,
    mut views: Option<&mut Views>,
    options: &BakeOptions,
    output: &Output,
    observer: Observer<'_>,
) -> Result<SizedBake> {
    let with = |options: &BakeOptions, max_triangles: Option<u64>| {
        let mut options = options.clone();
        options.prune.max_triangles = max_triangles;
        options
    };
    let bytes = |asset: &Asset, options: &BakeOptions| -> Result<u64> {
        let mut unread = Report::default();
        output::write(asset, output, output.dry_run(), &options.output, &mut unread, &mut |_| {
            Continue(())
        })?;
        Ok(unread.outputs.iter().map(|file| file.bytes).sum())
    };
    let probe_options = size_probe_options(options);
    let probe_scenes = without_cameras(start.scenes, options);
    let trial = |count: Option<u64>| {
        let options = with(&probe_options, count);
        let asset = Bake::new(&options).run(probe_scenes.iter().cloned())?;
        Ok((asset.counts().triangles, bytes(&asset, &options)?))
    };
    let make = |count: Option<u64>| -> Result<(u64, SizedBake)> {
        let options = with(options, count);
        let mut report = start.report.clone();
        let _ = observer(Event::SizeLimit { limit, triangles: count });
        let bake = Bake::new(&options).photos(views.as_deref_mut()).report(&mut report);
        let bake = bake.background(start.background.clone());
        let scenes = start.scenes.iter().cloned();
        let outcome = bake.observer(&mut stages(observer)).run_with_details(scenes)?;
        Ok((bytes(&outcome.asset, &options)?, SizedBake { outcome, options, report }))
    };
    largest_within(limit, options.prune.max_triangles, trial, make)
}

/// A scene and the size of its files.
struct SizedScene<T> {
    bytes: u64,
    scene: T,
}

/// Search the scene with most triangles, at most `max_triangles`, whose files take at most `limit`
/// bytes. `trial` returns the triangles and bytes of a similar scene, `make` the bytes of the scene
/// itself, of at most the number of triangles in its argument.
///
/// # Errors
///
/// Errors of both; a limit that not even one triangle fits.
fn largest_within<T>(
    limit: u64,
    max_triangles: Option<u64>,
    mut trial: impl FnMut(Option<u64>) -> Result<(u64, u64)>,
    mut make: impl FnMut(Option<u64>) -> Result<(u64, T)>,
) -> Result<T> {
    let too_small = |min_bytes: f64| {
        let wants = format!("{} or more, for a single triangle", min_bytes.ceil());
        Error::invalid("max_bytes", limit, wants)
    };
    let aim = AIM * limit as f64;
    let (all, all_bytes) = trial(max_triangles)?;
    // The last point on the line of bytes by triangles.
    let mut before = (0.0, 0.0);
    let mut count = max_triangles;
    if all_bytes > limit {
        let part = ((aim / all_bytes as f64 * all as f64) as u64).max(1);
        let (_, part_bytes) = trial(Some(part))?;
        let per_triangle =
            (all_bytes as f64 - part_bytes as f64) / all.saturating_sub(part).max(1) as f64;
        before.1 = (part_bytes as f64 - per_triangle * part as f64).max(0.0);
        if before.1 + per_triangle > limit as f64 || per_triangle <= 0.0 {
            return Err(too_small(before.1 + per_triangle));
        }
        count = Some((((aim - before.1) / per_triangle) as u64).clamp(1, all));
    }
    let mut best: Option<SizedScene<T>> = None;
    let mut min_bytes = f64::INFINITY;
    for bakes in 1..=MAX_BAKES {
        let (bytes, scene) = make(count)?;
        let now = (count.map_or(all, |count| count.min(all)) as f64, bytes as f64);
        if bytes > limit {
            min_bytes = min_bytes.min(now.1);
        } else if best.as_ref().is_none_or(|best| best.bytes < bytes) {
            best = Some(SizedScene { bytes, scene });
        }
        let enough = if bakes == 1 { NEAR } else { CLOSE } * limit as f64;
        if best.as_ref().is_some_and(|best| {
            best.bytes as f64 >= enough || bytes <= limit && now.0 >= all as f64
        }) {
            break;
        }
        let per_triangle = (now.1 - before.1) / (now.0 - before.0);
        let next = if per_triangle > 0.0 {
            now.0 + (aim - now.1) / per_triangle
        } else {
            now.0 * aim / now.1.max(1.0)
        };
        before = now;
        count = Some(next.clamp(1.0, all.max(1) as f64) as u64);
        if count == Some(now.0 as u64) {
            break;
        }
    }
    best.map(|best| best.scene).ok_or_else(|| too_small(min_bytes))
}

/// Options for a file of the same size, without the stages that use pictures.
fn size_probe_options(options: &BakeOptions) -> BakeOptions {
    let mut probe = options.clone();
    probe.teacher = TeacherOptions::OFF;
    probe.reshape = ReshapeOptions::OFF;
    probe.refit.refit = RefitColors::Off;
    // They need pictures; the bakes that decide have them.
    probe.sh = ShOptions::DEFAULT;
    // The size of these files does not depend on the number of triangles.
    probe.collision.collision = false;
    probe.texture.texture = TextureWhen::Off;
    probe
}

/// The scenes without cameras, unless cameras define the crop. Without cameras, triangles are
/// ranked by size.
fn without_cameras(scenes: &[ImportedScene], options: &BakeOptions) -> Vec<ImportedScene> {
    let mut scenes = scenes.to_vec();
    if options.crop.crop.is_empty() {
        for scene in &mut scenes {
            scene.cameras.clear();
        }
    }
    scenes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene of `all` triangles of `each` bytes; in trials they take `tried` times as many.
    /// Returns bytes, triangles permitted and bakes.
    fn search(
        limit: u64,
        all: u64,
        header: u64,
        each: f64,
        tried: f64,
    ) -> Result<(u64, Option<u64>, u32)> {
        let mut made = 0;
        let of = |most: Option<u64>, each: f64| {
            let triangles = most.map_or(all, |most| most.min(all));
            (triangles, header + (each * triangles as f64) as u64)
        };
        let trial = |most| Ok(of(most, tried * each));
        let found = largest_within(limit, None, trial, |most| {
            made += 1;
            let bytes = of(most, each).1;
            Ok((bytes, (bytes, most)))
        })?;
        Ok((found.0, found.1, made))
    }

    #[test]
    fn what_fits_is_left_alone() {
        assert_eq!(search(10_000, 100, 500, 60.0, 1.0).unwrap(), (6500, None, 1));
    }

    #[test]
    fn the_limit_is_kept_and_nearly_reached_by_baking_at_most_twice() {
        for (limit, header) in
            [(3_000_000, 1500), (1_000_000, 100_000), (50_000, 1500), (5_999_999, 0)]
        {
            for tried in [1.0, 0.8, 1.3] {
                let (bytes, _, made) = search(limit, 100_000, header, 60.0, tried).unwrap();
                let share = bytes as f64 / limit as f64;
                assert!((0.95..=1.0).contains(&share), "{limit}, {tried}: {bytes}");
                assert!(made <= 2 && (tried != 1.0 || made == 1), "{limit}, {tried}: {made}");
            }
        }
        let (bytes, _, made) = search(3_000_000, 100_000, 1500, 60.0, 0.3).unwrap();
        assert!(bytes <= 3_000_000 && made <= 3, "{made} after a trial that was far off");
    }

    /// Half of a soft scene's triangles go once pictures tell which of them are seen; a texture
    /// takes the same bytes for any number.
    #[test]
    fn what_later_stages_drop_or_add_is_made_up_for() {
        let limit = 20_000;
        for (kept, texture) in [(0.1, 0), (0.4, 0), (0.7, 0), (1.0, 0), (1.0, 8000), (0.5, 15_000)]
        {
            let bytes = |most: Option<u64>, kept: f64| {
                1500 + 60 * (kept * most.map_or(1000, |most| most.min(1000)) as f64) as u64
            };
            let trial = |most: Option<u64>| {
                Ok((most.map_or(1000, |most| most.min(1000)), bytes(most, 1.0)))
            };
            let make = |most| Ok((texture + bytes(most, kept), texture + bytes(most, kept)));
            let found = largest_within(limit, None, trial, make).unwrap();
            let all = texture + bytes(None, kept);
            assert!(
                found <= limit && found as f64 >= CLOSE * limit.min(all) as f64,
                "{kept}, {texture}: {found}"
            );
        }
    }

    #[test]
    fn a_limit_below_one_triangle_is_an_error() {
        let error = search(1000, 50_000, 1500, 60.0, 1.0).unwrap_err().to_string();
        assert!(error.starts_with("max_bytes is 1000: expected 15"), "{error}");
    }
}
