//! The held-out photos: `test.txt`, else those marked by the data set, else every Nth by name.

use super::options::DatasetOptions;
use super::posed::{Dataset, View};
use std::collections::HashSet;
use std::path::Path;
use trisplat_scene::{Error, Result, input};

/// A part of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// The held-out photos.
    #[default]
    Test,
    /// The photos to train on.
    Train,
    /// All photos.
    All,
}

impl Split {
    /// "test", "train" or "all".
    pub fn name(self) -> &'static str {
        match self {
            Split::Test => "test",
            Split::Train => "train",
            Split::All => "all",
        }
    }

    /// The photos of this part, in order of name.
    pub fn of(self, dataset: &Dataset) -> Vec<&View> {
        let belongs = |view: &&View| match self {
            Split::Test => view.test,
            Split::Train => !view.test,
            Split::All => true,
        };
        dataset.views.iter().filter(belongs).collect()
    }

    /// The same.
    ///
    /// Errors: no photos.
    pub fn some_of(self, dataset: &Dataset) -> Result<Vec<&View>> {
        let views = self.of(dataset);
        if views.is_empty() {
            return Err(Error::invalid("split", self.name(), "a part that holds photos: train or all"));
        }
        Ok(views)
    }
}

/// Marks the held-out views. They are sorted by name, and those of a `transforms_test.json` are marked
/// already.
pub(super) fn apply(dataset: &mut Dataset, root: &Path, options: &DatasetOptions) -> Result<()> {
    let list = root.join("test.txt");
    if options.test_every == 0 {
        dataset.views.iter_mut().for_each(|view| view.test = false);
        return Ok(());
    }
    if list.is_file() {
        let text = input::read_text(&list, &options.limits)?;
        return by_list(dataset, &list, &text);
    }
    if dataset.views.iter().any(|view| view.test) {
        return Ok(());
    }
    // A single photo is worth more in training than held out.
    if dataset.views.len() > 1 {
        for view in dataset.views.iter_mut().step_by(options.test_every as usize) {
            view.test = true;
        }
    }
    all_held_out(dataset, root)
}

/// Holds out the photos named in `text`, one per line, with or without their file extension.
fn by_list(dataset: &mut Dataset, list: &Path, text: &str) -> Result<()> {
    let named: HashSet<&str> = text.lines().map(str::trim).filter(|name| !name.is_empty()).collect();
    let mut matched = HashSet::new();
    for view in &mut dataset.views {
        let hit = spellings(view).into_iter().flatten().find_map(|name| named.get(name).copied());
        view.test = hit.is_some();
        matched.extend(hit);
    }
    if let Some(missing) = named.iter().filter(|name| !matched.contains(*name)).min() {
        let count = named.len() - matched.len();
        if matched.is_empty() {
            let reason = format!("none of its {count} names is a photo of the data set (`{missing}`)");
            return Err(Error::malformed(list, "names", format!("{reason}; correct or remove the file")));
        }
        let of = named.len();
        dataset
            .warnings
            .push(format!("test.txt: {count} of {of} names are not photos of the data set (`{missing}`)"));
    }
    all_held_out(dataset, list)
}

/// The names of a view in a list: in full, without extension, without folders, or without both.
fn spellings(view: &View) -> [Option<&str>; 4] {
    let path = Path::new(&view.name);
    let stem = view.name.rsplit_once('.').map(|(stem, _)| stem);
    let file = path.file_name().and_then(|n| n.to_str());
    let file_stem = path.file_stem().and_then(|n| n.to_str());
    [Some(view.name.as_str()), stem, file, file_stem]
}

fn all_held_out(dataset: &Dataset, source: &Path) -> Result<()> {
    if dataset.views.iter().all(|view| view.test) {
        let reason = "every photo is held out, none is left to train on; name fewer, or give `test_every` 0";
        return Err(Error::unsupported(source, reason));
    }
    Ok(())
}
