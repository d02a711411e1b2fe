//! Finds the masks of photos, and refuses those that leave no pixel: nothing is learnt from black,
//! and every drawing scores well.

use super::dataset::{Dataset, View};
use super::listing::{DatasetListing, is_picture};
use super::options::{DatasetOptions, Masks};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Result, input, parallel};

/// Weight of a mask's brightest pixel: darker ones are no mask of black and white.
const WHITE: u8 = 128;

/// Looks for `masks/NAME.png` and `masks/NAME.jpg.png` (as COLMAP names them) where no mask is
/// named, with any ending of pictures, in any case.
pub(super) fn find_masks(listing: &mut DatasetListing, options: &DatasetOptions) {
    if options.masks == Masks::Off {
        listing.photos.iter_mut().for_each(|photo| photo.mask = None);
        return;
    }
    let folder = listing.root.join("masks");
    if !folder.is_dir() {
        return;
    }
    let mut masks: HashMap<PathBuf, PathBuf> = HashMap::new();
    let mut files = input::files_below(&folder);
    // PNG has no loss.
    files.sort_by_key(|path| (path.extension() != Some("png".as_ref()), path.clone()));
    for file in files.into_iter().filter(|path| is_picture(path)) {
        let name = file.strip_prefix(&folder).unwrap_or(&file).with_extension("");
        masks.entry(lowercase(&name)).or_insert(file);
    }
    let mut without = 0;
    for photo in listing.photos.iter_mut().filter(|photo| photo.mask.is_none()) {
        let name = lowercase(Path::new(&photo.name));
        let mask = masks.get(&name.with_extension("")).or_else(|| masks.get(&name));
        photo.mask = mask.cloned();
        without += usize::from(photo.mask.is_none());
    }
    if without > 0 {
        let total = listing.photos.len();
        listing
            .warnings
            .push(format!("{without} of {total} photos have no picture in {}", folder.display()));
    }
}

fn lowercase(path: &Path) -> PathBuf {
    path.to_string_lossy().to_lowercase().into()
}

/// Refuses a data set whose masks leave nothing to train on, and leaves out held-out photos without
/// a pixel to score on.
///
/// # Errors
///
/// No pixel is left.
pub(super) fn check_masks(dataset: &mut Dataset) -> Result<()> {
    let brightest = dataset.train().map(brightest_weight).find(|weight| *weight > 0).unwrap_or(0);
    if brightest == 0 {
        return nothing_left(dataset, "train on");
    }
    if brightest < WHITE {
        dataset.warnings.push(format!(
            "the brightest pixel of a mask is {brightest}: 255 is kept, and 0 is masked"
        ));
    }
    // Photos of cut out objects are empty there, which a drawing can get wrong.
    let held_out: Vec<&View> =
        dataset.test().filter(|view| view.photo.mask.is_some() && !view.photo.is_cut()).collect();
    let weights = parallel::map(&held_out, |_, view| brightest_weight(view));
    let names = held_out.iter().zip(weights).filter(|(_, weight)| *weight == 0);
    let names: Vec<String> = names.map(|(view, _)| view.name.clone()).collect();
    let Some(first) = names.first() else { return Ok(()) };
    let total = dataset.test().count();
    if names.len() == total {
        return nothing_left(dataset, "score on");
    }
    dataset.warnings.push(format!(
        "{} of {total} held-out photos are left out, as their masks leave no pixel to score on, first `{first}`",
        names.len()
    ));
    dataset.views.retain(|view| !view.test || !names.contains(&view.name));
    Ok(())
}

/// The largest weight of a pixel; 255 of a file that cannot be decoded, which its user reports.
fn brightest_weight(view: &View) -> u8 {
    let photo = &view.photo;
    let weights = match (&photo.mask, photo.is_cut()) {
        (None, false) => None,
        (None, true) => photo.decode().ok().and_then(|picture| picture.alpha),
        (Some(_), _) => photo.decode_mask().ok().flatten().map(|(_, weights)| weights),
    };
    weights.map_or(u8::MAX, |weights| weights.into_iter().max().unwrap_or(0))
}

fn nothing_left(dataset: &Dataset, use_of_them: &str) -> Result<()> {
    let mask = dataset.views.iter().find_map(|view| view.photo.mask.as_ref());
    let Some(mask) = mask else {
        let reason = format!(
            "all photos are transparent everywhere: no pixel is left to {use_of_them}; export them with their colours, or give \
             `masks` off"
        );
        return Err(Error::unsupported(&dataset.path, reason));
    };
    let in_opacity = dataset.views.iter().any(|view| {
        let mask = view.photo.mask.as_ref();
        mask.is_some_and(|mask| RgbImage::has_alpha(mask, &view.photo.limits).unwrap_or(false))
    });
    let remedy = if in_opacity {
        "their shape may be in their opacity: save it as white on black"
    } else {
        "white is kept, and black is masked: invert them"
    };
    let reason = format!(
        "like all masks it is black everywhere, which leaves no pixel to {use_of_them}; {remedy}, or give `masks` off"
    );
    Err(Error::unsupported(mask, reason))
}
