//! Every stage with every preset on every hostile soup: nothing panics, nothing non-finite comes
//! out, every result is valid, and a second run has nothing to do. The stages that need cameras are
//! in `photos.rs`.

use super::hostile;
use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    ChunkOptions, ColorDetails, Evidence, FaceOrder, FinishedLevel, LevelSource, LodOptions,
    OrderOptions, PlaceOptions, PruneDetails, PruneOptions, SolidOptions, Solidify, TilesOptions,
    WeldOptions, WeldWhen, chunk, color, lod, order, place, placement, prune, solid, tiles, weld,
};
use trisplat_scene::{
    Asset, Error, Provenance, Result, Scene, Soup,
    mesh::Mesh,
    report::{Outcome, StageDetails, StageProgress},
};

#[derive(Clone)]
struct Preset {
    name: &'static str,
    prune: PruneOptions,
    solid: SolidOptions,
    weld: WeldOptions,
    chunk: ChunkOptions,
    order: OrderOptions,
}

fn presets() -> Vec<Preset> {
    let default = Preset {
        name: "default",
        prune: PruneOptions::DEFAULT,
        solid: SolidOptions::DEFAULT,
        weld: WeldOptions::DEFAULT,
        chunk: ChunkOptions::DEFAULT,
        order: OrderOptions::DEFAULT,
    };
    let with = |solid, order| Preset {
        name: "everything on",
        prune: PruneOptions { max_triangles: Some(200), ..PruneOptions::DEFAULT },
        solid: SolidOptions { solid, ..SolidOptions::DEFAULT },
        weld: WeldOptions { weld: WeldWhen::On },
        chunk: ChunkOptions { chunk_triangles: 7 },
        order: OrderOptions { order },
    };
    vec![
        Preset {
            name: "fast",
            prune: PruneOptions::DEFAULT,
            weld: WeldOptions::FAST,
            chunk: ChunkOptions::FAST,
            order: OrderOptions::FAST,
            ..default.clone()
        },
        Preset { name: "small", prune: PruneOptions::SMALL, ..default.clone() },
        Preset { name: "contour", ..with(Solidify::Contour, FaceOrder::None) },
        Preset { name: "area, small chunks, curve", ..with(Solidify::Area, FaceOrder::Spatial) },
        Preset {
            name: "one chunk",
            chunk: ChunkOptions::FAST,
            ..with(Solidify::None, FaceOrder::Spatial)
        },
        Preset {
            name: "keep all",
            prune: PruneOptions { min_opacity: 0.0, max_sigma: 0.0, ..PruneOptions::DEFAULT },
            ..default.clone()
        },
        default,
    ]
}

/// Runs a stage twice; the second run must have nothing to do.
fn twice<T, D: StageDetails>(
    mut run: impl FnMut(&mut T, &mut D) -> Result<Outcome<()>>,
    value: &mut T,
    what: &str,
) -> Result<()> {
    run(value, &mut D::default())?;
    match run(value, &mut D::default())? {
        Outcome::Skipped(_) => Ok(()),
        Outcome::Changed(()) => panic!("{what}: the second run changed something"),
    }
}

/// Two levels of a mesh, as they are before the stages that finish them.
fn levels(mesh: &Mesh, what: &str) -> Result<Vec<Asset>> {
    let source = LevelSource { mesh, cameras: &[], enlarge: true, is_soup: false };
    let options = LodOptions { lod: vec![0.5, 0.1] };
    let unfinished = |mesh, _: StageProgress<'_>| {
        Ok(FinishedLevel { asset: Asset { mesh, ..Asset::default() }, psnr: None })
    };
    let mut levels = Vec::new();
    let run = |levels: &mut Vec<Asset>, details: &mut _| {
        lod(
            levels,
            &source,
            &options,
            unfinished,
            details,
            &mut StageProgress::new(&mut |_| Continue(())),
        )
    };
    twice(run, &mut levels, what)?;
    Ok(levels)
}

/// Cuts an asset with these levels into tiles, which together hold as many triangles.
fn cut(mut asset: Asset, levels: Vec<Asset>, what: &str) -> Result<()> {
    asset.levels = levels;
    let options = TilesOptions { tiles: true, ..TilesOptions::DEFAULT };
    twice(|a, d| tiles(a, &options, d), &mut asset, &format!("{what}, tiles"))?;
    let mut finest = 0;
    asset.tiles.iter().for_each(|root| {
        root.visit(&mut |tile| {
            tile.mesh.validate().unwrap_or_else(|e| panic!("{what}, tiles: {e}"));
            finest += if tile.children.is_empty() { tile.mesh.face_count() } else { 0 };
        });
    });
    assert_eq!(finest, asset.mesh.face_count(), "{what}, tiles");
    Ok(())
}

/// The stages after pruning; an error only where a stage may drop everything.
fn bake(mut soup: Soup, preset: &Preset, what: &str) -> Result<Asset> {
    twice(|s, d| solid(s, &preset.solid, d), &mut soup, &format!("{what}, solid"))?;
    soup.validate().unwrap_or_else(|e| panic!("{what}, solid: {e}"));
    let mut mesh = color(soup, &mut ColorDetails::default())?;
    mesh.validate().unwrap_or_else(|e| panic!("{what}, color: {e}"));
    let levels = levels(&mesh, &format!("{what}, lod"))?;
    levels.iter().for_each(|l| l.mesh.validate().unwrap_or_else(|e| panic!("{what}, lod: {e}")));
    twice(|m, d| weld(m, &preset.weld, d), &mut mesh, &format!("{what}, weld"))?;
    mesh.validate().unwrap_or_else(|e| panic!("{what}, weld: {e}"));
    let mut provenance = Provenance::default();
    let turn_up = |mesh: &mut Mesh, details: &mut _| {
        let how =
            placement(mesh, &provenance, Evidence::default(), &PlaceOptions::DEFAULT, details);
        place(mesh, &mut provenance, how, details)
    };
    twice(turn_up, &mut mesh, &format!("{what}, place"))?;
    let mut asset = Asset { mesh, provenance, ..Asset::default() };
    twice(
        |a, d| chunk(a, &preset.chunk, preset.order.order, d),
        &mut asset,
        &format!("{what}, chunk"),
    )?;
    twice(|a, d| order(a, &preset.order, d), &mut asset, &format!("{what}, order"))?;
    asset.mesh.validate().unwrap_or_else(|e| panic!("{what}, order: {e}"));
    cut(asset.clone(), levels, what)?;
    Ok(asset)
}

#[test]
fn every_stage_survives_every_soup_with_every_preset() {
    for preset in presets() {
        for (name, soup) in hostile::finite().into_iter().chain(hostile::poison()) {
            let what = format!("{name}, preset {}", preset.name);
            let mut scene = Scene::Soup(soup);
            match twice(|s, d| prune(s, &preset.prune, d), &mut scene, &what) {
                Err(Error::Invalid { .. } | Error::InvalidData(_)) => continue,
                pruned => pruned.unwrap_or_else(|e| panic!("{what}: {e}")),
            }
            let Scene::Soup(soup) = scene else {
                panic!("{what}: prune turned a soup into a mesh")
            };
            soup.validate().unwrap_or_else(|e| panic!("{what}, prune: {e}"));
            match bake(soup, &preset, &what) {
                Ok(_) | Err(Error::Invalid { .. } | Error::InvalidData(_)) => {}
                Err(e) => panic!("{what}: {e}"),
            }
        }
    }
}

/// Stages do not rely on the prune stage: what is finite stays finite, and nothing panics.
#[test]
fn every_stage_survives_soups_that_were_not_pruned() {
    for preset in presets() {
        for (name, soup) in hostile::finite() {
            let what = format!("{name}, not pruned, preset {}", preset.name);
            match bake(soup, &preset, &what) {
                Ok(_) | Err(Error::Invalid { .. } | Error::InvalidData(_)) => {}
                Err(e) => panic!("{what}: {e}"),
            }
        }
    }
}

/// Only soups that hold nothing drawable are refused by default.
#[test]
fn the_default_preset_bakes_whatever_can_be_drawn() {
    for (name, soup) in hostile::finite().into_iter().chain(hostile::poison()) {
        let outcome =
            prune(&mut Scene::Soup(soup), &PruneOptions::DEFAULT, &mut PruneDetails::default());
        let refused =
            ["empty", "all points", "all lines", "1e38", "invisible", "softest"].contains(&name);
        assert_eq!(outcome.is_err(), refused, "{name}: {outcome:?}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let soup = trisplat_synthetic::soups::studio(40_000, 3);
    for mut preset in presets() {
        preset.prune.max_triangles = preset.prune.max_triangles.map(|_| 20_000);
        preset.chunk.chunk_triangles = preset.chunk.chunk_triangles.min(1000);
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut scene = Scene::Soup(soup.clone());
                prune(&mut scene, &preset.prune, &mut PruneDetails::default()).unwrap();
                let Scene::Soup(soup) = scene else { panic!("prune turned a soup into a mesh") };
                bake(soup, &preset, preset.name).unwrap()
            })
        };
        let one = with_threads(1);
        let two = with_threads(2);
        let seven = with_threads(7);
        for other in [two, seven] {
            assert!(one.mesh == other.mesh, "preset {}: meshes differ", preset.name);
            assert!(one.chunks == other.chunks, "preset {}: chunks differ", preset.name);
        }
    }
}
