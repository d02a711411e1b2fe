//! Writes an asset to all files of its format: they are planned first, then written, then renamed together.

mod beside;
mod encode;

use super::levels::EngineLevels;
use super::target::OutputTarget;
use super::tiles::{self, TileFiles};
use crate::gltf::{GltfOptions, TextureFormat};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::{
    Asset, Error, Provenance, Result,
    atomic::{AtomicFile, publish},
    ranges::{self, Called},
    report::{Outcome, OutputReport, Report, StageDetails, StageObserver},
};

pub use beside::Beside;

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
    /// 3D Tiles: most tiles in one tileset.json, 5 or more; of a larger tree, parts become tilesets of their own, which viewers load when
    /// they come near
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
        ranges::check(self, Called::ByFlag)
    }

    /// The glTF options of the target; notes for the user go into `details`.
    pub fn encoding(&self, details: &mut WriteDetails) -> GltfOptions {
        let encoding = self.target.encoding(self.compress);
        details.notes = Some(encoding.notes);
        GltfOptions { texture: self.texture_format, allow_huge: self.allow_huge, ..encoding.options }
    }

    /// The glTF options of our own page: it reads everything, so it is compressed, without loss by default.
    fn page_encoding(&self, details: &mut WriteDetails) -> GltfOptions {
        let other = !matches!(self.target, OutputTarget::Gltf | OutputTarget::Web);
        let notes =
            other.then_some("html: the page is its own viewer; `target` is for files that engines read");
        details.notes = Some(notes.into_iter().map(str::to_owned).collect());
        let web = OutputTarget::Web.encoding(self.compress).options;
        GltfOptions {
            meshopt: true,
            lit: false,
            texture: self.texture_format,
            allow_huge: self.allow_huge,
            ..web
        }
    }
}

/// Figures of the written scene, without levels.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct WriteDetails {
    /// Steps for opening the file in the target, one sentence each; absent for formats without targets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<Vec<String>>,
    /// Largest error of a written position, in units of the file; absent when none moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_position_error: Option<f32>,
    /// Triangles that the grid of positions flattened; absent when no position moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collapsed_triangles: Option<u64>,
}

impl StageDetails for WriteDetails {
    const STAGE: &'static str = "write";
}

impl Default for OutputOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum OutputFormat {
    /// glTF 2.0 in one binary file.
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
    /// By the ending of `path`.
    ///
    /// Errors: a name without a known ending.
    pub fn of(path: &Path) -> Result<Self> {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match ending.as_str() {
            "glb" => Ok(Self::Glb),
            "gltf" => Ok(Self::Gltf),
            "obj" => Ok(Self::Obj),
            "ply" => Ok(Self::Ply),
            "usdz" => Ok(Self::Usdz),
            "html" | "htm" => Ok(Self::Html),
            "json" if tiles::is_tileset(path) => Ok(Self::Tiles),
            _ if path.as_os_str() == "-" || is_device(path) => Ok(Self::Glb),
            _ => Err(Error::invalid(
                "output",
                path.display(),
                "a name ending in .glb, .gltf, .obj, .ply, .usdz, .html or .tileset.json, or `format`",
            )),
        }
    }
}

/// Name of a scene's node when it is a single one.
const SCENE_NODE: &str = "scene";

fn is_device(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The files one asset becomes.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    format: OutputFormat,
    main: PathBuf,
    /// .bin or .mtl.
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
    /// Names all levels.
    tileset: Option<PathBuf>,
    /// The file that switches levels in an engine.
    engine_levels: Option<(PathBuf, EngineLevels)>,
}

impl Output {
    /// Plans every file before any work. Standard output can take only one file.
    pub fn plan(path: &Path, format: Option<OutputFormat>, options: &OutputOptions) -> Result<Self> {
        let stream = path.as_os_str() == "-" || is_device(path);
        if !stream && path.file_name().is_some_and(|name| name.to_str().is_none()) {
            let wants = "a name in UTF-8, because files that belong together name each other";
            return Err(Error::invalid("output", path.display(), wants));
        }
        let format = format.map_or_else(|| OutputFormat::of(path), Ok)?;
        let second = match format {
            OutputFormat::Gltf => Some(path.with_extension("bin")),
            OutputFormat::Obj => Some(path.with_extension("mtl")),
            _ => None,
        };
        if stream && (second.is_some() || format == OutputFormat::Tiles) {
            let wants = "a file name: this kind writes a second file beside the first";
            return Err(Error::invalid("output", path.display(), wants));
        }
        if format == OutputFormat::Tiles && !tiles::is_tileset(path) {
            let wants = "a name ending in tileset.json";
            return Err(Error::invalid("output", path.display(), wants));
        }
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("scene.glb");
        let sidecar = match format {
            OutputFormat::Glb | OutputFormat::Gltf if !stream => options.target.sidecar(name),
            _ => None,
        };
        Ok(Self {
            format,
            main: path.to_owned(),
            second,
            picture: None,
            sidecar: sidecar.map(|(name, text)| (path.with_file_name(name), text)),
            node: SCENE_NODE,
            sky: None,
            backdrop: None,
            collision: None,
            levels: Vec::new(),
            tileset: None,
            engine_levels: None,
        })
    }

    /// Every file that will be written.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.parts().flat_map(|output| {
            let all = output.beside_main().into_iter().chain(output.of_levels());
            std::iter::once(output.main.as_path()).chain(all.flatten())
        })
    }

    /// The folder of its tiles, in which files get names with hashes.
    pub fn tiles(&self) -> Option<PathBuf> {
        (self.format == OutputFormat::Tiles).then(|| tiles::folder_of(&self.main))
    }

    /// The scene, its backdrop, its collider, its levels.
    fn parts(&self) -> impl Iterator<Item = &Self> {
        let beside = self.backdrop.as_deref().into_iter().chain(self.collision.as_deref());
        std::iter::once(self).chain(beside).chain(&self.levels)
    }

    fn import(&self) -> Option<&Path> {
        self.sidecar.as_ref().map(|sidecar| sidecar.0.as_path())
    }

    /// The files of one part beside its first.
    fn beside_main(&self) -> [Option<&Path>; 4] {
        let [second, picture] = [self.second.as_deref(), self.picture.as_deref()];
        [second, picture, self.import(), self.sky.as_deref()]
    }

    /// Every file in the order of publication: each after the files that it names.
    fn publishing_order(&self) -> Vec<&Path> {
        let beside = self.parts().flat_map(Self::beside_main);
        let parts = self.parts().skip(1).map(|part| Some(part.main.as_path()));
        let last = std::iter::once(Some(self.main.as_path())).chain(self.of_levels());
        beside.chain(parts).chain(last).flatten().collect()
    }

    /// Starts every file. From here on no other program writes them, and unwritable outputs have failed.
    ///
    /// Errors: those of the operating system; another program that writes one of them.
    pub fn start(&self) -> Result<OutputFiles> {
        AtomicFile::create_all(&self.publishing_order()).map(OutputFiles)
    }

    /// Files that only count bytes.
    pub fn dry_run(&self) -> OutputFiles {
        OutputFiles(self.paths().map(AtomicFile::nowhere).collect())
    }
}

/// The files of an output, started but incomplete.
#[derive(Debug)]
pub struct OutputFiles(Vec<AtomicFile>);

impl OutputFiles {
    fn take(&mut self, path: &Path) -> Result<AtomicFile> {
        match self.0.iter().position(|file| file.path() == path) {
            Some(at) => Ok(self.0.swap_remove(at)),
            None => AtomicFile::create(path),
        }
    }
}

/// Writes an asset into the files of `output` and names them only when all are whole.
///
/// Errors: those of the format and of the operating system; then every name keeps its old file.
pub fn write(
    asset: &Asset,
    output: &Output,
    files: OutputFiles,
    options: &OutputOptions,
    report: &mut Report,
    observer: StageObserver<'_>,
) -> Result<()> {
    let mut writer = SetWriter { options, started: files, written: Vec::new() };
    let (mut warnings, mut tiles) = (Vec::new(), None);
    let counts = asset.counts();
    report.stage(
        observer,
        (),
        |()| counts,
        |(), details| {
            if output.format == OutputFormat::Tiles {
                tiles = Some(writer.tiles(asset, output, details)?);
            } else {
                warnings = writer.all(asset, output, details)?;
            }
            Ok(Outcome::Changed(()))
        },
    )?;
    report.warnings.append(&mut warnings);
    let mut written = writer.written;
    let kept = !written.iter().any(AtomicFile::is_dry);
    let names: Vec<PathBuf> = written.iter().map(|file| file.path().to_owned()).collect();
    let order = output.publishing_order();
    written.sort_by_key(|file| order.iter().position(|path| *path == file.path()));
    let published: Vec<PathBuf> = written.iter().map(|file| file.path().to_owned()).collect();
    let sizes = publish(written)?;
    for name in names {
        let bytes = published.iter().position(|path| *path == name).map_or(0, |at| sizes[at]);
        report.outputs.push(OutputReport { path: name.display().to_string(), bytes });
    }
    if let Some((folder, bytes)) = tiles.map(TileFiles::keep) {
        report.outputs.push(OutputReport { path: folder.display().to_string(), bytes });
    }
    let stale = if kept { output.stale() } else { Vec::new() };
    let stale: Vec<String> = stale.iter().map(|path| path.display().to_string()).collect();
    if !stale.is_empty() {
        let (files, verb) = (stale.join(", "), if stale.len() == 1 { "is" } else { "are" });
        report
            .warnings
            .push(format!("{files} {verb} left of an earlier scene of this name: remove what is not needed"));
    }
    Ok(())
}

/// The files of an output during writing.
struct SetWriter<'a> {
    options: &'a OutputOptions,
    started: OutputFiles,
    written: Vec<AtomicFile>,
}

impl SetWriter<'_> {
    /// The tiles, which have their final names, and the tileset, which gets its name with the other files.
    fn tiles(&mut self, asset: &Asset, output: &Output, details: &mut WriteDetails) -> Result<TileFiles> {
        let mut file = self.started.take(&output.main)?;
        let encoding = self.options.encoding(details);
        let (tiles, text) = TileFiles::write(&mut file, asset, &encoding, self.options.tileset_tiles)?;
        file.write_all(text.as_bytes()).map_err(|e| Error::io(&output.main, e))?;
        self.written.push(file);
        Ok(tiles)
    }

    /// Writes the scene, its backdrop, its collider, its levels and the files that name them; returns
    /// warnings for the user.
    fn all(&mut self, asset: &Asset, output: &Output, details: &mut WriteDetails) -> Result<Vec<String>> {
        let mut warnings;
        let mut quiet = WriteDetails::default();
        match output.backdrop.as_deref().and_then(|beside| Some((beside, asset.apart()?))) {
            Some((beside, (scene, backdrop))) => {
                warnings = self.one(&scene, output, details)?;
                warnings.extend(self.one(&backdrop, beside, &mut quiet)?);
            }
            None => warnings = self.one(asset, output, details)?,
        }
        if let (Some(path), Some(sky)) = (&output.sky, &asset.sky) {
            self.bytes(path, &self.options.texture_format.bytes(sky)?)?;
        }
        if let (Some(beside), Some(mesh)) = (&output.collision, &asset.collision) {
            // Nobody looks at it.
            let provenance = Provenance { backdrop: 0, viewpoint: None, ..asset.provenance.clone() };
            let collision = Asset { provenance, ..Asset::from(mesh.clone()) };
            warnings.extend(self.one(&collision, beside, &mut quiet)?);
        }
        for (level, files) in asset.levels.iter().zip(&output.levels) {
            // One file of a backdrop serves all levels.
            let scene = output.backdrop.as_ref().and_then(|_| level.apart()).map(|(scene, _)| scene);
            warnings.extend(self.one(scene.as_ref().unwrap_or(level), files, &mut quiet)?);
        }
        if let Some(path) = &output.tileset {
            self.text(path, &output.tileset_text(asset))?;
        }
        if let Some((path, kind)) = &output.engine_levels {
            self.text(path, &output.engine_text(*kind, asset)?)?;
            warnings.extend(output.engine_warning(*kind, asset));
        }
        Ok(warnings)
    }

    /// The files of one level; returns warnings for the user.
    fn one(&mut self, asset: &Asset, output: &Output, details: &mut WriteDetails) -> Result<Vec<String>> {
        let mut main = self.started.take(&output.main)?;
        let mut second = output.second.as_deref().map(|path| self.started.take(path)).transpose()?;
        let warnings = output.encode(asset, self.options, &mut main, second.as_mut(), details)?;
        self.written.push(main);
        self.written.extend(second);
        if let (Some(path), Some(texture)) = (&output.picture, &asset.mesh.texture) {
            self.bytes(path, &self.options.texture_format.bytes(texture.joined().pages[0].picture())?)?;
        }
        if let Some((path, text)) = &output.sidecar {
            self.text(path, text)?;
        }
        Ok(warnings)
    }

    fn text(&mut self, path: &Path, text: &str) -> Result<()> {
        self.bytes(path, text.as_bytes())
    }

    fn bytes(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        let mut file = self.started.take(path)?;
        file.write_all(bytes).map_err(|e| Error::io(path, e))?;
        self.written.push(file);
        Ok(())
    }
}
