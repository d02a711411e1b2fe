//! Rays against brute force, over hostile triangles.

use super::hostile::{finite, grid, mesh_of, random};
use glam::{DVec3, Vec3, vec3};
use trisplat_formats::{ReadOptions, Source, ply};
use trisplat_scene::{Asset, Hit, Provenance, Rng, Scene, mesh::Mesh};

/// The nearest hit by looking at every face; the plane equation and three edge tests, unlike the
/// library.
fn brute_force(mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<Hit> {
    let origin = origin.as_dvec3();
    let direction = direction.as_dvec3();
    let mut best: Option<Hit> = None;
    for face in 0..mesh.face_count() {
        let [a, b, c] = mesh.corners(face).map(|v| v.as_dvec3());
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a - origin) / normal.dot(direction);
        let p = origin + t * direction;
        let distance = t * direction.length();
        let left = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) >= 0.0;
        if t >= 0.0
            && t.is_finite()
            && left(a, b)
            && left(b, c)
            && left(c, a)
            && best.is_none_or(|h| distance < h.distance)
        {
            best = Some(Hit { face: face as u32, distance });
        }
    }
    best
}

/// Casts `rays` through a mesh in both ways; returns how many hit.
fn compare(name: &str, asset: &Asset, rays: u64) -> usize {
    let mesh = &asset.mesh;
    let (min, max) = mesh
        .positions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let margin = 0.1 * (max.as_dvec3() - min.as_dvec3()).max_element();
    let min = min.as_dvec3() - margin;
    let max = max.as_dvec3() + margin;
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
                let corners =
                    mesh.corners((rng.bits(12 * i + 9) % mesh.face_count() as u64) as usize);
                (corners.iter().map(|v| v.as_dvec3() / 3.0).sum::<DVec3>() - origin.as_dvec3())
                    .as_vec3()
            }
        };
        if direction == Vec3::ZERO || !direction.is_finite() {
            continue;
        }
        let got = asset.raycast(origin, direction);
        let wants = brute_force(mesh, origin, direction);
        match (got, wants) {
            (None, None) => {}
            (Some(got), Some(wants)) => {
                hits += 1;
                assert!(
                    (got.distance - wants.distance).abs() <= 1e-9 * wants.distance + 1e-12,
                    "{name}, ray {i}: {got:?}, expected {wants:?}"
                );
            }
            _ => panic!(
                "{name}, ray {i} from {origin} along {direction}: {got:?}, expected {wants:?}"
            ),
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
        let hits = compare(name, &mesh_of(&soup).into(), 200);
        if ["studio", "coplanar", "1e14", "1e-18", "identical"].contains(&name) {
            assert!(hits >= 20, "{name}: only {hits} of 200 rays hit anything");
        }
    }
    compare("connected", &grid(30).into(), 300);
}

#[test]
fn rays_hit_what_brute_force_hits_in_a_trained_soup() {
    let path = &trisplat_fixtures::sample("soups/trained.ply");
    let source = Source::open(path, &trisplat_scene::Limits::DEFAULT).unwrap();
    let Scene::Soup(soup) = ply::read(source, &ReadOptions::with_degree(0)).unwrap().scene else {
        panic!("trained.ply is a soup")
    };
    let hits = compare("trained", &mesh_of(&soup).into(), 200);
    assert!(hits > 100, "{hits} of 200 rays hit");
}

#[test]
fn rays_from_far_away_hit_what_brute_force_hits() {
    let asset = Asset::from(mesh_of(&random(100, 0.5)));
    for away in [1e2, 1e5, 1e8, 1e12] {
        for face in 0..100 {
            let middle = asset.mesh.corners(face).iter().sum::<Vec3>() / 3.0;
            let origin = middle + away * vec3(0.6, 0.0, 0.8);
            let direction = middle - origin;
            let got = asset.raycast(origin, direction);
            let wants = brute_force(&asset.mesh, origin, direction);
            assert_eq!(
                got.is_some(),
                wants.is_some(),
                "{away}, face {face}: {got:?}, expected {wants:?}"
            );
        }
    }
}

#[test]
fn rays_that_make_no_sense_hit_nothing() {
    let asset = Asset::from(mesh_of(&random(100, 0.5)));
    for (origin, direction) in
        [(Vec3::NAN, Vec3::X), (Vec3::ZERO, Vec3::ZERO), (Vec3::ZERO, Vec3::INFINITY)]
    {
        assert_eq!(asset.raycast(origin, direction), None);
    }
    assert_eq!(Asset::default().raycast(Vec3::ZERO, Vec3::X), None);
}

fn equal(count: usize) -> Asset {
    let positions = [vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 1.0), vec3(0.0, 1.0, 1.0)].repeat(count);
    Mesh { positions, ..Mesh::default() }.into()
}

#[test]
fn of_equal_distances_the_first_face_is_hit() {
    let hit = equal(50).raycast(vec3(0.25, 0.25, 0.0), 3.0 * Vec3::Z);
    assert_eq!(hit, Some(Hit { face: 0, distance: 1.0 }));
}

#[test]
fn neither_backdrop_nor_damaged_faces_are_hit() {
    let origin = vec3(0.25, 0.25, 0.0);
    let direction = Vec3::Z;
    let mut asset = equal(2);
    asset.mesh.positions[0].z = f32::NAN;
    assert_eq!(asset.raycast(origin, direction).map(|hit| hit.face), Some(1));
    asset.provenance = Provenance { backdrop_faces: 1, ..Provenance::default() };
    assert_eq!(asset.clone().raycast(origin, direction), None);
    assert_eq!(asset.raycast(origin, direction), None, "the tree of more faces is not used");
}
