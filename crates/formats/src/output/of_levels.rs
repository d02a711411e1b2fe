//! Files that name all levels of detail.

use super::Output;
use crate::gltf::{backdrop_nodes, scene_nodes, uri};
use crate::levels::{EngineLevels, EngineScene, LevelFile};
use crate::tileset::{self, TilesetTile};
use std::path::Path;
use trisplat_scene::{Asset, Result, Tile};

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
            let bounds = tileset::bounds(&asset.mesh, asset.scene_faces());
            let error = if i == 0 { 0.0 } else { Tile::error_of(asset.detail()) };
            let uri = Some(uri::from_file_name(&output.file_name()));
            TilesetTile { uri, bounds, error, replaced: true, children: Vec::new() }
        };
        let root = TilesetTile::chain(self.levels_of(asset).enumerate().map(level));
        root.map_or_else(String::new, |root| tileset::json(&root, &trisplat_scene::report::generator()))
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
