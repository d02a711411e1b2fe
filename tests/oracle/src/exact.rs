//! Soups through the oracle, and their gradients through dual numbers.

use crate::dual::Dual;
use crate::frame::{self as oracle, Number, OracleCamera, Pixel, Rules, Triangle};
use trisplat_raster::soft::{FrameGrad, SoftOptions, Sort, SoupGrad, Window};
use trisplat_scene::{Soup, camera::Camera, math::real::Real};

pub fn oracle_camera(c: &Camera) -> OracleCamera {
    let d = |x: f32| f64::from(x);
    let m = c.rotation;
    OracleCamera {
        rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| d(m.col(j)[i]))),
        translation: c.translation.to_array().map(d),
        focal: c.focal.to_array().map(d),
        center: c.center.to_array().map(d),
        size: [c.size.x as usize, c.size.y as usize],
    }
}

pub fn rules(o: &SoftOptions) -> Rules {
    Rules {
        background: o.background.map(f64::from),
        per_pixel: o.sort == Sort::Pixel,
        cap: f64::from(o.alpha_cap),
        cutoff: f64::from(o.cutoff),
        min_transmittance: f64::from(o.min_transmittance),
        near: f64::from(o.near),
        fade_px: f64::from(o.fade_px),
        depth_range: o.depth_range.map(f64::from),
        coverage: match o.window {
            Window::Soft => None,
            Window::Coverage { width_px } => Some(f64::from(width_px)),
        },
        linear: o.linear,
    }
}

/// The triangles of a soup as numbers of the oracle; parameters of triangle `seeded` are variables.
pub fn triangles<R: Real>(
    soup: &Soup,
    seeded: usize,
    variable: impl Fn(f64, usize) -> R,
) -> Vec<Triangle<R>> {
    let k = soup.sh_count();
    (0..soup.len())
        .map(|i| {
            let of = |x: f32, n: usize| {
                if i == seeded { variable(f64::from(x), n) } else { R::of(f64::from(x)) }
            };
            let v = soup.vertices[i];
            Triangle {
                vertices: [0, 1, 2].map(|c| [0, 1, 2].map(|a| of(v[c][a], 3 * c + a))),
                opacity: of(soup.opacity[i], 9),
                sigma: of(soup.sigma[i], 10),
                sh: (0..k)
                    .map(|n| [0, 1, 2].map(|c| of(soup.sh[i * k + n][c], 11 + 3 * n + c)))
                    .collect(),
            }
        })
        .collect()
}

pub fn plain(soup: &Soup) -> Vec<Triangle<f64>> {
    triangles(soup, usize::MAX, |x, _| x)
}

pub fn pixel_values<R: Number>(p: &Pixel<R>) -> [R; 10] {
    let [r, g, b] = p.rgb;
    let [x, y, z] = p.normal;
    [r, g, b, p.transmittance, p.depth, p.median, x, y, z, p.distortion]
}

pub fn grad_values(d: &FrameGrad, i: usize) -> [f64; 10] {
    let scalar = |v: &[f32]| v.get(i).copied().unwrap_or(0.0);
    let [r, g, b] = d.d_rgb[i];
    let [x, y, z] = d.d_normal.get(i).copied().unwrap_or_default();
    let t = scalar(&d.d_transmittance);
    let depth = scalar(&d.d_depth);
    [r, g, b, t, depth, scalar(&d.d_median_depth), x, y, z, scalar(&d.d_distortion)].map(f64::from)
}

/// Parameters of a triangle of SH degree 3.
pub const PARAMETERS: usize = 11 + 48;

/// The gradient of triangle `t` by dual numbers.
pub fn exact_grad(
    soup: &Soup,
    t: usize,
    camera: &Camera,
    options: &SoftOptions,
    d: &FrameGrad,
) -> Vec<f64> {
    let scene = triangles(soup, t, Dual::<PARAMETERS>::variable);
    let picture = oracle::render(&scene, &oracle_camera(camera), &rules(options));
    let mut out = vec![0.0; 11 + 3 * soup.sh_count()];
    for (i, pixel) in picture.iter().enumerate() {
        for (value, weight) in pixel_values(pixel).into_iter().zip(grad_values(d, i)) {
            for (out, slope) in out.iter_mut().zip(value.d) {
                *out += slope * weight;
            }
        }
    }
    out
}

pub fn soup_grad(g: &SoupGrad, t: usize, k: usize) -> Vec<f64> {
    let vertices = g.vertices[t].iter().flat_map(|v| v.to_array());
    let sh = g.sh[t * k..(t + 1) * k].iter().flatten().copied();
    vertices.chain([g.opacity[t], g.sigma[t]]).chain(sh).map(f64::from).collect()
}
