//! The closed surface behind a scene: rows and columns of a sphere whose distance changes gently with direction.
//!
//! In each direction it lies where the shell of a training is, which stands where walls are; without one, behind the scene. A far place raises
//! what is around it, so that no spike shows.

use glam::{Mat3, Vec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::{Colors, Mesh};

/// Fewest and most rows.
const ROWS: [u32; 2] = [6, 16];
/// The surface has at most one triangle per this many of the scene, unless it has the fewest rows.
const SCENE_PER_BACKDROP: u64 = 20;
/// Distance from the middle, as a multiple of that of the farthest thing.
const BEHIND: f32 = 1.02;
/// Rounds in which directions without anything take the mean distance of their neighbours.
const ROUNDS: usize = 200;
/// Largest slope of the logarithm of the distance, per radian of direction.
const STEEPEST: f32 = 0.8;
/// Rounds in which every direction moves half way to the mean of its neighbours.
const SMOOTHING: usize = 3;

/// Triangles of a surface with this many rows.
fn triangles(rows: u32) -> u64 {
    4 * u64::from(rows) * u64::from(rows - 1)
}

/// Rows of the surface behind a scene of `faces` triangles.
pub(super) fn rows(faces: usize) -> u32 {
    let fits = |rows: &u32| triangles(*rows) * SCENE_PER_BACKDROP <= faces as u64;
    (ROWS[0]..=ROWS[1]).rev().find(fits).unwrap_or(ROWS[0])
}

/// Triangles of the surface behind a scene of `faces` triangles.
pub(super) fn face_count(faces: usize) -> u64 {
    triangles(rows(faces))
}

/// The directions of a picture of everything around a place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Around {
    /// Its middle.
    pub(crate) center: Vec3,
    /// From right, up and back to the world: a rotation.
    pub(crate) axes: Mat3,
}

impl Around {
    /// Upright for most of `cameras`.
    pub(super) fn upright(center: Vec3, cameras: &[Camera]) -> Self {
        let up = cameras.iter().map(|camera| -camera.rotation.row(1)).sum::<Vec3>();
        let up = up.try_normalize().unwrap_or(Vec3::Y);
        let right = up.any_orthonormal_vector();
        Self { center, axes: Mat3::from_cols(right, up, right.cross(up)) }
    }

    /// The direction of a place of the picture: (0, 0) is its upper left corner, (1, 1) its lower right one. The first column is left, a
    /// quarter of the way is ahead, the middle is right, as three.js has it.
    pub(crate) fn direction(&self, place: Vec2) -> Vec3 {
        let turn = (f64::from(place.x) - 0.5) * std::f64::consts::TAU;
        let down = f64::from(place.y) * std::f64::consts::PI;
        let (sine, cosine) = libm::sincos(turn);
        let (across, up) = libm::sincos(down);
        self.axes * Vec3::new((across * cosine) as f32, up as f32, (across * sine) as f32)
    }

    /// The place of a direction.
    pub(crate) fn place(&self, direction: Vec3) -> Vec2 {
        let [x, y, z] = (self.axes.transpose() * direction).normalize_or(Vec3::Y).to_array().map(f64::from);
        let turn = libm::atan2(z, x) / std::f64::consts::TAU + 0.5;
        Vec2::new(turn as f32, (libm::acos(y.clamp(-1.0, 1.0)) / std::f64::consts::PI) as f32)
    }
}

/// What the surface stands behind.
pub(super) struct Shape<'a> {
    pub(super) scene: &'a Mesh,
    /// Where walls and sky are.
    pub(super) shell: Option<&'a Mesh>,
    /// Least distance from the middle.
    pub(super) least: f32,
}

/// The surface around `shape`, with the places of its corners on a picture of everything around; fronts are inside. `[F]`
pub(super) fn surface(around: &Around, rows: u32, shape: &Shape) -> (Mesh, Vec<[Vec2; 3]>) {
    let grid = Grid::new(around, rows);
    let distances = grid.distances(around, shape);
    let columns = 2 * rows;
    let at = |row: u32, column: u32| {
        let i = grid.index(row, column);
        around.center + grid.directions[i] * distances[i]
    };
    let place = |row: u32, column: f32| Vec2::new(column / columns as f32, row as f32 / rows as f32);
    let (mut positions, mut uvs) = (Vec::new(), Vec::new());
    for row in 0..rows {
        for column in 0..columns {
            let [left, right] = [column as f32, column as f32 + 1.0];
            let corners = [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)];
            let [a, b, c, d] = corners.map(|(row, column)| at(row, column));
            // All columns meet in a pole.
            let pole = (left + right) / 2.0;
            if row > 0 {
                positions.extend([a, c, b]);
                let below = if row + 1 < rows { left } else { pole };
                uvs.push([place(row, left), place(row + 1, below), place(row, right)]);
            }
            if row + 1 < rows {
                positions.extend([b, c, d]);
                let above = if row > 0 { right } else { pole };
                uvs.push([place(row, above), place(row + 1, left), place(row + 1, right)]);
            }
        }
    }
    let colors = Colors::Face(vec![[0.0; 3]; uvs.len()]);
    let mut mesh = Mesh { positions, colors, ..Mesh::default() };
    for (face, uvs) in uvs.iter_mut().enumerate() {
        if mesh.flat_normal(face).dot(around.center - mesh.centroid(face)) < 0.0 {
            mesh.flip(face);
            uvs.swap(1, 2);
        }
    }
    (mesh, uvs)
}

/// The directions of the surface's corners, row by row.
struct Grid {
    rows: u32,
    directions: Vec<Vec3>,
}

impl Grid {
    fn new(around: &Around, rows: u32) -> Self {
        let place =
            |row: u32, column: u32| Vec2::new(column as f32 / (2 * rows) as f32, row as f32 / rows as f32);
        // Bitwise one place where all columns meet.
        let pole = |row: u32, column: u32| if row == 0 || row == rows { 0 } else { column };
        let corners = (0..=rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column)));
        let directions = corners.map(|(row, column)| around.direction(place(row, pole(row, column))));
        Self { rows, directions: directions.collect() }
    }

    fn index(&self, row: u32, column: u32) -> usize {
        (row * 2 * self.rows + column % (2 * self.rows)) as usize
    }

    /// The corners beside one, and itself.
    fn beside(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let columns = 2 * self.rows;
        let (row, column) = (i as u32 / columns, i as u32 % columns);
        let [low, high] = [row.saturating_sub(1), (row + 1).min(self.rows)];
        (low..=high).flat_map(move |row| [columns - 1, 0, 1].map(|turn| self.index(row, column + turn)))
    }

    /// The distance of the farthest of `points` in each direction; 0 where there is none.
    fn farthest(&self, around: &Around, points: impl Iterator<Item = Vec3>) -> Vec<f32> {
        let mut far = vec![0.0f32; self.directions.len()];
        for point in points {
            let away = point - around.center;
            let at = around.place(away) * Vec2::new(2.0, 1.0) * self.rows as f32;
            let nearest = self.index(at.y.round() as u32, at.x.round() as u32);
            far[nearest] = far[nearest].max(away.length());
        }
        far
    }

    /// How far the shell is in each direction. Where it has no triangle, or without one, how far the scene is around that direction, though not
    /// farther than the shell anywhere: some triangles lie astray. 0 where there is nothing.
    fn far(&self, around: &Around, shape: &Shape) -> Vec<f32> {
        let of_face = |shell: &Mesh, face: usize| {
            let [a, b, c] = shell.corners(face);
            [a, b, c, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0]
        };
        let on_shell =
            shape.shell.into_iter().flat_map(|s| (0..s.face_count()).flat_map(move |f| of_face(s, f)));
        let shell = self.farthest(around, on_shell);
        let most =
            if shape.shell.is_some() { shell.iter().copied().fold(0.0, f32::max) } else { f32::INFINITY };
        let scene = self.farthest(around, shape.scene.positions.iter().copied());
        let of_scene = |i: usize| self.beside(i).map(|j| scene[j]).fold(0.0, f32::max).min(most);
        (0..shell.len()).map(|i| if shell[i] > 0.0 { shell[i] } else { of_scene(i) }).collect()
    }

    /// The distance of each corner from the middle.
    fn distances(&self, around: &Around, shape: &Shape) -> Vec<f32> {
        let far = self.far(around, shape);
        let known: Vec<f32> = far.iter().copied().filter(|far| *far > 0.0).map(f32::ln).collect();
        let typical = if known.is_empty() { 0.0 } else { known.iter().sum::<f32>() / known.len() as f32 };
        // In logarithms, so that twice and half the distance count equally.
        let mut logs: Vec<f32> = far.iter().map(|far| if *far > 0.0 { far.ln() } else { typical }).collect();
        for _ in 0..ROUNDS {
            self.smooth(&mut logs, |i| far[i] > 0.0);
        }
        self.raise(&mut logs);
        for _ in 0..SMOOTHING {
            self.smooth(&mut logs, |_| false);
        }
        self.join_poles(&mut logs);
        logs.iter().map(|log| (BEHIND * log.exp()).max(shape.least)).collect()
    }

    /// Moves corners that are not `fixed` half way to the mean of their neighbours.
    fn smooth(&self, logs: &mut [f32], fixed: impl Fn(usize) -> bool) {
        let before = logs.to_vec();
        for (i, log) in logs.iter_mut().enumerate().filter(|(i, _)| !fixed(*i)) {
            let (sum, count) =
                self.beside(i).fold((0.0, 0.0), |(sum, count), j| (sum + before[j], count + 1.0));
            *log = (*log + sum / count) / 2.0;
        }
    }

    /// Raises logarithms around far places until no slope exceeds [`STEEPEST`].
    fn raise(&self, logs: &mut [f32]) {
        let mut rises = true;
        while rises {
            rises = false;
            self.join_poles(logs);
            for i in 0..logs.len() {
                for j in self.beside(i) {
                    let turn = self.directions[i].angle_between(self.directions[j]);
                    let least = logs[j] - STEEPEST * turn;
                    // Far above rounding, so that it ends.
                    rises |= least > logs[i] + 1e-4;
                    logs[i] = logs[i].max(least);
                }
            }
        }
    }

    /// A pole has one distance.
    fn join_poles(&self, logs: &mut [f32]) {
        let columns = 2 * self.rows as usize;
        let last = logs.len() - columns;
        for pole in [0..columns, last..last + columns] {
            let most = logs[pole.clone()].iter().copied().fold(f32::MIN, f32::max);
            logs[pole].fill(most);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around() -> Around {
        Around::upright(Vec3::new(1.0, -2.0, 0.5), &[])
    }

    /// Points on a room of half side 2 around the middle, and on a street that is seen through its window, 60 away.
    fn room_and_street() -> Vec<Vec3> {
        let place = |i: u32| Vec2::new((i % 40) as f32 / 40.0, (i / 40) as f32 / 20.0);
        let room = (0..800).map(|i| around().direction(place(i)) * 2.0);
        let street = (0..400).map(|i| Vec3::new((i % 20) as f32 - 10.0, (i / 20) as f32 - 10.0, 60.0));
        room.chain(street).map(|p| p + around().center).collect()
    }

    #[test]
    fn it_is_closed_behind_everything_and_has_no_spike() {
        for rows in [6, 11, 16] {
            let scene = Mesh { positions: room_and_street(), ..Mesh::default() };
            let (mesh, uvs) = surface(&around(), rows, &Shape { scene: &scene, shell: None, least: 0.0 });
            assert_eq!((mesh.face_count() as u64, uvs.len()), (triangles(rows), mesh.face_count()));
            // Every edge has a face on both sides.
            let mut edges = std::collections::BTreeMap::new();
            for face in 0..mesh.face_count() {
                let [a, b, c] = mesh.corners(face).map(|v| v.to_array().map(f32::to_bits));
                [(a, b), (b, c), (c, a)].into_iter().for_each(|edge| *edges.entry(edge).or_insert(0) += 1);
                assert!(mesh.flat_normal(face).dot(around().center - mesh.centroid(face)) > 0.0, "inside");
            }
            assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.contains_key(&(*b, *a))));
            let away: Vec<f32> = mesh.positions.iter().map(|v| v.distance(around().center)).collect();
            let (near, far) = away.iter().fold((f32::MAX, 0.0f32), |(a, b), r| (a.min(*r), b.max(*r)));
            assert!(near > 2.0 && far > 60.0 && near > 0.05 * far, "{near} to {far}");
        }
    }

    #[test]
    fn it_follows_a_shell_and_no_triangle_astray() {
        let at = |distance: f32| {
            let place = |i: u32| Vec2::new((i % 60) as f32 / 60.0, (i / 60) as f32 / 29.0);
            (0..1800).map(move |i| around().center + around().direction(place(i)) * distance)
        };
        let astray = Vec3::new(900.0, 0.0, 0.0);
        let scene = Mesh { positions: at(2.0).chain([astray; 3]).collect(), ..Mesh::default() };
        let shell = Mesh { positions: at(3.0).collect(), ..Mesh::default() };
        let (mesh, _) = surface(&around(), 16, &Shape { scene: &scene, shell: Some(&shell), least: 0.0 });
        let away = mesh.positions.iter().map(|v| v.distance(around().center) / 3.0);
        assert!(away.clone().all(|r| (1.0..1.1).contains(&r)), "{:?}", away.collect::<Vec<_>>());
        let (around_cameras, _) =
            surface(&around(), 16, &Shape { scene: &scene, shell: Some(&shell), least: 5.0 });
        assert!(around_cameras.positions.iter().all(|v| v.distance(around().center) > 4.99));
    }

    #[test]
    fn a_budget_is_kept_and_places_are_directions() {
        assert!(face_count(0) <= 120 && face_count(1 << 20) <= 960);
        for i in 0..200u16 {
            let place = Vec2::new(f32::from(i % 20) / 20.0, (f32::from(i / 20) + 0.5) / 10.0);
            let back = around().place(around().direction(place));
            assert!((back - place).length() < 1e-4, "{place} {back}");
        }
    }
}
