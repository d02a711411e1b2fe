//! Finds the triangle under the mouse.

use glam::{DVec3, Vec2, Vec3};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Asset, Soup, camera::Camera, math::color::srgb_from_linear};

/// A triangle under the mouse.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picked {
    /// Its corners in the frame of the asset.
    pub(super) corners: [Vec3; 3],
    /// Depth of the point that was hit.
    pub(super) depth: f32,
    /// sRGB-encoded colour, 0 to 255: the mean of its corners.
    pub(super) rgb: [u8; 3],
    /// Its original triangle in the soup.
    pub(super) source: Option<Origin>,
}

/// A triangle of a soup.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Origin {
    /// Its number in the soup.
    pub(super) triangle: usize,
    pub(super) sigma: f32,
    pub(super) opacity: f32,
}

/// The triangle that the ray through `pixel` hits first.
pub(super) fn pick(
    asset: &Asset,
    camera: &Camera,
    pixel: Vec2,
    source: Option<(&Soup, &dyn Fn(Vec3) -> Vec3)>,
) -> Option<Picked> {
    let ray = camera.rotation.transpose() * ((pixel - camera.center) / camera.focal).extend(1.0);
    let hit = asset.bvh.as_ref()?.cast(&asset.mesh, camera.position(), ray)?;
    let (corners, colors) =
        (asset.mesh.corners(hit.face as usize), asset.mesh.corner_colors(hit.face as usize));
    let mean = |c: usize| colors.iter().map(|color| color[c]).sum::<f32>() / 3.0;
    let rgb = [0, 1, 2].map(|c| (srgb_from_linear(mean(c)) * 255.0).round() as u8);
    let source = source.and_then(|(soup, to_soup)| origin(soup, corners.map(to_soup)));
    // The ray's direction is one unit of depth long.
    Some(Picked { corners, depth: hit.t as f32, rgb, source })
}

/// The triangle of the soup that was shrunk to these corners; shrinking keeps the incenter and the directions
/// of edges.
fn origin(soup: &Soup, corners: [Vec3; 3]) -> Option<Origin> {
    let (center, normal) = incenter(&corners);
    let mismatch = |triangle: usize| {
        let (other, across) = incenter(&soup.vertices[triangle]);
        // Triangles with the same incenter are distinguished by their normals.
        (other - center).length() * (2.0 - normal.dot(across).abs())
    };
    let mismatches = parallel::collect(soup.len(), GRAIN, mismatch);
    // Of equal ones the first.
    let nearest =
        (0..).zip(mismatches).map(|(i, mismatch)| (mismatch, i)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (distance, triangle) = nearest;
    let size = corners[0].distance(corners[1]).max(corners[0].distance(corners[2]));
    let found = distance <= 1e-3 * f64::from(size) + 1e-5 * center.length();
    found.then(|| Origin { triangle, sigma: soup.sigma[triangle], opacity: soup.opacity[triangle] })
}

/// Incenter and unit normal.
fn incenter(corners: &[Vec3; 3]) -> (DVec3, DVec3) {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let (x, y, z) = (b.distance(c), c.distance(a), a.distance(b));
    let length = x + y + z;
    let center = if length > 0.0 { (a * x + b * y + c * z) / length } else { a };
    (center, (b - a).cross(c - a).normalize_or_zero())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_bake::TeacherOptions;
    use trisplat_bake::{BakeOptions, bake};
    use trisplat_scene::{ImportedScene, Scene};

    #[test]
    fn a_click_finds_the_soups_triangle_behind_a_baked_face() {
        let soup = trisplat_bench::scenes::studio(3000, 1);
        let loaded = ImportedScene {
            scene: Scene::Soup(soup.clone()),
            provenance: Default::default(),
            warnings: vec![],
            cameras: vec![],
        };
        let mut options = BakeOptions::DEFAULT;
        options.bvh.bvh = true;
        // Colours as they are.
        options.teacher = TeacherOptions::OFF;
        let asset = bake(loaded, &options).unwrap();
        let placement = asset.provenance.placement;
        let to_soup = |v: Vec3| placement.to_world(v);
        let size = glam::UVec2::new(320, 240);
        let (focal, center) = (Vec2::splat(400.0), size.as_vec2() / 2.0);
        let lens = Camera { rotation: glam::Mat3::IDENTITY, translation: Vec3::ZERO, focal, center, size };
        let from = lens.looking(Vec3::new(1.5, -2.5, -5.8), Vec3::new(0.0, -0.35, 0.1), -Vec3::Y);
        let placed = trisplat_scene::placed::to_file(&from, &placement, DVec3::ZERO);
        let mut found = 0;
        for i in 0..300u32 {
            let pixel = Vec2::new((i * 37 % 320) as f32 + 0.5, (i * 53 % 240) as f32 + 0.5);
            let Some(picked) = pick(&asset, &placed, pixel, Some((&soup, &to_soup))) else { continue };
            let origin = picked.source.expect("every face comes from the soup");
            let rgb = soup.rgb(origin.triangle).map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
            assert!((0..3).all(|c| rgb[c].abs_diff(picked.rgb[c]) <= 1), "{rgb:?} is not {picked:?}");
            assert_eq!(
                (origin.sigma, origin.opacity),
                (soup.sigma[origin.triangle], soup.opacity[origin.triangle])
            );
            found += 1;
        }
        assert!(found > 100, "only {found} clicks hit anything");
    }
}
