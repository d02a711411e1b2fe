//! The blocks of a scene as one tileset. Each block is baked into tiles of its own; above these, along the cuts that made the blocks, tiles
//! stand for two blocks, four, and so on. Memory holds one block and the coarsest tiles of some others.

use super::merge::{Blocks, OwnedBlock};
use super::region::halves;
use super::source;
use glam::DVec3;
use std::path::{Path, PathBuf};
use trisplat_bake::{Bake, BakeOptions, BakePreset, PlaceOptions, TeacherOptions, enlarge, rank_by_size};
use trisplat_formats::{TilesetTile, TilesetWriter, bounds, output::WriteDetails};
use trisplat_scene::{
    Asset, ImportedScene, Placement, Provenance, Result, Scene, Soup, Tile, UpAxis, mesh::Mesh, placed,
};

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct CityTiles {
    /// The folder of the tiles.
    pub folder: PathBuf,
    /// Bytes of all tiles.
    pub bytes: u64,
    /// Triangles of the finest level, and of the shell.
    pub triangles: u64,
}

/// A tile and the mesh it shows.
struct Node {
    tile: TilesetTile,
    mesh: Mesh,
}

/// Bakes `blocks` into the tileset `path`; calls `done` after each block.
///
/// Errors: those of a bake; what the operating system refuses.
pub fn bake_tiles(
    blocks: &Blocks,
    path: &Path,
    options: &BakeOptions,
    done: &mut dyn FnMut(usize, u64),
) -> Result<CityTiles> {
    let writer = TilesetWriter::start(
        path,
        options.output.encoding(&mut WriteDetails::default()),
        options.output.tileset_tiles,
    )?;
    let (placement, source) = placement(blocks, options)?;
    let mut city =
        City { blocks, options, placement, source, writer, shell: Soup::default(), triangles: 0, done };
    let root = city.node(0, blocks.count(), "")?.map(|node| node.tile);
    let shell = std::mem::take(&mut city.shell);
    let root = city.with_shell(shell, root)?;
    let triangles = city.triangles;
    let (folder, bytes) = city.writer.finish(root)?;
    Ok(CityTiles { folder, bytes, triangles })
}

/// How the whole scene is placed, by its coarse scene; and how that was placed.
fn placement(blocks: &Blocks, options: &BakeOptions) -> Result<(Placement, Placement)> {
    let plan = &blocks.manifest;
    let mut scene = match &plan.coarse {
        Some(coarse) => source::read(blocks.folder(), coarse, &plan.dataset_options.limits)?,
        None => {
            let OwnedBlock { rest, provenance, cameras, .. } = blocks.read(0)?;
            ImportedScene { provenance, cameras, ..ImportedScene::from(rest) }
        }
    };
    let source = std::mem::take(&mut scene.provenance.placement);
    let quick = BakeOptions { place: options.place.clone(), ..plain(&BakeOptions::preset(BakePreset::Fast)) };
    Ok((Bake::new(&quick).run([scene])?.provenance.placement, source))
}

/// The options of a bake without photos or cameras.
fn plain(options: &BakeOptions) -> BakeOptions {
    let teacher = TeacherOptions::OFF;
    let mut plain = BakeOptions { teacher, ..options.clone() };
    plain.unseen.keep_unseen = true;
    plain
}

struct City<'a> {
    blocks: &'a Blocks,
    options: &'a BakeOptions,
    /// From the soups to the file.
    placement: Placement,
    /// From the world to the soups.
    source: Placement,
    writer: TilesetWriter,
    /// The shell of all blocks so far.
    shell: Soup,
    triangles: u64,
    done: &'a mut dyn FnMut(usize, u64),
}

impl City<'_> {
    /// The tile of `count` blocks from `first` on; `None` when they own nothing.
    fn node(&mut self, first: usize, count: usize, name: &str) -> Result<Option<Node>> {
        if count == 1 {
            return self.block(first);
        }
        let [below, above] = halves(count);
        let parts = [
            self.node(first, below, &format!("{name}0"))?,
            self.node(first + below, above, &format!("{name}1"))?,
        ];
        let mut parts: Vec<Node> = parts.into_iter().flatten().collect();
        if parts.len() < 2 {
            return Ok(parts.pop());
        }
        let mut mesh = Mesh::default();
        parts.iter().try_for_each(|part| mesh.append(part.mesh.clone()))?;
        let mesh = coarser(mesh, self.options.tiles.tile_triangles as usize);
        let below = parts.iter().map(|part| part.tile.error).fold(0.0, f64::max);
        let error = Tile::error_of(mesh.detail()).max(below);
        let asset = Asset { provenance: self.provenance(), ..Asset::from(mesh) };
        let children = parts.into_iter().map(|part| part.tile).collect();
        let tile = self.writer.above(&format!("r{name}"), &asset, error, true, children)?;
        Ok(Some(Node { tile, mesh: asset.mesh }))
    }

    /// The tiles of one block.
    fn block(&mut self, index: usize) -> Result<Option<Node>> {
        let OwnedBlock { shell, rest, cameras, .. } = self.blocks.read(index)?;
        self.shell.append(shell);
        if rest.is_empty() {
            (self.done)(index, 0);
            return Ok(None);
        }
        let to_file = |camera| placed::to_file(camera, &self.placement, DVec3::ZERO);
        let cameras = cameras.iter().map(to_file).collect();
        let scene = ImportedScene { cameras, ..self.placed(rest) };
        // It is placed already, like all others.
        let options = BakeOptions { place: PlaceOptions::DEFAULT, ..self.options.clone() };
        let asset = Bake::new(&options).run([scene])?;
        let triangles = asset.mesh.face_count() as u64;
        self.triangles += triangles;
        let tile = self.writer.block(index, &asset)?;
        (self.done)(index, triangles);
        Ok(asset.tiles.map(|root| Node { tile, mesh: root.mesh }))
    }

    /// A soup in the frame of the file.
    fn placed(&self, mut soup: Soup) -> ImportedScene {
        soup.truncate_sh(0);
        let transform = self.placement.transform();
        soup.vertices.iter_mut().flatten().for_each(|corner| *corner = transform(*corner));
        ImportedScene { provenance: self.provenance(), ..ImportedScene::from(Scene::Soup(soup)) }
    }

    fn provenance(&self) -> Provenance {
        let generator = Some(trisplat_scene::report::generator());
        let placement = self.source.then(&self.placement);
        Provenance { generator, up: Some(UpAxis::Y), placement, ..Provenance::default() }
    }

    /// The root, with the shell as a tile of its own that is always drawn.
    fn with_shell(&mut self, shell: Soup, root: Option<TilesetTile>) -> Result<TilesetTile> {
        if let (true, Some(root)) = (shell.is_empty(), &root) {
            return Ok(root.clone());
        }
        let options =
            plain(&BakeOptions { place: PlaceOptions::DEFAULT, ..BakeOptions::preset(BakePreset::Fast) });
        let asset = Bake::new(&options).run([self.placed(shell)])?;
        self.triangles += asset.mesh.face_count() as u64;
        // It is everywhere, so that all below it is wanted until the whole is a few pixels wide.
        let extent =
            bounds(&asset.mesh, asset.mesh.face_count()).map_or(0.0, |[low, high]| (high - low).length());
        let error = root.as_ref().map_or(0.0, |root| root.error).max(extent);
        self.writer.above("shell", &asset, error, false, root.into_iter().collect())
    }
}

/// At most `most` triangles of a mesh, enlarged to cover for the others.
fn coarser(mesh: Mesh, most: usize) -> Mesh {
    let mut mesh = mesh.unshared();
    let half = mesh.face_count().div_ceil(2).min(most);
    let mut kept = rank_by_size(&mesh);
    kept.truncate(half);
    kept.sort_unstable();
    enlarge(&mut mesh, &kept);
    mesh.keep(&kept);
    mesh
}
