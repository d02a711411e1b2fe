//! The studio: an analytic scene with a known surface everywhere. Balls, a ring, a chest, a colour
//! chart and thin poles stand on a chequered stage under a far dome. World axes are those of
//! COLMAP: -y is up.

use glam::{DMat3, DVec2, DVec3, UVec2, dvec3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// One textured surface of the scene, mapped from the unit square.
pub(super) struct Surface {
    pub(super) shape: SurfaceShape,
    pub(super) texture: Texture,
    /// Triangles per area, relative to the stage.
    pub(super) density: f64,
    /// Strength of the highlight.
    gloss: f64,
}

/// A map from the unit square to the world.
pub(super) enum SurfaceShape {
    /// A parallelogram; its normal is u × v.
    Parallelogram { origin: DVec3, u: DVec3, v: DVec3 },
    /// A sixth of a sphere, above one face of the cube inside it; `axes` are the face's u, v and
    /// normal.
    Cap { center: DVec3, radius: f64, axes: DMat3 },
    /// A torus lying flat.
    Ring { center: DVec3, major: f64, minor: f64 },
    /// The mantle of an upright cylinder.
    Pole { foot: DVec3, radius: f64, height: f64 },
}

/// Colour over the unit square. Colours are linear light.
pub(super) enum Texture {
    /// One colour.
    Flat(DVec3),
    /// A chequerboard, by its number of squares per side.
    Check(u32, DVec3, DVec3),
    /// Bands along u in two colours.
    Stripes(u32, DVec3, DVec3),
    /// Boards of wood with grain.
    Planks(u32, DVec3),
    /// 6 x 4 patches of the colour circle and greys, in a dark frame.
    Chart,
    /// Light from above, haze at the horizon.
    Sky,
}

impl SurfaceShape {
    /// World point of (u, v) in the unit square.
    pub(super) fn point(&self, at: DVec2) -> DVec3 {
        let around = || {
            let (sin, cos) = (TAU * at.x).sin_cos();
            dvec3(cos, 0.0, sin)
        };
        match self {
            SurfaceShape::Parallelogram { origin, u, v } => origin + u * at.x + v * at.y,
            SurfaceShape::Cap { center, radius, axes } => {
                // Equal steps are equal angles, which keeps the patches of a sphere alike in size.
                let angle = (at - 0.5) * FRAC_PI_2;
                center + *axes * dvec3(angle.x.tan(), angle.y.tan(), 1.0).normalize() * *radius
            }
            SurfaceShape::Ring { center, major, minor } => {
                let (sin, cos) = (TAU * at.y).sin_cos();
                center + around() * (major + minor * cos) + DVec3::Y * (minor * sin)
            }
            SurfaceShape::Pole { foot, radius, height } => {
                foot + around() * *radius + DVec3::NEG_Y * (height * at.y)
            }
        }
    }

    /// Unit normal at (u, v), outward.
    pub(super) fn normal(&self, at: DVec2) -> DVec3 {
        let point = self.point(at);
        let flat = |v: DVec3| dvec3(v.x, 0.0, v.z).normalize();
        match self {
            SurfaceShape::Parallelogram { u, v, .. } => u.cross(*v).normalize(),
            SurfaceShape::Cap { center, .. } => (point - center).normalize(),
            SurfaceShape::Ring { center, major, .. } => {
                (point - center - flat(point - center) * *major).normalize()
            }
            SurfaceShape::Pole { foot, .. } => flat(point - foot),
        }
    }

    /// World lengths of one step along u and along v at (u, v).
    pub(super) fn stretch(&self, at: DVec2) -> DVec2 {
        let half = 1.0 / 1024.0;
        let step =
            |axis: DVec2| (self.point(at + axis * half) - self.point(at - axis * half)).length();
        DVec2::new(step(DVec2::X), step(DVec2::Y)) / (2.0 * half)
    }

    /// Largest extent of a flat triangle along u and v that still follows the curve, in world
    /// units.
    pub(super) fn reach(&self) -> DVec2 {
        match self {
            SurfaceShape::Parallelogram { .. } => DVec2::INFINITY,
            SurfaceShape::Cap { radius, .. } => DVec2::splat(0.6 * radius),
            SurfaceShape::Ring { minor, .. } => DVec2::splat(0.8 * minor),
            SurfaceShape::Pole { radius, height, .. } => DVec2::new(0.8 * radius, *height),
        }
    }

    /// Surface in square world units.
    pub(super) fn area(&self) -> f64 {
        match self {
            SurfaceShape::Parallelogram { u, v, .. } => u.cross(*v).length(),
            SurfaceShape::Cap { radius, .. } => 2.0 * TAU * radius * radius / 6.0,
            SurfaceShape::Ring { major, minor, .. } => TAU * major * TAU * minor,
            SurfaceShape::Pole { radius, height, .. } => TAU * radius * height,
        }
    }
}

impl Texture {
    /// Patches of uniform colour along u and v; no solid triangle crosses their borders.
    pub(super) fn patches(&self) -> UVec2 {
        match self {
            Texture::Flat(_) | Texture::Sky => UVec2::ONE,
            Texture::Check(n, ..) => UVec2::splat(*n),
            Texture::Stripes(n, ..) => UVec2::new(*n, 1),
            Texture::Planks(n, _) => UVec2::new(1, *n),
            Texture::Chart => CHART,
        }
    }

    /// Linear colour at (u, v), where the surface faces `normal`, before lighting.
    fn color(&self, at: DVec2, normal: DVec3) -> DVec3 {
        let patch = (at * self.patches().as_dvec2()).floor();
        let odd = |x: f64| (x as i64).rem_euclid(2) == 1;
        match self {
            Texture::Flat(color) => *color,
            Texture::Check(_, a, b) => *if odd(patch.x + patch.y) { b } else { a },
            Texture::Stripes(_, a, b) => *if odd(patch.x) { b } else { a },
            Texture::Planks(_, color) => {
                let tone = 0.8 + 0.35 * (patch.y * 2.4 + 0.7).sin().abs();
                let grain = (at.x * 9.0 + 3.0 * (at.y * 40.0 + patch.y).sin()).sin();
                *color * (tone + 0.1 * grain)
            }
            Texture::Chart => chart(patch),
            Texture::Sky => {
                let haze = (1.0 - 2.5 * normal.y.abs()).max(0.0);
                let high = 0.5 - 0.5 * normal.y;
                dvec3(0.16, 0.20, 0.27).lerp(dvec3(0.30, 0.45, 0.68), high)
                    + haze * dvec3(0.34, 0.27, 0.18)
            }
        }
    }
}

/// Patches of the colour chart, frame included.
const CHART: UVec2 = UVec2::new(8, 6);

/// Linear colour of one patch of the chart: three rows of the colour circle, one of greys.
fn chart(patch: DVec2) -> DVec3 {
    let column = patch.x - 1.0;
    let row = patch.y - 1.0;
    if !(0.0..6.0).contains(&column) || !(0.0..4.0).contains(&row) {
        return DVec3::splat(0.012);
    }
    if row > 2.0 {
        return DVec3::splat(0.9 * (column / 5.0).powi(2) + 0.02);
    }
    let hue = |shift: f64| 0.5 + 0.5 * (TAU * (column / 6.0 + shift + row / 18.0)).cos();
    let pure = dvec3(hue(0.0), hue(1.0 / 3.0), hue(2.0 / 3.0));
    pure * pure * (0.95 - 0.28 * row) + 0.02
}

/// An object on the stage that casts a shadow.
enum Body {
    Ball { center: DVec3, radius: f64 },
    Block { center: DVec3, half: DVec3 },
    Ring { center: DVec3, major: f64, minor: f64 },
    Pole { foot: DVec3, radius: f64, height: f64 },
}

impl Body {
    /// Its outer surfaces, as maps from the unit square; a block has no underside.
    fn shapes(&self) -> Vec<SurfaceShape> {
        match *self {
            Body::Ball { center, radius } => caps(center, radius),
            Body::Block { center, half } => faces(center, half),
            Body::Ring { center, major, minor } => {
                vec![SurfaceShape::Ring { center, major, minor }]
            }
            Body::Pole { foot, radius, height } => {
                vec![SurfaceShape::Pole { foot, radius, height }]
            }
        }
    }

    /// Signed distance from its outside.
    fn distance(&self, p: DVec3) -> f64 {
        match *self {
            Body::Ball { center, radius } => (p - center).length() - radius,
            Body::Block { center, half } => {
                let q = (p - center).abs() - half;
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
            }
            Body::Ring { center, major, minor } => {
                let q = p - center;
                DVec2::new(DVec2::new(q.x, q.z).length() - major, q.y).length() - minor
            }
            Body::Pole { foot, radius, height } => {
                let q = p - foot;
                (q - DVec3::Y * q.y.clamp(-height, 0.0)).length() - radius
            }
        }
    }
}

/// A sphere in six parts.
fn caps(center: DVec3, radius: f64) -> Vec<SurfaceShape> {
    let cap = |n: DVec3| {
        let u = n.any_orthonormal_vector();
        SurfaceShape::Cap { center, radius, axes: DMat3::from_cols(u, n.cross(u), n) }
    };
    [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z].map(cap).into()
}

/// The faces of a box but its underside, normals outward: -z (the front), top, +z, -x, +x.
fn faces(center: DVec3, half: DVec3) -> Vec<SurfaceShape> {
    let x = DVec3::X * 2.0 * half.x;
    let y = DVec3::Y * 2.0 * half.y;
    let z = DVec3::Z * 2.0 * half.z;
    let low = center - half;
    let high = center + half;
    let face = |origin, u, v| SurfaceShape::Parallelogram { origin, u, v };
    vec![
        face(low + x, -x, y),
        face(low, x, z),
        face(low + z, x, y),
        face(low, z, y),
        face(high - y - z, z, y),
    ]
}

/// The scene: surfaces to sample, and the bodies that cast shadows on them.
pub(super) struct Studio {
    pub(super) surfaces: Vec<Surface>,
    bodies: Vec<Body>,
}

impl Studio {
    /// Builds the scene.
    pub(super) fn new() -> Self {
        let ivory = dvec3(0.78, 0.74, 0.66);
        let ink = dvec3(0.05, 0.07, 0.10);
        let blue = dvec3(0.03, 0.14, 0.50);
        let red = dvec3(0.62, 0.04, 0.03);
        let gold = dvec3(0.80, 0.46, 0.06);
        let teal = dvec3(0.02, 0.34, 0.36);
        let wood = dvec3(0.36, 0.17, 0.07);
        let mut studio = Self { surfaces: Vec::new(), bodies: Vec::new() };
        for shape in caps(DVec3::ZERO, 14.0) {
            studio.surfaces.push(Surface {
                shape,
                texture: Texture::Sky,
                density: 0.0,
                gloss: 0.0,
            });
        }
        let stage = Body::Block { center: dvec3(0.0, 0.1, 0.0), half: dvec3(2.5, 0.1, 2.5) };
        for (i, shape) in stage.shapes().into_iter().enumerate() {
            let texture =
                if i == 1 { Texture::Check(10, ivory, ink) } else { Texture::Planks(1, wood) };
            studio.surfaces.push(Surface { shape, texture, density: 1.0, gloss: 0.0 });
        }

        let ball = |x, z, radius: f64| Body::Ball { center: dvec3(x, -radius, z), radius };
        studio.place(ball(-0.15, 0.1, 0.62), 3.0, 0.5, |_| Texture::Flat(red));
        studio.place(ball(1.05, -0.75, 0.34), 3.0, 0.3, |_| Texture::Check(3, ivory, blue));
        studio.place(ball(-1.0, -1.05, 0.24), 3.0, 0.6, |_| Texture::Flat(gold));
        let ring = Body::Ring { center: dvec3(0.25, -0.13, -1.25), major: 0.36, minor: 0.13 };
        studio.place(ring, 4.0, 0.3, |_| Texture::Stripes(12, teal, ivory));
        let chest = Body::Block { center: dvec3(-1.35, -0.4, 0.25), half: DVec3::splat(0.4) };
        studio.place(chest, 2.5, 0.0, |_| Texture::Planks(4, wood));
        let board = Body::Block { center: dvec3(1.0, -0.65, 1.2), half: dvec3(0.8, 0.65, 0.03) };
        studio.place(board, 4.0, 0.0, |i| if i == 0 { Texture::Chart } else { Texture::Flat(ink) });
        for (x, z, height) in [(-1.75, 1.3, 1.45), (-1.3, 1.65, 1.15), (2.0, 0.2, 1.0)] {
            let foot = dvec3(x, 0.0, z);
            studio.place(Body::Pole { foot, radius: 0.025, height }, 9.0, 0.2, |_| {
                Texture::Stripes(4, ink, ink)
            });
            let center = foot - DVec3::Y * height;
            studio.place(Body::Ball { center, radius: 0.09 }, 5.0, 0.6, |_| Texture::Flat(gold));
        }
        studio
    }

    /// Adds a body whose face `i` has the texture `texture(i)`.
    fn place(&mut self, body: Body, density: f64, gloss: f64, texture: impl Fn(usize) -> Texture) {
        let shapes = body.shapes().into_iter().enumerate();
        self.surfaces.extend(shapes.map(|(i, shape)| Surface {
            shape,
            texture: texture(i),
            density,
            gloss,
        }));
        self.bodies.push(body);
    }

    /// Colour at (u, v) of a surface, sRGB-encoded, with sun, shadow, skylight and highlight.
    pub(super) fn color(&self, surface: &Surface, at: DVec2) -> DVec3 {
        let point = surface.shape.point(at);
        let normal = surface.shape.normal(at);
        let albedo = surface.texture.color(at, normal);
        if matches!(surface.texture, Texture::Sky) {
            return encode(albedo);
        }
        let sun = dvec3(-0.55, -1.0, -0.65).normalize();
        let half = (sun + dvec3(0.1, -0.45, -0.9).normalize()).normalize();
        let facing = normal.dot(sun).max(0.0);
        let lit =
            if facing > 0.0 { facing * self.sunlight(point + normal * 0.01, sun) } else { 0.0 };
        let sky = (0.6 - 0.4 * normal.y) * self.open_sky(point, normal);
        let highlight = surface.gloss * lit * normal.dot(half).max(0.0).powi(48);
        encode(albedo * (dvec3(1.0, 0.94, 0.84) * lit + dvec3(0.36, 0.42, 0.50) * sky) + highlight)
    }

    /// Distance to the nearest body.
    fn distance(&self, p: DVec3) -> f64 {
        self.bodies.iter().map(|body| body.distance(p)).fold(f64::INFINITY, f64::min)
    }

    /// Visible share of the sun from `p`, with a soft edge (sphere tracing).
    fn sunlight(&self, p: DVec3, sun: DVec3) -> f64 {
        let mut share = 1.0f64;
        let mut along = 0.0;
        while along < 4.0 && p.y + sun.y * along > -2.2 {
            let free = self.distance(p + sun * along);
            share = share.min(0.5 + 14.0 * free / (along + 0.2));
            if share <= 0.0 {
                return 0.0;
            }
            along += free.max(0.015);
        }
        share
    }

    /// Visible share of the sky from `p`: 1 in the open, less near bodies and the stage.
    fn open_sky(&self, p: DVec3, normal: DVec3) -> f64 {
        let reach = [0.08, 0.25].map(|step| {
            let probe = p + normal * step;
            (self.distance(probe).min(-probe.y) / step).clamp(0.0, 1.0)
        });
        0.25 + 0.75 * reach[0] * (0.4 + 0.6 * reach[1])
    }
}

/// Linear light to a display code by a square root: the studio's own tone curve, exact on every
/// machine.
fn encode(linear: DVec3) -> DVec3 {
    let sqrt = |x: f64| x.max(0.0).sqrt();
    dvec3(sqrt(linear.x), sqrt(linear.y), sqrt(linear.z))
}
