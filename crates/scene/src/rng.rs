//! Counter-based random numbers: a value depends only on (seed, purpose, step, index), so the order
//! of evaluation and the number of threads cannot change it.

use glam::Vec3;

/// A stream of random numbers for one purpose at one step.
#[derive(Debug, Clone, Copy)]
pub struct Rng {
    key: u64,
}

impl Rng {
    /// The stream of `purpose` ("init", "noise") at `step` under the user's `seed`.
    pub fn new(seed: u64, purpose: &str, step: u64) -> Self {
        let mut key = mix(seed ^ 0x9e37_79b9_7f4a_7c15);
        for byte in purpose.bytes() {
            key = mix(key ^ u64::from(byte));
        }
        Self { key: mix(key ^ mix(step)) }
    }

    /// 64 random bits of entry `index`.
    pub fn bits(self, index: u64) -> u64 {
        mix(self.key.wrapping_add(mix(index.wrapping_add(0x632b_e59b_d9b4_e019))))
    }

    /// Uniform in [0, 1), 24 bits.
    pub fn uniform(self, index: u64) -> f32 {
        (self.bits(index) >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform_f64(self, index: u64) -> f64 {
        (self.bits(index) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A direction uniform over the sphere, from entries `2 index` and `2 index + 1`.
    pub fn on_sphere(self, index: u64) -> Vec3 {
        let z = 2.0 * self.uniform(2 * index) - 1.0;
        let angle = std::f32::consts::TAU * self.uniform(2 * index + 1);
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * angle.cos(), r * angle.sin(), z)
    }

    /// Standard normal (Box-Muller on two uniforms of the same entry).
    pub fn normal(self, index: u64) -> f32 {
        let bits = self.bits(index);
        let u = ((bits >> 32) as f64 + 1.0) / (1u64 << 32) as f64;
        let v = (bits & 0xffff_ffff) as f64 / (1u64 << 32) as f64;
        ((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32
    }
}

/// The finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection with full avalanche.
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
