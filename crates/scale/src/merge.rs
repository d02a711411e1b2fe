//! Blocks become one scene again: of each, the triangles whose middle is in its core. One block is in memory at a time.

use super::manifest::{Manifest, NAME};
use super::region::middle;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use trisplat_formats::{self as formats, ReadOptions, ply::SoupWriter};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, Scene, Soup, atomic::AtomicFile, camera::Camera,
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
    /// Errors: those of [`Manifest::read`]; blocks that are not trained yet.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let (manifest, folder) = Manifest::read(path, limits)?;
        let blocks = Self { manifest, folder, limits: *limits };
        let missing: Vec<usize> = (0..blocks.count()).filter(|i| !blocks.path(*i).is_file()).collect();
        match missing.first() {
            None => Ok(blocks),
            Some(first) => {
                let (count, all) = (missing.len(), blocks.count());
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

    /// What a block owns.
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
        let provenance =
            Provenance { source: source.map(|name| name.to_string_lossy().into_owned()), ..provenance };
        let block = &self.manifest.blocks[index];
        let shell = soup.take_shell();
        let owned = |i: usize| block.core.contains(middle(&soup.vertices[i]));
        let keep: Vec<bool> = (0..soup.len()).map(owned).collect();
        soup.retain(|i| keep[i]);
        Ok(OwnedBlock { shell, rest: soup, provenance, cameras })
    }

    /// The cameras of all photos of all blocks, in order of the photos' names.
    fn cameras(&self, found: &[Vec<Camera>]) -> Vec<Camera> {
        let mut all: BTreeMap<u32, Camera> = BTreeMap::new();
        for (block, cameras) in self.manifest.blocks.iter().zip(found) {
            all.extend(block.photos.iter().map(|photo| photo.photo).zip(cameras.iter().copied()));
        }
        all.into_values().collect()
    }

    /// Writes the scene into a file that was started and has yet to be given its name; one block is in memory at a time. Returns its
    /// number of triangles.
    ///
    /// Errors: blocks that cannot be read; what the operating system refuses.
    pub fn merge_into(&self, file: &mut AtomicFile) -> Result<u64> {
        let (mut shell, mut cameras, mut provenance) = (Soup::default(), Vec::new(), None);
        let (mut degree, mut count) = (u8::MAX, 0);
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
        let provenance = Provenance { viewpoint: None, ..provenance.unwrap_or_default() };
        let path = file.path().to_owned();
        let io = |e| Error::io(&path, e);
        let mut out =
            SoupWriter::start(file, count, degree, &provenance, &cameras, !shell.is_empty()).map_err(io)?;
        out.vertices(&shell).map_err(io)?;
        self.each(degree, |rest| out.vertices(rest).map_err(io))?;
        out.faces(&shell).map_err(io)?;
        self.each(degree, |rest| out.faces(rest).map_err(io))?;
        out.end(&cameras).map_err(io)?;
        Ok(count as u64)
    }

    /// What each block owns, without the shell, one block after the other, with colours up to `degree`.
    fn each(&self, degree: u8, mut take: impl FnMut(&Soup) -> Result<()>) -> Result<()> {
        (0..self.count()).try_for_each(|index| {
            let mut rest = self.read(index)?.rest;
            rest.truncate_sh(degree);
            take(&rest)
        })
    }
}

/// What a block owns.
#[derive(Debug, Clone)]
pub(super) struct OwnedBlock {
    /// Its part of the shell.
    pub shell: Soup,
    /// Everything else.
    pub rest: Soup,
    /// Where it comes from.
    pub provenance: Provenance,
    /// The cameras of its photos.
    pub cameras: Vec<Camera>,
}
