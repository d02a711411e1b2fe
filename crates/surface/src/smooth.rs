//! Takes the noise of depths off a surface: its vertices move towards the middle of their neighbours and part of the way back, which keeps
//! its size (Taubin 1995). Borders move along themselves only.

use glam::Vec3;
use rayon::prelude::*;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

/// The way towards the middle of the neighbours, and ...
const SHRINK: f32 = 0.5;
/// ... back, as shares of it.
const GROW: f32 = -0.53;

/// Smooths an indexed mesh `rounds` times.
pub(super) fn smooth(mesh: &mut Mesh, rounds: u32) {
    if rounds == 0 || mesh.face_count() == 0 {
        return;
    }
    let neighbours = Neighbours::of(mesh);
    for share in (0..rounds).flat_map(|_| [SHRINK, GROW]) {
        let at = &mesh.positions;
        let moved = parallel::collect(at.len(), 1 << 10, |v| {
            let others = neighbours.around(v);
            let middle = others.iter().map(|o| at[*o as usize]).sum::<Vec3>() / others.len().max(1) as f32;
            if others.is_empty() { at[v] } else { at[v].lerp(middle, share) }
        });
        mesh.positions = moved;
    }
}

/// The vertices that each one moves with: those it shares an edge with; of the border, those along it.
struct Neighbours {
    first: Vec<u32>,
    all: Vec<u32>,
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
        runs.iter().filter(|run| run.1 == 1).for_each(|run| on_border[run.0.0 as usize] = true);
        let counts = |((from, _), faces): &&((u32, u32), usize)| *faces == 1 || !on_border[*from as usize];
        let pairs: Vec<(u32, u32)> = runs.iter().filter(counts).map(|run| run.0).collect();
        let first = (0..=mesh.vertex_count() as u32).map(|v| pairs.partition_point(|pair| pair.0 < v) as u32);
        Self { first: first.collect(), all: pairs.iter().map(|pair| pair.1).collect() }
    }

    fn around(&self, vertex: usize) -> &[u32] {
        &self.all[self.first[vertex] as usize..self.first[vertex + 1] as usize]
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
