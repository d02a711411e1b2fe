//! Pictures of depth, normals, wires and errors.

use glam::UVec2;
use trisplat_raster::soft::Frame;
use trisplat_raster::solid::Visibility;
use trisplat_scene::image::RgbImage;

/// A pixel with less coverage counts as background.
const MIN_COVERAGE: f32 = 0.05;

/// Expected depth, near bright and far dark, stretched over the middle 98% of the picture's inverse
/// depths; black for background. The frame must have been drawn with geometry.
pub fn depth(frame: &Frame) -> RgbImage {
    let inverse = |i: usize| {
        let coverage = 1.0 - frame.transmittance[i];
        (coverage > MIN_COVERAGE && frame.depth[i] > 0.0).then(|| coverage / frame.depth[i])
    };
    let mut seen: Vec<f32> = (0..frame.depth.len()).filter_map(inverse).collect();
    seen.sort_by(f32::total_cmp);
    let last = seen.len().saturating_sub(1);
    let at = |i: usize| seen.get(i).copied().unwrap_or(0.0);
    let far = at(last / 100);
    let near = at(last - last / 100);
    let stretched = |x: f32| if near > far { (x - far) / (near - far) } else { 0.5 };
    // Slightly above black, so that the farthest surface differs from the background.
    picture(frame, |i| {
        inverse(i).map_or([0.0; 3], |x| ramp(0.08 + 0.92 * stretched(x).clamp(0.0, 1.0)))
    })
}

/// Normals towards the camera: red to the right, green up, blue to the viewer; black for
/// background. The frame must have been drawn with geometry.
pub fn normal(frame: &Frame) -> RgbImage {
    picture(frame, |i| {
        let [x, y, z] = frame.normal[i];
        let length = (x * x + y * y + z * z).sqrt();
        let seen = length > 0.0 && 1.0 - frame.transmittance[i] > MIN_COVERAGE;
        // The camera's axes are x right, y down, z forward.
        if seen { [x, -y, -z].map(|c| 0.5 + 0.5 * c / length) } else { [0.0; 3] }
    })
}

/// The edges between the faces that are seen, black on white, in pixels of `size`.
pub fn wires(seen: &Visibility, size: UVec2) -> RgbImage {
    let samples = (seen.size.x / size.x) as usize;
    let [width, height] = seen.size.to_array().map(|n| n as usize);
    let mut ink = vec![0; size.element_product() as usize];
    for y in 1..height {
        for x in 1..width {
            let i = y * width + x;
            let edge = seen.face[i] != seen.face[i - 1] || seen.face[i] != seen.face[i - width];
            ink[y / samples * size.x as usize + x / samples] += usize::from(edge);
        }
    }
    // An edge straight across a pixel takes one sample in each row or column, and makes it black.
    let code = |ink: &usize| [255 - (255 * ink / samples).min(255) as u8; 3];
    RgbImage { size, rgb: ink.iter().map(code).collect(), alpha: None }
}

fn picture(frame: &Frame, at: impl Fn(usize) -> [f32; 3]) -> RgbImage {
    let count = frame.size.x as usize * frame.size.y as usize;
    RgbImage::from_rgb(frame.size, &(0..count).map(at).collect::<Vec<_>>())
}

/// The colour map magma of FLIP: black, violet, orange, white; for values in [0, 1].
fn ramp(value: f32) -> [f32; 3] {
    flip_rs::MAGMA[(value * 255.0).round() as usize]
}
