//! Every kernel function in WGSL against its Rust twin, on the same random numbers.

use super::card;
use trisplat_gpu::{Gpu, Kernel, readback::elements, storage, workgroups};
use trisplat_raster::{
    kernel::splat::{self, CameraTriangle, DepthPlane, DepthPlaneGrad, Splat, SplatGrad},
    kernel::splat::{near_point, near_point_grad, pieces},
    kernel::{Rate, adam, sh, wgsl_library, window},
};
use trisplat_scene::{
    Rng,
    math::color,
    math::metric::factors,
    math::real::{V2, V3},
};

/// Rows of random numbers that each function gets.
const ROWS: usize = 2000;

/// A function of some numbers and its twin.
struct Twin {
    name: &'static str,
    /// Ranges of the numbers it gets: `x` in WGSL.
    domain: &'static [(f32, f32)],
    /// Statements that set `y`.
    wgsl: &'static str,
    outputs: usize,
    rust: fn(&[f32]) -> Vec<f32>,
    /// Largest error: of 99.9% of the rows, relative to the number, or to a fiftieth of the largest
    /// number of that output.
    bound: f32,
}

/// Camera-space triangles: a corner, and two edges that make no sliver.
const TRIANGLE: [(f32, f32); 9] = [
    (-1.0, 1.0),
    (-1.0, 1.0),
    (2.0, 6.0),
    (0.3, 1.0),
    (-0.2, 0.2),
    (-0.5, 0.5),
    (-0.2, 0.2),
    (0.3, 1.0),
    (-0.5, 0.5),
];
const TRIANGLE_10: [(f32, f32); 19] = with_grads([(-1.0, 1.0); 10]);

const fn with_grads(grads: [(f32, f32); 10]) -> [(f32, f32); 19] {
    let mut out = [(0.0, 0.0); 19];
    let mut i = 0;
    while i < 19 {
        out[i] = if i < 9 { TRIANGLE[i] } else { grads[i - 9] };
        i += 1;
    }
    out
}

const FOCAL: V2<f32> = V2 { x: 600.0, y: 580.0 };
const CENTER: V2<f32> = V2 { x: 320.0, y: 240.0 };
const WGSL_TRIANGLE: &str =
    "let t = CameraTriangle(vec3(x[0], x[1], x[2]), vec3(x[3], x[4], x[5]), vec3(x[6], x[7], x[8]));
    let s = project_splat(t, vec2(600.0, 580.0), vec2(320.0, 240.0));";

fn v2(x: &[f32]) -> V2<f32> {
    V2::new(x[0], x[1])
}

fn v3(x: &[f32]) -> V3<f32> {
    V3::new(x[0], x[1], x[2])
}

fn triangle(x: &[f32]) -> (CameraTriangle<f32>, Splat<f32>) {
    let t = CameraTriangle { first: v3(x), edges: [v3(&x[3..]), v3(&x[6..])] };
    (t, splat::splat(&t, FOCAL, CENTER))
}

fn flat(t: &CameraTriangle<f32>) -> Vec<f32> {
    [t.first, t.edges[0], t.edges[1]].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

fn mask(m: [bool; 3]) -> Vec<f32> {
    m.map(|is| f32::from(u8::from(is))).to_vec()
}

const TWINS: &[Twin] = &[
    Twin { name: "log2_lane", domain: &[(1e-6, 2.0)], wgsl: "y[0] = log2_lane(x[0]);", outputs: 1, rust: |x| vec![x[0].log2()], bound: 1e-6 },
    Twin { name: "exp2_lane", domain: &[(-30.0, 1.0)], wgsl: "y[0] = exp2_lane(x[0]);", outputs: 1, rust: |x| vec![x[0].exp2()], bound: 1e-6 },
    Twin { name: "exp_lane", domain: &[(-9.0, 9.0)], wgsl: "y[0] = exp_lane(x[0]);", outputs: 1, rust: |x| vec![x[0].exp()], bound: 2e-6 },
    Twin {
        name: "decode, encode",
        domain: &[(0.0, 1.3)],
        wgsl: "let d = decode(x[0]); let e = encode(x[0]); y = array(d.x, d.y, e.x, e.y, linear_from_srgb(x[0]), srgb_from_linear(x[0]));",
        outputs: 6,
        rust: |x| {
            let d = color::decode(x[0]);
            let e = color::encode(x[0]);
            vec![d.0, d.1, e.0, e.1, color::linear_from_srgb(x[0]), color::srgb_from_linear(x[0])]
        },
        bound: 3e-6,
    },
    Twin {
        name: "ratio_floor, window_alpha, alpha_grad",
        domain: &[(-8.0, 0.0), (0.05, 10.0), (0.001, 1.0), (-1.0, 1.0)],
        wgsl: "let l = log2_lane(x[2]); let d = alpha_grad(x[2], l, x[1], 0.001, x[3]);
            y = array(ratio_floor(x[0], x[1], -8.0), window_alpha(l, x[0], x[1]), d.x, d.y);",
        outputs: 4,
        rust: |x| {
            let l = x[2].log2();
            let d = window::alpha_grad(x[2], l, x[1], 0.001, x[3]);
            vec![window::ratio_floor(x[0], x[1], -8.0), window::alpha(l, x[0], x[1]), d.0, d.1]
        },
        bound: 2e-5,
    },
    Twin {
        name: "coverage, coverage_edges, nearest, ratios",
        domain: &[(-1.0, 1.0); 9],
        wgsl: "let r = ratios(vec2(x[0], x[1]), vec2(x[2], x[3]), vec2(x[4], x[5]), x[6], vec2(x[7], x[8]));
            let e = coverage_edges(r); let n = nearest(r);
            y = array(r.x, r.y, r.z, window_ratio(r), coverage(r), e.x, e.y, e.z, n.x, n.y, n.z);",
        outputs: 11,
        rust: |x| {
            let r = window::ratios(&[v2(x), v2(&x[2..]), v2(&x[4..])], x[6], v2(&x[7..]));
            let e = mask(window::coverage_edges(&r));
            let n = mask(window::nearest(&r));
            [r.to_vec(), vec![window::ratio(&r), window::coverage(&r)], e, n].concat()
        },
        bound: 1e-5,
    },
    Twin {
        name: "blend, blend_grad, distortion, distortion_grad",
        domain: &[(0.0, 1.0), (0.0, 0.99), (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (0.0, 1.0), (0.0, 1.0), (0.0, 1.0)],
        wgsl: "let b = blend(x[0], x[1]); let g = distortion_grad(x[0], x[2], vec3(x[5], x[6], x[7]));
            y = array(b.x, b.y, blend_grad(x[0], x[1], x[2], x[3], false, x[4]), blend_grad(x[0], x[1], x[2], x[3], true, x[4]),
                distortion(x[0], x[2], vec3(x[5], x[6], x[7])), g.x, g.y);",
        outputs: 7,
        rust: |x| {
            let b = window::blend(x[0], x[1]);
            let sums = [x[5], x[6], x[7]];
            let grad = |last| window::blend_grad(x[0], x[1], x[2], x[3], last, x[4]);
            let g = window::distortion_grad(x[0], x[2], sums);
            vec![b.0, b.1, grad(false), grad(true), window::distortion(x[0], x[2], sums), g.0, g.1]
        },
        bound: 1e-5,
    },
    Twin {
        name: "project_splat, incenter, fade, fade_grad",
        domain: &TRIANGLE,
        wgsl: "let c = incenter(s);
            y = array(s.origin.x, s.origin.y, s.side1.x, s.side1.y, s.side2.x, s.side2.y, s.edge[0].x, s.edge[0].y, s.edge[1].x, s.edge[1].y,
                s.edge[2].x, s.edge[2].y, s.shift, s.inradius, c.x, c.y, fade(s.inradius, 40.0), fade_grad(s.inradius, 40.0));",
        outputs: 18,
        rust: |x| {
            let (_, s) = triangle(x);
            let c = splat::incenter(&s);
            let points = [s.origin, s.sides[0], s.sides[1], s.edge[0], s.edge[1], s.edge[2]];
            let mut out: Vec<f32> = points.iter().flat_map(|p| [p.x, p.y]).collect();
            out.extend([s.shift, s.inradius, c.x, c.y, splat::fade(s.inradius, 40.0), splat::fade_grad(s.inradius, 40.0)]);
            out
        },
        bound: 5e-5,
    },
    Twin {
        name: "splat_grad",
        domain: &TRIANGLE_10,
        wgsl: "let d = SplatGrad(vec3(x[9], x[10], x[11]), array(vec2(x[12], x[13]), vec2(x[14], x[15]), vec2(x[16], x[17])), x[18], 1.0);
            let g = splat_grad(t, vec2(600.0, 580.0), s, d);
            y = array(g.first.x, g.first.y, g.first.z, g.edge1.x, g.edge1.y, g.edge1.z, g.edge2.x, g.edge2.y, g.edge2.z);",
        outputs: 9,
        rust: |x| {
            let (t, s) = triangle(x);
            let moment = [v2(&x[12..]), v2(&x[14..]), v2(&x[16..])];
            let d = SplatGrad { ratio: [x[9], x[10], x[11]], moment, inradius: x[18], by_incenter: 1.0 };
            flat(&splat::splat_grad(&t, FOCAL, &s, &d))
        },
        bound: 1e-4,
    },
    Twin {
        name: "depth_plane, depth_plane_grad",
        domain: &TRIANGLE_10,
        wgsl: "let p = depth_plane(t, vec2(600.0, 580.0));
            let g = depth_plane_grad(t, vec2(600.0, 580.0), s, p, DepthPlane(x[9], vec2(x[10], x[11]), vec3(x[12], x[13], x[14])));
            y = array(p.inv_depth, p.slope.x, p.slope.y, p.normal.x, p.normal.y, p.normal.z,
                g.first.x, g.first.y, g.first.z, g.edge1.x, g.edge1.y, g.edge1.z, g.edge2.x, g.edge2.y, g.edge2.z);",
        outputs: 15,
        rust: |x| {
            let (t, s) = triangle(x);
            let p: DepthPlane<f32> = splat::depth_plane(&t, FOCAL);
            let d = DepthPlaneGrad { inv_depth: x[9], slope: v2(&x[10..]), normal: v3(&x[12..]) };
            let g = splat::depth_plane_grad(&t, FOCAL, &s, &p, &d);
            let mut out = vec![p.inv_depth, p.slope.x, p.slope.y, p.normal.x, p.normal.y, p.normal.z];
            out.extend(flat(&g));
            out
        },
        bound: 1e-4,
    },
    Twin {
        name: "near_point, near_point_grad",
        domain: &[(-1.0, 1.0), (-1.0, 1.0), (0.1, 2.0), (-1.0, 1.0), (-1.0, 1.0), (-2.0, -0.1), (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)],
        wgsl: "let f = vec3(x[0], x[1], x[2]); let b = vec3(x[3], x[4], x[5]);
            let p = near_point(f, b, 0.05); let g = near_point_grad(f, b, 0.05, vec3(x[6], x[7], x[8]));
            y = array(p.x, p.y, p.z, g.front.x, g.front.y, g.front.z, g.back.x, g.back.y, g.back.z);",
        outputs: 9,
        rust: |x| {
            let f = v3(x);
            let b = v3(&x[3..]);
            let p = near_point(f, b, 0.05);
            let (df, db) = near_point_grad(f, b, 0.05, v3(&x[6..]));
            [p, df, db].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
        },
        bound: 1e-5,
    },
    Twin {
        name: "clip_pieces",
        domain: &[(0.0, 8.0)],
        wgsl: "let p = clip_pieces(u32(x[0])); y = array(f32(p.count), f32(p.piece[0]), f32(p.piece[1]));",
        outputs: 3,
        rust: |x| {
            let bits = x[0] as u32;
            let (found, count) = pieces([0, 1, 2].map(|i| bits >> i & 1 == 1));
            let code = |at: usize| {
                let corner = |(k, c): (usize, &trisplat_raster::kernel::splat::PieceCorner)| u32::from(c.from | c.to << 2) << (4 * k);
                found[at].iter().enumerate().map(corner).sum::<u32>() as f32
            };
            vec![count as f32, code(0), code(1)]
        },
        bound: 0.0,
    },
    Twin {
        name: "sh_basis, sh_basis_grad, normalize_grad",
        domain: &[(-1.0, 1.0); 3],
        wgsl: "let v = normalize(vec3(x[0], x[1], x[2]) + vec3(0.0, 0.0, 1e-3)); let b = sh_basis(3u, v); let g = sh_basis_grad(3u, v, b);
            let u = normalize_grad(v, 2.0, vec3(x[1], x[2], x[0]));
            for (var k = 0u; k < 16u; k++) { y[k] = b[k]; } y[16] = g.x; y[17] = g.y; y[18] = g.z; y[19] = u.x; y[20] = u.y; y[21] = u.z;",
        outputs: 22,
        rust: |x| {
            let v = v3(&[x[0], x[1], x[2] + 1e-3]);
            let v = v.scale(1.0 / v.length());
            let b = sh::basis(3, v);
            let g = sh::basis_grad(3, v, &b);
            let u = sh::normalize_grad(v, 2.0, v3(&[x[1], x[2], x[0]]));
            let mut out = b.to_vec();
            out.extend([g.x, g.y, g.z, u.x, u.y, u.z]);
            out
        },
        bound: 5e-5,
    },
    Twin {
        name: "adam",
        domain: &[(-1.0, 1.0), (-1.0, 1.0), (-0.1, 0.1), (0.0, 0.1)],
        wgsl: "let a = adam(0.01, 3.0, x[1], Adam(x[0], x[2], x[3])); y = array(a.value, a.first, a.second);",
        outputs: 3,
        rust: |x| {
            // A rate whose numbers are 0.01 and 3: those of the WGSL.
            let mut value = [x[0]];
            let mut m = [x[2]];
            let mut v = [x[3]];
            let rate = Rate { step: 0.01, second: 3.0 };
            adam(rate, &mut value, &[x[1]], &mut m, &mut v);
            vec![value[0], m[0], v[0]]
        },
        bound: 1e-5,
    },
    Twin {
        name: "ssim_grad",
        domain: &[(0.0, 1.0), (0.0, 1.0), (0.1, 0.4), (-0.05, 0.05)],
        wgsl: "let s = ssim_grad(x[0], x[1], x[0] * x[0] + x[1] * x[1] + x[2], x[0] * x[1] + x[3], 1.0);
            y = array(s.value, s.d_mean, s.d_square, s.d_cross);",
        outputs: 4,
        rust: |x| {
            let [a, b] = [x[0], x[1]].map(f64::from);
            let variances = f64::from(x[2]);
            let ab = a * b + f64::from(x[3]);
            let f = factors(a, b, ab, variances);
            let s = f.luminance * f.structure / (f.means * f.variances);
            let d_mean = 2.0 * (b * (f.structure - f.luminance) / (f.means * f.variances) + s * a * (1.0 / f.variances - 1.0 / f.means));
            [s, d_mean, -s / f.variances, 2.0 * f.luminance / (f.means * f.variances)].map(|v| v as f32).to_vec()
        },
        bound: 1e-4,
    },
];

/// Results of the card for rows of numbers.
fn on_the_card(gpu: &Gpu, twin: &Twin, input: &[f32]) -> Vec<f32> {
    let ins = twin.domain.len();
    let outs = twin.outputs;
    let triangle = if ins >= 9 && twin.wgsl.contains("s.") || twin.wgsl.contains(", s, ") {
        WGSL_TRIANGLE
    } else {
        ""
    };
    let source = format!(
        "{}
        @group(0) @binding(0) var<storage, read> input: array<f32>;
        @group(0) @binding(1) var<storage, read_write> output: array<f32>;
        @compute @workgroup_size(64)
        fn twin(@builtin(global_invocation_id) id: vec3<u32>) {{
            if id.x >= {ROWS}u {{ return; }}
            var x: array<f32, {ins}>;
            var y: array<f32, {outs}>;
            for (var k = 0u; k < {ins}u; k++) {{ x[k] = input[id.x * {ins}u + k]; }}
            {triangle}
            {}
            for (var k = 0u; k < {outs}u; k++) {{ output[id.x * {outs}u + k] = y[k]; }}
        }}",
        wgsl_library(),
        twin.wgsl
    );
    let kernel = Kernel::new(gpu, "twin", source).unwrap();
    let buffer = |what, numbers: usize| storage(gpu, what, 4 * numbers as u64, "").unwrap();
    let from = buffer("input", input.len());
    let to = buffer("output", ROWS * outs);
    gpu.queue.write_buffer(&from, 0, bytemuck::cast_slice(input));
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(kernel.pipeline());
    pass.set_bind_group(
        0,
        &kernel.bind(gpu, &[from.as_entire_binding(), to.as_entire_binding()]),
        &[],
    );
    let [across, down] = workgroups((ROWS as u32).div_ceil(64));
    pass.dispatch_workgroups(across, down, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    elements(gpu, &to, ROWS * outs).unwrap()
}

/// Errors of all rows, the largest last.
fn errors(twin: &Twin, input: &[f32], output: &[f32]) -> Vec<f32> {
    let expected: Vec<Vec<f32>> = input.chunks_exact(twin.domain.len()).map(twin.rust).collect();
    let largest = |k: usize| expected.iter().map(|row| row[k].abs()).fold(1e-30, f32::max);
    let scales: Vec<f32> = (0..twin.outputs).map(|k| largest(k) / 50.0).collect();
    let error = |(row, out): (&Vec<f32>, &[f32])| {
        let each = (0..twin.outputs).map(|k| (row[k] - out[k]).abs() / row[k].abs().max(scales[k]));
        each.fold(0.0, |most: f32, e| if e.is_nan() { f32::INFINITY } else { most.max(e) })
    };
    let mut all: Vec<f32> =
        expected.iter().zip(output.chunks_exact(twin.outputs)).map(error).collect();
    all.sort_by(f32::total_cmp);
    all
}

#[test]
fn wgsl_functions_equal_their_rust_twins() {
    let Some(gpu) = card() else { return };
    let mut wrong = Vec::new();
    for twin in TWINS {
        let rng = Rng::new(3, twin.name, 0);
        let number = |i: usize| {
            let (low, high) = twin.domain[i % twin.domain.len()];
            low + (high - low) * rng.uniform(i as u64)
        };
        let input: Vec<f32> = (0..ROWS * twin.domain.len()).map(number).collect();
        let errors = errors(twin, &input, &on_the_card(&gpu, twin, &input));
        let error = errors[ROWS - 1 - ROWS / 1000];
        eprintln!("{}: {error:.1e} (largest {:.1e})", twin.name, errors[ROWS - 1]);
        if !(error <= twin.bound) {
            wrong.push(format!("{}: {error:e}, at most {:e}", twin.name, twin.bound));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
