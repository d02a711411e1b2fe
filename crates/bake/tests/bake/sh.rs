//! The stage `sh`: photos of shiny and of plain scenes, drawn from known harmonics.

use super::photos::{photograph, scene};
use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_bake::{Bake, BakeOptions, ShDegree, ShDetails, ShOptions, UpChoice, Views, sh};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_raster::solid::view_colors;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{FaceSh, ImportedScene, Provenance, Result, Scene, UpAxis};

/// The scene, each triangle brighter from a side of its own.
fn shiny() -> Mesh {
    let mut mesh = scene();
    let of_face = |face: usize| {
        (0..4).map(move |j| match j {
            0 => [0.0; 3],
            _ => [0.3 * ((face * 7 + j * 13) as f32).sin(); 3],
        })
    };
    let coefficients = (0..mesh.face_count()).flat_map(of_face).collect();
    mesh.sh = Some(FaceSh::new(1, coefficients).unwrap());
    mesh
}

fn plain(mesh: &Mesh) -> Mesh {
    Mesh { sh: None, ..mesh.clone() }
}

fn fitted(
    mesh: &mut Mesh,
    dataset: &Dataset,
    degree: ShDegree,
) -> Result<(Outcome<()>, ShDetails)> {
    let mut views = Views::new(dataset, &DatasetOptions::default());
    let mut details = ShDetails::default();
    let faces = mesh.face_count();
    let outcome = sh(
        mesh,
        faces,
        Some(&mut views),
        None,
        &ShOptions { sh: degree },
        &mut details,
        &mut StageProgress::new(&mut |_| Continue(())),
    )?;
    Ok((outcome, details))
}

#[test]
fn sh_auto_finds_the_harmonics_of_photos() {
    let truth = shiny();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let mut mesh = plain(&truth);
    let (outcome, details) = fitted(&mut mesh, &dataset, ShDegree::Auto).unwrap();
    assert_eq!(outcome, Outcome::Changed(()));
    assert!(details.psnr_sh > details.psnr_plain, "{details:?}");
    // The truth does not score perfectly either: photos are sampled more finely.
    let mut views = Views::new(&dataset, &DatasetOptions::default());
    let all: Vec<usize> = (0..views.len()).collect();
    let mut score = |mesh: &Mesh| views.mean_psnr(mesh, &all).unwrap();
    let [of_plain, found, best] = [&plain(&truth), &mesh, &truth].map(&mut score);
    assert!(found - of_plain > 0.7 * (best - of_plain), "{of_plain} {found} {best}");
    assert_eq!(mesh.colors, truth.colors, "plain viewers show the plain colours");
    assert!(view_colors(&mesh, Vec3::X * 3.0).is_some());
}

#[test]
fn sh_auto_without_shine_stays_plain() {
    let truth = scene();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let mut mesh = truth.clone();
    let (outcome, details) = fitted(&mut mesh, &dataset, ShDegree::Auto).unwrap();
    assert!(matches!(outcome, Outcome::Skipped(_)), "{details:?}");
    assert_eq!(mesh, truth);
}

#[test]
fn sh_of_shared_vertices_is_refused_by_name() {
    let (_folder, dataset) = photograph(&scene(), |_, photo| photo);
    let mut mesh = scene();
    mesh.indices = (0..mesh.vertex_count() as u32).collect();
    let refused = fitted(&mut mesh, &dataset, ShDegree::Two).unwrap_err().to_string();
    assert!(refused.contains("share vertices"), "{refused}");
    assert!(matches!(fitted(&mut mesh, &dataset, ShDegree::Auto), Ok((Outcome::Skipped(_), _))));
}

/// The frame of the file is another one than that of the photos, and so are the directions.
#[test]
fn sh_of_a_placed_scene_shows_the_photos() {
    let truth = shiny();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let score = |degree| {
        let mut options = BakeOptions::DEFAULT.clone();
        options.sh.sh = degree;
        options.place.up = UpChoice::Given(UpAxis::Z.into());
        options.place.scale = 2.5;
        let provenance = Provenance { up: Some(UpAxis::Z), ..Provenance::default() };
        let scene = Scene::Mesh(plain(&truth));
        let input = ImportedScene { scene, provenance, warnings: Vec::new(), cameras: Vec::new() };
        let mut views = Views::new(&dataset, &DatasetOptions::default());
        let asset = Bake::new(&options).photos(Some(&mut views)).run([input]).unwrap();
        views.transform(&asset.provenance.placement);
        let all: Vec<usize> = (0..views.len()).collect();
        views.mean_psnr(&asset.mesh, &all).unwrap()
    };
    let plain = score(ShDegree::Zero);
    let with = score(ShDegree::One);
    assert!(with > plain + 1.3, "{plain} {with}");
}
