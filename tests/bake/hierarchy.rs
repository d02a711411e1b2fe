//! The hierarchy: built, searched against brute force, written, read, and attacked.

use super::chunks::chunked;
use super::hostile::{finite, grid, mesh_of, random};
use glam::{DVec3, Vec3, vec3};
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_bake::{BvhDetails, BvhOptions, bvh};
use trisplat_bench::scenes::studio;
use trisplat_formats::{
    ReadOptions, Source,
    bvh::{BvhHeader, belongs, position_hash, read, write},
    ply,
};
use trisplat_scene::{
    Asset, Error, Result, Rng, Scene,
    bvh::{Bvh, RayHit},
    mesh::Mesh,
};

fn built(mesh: Mesh, limit: u32) -> Asset {
    let mut asset = chunked(mesh, limit);
    bvh(&mut asset, &BvhOptions { bvh: true }, &mut BvhDetails::default()).unwrap();
    asset
}

/// The nearest hit by looking at every face; the plane equation and three edge tests, unlike the library.
fn brute_force(mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<RayHit> {
    let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
    let mut best: Option<RayHit> = None;
    for face in 0..mesh.face_count() {
        let [a, b, c] = mesh.corners(face).map(|v| v.as_dvec3());
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a - origin) / normal.dot(direction);
        let p = origin + t * direction;
        let left = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) >= 0.0;
        if t >= 0.0 && t.is_finite() && left(a, b) && left(b, c) && left(c, a) && best.is_none_or(|h| t < h.t)
        {
            best = Some(RayHit { face: face as u32, t });
        }
    }
    best
}

/// Casts `rays` through a mesh both ways; returns how many hit.
fn compare(name: &str, asset: &Asset, rays: u64) -> usize {
    let mesh = &asset.mesh;
    let hierarchy = asset.bvh.as_ref().unwrap();
    let (min, max) = mesh
        .positions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let margin = 0.1 * (max.as_dvec3() - min.as_dvec3()).max_element();
    let (min, max) = (min.as_dvec3() - margin, max.as_dvec3() + margin);
    let rng = Rng::new(17, "test rays", 0);
    let mut hits = 0;
    for i in 0..rays {
        let point = |k: u64| {
            let part = |c| rng.uniform_f64(12 * i + 3 * k + c);
            min + (max - min) * DVec3::new(part(0), part(1), part(2))
        };
        // From a point in the box through a face, along an axis, or through another point.
        let origin = point(0).as_vec3();
        let direction = match i % 4 {
            0 => [Vec3::X, -Vec3::Y, Vec3::Z][(i / 4 % 3) as usize],
            1 => (point(1) - origin.as_dvec3()).as_vec3(),
            _ => {
                let corners = mesh.corners((rng.bits(12 * i + 9) % mesh.face_count() as u64) as usize);
                (corners.iter().map(|v| v.as_dvec3() / 3.0).sum::<DVec3>() - origin.as_dvec3()).as_vec3()
            }
        };
        if direction == Vec3::ZERO || !direction.is_finite() {
            continue;
        }
        let (got, wants) = (hierarchy.cast(mesh, origin, direction), brute_force(mesh, origin, direction));
        match (got, wants) {
            (None, None) => {}
            (Some(got), Some(wants)) => {
                hits += 1;
                assert!(
                    (got.t - wants.t).abs() <= 1e-9 * wants.t.abs() + 1e-12,
                    "{name}, ray {i}: {got:?}, expected {wants:?}"
                );
            }
            _ => panic!("{name}, ray {i} from {origin} along {direction}: {got:?}, expected {wants:?}"),
        }
    }
    hits
}

#[test]
fn rays_hit_what_brute_force_hits() {
    for (name, soup) in finite() {
        if soup.is_empty() {
            continue;
        }
        for limit in [0, 40] {
            let asset = built(mesh_of(&soup), limit);
            asset.bvh.as_ref().unwrap().validate_with(&asset.mesh).unwrap_or_else(|e| panic!("{name}: {e}"));
            let hits = compare(name, &asset, 200);
            if ["studio", "coplanar", "1e14", "1e-18", "identical"].contains(&name) {
                assert!(hits >= 20, "{name}: only {hits} of 200 rays hit anything");
            }
        }
    }
    compare("connected", &built(grid(30), 100), 300);
}

#[test]
fn rays_hit_what_brute_force_hits_in_a_trained_soup() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/samples/soups/trained.ply"));
    let source = Source::open(path, &trisplat::Limits::DEFAULT).unwrap();
    let Scene::Soup(soup) = ply::read(source, &ReadOptions::with_degree(0)).unwrap().scene else {
        panic!("trained.ply is a soup")
    };
    let asset = built(mesh_of(&soup), 4096);
    asset.bvh.as_ref().unwrap().validate_with(&asset.mesh).unwrap();
    let hits = compare("trained", &asset, 200);
    assert!(hits > 100, "{hits} of 200 rays hit");
}

#[test]
fn rays_that_make_no_sense_hit_nothing() {
    let asset = built(mesh_of(&random(100, 0.5)), 0);
    let hierarchy = asset.bvh.unwrap();
    for (origin, direction) in [(Vec3::NAN, Vec3::X), (Vec3::ZERO, Vec3::ZERO), (Vec3::ZERO, Vec3::INFINITY)]
    {
        assert_eq!(hierarchy.cast(&asset.mesh, origin, direction), None);
    }
    assert_eq!(Bvh::default().cast(&Mesh::default(), Vec3::ZERO, Vec3::X), None);
}

#[test]
fn of_equal_distances_the_first_face_is_hit() {
    let one = vec![vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 1.0), vec3(0.0, 1.0, 1.0)];
    let mut soup = random(50, 0.1);
    soup.vertices.iter_mut().for_each(|t| t.copy_from_slice(&one));
    let asset = built(mesh_of(&soup), 7);
    let hit = asset.bvh.unwrap().cast(&asset.mesh, vec3(0.25, 0.25, 0.0), Vec3::Z);
    assert_eq!(hit, Some(RayHit { face: 0, t: 1.0 }));
}

fn source(bytes: &[u8]) -> Source {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(bytes).unwrap();
    std::io::Seek::rewind(&mut file).unwrap();
    Source { path: PathBuf::from("scene.bvh"), file: file.into(), len: bytes.len() as u64 }
}

fn bytes_of(asset: &Asset) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, asset).unwrap();
    bytes
}

fn read_bytes(bytes: &[u8]) -> Result<(BvhHeader, Bvh)> {
    read(source(bytes))
}

#[test]
fn the_file_comes_back_as_it_was() {
    for limit in [0, 100] {
        let asset = built(mesh_of(&studio(2000, 1)), limit);
        let (header, back) = read_bytes(&bytes_of(&asset)).unwrap();
        assert!(Some(&back) == asset.bvh.as_ref());
        assert_eq!(header.chunks.len(), asset.chunks.len());
        belongs("scene.bvh".as_ref(), &header, &asset.mesh).unwrap();
        let mut other = asset.mesh.clone();
        other.positions[7].x += 1e-3;
        let error = belongs("scene.bvh".as_ref(), &header, &other).unwrap_err().to_string();
        assert!(error.contains("belongs to another scene") && error.contains("bake again"), "{error}");
    }
}

#[test]
fn the_hash_is_over_corners_whatever_the_indices() {
    let mesh = grid(3);
    let corners: Vec<Vec3> = (0..mesh.face_count()).flat_map(|f| mesh.corners(f)).collect();
    let bytes: Vec<u8> = corners.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect();
    assert_eq!(position_hash(&mesh, mesh.face_count()), xxhash_rust::xxh3::xxh3_64(&bytes));
    let own = Mesh { positions: corners, indices: Vec::new(), ..mesh };
    assert_eq!(position_hash(&own, own.face_count()), xxhash_rust::xxh3::xxh3_64(&bytes));
}

#[test]
fn every_truncation_of_the_file_fails_cleanly() {
    let bytes = bytes_of(&built(mesh_of(&random(60, 0.1)), 20));
    for end in 0..bytes.len() {
        assert!(matches!(read_bytes(&bytes[..end]), Err(Error::Malformed { .. })), "{end} bytes");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert!(matches!(read_bytes(&longer), Err(Error::Malformed { .. })));
}

/// Any damaged byte is refused or gives a hierarchy that can be searched.
#[test]
fn every_damaged_byte_fails_cleanly_or_can_be_searched() {
    let asset = built(mesh_of(&random(60, 0.1)), 20);
    let bytes = bytes_of(&asset);
    let mut refused = 0;
    for at in 0..bytes.len() {
        for damage in [0x01, 0x80, 0xff] {
            let mut damaged = bytes.clone();
            damaged[at] ^= damage;
            match read_bytes(&damaged) {
                Ok((_, back)) => {
                    for direction in [Vec3::X, vec3(-1.0, 0.3, 0.2)] {
                        back.cast(&asset.mesh, vec3(0.5, 0.5, 0.5), direction);
                    }
                }
                Err(Error::Malformed { .. } | Error::Unsupported { .. }) => refused += 1,
                Err(e) => panic!("byte {at}: {e}"),
            }
        }
    }
    assert!(refused > bytes.len() / 4, "{refused} of {} damaged files refused", 3 * bytes.len());
}

#[test]
fn promises_that_no_file_keeps_are_refused_before_memory_is_taken() {
    let bytes = bytes_of(&built(mesh_of(&random(60, 0.1)), 20));
    let mut long_json = bytes.clone();
    long_json[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(read_bytes(&long_json), Err(Error::Malformed { .. })));
    let header: BvhHeader = read_bytes(&bytes).unwrap().0;
    for (nodes, faces) in
        [(u32::MAX, header.faces), (header.nodes, u32::MAX), (0, header.faces), (header.nodes, 0)]
    {
        let changed = BvhHeader { nodes, faces, ..header.clone() };
        let mut json = serde_json::to_vec(&changed).unwrap();
        json.resize(json.len().next_multiple_of(16), b' ');
        let old_json = u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
        let file = [&bytes[..8], &(json.len() as u32).to_le_bytes(), &[0; 4], &json, &bytes[16 + old_json..]]
            .concat();
        assert!(matches!(read_bytes(&file), Err(Error::Malformed { .. })), "{nodes} nodes, {faces} faces");
    }
}

/// Equal boxes, where obvhs alone joins one pair a pass: seconds and a stack overflow without the tie-break.
#[test]
fn a_hundred_thousand_equal_triangles_build_a_shallow_tree() {
    let mut soup = random(1, 0.5);
    soup.vertices = soup.vertices.repeat(100_000);
    soup.opacity = soup.opacity.repeat(100_000);
    soup.sigma = soup.sigma.repeat(100_000);
    soup.sh = soup.sh.repeat(100_000);
    let asset = built(mesh_of(&soup), 0);
    let hierarchy = asset.bvh.unwrap();
    hierarchy.validate_with(&asset.mesh).unwrap();
    let mut depth = vec![0u32; hierarchy.nodes.len()];
    for (index, node) in hierarchy.nodes.iter().enumerate() {
        for slot in 0..8 {
            if let Ok(trisplat_scene::bvh::Child::Node(below)) = trisplat_scene::bvh::child(node, slot) {
                depth[below as usize] = depth[index] + 1;
            }
        }
    }
    let deepest = depth.iter().max().unwrap();
    assert!(*deepest < 32, "depth {deepest}");
}
