//! `trisplat render FILE -o DIR`: pictures of a soup, a mesh or Gaussian splats, from given cameras
//! or from a circle around it.

use super::GlobalArgs;
use super::inputs::Inputs;
use super::messages::many;
use super::outputs::Outputs;
use super::progress::Progress;
use std::path::{Path, PathBuf};
use trisplat_dataset::Dataset;
use trisplat_job::RenderJob;
use trisplat_scene::atomic::{AtomicFile, safe_path};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Result};

/// Scene and cameras to draw.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// The scene, the cameras, and how it is drawn.
    #[command(flatten)]
    pub job: RenderJob,
    /// Folder for the pictures; made if missing.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Data set whose cameras are used: a folder of posed photos, or a transforms.json.
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Replace pictures that are there.
    #[arg(short, long)]
    pub force: bool,
}

/// Draws all pictures.
pub fn run(args: &RenderArgs, global: &GlobalArgs, inputs: &Inputs) -> Result<()> {
    check_folder(&args.output)?;
    let dataset = args
        .dataset
        .as_ref()
        .map(|path| Dataset::load(path, &args.job.dataset_options))
        .transpose()?;
    let mut rendering = args.job.clone().prepare(dataset.as_ref())?;
    let mut outputs = Outputs::new(inputs, args.force);
    dataset.as_ref().map_or(Ok(()), |dataset| outputs.forbid_overwriting_photos(dataset))?;
    let names = rendering.cameras().iter().map(|(name, _)| name.as_str());
    let pictures = PictureFiles::plan("--output", &args.output, names, &mut outputs)?;
    let progress = Progress::new(global);
    let (card, warnings) = rendering.draw_on()?;
    progress.drawing_on(card.as_deref(), &warnings);
    let count = rendering.cameras().len();
    for i in 0..count {
        pictures.save(i, &rendering.draw(i)?)?;
    }
    progress.done();
    progress.line(&format!("wrote {} to {}", many(count as u64, "picture"), args.output.display()));
    Ok(())
}

/// Refuses a name with the ending of a file, before a folder of that name is made.
fn check_folder(folder: &Path) -> Result<()> {
    let ends_as_file = folder.extension().is_some_and(|end| {
        let end = end.to_string_lossy();
        end.len() <= 5 && end.chars().all(|c| c.is_ascii_alphabetic())
    });
    let meant_for_a_file = ends_as_file && !folder.to_string_lossy().ends_with(['/', '\\']);
    if folder.is_file() || (meant_for_a_file && !folder.is_dir()) {
        let wants = "a folder for the pictures, such as pictures; a folder whose name ends like a file's needs a / at its end";
        return Err(Error::invalid("output", folder.display(), wants));
    }
    Ok(())
}

// ---- A folder of pictures, one per photo and named like it --------------------------------------

/// Paths of the pictures.
#[derive(Debug)]
pub(super) struct PictureFiles {
    paths: Vec<PathBuf>,
}

impl PictureFiles {
    /// Names a picture for each photo and makes the folder, locked for other programs while
    /// `outputs` exists.
    ///
    /// # Errors
    ///
    /// Two photos that would have one picture, a picture that [`Outputs`] refuses, another program
    /// that writes into the folder.
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

/// `photo.jpg` becomes photo.png, or photo.jpg.png if there is a photo.png, too.
fn file_names<'a>(photos: &'a [&str]) -> impl Iterator<Item = PathBuf> + 'a {
    let short: Vec<PathBuf> =
        photos.iter().map(|name| safe_path(name).with_extension("png")).collect();
    let mut count = std::collections::HashMap::new();
    for name in &short {
        *count.entry(name.clone()).or_insert(0usize) += 1;
    }
    photos.iter().zip(short).map(move |(photo, short)| match count[&short] {
        1 => short,
        _ => {
            let mut long = safe_path(photo).into_os_string();
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
            names(&["a.jpg", "b/c.png", "../../d.jpg", "/e.v2.jpg", "f\\..\\g.jpg"]),
            ["a.png", "b/c.png", "d.png", "e.v2.png", "f_.._g.png"]
        );
    }

    #[test]
    fn photos_that_differ_in_their_ending_stay_separate() {
        assert_eq!(names(&["a.png", "a.jpg", "b.jpg"]), ["a.png.png", "a.jpg.png", "b.png"]);
    }
}
