//! Scores on shrunk photos differ from those on full photos, so the size is printed beside them.

use super::posed::View;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};
use trisplat_scene::Error;

/// The largest size of the shrunk photos: "320x213".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "String", try_from = "String")]
#[schemars(with = "String")]
pub struct ShrunkSize(UVec2);

impl ShrunkSize {
    /// Of some views; `None` if every photo is as large as its file.
    pub fn of<'a>(views: impl IntoIterator<Item = &'a View>) -> Option<Self> {
        let shrunk = views.into_iter().filter(|view| view.photo.is_shrunk()).map(|view| view.photo.size);
        shrunk.max_by_key(|size| u64::from(size.x) * u64::from(size.y)).map(Self)
    }

    /// The text after a score: ", photos at 320x213", or nothing.
    pub fn beside(size: Option<Self>) -> String {
        size.map_or(String::new(), |size| format!(", photos at {size}"))
    }
}

impl Display for ShrunkSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0.x, self.0.y)
    }
}

impl From<ShrunkSize> for String {
    fn from(size: ShrunkSize) -> Self {
        size.to_string()
    }
}

impl TryFrom<String> for ShrunkSize {
    type Error = Error;

    fn try_from(text: String) -> Result<Self, Error> {
        let sides =
            text.split_once('x').and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
        sides.map(Self).ok_or_else(|| Error::invalid("photo_size", text, "a width and a height, 320x213"))
    }
}
