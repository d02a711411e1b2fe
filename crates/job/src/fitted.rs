//! A bake whose files take at most a number of bytes.

use super::event::{Event, Observer, stages};
use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    Attempt, Bake, BakeOptions, ReshapeOptions, TeacherOptions, TextureWhen, Views, most_within,
    refit::RefitColors,
};
use trisplat_formats::output::{self, Output};
use trisplat_scene::{Asset, ImportedScene, Result, report::Report};

/// A bake, its options and its report so far.
pub(super) struct Fitted {
    pub(super) asset: Asset,
    pub(super) options: BakeOptions,
    pub(super) report: Report,
}

/// The bake with the most triangles whose files, all of `output` together, take at most `limit` bytes. The bytes of real files are counted:
/// first of the scene without anything that pictures decide, then of the bake itself, which may be made again. `report` is what each begins with.
///
/// Errors: those of a bake and of writing; a limit that not even one triangle meets.
pub(super) fn fitted(
    limit: u64,
    scenes: &[ImportedScene],
    mut views: Option<&mut Views>,
    options: &BakeOptions,
    output: &Output,
    report: &Report,
    observer: Observer<'_>,
) -> Result<Fitted> {
    let with = |options: &BakeOptions, max_triangles: Option<u64>| {
        let mut options = options.clone();
        options.prune.max_triangles = max_triangles;
        options
    };
    let measured = |asset: &Asset, options: &BakeOptions| -> Result<Attempt> {
        let mut unread = Report::default();
        output::write(asset, output, output.dry_run(), &options.output, &mut unread, &mut |_| Continue(()))?;
        let bytes = unread.outputs.iter().map(|file| file.bytes).sum();
        let max_triangles = options.prune.max_triangles;
        Ok(Attempt { max_triangles, triangles: asset.counts().triangles, bytes })
    };
    let (plain, sightless) = (plain(options), sightless(scenes, options));
    let probe = |most: Option<u64>| {
        let options = with(&plain, most);
        let asset = Bake::new(&options).run(sightless.iter().cloned())?;
        measured(&asset, &options)
    };
    let make = |most: Option<u64>| -> Result<(Attempt, Fitted)> {
        let (options, mut report) = (with(options, most), report.clone());
        let _ = observer(Event::Fits { limit, triangles: most });
        let bake = Bake::new(&options).photos(views.as_deref_mut()).report(&mut report);
        let asset = bake.observer(&mut stages(observer)).run(scenes.iter().cloned())?;
        Ok((measured(&asset, &options)?, Fitted { asset, options, report }))
    };
    most_within(limit, options.prune.max_triangles, probe, make)
}

/// Options for a file of the same size, without the stages that use pictures.
fn plain(options: &BakeOptions) -> BakeOptions {
    let mut plain = options.clone();
    (plain.teacher, plain.reshape) = (TeacherOptions::OFF, ReshapeOptions::OFF);
    plain.refit.refit = RefitColors::Off;
    // The size of these files does not depend on the number of triangles.
    (plain.collision.collision, plain.texture.texture) = (false, TextureWhen::Off);
    plain
}

/// The scenes without cameras, unless cameras define the crop. Without cameras, triangles are ranked by size.
fn sightless(scenes: &[ImportedScene], options: &BakeOptions) -> Vec<ImportedScene> {
    let mut scenes = scenes.to_vec();
    if options.crop.crop.is_empty() {
        scenes.iter_mut().for_each(|scene| scene.cameras.clear());
    }
    scenes
}
