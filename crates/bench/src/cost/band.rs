//! How far the mean of a few runs may lie from that of many.

/// 97.5% quantiles of Student's t for 1 to 10 degrees of freedom.
const QUANTILES: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
/// Its quantile for more: that of the normal variable, and what is left in the inverse of their number, to 0.01.
const MANY: (f64, f64) = (1.960, 2.65);

/// Half the width of the 95% band of a mean of `runs` runs, where `groups` hold the values of runs that differ by their seed only. All groups
/// have one spread, as far as few runs can tell, so it is taken from all of them; `None` where no group has two runs.
pub(super) fn half_band<'a>(groups: impl Iterator<Item = &'a [f64]>, runs: usize) -> Option<f64> {
    let (mut squares, mut freedom) = (0.0, 0);
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
                let groups: Vec<[f64; 3]> = (0..cells).map(|c| [0, 1, 2].map(|k| value(3 * c + k))).collect();
                let band = half_band(groups.iter().map(|group| &group[..]), 3).unwrap();
                (groups[0].iter().sum::<f64>() / 3.0).abs() <= band
            };
            let share = (0..4000).filter(|trial| held(*trial)).count() as f64 / 4000.0;
            assert!((0.935..0.965).contains(&share), "{cells} cells: {share}");
        }
    }
}
