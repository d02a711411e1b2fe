//! Smoothing: vertices move towards the middle of their neighbours, those of a border along it.

use glam::Vec3;
use rayon::prelude::*;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

/// The way towards the middle of the neighbours, and ...
const SHRINK: f32 = 0.5;
/// ... back, as shares of it.
const GROW: f32 = -0.53;
/// Rounds for borders: teeth of a cell or two vanish, and an outline stays where it is.
const BORDER_ROUNDS: u32 = 10;

/// Smooths an indexed mesh `rounds` times.
pub(super) fn smooth(mesh: &mut Mesh, rounds: u32) {
    if rounds == 0 || mesh.face_count() == 0 {
        return;
    }
    let neighbours = Neighbours::of(mesh);
    for share in (0..rounds).flat_map(|_| [SHRINK, GROW]) {
        neighbours.move_vertices(mesh, share, |vertex| !neighbours.around(vertex).is_empty());
    }
}

/// Smooths the borders of an indexed mesh, which are as ragged as the cells that were observed.
/// Vertices where borders touch stay.
pub(super) fn smooth_border(mesh: &mut Mesh) {
    let neighbours = Neighbours::of(mesh);
    let moves =
        |vertex: usize| neighbours.on_border[vertex] && neighbours.around(vertex).len() == 2;
    for _ in 0..BORDER_ROUNDS {
        neighbours.move_vertices(mesh, SHRINK, moves);
    }
}

/// The vertices that each one moves with: those it shares an edge with; of the border, those along
/// it.
struct Neighbours {
    first: Vec<u32>,
    all: Vec<u32>,
    on_border: Vec<bool>,
}

impl Neighbours {
    fn of(mesh: &Mesh) -> Self {
        let mut sides: Vec<(u32, u32)> = mesh
            .indices
            .as_chunks::<3>()
            .0
            .iter()
            .flat_map(|[a, b, c]| [(*a, *b), (*b, *a), (*b, *c), (*c, *b), (*c, *a), (*a, *c)])
            .collect();
        sides.par_sort_unstable();
        // Of an edge, the number of faces.
        let runs: Vec<((u32, u32), usize)> =
            sides.chunk_by(|a, b| a == b).map(|run| (run[0], run.len())).collect();
        let mut on_border = vec![false; mesh.vertex_count()];
        for ((from, _), _) in runs.iter().filter(|(_, faces)| *faces == 1) {
            on_border[*from as usize] = true;
        }
        let counts =
            |((from, _), faces): &&((u32, u32), usize)| *faces == 1 || !on_border[*from as usize];
        let pairs: Vec<(u32, u32)> = runs.iter().filter(counts).map(|run| run.0).collect();
        let first = (0..=mesh.vertex_count() as u32)
            .map(|v| pairs.partition_point(|pair| pair.0 < v) as u32);
        let all = pairs.iter().map(|pair| pair.1).collect();
        Self { first: first.collect(), all, on_border }
    }

    fn around(&self, vertex: usize) -> &[u32] {
        &self.all[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// Moves the vertices that `moves` selects by a share of their way to the middle of their
    /// neighbours.
    fn move_vertices(&self, mesh: &mut Mesh, share: f32, moves: impl Fn(usize) -> bool + Sync) {
        let at = &mesh.positions;
        let positions = parallel::collect(at.len(), 1 << 10, |vertex| {
            if !moves(vertex) {
                return at[vertex];
            }
            let others = self.around(vertex);
            let middle = others.iter().map(|o| at[*o as usize]).sum::<Vec3>() / others.len() as f32;
            at[vertex].lerp(middle, share)
        });
        mesh.positions = positions;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::mesh::Colors;

    /// A sheet of `side` by `side` squares whose inner heights are noise of up to `noise`.
    fn sheet(side: u32, noise: f32) -> Mesh {
        let at = |x: u32, y: u32| y * (side + 1) + x;
        let mut mesh = Mesh::default();
        for (y, x) in (0..=side).flat_map(|y| (0..=side).map(move |x| (y, x))) {
            let inner = x > 0 && y > 0 && x < side && y < side;
            let code = (x * 7919 + y * 104_729) % 17;
            let height = if inner { noise * (code as f32 / 8.0 - 1.0) } else { 0.0 };
            mesh.positions.push(Vec3::new(x as f32, y as f32, height));
        }
        mesh.colors = Colors::Vertex(vec![[0.5; 3]; mesh.positions.len()]);
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            mesh.indices.extend([a, b, c, a, c, d]);
        }
        mesh
    }

    #[test]
    fn noise_goes_and_the_outline_stays() {
        let mut mesh = sheet(20, 0.4);
        let roughness = |mesh: &Mesh| mesh.positions.iter().map(|p| p.z * p.z).sum::<f32>();
        let before = roughness(&mesh);
        smooth(&mut mesh, 8);
        assert!(roughness(&mesh) < 0.2 * before, "{} of {before}", roughness(&mesh));
        let high = mesh.positions.iter().copied().fold(Vec3::ZERO, Vec3::max);
        assert!((high.x - 20.0).abs() < 1.0 && (high.y - 20.0).abs() < 1.0, "{high}");
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
    }
}

#[cfg(test)]
mod border_tests {
    use super::*;
    use crate::fill::tests::sheet;

    #[test]
    fn teeth_of_a_border_vanish_and_the_rest_stays() {
        // Every second cell of the last row is missing.
        let mut mesh = sheet(20, &[0, 2, 4, 6, 8, 10, 12, 14, 16, 18].map(|x| (x, 19)));
        let whole = mesh.positions.clone();
        smooth_border(&mut mesh);
        let is_near = |v: usize, from: f32, to: f32| (from..=to).contains(&whole[v].y);
        let of_row = |row: f32| (0..whole.len()).filter(move |v| is_near(*v, row, row));
        // Away from the corners, which become round.
        let height = |v: usize| (5.0..16.0).contains(&whole[v].x).then(|| mesh.positions[v].y);
        let teeth: Vec<f32> = of_row(19.0).chain(of_row(20.0)).filter_map(height).collect();
        let [low, high] = [f32::min, f32::max].map(|of| teeth.iter().copied().reduce(of).unwrap());
        assert!(high - low < 0.1, "{low} to {high}");
        assert!((19.4..19.6).contains(&((low + high) / 2.0)), "{low} to {high}");
        let inside = (0..whole.len())
            .filter(|&v| is_near(v, 1.0, 18.0) && (1.0..=19.0).contains(&whole[v].x));
        assert!(inside.clone().count() > 300);
        assert!(inside.into_iter().all(|v| mesh.positions[v] == whole[v]));
    }

    #[test]
    fn a_vertex_where_borders_touch_stays() {
        let mut mesh = sheet(20, &[(9, 9), (10, 10)]);
        let touching = mesh.positions.iter().position(|at| *at == Vec3::new(10.0, 10.0, 1.0));
        smooth_border(&mut mesh);
        assert_eq!(mesh.positions[touching.unwrap()], Vec3::new(10.0, 10.0, 1.0));
    }
}
