//! What the caller will use of a file.

/// What the caller will use of a file; the rest is skipped on disk. The default is everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Highest degree of spherical harmonics to load, 0 to 3; the bake asks for 0.
    pub sh_degree: u8,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { sh_degree: 3 }
    }
}
