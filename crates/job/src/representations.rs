//! The forms of a trained soup from scene to file, each ready for drawing.
//!
//! ```text
//! soft (as trained) ──► solid (baked, in memory) ──► file (quantised, written, read back)
//! ```

use super::renderer::{RenderMode, RenderOptions, SceneRenderer};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_bake::{BakeOptions, bake};
use trisplat_dataset::Dataset;
use trisplat_formats::output::{self, Output, OutputOptions};
use trisplat_formats::{self as formats, OutputTarget, ReadOptions};
use trisplat_scene::report::Report;
use trisplat_scene::{Asset, Error, ImportedScene, ImportedSplats, Result, Scene, Soup};

/// A scene at one step from soup to file.
#[derive(Debug)]
pub(super) struct Representation {
    /// "soft", "solid", "file" or "splats".
    pub name: &'static str,
    /// Number of triangles.
    pub triangles: u64,
    /// Size of the file, if one was written.
    pub bytes: Option<u64>,
    /// Draws it.
    pub renderer: SceneRenderer,
}

/// The steps of the scene of `path`. A mesh has one, solid; a soup has those of `options`, by
/// default all three.
pub(super) fn of_scene(
    path: &Path,
    loaded: ImportedScene,
    options: &RenderOptions,
    dataset: &Dataset,
    background: [f32; 3],
) -> Result<Vec<Representation>> {
    let ImportedScene { scene, provenance, cameras, .. } = loaded;
    let soft = |soup: Soup| Representation {
        name: "soft",
        triangles: soup.len() as u64,
        bytes: None,
        renderer: SceneRenderer::soft(soup, &provenance.placement, Some(dataset), background),
    };
    let solid = |name, asset: Asset, bytes| {
        let mesh = asset.mesh;
        let placement = asset.provenance.placement;
        let triangles = mesh.face_count() as u64;
        let renderer =
            SceneRenderer::solid(mesh, &placement, Some(dataset), background, options.ssaa);
        Representation { name, triangles, bytes, renderer }
    };
    let baked = |soup: Soup| {
        baked(ImportedScene {
            provenance: provenance.clone(),
            cameras: cameras.clone(),
            ..soup.into()
        })
    };
    match (scene, options.mode) {
        (Scene::Mesh(_), Some(RenderMode::Soft)) => Err(no_soup(path)),
        (Scene::Mesh(mesh), _) => {
            let provenance = provenance.clone();
            Ok(vec![solid("solid", Asset { mesh, provenance, ..Asset::default() }, None)])
        }
        (Scene::Soup(soup), Some(RenderMode::Soft)) => Ok(vec![soft(soup)]),
        (Scene::Soup(soup), Some(RenderMode::Solid)) => {
            Ok(vec![solid("solid", baked(soup)?, None)])
        }
        (Scene::Soup(soup), None) => {
            let asset = baked(soup.clone())?;
            let (file, bytes) = reread(&asset, &SMALLEST)?;
            Ok(vec![soft(soup), solid("solid", asset, None), solid("file", file, Some(bytes))])
        }
    }
}

/// The one step of Gaussians, which are drawn as their trainers draw them.
///
/// # Errors
///
/// A mode of drawing triangles.
pub(super) fn of_splats(
    loaded: ImportedSplats,
    options: &RenderOptions,
    dataset: &Dataset,
    background: [f32; 3],
) -> Result<Vec<Representation>> {
    check_splats(options)?;
    let placement = loaded.provenance.placement;
    let renderer = SceneRenderer::splats(loaded.splats, &placement, Some(dataset), background);
    Ok(vec![Representation { name: "splats", triangles: 0, bytes: None, renderer }])
}

/// Refuses modes that only triangles have.
pub(super) fn check_splats(options: &RenderOptions) -> Result<()> {
    match options.mode {
        Some(_) => {
            Err(Error::invalid("as", "given", "no value for Gaussians, which are drawn in one way"))
        }
        None => Ok(()),
    }
}

/// The error of a mesh where only a soup can be drawn.
pub(super) fn no_soup(path: &Path) -> Error {
    let reason = "is a mesh, baked already; give the trained soup it was baked from (.ply or .pt), or `as` solid";
    Error::unsupported(path, reason)
}

/// A soup baked with default options.
pub(super) fn baked(loaded: ImportedScene) -> Result<Asset> {
    bake(loaded, &BakeOptions::DEFAULT)
}

/// The smallest file we write: 16-bit positions, 8-bit colours, meshopt.
const SMALLEST: OutputOptions = OutputOptions { target: OutputTarget::Web, ..OutputOptions::SMALL };

/// The asset after it was written as GLB and read back; and the size of that file.
fn reread(asset: &Asset, options: &OutputOptions) -> Result<(Asset, u64)> {
    let folder = tempfile::tempdir().map_err(Error::temporary)?;
    let path = folder.path().join("scene.glb");
    let output = Output::plan(&path, None, options)?;
    let mut report = Report::default();
    output::write(asset, &output, output.start()?, options, &mut report, &mut |_| Continue(()))?;
    let ImportedScene { scene, provenance, .. } =
        formats::read(&path, &ReadOptions::with_degree(0))?;
    let Scene::Mesh(mesh) = scene else { return Err(no_soup(&path)) };
    let bytes = report.outputs.iter().map(|file| file.bytes).sum();
    Ok((Asset { mesh, provenance, ..Asset::default() }, bytes))
}
