//! The most degenerate soup that a reader may accept: values are finite and in range, everything else is
//! wrong.

use glam::{Vec3, vec3};
use trisplat_scene::{Soup, sh0_from_rgb};

/// One triangle of every kind that breaks naive code, and a few valid ones, so that a bake of it still has
/// something to write.
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
            push(one.map(|p| p + vec3(2.0, opacity, sigma.log2() * 0.01)), opacity, sigma, [0.2, 0.6, 0.3]);
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
