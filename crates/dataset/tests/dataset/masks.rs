//! Masks and opacity as people have them.

use super::transforms::six_photos;
use super::*;
use trisplat_dataset::describe;

/// A folder of six photos with a list of their poses, whose masks `write` makes.
fn masked(write: impl Fn(usize, &View, &Path)) -> tempfile::TempDir {
    let (folder, views) = six_photos("images");
    let rows =
        super::transforms::frames(&views, |v| format!("images/{}", v.name), |_| String::new());
    let json = format!(
        "{{\"fl_x\": 168, \"fl_y\": 167.2, \"cx\": 81.92, \"cy\": 58.92, \"frames\": [{rows}]}}"
    );
    std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    let masks = folder.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    views.iter().enumerate().for_each(|(i, view)| write(i, view, &masks));
    folder
}

fn grey(code: u8) -> image::GrayImage {
    image::GrayImage::from_pixel(160, 120, image::Luma([code]))
}

#[test]
fn masks_are_found_by_any_picture_ending_in_any_case() {
    let endings = ["JPG", "jpeg", "tif", "png.PNG", "webp", "PNG"];
    let folder = masked(|i, view, masks| {
        let name = view.name.trim_end_matches(".png");
        let name = if i % 2 == 1 { name.to_uppercase() } else { name.to_owned() };
        grey(255).save(masks.join(format!("{name}.{}", endings[i]))).unwrap();
    });
    let dataset = load(folder.path());
    assert!(dataset.views.iter().all(|view| view.photo.mask.is_some()), "{:?}", dataset.warnings);
    assert_eq!(describe(&dataset, &Limits::DEFAULT).unwrap().masks, 6);
}

#[test]
fn masks_that_leave_no_pixel_are_refused() {
    let black = |_: usize, view: &View, masks: &Path| grey(0).save(masks.join(&view.name)).unwrap();
    let folder = masked(black);
    let error = error_of(folder.path());
    for part in ["masks/view_0000.png", "no pixel to train on", "invert them"] {
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
    let off = DatasetOptions { masks: Masks::Off, ..DatasetOptions::default() };
    assert_eq!(Dataset::load(folder.path(), &off).unwrap().views.len(), 6);
    // The shape is in the opacity.
    let shape = image::RgbaImage::from_fn(160, 120, |x, _| image::Rgba([0, 0, 0, x as u8]));
    let folder = masked(|_, view, masks| shape.save(masks.join(&view.name)).unwrap());
    assert!(error_of(folder.path()).contains("in their opacity"));
    // Of the held-out photos, view_0000 and view_0004, all, or one.
    std::fs::remove_dir_all(folder.path()).unwrap();
    for (out, kept) in [(vec![0, 4], None), (vec![4], Some(5))] {
        let folder = masked(|i, view, masks| {
            grey(255 * u8::from(!out.contains(&i))).save(masks.join(&view.name)).unwrap();
        });
        std::fs::write(folder.path().join("test.txt"), "view_0000\nview_0004\n").unwrap();
        let Some(kept) = kept else {
            assert!(error_of(folder.path()).contains("no pixel to score on"));
            continue;
        };
        let dataset = load(folder.path());
        assert_eq!((dataset.views.len(), dataset.test().count()), (kept, 1));
        let warning = "1 of 2 held-out photos are left out";
        assert!(dataset.warnings.iter().any(|w| w.contains(warning)), "{:?}", dataset.warnings);
    }
    let dark = masked(|_, view, masks| grey(7).save(masks.join(&view.name)).unwrap());
    let warnings = load(dark.path()).warnings;
    assert!(warnings.iter().any(|w| w.contains("brightest pixel of a mask is 7")), "{warnings:?}");
}

#[test]
fn opaque_photos_with_a_channel_of_opacity_are_no_cut_outs() {
    let folder = masked(|_, _, _| {});
    std::fs::remove_dir(folder.path().join("masks")).unwrap();
    let save = |alpha: u8| {
        for view in load(folder.path()).views {
            let photo = view.photo.decode().unwrap();
            let pixel = |x: u32, y: u32| {
                let [r, g, b] = photo.rgb[(160 * y + x) as usize];
                image::Rgba([r, g, b, if x < 80 { alpha } else { 255 }])
            };
            image::RgbaImage::from_fn(160, 120, pixel).save(&view.photo.path).unwrap();
        }
        describe(&load(folder.path()), &Limits::DEFAULT).unwrap().cut
    };
    assert_eq!(save(255), 0);
    assert_eq!(save(254), 6);
    assert_eq!(save(0), 6);
}
