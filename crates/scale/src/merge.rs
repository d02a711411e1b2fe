//! Blocks become one scene again: of each, the triangles whose middle is in its core. One block is
//! in memory at a time.

use crate::manifest::{self, Manifest, NAME};
use crate::region::halves;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use trisplat_bake::{
    Bake, BakeOptions, BakePreset, PlaceOptions, TeacherOptions, enlarge, rank_by_size,
};
use trisplat_formats::output::WriteDetails;
use trisplat_formats::ply::SoupWriter;
use trisplat_formats::{self as formats, ReadOptions, TilesetTile, TilesetWriter, bounds};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{
    Asset, Error, ImportedScene, Limits, Placement, Provenance, Result, Scene, Soup, Tile, UpAxis,
    frames,
};

/// The trained blocks of a plan.
#[derive(Debug)]
pub struct Blocks {
    /// The plan.
    pub(super) manifest: Manifest,
    folder: PathBuf,
    limits: Limits,
}

impl Blocks {
    /// Of the plan at `path`, its file or folder.
    ///
    /// # Errors
    ///
    /// As of [`Manifest::read`]; blocks that are not trained yet.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let (manifest, folder) = Manifest::read(path, limits)?;
        let blocks = Self { manifest, folder, limits: *limits };
        let untrained: Vec<usize> =
            (0..blocks.count()).filter(|i| !blocks.path(*i).is_file()).collect();
        match untrained.first() {
            None => Ok(blocks),
            Some(first) => {
                let count = untrained.len();
                let all = blocks.count();
                let reason = format!(
                    "{count} of {all} blocks are not trained yet: `trisplat train --block {}:{first}` and so on",
                    blocks.folder.join(NAME).display()
                );
                Err(Error::unsupported(&blocks.folder, reason))
            }
        }
    }

    /// Number of blocks.
    pub fn count(&self) -> usize {
        self.manifest.blocks.len()
    }

    /// The file of a block's soup.
    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(self.manifest.blocks[index].file(index, "ply"))
    }

    /// The folder of the plan.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Reads a block: the triangles in its core, its shell and its cameras.
    pub(super) fn read(&self, index: usize) -> Result<OwnedBlock> {
        let path = self.path(index);
        let options = ReadOptions { sh_degree: 3, limits: self.limits, ..ReadOptions::default() };
        let ImportedScene { scene, provenance, cameras, .. } = formats::read(&path, &options)?;
        let Scene::Soup(mut soup) = scene else {
            return Err(Error::unsupported(
                &path,
                "is not the soup of a block; remove it and train the block again",
            ));
        };
        // Files of a plan do not name the data set, what is made of them does, as a plain run.
        let source = Path::new(&self.manifest.dataset).file_name();
        let provenance = Provenance {
            source: source.map(|name| name.to_string_lossy().into_owned()),
            ..provenance
        };
        let block = &self.manifest.blocks[index];
        let shell = soup.take_shell();
        let owned = |i: usize| block.core.contains(centroid(soup.vertices[i]));
        let keep: Vec<bool> = (0..soup.len()).map(owned).collect();
        soup.retain(|i| keep[i]);
        Ok(OwnedBlock { shell, rest: soup, provenance, cameras })
    }

    /// The cameras of all photos of all blocks, in order of the photos' names.
    fn cameras(&self, by_block: &[Vec<Camera>]) -> Vec<Camera> {
        let mut all: BTreeMap<u32, Camera> = BTreeMap::new();
        for (block, cameras) in self.manifest.blocks.iter().zip(by_block) {
            all.extend(block.photos.iter().map(|photo| photo.photo).zip(cameras.iter().copied()));
        }
        all.into_values().collect()
    }

    /// Writes the scene into a file that was started and has yet to be given its name; one block is
    /// in memory at a time. Returns its number of triangles.
    ///
    /// # Errors
    ///
    /// Blocks that cannot be read; what the operating system refuses.
    pub fn merge_into(&self, file: &mut AtomicFile) -> Result<u64> {
        let mut shell = Soup::default();
        let mut cameras = Vec::new();
        let mut provenance = None;
        let mut degree = u8::MAX;
        let mut count = 0;
        for index in 0..self.count() {
            let block = self.read(index)?;
            degree = degree.min(block.rest.sh_degree);
            count += block.rest.len() + block.shell.len();
            cameras.push(block.cameras);
            provenance.get_or_insert(block.provenance);
            shell.append(block.shell);
        }
        shell.truncate_sh(degree);
        let cameras = self.cameras(&cameras);
        let provenance = provenance.unwrap_or_default().without_views();
        let path = file.path().to_owned();
        let io = |e| Error::io(&path, e);
        let mut out =
            SoupWriter::start(file, count, degree, &provenance, &cameras, !shell.is_empty())
                .map_err(io)?;
        out.vertices(&shell).map_err(io)?;
        self.each(degree, |rest| out.vertices(rest).map_err(io))?;
        out.faces(&shell).map_err(io)?;
        self.each(degree, |rest| out.faces(rest).map_err(io))?;
        out.end(&cameras).map_err(io)?;
        Ok(count as u64)
    }

    /// Visit the triangles in the core of each block, without the shell, with colours up to
    /// `degree`.
    fn each(&self, degree: u8, mut take: impl FnMut(&Soup) -> Result<()>) -> Result<()> {
        (0..self.count()).try_for_each(|index| {
            let mut rest = self.read(index)?.rest;
            rest.truncate_sh(degree);
            take(&rest)
        })
    }
}

/// Triangles in the core of a block.
#[derive(Debug, Clone)]
pub(super) struct OwnedBlock {
    /// Its part of the shell.
    pub shell: Soup,
    /// Everything else.
    pub rest: Soup,
    /// Provenance of the scene.
    pub provenance: Provenance,
    /// The cameras of its photos.
    pub cameras: Vec<Camera>,
}

// ---- The blocks of a scene as one tileset -------------------------------------------------------

/// Written tiles.
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

/// Bakes `blocks` into the tileset `path`; calls `on_block` with the number and the
/// triangles of each block that is done.
///
/// # Errors
///
/// As of a bake; a refusal of the operating system.
pub fn bake_tiles(
    blocks: &Blocks,
    path: &Path,
    options: &BakeOptions,
    on_block: &mut dyn FnMut(usize, u64),
) -> Result<CityTiles> {
    let writer = TilesetWriter::start(
        path,
        options.output.encoding(&mut WriteDetails::default()),
        options.output.tileset_tiles,
    )?;
    let (placement, source) = placement(blocks, options)?;
    let mut city = City {
        blocks,
        options,
        placement,
        source,
        writer,
        shell: Soup::default(),
        triangles: 0,
        on_block,
    };
    let root = city.node(0, blocks.count(), "")?.map(|node| node.tile);
    let shell = std::mem::take(&mut city.shell);
    let root = city.with_shell(shell, root)?;
    let triangles = city.triangles;
    let (folder, bytes) = city.writer.finish(root)?;
    Ok(CityTiles { folder, bytes, triangles })
}

/// Placement of the whole scene, found on its coarse scene; and that of the coarse scene itself.
fn placement(blocks: &Blocks, options: &BakeOptions) -> Result<(Placement, Placement)> {
    let plan = &blocks.manifest;
    let mut scene = match &plan.coarse {
        Some(coarse) => manifest::read(blocks.folder(), coarse, &plan.dataset_options.limits)?,
        None => {
            let OwnedBlock { rest, provenance, cameras, .. } = blocks.read(0)?;
            ImportedScene { provenance, cameras, ..ImportedScene::from(rest) }
        }
    };
    let source = std::mem::take(&mut scene.provenance.placement);
    let quick = BakeOptions {
        place: options.place.clone(),
        ..plain(&BakeOptions::preset(BakePreset::Fast))
    };
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
    on_block: &'a mut dyn FnMut(usize, u64),
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
            (self.on_block)(index, 0);
            return Ok(None);
        }
        let to_file = |camera| frames::to_file(camera, &self.placement, DVec3::ZERO);
        let cameras = cameras.iter().map(to_file).collect();
        let scene = ImportedScene { cameras, ..self.place(rest) };
        // The mesh is placed already, like all others.
        let options = BakeOptions { place: PlaceOptions::DEFAULT, ..self.options.clone() };
        let asset = Bake::new(&options).run([scene])?;
        let triangles = asset.mesh.face_count() as u64;
        self.triangles += triangles;
        let tile = self.writer.block(index, &asset)?;
        (self.on_block)(index, triangles);
        Ok(asset.tiles.map(|root| Node { tile, mesh: root.mesh }))
    }

    /// Moves a soup to the frame of the file.
    fn place(&self, mut soup: Soup) -> ImportedScene {
        soup.truncate_sh(0);
        let transform = self.placement.transform();
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = transform(*corner);
        }
        ImportedScene { provenance: self.provenance(), ..ImportedScene::from(Scene::Soup(soup)) }
    }

    fn provenance(&self) -> Provenance {
        let generator = Some(trisplat_scene::report::generator());
        let placement = self.source.then(&self.placement);
        Provenance { generator, up: Some(UpAxis::Y), placement, ..Provenance::default() }
    }

    /// The root, with the shell as a tile of its own that is always drawn.
    fn with_shell(&mut self, shell: Soup, root: Option<TilesetTile>) -> Result<TilesetTile> {
        if shell.is_empty()
            && let Some(root) = &root
        {
            return Ok(root.clone());
        }
        let options = plain(&BakeOptions {
            place: PlaceOptions::DEFAULT,
            ..BakeOptions::preset(BakePreset::Fast)
        });
        let asset = Bake::new(&options).run([self.place(shell)])?;
        self.triangles += asset.mesh.face_count() as u64;
        // The shell is everywhere, so all below it is refined until the whole is a few pixels wide.
        let extent = bounds(&asset.mesh, asset.mesh.face_count())
            .map_or(0.0, |[low, high]| (high - low).length());
        let error = root.as_ref().map_or(0.0, |root| root.error).max(extent);
        self.writer.above("shell", &asset, error, false, root.into_iter().collect())
    }
}

/// Half the triangles of a mesh, at most `max_faces`, enlarged to cover for the others.
fn coarser(mesh: Mesh, max_faces: usize) -> Mesh {
    let mut mesh = mesh.unshared();
    let half = mesh.face_count().div_ceil(2).min(max_faces);
    let mut largest = rank_by_size(&mesh);
    largest.truncate(half);
    largest.sort_unstable();
    enlarge(&mut mesh, &largest);
    mesh.keep(&largest);
    mesh.group_materials();
    mesh
}
