//! Stable radix sort by depth.

/// Depth of a splat and its index.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct DepthKey {
    /// Bits of the depth, which is positive, so that they sort in its order.
    pub(crate) depth: u32,
    /// Index of the splat before the sort.
    pub(crate) index: u32,
}

const BITS: u32 = 11;
const BUCKETS: usize = 1 << BITS;

/// Sorts `keys` by depth; equal depths keep their order.
pub(crate) fn by_depth(keys: &mut Vec<DepthKey>, scratch: &mut Vec<DepthKey>) {
    scratch.clear();
    scratch.resize(keys.len(), DepthKey::default());
    for shift in [0, BITS, 2 * BITS] {
        let digit = |k: &DepthKey| (k.depth >> shift) as usize & (BUCKETS - 1);
        let mut starts = [0u32; BUCKETS];
        for key in keys.iter() {
            starts[digit(key)] += 1;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for key in keys.iter() {
            let to = &mut starts[digit(key)];
            scratch[*to as usize] = *key;
            *to += 1;
        }
        std::mem::swap(keys, scratch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_as_a_stable_sort_does() {
        let rng = trisplat_scene::Rng::new(1, "sort", 0);
        let mut keys: Vec<DepthKey> = (0..5000)
            .map(|i| DepthKey { depth: ((rng.uniform(i) * 300.0).floor() * 0.1).to_bits(), index: i as u32 })
            .collect();
        let mut expected = keys.clone();
        expected.sort_by_key(|k| k.depth);
        by_depth(&mut keys, &mut Vec::new());
        assert_eq!(keys, expected);
    }
}
