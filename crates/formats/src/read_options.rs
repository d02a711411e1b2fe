//! What the caller will use of a file, and the limits that apply to it.

use trisplat_scene::Limits;

/// The parts of a file to load, and the limits for it. By default everything, within the default limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Highest degree of spherical harmonics to load, 0 to 3; the bake asks for 0. The rest is skipped on disk.
    pub sh_degree: u8,
    /// Limits on the file.
    pub limits: Limits,
    /// Whether a glTF document may name files outside its folder.
    pub allow_outside: bool,
}

impl ReadOptions {
    /// Spherical harmonics up to that degree, and the default limits.
    pub const fn with_degree(sh_degree: u8) -> Self {
        Self { sh_degree, limits: Limits::DEFAULT, allow_outside: false }
    }
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self::with_degree(3)
    }
}
