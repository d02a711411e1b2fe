//! Disjoint sets of numbers, which are joined one by one.

/// Sets of the numbers below a count; each number begins in a set of its own.
#[derive(Debug)]
pub struct Sets(Vec<u32>);

impl Sets {
    /// `count` sets of one number each.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The least number of the set that `number` is in. Paths to it are halved on the way.
    pub fn first(&mut self, mut number: u32) -> u32 {
        let Self(parents) = self;
        while parents[number as usize] != number {
            let above = parents[parents[number as usize] as usize];
            parents[number as usize] = above;
            number = above;
        }
        number
    }

    /// Makes one set of those that `a` and `b` are in.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.first(a), self.first(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_sets_have_their_least_number() {
        let mut sets = Sets::new(8);
        for (a, b) in [(7, 3), (6, 5), (3, 6), (2, 1), (1, 2)] {
            sets.join(a, b);
        }
        let firsts: Vec<u32> = (0..8).map(|number| sets.first(number)).collect();
        assert_eq!(firsts, [0, 1, 1, 3, 4, 3, 3, 3]);
    }
}
