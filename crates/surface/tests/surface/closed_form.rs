//! Surfaces of shapes that are known exactly.

use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_fixtures::shapes::{RADIUS, around, ball, camera, coarse_ball, cube, two_colors};
use trisplat_scene::{
    ImportedScene, Limits, Scene,
    camera::Camera,
    math::geometry::centroid,
    mesh::{Colors, Mesh},
    report::{StageEvent, StageProgress},
};
use trisplat_surface::{SurfaceDetails, SurfaceOptions, surface};

/// The surface that `cameras` see of `scene`.
pub(crate) fn made(
    scene: &ImportedScene,
    cameras: &[Camera],
    options: &SurfaceOptions,
) -> (Option<Mesh>, SurfaceDetails) {
    let mut details = SurfaceDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let mut progress = StageProgress::new(&mut nobody);
    let mesh =
        surface(scene, cameras, options, &Limits::DEFAULT, &mut details, &mut progress).unwrap();
    (mesh, details)
}

/// Distance from the cube's surface.
fn from_cube(p: Vec3) -> f32 {
    let out = (p.abs() - RADIUS).max(Vec3::ZERO).length();
    if out > 0.0 { out } else { RADIUS - p.abs().max_element() }
}

/// Unit normal of a face.
fn normal(mesh: &Mesh, face: usize) -> Vec3 {
    let [a, b, c] = mesh.corners(face);
    (b - a).cross(c - a).normalize_or_zero()
}

const OPTIONS: SurfaceOptions = SurfaceOptions { resolution: Some(64), ..SurfaceOptions::DEFAULT };

#[test]
fn a_ball_is_round_to_half_a_voxel() {
    let (mesh, details) = made(&ball(Vec3::ZERO).into(), &around(24, 4.0, 240), &OPTIONS);
    let mesh = mesh.unwrap();
    let voxel = details.voxel as f32;
    let off = |p: &Vec3| (p.length() - RADIUS).abs();
    let worst = mesh.positions.iter().map(off).fold(0.0, f32::max);
    let mean = mesh.positions.iter().map(off).sum::<f32>() / mesh.vertex_count() as f32;
    println!("ball: worst {:.3}, mean {:.4} voxels of {voxel}", worst / voxel, mean / voxel);
    assert!(worst < 0.5 * voxel && mean < 0.1 * voxel, "{worst} {mean}");
    assert!(
        (0..mesh.face_count()).all(|f| normal(&mesh, f).dot(mesh.centroid(f)) > 0.0),
        "fronts outside"
    );
    // Closed: every edge has two faces. Nothing else came out.
    assert_eq!(2 * (mesh.vertex_count() - 2), mesh.face_count(), "Euler's formula for a ball");
    assert_eq!((details.components, details.small, details.pictures), (1, 0, 24));
    let Colors::Vertex(colors) = &mesh.colors else { panic!("a colour per vertex") };
    // Samples up to the truncation, 4 cells, before the surface are coloured by what lies behind
    // them.
    for (position, color) in
        mesh.positions.iter().zip(colors).filter(|(p, _)| p.x.abs() > 5.0 * voxel)
    {
        let wants = two_colors(*position);
        assert!((0..3).all(|i| (color[i] - wants[i]).abs() < 0.02), "{color:?} at {position}");
    }
}

/// Trained triangles hardly touch: rays pass between them.
#[test]
fn a_ball_of_triangles_with_cracks_between_them_is_closed() {
    let mut mesh = coarse_ball(Vec3::ZERO, 12);
    for corners in mesh.positions.chunks_exact_mut(3) {
        let middle = centroid([corners[0], corners[1], corners[2]]);
        corners.iter_mut().for_each(|corner| *corner = middle + 0.85 * (*corner - middle));
    }
    let (surface, details) = made(&mesh.into(), &around(24, 4.0, 240), &OPTIONS);
    let surface = surface.unwrap();
    let voxel = details.voxel as f32;
    let worst = surface.positions.iter().map(|p| (p.length() - RADIUS).abs()).fold(0.0, f32::max);
    println!("ball with cracks: worst {:.3} voxels", worst / voxel);
    assert!(worst < 0.5 * voxel, "{worst} of {voxel}");
    assert_eq!(
        2 * (surface.vertex_count() - 2),
        surface.face_count(),
        "Euler's formula for a ball"
    );
}

#[test]
fn a_cube_is_flat_to_half_a_voxel() {
    // Surface nets cut edges and corners off, by less than a voxel.
    let (mesh, details) = made(&cube().into(), &around(40, 4.5, 240), &OPTIONS);
    let mesh = mesh.unwrap();
    let voxel = details.voxel as f32;
    let flat =
        |p: &&Vec3| p.abs().cmpgt(Vec3::splat(RADIUS - 2.0 * voxel)).bitmask().count_ones() == 1;
    let worst =
        |of: &mut dyn Iterator<Item = &Vec3>| of.map(|p| from_cube(*p)).fold(0.0, f32::max) / voxel;
    let sides = worst(&mut mesh.positions.iter().filter(flat));
    let all = worst(&mut mesh.positions.iter());
    println!("cube: sides {sides:.3}, edges and corners {all:.3} voxels of {voxel}");
    assert!(sides < 0.5 && all < 1.0, "{sides} {all}");
    let whole = mesh.positions.iter().map(|p| p.abs()).fold(Vec3::ZERO, Vec3::max);
    assert!((whole - RADIUS).abs().max_element() < 0.5 * voxel, "{whole}");
}

#[test]
fn nothing_is_made_up_where_nobody_looked() {
    // Three cameras on one side: an open cap, nothing behind.
    let eyes = [Vec3::new(0.0, 0.0, -4.0), Vec3::new(1.0, 0.3, -3.8), Vec3::new(-1.0, -0.3, -3.8)];
    let cameras = eyes.map(|eye| camera(eye, 160));
    let (mesh, details) = made(&ball(Vec3::ZERO).into(), &cameras, &OPTIONS);
    let mesh = mesh.unwrap();
    let voxel = details.voxel as f32;
    assert!(mesh.positions.iter().all(|p| (p.length() - RADIUS).abs() < voxel && p.z < 0.1));
    let front = mesh.positions.iter().filter(|p| p.z < -0.9).count();
    assert!(front > 100 && mesh.face_count() < 2 * mesh.vertex_count() - 4, "{front}: it is open");
}

#[test]
fn a_budget_is_met_and_keeps_the_shape() {
    let options = SurfaceOptions { max_triangles: Some(500), ..OPTIONS };
    let (mesh, details) = made(&ball(Vec3::ZERO).into(), &around(24, 4.0, 160), &options);
    let mesh = mesh.unwrap();
    assert!(mesh.face_count() <= 500 && mesh.face_count() > 400, "{}", mesh.face_count());
    let worst = mesh.positions.iter().map(|p| (p.length() - RADIUS).abs()).fold(0.0, f32::max);
    assert!(
        worst < 0.02 && details.simplification_error.is_some_and(|e| e < 0.05),
        "{worst} {details:?}"
    );
    mesh.validate().unwrap();
}

#[test]
fn small_pieces_go() {
    let mut scene = ball(Vec3::ZERO);
    let mut speck = ball(Vec3::ZERO);
    speck.positions.iter_mut().for_each(|p| *p = Vec3::splat(0.85) + *p * 0.16);
    scene.append(speck).unwrap();
    let cameras = around(24, 5.0, 160);
    let all = SurfaceOptions { min_component: 0, ..OPTIONS };
    let (_, details) = made(&scene.clone().into(), &cameras, &all);
    assert_eq!((details.components, details.small), (2, 0));
    let options = SurfaceOptions { min_component: 2000, ..OPTIONS };
    let (mesh, details) = made(&scene.into(), &cameras, &options);
    assert!(details.components == 1 && details.small > 0, "{details:?}");
    assert!(mesh.unwrap().positions.iter().all(|p| p.length() < 1.1));
}

#[test]
fn a_soup_has_the_surface_of_its_triangles_without_its_shell() {
    // Triangles of some pixels: smaller ones fade.
    let mesh = Scene::Mesh(coarse_ball(Vec3::ZERO, 14));
    let mut soup = mesh.to_soup();
    soup.opacity.fill(1.0);
    soup.sigma.fill(0.01);
    // Their windows end at their edges: they overlap a little, as trained ones do, so that nothing
    // shows between them.
    for corners in &mut soup.vertices {
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        *corners = corners.map(|corner| middle + (corner - middle) * 1.2);
    }
    // A shell around everything else: without it the ball is seen, with it only the shell.
    let mut shell = soup.clone();
    shell.vertices.iter_mut().flatten().for_each(|p| *p *= 1.5);
    shell.set_shell(0..shell.len());
    soup.append(shell);
    let loaded = ImportedScene::from(soup);
    for (with_shell, radius) in [(false, RADIUS), (true, 1.5 * RADIUS)] {
        let options = SurfaceOptions { shell: with_shell, ..OPTIONS };
        let (mesh, details) = made(&loaded, &around(24, 5.0, 240), &options);
        let voxel = details.voxel as f32;
        let worst =
            mesh.unwrap().positions.iter().map(|p| (p.length() - radius).abs()).fold(0.0, f32::max);
        println!("soup of radius {radius}: worst {:.3} voxels", worst / voxel);
        assert!(worst < 0.5 * voxel, "{worst} of {voxel}");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let scene: ImportedScene = cube().into();
    let cameras = around(12, 5.0, 96);
    let options = SurfaceOptions { max_triangles: Some(3000), ..OPTIONS };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| made(&scene, &cameras, &options))
    };
    let one = with(1);
    assert!(one.0.is_some());
    for threads in [2, 3, 8] {
        assert!(with(threads) == one, "{threads} threads");
    }
}

#[test]
fn hostile_scenes_make_no_surface_and_no_panic() {
    let nothing = ImportedScene::from(Mesh::default());
    assert_eq!(made(&nothing, &around(4, 3.0, 32), &OPTIONS).0, None);
    assert_eq!(made(&nothing, &[], &OPTIONS).0, None);
    let away = around(4, 3.0, 32)
        .into_iter()
        .map(|c| c.with_look_at(c.position(), c.position() * 2.0, Vec3::Y));
    assert_eq!(made(&ball(Vec3::ZERO).into(), &away.collect::<Vec<_>>(), &OPTIONS).0, None);
    let mut broken = ball(Vec3::ZERO);
    broken.positions.iter_mut().step_by(7).for_each(|p| p.y = f32::MAX);
    made(&broken.into(), &around(6, 3.0, 48), &OPTIONS);
}

#[test]
fn what_does_not_fit_is_an_error() {
    let mut details = SurfaceDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let mut tried = |options: SurfaceOptions, limits: Limits| {
        let scene = ball(Vec3::ZERO).into();
        let mut progress = StageProgress::new(&mut nobody);
        surface(&scene, &around(4, 4.0, 64), &options, &limits, &mut details, &mut progress)
    };
    let small = Limits { array_bytes: 10_000, ..Limits::DEFAULT };
    let message = tried(OPTIONS, small).unwrap_err().to_string();
    assert!(
        message.contains("the distance field") && message.contains("array_bytes="),
        "{message}"
    );
    for (options, field) in [
        (SurfaceOptions { voxel: Some(1e-9), ..OPTIONS }, "voxel"),
        (SurfaceOptions { voxel: Some(f64::NAN), ..OPTIONS }, "voxel"),
        (SurfaceOptions { resolution: Some(3), ..OPTIONS }, "resolution"),
        (SurfaceOptions { truncation: 0.5, ..OPTIONS }, "truncation"),
        (SurfaceOptions { min_views: 0, ..OPTIONS }, "min_views"),
    ] {
        let message = tried(options, Limits::DEFAULT).unwrap_err().to_string();
        assert!(message.starts_with(field), "{message}");
    }
}
