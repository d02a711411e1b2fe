//! `bake --lit`: fronts towards the cameras, normals of the surface, and what files hold of them.

use glam::{DMat3, Mat3, UVec2, Vec2, Vec3};
use std::path::Path;
use trisplat_bake::{BakeOptions, Lit, LitDetails, LitOptions, bake, lit};
use trisplat_formats::{OutputTarget, ReadOptions, output::OutputOptions, read, write};
use trisplat_scene::{
    Asset, ImportedScene, Rng, Scene,
    camera::Camera,
    mesh::{Colors, Mesh},
    report::Outcome,
};

/// Triangles scattered about a ball of radius 1, each tilted by up to some 40 degrees, every third
/// one wound inward.
fn scattered(count: usize) -> Mesh {
    let rng = Rng::new(5, "lit", 0);
    let random = |i: usize| 2.0 * rng.uniform(i as u64) - 1.0;
    let triangle = |i: usize| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        let radial = Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
        let jitter = Vec3::new(random(3 * i), random(3 * i + 1), random(3 * i + 2));
        let normal = (radial + 0.5 * jitter).normalize();
        let right = normal.any_orthonormal_vector();
        let up = normal.cross(right);
        let corners =
            [right, -0.5 * right + 0.8 * up, -0.5 * right - 0.8 * up].map(|v| radial + 0.09 * v);
        if i.is_multiple_of(3) { [corners[0], corners[2], corners[1]] } else { corners }
    };
    let positions = (0..count).flat_map(triangle).collect();
    Mesh { positions, colors: Colors::Face(vec![[0.5, 0.2, 0.1]; count]), ..Mesh::default() }
}

/// Cameras around the ball, at a distance of 4.
fn around() -> Vec<Camera> {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(50.0),
        size: UVec2::splat(100),
    };
    let eye = |i: u32| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / 20.0;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin) * 4.0
    };
    (0..20).map(|i| lens.with_look_at(eye(i), Vec3::ZERO, Vec3::NEG_Y)).collect()
}

/// Runs the stage; the angles between normals and the ball's own, degrees, in order.
fn angles(how: Lit, cameras: &[Camera], surface: Option<&Mesh>) -> (Mesh, LitDetails, Vec<f32>) {
    let mut mesh = scattered(4000);
    let mut details = LitDetails::default();
    let outcome = lit(&mut mesh, cameras, surface, &LitOptions { lit: how }, &mut details).unwrap();
    assert_eq!(outcome, Outcome::Changed(()));
    let angle = |f: usize| mesh.normals[f].angle_between(mesh.centroid(f)).to_degrees();
    let mut angles: Vec<f32> = (0..mesh.face_count()).map(angle).collect();
    angles.sort_by(f32::total_cmp);
    (mesh, details, angles)
}

#[test]
fn flat_normals_face_the_cameras() {
    let (flat, details, off) = angles(Lit::Flat, &around(), None);
    assert_eq!((details.cameras, details.on_surface), (20, 0));
    // Every third one was wound inward; a few are hidden, or tilted so far that their back is seen
    // more.
    assert!(details.flipped.abs_diff(1334) < 40 && details.unseen < 40, "{details:?}");
    assert!((0..flat.face_count()).all(|f| flat.normals[f].dot(flat.flat_normal(f)) > 0.999));
    assert!(off[2000] > 15.0, "the triangles are tilted, {}", off[2000]);
}

#[test]
fn cameras_are_counted_that_were_used() {
    let many: Vec<Camera> = around().into_iter().cycle().take(250).collect();
    let (_, details, _) = angles(Lit::Flat, &many, None);
    assert_eq!(details.cameras, 84, "every third of 250: at most 100 are asked");
}

/// Share of the triangles whose normal points out of their back: an engine turns it around for who
/// sees their front.
fn dark(mesh: &Mesh) -> f64 {
    let from_behind = |f: usize| mesh.flat_normal(f).dot(mesh.normals[f]) < 0.0;
    (0..mesh.face_count()).filter(|f| from_behind(*f)).count() as f64 / mesh.face_count() as f64
}

#[test]
fn lit_smooth_normals_are_those_of_the_surface() {
    // Normals of the triangles around.
    let (mesh, details, off) = angles(Lit::Smooth, &around(), None);
    assert_eq!((details.on_surface, dark(&mesh)), (0, 0.0));
    assert!(off[2000] < 5.0 && off[3960] < 15.0, "median {}, 99 % {}", off[2000], off[3960]);
    assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
    // Normals of a surface.
    let positions: Vec<Vec3> = (0..3000).flat_map(|i| fine(i, 3000)).collect();
    let colors = Colors::Face(vec![[0.5; 3]; 3000]);
    let ball = Mesh { positions, colors, ..Mesh::default() };
    let (mesh, details, off) = angles(Lit::Smooth, &around(), Some(&ball));
    assert!(details.on_surface > 3900 && dark(&mesh) == 0.0, "{details:?}");
    assert!(off[2000] < 2.0 && off[3960] < 6.0, "median {}, 99 % {}", off[2000], off[3960]);
}

/// A triangle that lies in the ball, its front outside.
fn fine(i: usize, count: usize) -> [Vec3; 3] {
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
    let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
    let normal = Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
    let right = normal.any_orthonormal_vector();
    let up = normal.cross(right);
    [right, -0.5 * right + 0.8 * up, -0.5 * right - 0.8 * up].map(|v| normal + 0.05 * v)
}

#[test]
fn without_cameras_the_winding_says_what_the_front_is() {
    let (mesh, details, _) = angles(Lit::Flat, &[], None);
    assert_eq!((details.cameras, details.flipped, details.unseen), (0, 0, 0));
    assert_eq!(mesh.positions, scattered(4000).positions);
}

#[test]
fn it_is_done_once_and_when_it_is_asked_for() {
    let mut mesh = scattered(100);
    let mut details = LitDetails::default();
    let off = lit(&mut mesh, &around(), None, &LitOptions::DEFAULT, &mut details).unwrap();
    assert!(
        matches!(off, Outcome::Skipped(why) if why.contains("not asked for"))
            && mesh.normals.is_empty()
    );
    let on = LitOptions { lit: Lit::Smooth };
    assert_eq!(lit(&mut mesh, &around(), None, &on, &mut details).unwrap(), Outcome::Changed(()));
    let before = mesh.clone();
    assert!(matches!(
        lit(&mut mesh, &around(), None, &on, &mut details).unwrap(),
        Outcome::Skipped(_)
    ));
    assert_eq!(mesh, before);
}

/// The ball, baked: turned, in chunks, with shared vertices if `welded`.
fn baked(how: Lit, welded: bool) -> Asset {
    let mut mesh = scattered(3000);
    if welded {
        mesh.colors = Colors::Vertex(vec![[0.3; 3]; 9000]);
        mesh.indices = (0..9000).collect();
    }
    let mut options = BakeOptions::default();
    options.lit.lit = how;
    options.chunk.chunk_triangles = 700;
    options.place.rotate = 30.0;
    bake(ImportedScene { cameras: around(), ..ImportedScene::from(mesh) }, &options).unwrap()
}

/// Normals of a GLB in the frame of the scene, three for each face, and the corners they are at.
fn normals_of(path: &Path) -> Vec<(Vec3, Vec3)> {
    // The crate knows no quantised positions and refuses files that require them.
    let bytes = std::fs::read(path).unwrap();
    let document =
        gltf::Gltf::from_slice_without_validation(&bytes).unwrap_or_else(|e| panic!("{e}"));
    let blob = document.blob.as_deref().unwrap();
    let mut all = Vec::new();
    for node in document.nodes() {
        let to_scene = DMat3::from_cols_array_2d(&node_scale(&node));
        let offset = Vec3::from(node.transform().decomposed().0);
        // The viewpoint is a node without a mesh.
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            assert!(!primitive.material().unlit());
            let normals = primitive.get(&gltf::Semantic::Normals).expect("normals");
            let view = normals.view().unwrap();
            let bytes = &blob[view.offset()..];
            let stride = view.stride().unwrap_or(normals.size());
            let normal = |i: usize| match normals.size() {
                12 => {
                    Vec3::from(bytemuck::pod_read_unaligned::<[f32; 3]>(&bytes[i * stride..][..12]))
                }
                3 => Vec3::from([0, 1, 2].map(|k| f32::from(bytes[i * stride + k] as i8) / 127.0)),
                size => panic!("normals of {size} bytes"),
            };
            let positions = primitive.get(&gltf::Semantic::Positions).unwrap();
            let view = positions.view().unwrap();
            let bytes = &blob[view.offset()..];
            let stride = view.stride().unwrap_or(positions.size());
            let position = |i: usize| match positions.size() {
                12 => {
                    Vec3::from(bytemuck::pod_read_unaligned::<[f32; 3]>(&bytes[i * stride..][..12]))
                }
                _ => Vec3::from(
                    bytemuck::pod_read_unaligned::<[u16; 3]>(&bytes[i * stride..][..6])
                        .map(f32::from),
                ),
            };
            all.extend((0..normals.count()).map(|i| {
                let at = to_scene.as_mat3() * position(i) + offset;
                (at, to_scene.inverse().transpose().as_mat3().mul_vec3(normal(i)).normalize())
            }));
        }
    }
    all
}

fn node_scale(node: &gltf::Node<'_>) -> [[f64; 3]; 3] {
    let [x, y, z] = node.transform().decomposed().2.map(f64::from);
    [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
}

#[test]
fn lit_glb_has_normals_as_floats_or_as_bytes() {
    let folder = tempfile::tempdir().unwrap();
    // Blender's small files are quantised without meshopt, so the `gltf` crate reads them.
    for (target, compress, degrees) in
        [(OutputTarget::Gltf, false, 0.05), (OutputTarget::Blender, true, 1.0)]
    {
        for welded in [false, true] {
            let path = folder.path().join("ball.glb");
            let options = OutputOptions { target, compress, ..OutputOptions::DEFAULT };
            let asset = baked(Lit::Smooth, welded);
            write(&asset, &path, &options).unwrap();
            let stored = normals_of(&path);
            let mesh = &asset.mesh;
            assert_eq!(stored.len(), mesh.vertex_count());
            let at = |i: usize| if mesh.indices.is_empty() { i / 3 } else { i };
            let wanted =
                if mesh.indices.is_empty() { mesh.normals.clone() } else { mesh.vertex_normals() };
            if mesh.indices.is_empty() {
                for (i, (position, normal)) in stored.iter().enumerate() {
                    assert!(position.distance(mesh.positions[i]) < 1e-3, "{i}: {position}");
                    let off = normal.angle_between(wanted[at(i)]).to_degrees();
                    assert!(off < degrees, "{target:?}: normal {i} is {off} degrees off");
                }
            }
            let outward =
                stored.iter().filter(|(position, normal)| position.dot(*normal) > 0.8).count();
            assert!(
                outward > stored.len() * 98 / 100,
                "{outward} of {} point outward",
                stored.len()
            );
        }
    }
}

#[test]
fn unlit_file_holds_no_normals() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |asset: &Asset, name: &str, options: &OutputOptions| {
        write(asset, &folder.path().join(name), options)
            .unwrap()
            .files
            .iter()
            .map(|f| f.bytes)
            .sum::<u64>()
    };
    let plain = baked(Lit::Off, false);
    let lit = baked(Lit::Smooth, false);
    let count = plain.mesh.face_count() as u64;
    let small =
        OutputOptions { target: OutputTarget::Blender, compress: true, ..OutputOptions::DEFAULT };
    // Documents differ by an accessor, a view and an attribute for each chunk.
    for (options, per_face) in [(OutputOptions::DEFAULT, 36), (small, 12)] {
        let more = bytes(&lit, "a.glb", &options) - bytes(&plain, "b.glb", &options);
        assert!((per_face * count..per_face * count + 2500).contains(&more), "{more} for {count}");
    }
    bytes(&plain, "plain.glb", &OutputOptions::DEFAULT);
    let document = gltf::Gltf::open(folder.path().join("plain.glb")).unwrap();
    assert!(document.materials().all(|material| material.unlit()));
}

#[test]
fn obj_and_ply_hold_normals_too_and_all_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(Lit::Smooth, false);
    for name in ["a.glb", "a.obj", "a.ply"] {
        let path = folder.path().join(name);
        write(&asset, &path, &OutputOptions::DEFAULT).unwrap();
        let Scene::Mesh(back) = read(&path, &ReadOptions::default()).unwrap().scene else {
            panic!("a soup")
        };
        assert_eq!(
            (back.face_count(), back.positions.len()),
            (asset.mesh.face_count(), asset.mesh.positions.len())
        );
        assert_eq!(back.positions[7], asset.mesh.positions[7]);
    }
    let obj = std::fs::read_to_string(folder.path().join("a.obj")).unwrap();
    let normals: Vec<Vec3> = obj
        .lines()
        .filter_map(|line| line.strip_prefix("vn "))
        .map(|line| {
            Vec3::from_slice(&line.split(' ').map(|x| x.parse().unwrap()).collect::<Vec<f32>>())
        })
        .collect();
    assert_eq!(normals, asset.mesh.normals);
    assert!(obj.contains("\nf 1//1 2//1 3//1\n"));
    let material = std::fs::read_to_string(folder.path().join("a.mtl")).unwrap();
    assert!(material.contains("illum 1"), "{material}");
    let ply = std::fs::read(folder.path().join("a.ply")).unwrap();
    let header = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    assert!(
        String::from_utf8_lossy(&ply[..header]).contains("property float z\nproperty float nx\n")
    );
    let first: [f32; 6] = bytemuck::pod_read_unaligned(&ply[header..header + 24]);
    assert_eq!(Vec3::from_slice(&first[3..]), asset.mesh.normals[0]);
}
