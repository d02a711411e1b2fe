//! Advice of a grid in one sentence: the settings to use, their cost and quality, and the gain of
//! more time would give.

use super::grid::CostCell;

/// Less than this is no difference, dB.
const MIN_DB: f64 = 0.01;

/// Recommends the cheapest of `cells` that cannot be told from the closest; `None` without any.
pub(super) fn advice(cells: &[CostCell], watched: usize) -> Option<String> {
    let best = cells.iter().max_by(|a, b| a.psnr.total_cmp(&b.psnr))?;
    let noise = difference_band(best);
    let enough = |cell: &&CostCell| cell.psnr >= best.psnr - noise;
    let chosen =
        cells.iter().filter(enough).min_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds))?;
    Some(sentence(chosen, best, watched, gain_of_doubling(cells, best)))
}

/// Two means that differ by less may be of one setting, dB.
fn difference_band(cell: &CostCell) -> f64 {
    cell.psnr_band.map_or(0.0, |band| band * std::f64::consts::SQRT_2).max(MIN_DB)
}

/// Expected gain of twice the seconds of the `best` cell, dB: gains of doublings are taken to
/// shrink geometrically.
fn gain_of_doubling(cells: &[CostCell], best: &CostCell) -> Option<f64> {
    // The closest within a share of its time.
    let within = |share: f64| {
        let cells = cells.iter().filter(|cell| cell.cpu_seconds <= share * best.cpu_seconds);
        cells.map(|cell| cell.psnr).max_by(f64::total_cmp)
    };
    // Seconds of runs that should take half as long vary.
    let half = within(0.6)?;
    let quarter = within(0.35)?;
    let last = best.psnr - half;
    let before = half - quarter;
    let decay = if before > 0.0 { (last / before).clamp(0.0, 1.0) } else { 1.0 };
    Some(last.max(0.0) * decay)
}

fn sentence(chosen: &CostCell, best: &CostCell, watched: usize, gain: Option<f64>) -> String {
    let mut text = format!(
        "use {}: {} CPU s, {} dB on {watched} photos that training did not see; ",
        chosen.options(),
        short(chosen.cpu_seconds),
        chosen.banded(),
    );
    if chosen.cpu_seconds < best.cpu_seconds {
        let differ = best.psnr - chosen.psnr;
        let seconds = short(best.cpu_seconds);
        let options = best.options();
        text += &format!("{seconds} CPU s ({options}) gave {differ:+.2} dB, which may be chance; ");
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

/// A number for axes: three digits, then k, M or G. 20000 as "20k", 1234567 as "1.23M", 0.5 as
/// "0.5".
fn short(value: f64) -> String {
    let (unit, letter) = match value.abs() {
        size if size >= 0.9995e9 => (1e9, "G"),
        size if size >= 0.9995e6 => (1e6, "M"),
        size if size >= 9995.0 => (1e3, "k"),
        _ => (1.0, ""),
    };
    let scaled = value / unit;
    let digits = (2 - scaled.abs().max(1e-4).log10().floor() as i32).clamp(0, 5) as usize;
    let text = format!("{scaled:.digits$}");
    let text =
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{}{letter}", if text == "-0" { "0" } else { text })
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
        let cells = [
            cell(250, 10.0, 20.0, 0.05),
            cell(500, 20.0, 22.0, 0.05),
            cell(1000, 41.0, 23.0, 0.05),
        ];
        let said = advice(&cells, 6).unwrap();
        let wants = "use --steps 1000 --max-triangles 3000: 41 CPU s, 23.00 ± 0.05 dB on 6 photos that training did not see; 82 CPU s should give +0.5 dB";
        assert_eq!(said, wants);
    }

    #[test]
    fn the_cheapest_of_what_is_as_close_is_told() {
        let cells =
            [cell(250, 10.0, 22.9, 0.1), cell(500, 20.0, 23.0, 0.1), cell(1000, 41.0, 23.02, 0.1)];
        let said = advice(&cells, 3).unwrap();
        assert!(said.starts_with("use --steps 250 "), "{said}");
        assert!(said.contains(
            "41 CPU s (--steps 1000 --max-triangles 3000) gave +0.12 dB, which may be chance"
        ));
        assert!(said.ends_with("should give nothing that can be told from chance"), "{}", said);
    }

    #[test]
    fn one_cell_says_nothing_of_more_time() {
        let said = advice(&[cell(250, 10.0, 20.0, 0.1)], 3).unwrap();
        assert!(said.ends_with("what more time would give was not measured"));
        assert_eq!(advice(&[], 3), None);
    }
}
