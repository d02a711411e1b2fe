//! The files of an asset: options, formats and a plan of all. They are written, then renamed
//! together.

mod encode;

use crate::gltf::{GltfOptions, TextureFormat};
use crate::levels::EngineLevels;
use crate::lines::breaks_text;
use crate::target::OutputTarget;
use crate::tiles;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::StartedFiles;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{Error, Result};

pub use encode::write;

/// Options of the files written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct OutputOptions {
    /// Engine or viewer to write for: decides colour encoding, compression and files beside.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = OutputTarget::Gltf))]
    pub target: OutputTarget,
    /// Quantise positions per chunk and compress with meshopt, where the target reads it.
    #[cfg_attr(feature = "cli", arg(skip = OutputOptions::DEFAULT.compress))]
    pub compress: bool,
    /// PLY: colours on faces instead of vertices; smaller, but fewer programs read it.
    #[cfg_attr(feature = "cli", arg(skip = OutputOptions::DEFAULT.ply_face_colors))]
    pub ply_face_colors: bool,
    /// glTF: how the picture of a texture is stored
    #[cfg_attr(feature = "cli", arg(skip = OutputOptions::DEFAULT.texture_format))]
    pub texture_format: TextureFormat,
    /// Write GLB files above 2 GiB, which Unity and browsers refuse.
    #[cfg_attr(feature = "cli", arg(skip = OutputOptions::DEFAULT.allow_huge))]
    pub allow_huge: bool,
    /// 3D Tiles: most tiles in one tileset.json, 5 or more; of a larger tree, parts become tilesets
    /// of their own, which viewers load when they come near
    #[cfg_attr(feature = "cli", arg(skip = OutputOptions::DEFAULT.tileset_tiles))]
    #[schemars(range(min = 5, max = 1_000_000_000))]
    pub tileset_tiles: u32,
}

impl OutputOptions {
    /// Plain glTF for every viewer.
    pub const DEFAULT: Self = Self {
        target: OutputTarget::Gltf,
        compress: false,
        ply_face_colors: false,
        texture_format: TextureFormat::Jpeg,
        allow_huge: false,
        tileset_tiles: 10_000,
    };
    /// Quantised and compressed where the target reads it.
    pub const SMALL: Self = Self { compress: true, ..Self::DEFAULT };

    /// Checks the ranges of numbers.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }

    /// The glTF options of the target; notes for the user go into `details`.
    pub fn encoding(&self, details: &mut WriteDetails) -> GltfOptions {
        let (encoding, notes) = self.target.encoding(self.compress);
        details.notes = Some(notes);
        GltfOptions { texture: self.texture_format, allow_huge: self.allow_huge, ..encoding }
    }

    /// The glTF options of our own page: it reads everything, so it is compressed, without loss by
    /// default.
    fn page_encoding(&self, details: &mut WriteDetails) -> GltfOptions {
        let other = !matches!(self.target, OutputTarget::Gltf | OutputTarget::Web);
        let notes = other
            .then_some("html: the page is its own viewer; `target` is for files that engines read");
        details.notes = Some(notes.into_iter().map(str::to_owned).collect());
        let (web, _) = OutputTarget::Web.encoding(self.compress);
        GltfOptions {
            meshopt: true,
            texture: self.texture_format,
            allow_huge: self.allow_huge,
            ..web
        }
    }
}

/// Figures of the written scene, without levels.
#[derive(
    Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
pub struct WriteDetails {
    /// Steps for opening the file in the target, one sentence each; absent for formats without
    /// targets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<Vec<String>>,
    /// Largest error of a written position, in units of the file; absent when none moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_position_error: Option<f32>,
    /// Triangles that the grid of positions flattened; absent when no position moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collapsed_triangles: Option<u64>,
}

trisplat_scene::stage!(WriteDetails, "write");

trisplat_scene::default!(OutputOptions);

/// The formats that are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum OutputFormat {
    /// glTF 2.0 in one binary file.
    #[default]
    Glb,
    /// glTF 2.0 as JSON with a .bin beside it.
    Gltf,
    /// Wavefront OBJ with a .mtl beside it.
    Obj,
    /// PLY mesh.
    Ply,
    /// One file that phones show in a room.
    Usdz,
    /// One page with a viewer and the scene in it.
    Html,
    /// 3D Tiles 1.1: a tileset.json and a folder of GLB files.
    Tiles,
}

impl OutputFormat {
    /// True when its files store from which sides triangles are drawn.
    pub fn has_sides(self) -> bool {
        !matches!(self, Self::Obj | Self::Ply)
    }

    /// The format of the ending of `path`.
    ///
    /// # Errors
    ///
    /// A name without a known ending.
    pub fn of(path: &Path) -> Result<Self> {
        let ending =
            path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match ending.as_str() {
            "glb" => Ok(Self::Glb),
            "gltf" => Ok(Self::Gltf),
            "obj" => Ok(Self::Obj),
            "ply" => Ok(Self::Ply),
            "usdz" => Ok(Self::Usdz),
            "html" | "htm" => Ok(Self::Html),
            "json" if tiles::is_tileset(path) => Ok(Self::Tiles),
            _ if path.as_os_str() == "-" || is_device(path) => Ok(Self::Glb),
            _ => Err(Error::UnknownEnding { path: path.to_owned() }),
        }
    }
}

/// Name of a scene's node when it is a single one.
const SCENE_NODE: &str = "scene";

/// Name of the node in a file of the collider.
const COLLISION_NODE: &str = "collision";

/// The kinds of files beside the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SideFiles {
    /// Number of levels of detail.
    pub levels: usize,
    /// The backdrop in a separate file.
    pub backdrop: bool,
    /// The surroundings as a panorama.
    pub sky: bool,
    /// The collider.
    pub collision: bool,
    /// The picture of the scene's texture, if the format does not hold it.
    pub texture: bool,
}

fn is_device(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The files one asset becomes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Output {
    format: OutputFormat,
    main: PathBuf,
    /// The .bin of a .gltf, or the .mtl of an .obj.
    second: Option<PathBuf>,
    /// The picture of the texture, if it is a separate file.
    picture: Option<PathBuf>,
    /// Name and content of the engine's import settings.
    sidecar: Option<(PathBuf, String)>,
    /// Name of the scene's node, if the format has nodes.
    node: &'static str,
    /// The panorama in place of a backdrop.
    sky: Option<PathBuf>,
    /// The file of the backdrop, if separate.
    backdrop: Option<Box<Output>>,
    /// The file of the collider, if separate.
    collision: Option<Box<Output>>,
    /// One for each level of detail.
    levels: Vec<Output>,
    /// A tileset.json that names all levels.
    tileset: Option<PathBuf>,
    /// The file that switches levels in an engine.
    engine_levels: Option<(PathBuf, EngineLevels)>,
}

impl Output {
    /// The files of a scene and all files beside it, planned before any work; `format` decides if
    /// the name of `path` does not. Standard output can take only one file.
    ///
    /// # Errors
    ///
    /// A name without a known ending; an output that cannot have files beside it.
    pub fn of_scene(
        path: &Path,
        format: Option<OutputFormat>,
        options: &OutputOptions,
        side_files: &SideFiles,
    ) -> Result<Self> {
        let mut output = Self::plan(path, format, options)?;
        let gltf = matches!(output.format, OutputFormat::Glb | OutputFormat::Gltf);
        let level = |i: usize| output.part(&format!("lod{i}"), "`lod` writes more files", options);
        output.levels = (1..=side_files.levels).map(level).collect::<Result<_>>()?;
        if gltf && side_files.levels > 0 {
            output.tileset = Some(path.with_extension("tileset.json"));
            output.engine_levels =
                options.target.levels().map(|kind| (path.with_extension(kind.ending()), kind));
        }
        if side_files.backdrop {
            output.backdrop =
                Some(Box::new(output.part("backdrop", "`backdrop` file writes one", options)?));
        }
        // A page holds the panorama itself.
        if side_files.sky && output.format != OutputFormat::Html {
            let ending = format!("sky.{}", options.texture_format.ending());
            output.sky = Some(output.side_path(&ending, "`backdrop` sky writes a picture")?);
        }
        // Some targets have a node for the collider.
        if side_files.collision && !(gltf && options.target.has_collision_node()) {
            let file = output.part("collision", "`collision` writes one", options)?;
            output.collision = Some(Box::new(Self { node: COLLISION_NODE, ..file }));
        }
        if side_files.texture && output.format == OutputFormat::Obj {
            output.add_picture(options);
        }
        Ok(output)
    }

    /// The main file of a part, and those that it needs: .bin, .mtl, import settings.
    pub fn plan(
        path: &Path,
        format: Option<OutputFormat>,
        options: &OutputOptions,
    ) -> Result<Self> {
        let refuse = |wants: &str| Err(Error::invalid("output", path.display(), wants));
        let stream = path.as_os_str() == "-" || is_device(path);
        if !stream && path.file_name().is_some_and(|name| name.to_str().is_none()) {
            return refuse("a name in UTF-8, because files that belong together name each other");
        }
        let format = format.map_or_else(|| OutputFormat::of(path), Ok)?;
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("scene.glb");
        if format == OutputFormat::Obj
            && (name.contains(breaks_text) || name.starts_with(char::is_whitespace))
        {
            return refuse(
                "a name of printable characters that begins with no space: OBJ cannot quote the name of its .mtl",
            );
        }
        let second = match format {
            OutputFormat::Gltf => Some(path.with_extension("bin")),
            OutputFormat::Obj => Some(path.with_extension("mtl")),
            _ => None,
        };
        if stream && (second.is_some() || format == OutputFormat::Tiles) {
            return refuse("a file name: this kind writes a second file beside the first");
        }
        if format == OutputFormat::Tiles && !tiles::is_tileset(path) {
            return refuse("a name ending in tileset.json");
        }
        let sidecar = match format {
            OutputFormat::Glb | OutputFormat::Gltf if !stream => options.target.sidecar(name),
            _ => None,
        };
        let sidecar = sidecar.map(|(name, text)| (path.with_file_name(name), text));
        Ok(Self {
            format,
            main: path.to_owned(),
            second,
            sidecar,
            node: SCENE_NODE,
            ..Self::default()
        })
    }

    /// Adds the picture of a texture to the scene, its backdrop and its levels: OUT.jpg.
    fn add_picture(&mut self, options: &OutputOptions) {
        self.picture = Some(self.main.with_extension(options.texture_format.ending()));
        for part in self.backdrop.as_deref_mut().into_iter().chain(&mut self.levels) {
            part.add_picture(options);
        }
    }

    /// The files of OUT.PART.glb, as [`Output::side_path`].
    fn part(&self, part: &str, what: &str, options: &OutputOptions) -> Result<Self> {
        let path = self.side_path(&format!("{part}.{}", self.ending()), what)?;
        Self::plan(&path, Some(self.format), options)
    }

    /// OUT.ENDING; `what` names the content in the error for outputs that cannot have files beside
    /// them.
    fn side_path(&self, ending: &str, what: &str) -> Result<PathBuf> {
        let is_complete =
            matches!(self.format, OutputFormat::Html | OutputFormat::Tiles | OutputFormat::Usdz);
        if is_complete || self.main.as_os_str() == "-" || is_device(&self.main) {
            let wants = format!("a .glb, .gltf, .obj or .ply file: {what} beside the first");
            return Err(Error::invalid("output", self.main.display(), wants));
        }
        Ok(self.main.with_extension(ending))
    }

    fn ending(&self) -> &str {
        self.main.extension().and_then(|e| e.to_str()).unwrap_or("glb")
    }

    /// Every file that will be written.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.parts().flat_map(|output| {
            let all = output.needed_files().into_iter().chain(output.level_files());
            std::iter::once(output.main.as_path()).chain(all.flatten())
        })
    }

    /// The folder of its tiles, in which files get names with hashes.
    pub fn tiles(&self) -> Option<PathBuf> {
        (self.format == OutputFormat::Tiles).then(|| tiles::folder_of(&self.main))
    }

    /// The scene, its backdrop, its collider, its levels.
    fn parts(&self) -> impl Iterator<Item = &Self> {
        let side_outputs = self.backdrop.as_deref().into_iter().chain(self.collision.as_deref());
        std::iter::once(self).chain(side_outputs).chain(&self.levels)
    }

    fn sidecar_path(&self) -> Option<&Path> {
        self.sidecar.as_ref().map(|sidecar| sidecar.0.as_path())
    }

    /// The files that one part needs beside its main file.
    fn needed_files(&self) -> [Option<&Path>; 4] {
        let [second, picture] = [self.second.as_deref(), self.picture.as_deref()];
        [second, picture, self.sidecar_path(), self.sky.as_deref()]
    }

    /// Every file in the order of publication: each after the files that it names.
    fn publishing_order(&self) -> Vec<&Path> {
        let needed_files = self.parts().flat_map(Self::needed_files);
        let parts = self.parts().skip(1).map(|part| Some(part.main.as_path()));
        let last = std::iter::once(Some(self.main.as_path())).chain(self.level_files());
        needed_files.chain(parts).chain(last).flatten().collect()
    }

    /// Starts every file.
    ///
    /// # Errors
    ///
    /// Errors of the operating system; another program that writes one of them.
    pub fn start(&self) -> Result<StartedFiles> {
        StartedFiles::start(self.publishing_order())
    }

    /// Files that only count bytes.
    pub fn dry_run(&self) -> StartedFiles {
        StartedFiles::dry_run(self.paths())
    }

    /// The files that name all levels, in the order of publication.
    fn level_files(&self) -> impl Iterator<Item = Option<&Path>> {
        [self.tileset.as_deref(), self.engine_levels.as_ref().map(|(path, _)| path.as_path())]
            .into_iter()
    }

    /// Files of an earlier scene of the same name that this one does not replace.
    fn stale(&self) -> Vec<PathBuf> {
        if self.main.as_os_str() == "-" || is_device(&self.main) {
            return Vec::new();
        }
        let ending = self.ending();
        let with_ending = |ending: &str| self.main.with_extension(ending);
        let level = |i: usize| with_ending(&format!("lod{i}.{ending}"));
        let first_unused = self.levels.len() + 1;
        let mut stale: Vec<PathBuf> =
            (first_unused..).map(level).take_while(|path| path.exists()).collect();
        let needed_files =
            |path: &PathBuf| ["bin", "mtl"].map(|ending| path.with_extension(ending));
        stale.extend(stale.clone().iter().flat_map(needed_files));
        let parts = ["backdrop", "collision"].map(|part| with_ending(&format!("{part}.{ending}")));
        stale.extend(parts.iter().flat_map(needed_files));
        stale.extend(parts);
        stale.extend(["tileset.json", "sky.jpg", "sky.png"].map(with_ending));
        stale.extend(EngineLevels::ALL.map(|kind| with_ending(kind.ending())));
        // Godot writes settings of that name itself: only unchanged ones are ours.
        let name = self.main.file_name().unwrap_or_default().to_string_lossy();
        let import = OutputTarget::Godot
            .sidecar(&name)
            .map(|(name, text)| (self.main.with_file_name(name), text));
        let ours = |(path, text): (PathBuf, String)| {
            std::fs::read_to_string(&path).is_ok_and(|existing| existing == text).then_some(path)
        };
        stale.extend(import.and_then(ours));
        stale.retain(|path| path.is_file() && self.paths().all(|written| written != path));
        stale
    }
}
