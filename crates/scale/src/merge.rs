//! Blocks become one scene again: of each, the triangles whose middle is in its core. One block is in memory at a time.

use super::manifest::{Block, Manifest};
use super::region::{Region, middle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use trisplat_dataset::ShrunkSize;
use trisplat_formats::{self as formats, ReadOptions, ply::SoupWriter};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, Scene, Soup, atomic::AtomicFile, camera::Camera,
};

/// What a merge measured at the borders of blocks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat report of a merge")]
pub struct MergeReport {
    /// Program and version.
    pub generator: String,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Triangles of the shell, the first of these.
    pub shell: u64,
    /// One entry per block.
    pub blocks: Vec<BlockSeams>,
    /// How the scene looks at seams and elsewhere; only where it was compared with photos.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quality: Vec<SeamQuality>,
}

/// What the merge kept and left out of a block.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BlockSeams {
    /// Triangles that it owns.
    pub owned: u64,
    /// Of these, triangles with a corner in another block.
    pub crossing: u64,
    /// Triangles left out because another block owns them.
    pub left_out: u64,
}

/// How a scene looks at seams and elsewhere, over the held-out photos.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SeamQuality {
    /// The scene.
    pub scene: String,
    /// Held-out photos.
    pub photos: u64,
    /// The size that these photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// Mean PSNR, dB.
    pub psnr: f64,
    /// PSNR of all pixels near a seam, dB; null without such pixels.
    pub seams_psnr: Option<f64>,
    /// PSNR of all other pixels, dB.
    pub elsewhere_psnr: Option<f64>,
    /// Share of the pixels near a seam.
    pub seams_share: f64,
}

/// The trained blocks of a plan.
#[derive(Debug)]
pub struct Blocks {
    /// The plan.
    pub manifest: Manifest,
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
        let missing: Vec<usize> = (0..blocks.len()).filter(|i| !blocks.path(*i).is_file()).collect();
        match missing.first() {
            None => Ok(blocks),
            Some(first) => {
                let (count, all) = (missing.len(), blocks.len());
                let reason = format!(
                    "{count} of {all} blocks are not trained yet: `trisplat train --block {}:{first}` and so on",
                    blocks.folder.join(super::manifest::NAME).display()
                );
                Err(Error::unsupported(&blocks.folder, reason))
            }
        }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.manifest.blocks.len()
    }

    /// True without blocks, which no plan is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The file of a block's soup.
    pub fn path(&self, index: usize) -> PathBuf {
        self.folder.join(self.manifest.blocks[index].file(index, "ply"))
    }

    /// The folder of the plan.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What a block owns, and what of it is left out.
    pub fn read(&self, index: usize) -> Result<(OwnedBlock, BlockSeams)> {
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
        let crosses = |corners: &[glam::Vec3; 3]| !corners.iter().all(|corner| block.core.contains(*corner));
        let kept = || (0..soup.len()).filter(|i| keep[*i]);
        let seams = BlockSeams {
            // Its part of the shell is its own, wherever that is.
            owned: (shell.len() + kept().count()) as u64,
            crossing: kept().filter(|i| crosses(&soup.vertices[*i])).count() as u64,
            left_out: keep.iter().filter(|keep| !**keep).count() as u64,
        };
        soup.retain(|i| keep[i]);
        Ok((OwnedBlock { shell, rest: soup, provenance, cameras }, seams))
    }

    /// The cameras of all photos of all blocks, in order of the photos' names.
    fn cameras(&self, found: &[Vec<Camera>]) -> Vec<Camera> {
        let mut all: BTreeMap<u32, Camera> = BTreeMap::new();
        for (block, cameras) in self.manifest.blocks.iter().zip(found) {
            all.extend(block.photos.iter().map(|photo| photo.photo).zip(cameras.iter().copied()));
        }
        all.into_values().collect()
    }

    /// Writes the scene into a file that was started and has yet to be given its name; one block is in memory at a time.
    ///
    /// Errors: blocks that cannot be read; what the operating system refuses.
    pub fn merge_into(&self, file: &mut AtomicFile) -> Result<MergeReport> {
        let mut report =
            MergeReport { generator: trisplat_scene::report::generator(), ..MergeReport::default() };
        let (mut shell, mut cameras, mut provenance) = (Soup::default(), Vec::new(), None);
        let mut degree = u8::MAX;
        for index in 0..self.len() {
            let (block, seams) = self.read(index)?;
            degree = degree.min(block.rest.sh_degree);
            report.triangles += seams.owned;
            report.blocks.push(seams);
            cameras.push(block.cameras);
            provenance.get_or_insert(block.provenance);
            shell.append(block.shell);
        }
        report.shell = shell.len() as u64;
        shell.truncate_sh(degree);
        let cameras = self.cameras(&cameras);
        let provenance = Provenance { viewpoint: None, ..provenance.unwrap_or_default() };
        let path = file.path().to_owned();
        let io = |e| Error::io(&path, e);
        let count = usize::try_from(report.triangles).unwrap_or(usize::MAX);
        let mut out =
            SoupWriter::start(file, count, degree, &provenance, &cameras, !shell.is_empty()).map_err(io)?;
        out.vertices(&shell).map_err(io)?;
        self.each(degree, |rest| out.vertices(rest).map_err(io))?;
        out.faces(&shell).map_err(io)?;
        self.each(degree, |rest| out.faces(rest).map_err(io))?;
        out.end(&cameras).map_err(io)?;
        Ok(report)
    }

    /// What each block owns, without the shell, one block after the other, with colours up to `degree`.
    fn each(&self, degree: u8, mut take: impl FnMut(&Soup) -> Result<()>) -> Result<()> {
        (0..self.len()).try_for_each(|index| {
            let mut rest = self.read(index)?.0.rest;
            rest.truncate_sh(degree);
            take(&rest)
        })
    }

    /// The boxes of the blocks.
    pub fn cores(&self) -> impl Iterator<Item = &Region> {
        self.manifest.blocks.iter().map(|block: &Block| &block.core)
    }
}

/// What a block owns.
#[derive(Debug, Clone)]
pub struct OwnedBlock {
    /// Its part of the shell.
    pub shell: Soup,
    /// Everything else.
    pub rest: Soup,
    /// Where it comes from.
    pub provenance: Provenance,
    /// The cameras of its photos.
    pub cameras: Vec<Camera>,
}
