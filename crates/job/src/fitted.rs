//! A bake whose files take at most a number of bytes.
//!
//! Bytes are nearly in proportion to triangles of any shape. So trials without fitting, which cost
//! little, measure the bytes of a triangle; one or two bakes by proportion follow, and the size of
//! their files decides.

use super::event::{Event, Observer, stages};
use std::ops::ControlFlow::Continue;
use trisplat_bake::refit::RefitColors;
use trisplat_bake::{
    BackgroundDetails, Bake, BakeOptions, ReshapeOptions, TeacherOptions, TextureWhen, Views,
};
use trisplat_formats::output::{self, Output};
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Error, ImportedScene, Result};

/// Maximum number of bakes, should the later ones be needed.
const MAX_BAKES: u32 = 6;
/// The target size, as a share of the limit: a little less, because a scene that is too large is
/// discarded.
const AIM: f64 = 0.985;
/// Minimum share of the limit that is good enough at once, and ...
const NEAR: f64 = 0.95;
/// ... after the second bake.
const CLOSE: f64 = 0.9;

/// A bake, its options and its report so far.
pub(super) struct Fitted {
    pub(super) asset: Asset,
    pub(super) options: BakeOptions,
    pub(super) report: Report,
}

/// The inputs of every bake.
#[derive(Clone, Copy)]
pub(super) struct BakeStart<'a> {
    pub(super) scenes: &'a [ImportedScene],
    /// The background, if it was looked for.
    pub(super) background: &'a Option<BackgroundDetails>,
    /// The report so far.
    pub(super) report: &'a Report,
}

/// The bake with the most triangles whose files, all of `output` together, take at most `limit`
/// bytes. The bytes of real files are counted: first of the scene without anything that pictures
/// decide, then of the bake itself, which may be made again.
///
/// # Errors
///
/// Those of a bake and of writing; a limit that not even one triangle meets.
pub(super) fn fitted(
    limit: u64,
    start: BakeStart<'_>,
    mut views: Option<&mut Views>,
    options: &BakeOptions,
    output: &Output,
    observer: Observer<'_>,
) -> Result<Fitted> {
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
    let plain = plain(options);
    let sightless = sightless(start.scenes, options);
    let trial = |most: Option<u64>| {
        let options = with(&plain, most);
        let asset = Bake::new(&options).run(sightless.iter().cloned())?;
        Ok((asset.counts().triangles, bytes(&asset, &options)?))
    };
    let make = |most: Option<u64>| -> Result<(u64, Fitted)> {
        let options = with(options, most);
        let mut report = start.report.clone();
        let _ = observer(Event::Fits { limit, triangles: most });
        let bake = Bake::new(&options).photos(views.as_deref_mut()).report(&mut report);
        let bake = bake.background(start.background.clone());
        let asset = bake.observer(&mut stages(observer)).run(start.scenes.iter().cloned())?;
        Ok((bytes(&asset, &options)?, Fitted { asset, options, report }))
    };
    most_within(limit, options.prune.max_triangles, trial, make)
}

/// The scene with most triangles, at most `max_triangles`, whose files take at most `limit` bytes.
/// `trial` returns the triangles and bytes of a similar scene, `make` the bytes of the scene
/// itself, of at most the given number of triangles.
///
/// # Errors
///
/// Those of both; a limit that not even one triangle fits.
fn most_within<T>(
    limit: u64,
    max_triangles: Option<u64>,
    mut trial: impl FnMut(Option<u64>) -> Result<(u64, u64)>,
    mut make: impl FnMut(Option<u64>) -> Result<(u64, T)>,
) -> Result<T> {
    let too_few = |least: f64| {
        Error::invalid(
            "max_bytes",
            limit,
            format!("{} or more, for a single triangle", least.ceil()),
        )
    };
    let aim = AIM * limit as f64;
    let (all, whole) = trial(max_triangles)?;
    // A point on the line of bytes by triangles.
    let mut from = (0.0, 0.0);
    let mut most = max_triangles;
    if whole > limit {
        let few = ((aim / whole as f64 * all as f64) as u64).max(1);
        let (_, part) = trial(Some(few))?;
        let each = (whole as f64 - part as f64) / all.saturating_sub(few).max(1) as f64;
        from.1 = (part as f64 - each * few as f64).max(0.0);
        if from.1 + each > limit as f64 || each <= 0.0 {
            return Err(too_few(from.1 + each));
        }
        most = Some((((aim - from.1) / each) as u64).clamp(1, all));
    }
    let (mut best, mut least): (Option<(u64, T)>, f64) = (None, f64::INFINITY);
    for made in 1..=MAX_BAKES {
        let (bytes, scene) = make(most)?;
        let now = (most.map_or(all, |most| most.min(all)) as f64, bytes as f64);
        if bytes > limit {
            least = least.min(now.1);
        } else if best.as_ref().is_none_or(|(other, _)| *other < bytes) {
            best = Some((bytes, scene));
        }
        let enough = if made == 1 { NEAR } else { CLOSE } * limit as f64;
        if best.as_ref().is_some_and(|(most, _)| {
            *most as f64 >= enough || bytes <= limit && now.0 >= all as f64
        }) {
            break;
        }
        let each = (now.1 - from.1) / (now.0 - from.0);
        let next =
            if each > 0.0 { now.0 + (aim - now.1) / each } else { now.0 * aim / now.1.max(1.0) };
        from = now;
        most = Some(next.clamp(1.0, all.max(1) as f64) as u64);
        if most == Some(now.0 as u64) {
            break;
        }
    }
    best.map(|(_, scene)| scene).ok_or_else(|| too_few(least))
}

/// Options for a file of the same size, without the stages that use pictures.
fn plain(options: &BakeOptions) -> BakeOptions {
    let mut plain = options.clone();
    plain.teacher = TeacherOptions::OFF;
    plain.reshape = ReshapeOptions::OFF;
    plain.refit.refit = RefitColors::Off;
    // The size of these files does not depend on the number of triangles.
    plain.collision.collision = false;
    plain.texture.texture = TextureWhen::Off;
    plain
}

/// The scenes without cameras, unless cameras define the crop. Without cameras, triangles are
/// ranked by size.
fn sightless(scenes: &[ImportedScene], options: &BakeOptions) -> Vec<ImportedScene> {
    let mut scenes = scenes.to_vec();
    if options.crop.crop.is_empty() {
        scenes.iter_mut().for_each(|scene| scene.cameras.clear());
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
        let found = most_within(limit, None, trial, |most| {
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
            let found = most_within(limit, None, trial, make).unwrap();
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
