//! What a grid says in one sentence: the settings to use, what they cost and reach, and what more time would give.

use super::cell::CostCell;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::short::short;

/// Less than this is no difference, dB.
const LEAST_DB: f64 = 0.01;

/// The settings to use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CostAdvice {
    /// `--steps`.
    pub steps: u64,
    /// `--max-triangles`.
    pub max_triangles: u64,
    /// CPU seconds that they took.
    pub cpu_seconds: f64,
    /// PSNR that they reached on the watched photos, dB.
    pub psnr: f64,
    /// Half the width of its 95% band, dB.
    #[serde(default)]
    pub psnr_band: Option<f64>,
    /// Gain expected of twice the time of the dearest useful training, dB: gains of doublings are taken to shrink geometrically. Absent where
    /// too little was measured.
    #[serde(default)]
    pub gain_of_twice_the_time: Option<f64>,
    /// All of it in words.
    pub sentence: String,
}

impl CostAdvice {
    /// The cheapest of `cells` that cannot be told from the closest; `None` without any.
    pub(super) fn new(cells: &[CostCell], watched: usize) -> Option<Self> {
        let best = cells.iter().max_by(|a, b| a.psnr.total_cmp(&b.psnr))?;
        let noise = difference_band(best);
        let enough = |cell: &&CostCell| cell.psnr >= best.psnr - noise;
        let chosen = cells.iter().filter(enough).min_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds))?;
        let gain = gain_of_doubling(cells, best);
        let sentence = sentence(chosen, best, watched, gain);
        let CostCell { steps, max_triangles, cpu_seconds, psnr, psnr_band, .. } = *chosen;
        Some(Self {
            steps,
            max_triangles,
            cpu_seconds,
            psnr,
            psnr_band,
            gain_of_twice_the_time: gain,
            sentence,
        })
    }
}

/// Two means that differ by less may be of one setting, dB.
fn difference_band(cell: &CostCell) -> f64 {
    cell.psnr_band.map_or(0.0, |band| band * std::f64::consts::SQRT_2).max(LEAST_DB)
}

/// What twice the seconds of the `best` cell should give.
fn gain_of_doubling(cells: &[CostCell], best: &CostCell) -> Option<f64> {
    // The closest within a share of its time.
    let within = |share: f64| {
        let cells = cells.iter().filter(|cell| cell.cpu_seconds <= share * best.cpu_seconds);
        cells.map(|cell| cell.psnr).max_by(f64::total_cmp)
    };
    // Seconds of runs that should take half as long vary.
    let (half, quarter) = (within(0.6)?, within(0.35)?);
    let (last, before) = (best.psnr - half, half - quarter);
    let decay = if before > 0.0 { (last / before).clamp(0.0, 1.0) } else { 1.0 };
    Some(last.max(0.0) * decay)
}

fn sentence(chosen: &CostCell, best: &CostCell, watched: usize, gain: Option<f64>) -> String {
    let band = chosen.psnr_band.map_or(String::new(), |band| format!(" ± {band:.2}"));
    let mut text = format!(
        "use {}: {} CPU s, {:.2}{band} dB on {watched} photos that training did not see; ",
        chosen.options(),
        short(chosen.cpu_seconds),
        chosen.psnr,
    );
    if chosen.cpu_seconds < best.cpu_seconds {
        let differ = best.psnr - chosen.psnr;
        text += &format!("{} gave {differ:+.2} dB, which may be chance; ", spent(best));
    }
    text += &match gain {
        None => "what more time would give was not measured".to_owned(),
        Some(gain) if gain < difference_band(best) => {
            format!(
                "more time than {} CPU s should give nothing that can be told from chance",
                short(best.cpu_seconds)
            )
        }
        Some(gain) => format!("{} CPU s should give {gain:+.1} dB", short(2.0 * best.cpu_seconds)),
    };
    text
}

fn spent(cell: &CostCell) -> String {
    format!("{} CPU s ({})", short(cell.cpu_seconds), cell.options())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(steps: u64, cpu_seconds: f64, psnr: f64, band: f64) -> CostCell {
        let psnr_band = Some(band);
        CostCell { cpu_seconds, psnr, psnr_band, ..CostCell::new(steps, 3000, Vec::new()) }
    }

    #[test]
    fn what_still_gains_is_told_with_what_twice_the_time_gives() {
        let cells = [cell(250, 10.0, 20.0, 0.05), cell(500, 20.0, 22.0, 0.05), cell(1000, 41.0, 23.0, 0.05)];
        let advice = CostAdvice::new(&cells, 6).unwrap();
        assert_eq!((advice.steps, advice.cpu_seconds), (1000, 41.0));
        assert!((advice.gain_of_twice_the_time.unwrap() - 0.5).abs() < 1e-9);
        let wants = "use --steps 1000 --max-triangles 3000: 41 CPU s, 23.00 ± 0.05 dB on 6 photos that training did not see; 82 CPU s should give +0.5 dB";
        assert_eq!(advice.sentence, wants);
    }

    #[test]
    fn the_cheapest_of_what_is_as_close_is_told() {
        let cells = [cell(250, 10.0, 22.9, 0.1), cell(500, 20.0, 23.0, 0.1), cell(1000, 41.0, 23.02, 0.1)];
        let advice = CostAdvice::new(&cells, 3).unwrap();
        assert_eq!(advice.steps, 250);
        assert!(
            advice
                .sentence
                .contains("41 CPU s (--steps 1000 --max-triangles 3000) gave +0.12 dB, which may be chance")
        );
        assert!(
            advice.sentence.ends_with("should give nothing that can be told from chance"),
            "{}",
            advice.sentence
        );
    }

    #[test]
    fn one_cell_says_nothing_of_more_time() {
        let advice = CostAdvice::new(&[cell(250, 10.0, 20.0, 0.1)], 3).unwrap();
        assert!(advice.sentence.ends_with("what more time would give was not measured"));
        assert_eq!(CostAdvice::new(&[], 3), None);
    }
}
