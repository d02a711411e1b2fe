//! Writes the files of an output: each in its format, then the files that name all levels.

use super::{Output, OutputFormat, OutputOptions, WriteDetails};
use crate::gltf::{self as gltf, GltfOptions, from_file_name, node_names};
use crate::levels::{EngineLevels, EngineScene, LevelFile};
use crate::tiles::{self, TilesetTile, TilesetWriter};
use crate::{html, obj, ply, usdz};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::{AtomicFile, StartedFiles, publish};
use trisplat_scene::report::{Outcome, OutputReport, Report, StageObserver};
use trisplat_scene::{Asset, Error, Provenance, Result, Tile};

/// The note for a file that does not hold its scene's texture.
const NO_TEXTURE: &str = "the texture of the scene is not in this file, which has its colours: write .glb or .gltf to keep it";

/// Loss of a scene with spherical harmonics in a format without a place for them.
const NO_SH: &str =
    "the file shows the plain colours: only glTF, GLB and pages hold view-dependent ones";

/// The note for a file that does not hold its scene's sides.
const NO_SIDES: &str = "this file does not say from which sides triangles are drawn, so their backs show: write .glb or .gltf to keep sides";

/// Writes an asset into the files of `output` and names them only when all are whole.
///
/// # Errors
///
/// Errors of the format and of the operating system; then every name keeps its old file.
pub fn write(
    asset: &Asset,
    output: &Output,
    files: StartedFiles,
    options: &OutputOptions,
    report: &mut Report,
    observer: StageObserver<'_>,
) -> Result<()> {
    let mut writer = SetWriter { options, started: files, written: Vec::new() };
    let mut warnings = Vec::new();
    let mut tiles = None;
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
    let paths =
        |files: &[AtomicFile]| files.iter().map(|file| file.path().to_owned()).collect::<Vec<_>>();
    let names = paths(&written);
    let order = output.publishing_order();
    written.sort_by_key(|file| order.iter().position(|path| *path == file.path()));
    let sizes: BTreeMap<PathBuf, u64> =
        paths(&written).into_iter().zip(publish(written)?).collect();
    for name in names {
        report.outputs.push(OutputReport { path: name.display().to_string(), bytes: sizes[&name] });
    }
    if let Some((folder, bytes)) = tiles.map(|keep| keep()) {
        report.outputs.push(OutputReport { path: folder.display().to_string(), bytes });
    }
    let stale = if kept { output.stale() } else { Vec::new() };
    let stale: Vec<String> = stale.iter().map(|path| path.display().to_string()).collect();
    if !stale.is_empty() {
        let files = stale.join(", ");
        let verb = if stale.len() == 1 { "is" } else { "are" };
        report.warnings.push(format!(
            "{files} {verb} left of an earlier scene of this name: remove what is not needed"
        ));
    }
    Ok(())
}

/// The files of an output during writing.
struct SetWriter<'a> {
    options: &'a OutputOptions,
    started: StartedFiles,
    written: Vec<AtomicFile>,
}

impl SetWriter<'_> {
    /// The tiles, which have their final names, and the tileset, which gets its name with the other
    /// files. Returns a function to call then.
    fn tiles(
        &mut self,
        asset: &Asset,
        output: &Output,
        details: &mut WriteDetails,
    ) -> Result<impl FnOnce() -> (PathBuf, u64) + use<>> {
        let file = self.started.take(&output.main)?;
        let encoding = self.options.encoding(details);
        let mut writer = TilesetWriter::of(file, encoding, self.options.tileset_tiles)?;
        let root = writer.scene(asset)?;
        let (file, keep) = writer.write_tileset(root)?;
        self.written.push(file);
        Ok(keep)
    }

    /// Writes the scene, its backdrop, its collider, its levels and the files that name them;
    /// returns warnings for the user.
    fn all(
        &mut self,
        asset: &Asset,
        output: &Output,
        details: &mut WriteDetails,
    ) -> Result<Vec<String>> {
        let mut quiet = WriteDetails::default();
        let mut warnings = if let Some(beside) = output.backdrop.as_deref()
            && let Some((scene, backdrop)) = asset.split_backdrop()
        {
            let mut warnings = self.one(&scene, output, details)?;
            warnings.extend(self.one(&backdrop, beside, &mut quiet)?);
            warnings
        } else {
            self.one(asset, output, details)?
        };
        if let (Some(path), Some(sky)) = (&output.sky, asset.sky()) {
            self.bytes(path, &self.options.texture_format.bytes(sky)?)?;
        }
        if let (Some(beside), Some(mesh)) = (&output.collision, &asset.collision) {
            // A collider is not viewed.
            let provenance =
                Provenance { backdrop_faces: 0, ..asset.provenance.clone().without_views() };
            let collision = Asset { provenance, ..Asset::from(mesh.clone()) };
            warnings.extend(self.one(&collision, beside, &mut quiet)?);
        }
        for (level, files) in asset.levels.iter().zip(&output.levels) {
            // One file of a backdrop serves all levels.
            let scene = output
                .backdrop
                .as_ref()
                .and_then(|_| level.split_backdrop())
                .map(|(scene, _)| scene);
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
    fn one(
        &mut self,
        asset: &Asset,
        output: &Output,
        details: &mut WriteDetails,
    ) -> Result<Vec<String>> {
        let mut main = self.started.take(&output.main)?;
        let mut second =
            output.second.as_deref().map(|path| self.started.take(path)).transpose()?;
        let warnings = output.encode(asset, self.options, &mut main, second.as_mut(), details)?;
        self.written.push(main);
        self.written.extend(second);
        if let (Some(path), Some(texture)) = (&output.picture, &asset.mesh.texture) {
            self.bytes(
                path,
                &self.options.texture_format.bytes(texture.joined().pages[0].picture())?,
            )?;
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

impl Output {
    /// Encodes the asset in its format; returns warnings for the user.
    fn encode(
        &self,
        asset: &Asset,
        options: &OutputOptions,
        main: &mut AtomicFile,
        second: Option<&mut AtomicFile>,
        details: &mut WriteDetails,
    ) -> Result<Vec<String>> {
        let path = self.main.as_path();
        let io = |e| Error::io(path, e);
        let name = self.second.as_deref().map(name_of).unwrap_or_default();
        let sky = asset.sky().and(self.sky.as_deref()).map(name_of);
        let with_names = |encoding| GltfOptions {
            node_name: self.node.to_owned(),
            sky_name: sky.clone(),
            ..encoding
        };
        let has_fronts = (0..asset.scene_faces()).any(|face| asset.mesh.is_single_sided(face));
        let no_sides = (has_fronts && !self.format.has_sides()).then_some(NO_SIDES);
        let no_sh = asset.mesh.sh.as_ref().map(|_| NO_SH);
        let written = match (self.format, second) {
            (OutputFormat::Obj, Some(mtl)) => {
                let picture = self.picture.as_deref().map(name_of);
                obj::write(main, mtl, &name, picture.as_deref(), asset).map_err(io)?;
                let prefer = "OBJ is text (about 3x a GLB) and Godot, Unity and Unreal drop or cull parts of it; prefer GLB";
                let lost =
                    (asset.mesh.texture.is_some() && picture.is_none()).then_some(NO_TEXTURE);
                return Ok([Some(prefer), lost, no_sides, no_sh]
                    .into_iter()
                    .flatten()
                    .map(str::to_owned)
                    .collect());
            }
            (OutputFormat::Ply, _) => {
                ply::write_mesh(main, asset, options.ply_face_colors).map_err(io)?;
                let lost = asset.mesh.texture.as_ref().map(|_| NO_TEXTURE);
                return Ok([lost, no_sides, no_sh]
                    .into_iter()
                    .flatten()
                    .map(str::to_owned)
                    .collect());
            }
            (OutputFormat::Usdz, _) => return encode_usdz(main, asset, options),
            (OutputFormat::Gltf, Some(bin)) => {
                let encoding = with_names(options.encoding(details));
                gltf::write_gltf(main, bin, &name, path, asset, &encoding)?
            }
            (OutputFormat::Html, _) => {
                let title =
                    path.file_stem().filter(|name| *name != "-").unwrap_or("trisplat".as_ref());
                let encoding = options.page_encoding(details);
                let format = options.texture_format;
                let sky = asset.sky().map(|sky| format.bytes(sky)).transpose()?;
                let sky = sky.map(|bytes| (format.media_type(), bytes));
                html::write(main, path, &title.to_string_lossy(), asset, sky, &encoding)?
            }
            _ => {
                let encoding = with_names(options.encoding(details));
                gltf::write_glb(main, path, asset, &encoding)?
            }
        };
        if written.worst_position_error > 0.0 {
            details.worst_position_error = Some(written.worst_position_error);
            details.collapsed_triangles = Some(written.collapsed);
        }
        Ok(written.warnings)
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The scene for a phone: without its backdrop, since the room is around it.
fn encode_usdz(
    main: &mut AtomicFile,
    asset: &Asset,
    options: &OutputOptions,
) -> Result<Vec<String>> {
    let parts = asset.split_backdrop();
    let scene = parts.as_ref().map_or(asset, |(scene, _)| scene);
    let format = options.texture_format;
    let texture = scene.mesh.texture.as_ref();
    let bytes =
        texture.map(|texture| format.bytes(texture.joined().pages[0].picture())).transpose()?;
    let name = format!("texture.{}", format.ending());
    let picture = bytes.as_ref().map(|bytes| (name.as_str(), bytes.as_slice()));
    usdz::write(main, picture, scene).map_err(|e| Error::io(main.path(), e))?;
    let plain = "USDZ: phones show pictures and no colours of triangles: give `texture`, even where colours are closer to the photos, or use `trisplat mesh --texture`";
    let room = "USDZ: the backdrop is left out, because a phone shows the room around the scene";
    let notes =
        [(picture.is_none(), plain), (parts.is_some(), room), (scene.mesh.sh.is_some(), NO_SH)];
    Ok(notes.into_iter().filter(|(holds, _)| *holds).map(|(_, note)| note.to_owned()).collect())
}

// ---- Files that name all levels of detail -------------------------------------------------------

impl Output {
    /// The scene and its levels, each with its files.
    fn levels_of<'a>(&'a self, asset: &'a Asset) -> impl Iterator<Item = (&'a Asset, &'a Output)> {
        std::iter::once((asset, self)).chain(asset.levels.iter().zip(&self.levels))
    }

    /// The tileset of an asset and its levels.
    fn tileset_text(&self, asset: &Asset) -> String {
        let level = |(i, (asset, output)): (usize, (&Asset, &Output))| {
            let bounds = tiles::bounds(&asset.mesh, asset.scene_faces());
            let error = if i == 0 { 0.0 } else { Tile::error_of(asset.detail()) };
            let uri = Some(from_file_name(&name_of(&output.main)));
            TilesetTile { uri, bounds, error, replaced: true, children: Vec::new() }
        };
        let root = TilesetTile::chain(self.levels_of(asset).enumerate().map(level));
        root.map_or_else(String::new, |root| {
            tiles::json(&root, &trisplat_scene::report::generator())
        })
    }

    /// The file that switches levels in an engine.
    ///
    /// # Errors
    ///
    /// Chunks that do not hold every face once.
    fn engine_text(&self, kind: EngineLevels, asset: &Asset) -> Result<String> {
        let file = |(asset, output): (&'_ Asset, &Output)| {
            let [nodes, within] = node_names(asset, output.node)?;
            let backdrop = if self.backdrop.is_none() { within } else { Vec::new() };
            Ok(LevelFile { name: name_of(&output.main), nodes, backdrop })
        };
        let files: Vec<LevelFile> = self.levels_of(asset).map(file).collect::<Result<_>>()?;
        let scene = EngineScene::new(self.levels_of(asset).map(|(asset, _)| asset).zip(files));
        let name = self.main.file_stem().unwrap_or_default().to_string_lossy();
        Ok(kind.text(&name, &scene))
    }

    /// Limitations of an engine with the levels of this asset.
    fn engine_warning(&self, kind: EngineLevels, asset: &Asset) -> Option<String> {
        let within = self.backdrop.is_none() && asset.has_backdrop();
        (kind == EngineLevels::UnrealScript && within).then(|| {
            "unreal: levels are of one mesh, and the backdrop would count for its size: give `backdrop` file".to_owned()
        })
    }
}
