//! Synthetic soups: seeded samples of an analytic scene, of any size; the same seed gives the same
//! bits on any number of threads. They replace trained scenes wherever size and statistics matter
//! more than the subject: samples, tests, benchmarks.

use super::studio::{Studio, Surface};
use glam::{DVec2, DVec3, UVec2, Vec3, vec3};
use std::f64::consts::TAU;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Provenance, Rng, Soup, UpAxis, sh0_from_rgb};

/// Share of the triangles on the far dome, and of faint ones floating in the air.
const FAR: f64 = 0.05;
const FLOATING: f64 = 0.01;
/// Share of a surface's triangles that are nearly solid and tile it without crossing a colour edge.
const CORE: f64 = 0.4;
/// Size of a triangle of the core, relative to its half of the cell.
const GROWN: f64 = 1.3;
/// Maximum number of cells by which it may cross the border of its patch.
const SLACK: f64 = 0.06;
/// Area of all scattered triangles of a surface over the area of the surface, per share of
/// scattered ones.
const OVERLAP: f64 = 10.0;
/// Random numbers reserved for one triangle.
const RANDOM_NUMBERS: u64 = 32;

// The recipes name the command of the time when the samples were made: they are part of their
// bytes.

/// What made [`degenerate()`].
pub const DEGENERATE_RECIPE: &str = "trisplat sample degenerate";

/// What made [`studio()`].
pub fn studio_recipe(triangles: usize, seed: u64) -> String {
    format!("trisplat sample studio --triangles {triangles} --seed {seed}")
}

/// The provenance of a sample: its recipe and the up axis.
pub fn provenance(recipe: &str) -> Provenance {
    Provenance { trainer: Some(recipe.to_owned()), up: Some(UpAxis::NegY), ..Provenance::default() }
}

/// One triangle with its attributes; rgb is sRGB-encoded.
struct SoupTriangle {
    corners: [DVec3; 3],
    rgb: DVec3,
    opacity: f64,
    sigma: f64,
}

/// `n` triangles of the studio, SH degree 0, in no particular order; -y is up.
///
/// Edge lengths, opacities and σ are spread as in optimised scenes: edges over two decades, a tenth
/// of the triangles slivers, half of them below opacity 0.5, σ around 0.3.
pub fn studio(n: usize, seed: u64) -> Soup {
    let studio = &Studio::new();
    let shares = shares(&studio.surfaces, n);
    let mut soup = Soup {
        vertices: vec![[Vec3::ZERO; 3]; n],
        opacity: vec![0.0; n],
        sigma: vec![0.0; n],
        sh: vec![[0.0; 3]; n],
        sh_degree: 0,
        ..Soup::default()
    };
    let slots =
        soup.vertices.iter_mut().zip(&mut soup.opacity).zip(&mut soup.sigma).zip(&mut soup.sh);
    let mut slots: Vec<_> = slots.collect();
    parallel::for_each_mut(&mut slots, GRAIN, |slot, (((vertices, opacity), sigma), sh)| {
        let i = shuffled(slot, n);
        let random =
            TriangleRng { rng: Rng::new(seed, "sample", 0), first: i as u64 * RANDOM_NUMBERS };
        let owner = shares.partition_point(|&end| end <= i);
        let first = if owner == 0 { 0 } else { shares[owner - 1] };
        let made = match studio.surfaces.get(owner) {
            Some(on) => {
                let i = i - first;
                let count = shares[owner] - first;
                let grid = CoreGrid::new(on, count, Rng::new(seed, "sample grid", owner as u64));
                if i < grid.len() {
                    grid.triangle(studio, on, i, &random)
                } else {
                    scattered(studio, on, i, count, &random)
                }
            }
            None => floating(&random),
        };
        **vertices = made.corners.map(DVec3::as_vec3);
        **opacity = made.opacity.clamp(0.0, 1.0) as f32;
        **sigma = made.sigma as f32;
        **sh = made.rgb.as_vec3().to_array().map(sh0_from_rgb);
    });
    soup
}

/// End of each surface's triangles, in order; the rest float in the air.
fn shares(surfaces: &[Surface], n: usize) -> Vec<usize> {
    let weight = |s: &Surface| s.density * s.shape.area();
    let near: f64 = surfaces.iter().map(weight).sum();
    let far = surfaces.iter().filter(|s| s.density == 0.0).count() as f64;
    let mut end = 0.0;
    let share = |s: &Surface| {
        end += if s.density == 0.0 { FAR / far } else { (1.0 - FAR - FLOATING) * weight(s) / near };
        (end * n as f64).round() as usize
    };
    surfaces.iter().map(share).collect()
}

/// A fixed permutation of 0..n: neighbours in the file are far apart in space, as in a trained
/// soup.
fn shuffled(slot: usize, n: usize) -> usize {
    const STEP: u64 = 2_654_435_761; // prime, so coprime to every n it does not divide
    ((slot as u64).wrapping_mul(STEP) % n as u64) as usize
}

/// The random numbers of one triangle.
struct TriangleRng {
    rng: Rng,
    first: u64,
}

impl TriangleRng {
    fn uniform(&self, which: u64) -> f64 {
        self.rng.uniform_f64(self.first + which)
    }

    fn normal(&self, which: u64) -> f64 {
        f64::from(self.rng.normal(self.first + which))
    }

    /// A unit-area triangle about the origin: equilateral, jittered, rotated.
    fn unit_triangle(&self, which: u64) -> [DVec2; 3] {
        let rotation = self.uniform(which);
        let corner = |k: u64| {
            let angle =
                TAU * (rotation + (k as f64 + 0.5 * (self.uniform(which + 1 + k) - 0.5)) / 3.0);
            DVec2::from_angle(angle) * 0.877_382_675 // circumradius of the unit-area equilateral triangle
        };
        [corner(0), corner(1), corner(2)]
    }
}

/// The core of a surface: nearly solid triangles that tile it, as after training. A grid with
/// jittered corners, two triangles per cell, aligned with the patches of the texture; empty when
/// there are too few for that.
struct CoreGrid {
    patches: UVec2,
    cells: UVec2, // of one patch
    rng: Rng,
}

impl CoreGrid {
    fn new(on: &Surface, count: usize, rng: Rng) -> Self {
        let pairs = (CORE * count as f64 / 2.0).floor();
        let of = |patches: UVec2| f64::from(patches.x) * f64::from(patches.y);
        let patches = on.texture.patches();
        let room = pairs / of(patches);
        if room < 1.0 {
            return Self { patches: UVec2::ZERO, cells: UVec2::ONE, rng };
        }
        let side = on.shape.stretch(DVec2::splat(0.5)) / patches.as_dvec2();
        let x = (room * side.x / side.y).sqrt().floor().clamp(1.0, room.floor());
        Self { patches, cells: DVec2::new(x, (room / x).floor()).as_uvec2(), rng }
    }

    fn len(&self) -> usize {
        (2 * u64::from(self.patches.x * self.cells.x) * u64::from(self.patches.y * self.cells.y))
            as usize
    }

    /// Corner (x, y) of the grid in the unit square; those on the border of a patch stay on it.
    fn corner(&self, at: UVec2) -> DVec2 {
        let size = self.patches * self.cells;
        let jitter = |axis: u64, on_border: bool| {
            let entry = 2 * (u64::from(at.y) * (u64::from(size.x) + 1) + u64::from(at.x)) + axis;
            if on_border { 0.0 } else { 0.6 * (self.rng.uniform_f64(entry) - 0.5) }
        };
        let border = at % self.cells;
        (at.as_dvec2() + DVec2::new(jitter(0, border.x == 0), jitter(1, border.y == 0)))
            / size.as_dvec2()
    }

    /// Triangle `i`: a little larger than its half cell, so that it still closes the surface when
    /// its soft rim is cut away, but hardly across the border of its patch.
    fn triangle(
        &self,
        studio: &Studio,
        on: &Surface,
        i: usize,
        random: &TriangleRng,
    ) -> SoupTriangle {
        let cell = i as u32 / 2;
        let width = self.patches.x * self.cells.x;
        let cell = UVec2::new(cell % width, cell / width);
        let ring =
            [UVec2::ZERO, UVec2::X, UVec2::ONE, UVec2::Y].map(|step| self.corner(cell + step));
        let diagonal = (cell.x + cell.y) as usize % 2;
        let half = [0, 1, 2].map(|k| ring[(diagonal + 2 * (i % 2) + k) % 4]);
        let middle = (half[0] + half[1] + half[2]) / 3.0;
        let patch = (cell / self.cells).as_dvec2();
        let slack = SLACK / self.cells.as_dvec2();
        let low = (patch - slack) / self.patches.as_dvec2();
        let high = (patch + 1.0 + slack) / self.patches.as_dvec2();
        let corners = half.map(|corner| (middle + (corner - middle) * GROWN).clamp(low, high));
        let lift = on.shape.normal(middle) * (0.001 * random.normal(0));
        SoupTriangle {
            corners: corners.map(|corner| on.shape.point(corner) + lift),
            rgb: studio.color(on, middle)
                + 0.012 * DVec3::from([1, 2, 3].map(|k| random.normal(k))),
            opacity: 1.02 - 0.3 * random.uniform(4).powi(2),
            sigma: 0.15 * (0.45 * random.normal(5)).exp(),
        }
    }
}

/// Triangle `i` of `count` scattered on a surface, soft and of any size. Centres follow the R2
/// sequence (Roberts 2018), which covers evenly at any count.
fn scattered(
    studio: &Studio,
    on: &Surface,
    i: usize,
    count: usize,
    random: &TriangleRng,
) -> SoupTriangle {
    let at = DVec2::new(
        (0.5 + i as f64 * 0.754_877_666_246_692_7).fract(),
        (0.5 + i as f64 * 0.569_840_290_998_053_2).fract(),
    );
    let area = OVERLAP * on.shape.area() / count as f64 * (1.6 * random.normal(1) - 1.28).exp();
    let corners = scattered_corners(on, at, area, random);
    let tilt = 0.04 * area.sqrt().min(0.3);
    let lift = |k: u64| on.shape.normal(at) * (tilt * (random.normal(16) + random.normal(17 + k)));
    SoupTriangle {
        corners: [0, 1, 2].map(|k| on.shape.point(corners[k]) + lift(k as u64)),
        rgb: studio.color(on, at) + 0.02 * DVec3::from([20, 21, 22].map(|k| random.normal(k))),
        opacity: faint(random.uniform(23)),
        sigma: 0.45 * (0.75 * random.normal(24)).exp(),
    }
}

/// Corners in the unit square of a surface: mostly slivers along one of its axes, at most a little
/// across the border of their patch.
fn scattered_corners(on: &Surface, at: DVec2, area: f64, random: &TriangleRng) -> [DVec2; 3] {
    let long = (1.9 + 1.0 * random.normal(2)).exp().clamp(1.0, 60.0).sqrt();
    let along = match random.uniform(3) {
        u if u < 0.4 => 0.1 * random.normal(4),
        u if u < 0.8 => 0.25 * TAU + 0.1 * random.normal(4),
        _ => TAU * random.uniform(5),
    };
    let stretch = on.shape.stretch(at);
    let reach = on.shape.reach();
    let patches = on.texture.patches().as_dvec2();
    let low = ((at * patches).floor() - 0.05) / patches;
    let high = ((at * patches).floor() + 1.05) / patches;
    random.unit_triangle(6).map(|corner| {
        let shaped =
            DVec2::from_angle(along).rotate(corner * DVec2::new(long, 1.0 / long)) * area.sqrt();
        let offset = shaped.clamp(-reach, reach) / stretch;
        (at + offset).clamp(low, high).clamp(DVec2::ZERO, DVec2::ONE)
    })
}

/// A faint floating triangle: every optimised scene has some.
fn floating(random: &TriangleRng) -> SoupTriangle {
    let place = DVec3::from([0, 1, 2].map(|k| random.uniform(k) - 0.5)) * 7.0 - DVec3::Y * 2.0;
    let corner = |k: u64| DVec3::from([3, 4, 5].map(|axis| random.normal(3 * k + axis)));
    let size = 0.15 * random.normal(12).exp();
    SoupTriangle {
        corners: [0, 1, 2].map(|k| place + size * corner(k)),
        rgb: DVec3::from([13, 14, 15].map(|k| random.uniform(k))),
        opacity: 0.2 * faint(random.uniform(23)),
        sigma: 0.8 * (0.5 * random.normal(24)).exp(),
    }
}

/// Opacity of a triangle that is not solid: values near 0 are more frequent than those near 0.7.
fn faint(uniform: f64) -> f64 {
    0.02 + 0.7 * uniform * uniform.sqrt()
}

/// Maximum degenerate soup that a reader may accept: one triangle of every kind that breaks naive
/// code, and a few valid ones, so that a bake of it still has something to write.
pub fn degenerate() -> Soup {
    let mut soup = Soup::default();
    let one = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, -1.0, 0.0)];
    let mut push = |corners: [Vec3; 3], opacity: f32, sigma: f32, rgb: [f32; 3]| {
        soup.vertices.push(corners);
        soup.opacity.push(opacity);
        soup.sigma.push(sigma);
        soup.sh.push(rgb.map(sh0_from_rgb));
    };
    for corners in shapes(one) {
        push(corners, 0.9, 0.1, [0.8, 0.3, 0.2]);
    }
    let tiny = f32::MIN_POSITIVE;
    for opacity in [0.0, -0.0, tiny, 1e-3, 0.5, 1.0 - f32::EPSILON, 1.0] {
        for sigma in [tiny, 1e-30, 1e-3, 0.5, 1.0, 1e3, 1e30, f32::MAX] {
            push(
                one.map(|p| p + vec3(2.0, opacity, sigma.log2() * 0.01)),
                opacity,
                sigma,
                [0.2, 0.6, 0.3],
            );
        }
    }
    let channels = [-1e30, -1.0, -0.0, 0.0, tiny, 1.0, 2.0, 1e30];
    for (i, channel) in channels.into_iter().enumerate() {
        push(one.map(|p| p - vec3(2.0, 0.0, i as f32)), 0.9, 0.1, [channel, 0.5, 1.0 - channel]);
    }
    soup
}

/// Triangles by their kind of degeneracy.
fn shapes(one: [Vec3; 3]) -> Vec<[Vec3; 3]> {
    let [a, b, c] = one;
    let last_bit = f32::from_bits(1.0f32.to_bits() + 1);
    let mut all = vec![
        one,
        [a, c, b],                                      // the same, seen from behind
        one,                                            // the same again
        [a; 3],                                         // a point
        [b; 3],                                         // a point elsewhere
        [a, b, b],                                      // a line with a double corner
        [a, b, (a + b) / 2.0],                          // three corners in a row
        [a, b, vec3(3.0, 0.0, 0.0)],                    // in a row, one outside
        [a, b, vec3(0.5, -1e-7, 0.0)],                  // a sliver
        [a, b, vec3(0.5, -1e-20, 0.0)],                 // its area squared underflows
        [b, vec3(last_bit, 0.0, 0.0), c],               // one edge of one ulp
        [a, vec3(1e-3, 0.0, 0.0), vec3(0.0, 1e4, 0.0)], // a needle
    ];
    // Equal triangles many times over: coincident centroids, no split to be found.
    all.extend([one.map(|p| p + vec3(0.0, 0.0, 3.0)); 40]);
    // From denormal to almost infinite.
    for size in [1e-45, 1e-38, 1e-30, 1e-19, 1e-9, 1e-4, 1e4, 1e9, 1e18, 1e19, 1e30, 1e38] {
        all.push(one.map(|p| p * size));
    }
    // Ordinary, but so far away that no two corners differ by much more than one ulp.
    for place in [1e4, 1e6, 1e7, 1e15, 1e37] {
        all.push(one.map(|p| p + Vec3::splat(place)));
    }
    // Corners at both ends of the range of f32: differences overflow.
    all.push([Vec3::splat(-3e38), Vec3::splat(3e38), vec3(3e38, -3e38, 0.0)]);
    all.push([Vec3::splat(f32::MIN), Vec3::splat(f32::MAX), Vec3::ZERO]);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The value below which `share` of `values` lie.
    fn quantile(mut values: Vec<f32>, share: f64) -> f32 {
        values.sort_by(f32::total_cmp);
        values[(share * (values.len() - 1) as f64) as usize]
    }

    #[test]
    fn any_count_is_exact_and_valid() {
        for n in [0, 1, 10, 97, 1000, 20_011] {
            let made = studio(n, 3);
            assert_eq!(made.len(), n);
            made.validate().unwrap();
        }
        degenerate().validate().unwrap();
    }

    #[test]
    fn the_seed_decides_and_the_threads_do_not() {
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let one = pool(1).install(|| studio(5000, 7));
        assert_eq!(one, pool(5).install(|| studio(5000, 7)));
        assert_ne!(one, studio(5000, 8));
    }

    #[test]
    fn statistics_are_those_of_optimised_scenes() {
        let made = studio(20_000, 1);
        let quantiles = |values: &[f32]| [0.25, 0.5, 0.75].map(|q| quantile(values.to_vec(), q));
        let close = |got: [f32; 3], wants: [f32; 3]| {
            let near = got.iter().zip(wants).all(|(g, w)| (g / w).ln().abs() < 0.3);
            assert!(near, "{got:?} is not near {wants:?}");
        };
        close(quantiles(&made.sigma), [0.18, 0.31, 0.52]);
        close(quantiles(&made.opacity), [0.17, 0.45, 0.88]);
        let longest =
            |t: &[Vec3; 3]| (0..3).map(|k| t[k].distance(t[(k + 1) % 3])).fold(0.0, f32::max);
        let edges: Vec<f32> = made.vertices.iter().map(longest).collect();
        let spread = quantile(edges.clone(), 0.99) / quantile(edges, 0.01);
        assert!(spread > 50.0, "edges spread over {spread}");
    }
}
