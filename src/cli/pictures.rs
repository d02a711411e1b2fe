//! A folder of pictures, one per photo and named like it.

use super::outputs::Outputs;
use std::path::{Component, Path, PathBuf};
use trisplat_scene::{Result, atomic::AtomicFile, image::RgbImage};

/// Where each picture goes.
#[derive(Debug)]
pub(super) struct Pictures {
    paths: Vec<PathBuf>,
}

impl Pictures {
    /// Names a picture for each photo and makes the folder, locked for other programs while `outputs` exists.
    ///
    /// Errors: two photos that would have one picture, a picture that [`Outputs`] refuses, another program that writes into the folder.
    pub(super) fn plan<'a>(
        option: &'static str,
        folder: &Path,
        photos: impl Iterator<Item = &'a str>,
        outputs: &mut Outputs<'_>,
    ) -> Result<Self> {
        let paths: Vec<PathBuf> =
            file_names(&photos.collect::<Vec<_>>()).map(|name| folder.join(name)).collect();
        outputs.make_folder(folder)?;
        outputs.lock_folder(folder)?;
        for path in &paths {
            let parent = path.parent().unwrap_or(folder);
            outputs.make_folder(parent)?;
            outputs.plan(option, path)?;
        }
        // Unwritable outputs fail before any picture is drawn.
        paths.first().map_or(Ok(()), |path| AtomicFile::create(path).map(drop))?;
        Ok(Self { paths })
    }

    /// Writes the picture of the photo at index `i`.
    pub(super) fn save(&self, i: usize, picture: &RgbImage) -> Result<()> {
        picture.save_png(&self.paths[i])
    }
}

/// `photo.jpg` becomes photo.png, or photo.jpg.png if there is a photo.png, too. Parts of a name that would
/// lead out of the folder are left out.
fn file_names<'a>(photos: &'a [&str]) -> impl Iterator<Item = PathBuf> + 'a {
    let inside = |name: &str| -> PathBuf {
        Path::new(name).components().filter(|c| matches!(c, Component::Normal(_))).collect()
    };
    let short: Vec<PathBuf> = photos.iter().map(|name| inside(name).with_extension("png")).collect();
    let mut count = std::collections::HashMap::new();
    short.iter().for_each(|name| *count.entry(name.clone()).or_insert(0usize) += 1);
    photos.iter().zip(short).map(move |(photo, short)| match count[&short] {
        1 => short,
        _ => {
            let mut long = inside(photo).into_os_string();
            long.push(".png");
            long.into()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(photos: &[&str]) -> Vec<String> {
        file_names(photos).map(|name| name.to_string_lossy().replace('\\', "/")).collect()
    }

    #[test]
    fn pictures_are_named_like_their_photos() {
        assert_eq!(
            names(&["a.jpg", "b/c.png", "../../d.jpg", "/e.v2.jpg"]),
            ["a.png", "b/c.png", "d.png", "e.v2.png"]
        );
    }

    #[test]
    fn photos_that_differ_in_their_ending_have_pictures_of_their_own() {
        assert_eq!(names(&["a.png", "a.jpg", "b.jpg"]), ["a.png.png", "a.jpg.png", "b.png"]);
    }
}
