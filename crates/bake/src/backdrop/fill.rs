//! Continues a picture of everything around to directions that nobody looked at, without an edge.
//!
//! ```text
//! minimise Σ_texels w (u - d)² + Σ_neighbours (u - u')²
//! ```
//!
//! with d the known colours, w their weights, and neighbours on the sphere: texels of a row are nearer to each other towards the poles. Coarse
//! pictures begin, finer ones continue from them, so that few rounds suffice.

use super::known::Known;

/// Rounds at each size.
const ROUNDS: usize = 16;
/// Rows of the coarsest picture.
const LEAST_ROWS: usize = 8;

/// The whole picture, sRGB-encoded, 0 to 255. `known` has twice as many columns as rows, a power of two. `[H * W]`
pub(super) fn fill(known: Known) -> Vec<[f32; 3]> {
    let mut sizes = vec![known];
    while let Some(finest) = sizes.last().filter(|known| known.rows > LEAST_ROWS) {
        sizes.push(finest.halved());
    }
    let mut filled: Option<Vec<[f32; 3]>> = None;
    for known in sizes.iter().rev() {
        let mut values = match filled {
            Some(coarse) => doubled(&coarse, known.rows),
            None => vec![known.mean(); known.values.len()],
        };
        let links = Links::new(known.rows);
        for _ in 0..ROUNDS {
            [0, 1].into_iter().for_each(|parity| relax(&mut values, known, &links, parity));
        }
        filled = Some(values);
    }
    filled.unwrap_or_default()
}

/// The picture with twice as many rows and columns, interpolated.
fn doubled(coarse: &[[f32; 3]], rows: usize) -> Vec<[f32; 3]> {
    let (height, width) = (rows / 2, rows);
    let at = |row: usize, column: usize| coarse[row.min(height - 1) * width + column % width];
    let value = |i: usize| {
        let (row, column) = (i / (2 * rows), i % (2 * rows));
        // A texel lies a quarter of a coarse one from the middle of its own, towards a neighbour.
        let beside = |i: usize, count: usize| {
            if i.is_multiple_of(2) { (i / 2 + count - 1) % count } else { i / 2 + 1 }
        };
        let other_row = if row == 0 { 0 } else { beside(row, usize::MAX / 2) };
        let other = beside(column, width);
        let (row, column) = (row / 2, column / 2);
        let corners = [at(row, column), at(row, other), at(other_row, column), at(other_row, other)];
        let mix = |c: usize| {
            let [own, along, down, both] = corners.map(|corner| corner[c]);
            (9.0 * own + 3.0 * (along + down) + both) / 16.0
        };
        [mix(0), mix(1), mix(2)]
    };
    (0..2 * rows * rows).map(value).collect()
}

/// How strongly the texels of each row are tied to their neighbours.
struct Links {
    along: Vec<f32>,
    above: Vec<f32>,
    below: Vec<f32>,
}

impl Links {
    fn new(rows: usize) -> Self {
        let sine = |row: f64| libm::sin(row / rows as f64 * std::f64::consts::PI);
        let of_rows = |link: &dyn Fn(f64) -> f64| (0..rows).map(|row| link(row as f64) as f32).collect();
        Self {
            along: of_rows(&|row| sine(row + 0.5).powi(-1)),
            above: of_rows(&|row| sine(row).max(0.0)),
            below: of_rows(&|row| sine(row + 1.0).max(0.0)),
        }
    }
}

/// Solves every second texel for its neighbours.
fn relax(values: &mut [[f32; 3]], known: &Known, links: &Links, parity: usize) {
    let (rows, columns) = (known.rows, 2 * known.rows);
    for row in 0..rows {
        let (along, above, below) = (links.along[row], links.above[row], links.below[row]);
        let [up, down] = [row.saturating_sub(1) * columns, (row + 1).min(rows - 1) * columns];
        let own = row * columns;
        for column in ((row + parity) % 2..columns).step_by(2) {
            let i = own + column;
            let left = values[own + (column + columns - 1) % columns];
            let right = values[own + (column + 1) % columns];
            let (over, under) = (values[up + column], values[down + column]);
            let weight = known.weights[i];
            let per = 1.0 / (2.0 * along + above + below + weight);
            for c in 0..3 {
                let pulled = along * (left[c] + right[c]) + above * over[c] + below * under[c];
                values[i][c] = (pulled + weight * known.values[i][c]) * per;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_stays_and_the_rest_has_no_edge() {
        let rows = 64;
        let mut known = Known::nothing(rows);
        // A bright cap above, a dark one below, and a red patch between them.
        for row in 0..rows {
            for column in 0..2 * rows {
                let color = match (row, column) {
                    (0..12, _) => [200.0; 3],
                    (52.., _) => [40.0; 3],
                    (28..34, 30..40) => [180.0, 20.0, 20.0],
                    _ => continue,
                };
                (known.values[row * 2 * rows + column], known.weights[row * 2 * rows + column]) =
                    (color, 50.0);
            }
        }
        let kept = known.clone();
        let filled = fill(known);
        for (i, value) in filled.iter().enumerate() {
            let (row, column) = (i / (2 * rows), i % (2 * rows));
            if kept.weights[i] > 0.0 {
                assert!((value[1] - kept.values[i][1]).abs() < 12.0, "{row} {column} {value:?}");
                continue;
            }
            let right = filled[row * 2 * rows + (column + 1) % (2 * rows)];
            let below = filled[(row + 1) * 2 * rows + column];
            for c in 0..3 {
                let step = (value[c] - right[c]).abs().max((value[c] - below[c]).abs());
                assert!(step < 40.0 && (20.0..=200.0).contains(&value[c]), "{row} {column} {value:?}");
            }
        }
        // Far from the patch the colour is that of the height.
        let middle = filled[32 * 2 * rows + 100];
        assert!((middle[0] - 120.0).abs() < 12.0, "{middle:?}");
    }

    #[test]
    fn nothing_known_is_one_colour() {
        assert!(fill(Known::nothing(16)).iter().all(|value| *value == [0.0; 3]));
    }
}
