//! Normal consistency (Huang et al. 2024, 2DGS, eq. 14): drawn normals against those of the depth
//! map.
//!
//! ```text
//! A = 1 - T,  D = depth / A,  P = D · K⁻¹(p, 1)
//! N = -(∂P/∂x × ∂P/∂y) normalised, by central differences
//! loss = mean over pixels of A (1 - n · N), the factor A held constant;  n: Σ w n as drawn
//! ```
//! Pixels on the border, or next to one whose coverage is below `MIN_COVERAGE`, have no N and no
//! loss.

use trisplat_scene::math::real::{Real, V3};
use trisplat_scene::parallel::{self, GRAIN};

/// The least coverage A of a pixel with a depth.
pub(super) const MIN_COVERAGE: f64 = 0.1;

/// The input maps of this loss, rows from the top. // each [H * W]
#[derive(Debug, Clone, Copy)]
pub struct Maps<'a, R> {
    /// Pixels per row.
    pub width: usize,
    /// Focal lengths, px.
    pub focal: [R; 2],
    /// Principal point, px; pixel centres at +0.5.
    pub center: [R; 2],
    /// Σ w z.
    pub depth: &'a [R],
    /// T.
    pub transmittance: &'a [R],
    /// Σ w n in camera space.
    pub normal: &'a [[R; 3]],
}

/// Gradients of the maps, resized and overwritten.
#[derive(Debug, Clone, Default)]
pub struct MapsGrad<R> {
    /// ∂L/∂depth.
    pub d_depth: Vec<R>,
    /// ∂L/∂transmittance.
    pub d_transmittance: Vec<R>,
    /// ∂L/∂normal.
    pub d_normal: Vec<[R; 3]>,
}

/// ∂L/∂(∂P/∂x) and ∂L/∂(∂P/∂y) of a pixel.
type Slopes<R> = [V3<R>; 2];

/// Returns the loss times `weight` and writes its gradient.
pub fn normal_grad<R: Real<Mask = bool> + Send + Sync + Into<f64>>(
    maps: &Maps<'_, R>,
    weight: f64,
    out: &mut MapsGrad<R>,
) -> f64 {
    let count = maps.depth.len();
    let scale = R::of(weight / count.max(1) as f64);
    let pixels: Vec<(R, [R; 3], Slopes<R>)> =
        parallel::collect(count, GRAIN, |i| maps.pixel(i, scale));
    let slopes = |i: usize, k: usize| pixels[i].2[k];
    let w = maps.width;
    let rows: Vec<(R, R)> = parallel::collect(count, GRAIN, |i| {
        let coverage = R::of(1.0) - maps.transmittance[i];
        if !R::of(MIN_COVERAGE).lt(coverage) {
            return (R::of(0.0), R::of(0.0));
        }
        // A pixel is the right neighbour of the previous pixel and the left neighbour of the next.
        let mut d_point = V3::zero();
        if i >= 1 {
            d_point = d_point + slopes(i - 1, 0);
        }
        if i + 1 < count {
            d_point = d_point - slopes(i + 1, 0);
        }
        if i >= w {
            d_point = d_point + slopes(i - w, 1);
        }
        if i + w < count {
            d_point = d_point - slopes(i + w, 1);
        }
        let d_depth = d_point.dot(maps.ray(i)) / coverage;
        (d_depth, d_depth * maps.depth[i] / coverage)
    });
    out.d_depth = rows.iter().map(|r| r.0).collect();
    out.d_transmittance = rows.iter().map(|r| r.1).collect();
    out.d_normal = pixels.iter().map(|p| p.1).collect();
    pixels.iter().map(|p| p.0.into()).sum()
}

impl<R: Real<Mask = bool>> Maps<'_, R> {
    /// K⁻¹(p, 1).
    fn ray(&self, i: usize) -> V3<R> {
        let at =
            |k: usize, index: usize| (R::of(index as f64 + 0.5) - self.center[k]) / self.focal[k];
        V3::new(at(0, i % self.width), at(1, i / self.width), R::of(1.0))
    }

    fn coverage(&self, i: usize) -> R {
        R::of(1.0) - self.transmittance[i]
    }

    /// P, where the scene covers the pixel.
    fn point(&self, i: usize) -> Option<V3<R>> {
        let coverage = self.coverage(i);
        R::of(MIN_COVERAGE).lt(coverage).then(|| self.ray(i).scale(self.depth[i] / coverage))
    }

    /// ∂P/∂x and ∂P/∂y, where all four neighbours have a point.
    fn slopes(&self, i: usize) -> Option<[V3<R>; 2]> {
        let w = self.width;
        let x = i % self.width;
        if x == 0 || x + 1 == w || i < w || i + w >= self.depth.len() {
            return None;
        }
        let across = self.point(i + 1)? - self.point(i - 1)?;
        Some([across, self.point(i + w)? - self.point(i - w)?])
    }

    /// The loss of a pixel, its ∂L/∂n and its ∂L/∂ slopes, all times `scale`.
    fn pixel(&self, i: usize, scale: R) -> (R, [R; 3], Slopes<R>) {
        let nothing = (R::of(0.0), [R::of(0.0); 3], [V3::zero(); 2]);
        let Some([dx, dy]) = self.slopes(i).filter(|_| R::of(MIN_COVERAGE).lt(self.coverage(i)))
        else {
            return nothing;
        };
        let cross = dx.cross(dy);
        let length = cross.length();
        if !R::of(1e-20).lt(length) {
            return nothing;
        }
        let n = V3::new(self.normal[i][0], self.normal[i][1], self.normal[i][2]);
        let surface = -cross.scale(R::of(1.0) / length);
        let weight = scale * self.coverage(i);
        let agreement = n.dot(surface);
        let d_n = -surface.scale(weight);
        // ∂L/∂N = -weight n, passed through the normalisation of -cross.
        let d_cross = (n - surface.scale(agreement)).scale(weight / length);
        let slopes = [dy.cross(d_cross), d_cross.cross(dx)];
        (weight * (R::of(1.0) - agreement), [d_n.x, d_n.y, d_n.z], slopes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    const WIDTH: usize = 7;
    const COUNT: usize = WIDTH * 6;

    struct TestMaps {
        depth: Vec<f64>,
        transmittance: Vec<f64>,
        normal: Vec<[f64; 3]>,
    }

    impl TestMaps {
        fn new() -> Self {
            let rng = Rng::new(2, "maps", 0);
            let transmittance: Vec<f64> =
                (0..COUNT as u64).map(|i| 0.6 * rng.uniform_f64(i)).collect();
            let depth =
                |i: usize| (1.0 - transmittance[i]) * (3.0 + rng.uniform_f64(100 + i as u64));
            Self {
                depth: (0..COUNT).map(depth).collect(),
                normal: (0..COUNT as u64)
                    .map(|i| {
                        std::array::from_fn(|c| rng.uniform_f64(1000 + 3 * i + c as u64) - 0.5)
                    })
                    .collect(),
                transmittance,
            }
        }

        fn maps(&self) -> Maps<'_, f64> {
            Maps {
                width: WIDTH,
                focal: [9.0, 8.0],
                center: [3.3, 2.9],
                depth: &self.depth,
                transmittance: &self.transmittance,
                normal: &self.normal,
            }
        }

        /// The loss with the factor A taken from `coverages`.
        fn loss(&self, coverages: &[f64]) -> f64 {
            let maps = self.maps();
            let pixel = |i: usize| maps.pixel(i, 1.0).0 / maps.coverage(i) * coverages[i];
            (0..COUNT).map(pixel).sum::<f64>() / COUNT as f64
        }
    }

    #[test]
    fn gradient_is_the_derivative() {
        let scene = TestMaps::new();
        let coverages: Vec<f64> = scene.transmittance.iter().map(|t| 1.0 - t).collect();
        let mut grad = MapsGrad::default();
        let loss = normal_grad(&scene.maps(), 1.0, &mut grad);
        assert!((loss - scene.loss(&coverages)).abs() < 1e-12 && loss > 0.0);
        let h = 1e-6;
        let check = |name: &str, i: usize, g: f64, change: &dyn Fn(&mut TestMaps, f64)| {
            let at = |h: f64| {
                let mut moved = TestMaps::new();
                change(&mut moved, h);
                moved.loss(&coverages)
            };
            let difference = (at(h) - at(-h)) / (2.0 * h);
            assert!((difference - g).abs() < 1e-8, "{name} {i}: {difference} {g}");
        };
        for i in 0..COUNT {
            check("depth", i, grad.d_depth[i], &|s, h| s.depth[i] += h);
            check("transmittance", i, grad.d_transmittance[i], &|s, h| s.transmittance[i] += h);
            check("normal", i, grad.d_normal[i][1], &|s, h| s.normal[i][1] += h);
        }
    }

    #[test]
    fn a_plane_drawn_with_its_own_normal_costs_nothing() {
        let mut scene = TestMaps::new();
        scene.depth.fill(4.0);
        scene.transmittance.fill(0.0);
        scene.normal.fill([0.0, 0.0, -1.0]);
        let loss = normal_grad(&scene.maps(), 1.0, &mut MapsGrad::default());
        assert!(loss.abs() < 1e-12, "{loss}");
    }

    #[test]
    fn an_empty_picture_has_no_loss_and_no_gradient() {
        let mut scene = TestMaps::new();
        scene.depth.fill(0.0);
        scene.transmittance.fill(1.0);
        let mut grad = MapsGrad::default();
        assert_eq!(normal_grad(&scene.maps(), 1.0, &mut grad), 0.0);
        assert!(grad.d_depth.iter().chain(&grad.d_transmittance).all(|g| *g == 0.0));
    }
}
