//! A small outdoor scene with a known answer at every ray: checkered floor, balls, a box, a card,
//! thin poles, a sky. World axes as COLMAP usually has them: -Y is up. Colours are sRGB-encoded.

use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The hit of a ray on an object.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceHit {
    /// Distance along the ray, in lengths of its direction.
    pub distance: f64,
    /// World position.
    pub position: DVec3,
    /// Unit normal of the surface, towards the ray's origin.
    pub normal: DVec3,
    /// sRGB-encoded colour towards the ray's origin, in [0, 1].
    pub rgb: DVec3,
    /// Index of the object; objects differ in colour along their outlines.
    pub object: usize,
    /// True for the sky, which is painted on the inside of a large ball.
    pub sky: bool,
    /// True for objects on the ground.
    pub thing: bool,
}

/// A ray from `origin` along `direction`, which need not have length 1.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

#[derive(Debug, Clone, Copy)]
enum Shape {
    /// The plane y = 0.
    Ground,
    Ball {
        center: DVec3,
        radius: f64,
    },
    /// A box; `rotation` takes world axes to its own.
    Block {
        center: DVec3,
        half: DVec3,
        rotation: DMat3,
    },
    /// A cylinder with flat ends.
    Pole {
        from: DVec3,
        to: DVec3,
        radius: f64,
    },
    /// A rectangle seen from both sides.
    Card {
        corner: DVec3,
        right: DVec3,
        down: DVec3,
    },
    /// The inside of a ball around the origin.
    Sky {
        radius: f64,
    },
}

#[derive(Debug, Clone, Copy)]
enum Paint {
    Checker,
    Stripes(DVec3, DVec3),
    Wood,
    TestCard,
    Plain(DVec3),
    Gradient,
}

#[derive(Debug, Clone, Copy)]
struct Object {
    shape: Shape,
    paint: Paint,
    /// Strength of the highlight.
    gloss: f64,
}

/// Distance, outward normal and surface coordinates; those of a ball follow from the normal (see
/// [`around`]).
type Intersection = (f64, DVec3, DVec2);

/// Half the side of the checkered floor; sand lies around it.
const FLOOR_HALF: f64 = 3.0;
const SKY_RADIUS: f64 = 14.0;
/// Direction to the sun.
const SUN: DVec3 = DVec3::new(0.48, -0.8, -0.36);
/// Light that reaches shadows, of 1.
const AMBIENT: f64 = 0.5;

/// The appearance of the nearest object on a ray. A ray that starts between ground and sky always
/// hits one of them.
pub fn trace(ray: Ray) -> Option<SurfaceHit> {
    let (object, (distance, outward, uv)) = nearest(ray)?;
    let position = ray.origin + ray.direction * distance;
    let Object { shape, paint, gloss } = OBJECTS[object];
    // Only here: for every ball on every ray they would take most of the time.
    let uv =
        if matches!(shape, Shape::Ball { .. } | Shape::Sky { .. }) { around(outward) } else { uv };
    let normal = if outward.dot(ray.direction) > 0.0 { -outward } else { outward };
    if matches!(shape, Shape::Sky { .. }) {
        let rgb = albedo(paint, uv, position);
        return Some(SurfaceHit {
            distance,
            position,
            normal,
            rgb,
            object,
            sky: true,
            thing: false,
        });
    }
    let lit = normal.dot(SUN) > 0.0 && !shadowed(position + normal * 1e-6);
    let sun = if lit { normal.dot(SUN) } else { 0.0 };
    let mut rgb = albedo(paint, uv, position) * (AMBIENT + (1.0 - AMBIENT) * sun);
    if gloss > 0.0 && lit {
        let mirrored = ray.direction.normalize().reflect(normal);
        rgb += DVec3::splat(gloss * mirrored.dot(SUN).max(0.0).powi(16));
    }
    let thing = !matches!(shape, Shape::Ground);
    Some(SurfaceHit {
        distance,
        position,
        normal,
        rgb: rgb.min(DVec3::ONE),
        object,
        sky: false,
        thing,
    })
}

/// True when no object is between a point and an eye.
pub fn visible(point: DVec3, eye: DVec3) -> bool {
    let ray = Ray { origin: eye, direction: point - eye };
    nearest(ray).is_some_and(|(_, (distance, ..))| distance > 1.0 - 1e-6)
}

fn nearest(ray: Ray) -> Option<(usize, Intersection)> {
    let hits = OBJECTS
        .iter()
        .enumerate()
        .filter_map(|(i, object)| Some((i, object.shape.intersect(ray)?)));
    hits.min_by(|a, b| a.1.0.total_cmp(&b.1.0))
}

fn shadowed(from: DVec3) -> bool {
    let ray = Ray { origin: from, direction: SUN };
    OBJECTS.iter().any(|object| {
        !matches!(object.shape, Shape::Sky { .. }) && object.shape.intersect(ray).is_some()
    })
}

/// The scene. -Y is up: objects stand on y = 0 and reach into negative y.
const OBJECTS: [Object; 12] = {
    const RED: DVec3 = DVec3::new(0.82, 0.16, 0.13);
    const CREAM: DVec3 = DVec3::new(0.95, 0.91, 0.78);
    const TEAL: DVec3 = DVec3::new(0.1, 0.55, 0.58);
    const YELLOW: DVec3 = DVec3::new(0.93, 0.76, 0.18);
    const STEEL: DVec3 = DVec3::new(0.42, 0.45, 0.5);
    const DARK: DVec3 = DVec3::new(0.13, 0.14, 0.18);
    const fn matt(shape: Shape, paint: Paint) -> Object {
        Object { shape, paint, gloss: 0.0 }
    }
    const fn pole(from: [f64; 3], to: [f64; 3], radius: f64, color: DVec3) -> Object {
        let from = DVec3::from_array(from);
        let to = DVec3::from_array(to);
        matt(Shape::Pole { from, to, radius }, Paint::Plain(color))
    }
    const fn ball(center: [f64; 3], radius: f64, paint: Paint, gloss: f64) -> Object {
        Object { shape: Shape::Ball { center: DVec3::from_array(center), radius }, paint, gloss }
    }
    const fn at(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }
    // 30 degrees about Y.
    const TURN: DMat3 = DMat3::from_cols(
        at(0.8660254037844387, 0.0, 0.5),
        DVec3::Y,
        at(-0.5, 0.0, 0.8660254037844387),
    );
    [
        matt(Shape::Sky { radius: SKY_RADIUS }, Paint::Gradient),
        matt(Shape::Ground, Paint::Checker),
        ball([-0.95, -0.55, 0.35], 0.55, Paint::Stripes(RED, CREAM), 0.0),
        ball([0.35, -0.32, -0.95], 0.32, Paint::Plain(TEAL), 0.35),
        ball([-0.35, -0.2, -1.35], 0.2, Paint::Stripes(YELLOW, DARK), 0.0),
        matt(
            Shape::Block {
                center: at(0.95, -0.4, 0.45),
                half: at(0.45, 0.4, 0.35),
                rotation: TURN,
            },
            Paint::Wood,
        ),
        matt(
            Shape::Card {
                corner: at(-0.55, -1.3, 1.35),
                right: at(1.1, 0.0, 0.25),
                down: at(0.0, 0.8, 0.0),
            },
            Paint::TestCard,
        ),
        pole([-0.5, 0.0, 1.34], [-0.5, -0.5, 1.34], 0.03, STEEL),
        pole([0.5, 0.0, 1.57], [0.5, -0.5, 1.57], 0.03, STEEL),
        pole([-1.6, 0.0, -0.8], [-1.6, -1.7, -0.8], 0.035, STEEL),
        pole([-1.6, -1.65, -0.8], [1.5, -1.45, -0.9], 0.018, DARK),
        pole([1.5, 0.0, -0.9], [1.5, -1.5, -0.9], 0.025, YELLOW),
    ]
};

impl Shape {
    /// The nearest intersection in front of the ray's origin.
    fn intersect(&self, ray: Ray) -> Option<Intersection> {
        match *self {
            Shape::Ground => {
                let t = -ray.origin.y / ray.direction.y;
                let p = ray.origin + ray.direction * t;
                (t > 0.0 && p.length() < SKY_RADIUS).then_some((
                    t,
                    DVec3::NEG_Y,
                    DVec2::new(p.x, p.z),
                ))
            }
            Shape::Ball { center, radius } => {
                let (near, _) = ball_span(ray, center, radius)?;
                let n = (ray.origin + ray.direction * near - center) / radius;
                (near > 0.0).then_some((near, n, DVec2::ZERO))
            }
            Shape::Sky { radius } => {
                let (_, far) = ball_span(ray, DVec3::ZERO, radius)?;
                let n = -(ray.origin + ray.direction * far) / radius;
                (far > 0.0).then_some((far, n, DVec2::ZERO))
            }
            Shape::Block { center, half, rotation } => touch_block(ray, center, half, rotation),
            Shape::Pole { from, to, radius } => touch_pole(ray, from, to, radius),
            Shape::Card { corner, right, down } => {
                let normal = right.cross(down).normalize();
                let t = (corner - ray.origin).dot(normal) / ray.direction.dot(normal);
                let p = ray.origin + ray.direction * t - corner;
                let uv = DVec2::new(
                    p.dot(right) / right.length_squared(),
                    p.dot(down) / down.length_squared(),
                );
                let inside = uv.cmpge(DVec2::ZERO).all() && uv.cmple(DVec2::ONE).all();
                (t > 0.0 && inside).then_some((t, normal, uv))
            }
        }
    }
}

/// Longitude and latitude of a unit vector, in turns.
fn around(n: DVec3) -> DVec2 {
    DVec2::new(n.z.atan2(n.x) / TAU, (-n.y).clamp(-1.0, 1.0).asin() / PI)
}

/// Where a ray enters and leaves a ball.
fn ball_span(ray: Ray, center: DVec3, radius: f64) -> Option<(f64, f64)> {
    let to = ray.origin - center;
    let a = ray.direction.length_squared();
    let b = to.dot(ray.direction);
    let c = to.length_squared() - radius * radius;
    let root = b * b - a * c;
    (root >= 0.0).then(|| ((-b - root.sqrt()) / a, (-b + root.sqrt()) / a))
}

fn touch_block(ray: Ray, center: DVec3, half: DVec3, rotation: DMat3) -> Option<Intersection> {
    let o = rotation * (ray.origin - center);
    let d = rotation * ray.direction;
    let a = (-half - o) / d;
    let b = (half - o) / d;
    let near = a.min(b);
    let far = a.max(b);
    let t = near.max_element();
    if !(t > 0.0 && t <= far.min_element()) {
        return None;
    }
    let p = o + d * t;
    let (axis, uv) = if t == near.x {
        (DVec3::X * -d.x.signum(), DVec2::new(p.z, p.y))
    } else if t == near.y {
        (DVec3::Y * -d.y.signum(), DVec2::new(p.x, p.z))
    } else {
        (DVec3::Z * -d.z.signum(), DVec2::new(p.x, p.y))
    };
    Some((t, rotation.transpose() * axis, uv))
}

fn touch_pole(ray: Ray, from: DVec3, to: DVec3, radius: f64) -> Option<Intersection> {
    let length = from.distance(to);
    let axis = (to - from) / length;
    let o = ray.origin - from;
    let d = ray.direction;
    let along_o = o.dot(axis);
    let along_d = d.dot(axis);
    let flat_o = o - axis * along_o;
    let flat_d = d - axis * along_d;
    let a = flat_d.length_squared();
    let b = flat_o.dot(flat_d);
    let root = b * b - a * (flat_o.length_squared() - radius * radius);
    if root >= 0.0 && a > 0.0 {
        let t = (-b - root.sqrt()) / a;
        let along = along_o + along_d * t;
        if t > 0.0 && (0.0..=length).contains(&along) {
            return Some((t, (flat_o + flat_d * t) / radius, DVec2::new(0.0, along)));
        }
    }
    let end = |at: f64, normal: DVec3| {
        let t = (at - along_o) / along_d;
        let inside = (flat_o + flat_d * t).length_squared() <= radius * radius;
        (t > 0.0 && inside).then_some((t, normal, DVec2::new(0.0, at)))
    };
    let ends = [end(0.0, -axis), end(length, axis)];
    ends.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The colour of a surface in full light.
fn albedo(paint: Paint, uv: DVec2, position: DVec3) -> DVec3 {
    let rgb = DVec3::new;
    let odd = |x: f64| x.rem_euclid(2.0) >= 1.0;
    match paint {
        Paint::Plain(color) => color,
        Paint::Stripes(a, b) => {
            if odd(uv.x * 12.0) {
                a
            } else {
                b
            }
        }
        Paint::Checker if uv.abs().max_element() <= FLOOR_HALF => {
            let dark = odd((uv.x / 0.5).floor() + (uv.y / 0.5).floor());
            let vein = 0.5 + 0.5 * (9.0 * uv.x + 3.0 * (2.3 * uv.y).sin()).sin();
            if dark {
                rgb(0.3, 0.33, 0.4) + 0.06 * vein
            } else {
                rgb(0.86, 0.83, 0.76) - 0.08 * vein
            }
        }
        // Sand with dunes that fade into the distance.
        Paint::Checker => {
            let dune = (1.7 * uv.x + (0.9 * uv.y).sin()).sin() * (1.1 * uv.y).cos();
            rgb(0.76, 0.66, 0.47) + 0.07 * dune * rgb(1.0, 0.9, 0.7)
        }
        Paint::Wood => {
            let plank = (uv.y / 0.2).floor();
            let grain = (38.0 * uv.y + 4.0 * (3.0 * uv.x + 1.9 * plank).sin()).sin();
            let tone = 0.85 + 0.15 * (2.4 * plank).sin();
            let seam = (uv.y / 0.2).rem_euclid(1.0) < 0.06;
            if seam { rgb(0.2, 0.12, 0.07) } else { rgb(0.66, 0.43, 0.23) * tone + 0.05 * grain }
        }
        Paint::TestCard => test_card(uv),
        Paint::Gradient => {
            let height = (-position.y / SKY_RADIUS).clamp(0.0, 1.0);
            let cloud =
                0.5 + 0.5 * (TAU * (3.0 * uv.x + 2.0 * uv.y)).sin() * (TAU * 4.0 * uv.y).cos();
            let sky = rgb(0.86, 0.9, 0.95).lerp(rgb(0.3, 0.52, 0.85), height.sqrt());
            sky.lerp(DVec3::ONE, 0.25 * cloud * (1.0 - height))
        }
    }
}

/// Colour bars, a diagonal, a disc and a frame; uv in [0, 1].
fn test_card(uv: DVec2) -> DVec3 {
    let rgb = DVec3::new;
    if uv.min_element() < 0.04 || uv.max_element() > 0.96 {
        return rgb(0.1, 0.1, 0.12);
    }
    if (uv - DVec2::splat(0.5)).length() < 0.2 {
        return if uv.x > uv.y { rgb(0.95, 0.95, 0.95) } else { rgb(0.12, 0.2, 0.5) };
    }
    const BARS: [[f64; 3]; 6] = [
        [0.9, 0.9, 0.9],
        [0.85, 0.8, 0.15],
        [0.15, 0.75, 0.8],
        [0.2, 0.7, 0.25],
        [0.75, 0.2, 0.6],
        [0.8, 0.2, 0.15],
    ];
    let bar = ((uv.x * 6.0) as usize).min(5);
    if uv.y < 0.7 { DVec3::from(BARS[bar]) } else { DVec3::splat(0.1 + 0.8 * uv.x) }
}
