//! `--crop subject`: what is kept of a thing on a table, and how large a viewer shows it that
//! frames the whole file.

use glam::{Mat3, UVec2, Vec2, Vec3};
use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow::Continue;
use trisplat_bake::{
    Bake, BakeOptions, BakePreset, CropDetails, MeshOptions, TextureOptions, TextureWhen, Views,
    mesh,
};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    ImportedScene, Limits, Scene,
    camera::Camera,
    image::RgbImage,
    math::geometry::octasphere,
    mesh::{Colors, Mesh},
    report::{Report, StageEvent},
};
use trisplat_surface::SurfaceDetails;

/// Colours of the ball, the table, and all else.
const BALL: f32 = 0.9;
const TABLE: f32 = 0.5;
const ELSE: f32 = 0.1;

fn part(positions: Vec<Vec3>, grey: f32) -> Mesh {
    let colors = Colors::Face(vec![[grey; 3]; positions.len() / 3]);
    Mesh { positions, colors, ..Mesh::default() }
}

/// A square of cells of 0.15 with corners at `from`, `from + u` and `from + v`.
fn square(from: Vec3, u: Vec3, v: Vec3, cells: usize) -> Vec<Vec3> {
    let at = |i: usize, k: usize| from + (u * i as f32 + v * k as f32) / cells as f32;
    let cell = |n: usize| {
        let i = n % cells;
        let k = n / cells;
        [at(i, k), at(i + 1, k), at(i, k + 1), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
    };
    (0..cells * cells).flat_map(cell).collect()
}

/// A ball of radius 0.5 on a table of side 6, before a wall, with crumbs in the air.
fn studio() -> Mesh {
    let (corners, faces) = octasphere(3);
    let ball = faces.iter().flat_map(|f| f.map(|i| 0.5 * corners[i as usize] + Vec3::Y * 0.5));
    let mut all = part(ball.collect(), BALL);
    let table = square(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, 40);
    all.append(part(table, TABLE)).unwrap();
    let wall = square(Vec3::new(-3.0, 0.0, -3.0), Vec3::X * 6.0, Vec3::Y * 6.0, 40);
    all.append(part(wall, ELSE)).unwrap();
    let crumb = |at: Vec3| [at, at + Vec3::X * 0.05, at + Vec3::Y * 0.05];
    let crumbs = [[1.2, 1.0, 0.3], [-0.9, 1.4, 0.8], [0.4, 2.0, -1.0]].map(|at| crumb(at.into()));
    all.append(part(crumbs.concat(), ELSE)).unwrap();
    all
}

fn lens(size: UVec2, focal: f32) -> Camera {
    let center = size.as_vec2() / 2.0;
    Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(focal),
        center,
        size,
    }
}

/// Twelve cameras in half a circle around the ball.
fn cameras() -> Vec<Camera> {
    let camera = |i: usize| {
        let turn = (i as f32 / 11.0 - 0.5) * 3.0;
        let eye = Vec3::new(2.5 * turn.sin(), 1.2 + 0.1 * (i % 3) as f32, 2.5 * turn.cos());
        lens(UVec2::new(96, 72), 100.0).with_look_at(eye, Vec3::Y * 0.5, Vec3::Y)
    };
    (0..12).map(camera).collect()
}

fn baked(crop: &[&str]) -> Mesh {
    bake(Scene::Mesh(studio()), crop).0
}

fn bake(scene: Scene, crop: &[&str]) -> (Mesh, Report) {
    bake_from(cameras(), scene, crop)
}

fn bake_from(cameras: Vec<Camera>, scene: Scene, crop: &[&str]) -> (Mesh, Report) {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    // Of a small scene more triangles go that no camera sees.
    options.unseen.keep_unseen = true;
    options.crop.crop = crop.iter().map(|text| text.parse().unwrap()).collect();
    let scene = ImportedScene { cameras, ..ImportedScene::from(scene) };
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([scene]).unwrap();
    (asset.mesh, report)
}

fn is(mesh: &Mesh, face: usize, grey: f32) -> bool {
    (mesh.corner_colors(face)[0][0] - grey).abs() < 0.05
}

fn count(mesh: &Mesh, grey: f32) -> usize {
    (0..mesh.face_count()).filter(|face| is(mesh, *face, grey)).count()
}

/// The box around a mesh.
fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    mesh.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), v| (low.min(*v), high.max(*v)))
}

#[test]
fn crop_keeps_the_object_and_a_margin_of_its_table() {
    let whole = baked(&[]);
    let mesh = baked(&["subject"]);
    assert_eq!(
        (count(&mesh, BALL), count(&mesh, ELSE)),
        (512, 0),
        "the ball is whole, the wall and crumbs are gone"
    );
    assert!(count(&whole, BALL) == 512 && count(&whole, ELSE) > 3000 && count(&mesh, TABLE) > 10);
    let edge = |v: &Vec3| Vec2::new(v.x, v.z).length();
    let farthest = mesh.positions.iter().map(edge).fold(0.0, f32::max);
    assert!((0.5..0.75).contains(&farthest), "the table ends {farthest} from the middle");
    let (low, high) = bounds(&mesh);
    assert!(low.y.abs() < 0.05 && (0.9..1.1).contains(&high.y), "{low} {high}");
    assert!(
        ((low + high) / 2.0).x.abs() < 0.1 && ((low + high) / 2.0).z.abs() < 0.1,
        "{low} {high}"
    );
}

/// The shares of the ball and of all triangles in a picture that a viewer frames: a ball around
/// what is in the file fills the height.
fn shares(mesh: &Mesh) -> [f32; 2] {
    let (low, high) = bounds(mesh);
    let center = (low + high) / 2.0;
    let radius = mesh.positions.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
    let size = UVec2::new(640, 480);
    let half = 25.0f32.to_radians();
    let eye = center + Vec3::new(0.45, 0.3, 1.0).normalize() * radius / half.sin();
    let camera = lens(size, 240.0 / half.tan()).with_look_at(eye, center, Vec3::Y);
    let mut solid = SolidRasterizer::new();
    let seen = solid.visibility(mesh, &camera, &SolidRasterOptions::default());
    let shown: Vec<usize> =
        seen.face.iter().filter(|f| **f != NO_FACE).map(|f| *f as usize).collect();
    let ball = shown.iter().filter(|face| is(mesh, **face, BALL)).count();
    [ball, shown.len()].map(|pixels| pixels as f32 / size.element_product() as f32)
}

#[test]
fn framing_of_other_viewers_fills_a_quarter_of_the_picture() {
    let [before, after] = [baked(&[]), baked(&["subject"])].map(|mesh| shares(&mesh));
    assert!(before[0] < 0.02, "{before:?}");
    assert!(after[1] > 0.25 && after[0] > 0.18, "{after:?}");
}

/// The farthest place of the table in each of 16 directions.
fn rim(mesh: &Mesh) -> [f32; 16] {
    let mut edge = [0.0f32; 16];
    for v in mesh.positions.iter().filter(|v| v.y < 0.1) {
        let turn = v.z.atan2(v.x) / std::f32::consts::TAU + 0.5;
        let ray = &mut edge[((turn * 16.0) as usize).min(15)];
        *ray = ray.max(Vec2::new(v.x, v.z).length());
    }
    edge
}

/// A block on the same table is none of its business, even if it is large and near; nor is what
/// photos show beyond the table's edge.
#[test]
fn what_stands_beside_it_is_left_out() {
    let mut room = studio();
    let block = square(Vec3::new(1.0, 0.0, -0.6), Vec3::Y * 1.2, Vec3::Z * 1.2, 12);
    room.append(part(block, ELSE)).unwrap();
    room.append(part(
        square(Vec3::new(-9.0, -3.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, 40),
        ELSE,
    ))
    .unwrap();
    let (mesh, _) = bake(Scene::Mesh(room), &["subject"]);
    assert_eq!((count(&mesh, BALL), count(&mesh, ELSE)), (512, 0));
    assert!(count(&mesh, TABLE) > 10);
}

/// The studio with its floor as a wall: there is nothing that the ball stands on.
#[test]
fn a_thing_on_a_wall_keeps_a_hands_breadth_of_it() {
    let mut wall = studio();
    wall.retain(|face| !is(&studio(), face, ELSE));
    // The cameras' up is along the wall.
    let upright = Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2);
    wall.positions.iter_mut().for_each(|at| *at = upright * *at);
    let camera = |i: usize| {
        let turn = (i % 4) as f32 * 0.4 - 0.6;
        let height = (i / 4) as f32 * 0.5 - 0.5;
        let eye = Vec3::new(2.5 * turn.sin(), height, 0.5 + 2.5 * turn.cos());
        lens(UVec2::new(96, 72), 100.0).with_look_at(eye, Vec3::Z * 0.5, Vec3::Y)
    };
    let (mesh, _) = bake_from((0..12).map(camera).collect(), Scene::Mesh(wall), &["subject"]);
    assert!(
        count(&mesh, BALL) > 500 && count(&mesh, TABLE) > 10,
        "{} {}",
        count(&mesh, BALL),
        count(&mesh, TABLE)
    );
    let (low, high) = bounds(&mesh);
    assert!((high - low).max_element() < 1.6, "{low} {high}");
}

/// Triangles of a soup that reach over the edge are cut there, so the table is a disc.
#[test]
fn a_soup_is_cut_along_its_edge() {
    let (mesh, report) = bake(Scene::Soup(Scene::Mesh(studio()).to_soup()), &["subject"]);
    assert_eq!((count(&mesh, BALL), count(&mesh, ELSE)), (512, 0));
    let details = report.details::<CropDetails>().unwrap();
    assert!(details.cut > 16 && details.outside > 3000, "{details:?}");
    let edge = rim(&mesh);
    let (least, most) =
        edge.iter().fold((f32::MAX, 0.0f32), |(least, most), r| (least.min(*r), most.max(*r)));
    assert!((0.5..0.75).contains(&most) && least > 0.98 * most, "{edge:?}");
    let table = (0..mesh.face_count()).filter(|face| is(&mesh, *face, TABLE));
    let area: f64 = table.map(|face| mesh.area(face)).sum();
    let disc = std::f64::consts::PI * f64::from(most).powi(2);
    assert!((area / disc - 1.0).abs() < 0.02, "{area} of {disc}");
}

/// The surface is cut, not the scene: triangles of the table that reach over the edge leave no
/// holes, and there are no crumbs.
#[test]
fn the_surface_of_the_thing_ends_in_an_even_edge() {
    let mut options = MeshOptions::default();
    options.crop.crop = vec!["subject".parse().unwrap()];
    options.surface.resolution = Some(64);
    let scene = ImportedScene { cameras: cameras(), ..ImportedScene::from(Scene::Mesh(studio())) };
    let mut report = Report::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let asset = mesh(scene, None, &options, &Limits::DEFAULT, &mut report, &mut nobody).unwrap();
    let found = asset.mesh;
    let details = report.details::<SurfaceDetails>().unwrap();
    assert_eq!(details.components, 2, "the ball, and its piece of the table: {details:?}");
    assert!((0..found.face_count()).all(|face| !is(&found, face, ELSE)), "no wall, no crumbs");
    let edge = rim(&found);
    let most = edge.iter().fold(0.0f32, |most, r| most.max(*r));
    let even = |i: usize| edge[i].min(edge[(i + 1) % 16]) > 0.85 * edge[i].max(edge[(i + 1) % 16]);
    assert!((0.5..0.75).contains(&most) && (0..16).all(even), "{edge:?}");
}

/// Eighteen cameras all around the ball, which see nothing of its underside, nor of the table below
/// it.
fn around() -> Vec<Camera> {
    let camera = |i: usize| {
        let turn = i as f32 * std::f32::consts::TAU / 18.0;
        let height = 1.0 + 0.5 * (i % 3) as f32;
        let eye = Vec3::new(2.5 * turn.sin(), height, 2.5 * turn.cos());
        lens(UVec2::new(96, 72), 100.0).with_look_at(eye, Vec3::Y * 0.5, Vec3::Y)
    };
    (0..18).map(camera).collect()
}

/// The subject's surface with a texture of pictures from all around.
fn textured_surface() -> (Mesh, SurfaceDetails) {
    let drawing = SolidRasterOptions { samples: 4, ..SolidRasterOptions::default() };
    let picture = |camera: &Camera| SolidRasterizer::new().render(&studio(), camera, &drawing);
    let mut views = Views::drawn(around(), around().iter().map(picture).collect());
    let mut options = MeshOptions {
        texture: TextureOptions { texture: TextureWhen::On, ..TextureOptions::DEFAULT },
        ..MeshOptions::default()
    };
    options.crop.crop = vec!["subject".parse().unwrap()];
    options.surface.resolution = Some(64);
    options.surface.max_triangles = Some(3000);
    options.place.up = "y".parse().unwrap();
    let scene = ImportedScene { cameras: around(), ..ImportedScene::from(Scene::Mesh(studio())) };
    let mut report = Report::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    let found = mesh(scene, Some(&mut views), &options, &Limits::DEFAULT, &mut report, &mut nobody)
        .unwrap();
    (found.mesh, report.details().unwrap())
}

/// Of each border of a mesh, the least distance of its places from the axis of the ball.
fn borders(mesh: &Mesh) -> Vec<f32> {
    // A texture splits vertices where its charts meet.
    let corners = |face: usize| mesh.corners(face).map(|place| place.to_array().map(f32::to_bits));
    let edges: HashSet<_> = (0..mesh.face_count())
        .map(corners)
        .flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)])
        .collect();
    let mut next = HashMap::new();
    for (a, b) in edges.iter().filter(|(a, b)| !edges.contains(&(*b, *a))) {
        assert_eq!(next.insert(*a, *b), None, "borders touch");
    }
    let mut least = Vec::new();
    while let Some(start) = next.keys().next().copied() {
        let mut at = start;
        let mut nearest = f32::MAX;
        while let Some(after) = next.remove(&at) {
            let [x, _, z] = at.map(f32::from_bits);
            at = after;
            nearest = nearest.min(x.hypot(z));
        }
        least.push(nearest);
    }
    least
}

/// A picture from straight below, and which of its pixels show a triangle, or are beside all of
/// them. `[H * W]`
fn from_below(mesh: &Mesh) -> (RgbImage, Vec<bool>, Vec<bool>) {
    let (low, high) = bounds(mesh);
    let size = UVec2::splat(200);
    let center = (low + high) / 2.0;
    let eye = center - Vec3::Y * 2.5 * (high - low).length();
    let camera = lens(size, 400.0).with_look_at(eye, center, Vec3::Z);
    let drawing = SolidRasterOptions::default();
    let mut solid = SolidRasterizer::new();
    let seen = solid.visibility(mesh, &camera, &drawing);
    let shows: Vec<bool> = seen.face.iter().map(|face| *face != NO_FACE).collect();
    // Pixels connected to a corner of the picture are beside the silhouette.
    let width = size.x as usize;
    let mut beside = vec![false; shows.len()];
    let mut reached = vec![0];
    while let Some(pixel) = reached.pop() {
        if shows[pixel] || std::mem::replace(&mut beside[pixel], true) {
            continue;
        }
        let x = pixel % width;
        let y = pixel / width;
        let around =
            [(x > 0, -1), (x + 1 < width, 1), (y > 0, -200), (y + 1 < size.y as usize, 200)];
        let steps = around.into_iter().filter(|(within, _)| *within);
        reached.extend(steps.filter_map(|(_, step)| pixel.checked_add_signed(step)));
    }
    (SolidRasterizer::new().render(mesh, &camera, &drawing), shows, beside)
}

/// Distance of the codes of the pixels of a thing from its own, of 95% of them: where two meet,
/// each has some of the other's.
fn off(picture: &RgbImage, shows: &[bool], grey: f32) -> u8 {
    let wants = (255.0 * trisplat_scene::math::color::srgb_from_linear(grey)).round() as u8;
    let shown = picture.rgb.iter().zip(shows).filter(|(_, shows)| **shows);
    let mut off: Vec<u8> = shown.map(|(pixel, _)| pixel[1].abs_diff(wants)).collect();
    off.sort_unstable();
    off[off.len() * 95 / 100]
}

/// The area under the ball, seen by no photo, is closed and has the colours around it.
#[test]
fn nothing_shines_through_the_surface_from_below() {
    let (found, details) = textured_surface();
    let borders = borders(&found);
    assert!(borders.len() == 1 && details.holes >= 1, "{borders:?} {details:?}");
    assert!(borders[0] > 0.5, "the outline is open, not a hole: {borders:?}");
    let (picture, shows, beside) = from_below(&found);
    let holes = shows.iter().zip(&beside).filter(|(shows, beside)| !**shows && !**beside).count();
    assert!(shows.iter().filter(|shows| **shows).count() > 4000, "the table is in view");
    assert_eq!(holes, 0, "pixels through which the background shines");
    let table = off(&picture, &shows, TABLE);
    // Without the table, the ball's underside is in view.
    let mut ball = found.clone();
    ball.retain(|face| found.corners(face).iter().any(|v| v.y > 0.06));
    let (picture, shows, beside) = from_below(&ball);
    let holes = shows.iter().zip(&beside).filter(|(shows, beside)| !**shows && !**beside).count();
    let ball = off(&picture, &shows, BALL);
    assert_eq!(holes, 0, "pixels of the ball through which the background shines");
    assert!(table <= 25 && ball <= 25, "{table} codes off below the table, {ball} below the ball");
}
