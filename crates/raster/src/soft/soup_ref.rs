//! The rasteriser's view of a soup.

use glam::Vec3;

/// A borrowed soup, so that a trainer may keep its own layout.
#[derive(Debug, Clone, Copy)]
pub struct SoupRef<'a> {
    /// Corners in world units. `[N, 3]`
    pub vertices: &'a [[Vec3; 3]],
    /// Opacity o in [0, 1]. `[N]`
    pub opacity: &'a [f32],
    /// Window exponent σ > 0. `[N]`
    pub sigma: &'a [f32],
    /// Spherical harmonics, degree 0 first. `[N * K]`
    pub sh: &'a [[f32; 3]],
    /// Degree stored: K = (degree + 1)².
    pub sh_degree: u8,
    /// Degree used, at most the stored one.
    pub active_degree: u8,
}

impl<'a> SoupRef<'a> {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// True when there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// Coefficients per triangle: K = (degree + 1)².
    pub fn sh_count(&self) -> usize {
        (self.sh_degree as usize + 1).pow(2)
    }

    /// The coefficients of a triangle that are in use.
    #[inline]
    pub(super) fn active_sh(&self, triangle: usize) -> &'a [[f32; 3]] {
        let k = self.sh_count();
        let used = (self.active_degree.min(self.sh_degree) as usize + 1).pow(2);
        &self.sh[triangle * k..triangle * k + used]
    }
}

impl<'a> From<&'a trisplat_scene::Soup> for SoupRef<'a> {
    fn from(soup: &'a trisplat_scene::Soup) -> Self {
        Self {
            vertices: &soup.vertices,
            opacity: &soup.opacity,
            sigma: &soup.sigma,
            sh: &soup.sh,
            sh_degree: soup.sh_degree,
            active_degree: soup.sh_degree,
        }
    }
}
