//! Grid of trainings: every number of triangles with ever more steps, until the
//! next would take more than the budget.

use serde::Serialize;
use trisplat_scene::{Error, Result};

/// The first number of steps, and what is beyond the last; each is twice the one before.
const STEPS: (u64, u64) = (250, 1 << 24);
/// First number of triangles, and the end; there are two numbers per decade.
const TRIANGLES: (u64, u64) = (3000, 30_000_000);
/// More triangles are tried while they gain as much at the end of the row, dB.
const MIN_GAIN: f64 = 0.05;

/// The steps and triangles to try, both ascending.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CostGrid {
    pub(super) steps: Vec<u64>,
    pub(super) triangles: Vec<u64>,
    /// Maximum CPU seconds of a training.
    pub(super) budget: f64,
}

impl CostGrid {
    /// Of what is given; the usual ones where nothing is.
    ///
    /// # Errors
    ///
    /// Lists that do not ascend.
    pub(super) fn new(steps: &[u64], triangles: &[u64], budget: f64) -> Result<Self> {
        let checked = |option: &str, list: &[u64], usual: &dyn Fn() -> Vec<u64>| match list {
            [] => Ok(usual()),
            list if list.is_sorted_by(|a, b| a < b) => Ok(list.to_vec()),
            list => {
                let list: Vec<String> = list.iter().map(u64::to_string).collect();
                Err(Error::invalid(option, list.join(","), "numbers that ascend, each given once"))
            }
        };
        let doubled =
            || std::iter::successors(Some(STEPS.0), |n| Some(2 * n)).take_while(|n| *n < STEPS.1);
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

    /// Measures cells by `train`, given steps and triangles. The first is measured whatever it
    /// takes.
    ///
    /// # Errors
    ///
    /// As of `train`.
    pub(super) fn measure(
        &self,
        mut train: impl FnMut(u64, u64) -> Result<CostCell>,
    ) -> Result<Vec<CostCell>> {
        let mut cells: Vec<CostCell> = Vec::new();
        let mut best = f64::NEG_INFINITY;
        for triangles in &self.triangles {
            let before = cells.len();
            for steps in &self.steps {
                if self
                    .expected(&cells, *steps, *triangles)
                    .is_some_and(|seconds| seconds > self.budget)
                {
                    break;
                }
                cells.push(train(*steps, *triangles)?);
            }
            let row =
                cells[before..].iter().map(|cell| cell.psnr).fold(f64::NEG_INFINITY, f64::max);
            // A row that nothing fits in, or that gains nothing, is the last: larger ones gain less
            // in this time.
            if !(row > best + MIN_GAIN) {
                break;
            }
            best = row;
        }
        Ok(cells)
    }

    /// The seconds that a training should take, at least: in proportion to its steps after one with
    /// fewer, as long as with fewer triangles. `None` of the first.
    fn expected(&self, cells: &[CostCell], steps: u64, triangles: u64) -> Option<f64> {
        let shorter = cells.iter().rev().find(|cell| cell.max_triangles == triangles);
        let shorter = shorter.map(|cell| cell.cpu_seconds * steps as f64 / cell.steps as f64);
        let smaller =
            cells.iter().rev().find(|cell| cell.steps == steps).map(|cell| cell.cpu_seconds);
        shorter.or(smaller)
    }
}

/// A training.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct CostRun {
    /// Its seed.
    pub(super) seed: u64,
    /// User and system seconds on all threads: photos, teacher, training and the drawing of the
    /// watched photos.
    pub(super) cpu_seconds: f64,
    /// Triangles at the end.
    pub(super) triangles: u64,
    /// Mean PSNR of the watched photos, dB.
    pub(super) psnr: f64,
    /// Mean SSIM of the watched photos.
    pub(super) ssim: f64,
}

/// All trainings with as many steps and triangles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct CostCell {
    /// `--steps`.
    pub(super) steps: u64,
    /// `--max-triangles`.
    pub(super) max_triangles: u64,
    /// Mean of the runs' CPU seconds.
    pub(super) cpu_seconds: f64,
    /// Mean of their PSNR, dB.
    pub(super) psnr: f64,
    /// Half the width of its 95% band over seeds, dB, from the spread of all cells; absent where
    /// each has one seed.
    pub(super) psnr_band: Option<f64>,
    /// Mean of their SSIM.
    pub(super) ssim: f64,
    /// No cell that costs no more comes closer.
    pub(super) on_front: bool,
    /// One for each seed.
    pub(super) runs: Vec<CostRun>,
}

impl CostCell {
    /// Of runs; band and front come later.
    pub(super) fn new(steps: u64, max_triangles: u64, runs: Vec<CostRun>) -> Self {
        let mean =
            |of: fn(&CostRun) -> f64| runs.iter().map(of).sum::<f64>() / runs.len().max(1) as f64;
        Self {
            steps,
            max_triangles,
            cpu_seconds: mean(|run| run.cpu_seconds),
            psnr: mean(|run| run.psnr),
            psnr_band: None,
            ssim: mean(|run| run.ssim),
            on_front: false,
            runs,
        }
    }

    /// "--steps 500 --max-triangles 3000".
    pub(super) fn options(&self) -> String {
        format!("--steps {} --max-triangles {}", self.steps, self.max_triangles)
    }

    /// Its PSNR with the band: "21.50 ± 0.12".
    pub(super) fn banded(&self) -> String {
        let band = self.psnr_band.map_or(String::new(), |band| format!(" ± {band:.2}"));
        format!("{:.2}{band}", self.psnr)
    }
}

/// Gives cells their bands, and marks those on the front.
pub(super) fn compare(cells: &mut [CostCell]) {
    let values: Vec<Vec<f64>> =
        cells.iter().map(|cell| cell.runs.iter().map(|run| run.psnr).collect()).collect();
    let costs: Vec<(f64, f64)> = cells.iter().map(|cell| (cell.cpu_seconds, cell.psnr)).collect();
    for cell in cells {
        cell.psnr_band = half_band(values.iter().map(Vec::as_slice), cell.runs.len());
        let beaten =
            |(seconds, psnr): &(f64, f64)| *seconds <= cell.cpu_seconds && *psnr > cell.psnr;
        cell.on_front = !costs.iter().any(beaten);
    }
}

/// 97.5% quantiles of Student's t for 1 to 10 degrees of freedom.
const QUANTILES: [f64; 10] =
    [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
/// Its quantile for more: that of the normal variable, and what is left in the inverse of their
/// number, to 0.01.
const MANY: (f64, f64) = (1.960, 2.65);

/// Half the width of the 95% band of a mean of `runs` runs, where `groups` hold the values of runs
/// that differ by their seed only. All groups have one spread, as far as few runs can tell, so it
/// is taken from all of them; `None` where no group has two runs.
fn half_band<'a>(groups: impl Iterator<Item = &'a [f64]>, runs: usize) -> Option<f64> {
    let mut squares = 0.0;
    let mut freedom = 0;
    for group in groups.filter(|group| group.len() > 1) {
        let mean = group.iter().sum::<f64>() / group.len() as f64;
        squares += group.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        freedom += group.len() - 1;
    }
    let quantile = QUANTILES.get(freedom.checked_sub(1)?).copied();
    let quantile = quantile.unwrap_or(MANY.0 + MANY.1 / freedom as f64);
    Some(quantile * (squares / freedom as f64 / runs as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    /// A training that takes a second for a million steps times triangles, and gains less the more
    /// it has.
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
    fn cost_grid_keeps_to_the_budget_and_ends_rows_without_gain() {
        let grid = CostGrid::new(&[], &[], 30.0).unwrap();
        assert_eq!(
            (&grid.steps[..3], &grid.triangles[..3]),
            (&[250, 500, 1000][..], &[3000, 10_000, 30_000][..])
        );
        let cells = grid.measure(cell).unwrap();
        assert!(cells.iter().all(|cell| cell.cpu_seconds <= 30.0));
        let rows: Vec<usize> = grid
            .triangles
            .iter()
            .map(|t| cells.iter().filter(|c| c.max_triangles == *t).count())
            .collect();
        // 8000, 2000, 1000 and 250 steps fit; with 100,000 triangles these are too few.
        assert_eq!(rows[..5], [6, 4, 3, 1, 0]);
    }

    #[test]
    fn what_is_given_is_tried_as_far_as_it_fits() {
        let grid = CostGrid::new(&[100, 1000], &[1000, 2000], 1.0).unwrap();
        let cells = grid.measure(cell).unwrap();
        let tried: Vec<(u64, u64)> =
            cells.iter().map(|cell| (cell.steps, cell.max_triangles)).collect();
        assert_eq!(tried, [(100, 1000), (1000, 1000), (100, 2000)]);
        assert_eq!(CostGrid::new(&[100], &[2000], 1e-9).unwrap().measure(cell).unwrap().len(), 1);
        let message = CostGrid::new(&[100, 100], &[], 1.0).unwrap_err().to_string();
        assert!(message.contains("steps is 100,100"), "{message}");
    }

    #[test]
    fn cells_have_means_bands_and_a_front() {
        let run =
            |seed, cpu_seconds, psnr| CostRun { seed, cpu_seconds, triangles: 7, psnr, ssim: 0.9 };
        let cell = |seconds: f64, psnr: f64| {
            CostCell::new(
                8,
                9,
                vec![run(0, seconds - 1.0, psnr - 0.1), run(1, seconds + 1.0, psnr + 0.1)],
            )
        };
        let mut cells = [cell(10.0, 20.0), cell(20.0, 19.0), cell(30.0, 21.0)];
        compare(&mut cells);
        assert_eq!(cells.each_ref().map(|cell| cell.on_front), [true, false, true]);
        assert!((cells[1].cpu_seconds - 20.0).abs() < 1e-9 && (cells[1].psnr - 19.0).abs() < 1e-9);
        // Three degrees of freedom: 3.182 times 0.1414, over √2.
        assert!(cells.iter().all(|cell| (cell.psnr_band.unwrap() - 0.3182).abs() < 1e-4));
        assert_eq!(cells[0].options(), "--steps 8 --max-triangles 9");
    }

    #[test]
    fn bands_are_those_of_tables() {
        let band = |groups: &[&[f64]], runs| half_band(groups.iter().copied(), runs);
        // Three runs with a standard deviation of 1: 4.303 / √3.
        assert!((band(&[&[-1.0, 0.0, 1.0]], 3).unwrap() - 2.4843).abs() < 1e-4);
        // Four degrees of freedom from two groups with other means.
        assert!((band(&[&[-1.0, 0.0, 1.0], &[9.0, 10.0, 11.0]], 3).unwrap() - 1.6027).abs() < 1e-4);
        assert_eq!(band(&[&[1.0], &[2.0]], 1), None);
    }

    #[test]
    fn nineteen_of_twenty_bands_hold_the_true_mean() {
        for cells in [1, 4, 20] {
            let held = |trial: u64| {
                let rng = Rng::new(7, "band", trial);
                let value = |i: u64| f64::from(rng.normal(i));
                let groups: Vec<[f64; 3]> =
                    (0..cells).map(|c| [0, 1, 2].map(|k| value(3 * c + k))).collect();
                let band = half_band(groups.iter().map(|group| &group[..]), 3).unwrap();
                (groups[0].iter().sum::<f64>() / 3.0).abs() <= band
            };
            let share = (0..4000).filter(|trial| held(*trial)).count() as f64 / 4000.0;
            assert!((0.935..0.965).contains(&share), "{cells} cells: {share}");
        }
    }
}
