//! Which trainings are worth their time: every number of triangles with ever more steps, until the next would take more than the budget.

use super::cell::CostCell;
use trisplat_scene::{Error, Result};

/// The first number of steps, and what is beyond the last; each is twice the one before.
const STEPS: (u64, u64) = (250, 1 << 24);
/// First number of triangles, and the end; there are two numbers per decade.
const TRIANGLES: (u64, u64) = (3000, 30_000_000);
/// More triangles are tried while they gain as much at the end of the row, dB.
const LEAST_GAIN: f64 = 0.05;

/// The steps and triangles to try, both ascending.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grid {
    pub(super) steps: Vec<u64>,
    pub(super) triangles: Vec<u64>,
    /// Most CPU seconds of a training.
    pub(super) budget: f64,
}

impl Grid {
    /// Of what is given; the usual ones where nothing is.
    ///
    /// Errors: lists that do not ascend.
    pub(super) fn new(steps: &[u64], triangles: &[u64], budget: f64) -> Result<Self> {
        let checked = |option: &str, list: &[u64], usual: &dyn Fn() -> Vec<u64>| match list {
            [] => Ok(usual()),
            list if list.is_sorted_by(|a, b| a < b) => Ok(list.to_vec()),
            list => {
                let list: Vec<String> = list.iter().map(u64::to_string).collect();
                Err(Error::invalid(option, list.join(","), "numbers that ascend, each given once"))
            }
        };
        let doubled = || std::iter::successors(Some(STEPS.0), |n| Some(2 * n)).take_while(|n| *n < STEPS.1);
        let thirds = || {
            let decades = std::iter::successors(Some(TRIANGLES.0), |n| Some(10 * n));
            decades.flat_map(|n| [n, 10 * n / 3]).take_while(|n| *n < TRIANGLES.1)
        };
        Ok(Self {
            steps: checked("steps", steps, &|| doubled().collect())?,
            triangles: checked("max_triangles", triangles, &|| thirds().collect())?,
            budget,
        })
    }

    /// Measures cells by `train`, given steps and triangles. The first is measured whatever it takes.
    ///
    /// Errors: those of `train`.
    pub(super) fn measure(
        &self,
        mut train: impl FnMut(u64, u64) -> Result<CostCell>,
    ) -> Result<Vec<CostCell>> {
        let mut cells: Vec<CostCell> = Vec::new();
        let mut best = f64::NEG_INFINITY;
        for triangles in &self.triangles {
            let before = cells.len();
            for steps in &self.steps {
                if self.expected(&cells, *steps, *triangles).is_some_and(|seconds| seconds > self.budget) {
                    break;
                }
                cells.push(train(*steps, *triangles)?);
            }
            let row = cells[before..].iter().map(|cell| cell.psnr).fold(f64::NEG_INFINITY, f64::max);
            // A row that nothing fits in, or that gains nothing, is the last: larger ones gain less in this time.
            if !(row > best + LEAST_GAIN) {
                break;
            }
            best = row;
        }
        Ok(cells)
    }

    /// The seconds that a training should take, at least: in proportion to its steps after one with fewer, as long as with fewer triangles.
    /// `None` of the first.
    fn expected(&self, cells: &[CostCell], steps: u64, triangles: u64) -> Option<f64> {
        let shorter = cells.iter().rev().find(|cell| cell.max_triangles == triangles);
        let shorter = shorter.map(|cell| cell.cpu_seconds * steps as f64 / cell.steps as f64);
        let smaller = cells.iter().rev().find(|cell| cell.steps == steps).map(|cell| cell.cpu_seconds);
        shorter.or(smaller)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::cell::CostRun;

    /// A training that takes a second for a million steps times triangles, and gains less the more it has.
    fn cell(steps: u64, triangles: u64) -> Result<CostCell> {
        let cpu_seconds = (steps * triangles) as f64 * 1e-6;
        let psnr = 30.0 - 1000.0 / steps as f64 - 9000.0 / triangles as f64;
        Ok(CostCell::new(
            steps,
            triangles,
            vec![CostRun { seed: 0, cpu_seconds, triangles, psnr, ssim: 0.9 }],
        ))
    }

    #[test]
    fn no_training_takes_more_than_the_budget_and_rows_end_where_triangles_gain_nothing() {
        let grid = Grid::new(&[], &[], 30.0).unwrap();
        assert_eq!(
            (&grid.steps[..3], &grid.triangles[..3]),
            (&[250, 500, 1000][..], &[3000, 10_000, 30_000][..])
        );
        let cells = grid.measure(cell).unwrap();
        assert!(cells.iter().all(|cell| cell.cpu_seconds <= 30.0));
        let rows: Vec<usize> =
            grid.triangles.iter().map(|t| cells.iter().filter(|c| c.max_triangles == *t).count()).collect();
        // 8000, 2000, 1000 and 250 steps fit; with 100,000 triangles these are too few.
        assert_eq!(rows[..5], [6, 4, 3, 1, 0]);
    }

    #[test]
    fn what_is_given_is_tried_as_far_as_it_fits() {
        let grid = Grid::new(&[100, 1000], &[1000, 2000], 1.0).unwrap();
        let cells = grid.measure(cell).unwrap();
        let tried: Vec<(u64, u64)> = cells.iter().map(|cell| (cell.steps, cell.max_triangles)).collect();
        assert_eq!(tried, [(100, 1000), (1000, 1000), (100, 2000)]);
        assert_eq!(Grid::new(&[100], &[2000], 1e-9).unwrap().measure(cell).unwrap().len(), 1);
        let message = Grid::new(&[100, 100], &[], 1.0).unwrap_err().to_string();
        assert!(message.contains("steps is 100,100"), "{message}");
    }
}
