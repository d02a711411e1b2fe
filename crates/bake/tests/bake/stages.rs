//! The stages by example: prune, solid, color, weld, order.

use super::chunks::chunked;
use super::hostile::{grid, mesh_of, random, random_triangle, soup_of};
use glam::Vec3;
use trisplat_bake::{
    Bake, BakeOptions, ColorDetails, FaceOrder, OrderDetails, OrderOptions, PruneDetails,
    PruneOptions, SolidDetails, SolidOptions, Solidify, WeldDetails, WeldOptions, WeldWhen, color,
    order, prune, solid, weld,
};
use trisplat_scene::{
    Scene, Soup,
    mesh::{Colors, Mesh},
    report::Outcome,
};

/// Prunes; returns what is left and the counts.
fn pruned(soup: Soup, options: &PruneOptions) -> (Soup, PruneDetails) {
    let mut scene = Scene::Soup(soup);
    let mut details = PruneDetails::default();
    prune(&mut scene, options, &mut details).unwrap();
    let Scene::Soup(soup) = scene else { panic!("prune turned a soup into a mesh") };
    (soup, details)
}

#[test]
fn prune_counts_by_cause() {
    let mut soup = random(100, 0.2);
    soup.vertices[3][1].z = f32::NAN;
    soup.sh[4][0] = f32::INFINITY;
    soup.vertices[5] = [Vec3::ONE; 3];
    soup.opacity[6] = 0.01;
    soup.opacity[7] = 0.013;
    soup.opacity[8] = 0.0;
    soup.sigma[9] = 50.0;
    soup.vertices[11] = [Vec3::X, Vec3::Y, Vec3::splat(2e15)];
    let options = PruneOptions { max_triangles: Some(80), ..PruneOptions::DEFAULT };
    let (left, details) = pruned(soup, &options);
    assert_eq!(left.len(), 80);
    let wants = PruneDetails {
        non_finite: 2,
        out_of_reach: 1,
        degenerate: 1,
        faint: 3,
        soft: 1,
        over_budget: 12,
    };
    assert_eq!(details, wants);
    let told = details.warning().unwrap();
    assert!(told.starts_with("dropped 1 triangle farther than 1e15"), "{told}");
}

#[test]
fn bake_of_any_scale_is_whole_or_refused_with_the_remedy() {
    for scale in [1e-30f32, 1e-15, 1e-3, 1.0, 1e6, 1e12, 1e14, 1e15, 1e16, 1e25, 1e37] {
        let mut mesh = mesh_of(&random(4000, 0.02));
        let most = mesh.positions.iter().map(|v| v.abs().max_element()).fold(0.0, f32::max);
        mesh.positions.iter_mut().for_each(|p| *p = *p / most * 2.0 * scale);
        match Bake::new(&BakeOptions::default()).run([mesh]) {
            Ok(asset) => {
                assert!(scale <= 1e14, "{scale} is refused");
                assert_eq!(asset.mesh.face_count(), 4000, "{scale}");
            }
            Err(error) => {
                let text = error.to_string();
                assert!(scale >= 1e15, "{scale}: {text}");
                assert!(text.contains("triangles farther than 1e15 from the origin"), "{text}");
                assert!(text.contains("multiply those of the file by 1e-"), "{text}");
                assert!(!text.contains("non_finite"), "{text}");
            }
        }
    }
}

#[test]
fn prune_keeps_the_largest_contributions_and_their_order() {
    let size = |i: usize| 1.0 + ((i * 37) % 100) as f32;
    let soup =
        soup_of((0..100).map(|i| ([Vec3::ZERO, Vec3::X, Vec3::Y].map(|v| v * size(i)), 0.5, 0.5)));
    let (left, _) =
        pruned(soup.clone(), &PruneOptions { max_triangles: Some(10), ..PruneOptions::DEFAULT });
    let kept: Vec<f32> = left.vertices.iter().map(|v| v[1].x).collect();
    let wants: Vec<f32> = (0..100).map(size).filter(|&s| s > 90.0).collect();
    assert_eq!(kept, wants);
    // A peak of 1 on a point-like window adds less than a peak of 0.5 on a solid one.
    let triangle = soup.vertices[0];
    let two = soup_of([(triangle, 1.0, 9.0), (triangle, 0.5, 0.01)]);
    let (left, _) = pruned(two, &PruneOptions { max_triangles: Some(1), ..PruneOptions::DEFAULT });
    assert_eq!(left.opacity, [0.5]);
    // Of equals the first stay.
    let equal = soup_of((0..9).map(|i| (triangle.map(|v| v + i as f32), 0.5, 0.5)));
    let (left, _) =
        pruned(equal, &PruneOptions { max_triangles: Some(4), ..PruneOptions::DEFAULT });
    assert_eq!(left.vertices.iter().map(|v| v[0].x).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0]);
}

#[test]
fn prune_of_a_soft_scene_keeps_most_of_it() {
    // As trained without hardening: σ around its start of 1.16, opacity around its start of 0.28.
    let soup = soup_of((0..1000).map(|i| {
        let spread = (i % 100) as f32 / 100.0;
        (random_triangle(i, Vec3::ZERO, 1.0), 0.02 + 0.9 * spread * spread, 0.5 + 2.0 * spread)
    }));
    let (left, _) = pruned(soup, &PruneOptions::DEFAULT);
    assert_eq!(left.len(), 1000);
}

#[test]
fn prune_says_which_option_left_nothing() {
    let cases = [
        (PruneOptions { min_opacity: 1.0, ..PruneOptions::DEFAULT }, "min_opacity is"),
        (PruneOptions { max_sigma: 1e-3, ..PruneOptions::DEFAULT }, "max_sigma is"),
        (PruneOptions { min_opacity: f64::NAN, ..PruneOptions::DEFAULT }, "min_opacity is"),
        (PruneOptions { max_sigma: -1.0, ..PruneOptions::DEFAULT }, "max_sigma is"),
        (PruneOptions { max_triangles: Some(0), ..PruneOptions::DEFAULT }, "max_triangles is"),
    ];
    for (options, names) in cases {
        let mut soup = random(20, 0.2);
        soup.opacity.fill(0.9);
        let error =
            prune(&mut Scene::Soup(soup), &options, &mut PruneDetails::default()).unwrap_err();
        assert!(error.to_string().starts_with(names), "{options:?}: {error}");
    }
}

#[test]
fn prune_drops_faces_and_their_vertices_from_a_mesh() {
    let mut mesh = grid(4);
    mesh.opacity = vec![1.0; 32];
    mesh.opacity[0] = 0.0;
    mesh.positions[24] = mesh.positions[23]; // makes the last two faces a line and a thinner triangle
    let before = mesh.clone();
    let mut scene = Scene::Mesh(mesh);
    prune(&mut scene, &PruneOptions::DEFAULT, &mut PruneDetails::default()).unwrap();
    let Scene::Mesh(after) = scene else { panic!("prune turned a mesh into a soup") };
    after.validate().unwrap();
    let keeps: Vec<usize> = (0..32).filter(|&f| before.opacity[f] > 0.0 && f != 31).collect();
    assert_eq!(after.face_count(), keeps.len());
    for (new, &old) in keeps.iter().enumerate() {
        assert_eq!(after.corners(new), before.corners(old));
        assert_eq!(after.corner_colors(new), before.corner_colors(old));
    }
    assert_eq!(after.vertex_count(), 23, "vertices 0 and 24 are used by no face any more");
}

#[test]
fn solid_keeps_solid_triangles_and_drops_none_by_default() {
    let corners = random_triangle(0, Vec3::ZERO, 1.0);
    let soup = soup_of([
        (corners, 1.0, 1e-5),
        (corners, 1.0, 0.01),
        (corners, 0.3, 1.16),
        (corners, 0.02, 9.0),
    ]);
    let area = |t: &[Vec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length();
    let run = |how| {
        let mut soup = soup.clone();
        let mut details = SolidDetails::default();
        solid(&mut soup, &SolidOptions { solid: how, ..SolidOptions::DEFAULT }, &mut details)
            .unwrap();
        assert!(soup.opacity.iter().all(|&o| o == 1.0));
        let shares: Vec<f32> = soup.vertices.iter().map(|t| area(t) / area(&corners)).collect();
        (shares, details)
    };
    let close = |got: &[f32], wants: &[f32]| {
        assert_eq!(got.len(), wants.len());
        assert!(
            got.iter().zip(wants).all(|(g, w)| (g - w).abs() < 1e-3),
            "{got:?}, expected {wants:?}"
        );
    };
    let mean = |o: f32, s: f32| o * 2.0 / ((s + 1.0) * (s + 2.0));
    close(&run(Solidify::Auto).0, &[1.0, 1.0, mean(0.3, 1.16), mean(0.02, 9.0)]);
    close(&run(Solidify::Area).0, &[1.0, mean(1.0, 0.01), mean(0.3, 1.16), mean(0.02, 9.0)]);
    close(&run(Solidify::None).0, &[1.0; 4]);
    let (shares, details) = run(Solidify::Contour);
    close(&shares, &[1.0, 1.0]);
    assert_eq!(details.no_contour, 2);
}

#[test]
fn solid_names_the_option_that_left_nothing() {
    let mut soup = soup_of([(random_triangle(0, Vec3::ZERO, 1.0), 0.4, 0.5)]);
    let options = SolidOptions { solid: Solidify::Contour, ..SolidOptions::DEFAULT };
    let error = solid(&mut soup, &options, &mut SolidDetails::default()).unwrap_err().to_string();
    assert!(error.starts_with("contour is 0.5") && error.contains("`solid` auto"), "{error}");
    for contour in [0.0, 1.0, f64::NAN] {
        let options = SolidOptions { contour, ..SolidOptions::DEFAULT };
        assert!(solid(&mut soup, &options, &mut SolidDetails::default()).is_err());
    }
}

#[test]
fn color_is_linear_and_clamped() {
    let mut soup = random(3, 0.1);
    soup.sh_degree = 1;
    let sh0 = |rgb: [f32; 3]| rgb.map(|c| (c - 0.5) / 0.282_094_79);
    let row = |rgb| [sh0(rgb), [9.0; 3], [9.0; 3], [9.0; 3]];
    soup.sh = [row([0.0, 0.5, 1.0]), row([-0.2, 1.7, 0.04]), row([0.25, 0.75, 0.9])].concat();
    let mut details = ColorDetails::default();
    let mesh = color(soup.clone(), &mut details).unwrap();
    let Colors::Face(colors) = &mesh.colors else { panic!("colours are not per face") };
    let wants =
        [[0.0, 0.214_041, 1.0], [0.0, 1.0, 0.003_095_98], [0.050_876, 0.522_522, 0.787_412]];
    for (got, wants) in colors.iter().zip(wants) {
        assert!((0..3).all(|c| (got[c] - wants[c]).abs() < 2e-6), "{got:?}, expected {wants:?}");
    }
    // The ends of the range may round to either side of it.
    assert!((2..=4).contains(&details.clamped_channels), "{details:?}");
    assert_eq!(mesh.positions, soup.vertices.concat());
}

#[test]
fn weld_shares_corners_only_where_it_pays() {
    let soup = random(500, 0.1);
    let mut mesh = mesh_of(&soup);
    let mut details = WeldDetails::default();
    assert!(matches!(
        weld(&mut mesh, &WeldOptions::DEFAULT, &mut details),
        Ok(Outcome::Skipped(_))
    ));
    assert!(mesh.indices.is_empty());

    let flat = grid(20);
    let corners: Vec<u32> = flat.indices.clone();
    let at = |v: &[Vec3]| corners.iter().map(|&i| v[i as usize]).collect::<Vec<_>>();
    let one_color = Colors::Face(vec![[0.25, 0.5, 0.75]; flat.face_count()]);
    let unshared = Mesh {
        positions: at(&flat.positions),
        colors: one_color,
        indices: Vec::new(),
        opacity: Vec::new(),
        ..Mesh::default()
    };
    let mut welded = unshared.clone();
    weld(&mut welded, &WeldOptions::DEFAULT, &mut WeldDetails::default()).unwrap();
    welded.validate().unwrap();
    assert_eq!(welded.vertex_count(), 21 * 21);
    for face in 0..unshared.face_count() {
        assert_eq!(welded.corners(face), unshared.corners(face));
        assert_eq!(welded.corner_colors(face), unshared.corner_colors(face));
    }
}

#[test]
fn weld_estimates_large_scenes_from_a_sample() {
    let mut mesh = mesh_of(&random(60_000, 0.01));
    let mut details = WeldDetails::default();
    weld(&mut mesh, &WeldOptions::DEFAULT, &mut details).unwrap();
    assert_eq!(details.unique_corners, Some(1.0));
    // Every corner three times: a third is unique.
    let mut positions = mesh.positions.clone();
    positions.extend_from_slice(&mesh.positions);
    positions.extend_from_slice(&mesh.positions);
    let Colors::Face(colors) = &mesh.colors else { panic!("colours are not per face") };
    let mut tripled = Mesh { colors: Colors::Face(colors.repeat(3)), positions, ..Mesh::default() };
    weld(&mut tripled, &WeldOptions::DEFAULT, &mut details).unwrap();
    let share = details.unique_corners.unwrap();
    assert!((share - 1.0 / 3.0).abs() < 1e-12, "equal corners are sampled together: {share}");
    assert_eq!(tripled.vertex_count(), mesh.vertex_count());
}

#[test]
fn weld_unshares_face_colours_of_connected_meshes() {
    for when in [WeldWhen::Auto, WeldWhen::On, WeldWhen::Off] {
        let mut mesh = grid(5);
        mesh.colors = Colors::Face((0..mesh.face_count()).map(|f| [f as f32 / 50.0; 3]).collect());
        let before = mesh.clone();
        weld(&mut mesh, &WeldOptions { weld: when }, &mut WeldDetails::default()).unwrap();
        mesh.validate().unwrap();
        assert!(mesh.indices.is_empty() || matches!(mesh.colors, Colors::Vertex(_)));
        for face in 0..before.face_count() {
            assert_eq!(mesh.corners(face), before.corners(face));
            assert_eq!(mesh.corner_colors(face), before.corner_colors(face));
        }
    }
    let mut mesh = grid(5);
    let before = mesh.clone();
    let outcome = weld(&mut mesh, &WeldOptions { weld: WeldWhen::On }, &mut WeldDetails::default());
    assert!(matches!(outcome, Ok(Outcome::Skipped(_))) && mesh == before);
}

#[test]
fn order_brings_near_faces_together() {
    let mut asset = chunked(mesh_of(&random(4000, 0.01)), 1500);
    let step = |mesh: &Mesh| {
        let hop = |f: usize| mesh.corners(f)[0].distance(mesh.corners(f + 1)[0]);
        (0..mesh.face_count() - 1).map(hop).sum::<f32>() / mesh.face_count() as f32
    };
    let before = asset.mesh.clone();
    let chunks = asset.chunks.clone();
    let options = OrderOptions { order: FaceOrder::Spatial };
    order(&mut asset, &options, &mut OrderDetails::default()).unwrap();
    assert_eq!(asset.chunks, chunks);
    assert!(
        step(&asset.mesh) < 0.25 * step(&before),
        "{} was {}",
        step(&asset.mesh),
        step(&before)
    );
    for chunk in chunks {
        let sorted = |mesh: &Mesh| {
            let faces = chunk.first as usize..(chunk.first + chunk.count) as usize;
            let mut bits: Vec<_> = faces
                .map(|f| {
                    (
                        mesh.corners(f).map(|v| v.to_array().map(f32::to_bits)),
                        mesh.corner_colors(f)[0].map(f32::to_bits),
                    )
                })
                .collect();
            bits.sort_unstable();
            bits
        };
        assert_eq!(sorted(&asset.mesh), sorted(&before), "a chunk has other faces than before");
    }
}
