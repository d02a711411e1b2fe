//! Depth maps as pictures for eyes: depth, normals and confidence beside the photo.

use super::depth_map::DepthMap;
use crate::image::Pixels;
use glam::{UVec2, Vec3};

/// The photo, the depths, the normals and the confidence of a map, two by two. Near is bright, unknown black,
/// the sky blue.
pub fn picture(map: &DepthMap) -> Pixels {
    let size = map.camera.size;
    let (width, height) = (size.x as usize, size.y as usize);
    let mut inverse: Vec<f32> =
        (0..map.depth.len()).filter(|i| map.is_known(*i)).map(|i| map.depth[i].recip()).collect();
    inverse.sort_by(f32::total_cmp);
    let at =
        |share: f32| inverse.get(((inverse.len() as f32 * share) as usize).min(inverse.len().max(1) - 1));
    let (low, high) = (at(0.01).copied().unwrap_or(0.0), at(0.99).copied().unwrap_or(1.0));
    let mut rgb = vec![[0u8; 3]; 4 * width * height];
    for (pixel, own) in map.rgb.iter().enumerate() {
        let (x, y) = (pixel % width, pixel / width);
        let place = |column: usize, row: usize| (y + row * height) * 2 * width + x + column * width;
        rgb[place(0, 0)] = *own;
        rgb[place(1, 1)] = [(map.confidence[pixel] * 255.0) as u8; 3];
        if map.depth[pixel].is_infinite() {
            rgb[place(1, 0)] = [40, 90, 200];
        } else if map.is_known(pixel) {
            let near = (map.depth[pixel].recip() - low) / (high - low).max(f32::MIN_POSITIVE);
            rgb[place(1, 0)] = heat(near.clamp(0.0, 1.0));
            let normal = map.camera.rotation * map.normal[pixel];
            rgb[place(0, 1)] =
                ((normal * Vec3::new(1.0, -1.0, -1.0) + 1.0) * 127.5).to_array().map(|c| c as u8);
        }
    }
    Pixels { size: UVec2::new(2 * size.x, 2 * size.y), rgb, alpha: None }
}

/// From far (dark violet) to near (light yellow).
fn heat(share: f32) -> [u8; 3] {
    const COLORS: [[f32; 3]; 5] = [
        [40.0, 15.0, 70.0],
        [110.0, 30.0, 110.0],
        [205.0, 65.0, 75.0],
        [245.0, 145.0, 40.0],
        [252.0, 250.0, 165.0],
    ];
    let at = share * (COLORS.len() - 1) as f32;
    let below = (at as usize).min(COLORS.len() - 2);
    let part = at - below as f32;
    std::array::from_fn(|c| (COLORS[below][c] * (1.0 - part) + COLORS[below + 1][c] * part) as u8)
}
