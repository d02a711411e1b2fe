//! The bake: a short recipe of stages from a scene to an asset.
//!
//! ```text
//! prune → solid → color → unseen → backdrop → refit → weld → place → chunk → bvh → order → lod
//! ```
//!
//! Each stage is a file; it does its work or says why none was needed, and running it twice changes
//! nothing the second time.

pub mod backdrop;
pub mod bvh;
pub mod chunk;
pub mod color;
pub mod lod;
pub mod merge;
pub mod options;
pub mod order;
pub mod place;
pub mod prune;
pub mod refit;
pub mod solid;
pub mod thin;
pub mod unseen;
pub mod views;
pub mod weld;

use crate::asset::{Asset, Placement, Provenance};
use crate::error::Result;
use crate::mesh::Mesh;
use crate::report::{Counts, Observer, Outcome, Report};
use crate::scene::{Loaded, Scene};
use options::BakeOptions;
use prune::PruneOptions;
use views::Views;

/// Figures of one stage, for the report.
pub type Details = serde_json::Map<String, serde_json::Value>;

/// Turns what was read into what an engine draws; every step is told to `report` and `observer`. `views`
/// are photos of the scene, if there are any; without them the cameras that came with it, if any, tell what is
/// seen.
///
/// Errors: options out of range, inputs that do not merge, nothing left to draw, photos that cannot be read
/// or do not show the scene.
pub fn bake(
    inputs: Vec<Loaded>,
    options: &BakeOptions,
    mut views: Option<&mut Views>,
    report: &mut Report,
    observer: &mut dyn Observer,
) -> Result<Asset> {
    options.validate()?;
    let Loaded { scene, mut provenance, warnings, mut cameras } = merge::merge(inputs)?;
    report.warnings.extend(warnings);
    if let Some(views) = views.as_deref_mut() {
        views.enter(&provenance.placement);
        provenance.viewpoint = provenance.viewpoint.or_else(|| views.viewpoint());
        cameras = views.cameras().to_vec();
    }
    // What cameras see tells better which triangles matter most than their size does.
    let budget = match &views {
        Some(_) => options.backdrop.scene_budget(options.prune.max_triangles),
        None => options.prune.max_triangles,
    };
    let pruning = match cameras.is_empty() {
        true => options.prune.clone(),
        false => PruneOptions { max_triangles: None, ..options.prune.clone() },
    };

    // First, because every later stage costs per triangle and counts on finite geometry.
    let scene = report
        .stage(observer, "prune", scene, count, |scene, details| prune::prune(scene, &pruning, details))?;

    // On the soup, as it needs opacity and σ, which colours throw away.
    let scene = report.stage(observer, "solid", scene, count, |scene, details| match scene {
        Scene::Soup(soup) => solid::solid(soup, &options.solid, details),
        Scene::Mesh(_) => Ok(Outcome::Unneeded("the input is a mesh: its triangles are solid")),
    })?;

    // From here on an ordinary mesh in linear light.
    let scene = report.stage(observer, "color", scene, count, |scene, details| {
        let Scene::Soup(soup) = scene else {
            return Ok(Outcome::Unneeded("the input is a mesh: it has colours"));
        };
        *scene = Scene::Mesh(color::color(std::mem::take(soup), details)?);
        Ok(Outcome::Changed(()))
    })?;
    let mesh = match scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => unreachable!("the color stage makes a mesh of every soup"),
    };

    // As soon as there are opaque triangles that hide each other, and before work is done on those hidden.
    let mesh = report.stage(observer, "unseen", mesh, count_mesh, |mesh, details| {
        unseen::unseen(mesh, &cameras, views.as_deref_mut(), &options.unseen, budget, details)
    })?;

    // Levels are made of what is left here, but stand where the scene will stand.
    let rough = if options.lod.lod.is_empty() { Mesh::default() } else { mesh.clone() };
    let mesh = paint(mesh, views.as_deref_mut(), options, report, observer)?;
    let mut step = None;
    let asset = package(mesh, provenance.clone(), &mut step, options, report, observer)?;
    let levels = report.stage(
        observer,
        "lod",
        Vec::new(),
        |levels: &Vec<Asset>| count_levels(levels),
        |levels, details| lod::lod(levels, &rough, &cameras, views, (&provenance, step), options, details),
    )?;
    Ok(Asset { levels, ..asset })
}

/// The part of the recipe that looks at photos.
fn paint(
    mesh: Mesh,
    mut views: Option<&mut Views>,
    options: &BakeOptions,
    report: &mut Report,
    observer: &mut dyn Observer,
) -> Result<Mesh> {
    // Behind what is left, and before colours are taken from the photos: those of holes are its own.
    let mesh = report.stage(observer, "backdrop", mesh, count_mesh, |mesh, details| {
        backdrop::backdrop(mesh, views.as_deref_mut(), &options.backdrop, details)
    })?;

    // On what is left: a colour belongs to what a triangle shows when the others are gone.
    report.stage(observer, "refit", mesh, count_mesh, |mesh, details| {
        refit::refit(mesh, views, &options.refit, details)
    })
}

/// The part of the recipe that makes a file of a mesh, which is moved by `step`, or as the options say.
fn package(
    mesh: Mesh,
    mut provenance: Provenance,
    step: &mut Option<Placement>,
    options: &BakeOptions,
    report: &mut Report,
    observer: &mut dyn Observer,
) -> Result<Asset> {
    // Before placing, while equal corners are still equal to the bit.
    let mesh = report.stage(observer, "weld", mesh, count_mesh, |mesh, details| {
        weld::weld(mesh, &options.weld, details)
    })?;

    // Before anything with boxes in it, whose numbers must be those of the file.
    let mesh = report.stage(observer, "place", mesh, count_mesh, |mesh, details| {
        let step = *step.get_or_insert_with(|| place::step(mesh, &provenance, &options.place));
        place::move_by(mesh, &mut provenance, step, details)
    })?;

    provenance.generator = Some(crate::report::generator());
    let asset = Asset { mesh, provenance, ..Asset::default() };

    // Cuts first: a hierarchy and an order are only useful inside the runs that an engine skips.
    let asset = report.stage(observer, "chunk", asset, Asset::counts, |asset, details| {
        chunk::chunk(asset, &options.chunk, details)
    })?;
    let asset = report.stage(observer, "bvh", asset, Asset::counts, |asset, details| {
        bvh::bvh(asset, &options.bvh, details)
    })?;
    // Last: it leaves the leaf order of a hierarchy alone.
    let asset = report.stage(observer, "order", asset, Asset::counts, |asset, details| {
        order::order(asset, &options.order, details)
    })?;
    debug_assert!(asset.mesh.validate().is_ok(), "{:?}", asset.mesh.validate());
    Ok(asset)
}

fn count(scene: &Scene) -> Counts {
    match scene {
        Scene::Soup(soup) => Counts { triangles: soup.len() as u64, vertices: 3 * soup.len() as u64 },
        Scene::Mesh(mesh) => count_mesh(mesh),
    }
}

fn count_levels(levels: &[Asset]) -> Counts {
    let counts = levels.iter().map(Asset::counts);
    counts.fold(Counts::default(), |a, b| Counts {
        triangles: a.triangles + b.triangles,
        vertices: a.vertices + b.vertices,
    })
}

fn count_mesh(mesh: &Mesh) -> Counts {
    Counts { triangles: mesh.face_count() as u64, vertices: mesh.vertex_count() as u64 }
}
