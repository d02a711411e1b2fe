//! The stage `sh`: photos of shiny and of plain scenes, drawn from known harmonics.

use super::photos::{photograph, scene};
use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_bake::{Bake, BakeOptions, ShDegree, ShDetails, ShOptions, UpChoice, Views, sh};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_raster::solid::{direction_basis, view_colors};
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{FaceSh, ImportedScene, Provenance, Result, Scene, Soup, UpAxis};

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

/// The output of a trainer of opaque triangles: harmonics of degree 3, and nothing to fit.
#[test]
fn sh_of_a_solid_soup_without_photos_is_its_own() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let sh: Vec<[f32; 3]> = (0..16).map(|j| [0.1 * (j as f32).sin(), 0.05, -0.02]).collect();
    // Beyond what a plain colour holds.
    let sh: Vec<[f32; 3]> = [[-2.5, 0.3, 2.0]].into_iter().chain(sh.into_iter().skip(1)).collect();
    let soup = Soup {
        vertices: vec![corners],
        opacity: vec![1.0],
        sigma: vec![1e-3],
        sh: sh.clone(),
        sh_degree: 3,
        ..Soup::default()
    };
    let bake = |degree| {
        let mut options = BakeOptions::DEFAULT.clone();
        options.sh.sh = degree;
        Bake::new(&options).run([ImportedScene::from(soup.clone())]).unwrap()
    };
    assert!(bake(ShDegree::Zero).mesh.sh.is_none());
    let asset = bake(ShDegree::Two);
    assert_eq!(asset.mesh.sh.as_ref().map(FaceSh::degree), Some(2));
    let to_file = asset.provenance.placement.transform();
    let nearest = |corner: &Vec3| {
        let distance = |i: &usize| asset.mesh.positions[*i].distance(to_file(*corner));
        (0..3).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
    };
    for eye in [Vec3::new(3.0, -2.0, 5.0), Vec3::new(-1.0, 4.0, -2.0)] {
        let Some(Colors::Vertex(seen)) = view_colors(&asset.mesh, to_file(eye)) else { panic!() };
        for corner in corners {
            let basis = direction_basis(2, corner, eye);
            for c in 0..3 {
                let code = 0.5 + sh.iter().zip(&basis[..9]).map(|(own, y)| own[c] * y).sum::<f32>();
                let found = srgb_from_linear(seen[nearest(&corner)][c]);
                assert!((found - code.clamp(0.0, 1.0)).abs() < 2e-3, "{eye} {found} {code}");
            }
        }
    }
}
