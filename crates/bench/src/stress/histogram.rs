//! Quantiles of many numbers in little memory, the same in whatever order they are added.

/// Bins per power of two: a quantile is at most 9% too large.
const PER_OCTAVE: i64 = 8;
/// Exponents of the first bin and of the last.
const OCTAVES: (i64, i64) = (-48, 48);
const BINS: usize = ((OCTAVES.1 - OCTAVES.0) * PER_OCTAVE) as usize;

/// Counts of numbers of at least 0 by their size.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Histogram {
    counts: Vec<u64>,
    total: u64,
    most: f64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: vec![0; BINS], total: 0, most: 0.0 }
    }
}

impl Histogram {
    /// Adds a number; one that is not finite must not come here.
    #[inline]
    pub(super) fn add(&mut self, value: f64) {
        let bits = (value.to_bits() >> (52 - PER_OCTAVE.trailing_zeros())) as i64;
        let bin = bits - (OCTAVES.0 + 1023) * PER_OCTAVE;
        self.counts[bin.clamp(0, BINS as i64 - 1) as usize] += 1;
        self.total += 1;
        self.most = self.most.max(value);
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.total += other.total;
        self.most = self.most.max(other.most);
    }

    /// How many numbers there are.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// The largest number, exactly.
    pub(super) fn most(&self) -> f64 {
        self.most
    }

    /// A number that at least `share` of them do not exceed: the upper end of a bin, or the largest number.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        let wanted = (share * self.total as f64).ceil() as u64;
        let mut seen = 0;
        for (bin, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted.max(1) {
                let bits = bin as i64 + 1 + (OCTAVES.0 + 1023) * PER_OCTAVE;
                return f64::from_bits((bits as u64) << (52 - PER_OCTAVE.trailing_zeros())).min(self.most);
            }
        }
        self.most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_at_most_a_bin_too_large() {
        let (mut all, mut halves) = (Histogram::default(), [Histogram::default(), Histogram::default()]);
        for i in 0..10_000 {
            let value = 1e-7 * f64::from(i);
            all.add(value);
            halves[i as usize % 2].add(value);
        }
        for share in [0.01, 0.5, 0.999] {
            let ratio = all.quantile(share) / (1e-3 * share);
            assert!((1.0..1.13).contains(&ratio), "{share}: {ratio}");
        }
        assert_eq!((all.quantile(1.0), all.most()), (all.most(), 1e-7 * 9999.0));
        let [mut a, b] = halves;
        a.merge(&b);
        assert_eq!(a, all);
    }

    #[test]
    fn numbers_beyond_the_bins_are_counted() {
        let mut all = Histogram::default();
        [0.0, 1e-300, 1e300].into_iter().for_each(|x| all.add(x));
        assert_eq!((all.total(), all.most(), all.quantile(1.0)), (3, 1e300, 1e300_f64.min(2f64.powi(48))));
        assert_eq!(Histogram::default().quantile(0.5), 0.0);
    }
}
