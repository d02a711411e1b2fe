//! Connected meshes: they stay closed and keep their picture with fewer triangles.

use glam::{UVec2, Vec2, Vec3};
use std::sync::Arc;
use trisplat_bake::{Bake, BakeOptions, BakePreset, LodOptions};
use trisplat_fixtures::shapes::{around, loose};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::geometry::octasphere;
use trisplat_scene::math::metric::psnr;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Asset, FaceTexture, ImportedScene, Rng, Texture};
use trisplat_surface::CollisionOptions;

/// A closed ball with bumps, of 8 · 4^levels triangles that share vertices.
fn bumpy(levels: u32) -> Mesh {
    let (corners, faces) = octasphere(levels);
    let bump =
        |p: Vec3| 1.0 + 0.1 * (5.0 * p.x).sin() * (4.0 * p.y + 1.0).sin() * (6.0 * p.z).cos();
    Mesh {
        colors: Colors::Vertex(vec![[0.5; 3]; corners.len()]),
        positions: corners.into_iter().map(|p| p * bump(p)).collect(),
        indices: faces.into_flattened(),
        ..Mesh::default()
    }
}

/// Soft waves of colour.
fn picture() -> Arc<Texture> {
    let wave = |x: u32, y: u32, k: u32| {
        let phase = (x * (3 + k) + y * (5 - k)) as f32 / 256.0 * std::f32::consts::TAU;
        (128.0 + 80.0 * phase.sin()) as u8
    };
    let rgb = (0..256 * 256).map(|i| [0, 1, 2].map(|k| wave(i % 256, i / 256, k))).collect();
    Arc::new(Texture::new(RgbImage { size: UVec2::splat(256), rgb, alpha: None }))
}

/// With a texture at `uv` of each corner of a face.
fn textured(mut mesh: Mesh, uv: impl Fn([Vec3; 3]) -> [Vec2; 3]) -> Mesh {
    let uvs = (0..mesh.face_count()).map(|face| uv(mesh.corners(face))).collect();
    mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
    mesh.texture = Some(FaceTexture::new(uvs, picture()));
    mesh
}

/// Its picture goes through it along z.
fn projected() -> Mesh {
    textured(bumpy(5), |corners| corners.map(|p| Vec2::new(p.x, p.y) * 0.4 + 0.5))
}

/// Its picture goes around it, and ends meet at a seam.
fn with_seam() -> Mesh {
    textured(bumpy(5), |corners| {
        let middle = (corners[0] + corners[1] + corners[2]).normalize();
        let turn = |p: Vec3| p.y.atan2(p.x) / std::f32::consts::TAU + 0.5;
        corners.map(|p| {
            let mut u = if p.x.hypot(p.y) < 1e-4 { turn(middle) } else { turn(p) };
            u += (turn(middle) - u).round();
            Vec2::new(0.9 * u.clamp(0.0, 1.0) + 0.05, p.normalize().z.acos() / std::f32::consts::PI)
        })
    })
}

/// Without its lower quarter.
fn with_border() -> Mesh {
    let mut mesh = bumpy(5);
    let centroids: Vec<Vec3> = (0..mesh.face_count()).map(|face| mesh.centroid(face)).collect();
    mesh.retain(|face| centroids[face].y > -0.5);
    mesh
}

fn baked(mesh: Mesh, shares: &[f64]) -> Asset {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.lod = LodOptions { lod: shares.to_vec() };
    Bake::new(&options).run([mesh]).unwrap()
}

/// Share of rays from outside that miss a level or hit it over 3% of the radius too near or far.
fn wrong_rays(whole: &Asset, level: &Asset) -> f64 {
    let rng = Rng::new(1, "rays", 0);
    let inside = |i: u64| {
        let [x, y, z] = [0, 1, 2].map(|k| 2.0 * rng.uniform(3 * i + k) - 1.0);
        Vec3::new(x, y, z)
    };
    let middle = middle(&whole.mesh);
    let mut wrong = 0u32;
    let mut all = 0u32;
    for i in 0..5000 {
        let from = middle + 3.0 * inside(2 * i).normalize();
        let towards = middle + 0.6 * inside(2 * i + 1) - from;
        let Some(hit) = whole.raycast(from, towards) else { continue };
        let near = level.raycast(from, towards).map(|other| (other.distance - hit.distance).abs());
        wrong += u32::from(near.is_none_or(|off| off > 0.03));
        all += 1;
    }
    f64::from(wrong) / f64::from(all)
}

fn open_edges(mesh: &Mesh) -> usize {
    let bits = |p: Vec3| p.to_array().map(f32::to_bits);
    let mut sides: Vec<_> = (0..mesh.face_count())
        .flat_map(|face| {
            let [a, b, c] = mesh.corners(face).map(bits);
            [(a, b), (b, c), (c, a)]
        })
        .map(|(a, b)| if a < b { (a, b) } else { (b, a) })
        .collect();
    sides.sort_unstable();
    sides.chunk_by(|a, b| a == b).filter(|side| side.len() % 2 == 1).count()
}

/// PSNR of the pictures of a level against those of the whole, dB.
fn picture_psnr(whole: &Asset, level: &Asset) -> f64 {
    let middle = middle(&whole.mesh);
    let cameras = around(5, 3.0, 200).into_iter().map(|mut camera| {
        camera.translation -= camera.rotation * middle;
        camera
    });
    let options = SolidRasterOptions { samples: 2, ..SolidRasterOptions::default() };
    let cameras: Vec<Camera> = cameras.collect();
    let draw = |asset: &Asset| -> Vec<[u8; 3]> {
        let one = |camera| SolidRasterizer::new().render(&asset.mesh, camera, &options).rgb;
        cameras.iter().flat_map(one).collect()
    };
    psnr(&draw(whole), &draw(level), None)
}

fn middle(mesh: &Mesh) -> Vec3 {
    mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f32
}

#[test]
fn levels_of_connected_meshes_keep_shape_and_picture() {
    let shapes = [
        ("plain", bumpy(5)),
        ("textured", projected()),
        ("seam", with_seam()),
        ("border", with_border()),
    ];
    for (name, mesh) in shapes {
        let closed = name != "border";
        let asset = baked(mesh, &[0.5, 0.25, 0.1]);
        for (level, (share, most_wrong)) in
            asset.levels.iter().zip([(0.5, 0.002), (0.25, 0.002), (0.1, 0.01)])
        {
            let wrong = wrong_rays(&asset, level);
            assert!(wrong <= most_wrong, "{name} at {share}: {wrong}");
            let faces = (share * asset.scene_faces() as f64) as usize;
            assert!((faces - 2..=faces).contains(&level.scene_faces()), "{name} at {share}");
            assert!(!closed || open_edges(&level.mesh) == 0, "{name} at {share}");
        }
        let db = picture_psnr(&asset, &asset.levels[0]);
        assert!(db >= 40.0, "{name}: {db} dB");
    }
}

#[test]
fn limits_keep_connected_meshes_closed() {
    let mut mesh = bumpy(5);
    // A colour of its own for each face: seams everywhere.
    let random = Rng::new(2, "colours", 0);
    let color = |face: u64| [0, 1, 2].map(|k| random.uniform(3 * face + k));
    mesh.colors = Colors::Face((0..mesh.face_count() as u64).map(color).collect());
    for mesh in [with_seam(), mesh] {
        let whole = baked(mesh.clone(), &[]);
        let mut options = BakeOptions::preset(BakePreset::Default);
        options.prune.max_triangles = Some(2000);
        let fewer = Bake::new(&options).run([mesh]).unwrap();
        assert!((1990..=2000).contains(&fewer.scene_faces()), "{}", fewer.scene_faces());
        assert_eq!(fewer.mesh.texture.is_some(), whole.mesh.texture.is_some());
        assert_eq!(open_edges(&fewer.mesh), 0);
        let wrong = wrong_rays(&whole, &fewer);
        assert!(wrong <= 0.002, "{wrong}");
    }
}

/// A ball beside triangles that share nothing: each part is simplified by its kind.
#[test]
fn parts_of_a_mixed_scene_are_simplified_each_by_its_kind() {
    let far = Vec3::X * 8.0;
    let patch = |i: u32| {
        let corner = far + Vec3::new((i % 16) as f32, (i / 16) as f32, 0.0) / 8.0;
        [corner, corner + Vec3::X / 8.0, corner + Vec3::Y / 8.0]
    };
    let mut mesh = bumpy(4);
    let soup = loose((0..256).flat_map(patch).collect());
    let colors = Colors::Vertex(vec![[0.5; 3]; soup.len()]);
    mesh.append(Mesh { positions: soup, colors, ..Mesh::default() }).unwrap();
    let all = mesh.face_count();
    let count = |asset: &Asset| {
        let is_ball = |face: &usize| asset.mesh.centroid(*face).x < bounds_middle(&asset.mesh);
        let faces = asset.scene_faces();
        [(0..faces).filter(is_ball).count(), faces]
    };
    let level = &baked(mesh.clone(), &[0.5]).levels[0];
    assert_eq!(count(level), [1024, all / 2]);
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.prune.max_triangles = Some(all as u64 / 2);
    let fewer = Bake::new(&options).run([mesh]).unwrap();
    assert_eq!(count(&fewer), [1024, all / 2]);
    // All three edges of each loose triangle are open, and no others.
    assert_eq!([level, &fewer].map(|asset| open_edges(&asset.mesh)), [3 * 128; 2]);
}

#[test]
fn hidden_faces_of_a_connected_part_stay() {
    let mut mesh = bumpy(4);
    let whole = mesh.face_count();
    let mut hidden = bumpy(3);
    for place in &mut hidden.positions {
        *place *= 0.5;
    }
    mesh.append(hidden).unwrap();
    let mut scene = ImportedScene::from(mesh);
    // From one side only: the other half hides behind it.
    scene.cameras = around(1, 3.0, 200);
    let asset = Bake::new(&BakeOptions::default()).run([scene]).unwrap();
    assert_eq!(asset.scene_faces(), whole, "the ball stays whole, the one inside it goes");
    assert_eq!(open_edges(&asset.mesh), 0);
}

fn bounds_middle(mesh: &Mesh) -> f32 {
    let along = || mesh.positions.iter().map(|p| p.x);
    (along().fold(f32::INFINITY, f32::min) + along().fold(f32::NEG_INFINITY, f32::max)) / 2.0
}

#[test]
fn colliders_of_meshes_have_at_most_their_triangles() {
    let collider = |mesh: Mesh, most: Option<u32>| {
        let mut options = BakeOptions::preset(BakePreset::Fast);
        options.collision = CollisionOptions { collision: true, collision_triangles: most };
        let asset = Bake::new(&options).run([mesh]).unwrap();
        let collider = Asset::from(asset.collision.clone().unwrap());
        assert_eq!(open_edges(&collider.mesh), 0);
        (wrong_rays(&asset, &collider), collider.mesh.face_count())
    };
    let (wrong, faces) = collider(with_seam(), None);
    assert!(wrong <= 0.01 && (1000..=1024).contains(&faces), "{wrong} {faces}");
    let (wrong, faces) = collider(with_seam(), Some(500));
    assert!(wrong <= 0.02 && (480..=500).contains(&faces), "{wrong} {faces}");
    assert_eq!(collider(bumpy(3), Some(4000)), (0.0, 512));
    assert_eq!(collider(bumpy(0), None), (0.0, 8), "what has no triangle too many stays");
}
