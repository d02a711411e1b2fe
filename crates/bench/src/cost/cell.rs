//! What trainings with as many steps and triangles cost and gain.

use super::band::half_band;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CostRun {
    /// Its seed.
    pub seed: u64,
    /// User and system seconds on all threads: photos, teacher, training and the drawing of the watched photos.
    pub cpu_seconds: f64,
    /// Triangles at the end.
    pub triangles: u64,
    /// Mean PSNR of the watched photos, dB.
    pub psnr: f64,
    /// Mean SSIM of the watched photos.
    pub ssim: f64,
}

/// All trainings with as many steps and triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CostCell {
    /// `--steps`.
    pub steps: u64,
    /// `--max-triangles`.
    pub max_triangles: u64,
    /// Mean of the runs' CPU seconds.
    pub cpu_seconds: f64,
    /// Mean of their PSNR, dB.
    pub psnr: f64,
    /// Half the width of its 95% band over seeds, dB, from the spread of all cells; absent where each has one seed.
    #[serde(default)]
    pub psnr_band: Option<f64>,
    /// Mean of their SSIM.
    pub ssim: f64,
    /// No cell that costs no more comes closer.
    pub on_front: bool,
    /// One for each seed.
    pub runs: Vec<CostRun>,
}

impl CostCell {
    /// Of runs; band and front come later.
    pub(super) fn new(steps: u64, max_triangles: u64, runs: Vec<CostRun>) -> Self {
        let mean = |of: fn(&CostRun) -> f64| runs.iter().map(of).sum::<f64>() / runs.len().max(1) as f64;
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
    pub fn options(&self) -> String {
        format!("--steps {} --max-triangles {}", self.steps, self.max_triangles)
    }
}

/// Gives cells their bands, and marks those on the front.
pub(super) fn compare(cells: &mut [CostCell]) {
    let values: Vec<Vec<f64>> =
        cells.iter().map(|cell| cell.runs.iter().map(|run| run.psnr).collect()).collect();
    let costs: Vec<(f64, f64)> = cells.iter().map(|cell| (cell.cpu_seconds, cell.psnr)).collect();
    for cell in cells {
        cell.psnr_band = half_band(values.iter().map(Vec::as_slice), cell.runs.len());
        let beaten = |(seconds, psnr): &(f64, f64)| *seconds <= cell.cpu_seconds && *psnr > cell.psnr;
        cell.on_front = !costs.iter().any(beaten);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_means_bands_and_a_front() {
        let run = |seed, cpu_seconds, psnr| CostRun { seed, cpu_seconds, triangles: 7, psnr, ssim: 0.9 };
        let cell = |seconds: f64, psnr: f64| {
            CostCell::new(8, 9, vec![run(0, seconds - 1.0, psnr - 0.1), run(1, seconds + 1.0, psnr + 0.1)])
        };
        let mut cells = [cell(10.0, 20.0), cell(20.0, 19.0), cell(30.0, 21.0)];
        compare(&mut cells);
        assert_eq!(cells.each_ref().map(|cell| cell.on_front), [true, false, true]);
        assert!((cells[1].cpu_seconds - 20.0).abs() < 1e-9 && (cells[1].psnr - 19.0).abs() < 1e-9);
        // Three degrees of freedom: 3.182 times 0.1414, over √2.
        assert!(cells.iter().all(|cell| (cell.psnr_band.unwrap() - 0.3182).abs() < 1e-4));
        assert_eq!(cells[0].options(), "--steps 8 --max-triangles 9");
    }
}
