//! From the path of a data set to cameras and photos: finds its reader, then does the common steps:
//! check the photos, plan their undistortion, shrink, split.

use super::colmap_model::ListedPoint;
use super::dataset::{Dataset, DatasetKind, Point, Reprojection, View, hold_out};
use super::depth_scale::find_depths;
use super::extent::{MAX_DISTANCE, check_extent, leave_out_far, origin_of};
use super::lens::{Lens, Undistort};
use super::listing::{DatasetListing, ListedPhoto, shared_label};
use super::masks::{check_masks, find_masks};
use super::options::{DatasetOptions, Masks};
use super::photo::{Photo, check_mask};
use super::points::bring_to_horizon;
use super::pose_check::unseen_points;
use super::silhouettes::are_silhouettes;
use super::{colmap, exif, llff, metashape, phone_apps, realityscan, transforms, views};
use glam::{DMat3, DVec3, UVec2, Vec2Swizzles};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Limits, Result, parallel};

impl Dataset {
    /// Reads a data set: a folder with poses in a format of docs/datasets.md, or their file itself.
    /// In a folder with several a COLMAP model goes first.
    ///
    /// ```no_run
    /// use trisplat_dataset::{Dataset, DatasetOptions};
    ///
    /// let dataset = Dataset::load("garden", &DatasetOptions::default())?;
    /// println!("{}: {} photos to train on, {} held out", dataset.kind, dataset.train().count(),
    /// dataset.test().count());
    /// # Ok::<(), trisplat_scene::Error>(())
    /// ```
    ///
    /// # Errors
    /// `Unsupported` for a folder without posed photos or a camera model that is not read,
    /// `Malformed` for broken files. Only the headers of photos are read; a missing or broken photo
    /// is an error unless `skip_broken` is set.
    pub fn load(path: impl AsRef<Path>, options: &DatasetOptions) -> Result<Self> {
        let path = path.as_ref();
        finish(path, find(path, options)?, options, None)
    }

    /// True for a file or folder with camera poses that [`Dataset::load`] can read.
    pub fn is_posed(path: &Path) -> bool {
        if path.is_dir() {
            colmap::locate(path).is_some() || LISTS.iter().any(|(_, find, _)| find(path).is_some())
        } else {
            path.is_file() && reader(path).is_some()
        }
    }

    /// True for the name of a list of poses: .json, .npy, .xml or .csv.
    pub fn is_list(path: &Path) -> bool {
        reader(path).is_some()
    }

    /// Like [`Dataset::load`], but only with the named photos, all for training; others are not
    /// opened and may be missing. The points and the origin are those of the whole data set; if
    /// `origin` is given, there are no points.
    ///
    /// # Errors
    /// As of [`Dataset::load`]; a name that is not in the data set.
    pub fn load_some(
        path: &Path,
        options: &DatasetOptions,
        names: &BTreeSet<String>,
        origin: Option<DVec3>,
    ) -> Result<Self> {
        finish(path, find(path, options)?, options, Some((names, origin)))
    }

    /// Reprojection errors, if the data set has observations. Reads its model again, because
    /// nothing else needs observations.
    ///
    /// # Errors
    /// A model that can no longer be read.
    pub fn reprojection(&self, limits: &Limits) -> Result<Option<Reprojection>> {
        match self.kind {
            DatasetKind::ColmapBinary | DatasetKind::ColmapText => {
                colmap::reprojection(&self.path, limits)
            }
            _ => Ok(None),
        }
    }
}

/// Finds the list of poses of a folder.
type Locator = fn(&Path) -> Option<PathBuf>;
type PoseReader = fn(&Path, &DatasetOptions) -> Result<DatasetListing>;
/// The lists of poses beside COLMAP's, by extension if they have one; in a folder the first goes
/// first.
const LISTS: [(&str, Locator, PoseReader); 6] = [
    ("json", transforms::locate, transforms::read),
    ("npy", llff::locate, llff::read),
    ("xml", metashape::locate, metashape::read),
    ("csv", realityscan::locate, realityscan::read),
    ("", phone_apps::locate_polycam, phone_apps::read_polycam),
    ("", phone_apps::locate_record3d, phone_apps::read_record3d),
];

/// The reader of a list of poses, by its extension.
fn reader(file: &Path) -> Option<PoseReader> {
    let extension = file.extension()?;
    let list = LISTS.iter().find(|(ending, ..)| extension.eq_ignore_ascii_case(*ending));
    list.map(|(.., read)| *read)
}

/// Reads the files at `path`, of any kind.
fn find(path: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    options.validate()?;
    let meta = std::fs::metadata(path).map_err(|e| Error::unread(path, e))?;
    if meta.is_file() {
        let is_zip = path.extension().is_some_and(|ending| {
            ["zip", "r3d"].iter().any(|zip| ending.eq_ignore_ascii_case(zip))
        });
        let reason = if is_zip {
            "is a zip archive; unpack it, and give the folder"
        } else {
            "is not a data set; give its folder or its transforms.json"
        };
        return reader(path).ok_or_else(|| Error::unsupported(path, reason))?(path, options);
    }
    if let Some(model) = colmap::locate(path) {
        return colmap::read(path, &model, options);
    }
    if let Some((file, read)) = LISTS.iter().find_map(|(_, find, read)| Some((find(path)?, read))) {
        return read(&file, options);
    }
    let inside = path.join("photos");
    if Dataset::is_posed(&inside) {
        let reason =
            format!("is a folder of `trisplat make`: its data set is {}", inside.display());
        return Err(Error::unsupported(path, reason));
    }
    let reason = colmap::incomplete(path).or_else(|| phone_apps::other_app(path));
    Err(Error::unsupported(path, reason.as_deref().unwrap_or(NO_POSES)))
}

/// Reason of a folder without poses.
const NO_POSES: &str = "holds no posed photos: expected a COLMAP model (sparse/0 with cameras, images and points3D as .bin or .txt), a \
     transforms.json, poses_bounds.npy, Metashape's cameras.xml, RealityScan's registration .csv, or a raw export of Polycam or \
     Record3D; `trisplat capture` finds the poses of photos";

/// Makes a data set of all photos found, or of the named ones.
fn finish(
    path: &Path,
    mut listing: DatasetListing,
    options: &DatasetOptions,
    some: Option<(&BTreeSet<String>, Option<DVec3>)>,
) -> Result<Dataset> {
    listing.photos.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = listing.photos.windows(2).find(|pair| pair[0].name == pair[1].name) {
        let by_label = matches!(listing.kind, DatasetKind::Metashape | DatasetKind::RealityScan);
        let shared_name = by_label.then(|| shared_label(&listing.root, &pair[0].path)).flatten();
        let reason = shared_name.unwrap_or_else(|| "is listed twice; remove one of the two".into());
        return Err(Error::malformed(&listing.list, format!("photo `{}`", pair[0].name), reason));
    }
    if some.is_none() {
        leave_out_far(&mut listing);
    }
    check_extent(&listing)?;
    let given_origin = some.and_then(|(_, origin)| origin);
    let origin = given_origin.unwrap_or_else(|| origin_of(&listing));
    if let Some((names, _)) = some {
        keep_named(&mut listing, names);
    }
    find_masks(&mut listing, options);
    find_depths(&mut listing, &options.limits)?;
    let mut views = open_views(&mut listing, origin, options)?;
    if let Some((names, _)) = some {
        views.retain(|view| names.contains(&view.name));
        check_named(&listing, &views, names)?;
    }
    let mut dataset = Dataset {
        path: path.to_owned(),
        kind: listing.kind,
        views,
        points: Vec::new(),
        origin,
        warnings: listing.warnings,
    };
    match given_origin {
        Some(_) => dataset.views.iter_mut().for_each(|view| view.tracked.clear()),
        None => keep_points(listing.points, &mut dataset),
    }
    dataset.fit_depths()?;
    if some.is_none() {
        dataset.warnings.extend(unseen_points(&dataset));
    }
    if options.masks == Masks::Auto && are_silhouettes(&dataset.views, &dataset.points) {
        dataset.views.iter_mut().for_each(|view| view.photo.cut = true);
    }
    if some.is_none() {
        hold_out(&mut dataset, &listing.root, options)?;
        check_masks(&mut dataset)?;
    }
    Ok(dataset)
}

/// Keeps the photos of views of these names, none of them held out.
fn keep_named(listing: &mut DatasetListing, names: &BTreeSet<String>) {
    let photos: BTreeSet<String> = names.iter().map(|name| views::photo(name)).collect();
    listing.photos.retain(|photo| names.contains(&photo.name) || photos.contains(&photo.name));
    listing.broken.retain(|(name, _)| names.contains(name));
    listing.photos.iter_mut().for_each(|photo| photo.held_out = false);
}

/// Refuses names without a view.
fn check_named(listing: &DatasetListing, views: &[View], names: &BTreeSet<String>) -> Result<()> {
    let view_names: BTreeSet<&String> = views.iter().map(|view| &view.name).collect();
    match names.iter().find(|name| !view_names.contains(name)) {
        Some(name) => {
            let reason = "is not in the data set any more: put it back, or plan again";
            Err(Error::malformed(&listing.list, format!("photo `{name}`"), reason))
        }
        None => Ok(()),
    }
}

/// Reads the header of every photo and makes it a view.
fn open_views(
    listing: &mut DatasetListing,
    origin: DVec3,
    options: &DatasetOptions,
) -> Result<Vec<View>> {
    let photos: Vec<Result<(Vec<View>, Option<String>)>> =
        parallel::map(&listing.photos, |_, photo| open_photo(photo, origin, options));
    let mut broken = std::mem::take(&mut listing.broken);
    let total = photos.len() + broken.len();
    let mut views: Vec<View> = Vec::with_capacity(total);
    let mut wide = 0;
    let mut parts = 0;
    let mut size_warnings = Vec::new();
    for (photo, result) in listing.photos.iter().zip(photos) {
        match result {
            Ok((of_photo, warning)) => {
                let several = of_photo.len() > 1;
                (wide, parts) =
                    if several { (wide + 1, parts + of_photo.len()) } else { (wide, parts) };
                views.extend(of_photo);
                size_warnings.extend(warning);
            }
            Err(
                error @ (Error::Io { .. }
                | Error::Malformed { .. }
                | Error::Unsupported { .. }
                | Error::Limit { .. }),
            ) => {
                broken.push((photo.name.clone(), error));
            }
            Err(error) => return Err(error),
        }
    }
    let count = |n: usize| format!("{n} of {total} photos {}", if n == 1 { "is" } else { "are" });
    let also = |n: usize| if n > 1 { format!(" (and {} more)", n - 1) } else { String::new() };
    if let Some(first) = size_warnings.first() {
        listing.warnings.push(format!("{first}{}", also(size_warnings.len())));
    }
    if let Some((name, error)) = broken.first() {
        let at = format!("photo `{name}`");
        if broken.len() == total && total > 1 {
            let reason = format!("{error}; no photo is left: all {total} fail");
            return Err(Error::malformed(&listing.list, at, reason));
        }
        let broken = format!("{} missing or broken", count(broken.len()));
        if !options.skip_broken {
            let reason = format!("{error}; {broken}: repair them");
            return Err(Error::broken_photos(&listing.list, at, &reason));
        }
        listing.warnings.push(format!("{broken} and left out, first {error}"));
    }
    if views.is_empty() {
        return Err(Error::unsupported(
            &listing.list,
            "no photo is left; a data set needs at least one",
        ));
    }
    if wide > 0 {
        views.sort_by(|a, b| a.name.cmp(&b.name));
        listing.warnings.push(format!(
            "{wide} wide photos are read as {parts} pinhole views, first `{}`",
            views[0].name
        ));
    }
    Ok(views)
}

/// Longer side of a photo in shorter ones, at most: a strip shows no scene, and cannot be shrunk.
const LONGEST_SHAPE: u32 = 64;

/// The views of a photo, one unless its lens is wide, and a warning when it has another size than
/// its camera.
fn open_photo(
    listed: &ListedPhoto,
    origin: DVec3,
    options: &DatasetOptions,
) -> Result<(Vec<View>, Option<String>)> {
    let stored = RgbImage::size_of(&listed.path, &options.limits)?;
    check_memory(&listed.path, stored, options)?;
    if stored.max_element() / LONGEST_SHAPE > stored.min_element() {
        let reason = format!(
            "is {}x{} px; expected one side at most {LONGEST_SHAPE} times the other, as in a photo",
            stored.x, stored.y
        );
        return Err(Error::unsupported(&listed.path, reason));
    }
    let at_fault = |reason: String| Error::malformed(&listed.path, "camera", reason);
    let stated_lens = listed.lens.resolve(stored).map_err(at_fault)?;
    let warning = check_shape(&listed.path, &stated_lens, stored).map_err(at_fault)?;
    let lens = stated_lens.resized(stored);
    // Opacity is a mask inside the photo.
    let cut = match (&listed.mask, options.masks) {
        (Some(_), masks) => masks == Masks::Cut,
        (None, Masks::Off) => false,
        (None, _) => RgbImage::has_alpha(&listed.path, &options.limits)?,
    };
    if let Some(mask) = &listed.mask {
        check_mask(mask, &listed.path, RgbImage::size_of(mask, &options.limits)?, stored)?;
    }
    if let Some(depth) = &listed.depth {
        depth.check_shape(stored, &options.limits)?;
    }
    let decoding = RgbImage::decoding_bytes(&listed.path, stored, &options.limits)?;
    let view = |(part, undistort): (&str, Option<Undistort>)| {
        let pinhole = undistort.map_or(lens, |plan| plan.pinhole);
        let turn = undistort.map_or(DMat3::IDENTITY, |plan| plan.turn);
        let size = limited_size(pinhole.size, options.max_size);
        let pinhole = pinhole.resized(size);
        let camera = Camera {
            rotation: (turn * listed.rotation).as_mat3(),
            translation: (turn * (listed.translation + listed.rotation * origin)).as_vec3(),
            focal: pinhole.focal.as_vec2(),
            center: pinhole.center.as_vec2(),
            size,
        };
        camera.validate(&options.limits).map_err(|e| at_fault(e.to_string()))?;
        let photo = Photo {
            path: listed.path.clone(),
            mask: listed.mask.clone(),
            // Along another axis than that of the lens depths differ.
            depth: listed.depth.clone().filter(|_| part.is_empty()),
            size,
            stored,
            undistort,
            background: options.background,
            limits: options.limits,
            drawn: None,
            cut,
            crop: None,
            decoding,
        };
        if options.skip_broken {
            photo.decode()?;
        }
        // A wide photo has none: its points are in one of its views or another.
        let tracked = if part.is_empty() { listed.tracked.clone() } else { Vec::new() };
        Ok(View {
            name: views::name(&listed.name, part),
            camera,
            photo,
            test: listed.held_out,
            tracked,
        })
    };
    let plans = views::plans(&lens).map_err(at_fault)?;
    let views = plans.into_iter().map(view).collect::<Result<_>>()?;
    Ok((views, warning.map(|w| format!("photo `{}`: {w}", listed.name))))
}

/// Refuses a photo that alone takes more than the memory for photos.
fn check_memory(path: &Path, stored: UVec2, options: &DatasetOptions) -> Result<()> {
    let bytes = 4 * u64::from(stored.x) * u64::from(stored.y);
    if bytes <= options.photo_bytes() {
        return Ok(());
    }
    let has = options.photo_memory_mib;
    let wants = bytes.div_ceil(1 << 20);
    let reason = format!(
        "takes {wants} MiB to decode, and {has} may be used; give `photo_memory_mib` {wants}"
    );
    Err(Error::unsupported(path, reason))
}

/// A camera may have been calibrated on the same photos at another size, but not at another shape.
fn check_shape(path: &Path, lens: &Lens, stored: UVec2) -> Result<Option<String>, String> {
    if lens.size == stored {
        return Ok(None);
    }
    let sizes = format!(
        "the photo is {}x{}, its camera {}x{}",
        stored.x, stored.y, lens.size.x, lens.size.y
    );
    // Shrinking rounds each side to whole pixels.
    let rounding = 1.0 / f64::from(stored.min_element()) + 0.005;
    let fits = |photo: UVec2| {
        let ratio = photo.as_dvec2() / lens.size.as_dvec2();
        (ratio.x / ratio.y - 1.0).abs() <= rounding
    };
    let turning_orientation =
        || exif::orientation_of(path).filter(|o| *o >= 5 && fits(stored.yx()));
    match (fits(stored), turning_orientation()) {
        (true, _) => {}
        (false, Some(orientation)) => {
            return Err(format!(
                "{sizes}: the poses are of photos as their EXIF orientation, {orientation}, turns them; turn the pixels \
                 too, as with `magick mogrify -auto-orient`"
            ));
        }
        (false, None) => {
            return Err(format!(
                "{sizes}: give the photos the poses were made from, not rotated or cropped"
            ));
        }
    }
    Ok(Some(format!("{sizes}; the camera was scaled")))
}

/// The size of a photo whose longer side may be at most `max_size`.
fn limited_size(size: UVec2, max_size: Option<u32>) -> UVec2 {
    let longest = size.max_element();
    match max_size {
        Some(limit) if limit < longest => {
            let ratio = f64::from(limit) / f64::from(longest);
            (size.as_dvec2() * ratio).round().as_uvec2().max(UVec2::ONE)
        }
        _ => size,
    }
}

/// Keeps the points with positions within [`MAX_DISTANCE`], relative to the origin.
fn keep_points(points: Vec<ListedPoint>, dataset: &mut Dataset) {
    let count = points.len();
    let mut numbers = vec![None; count];
    for (ListedPoint { position, rgb, error, .. }, number) in points.into_iter().zip(&mut numbers) {
        let position = (position - dataset.origin).as_vec3();
        if position.abs().max_element() <= MAX_DISTANCE as f32 {
            *number = Some(dataset.points.len() as u32);
            dataset.points.push(Point { position, rgb, error });
        }
    }
    for view in &mut dataset.views {
        view.tracked = view.tracked.iter().filter_map(|i| numbers[*i as usize]).collect();
    }
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    let (beyond, horizon) = bring_to_horizon(&mut dataset.points, &cameras);
    let count_kept = dataset.points.len();
    let warnings = &mut dataset.warnings;
    if beyond > 0 {
        warnings.push(format!(
            "{beyond} of {count_kept} points are farther away than {horizon:.0} units, where no two photos differ by a pixel: they are brought to that distance"
        ));
    }
    if count_kept < count {
        warnings.push(format!(
            "dropped {} points that are not finite, or farther than {MAX_DISTANCE:.0e}",
            count - count_kept
        ));
    }
    if count_kept == 0 {
        warnings.push("no points: training searches where three photos agree".into());
    }
}
