//! Encodes an asset in its format.

use super::{Output, OutputFormat, OutputOptions, WriteDetails};
use crate::gltf::{self as gltf, GltfOptions, backdrop_nodes, from_file_name, scene_nodes};
use crate::levels::{EngineLevels, EngineScene, LevelFile};
use crate::tiles::TilesetTile;
use crate::{html, obj, ply, tiles, usdz};
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::{Asset, Error, Result, Tile};

/// The note for a file that does not hold its scene's texture.
const NO_TEXTURE: &str =
    "the texture of the scene is not in this file, which has its colours: write .glb or .gltf to keep it";

impl Output {
    /// Encodes the asset in its format; returns warnings for the user.
    pub(super) fn encode(
        &self,
        asset: &Asset,
        options: &OutputOptions,
        main: &mut AtomicFile,
        second: Option<&mut AtomicFile>,
        details: &mut WriteDetails,
    ) -> Result<Vec<String>> {
        let path = self.main.as_path();
        let io = |e| Error::io(path, e);
        let name_of = |p: &Option<PathBuf>| {
            p.as_ref()
                .and_then(|p| p.file_name())
                .map(|n| n.to_string_lossy().into_owned())
                .unwrap_or_default()
        };
        let name = name_of(&self.second);
        let sky = asset.sky.as_ref().and(self.sky.as_ref()).map(|_| name_of(&self.sky));
        let named =
            |encoding| GltfOptions { node_name: self.node.to_owned(), sky_name: sky.clone(), ..encoding };
        let written = match (self.format, second) {
            (OutputFormat::Obj, Some(mtl)) => {
                let picture = self.picture.as_ref().map(|_| name_of(&self.picture));
                obj::write(main, mtl, &name, picture.as_deref(), asset).map_err(io)?;
                let prefer = "OBJ is text (about 3x a GLB) and Godot, Unity and Unreal drop or cull parts of it; prefer GLB";
                let lost = (asset.mesh.texture.is_some() && picture.is_none()).then_some(NO_TEXTURE);
                return Ok([Some(prefer), lost].into_iter().flatten().map(str::to_owned).collect());
            }
            (OutputFormat::Ply, _) => {
                ply::write_mesh(main, asset, options.ply_face_colors).map_err(io)?;
                return Ok(asset.mesh.texture.iter().map(|_| NO_TEXTURE.to_owned()).collect());
            }
            (OutputFormat::Usdz, _) => return encode_usdz(main, asset, options),
            (OutputFormat::Gltf, Some(bin)) => {
                let encoding = named(options.encoding(details));
                gltf::write_gltf(main, bin, &name, path, asset, &encoding)?
            }
            (OutputFormat::Html, _) => {
                let title = path.file_stem().filter(|name| *name != "-").unwrap_or("trisplat".as_ref());
                let encoding = options.page_encoding(details);
                if !asset.mesh.normals.is_empty() {
                    let unlit =
                        "html: the page shows colours as they are; `lit` is for files that engines read";
                    details.notes.get_or_insert_default().push(unlit.into());
                }
                let format = options.texture_format;
                let encoded =
                    |sky| Ok(html::EncodedPicture { mime: format.media_type(), bytes: format.bytes(sky)? });
                let sky = asset.sky.as_ref().map(encoded).transpose()?;
                html::write(main, path, &title.to_string_lossy(), asset, sky.as_ref(), &encoding)?
            }
            _ => {
                let encoding = named(options.encoding(details));
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

/// The scene for a phone: without its backdrop, since the room is around it.
fn encode_usdz(main: &mut AtomicFile, asset: &Asset, options: &OutputOptions) -> Result<Vec<String>> {
    let apart = asset.apart();
    let scene = apart.as_ref().map_or(asset, |(scene, _)| scene);
    let format = options.texture_format;
    let texture = scene.mesh.texture.as_ref();
    let bytes = texture.map(|texture| format.bytes(texture.joined().pages[0].picture())).transpose()?;
    let name = format!("texture.{}", format.ending());
    let picture = bytes.as_ref().map(|bytes| (name.as_str(), bytes.as_slice()));
    usdz::write(main, picture, scene).map_err(|e| Error::io(main.path(), e))?;
    let plain = "USDZ: phones show pictures and no colours of triangles: `texture`, or `trisplat mesh --texture`, makes one";
    let room = "USDZ: the backdrop is left out, because a phone shows the room around the scene";
    let notes = [(picture.is_none(), plain), (apart.is_some(), room)];
    Ok(notes.into_iter().filter(|(holds, _)| *holds).map(|(_, note)| note.to_owned()).collect())
}

// ---- Files that name all levels of detail ------------------------------------------------------------

impl Output {
    /// The files, in the order of publication.
    pub(super) fn of_levels(&self) -> impl Iterator<Item = Option<&Path>> {
        [self.tileset.as_deref(), self.engine_levels.as_ref().map(|(path, _)| path.as_path())].into_iter()
    }

    /// The scene and its levels, each with its files.
    fn levels_of<'a>(&'a self, asset: &'a Asset) -> impl Iterator<Item = (&'a Asset, &'a Output)> {
        std::iter::once((asset, self)).chain(asset.levels.iter().zip(&self.levels))
    }

    fn file_name(&self) -> String {
        self.main.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The tileset of an asset and its levels.
    pub(super) fn tileset_text(&self, asset: &Asset) -> String {
        let level = |(i, (asset, output)): (usize, (&Asset, &Output))| {
            let bounds = tiles::bounds(&asset.mesh, asset.scene_faces());
            let error = if i == 0 { 0.0 } else { Tile::error_of(asset.detail()) };
            let uri = Some(from_file_name(&output.file_name()));
            TilesetTile { uri, bounds, error, replaced: true, children: Vec::new() }
        };
        let root = TilesetTile::chain(self.levels_of(asset).enumerate().map(level));
        root.map_or_else(String::new, |root| tiles::json(&root, &trisplat_scene::report::generator()))
    }

    /// The file that switches levels in an engine.
    ///
    /// Errors: chunks that do not hold every face once.
    pub(super) fn engine_text(&self, kind: EngineLevels, asset: &Asset) -> Result<String> {
        let file = |(asset, output): (&'_ Asset, &Output)| {
            let nodes = scene_nodes(asset, output.node)?;
            let backdrop = if self.backdrop.is_none() { backdrop_nodes(asset)? } else { Vec::new() };
            Ok(LevelFile { name: output.file_name(), nodes, backdrop })
        };
        let files: Vec<LevelFile> = self.levels_of(asset).map(file).collect::<Result<_>>()?;
        let scene = EngineScene::new(self.levels_of(asset).map(|(asset, _)| asset).zip(files));
        let name = self.main.file_stem().unwrap_or_default().to_string_lossy();
        Ok(kind.text(&name, &scene))
    }

    /// Limitations of an engine with the levels of this asset.
    pub(super) fn engine_warning(&self, kind: EngineLevels, asset: &Asset) -> Option<String> {
        let within = self.backdrop.is_none() && asset.has_backdrop();
        (kind == EngineLevels::UnrealScript && within).then(|| {
            "unreal: levels are of one mesh, and the backdrop would count for its size: give `backdrop` file".to_owned()
        })
    }
}
