//! What a count of failures says about their rate: bounds of a Poisson variable, as failures are rare.

/// Confidence of the bound from above, which is what is promised to hold.
const ABOVE: f64 = 0.95;
/// Confidence of the bound from below: a promise is broken where chance alone would count as many once in a thousand runs.
const BELOW: f64 = 0.999;
/// From this many failures on, the approximation of Wilson and Hilferty is exact to 1e-4.
const MANY: u64 = 1000;
/// Quantiles of the normal variable for both.
const NORMAL: (f64, f64) = (1.6449, 3.0902);

/// The rate that is not exceeded, as far as `failures` of `of` cases can say (95%).
pub(super) fn upper(failures: u64, of: u64) -> f64 {
    let count = match failures {
        MANY.. => cubed(failures as f64 + 1.0, NORMAL.0),
        _ => solve(|mean| at_most(failures, mean) <= 1.0 - ABOVE),
    };
    (count / of.max(1) as f64).min(1.0)
}

/// The rate that is reached at least, as far as `failures` of `of` cases can say (99.9%).
pub(super) fn lower(failures: u64, of: u64) -> f64 {
    let count = match failures {
        0 => 0.0,
        MANY.. => cubed(failures as f64, -NORMAL.1),
        _ => solve(|mean| 1.0 - at_most(failures - 1, mean) >= 1.0 - BELOW),
    };
    count / of.max(1) as f64
}

/// The bound of a count by a quantile of the normal variable.
fn cubed(count: f64, quantile: f64) -> f64 {
    count * (1.0 - 1.0 / (9.0 * count) + quantile / (3.0 * count.sqrt())).powi(3)
}

/// The probability of `count` failures or fewer where `mean` are expected.
fn at_most(count: u64, mean: f64) -> f64 {
    let (mut log, mut sum) = (-mean, (-mean).exp());
    for i in 1..=count {
        log += mean.ln() - (i as f64).ln();
        sum += log.exp();
    }
    sum
}

/// The least mean for which `is_large` holds, which it does from there on.
fn solve(is_large: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 2.0 * MANY as f64);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if is_large(middle) { high = middle } else { low = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_those_of_tables() {
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < 2e-3;
        // Tables of the Poisson variable: 95% from above, 99.9% from below.
        for (failures, above, below) in
            [(0, 2.996, 0.0), (1, 4.744, 0.0010005), (5, 10.513, 0.7394), (10, 16.962, 2.961)]
        {
            assert!(near(upper(failures, 1000), above / 1000.0), "{failures}: {}", upper(failures, 1000));
            let found = lower(failures, 1000);
            assert!(found == below || near(found, below / 1000.0), "{failures}: {found}");
        }
        // Both ways to a bound agree where they meet.
        let of = 1 << 20;
        assert!(near(upper(999, of), upper(1000, of)) && near(lower(999, of), lower(1000, of)));
    }
}
