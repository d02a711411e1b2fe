//! The town: streets, façades with windows, roofs and trees under a sky, all of flat triangles, so that its
//! photos show exactly this mesh. World frame: z is up, lengths are metres, the middle of the town is the
//! origin.

use glam::{Vec3, vec3};
use trisplat_scene::{
    Rng,
    math::octasphere::octasphere,
    mesh::{Colors, Mesh},
};

/// Distance between the middles of neighbouring streets, m.
pub(super) const PITCH: f32 = 20.0;
/// Half the width of a street, m.
const HALF_STREET: f32 = 3.5;
/// Half the width of a street and its pavements, m: the place of façades.
const HALF_GAP: f32 = 5.0;
/// A floor of a house, and a bay of its façade, m.
const FLOOR: f32 = 3.0;
/// Towards the sun.
const SUN: Vec3 = vec3(0.48, -0.36, 0.8);
/// Ambient light.
const AMBIENT: f32 = 0.45;
/// Random numbers for one lot.
const PER_LOT: u64 = 1 << 16;

/// Triangles, added by their corners and colour.
struct Builder {
    positions: Vec<Vec3>,
    colors: Vec<[f32; 3]>,
    rng: Rng,
    next: u64,
}

impl Builder {
    /// The next random number in [0, 1).
    fn random(&mut self) -> f32 {
        self.next += 1;
        self.rng.uniform(self.next)
    }

    fn triangle(&mut self, corners: [Vec3; 3], albedo: Vec3) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let light = AMBIENT + (1.0 - AMBIENT) * normal.dot(SUN).max(0.0);
        self.positions.extend(corners);
        self.colors.push((albedo * light).clamp(Vec3::ZERO, Vec3::ONE).to_array());
    }

    /// A parallelogram, its front where `u` × `v` points.
    fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, albedo: Vec3) {
        self.triangle([corner, corner + u, corner + u + v], albedo);
        self.triangle([corner, corner + u + v, corner + v], albedo);
    }

    /// A parallelogram in cells of about this side, with different tones.
    fn mottled(&mut self, corner: Vec3, u: Vec3, v: Vec3, side: f32, albedo: Vec3, contrast: f32) {
        let [across, up] = [u, v].map(|edge| (edge.length() / side).round().max(1.0));
        let (du, dv) = (u / across, v / up);
        for y in 0..up as u32 {
            for x in 0..across as u32 {
                let tone = 1.0 + contrast * (self.random() - 0.5);
                self.quad(corner + du * x as f32 + dv * y as f32, du, dv, albedo * tone);
            }
        }
    }

    /// A wall with a window in each bay of each floor.
    fn facade(&mut self, corner: Vec3, along: Vec3, floors: u32, albedo: Vec3) {
        let bays = (along.length() / FLOOR).round().max(1.0);
        let (u, v, out) = (along / bays, Vec3::Z * FLOOR, along.normalize().cross(Vec3::Z));
        for floor in 0..floors {
            for bay in 0..bays as u32 {
                let at = corner + u * bay as f32 + v * floor as f32;
                self.mottled(at, u, v, 1.0, albedo, 0.25);
                let glass = vec3(0.05, 0.09, 0.14) + vec3(0.3, 0.26, 0.12) * f32::from(self.random() > 0.8);
                let frame = at + u * 0.25 + v * 0.28 + out * 0.03;
                self.quad(frame, u * 0.5, v * 0.52, vec3(0.75, 0.73, 0.68));
                self.quad(frame + u * 0.04 + v * 0.04 + out * 0.02, u * 0.42, v * 0.44, glass);
            }
        }
        self.quad(corner + v * floors as f32 + out * 0.1, along, Vec3::Z * 0.4, albedo * 0.6);
    }

    /// A house on a rectangle from `low` to `high`.
    fn house(&mut self, low: Vec3, high: Vec3) {
        let floors = 2 + (self.random() * 4.0) as u32;
        let hue =
            [vec3(0.55, 0.28, 0.18), vec3(0.62, 0.55, 0.40), vec3(0.42, 0.45, 0.48), vec3(0.60, 0.42, 0.26)];
        let albedo = hue[(self.random() * 4.0) as usize % 4] * (0.8 + 0.4 * self.random());
        let (x, y) = (Vec3::X * (high.x - low.x), Vec3::Y * (high.y - low.y));
        for (corner, along) in [(low, x), (low + x, y), (low + x + y, -x), (low + y, -y)] {
            self.facade(corner, along, floors, albedo);
        }
        let top = low + Vec3::Z * FLOOR * floors as f32;
        let roof = vec3(0.32, 0.17, 0.13) * (0.7 + 0.6 * self.random());
        let (height, ridge) = (1.5 + 2.0 * self.random(), y / 2.0);
        let peak = ridge + Vec3::Z * height;
        self.mottled(top, x, peak, 1.5, roof, 0.3);
        self.mottled(top + x + y, -x, peak - 2.0 * ridge, 1.5, roof, 0.3);
        for (corner, side) in [(top + y, -y), (top + x, y)] {
            self.triangle([corner, corner + side, corner + side / 2.0 + Vec3::Z * height], albedo);
        }
    }

    /// A tree: a trunk and a crown of leaves.
    fn tree(&mut self, foot: Vec3) {
        let (height, radius) = (2.0 + 1.5 * self.random(), 1.1 + 0.7 * self.random());
        for (side, along) in
            [(Vec3::X, Vec3::Y), (Vec3::Y, -Vec3::X), (-Vec3::X, -Vec3::Y), (-Vec3::Y, Vec3::X)]
        {
            let corner = foot + 0.15 * (side - along);
            self.quad(corner, 0.3 * along, Vec3::Z * height, vec3(0.16, 0.10, 0.06));
        }
        let (directions, faces) = octasphere(2);
        let middle = foot + Vec3::Z * (height + 0.7 * radius);
        let green = vec3(0.10, 0.24, 0.06) * (0.8 + 0.5 * self.random());
        for face in faces {
            let tone = 0.7 + 0.6 * self.random();
            let corner = |i: u32| middle + radius * directions[i as usize];
            self.triangle(face.map(corner), green * tone);
        }
    }

    /// A lot, with corners in the middle of the streets around it.
    fn lot(&mut self, corner: Vec3, seed: u64, index: u64) {
        (self.rng, self.next) = (Rng::new(seed, "lot", 0), index * PER_LOT);
        let square = |inset: f32| (corner + vec3(inset, inset, 0.0), PITCH - 2.0 * inset);
        let (at, side) = square(0.0);
        self.mottled(at, Vec3::X * side, Vec3::Y * side, 1.25, vec3(0.16, 0.16, 0.17), 0.5);
        let (at, side) = square(HALF_STREET);
        let pavement = vec3(0.45, 0.43, 0.40);
        self.mottled(at + Vec3::Z * 0.12, Vec3::X * side, Vec3::Y * side, 1.0, pavement, 0.35);
        for dash in 0..4 {
            let along = 2.0 + 5.0 * dash as f32;
            let white = vec3(0.8, 0.8, 0.76);
            self.quad(corner + vec3(along, -0.1, 0.02), Vec3::X * 2.0, Vec3::Y * 0.25, white);
            self.quad(corner + vec3(-0.1, along, 0.02), Vec3::X * 0.25, Vec3::Y * 2.0, white);
        }
        let (at, side) = square(HALF_GAP);
        // Some lots are parks.
        if self.random() < 0.15 {
            self.mottled(
                at + Vec3::Z * 0.2,
                Vec3::X * side,
                Vec3::Y * side,
                1.0,
                vec3(0.14, 0.28, 0.08),
                0.5,
            );
            for _ in 0..6 {
                let place = vec3(self.random(), self.random(), 0.0) * side;
                self.tree(at + place);
            }
        } else {
            self.house(at, at + vec3(side, side, 0.0));
        }
        for (x, y) in [(4.2, 4.2), (PITCH - 4.2, 4.2), (4.2, PITCH - 4.2)] {
            if self.random() < 0.6 {
                self.tree(corner + vec3(x, y, 0.12));
            }
        }
    }
}

/// Half the side of a town of `lots` times `lots` lots, m.
pub(super) fn half_side(lots: u32) -> f32 {
    0.5 * PITCH * lots as f32
}

/// The town of `lots` times `lots` lots.
pub(crate) fn town(lots: u32, seed: u64) -> Mesh {
    let mut builder =
        Builder { positions: Vec::new(), colors: Vec::new(), rng: Rng::new(seed, "town", 0), next: 0 };
    let half = half_side(lots);
    builder.surroundings(half);
    for y in 0..lots {
        for x in 0..lots {
            let corner = vec3(PITCH * x as f32 - half, PITCH * y as f32 - half, 0.0);
            builder.lot(corner, seed, u64::from(y * lots + x));
        }
    }
    Mesh { positions: builder.positions, colors: Colors::Face(builder.colors), ..Mesh::default() }
}

impl Builder {
    /// Meadows around the town, and the sky.
    fn surroundings(&mut self, half: f32) {
        let (far, side) = (3.0 * half, 8.0);
        let cells = (2.0 * far / side).ceil() as i32;
        for i in 0..cells * cells {
            let at = vec3((i % cells) as f32 * side - far, (i / cells) as f32 * side - far, -0.05);
            let middle = at + vec3(side / 2.0, side / 2.0, 0.0);
            let tone = 0.75 + 0.5 * self.random();
            if middle.x.abs().max(middle.y.abs()) > half {
                self.quad(at, Vec3::X * side, Vec3::Y * side, vec3(0.24, 0.30, 0.12) * tone);
            }
        }
        let (directions, faces) = octasphere(4);
        for face in faces {
            let [a, b, c] = face.map(|i| directions[i as usize]);
            let high = ((a + b + c) / 3.0).z.max(0.0);
            let rgb = vec3(0.62, 0.66, 0.70).lerp(vec3(0.20, 0.38, 0.68), high.sqrt());
            self.positions.extend([a, c, b].map(|v| v * 5.0 * half));
            self.colors.push(rgb.to_array());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_is_the_same_town() {
        let small = town(2, 1);
        small.validate().unwrap();
        assert_eq!(small, town(2, 1));
        assert_ne!(small, town(2, 2));
        assert!(town(3, 1).face_count() > small.face_count());
    }

    #[test]
    fn nothing_of_it_is_outside_of_the_sky() {
        let town = town(2, 5);
        let reach = town.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!(reach <= 5.01 * half_side(2) && town.positions.iter().all(|p| p.z > -5.01 * half_side(2)));
    }
}
