//! The gradient of an [`ExactFrame`]: the chain rule over its layers, then the kernels' formulas.

use super::exact::{ExactCamera, ExactFrame, ExactLayer, ExactSplat, dvec3, v3};
use glam::DVec3;
use trisplat_raster::{
    kernel::clip,
    kernel::sh,
    kernel::splat::{self, SplatGrad},
    kernel::window,
    soft::{FrameGrad, SoftOptions},
};
use trisplat_scene::{
    Soup,
    camera::Camera,
    math::vec::{V2, V3},
};

/// Gradient of one triangle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExactGrad {
    /// ∂L/∂vertices.
    pub vertices: [DVec3; 3],
    /// ∂L/∂opacity.
    pub opacity: f64,
    /// ∂L/∂sigma.
    pub sigma: f64,
    /// ∂L/∂sh, of as many coefficients as the soup has.
    pub sh: [[f64; 3]; sh::MAX_COEFFICIENTS],
}

impl ExactGrad {
    /// All of it: vertices, opacity, σ, SH.
    pub fn numbers(&self) -> [f64; 11 + 3 * sh::MAX_COEFFICIENTS] {
        let mut out = [0.0; 11 + 3 * sh::MAX_COEFFICIENTS];
        self.vertices.iter().enumerate().for_each(|(i, v)| v.write_to_slice(&mut out[3 * i..]));
        (out[9], out[10]) = (self.opacity, self.sigma);
        out[11..].copy_from_slice(self.sh.as_flattened());
        out
    }
}

/// Sums over the pixels of a splat.
#[derive(Debug, Clone, Copy)]
struct Sums {
    ratio: [f64; 3],
    moment: [V2<f64>; 3],
    /// ∂L/∂log of the opacity.
    opacity: f64,
    sigma: f64,
    rgb: [f64; 3],
}

const NOTHING: Sums =
    Sums { ratio: [0.0; 3], moment: [V2 { x: 0.0, y: 0.0 }; 3], opacity: 0.0, sigma: 0.0, rgb: [0.0; 3] };

impl ExactFrame {
    /// The gradients for a gradient of the frame just drawn; only its colour and transmittance are used. `[N]`
    pub fn backward(
        &self,
        soup: &Soup,
        camera: &Camera,
        options: &SoftOptions,
        d: &FrameGrad,
    ) -> Vec<ExactGrad> {
        let mut sums = vec![NOTHING; self.splats.len()];
        for (pixel, range) in self.starts.windows(2).enumerate() {
            let d_rgb = d.d_rgb[pixel].map(f64::from);
            let d_t = d.d_transmittance.get(pixel).map_or(0.0, |x| f64::from(*x));
            self.pixel_grad(&self.layers[range[0]..range[1]], d_rgb, d_t, options, &mut sums);
        }
        let camera = ExactCamera::new(camera);
        let mut out = vec![ExactGrad::default(); soup.len()];
        for (splat, sums) in self.splats.iter().zip(&sums) {
            splat_grad(splat, sums, soup, &camera, options, &mut out[splat.triangle]);
        }
        out
    }

    fn pixel_grad(
        &self,
        layers: &[ExactLayer],
        d_rgb: [f64; 3],
        d_t: f64,
        options: &SoftOptions,
        sums: &mut [Sums],
    ) {
        let dot = |rgb: [f64; 3]| (0..3).map(|c| d_rgb[c] * rgb[c]).sum::<f64>();
        // What lies behind a layer, as if it were one opaque layer.
        let mut behind = dot(options.background.map(f64::from)) + d_t;
        for layer in layers.iter().rev() {
            let splat = &self.splats[layer.splat];
            let sums = &mut sums[layer.splat];
            let value = dot(splat.rgb);
            let d_alpha = layer.before * (value - behind);
            behind = layer.alpha * value + (1.0 - layer.alpha) * behind;
            (0..3).for_each(|c| sums.rgb[c] += layer.before * layer.alpha * d_rgb[c]);
            if layer.capped {
                continue;
            }
            let d_log = d_alpha * layer.alpha;
            let least = f64::from(options.ratio_least);
            let (d_sigma, d_ratio) =
                window::alpha_grad(layer.ratio, layer.ratio.log2(), splat.sigma, least, d_log);
            sums.opacity += d_log;
            sums.sigma += d_sigma;
            sums.ratio[layer.nearest] += d_ratio;
            sums.moment[layer.nearest] = sums.moment[layer.nearest] + layer.offset.scale(d_ratio);
        }
    }
}

/// Adds the gradient of a splat to that of its triangle.
fn splat_grad(
    splat: &ExactSplat,
    sums: &Sums,
    soup: &Soup,
    camera: &ExactCamera,
    options: &SoftOptions,
    out: &mut ExactGrad,
) {
    let fade_px = f64::from(options.fade_px);
    let inradius = splat.splat.inradius;
    let by_fade = splat::fade_grad(inradius, fade_px) / splat::fade(inradius, fade_px);
    let d = SplatGrad {
        ratio: sums.ratio,
        moment: sums.moment,
        inradius: sums.opacity * by_fade,
        by_incenter: 1.0,
    };
    let d = splat::splat_grad(&splat.corners, camera.focal, &splat.splat, &d);
    out.opacity += sums.opacity / f64::from(soup.opacity[splat.triangle]);
    out.sigma += sums.sigma;
    let whole = camera.corners(&soup.vertices[splat.triangle]);
    let each = [d.first - d.edges[0] - d.edges[1], d.edges[0], d.edges[1]];
    let mut add = |corner: usize, d: V3<f64>| out.vertices[corner] += camera.rotation.transpose() * dvec3(d);
    for (corner, d) in splat.piece.iter().zip(each) {
        let (from, to) = (corner.from as usize, corner.to as usize);
        if from == to {
            add(from, d);
        } else {
            let (d_from, d_to) = clip::near_point_grad(whole[from], whole[to], f64::from(options.near), d);
            add(from, d_from);
            add(to, d_to);
        }
    }
    color_grad(splat, sums.rgb, soup, camera, out);
}

fn color_grad(splat: &ExactSplat, d: [f64; 3], soup: &Soup, camera: &ExactCamera, out: &mut ExactGrad) {
    let d: [f64; 3] = std::array::from_fn(|c| if splat.rgb[c] > 0.0 || d[c] < 0.0 { d[c] } else { 0.0 });
    let offset = camera.offset(&soup.vertices[splat.triangle]);
    let (length, unit) = (offset.length(), v3(offset.normalize()));
    let (k, basis) = (soup.sh_count(), sh::basis(soup.sh_degree, unit));
    let mut d_basis = [0.0; sh::MAX_COEFFICIENTS];
    for (n, coefficient) in soup.sh[splat.triangle * k..(splat.triangle + 1) * k].iter().enumerate() {
        for c in 0..3 {
            out.sh[n][c] += d[c] * basis[n];
            d_basis[n] += f64::from(coefficient[c]) * d[c];
        }
    }
    let d_offset = sh::normalize_grad(unit, length, sh::basis_grad(soup.sh_degree, unit, &d_basis));
    out.vertices.iter_mut().for_each(|v| *v += dvec3(d_offset) / 3.0);
}
