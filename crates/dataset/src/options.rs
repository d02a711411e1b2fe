//! Options for reading a data set, declared once for the library, the flags and the config file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use trisplat_formats::ReadOptions;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{Limits, Result};

/// Options for reading a folder of posed photos.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Data set"))]
pub struct DatasetOptions {
    /// Shrink photos whose longer side is above this, by area; px.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=65_535)))]
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 65_535))]
    pub max_size: Option<u32>,
    /// Hold out every Nth photo by name (the 1st, the N+1st, ...) if the data set has no split of
    /// its own; 0 trains on all photos, even if it has one.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 8))]
    #[schemars(range(max = 1_000_000))]
    pub test_every: u32,
    /// Skip missing and broken photos; every photo is then read once in full.
    #[cfg_attr(feature = "cli", arg(long))]
    pub skip_broken: bool,
    /// Folder of the photos, relative to the data set; COLMAP models name them relative to it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FOLDER", default_value = "images"))]
    pub images: PathBuf,
    /// Use of the pictures in the folder `masks`, and of the `mask_path` of a frame.
    /// Transparent pixels are a mask that cuts, unless this is `off`.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub masks: Masks,
    /// Colour behind transparent pixels: black, white or #rrggbb.
    #[cfg_attr(feature = "cli", arg(long, value_name = "COLOR", default_value_t))]
    pub background: PhotoBackground,
    /// Memory for decoded photos and drawn pictures, MiB; others go into a temporary file. Each
    /// thread may hold one more.
    #[cfg_attr(feature = "cli", arg(long, value_name = "MIB", default_value_t = 1024))]
    #[schemars(range(max = 16_777_216))]
    pub photo_memory_mib: u32,
    /// Limits on its files.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(default)]
    pub limits: Limits,
    /// Permit it to name files outside its folder.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub allow_outside: bool,
}

impl DatasetOptions {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }

    /// Memory for decoded photos, bytes.
    pub fn photo_bytes(&self) -> u64 {
        u64::from(self.photo_memory_mib) << 20
    }

    /// The options for reading a scene of these photos: colours up to `sh_degree`, with the same
    /// limits.
    pub fn read_options(&self, sh_degree: u8) -> ReadOptions {
        ReadOptions {
            limits: self.limits,
            allow_outside: self.allow_outside,
            ..ReadOptions::with_degree(sh_degree)
        }
    }
}

impl Default for DatasetOptions {
    fn default() -> Self {
        Self {
            max_size: None,
            test_every: 8,
            skip_broken: false,
            images: PathBuf::from("images"),
            masks: Masks::default(),
            background: PhotoBackground::default(),
            photo_memory_mib: 1024,
            limits: Limits::DEFAULT,
            allow_outside: false,
        }
    }
}

/// The meaning of a mask; white (255) is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Masks {
    /// `cut` where masks are silhouettes of an object, else `ignore`.
    #[default]
    Auto,
    /// Black pixels do not count, so anything may be drawn there.
    Ignore,
    /// Black pixels are cut out: nothing may be drawn there.
    Cut,
    /// Masks are not read, and transparent pixels show the background.
    Off,
}

/// The colour behind everything, sRGB-encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(description = "black, white or #rrggbb", extend("pattern" = "^(black|white|#[0-9a-fA-F]{6})$"))]
pub struct PhotoBackground(pub [u8; 3]);

impl PhotoBackground {
    /// The colour with channels in [0, 1].
    pub fn to_f32(self) -> [f32; 3] {
        self.0.map(|c| f32::from(c) * (1.0 / 255.0))
    }
}

impl FromStr for PhotoBackground {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let hex = match text {
            "black" => "000000",
            "white" => "ffffff",
            other => other.strip_prefix('#').unwrap_or(""),
        };
        match u32::from_str_radix(hex, 16) {
            Ok(rgb) if hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit()) => {
                Ok(Self([(rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8]))
            }
            _ => Err("is not a colour: expected black, white or #rrggbb".to_owned()),
        }
    }
}

impl fmt::Display for PhotoBackground {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [0, 0, 0] => f.write_str("black"),
            [255, 255, 255] => f.write_str("white"),
            [r, g, b] => write!(f, "#{r:02x}{g:02x}{b:02x}"),
        }
    }
}

trisplat_scene::as_text!(PhotoBackground);

#[cfg(test)]
#[cfg(feature = "cli")]
mod tests {
    use super::*;

    #[test]
    fn colours_survive_being_written() {
        for (text, rgb) in
            [("black", [0, 0, 0]), ("white", [255; 3]), ("#1e90ff", [0x1e, 0x90, 0xff])]
        {
            let background: PhotoBackground = text.parse().unwrap();
            assert_eq!(background, PhotoBackground(rgb));
            assert_eq!(background.to_string(), text);
        }
        for bad in ["", "#", "#fff", "red", "#12345g", "#+12345", "1e90ff"] {
            assert!(bad.parse::<PhotoBackground>().is_err(), "{bad}");
        }
    }

    #[test]
    fn flags_and_config_have_the_same_defaults() {
        #[derive(clap::Parser)]
        struct Flags {
            #[cfg_attr(feature = "cli", command(flatten))]
            dataset: DatasetOptions,
        }
        let flags = <Flags as clap::Parser>::parse_from(["trisplat"]).dataset;
        assert_eq!(flags, DatasetOptions::default());
        let config: DatasetOptions = serde_json::from_str("{}").unwrap();
        assert_eq!(config, flags);
        let written = serde_json::to_string(&flags).unwrap();
        assert_eq!(serde_json::from_str::<DatasetOptions>(&written).unwrap(), flags);
    }
}
