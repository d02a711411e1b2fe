//! The paper's equations, brute force: every pixel tests every triangle, in absolute pixel
//! coordinates, with outward edge normals and the true maximum. Shares no formula with the kernels;
//! runs on f64 and dual numbers.

use crate::dual::Dual;
use trisplat_scene::math::real::Real;

/// A number with a readable value.
pub trait Number: Real {
    fn value(self) -> f64;
}

impl Number for f64 {
    fn value(self) -> f64 {
        self
    }
}

impl<const N: usize> Number for Dual<N> {
    fn value(self) -> f64 {
        self.v
    }
}

#[derive(Clone)]
pub struct Triangle<R> {
    pub vertices: [[R; 3]; 3],
    pub opacity: R,
    pub sigma: R,
    pub sh: Vec<[R; 3]>,
}

#[derive(Clone, Copy)]
pub struct OracleCamera {
    pub rotation: [[f64; 3]; 3],
    pub translation: [f64; 3],
    pub focal: [f64; 2],
    pub center: [f64; 2],
    pub size: [usize; 2],
}

#[derive(Clone, Copy)]
pub struct Rules {
    pub background: [f64; 3],
    pub per_pixel: bool,
    pub cap: f64,
    pub cutoff: f64,
    pub min_transmittance: f64,
    pub near: f64,
    pub fade_px: f64,
    pub depth_range: [f64; 2],
    /// Width of the ramp when alpha is the part of the pixel that is covered, px.
    pub coverage: Option<f64>,
    pub linear: bool,
}

/// sRGB to linear light, for a number in [0, 1]; beyond, its value at 1.
fn linear_from_srgb<R: Number>(x: R) -> R {
    if x.value() > 1.0 {
        R::of(1.0)
    } else if x.value() > 0.04045 {
        power((x + R::of(0.055)) / R::of(1.055), R::of(2.4))
    } else {
        x / R::of(12.92)
    }
}

/// One pixel.
#[derive(Clone)]
pub struct Pixel<R> {
    pub rgb: [R; 3],
    pub transmittance: R,
    pub depth: R,
    pub median: R,
    pub normal: [R; 3],
    pub distortion: R,
    /// Distance, relative, to the nearest jump or kink of any of the above.
    pub margin: f64,
    /// Weight alpha T of every triangle.
    pub weights: Vec<f64>,
}

type P3<R> = [R; 3];

fn add<R: Number>(a: P3<R>, b: P3<R>) -> P3<R> {
    [0, 1, 2].map(|i| a[i] + b[i])
}
fn sub<R: Number>(a: P3<R>, b: P3<R>) -> P3<R> {
    [0, 1, 2].map(|i| a[i] - b[i])
}
fn mul<R: Number>(a: P3<R>, s: R) -> P3<R> {
    a.map(|x| x * s)
}
fn dot<R: Number>(a: P3<R>, b: P3<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross<R: Number>(a: P3<R>, b: P3<R>) -> P3<R> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn power<R: Number>(x: R, e: R) -> R {
    (x.log2() * e).exp2()
}

/// A convex piece of a triangle on the screen.
struct Piece<R> {
    triangle: usize,
    /// Outward unit normals and offsets: L_i(p) = n · p + d.
    lines: [[R; 3]; 3],
    /// φ(s), negative.
    phi_s: R,
    opacity: R,
    sigma: R,
    rgb: [R; 3],
    depth: R,
    /// Plane n · x = d in camera space.
    plane: [R; 3],
    plane_d: R,
}

fn to_camera<R: Number>(camera: &OracleCamera, v: P3<R>) -> P3<R> {
    [0, 1, 2].map(|i| dot(camera.rotation[i].map(R::of), v) + R::of(camera.translation[i]))
}

/// Corners in front of the near plane, in order (Sutherland-Hodgman), starting with a corner of the
/// triangle that follows the cut, if there is one.
fn clip<R: Number>(v: [P3<R>; 3], near: f64) -> Vec<P3<R>> {
    let mut out: Vec<(P3<R>, bool)> = Vec::new();
    for i in 0..3 {
        let a = v[i];
        let b = v[(i + 1) % 3];
        let ia = a[2].value() >= near;
        let ib = b[2].value() >= near;
        if ia {
            out.push((a, true));
        }
        if ia != ib {
            let t = (R::of(near) - a[2]) / (b[2] - a[2]);
            out.push((add(a, mul(sub(b, a), t)), false));
        }
    }
    let start =
        (0..out.len()).find(|i| out[*i].1 && !out[(*i + out.len() - 1) % out.len()].1).unwrap_or(0);
    out.rotate_left(start);
    out.into_iter().map(|(p, _)| p).collect()
}

fn sh_color<R: Number>(sh: &[[R; 3]], d: P3<R>) -> [R; 3] {
    let [x, y, z] = d;
    let c = R::of;
    let basis: Vec<R> = vec![
        c(0.28209479177387814),
        c(-0.4886025119029199) * y,
        c(0.4886025119029199) * z,
        c(-0.4886025119029199) * x,
        c(1.0925484305920792) * x * y,
        c(-1.0925484305920792) * y * z,
        c(0.31539156525252005) * (c(2.0) * z * z - x * x - y * y),
        c(-1.0925484305920792) * x * z,
        c(0.5462742152960396) * (x * x - y * y),
        c(-0.5900435899266435) * y * (c(3.0) * x * x - y * y),
        c(2.890611442640554) * x * y * z,
        c(-0.4570457994644658) * y * (c(4.0) * z * z - x * x - y * y),
        c(0.3731763325901154) * z * (c(2.0) * z * z - c(3.0) * x * x - c(3.0) * y * y),
        c(-0.4570457994644658) * x * (c(4.0) * z * z - x * x - y * y),
        c(1.445305721320277) * z * (x * x - y * y),
        c(-0.5900435899266435) * x * (x * x - c(3.0) * y * y),
    ];
    [0, 1, 2].map(|channel| {
        let mut sum = c(0.5);
        for (b, k) in basis.iter().zip(sh) {
            sum = sum + *b * k[channel];
        }
        if sum.value() > 0.0 { sum } else { c(0.0) }
    })
}

fn piece<R: Number>(
    camera: &OracleCamera,
    rules: &Rules,
    t: &Triangle<R>,
    triangle: usize,
    v: [P3<R>; 3],
) -> Option<Piece<R>> {
    let q: [[R; 2]; 3] =
        v.map(|p| [0, 1].map(|i| R::of(camera.focal[i]) * p[i] / p[2] + R::of(camera.center[i])));
    let distance = |a: [R; 2], b: [R; 2]| {
        let x = b[0] - a[0];
        let y = b[1] - a[1];
        (x * x + y * y).sqrt()
    };
    // Incenter: corners weighted by the lengths of the opposite sides.
    let opposite = [distance(q[1], q[2]), distance(q[2], q[0]), distance(q[0], q[1])];
    let perimeter = opposite[0] + opposite[1] + opposite[2];
    if !(perimeter.value() > 0.0) {
        return None;
    }
    let s = [0, 1].map(|i| {
        (q[0][i] * opposite[0] + q[1][i] * opposite[1] + q[2][i] * opposite[2]) / perimeter
    });
    let lines = [0, 1, 2].map(|i| {
        let a = q[i];
        let b = q[(i + 1) % 3];
        let length = distance(a, b);
        let mut n = [(b[1] - a[1]) / length, (a[0] - b[0]) / length];
        let mut d = -(n[0] * a[0] + n[1] * a[1]);
        if (n[0] * s[0] + n[1] * s[1] + d).value() > 0.0 {
            n = n.map(|x| -x);
            d = -d;
        }
        [n[0], n[1], d]
    });
    let phi_s = phi(&lines, s).0;
    if !(phi_s.value() < 0.0) {
        return None;
    }
    let inradius = -phi_s;
    let mut opacity = t.opacity;
    if rules.coverage.is_none() && rules.fade_px > 0.0 && inradius.value() < rules.fade_px {
        let x = inradius / R::of(rules.fade_px);
        opacity = opacity * x * x * (R::of(3.0) - R::of(2.0) * x);
    }
    let centroid = mul(add(add(t.vertices[0], t.vertices[1]), t.vertices[2]), R::of(1.0 / 3.0));
    let position = [0, 1, 2]
        .map(|i| -(0..3).map(|j| camera.rotation[j][i] * camera.translation[j]).sum::<f64>());
    let offset = sub(centroid, position.map(R::of));
    let unit = mul(offset, R::of(1.0) / dot(offset, offset).sqrt());
    let plane = cross(sub(v[1], v[0]), sub(v[2], v[0]));
    Some(Piece {
        triangle,
        lines,
        phi_s,
        opacity,
        sigma: t.sigma,
        rgb: if rules.linear {
            sh_color(&t.sh, unit).map(linear_from_srgb)
        } else {
            sh_color(&t.sh, unit)
        },
        depth: (v[0][2] + v[1][2] + v[2][2]) / R::of(3.0),
        plane,
        plane_d: dot(plane, v[0]),
    })
}

/// φ(p) = max_i L_i(p), and its distance to the second largest.
fn phi<R: Number>(lines: &[[R; 3]; 3], p: [R; 2]) -> (R, f64) {
    let mut l = lines.map(|[a, b, d]| a * p[0] + b * p[1] + d).to_vec();
    l.sort_by(|a, b| b.value().total_cmp(&a.value()));
    (l[0], l[0].value() - l[1].value())
}

/// All pixels, row by row.
pub fn render<R: Number>(
    triangles: &[Triangle<R>],
    camera: &OracleCamera,
    rules: &Rules,
) -> Vec<Pixel<R>> {
    let mut pieces = Vec::new();
    for (i, t) in triangles.iter().enumerate() {
        let corners = clip(t.vertices.map(|v| to_camera(camera, v)), rules.near);
        for k in 2..corners.len() {
            pieces.extend(piece(camera, rules, t, i, [corners[0], corners[k - 1], corners[k]]));
        }
    }
    pieces.sort_by(|a, b| a.depth.value().total_cmp(&b.depth.value()));
    let mut out = Vec::new();
    for y in 0..camera.size[1] {
        for x in 0..camera.size[0] {
            out.push(pixel(
                &pieces,
                triangles.len(),
                camera,
                rules,
                [x as f64 + 0.5, y as f64 + 0.5],
            ));
        }
    }
    out
}

struct Layer<R> {
    alpha: R,
    z: R,
    normal: P3<R>,
    piece: usize,
}

/// Depth of the piece's plane at p, and its unit normal towards the camera.
fn plane_at<R: Number>(piece: &Piece<R>, camera: &OracleCamera, p: [f64; 2]) -> (R, P3<R>) {
    let ray = [
        (p[0] - camera.center[0]) / camera.focal[0],
        (p[1] - camera.center[1]) / camera.focal[1],
        1.0,
    ]
    .map(R::of);
    let z = piece.plane_d / dot(piece.plane, ray);
    let n = mul(piece.plane, R::of(1.0) / dot(piece.plane, piece.plane).sqrt());
    (z, if dot(n, ray).value() > 0.0 { n.map(|x| -x) } else { n })
}

/// Opacity times the part of the pixel that is inside: 1 less the parts beyond each edge's line.
fn coverage_alpha<R: Number>(
    piece: &Piece<R>,
    p: [f64; 2],
    width: f64,
    cutoff: f64,
    margin: &mut f64,
) -> Option<R> {
    let mut inside = R::of(1.0);
    for [a, b, d] in piece.lines {
        let beyond = (a * R::of(p[0]) + b * R::of(p[1]) + d) / R::of(width) + R::of(0.5);
        *margin = margin.min(beyond.value().abs());
        if beyond.value() > 0.0 {
            inside = inside - beyond;
        }
    }
    let alpha = inside * piece.opacity;
    *margin = margin.min((alpha.value() / cutoff - 1.0).abs());
    (alpha.value() >= cutoff).then_some(alpha)
}

/// The layers drawn at p, in blending order.
fn layers<R: Number>(
    pieces: &[Piece<R>],
    camera: &OracleCamera,
    rules: &Rules,
    p: [f64; 2],
    margin: &mut f64,
) -> Vec<Layer<R>> {
    let mut out: Vec<Layer<R>> = Vec::new();
    for (index, piece) in pieces.iter().enumerate() {
        if let Some(width) = rules.coverage {
            let alpha = coverage_alpha(piece, p, width, rules.cutoff, margin);
            if let Some(alpha) = alpha {
                let (z, normal) = plane_at(piece, camera, p);
                out.push(Layer { alpha, z, normal, piece: index });
            }
            continue;
        }
        let (at, gap) = phi(&piece.lines, p.map(R::of));
        let ratio = at / piece.phi_s;
        // Half a pixel around the boundary of a solid triangle everything jumps.
        let from_floor = (ratio.value() - 2f64.powi(-20)).abs();
        if !(ratio.value() >= 2f64.powi(-20)) {
            let edge_alpha = piece.opacity.value() * 1e-3f64.powf(piece.sigma.value());
            if edge_alpha >= rules.cutoff {
                *margin = margin.min(from_floor);
            }
            continue;
        }
        let value = piece.opacity * power(ratio, piece.sigma);
        *margin = margin.min((value.value() / rules.cutoff - 1.0).abs());
        if value.value() < rules.cutoff {
            continue;
        }
        *margin = margin.min(from_floor).min(gap).min((value.value() - rules.cap).abs());
        let alpha = if value.value() > rules.cap { R::of(rules.cap) } else { value };
        let (z, normal) = plane_at(piece, camera, p);
        out.push(Layer { alpha, z, normal, piece: index });
    }
    if !rules.per_pixel {
        // Depths that differ by less than 5e-6 may be taken in either order by single precision,
        // equal ones go by their index.
        for pair in out.windows(2) {
            let gap =
                pieces[pair[1].piece].depth.value() / pieces[pair[0].piece].depth.value() - 1.0;
            *margin = if gap > 0.0 { margin.min(100.0 * gap) } else { *margin };
        }
    }
    if rules.per_pixel {
        out.sort_by(|a, b| a.z.value().total_cmp(&b.z.value()));
        for pair in out.windows(2) {
            *margin = margin.min((pair[1].z.value() / pair[0].z.value() - 1.0).abs());
        }
    }
    out
}

fn pixel<R: Number>(
    pieces: &[Piece<R>],
    count: usize,
    camera: &OracleCamera,
    rules: &Rules,
    p: [f64; 2],
) -> Pixel<R> {
    let zero = R::of(0.0);
    let mut out = Pixel {
        rgb: [zero; 3],
        transmittance: R::of(1.0),
        depth: zero,
        median: zero,
        normal: [zero; 3],
        distortion: zero,
        margin: f64::INFINITY,
        weights: vec![0.0; count],
    };
    let mut margin = f64::INFINITY;
    let layers = layers(pieces, camera, rules, p, &mut margin);
    let mut front: Vec<(R, R)> = Vec::new();
    for layer in layers {
        if out.transmittance.value() < rules.min_transmittance {
            break;
        }
        let before = out.transmittance;
        let w = before * layer.alpha;
        out.transmittance = before - w;
        let after = out.transmittance.value();
        margin = margin.min((after / rules.min_transmittance - 1.0).abs()).min((after - 0.5).abs());
        out.rgb = add(out.rgb, mul(pieces[layer.piece].rgb, w));
        out.depth = out.depth + layer.z * w;
        out.normal = add(out.normal, mul(layer.normal, w));
        if before.value() >= 0.5 && after < 0.5 {
            out.median = layer.z;
        }
        let [near, far] = rules.depth_range;
        let m = R::of(far / (far - near)) - R::of(far * near / (far - near)) / layer.z;
        for (wj, mj) in &front {
            out.distortion = out.distortion + w * *wj * (m - *mj) * (m - *mj);
        }
        front.push((w, m));
        out.weights[pieces[layer.piece].triangle] += w.value();
    }
    let background = rules.background.map(R::of);
    let background = if rules.linear { background.map(linear_from_srgb) } else { background };
    out.rgb = add(out.rgb, mul(background, out.transmittance));
    out.margin = margin;
    out
}
