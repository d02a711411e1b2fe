//! Finds the background that a soft scene was trained on, and drops the triangles that show nothing
//! but it.
//!
//! They would be shards on a page or before a sky. It runs on the scene as it was trained. Its
//! result tells later stages to draw the object alone, so that fitting leaves no new ones.

use super::teacher::{HAS_PHOTOS, soft_soup, viewpoints};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use trisplat_dataset::PhotoBackground as Color;
use trisplat_scene::report::Outcome;
use trisplat_scene::{ImportedScene, Scene};
use trisplat_teacher::ObjectBackground;

/// Source of the background's colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(
    description = "auto, off, black, white or #rrggbb",
    extend("pattern" = "^(auto|off|black|white|#[0-9a-fA-F]{6})$")
)]
pub enum BackgroundFrom {
    /// The borders of the scene's own pictures.
    #[default]
    Auto,
    /// None: the scene fills its pictures.
    Off,
    /// Given.
    Color(Color),
}

impl FromStr for BackgroundFrom {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            color => color
                .parse()
                .map(Self::Color)
                .map_err(|why: String| format!("{why}, or auto or off")),
        }
    }
}

impl fmt::Display for BackgroundFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Off => f.write_str("off"),
            Self::Color(color) => color.fmt(f),
        }
    }
}

trisplat_scene::as_text!(BackgroundFrom);

/// The background that the scene was trained on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BackgroundOptions {
    /// Colour that a soft scene was trained on; `auto` finds it at the borders of its own pictures
    pub background: BackgroundFrom,
}

impl BackgroundOptions {
    /// Found at the borders.
    pub const DEFAULT: Self = Self { background: BackgroundFrom::Auto };
    /// None.
    pub const OFF: Self = Self { background: BackgroundFrom::Off };
}

/// The background; empty where the scene fills its pictures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackgroundDetails {
    /// The scene is an object: nothing is to be drawn beside it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub object: bool,
    /// The colour it was trained on; absent where only the object is in view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
}

impl BackgroundDetails {
    /// The colour behind the object, sRGB-encoded: black where any will do. `None` where there is
    /// no object.
    pub fn object_color(&self) -> Option<[f32; 3]> {
        self.object.then(|| self.color.unwrap_or(Color([0; 3])).to_f32())
    }
}

trisplat_scene::stage!(BackgroundDetails, "background");

/// Drops the triangles of a soft `scene` that show only its background, unless there are `photos`.
pub fn background(
    scene: &mut ImportedScene,
    has_photos: bool,
    options: &BackgroundOptions,
    details: &mut BackgroundDetails,
) -> Outcome<()> {
    let requested = match options.background {
        BackgroundFrom::Off => return Outcome::Skipped("`background` off"),
        BackgroundFrom::Auto => None,
        BackgroundFrom::Color(color) => Some(color.to_f32()),
    };
    let soup = match soft_soup(&scene.scene) {
        Ok(_) if has_photos => return Outcome::Skipped(HAS_PHOTOS),
        Ok(soup) => soup,
        Err(why) => return Outcome::Skipped(why),
    };
    let cameras = viewpoints(scene).map_or(Vec::new(), |viewpoints| viewpoints.cameras);
    let Some(background) = ObjectBackground::of(soup, &cameras, requested) else {
        return Outcome::Skipped("the borders of its pictures have no common colour");
    };
    details.object = true;
    details.color =
        background.rgb.map(|rgb| Color(rgb.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)));
    let is_object = background.is_object;
    if is_object.iter().all(|object| *object) || !is_object.contains(&true) {
        return Outcome::Skipped("no triangle shows the background alone");
    }
    if let Scene::Soup(soup) = &mut scene.scene {
        soup.retain(|i| is_object[i]);
    }
    Outcome::Changed(())
}
