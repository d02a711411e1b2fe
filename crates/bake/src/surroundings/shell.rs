//! The shell of a trained scene as its backdrop.
//!
//! Training closes a scene with a shell of triangles where it has no points. As part of the scene,
//! the shell would be an opaque ball for viewers, which look from outside. As the backdrop it is
//! visible from within only. Training flags the triangles of its shell ([`Mesh::shell`]); they are
//! never guessed from their place. Other programs close their scenes with sky domes without such a
//! flag. These are recognised by four signs that no wall shows.

use super::backdrop::BackdropWhen;
use super::sky::close_surface;
use crate::budget::TriangleBudget;
use glam::Vec3;
use std::collections::HashMap;
use trisplat_raster::framing::far_shell;
use trisplat_scene::Scene;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::{mean, place_bits};
use trisplat_scene::mesh::{Colors, Mesh};

/// Maximum number of triangles of a shell cut into quarters: surroundings are out of focus, so more
/// gain nothing.
const MAX_QUARTERS: usize = 8192;
/// Minimum triangles of the scene for each triangle of a cut shell.
const SCENE_PER_QUARTER: usize = 2;
/// Radius of a surface of few, large triangles, as a multiple of the scene's: the middles of
/// triangles are nearer than their corners.
const RADIUS_FACTOR: f32 = 1.25;

/// Flags the far shell of a soup whose file has no flags.
pub(crate) fn recognise_shell(scene: &mut Scene, when: BackdropWhen) {
    let Scene::Soup(soup) = scene else { return };
    if when == BackdropWhen::Off || soup.shell_count() > 0 {
        return;
    }
    soup.shell = far_shell(|triangle| soup.vertices[triangle], soup.len()).unwrap_or_default();
}

/// Takes the faces of the shell out of `mesh`, their fronts towards the middle: that of `cameras`,
/// or its own.
pub(crate) fn take_shell(mesh: &mut Mesh, cameras: &[Camera]) -> Mesh {
    let mut shell = mesh.take_shell();
    shell.shell.clear();
    let middle = shell_center(&shell, cameras);
    for face in 0..shell.face_count() {
        if shell.flat_normal(face).dot(middle - shell.centroid(face)) < 0.0 {
            shell.flip(face);
        }
    }
    shell
}

/// True if a `shell` cut into quarters has room beside the `scene_faces` of the scene, within the
/// `budget` too.
pub(crate) fn has_room_for_quarters(
    shell: &Mesh,
    scene_faces: usize,
    budget: &TriangleBudget,
) -> bool {
    let quarters = 4 * shell.face_count();
    let fits_total = budget.total.is_none_or(|total| (scene_faces + quarters) as u64 <= total);
    let fits = fits_total && budget.surroundings.is_none_or(|budget| quarters as u64 <= budget);
    quarters <= MAX_QUARTERS && quarters * SCENE_PER_QUARTER <= scene_faces && fits
}

/// Cuts each face of `shell` into four. Each vertex gets the mean colour of the faces that it is
/// part of, so colours run softly; faces of one colour each look like gems.
pub(crate) fn quarter_faces(shell: &Mesh) -> Mesh {
    let mut sums: HashMap<[u32; 3], (Vec3, f32)> = HashMap::new();
    let mut positions = Vec::with_capacity(12 * shell.face_count());
    for face in 0..shell.face_count() {
        let [a, b, c] = shell.corners(face);
        let colors = shell.corner_colors(face).map(Vec3::from);
        // Neighbours compute the same middle of their edge, bit for bit.
        let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
        positions.extend([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]);
        for place in [a, b, c, ab, bc, ca] {
            let (sum, count) = sums.entry(place_bits(place)).or_default();
            *sum += (colors[0] + colors[1] + colors[2]) / 3.0;
            *count += 1.0;
        }
    }
    let color = |place: &Vec3| {
        let (sum, count) = sums[&place_bits(*place)];
        (sum / count).to_array()
    };
    let colors = Colors::Vertex(positions.iter().map(color).collect());
    let opacity = shell.opacity.iter().flat_map(|opacity| [*opacity; 4]).collect();
    Mesh { positions, colors, opacity, ..Mesh::default() }
}

/// The middle of `cameras`, or that of `shell`: where it is open to one side, this may lie behind
/// some of it.
pub(crate) fn shell_center(shell: &Mesh, cameras: &[Camera]) -> Vec3 {
    if cameras.is_empty() {
        mean((0..shell.face_count()).map(|face| shell.centroid(face)))
    } else {
        mean(cameras.iter().map(Camera::position))
    }
}

/// Surroundings of at most `max_faces` triangles around a scene with these corners: a closed
/// surface of fewer, larger ones. Empty where so few close nothing.
pub(crate) fn simplified_shell(
    shell: &Mesh,
    corners: impl Iterator<Item = Vec3>,
    cameras: &[Camera],
    max_faces: u64,
) -> Mesh {
    let center = shell_center(shell, cameras);
    let reach = corners.map(|corner| corner.distance(center)).fold(0.0, f32::max);
    close_surface(shell, center, RADIUS_FACTOR * reach, max_faces).unwrap_or_default()
}

/// Faces of the shell in `mesh` that stay even if unseen, because a shell with holes closes
/// nothing. All of them, unless the mesh exceeds `budget` and the shell more than its part of it:
/// small budgets are spent on visible triangles. `[F]`, or empty for none.
pub(crate) fn protected_faces(mesh: &Mesh, budget: &TriangleBudget) -> Vec<bool> {
    let shell_faces = mesh.shell.iter().filter(|is_shell| **is_shell).count();
    let limit = budget.surroundings_among(mesh.face_count());
    if shell_faces > 0 && limit.is_none_or(|limit| shell_faces as u64 <= limit) {
        mesh.shell.clone()
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An octahedron of radius 10 as a shell, wound outward, and `within` triangles near its
    /// middle.
    fn scene(within: usize) -> Mesh {
        let faces = (0..8).map(|i| {
            let sign = |axis: usize| if i >> axis & 1 == 0 { 10.0 } else { -10.0 };
            let [x, y, z] = [Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)];
            if (y - x).cross(z - x).dot(x) > 0.0 { [x, y, z] } else { [x, z, y] }
        });
        let inner = (0..within)
            .map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::X * (i as f32 / 100.0)));
        let triangles: Vec<[Vec3; 3]> = faces.chain(inner).collect();
        Mesh {
            colors: Colors::Face(vec![[0.5; 3]; triangles.len()]),
            shell: (0..triangles.len()).map(|face| face < 8).collect(),
            positions: triangles.into_flattened(),
            ..Mesh::default()
        }
    }

    #[test]
    fn sky_takes_the_shell_and_leaves_what_leans_against_it() {
        let mut mesh = scene(1);
        // In the plane of a triangle of the shell: only the flag tells them apart.
        let leaning = Mesh { shell: Vec::new(), ..scene(0).part(&[0]) };
        mesh.append(leaning.clone()).unwrap();
        let shell = take_shell(&mut mesh, &[]);
        assert_eq!((shell.face_count(), mesh.face_count()), (8, 2));
        assert_eq!(mesh.corners(1), leaning.corners(0));
        assert!(
            (0..8).all(|f| shell.flat_normal(f).dot(shell.centroid(f)) < 0.0),
            "fronts are inside"
        );
        assert!(mesh.shell.is_empty() && shell.shell.is_empty());
        assert_eq!(take_shell(&mut mesh, &[]).face_count(), 0);
    }

    #[test]
    fn a_cut_shell_has_the_same_surface_in_quarters_and_no_gap() {
        let shell = take_shell(&mut scene(0), &[]);
        let quarters = quarter_faces(&shell);
        assert_eq!(quarters.face_count(), 4 * shell.face_count());
        let mut edges = HashMap::new();
        for face in 0..quarters.face_count() {
            let part = quarters.area(face);
            let whole = shell.area(face / 4);
            assert!((4.0 * part - whole).abs() < 1e-4 * whole, "{part} of {whole}");
            assert!(quarters.flat_normal(face).dot(shell.flat_normal(face / 4)) > 0.999);
            let corners = quarters.corners(face).map(place_bits);
            for k in 0..3 {
                *edges.entry((corners[k], corners[(k + 1) % 3])).or_insert(0) += 1;
            }
        }
        // Every edge has a neighbour on its other side.
        assert!(
            edges.iter().all(|((a, b), count)| *count == 1 && edges.get(&(*b, *a)) == Some(&1))
        );
    }

    #[test]
    fn colours_of_a_cut_shell_run_from_face_to_face() {
        let mut shell = take_shell(&mut scene(0), &[]);
        shell.colors = Colors::Face((0..8).map(|face| [face as f32 / 8.0; 3]).collect());
        let quarters = quarter_faces(&shell);
        let mut at = HashMap::new();
        for face in 0..quarters.face_count() {
            for (place, color) in
                quarters.corners(face).into_iter().zip(quarters.corner_colors(face))
            {
                let first = *at.entry(place_bits(place)).or_insert(color);
                assert_eq!(first, color, "{place}");
            }
        }
        // The middle of an edge is between its two faces, and the middle of the shell's colours
        // stays.
        assert_eq!(at.len(), 18);
        let mean = at.values().map(|color| color[0]).sum::<f32>() / 18.0;
        assert!((mean - 3.5 / 8.0).abs() < 1e-6, "{mean}");
    }

    #[test]
    fn a_shell_is_cut_only_where_there_is_room() {
        let has_room = |shell: &Mesh, scene_faces: usize, total: Option<u64>| {
            has_room_for_quarters(shell, scene_faces, &TriangleBudget::new(total))
        };
        let shell = take_shell(&mut scene(0), &[]);
        assert!(has_room(&shell, 64, None) && !has_room(&shell, 63, None));
        assert!(has_room(&shell, 64, Some(256)) && !has_room(&shell, 64, Some(255)), "an eighth");
        assert!(has_room(&shell, 300, Some(332)) && !has_room(&shell, 300, Some(331)));
        let mut large = shell;
        while has_room(&large, 1 << 20, None) {
            large = quarter_faces(&large);
        }
        assert_eq!(large.face_count(), 8192);
    }

    #[test]
    fn a_shell_is_kept_whole_unless_it_is_a_large_part_of_a_budget() {
        let mut whole = scene(100);
        for (budget, count) in
            [(None, 8), (Some(108), 8), (Some(107), 8), (Some(64), 8), (Some(63), 0)]
        {
            let faces = protected_faces(&whole, &TriangleBudget::new(budget));
            assert_eq!(faces.iter().filter(|face| **face).count(), count, "{budget:?}");
            assert!(faces.iter().skip(8).all(|face| !face), "{budget:?}");
            assert_eq!(faces.is_empty(), count == 0, "{budget:?}");
        }
        whole.shell.clear();
        assert!(
            protected_faces(&whole, &TriangleBudget::new(Some(64))).is_empty(),
            "room is left for another backdrop"
        );
    }
}
