//! The end of every reader: drops triangles that are not finite, and validates the rest.

use glam::{DVec3, Vec3};
use std::fmt::Display;
use std::path::Path;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, ImportedScene, Limits, Placement, Provenance, Result, Scene, Soup};

/// The warning about a material that was made for light, of a mesh: without `--lit` a bake has none.
pub const PLAIN_COLOR: &str = "a material has one colour and no picture: without light only its outline shows; `trisplat bake --lit` lets light fall on it";

/// The scene without triangles that are not finite; a warning counts these. `origin` was subtracted
/// from its positions.
///
/// A valid scene costs one parallel pass over its numbers.
///
/// # Errors
///
/// `Malformed` when opacity, σ or colours are out of range, when a corner names a missing vertex,
/// or when no triangle is left.
pub(crate) fn finish(path: &Path, loaded: ImportedScene, origin: DVec3) -> Result<ImportedScene> {
    let ImportedScene { mut scene, mut provenance, mut warnings, cameras } = loaded;
    note_origin(&mut provenance, &mut warnings, origin);
    let total = scene.triangle_count();
    let error = |e: Error| Error::malformed(path, "values", e.to_string());
    let first = match &mut scene {
        _ if total == 0 => {
            return Err(Error::malformed(path, "triangles", "there are none in the file"));
        }
        Scene::Soup(soup) if soup.validate().is_err() => drop_from_soup(soup).map_err(error)?,
        Scene::Mesh(mesh) if mesh.validate().is_err() => drop_from_mesh(mesh).map_err(error)?,
        _ => None,
    };
    let dropped = total - scene.triangle_count();
    if dropped == total {
        let reason = format!(
            "none of {} is finite: there are NaN, infinite numbers or ones beyond {:.1e}; scale the scene down where it was made",
            counted(total as u64, "triangle"),
            f32::MAX
        );
        return Err(Error::malformed(path, "values", reason));
    }
    // A count that no longer matches is dropped.
    if dropped > 0 || provenance.backdrop_faces as usize > scene.triangle_count() {
        provenance.backdrop_faces = 0;
    }
    if let Some(first) = first {
        let dropped = counted(dropped as u64, "triangle");
        warnings
            .push(format!("dropped {dropped} with non-finite values (first: triangle {first})"));
    }
    Ok(ImportedScene { scene, provenance, warnings, cameras })
}

/// Drops triangles that are not finite and validates the rest; returns the first dropped one.
fn drop_from_soup(soup: &mut Soup) -> Result<Option<usize>> {
    soup.validate_shape()?;
    let first = (0..soup.len()).find(|&i| !soup.is_finite(i));
    soup.retain_finite();
    soup.validate()?;
    Ok(first)
}

/// Drops faces that are not finite, and unused vertices, and validates the rest; returns the first
/// dropped face.
fn drop_from_mesh(mesh: &mut Mesh) -> Result<Option<usize>> {
    mesh.validate_shape()?;
    let finite = |face: usize| {
        let corners = mesh.face(face).map(|v| v as usize);
        let color = |i: usize| match &mesh.colors {
            Colors::Face(colors) => colors[face],
            Colors::Vertex(colors) => colors[corners[i]],
        };
        corners.iter().all(|v| mesh.positions[*v].is_finite())
            && (0..3).all(|i| color(i).iter().all(|x| x.is_finite()))
            && mesh.opacity.get(face).is_none_or(|o| o.is_finite())
    };
    let keep: Vec<bool> = (0..mesh.face_count()).map(finite).collect();
    mesh.retain(|face| keep[face]);
    mesh.validate()?;
    Ok(keep.iter().position(|keep| !keep))
}

// ---- Scenes far from the origin of their world: at 500 km, f32 has steps of 3 cm ----------------
//
// Files with higher precision are read relative to an origin of their own, which the placement
// stores. So the bake gives bitwise the same result as for the scene at the origin.

/// Maximum distance along every axis below which positions are read unchanged.
const NEAR_DISTANCE: f64 = 4096.0;
/// Distance of a data set from the origin, in its sizes, at which f32 loses a millionth of the
/// size.
const MAX_DATASET_DISTANCE: f64 = 100.0;
/// Distance of a scene from the origin, in its sizes, at which it gets an origin of its own.
const MAX_SCENE_DISTANCE: f64 = 16.0;
/// Share of the positions that determine a scene's size, so that outliers or a sky do not change
/// it.
const SIZE_QUANTILE: f64 = 0.9;
/// Maximum number of positions to sample.
const MAX_SAMPLES: usize = 1 << 12;

/// Indices of the sampled positions among `count`.
pub(crate) fn sampled(count: usize) -> impl Iterator<Item = usize> {
    (0..count).step_by(count.div_ceil(MAX_SAMPLES).max(1))
}

/// The origin of a file, from a sample of its positions: whole numbers, and zero where f32
/// suffices. Positions that are not finite are ignored here and removed later.
pub(crate) fn origin_of(mut sample: Vec<DVec3>) -> DVec3 {
    sample.retain(|position| position.is_finite());
    let along = |axis: usize| median(sample.iter().map(|p| p[axis]).collect(), f64::total_cmp);
    let middle = DVec3::from_array([0, 1, 2].map(|axis| along(axis).unwrap_or(0.0)));
    let mut distances: Vec<f64> = sample.iter().map(|p| p.distance(middle)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let last = distances.len().saturating_sub(1);
    let spread =
        distances.get((SIZE_QUANTILE * last as f64).ceil() as usize).copied().unwrap_or(0.0);
    if is_far(middle) && middle.length() > MAX_SCENE_DISTANCE * spread {
        middle.round()
    } else {
        DVec3::ZERO
    }
}

/// The origin of a scene with this middle and size: zero, unless f32 lacks the digits for detail at
/// that distance. Whole numbers, so that adding them back is exact.
pub fn far_origin(middle: DVec3, size: f64) -> DVec3 {
    if middle.is_finite() && middle.length() > MAX_DATASET_DISTANCE * size {
        middle.round()
    } else {
        DVec3::ZERO
    }
}

/// True for a position so far from the origin that f32 may be too coarse.
pub fn is_far(position: DVec3) -> bool {
    position.abs().max_element() >= NEAR_DISTANCE
}

/// Positions with the digits that f32 lacks, if a file has them.
#[derive(Debug, Default)]
pub(super) struct FarPositions {
    rounded: Vec<Vec3>,
    /// The rounding residuals, from the first far position on. Empty, or as long as the positions.
    residuals: Vec<Vec3>,
}

impl FarPositions {
    /// Reserves memory for `count` positions.
    ///
    /// # Errors
    ///
    /// As for [`Limits::reserve`].
    pub(super) fn reserve(
        &mut self,
        limits: &Limits,
        place: impl Display,
        count: usize,
    ) -> Result<()> {
        limits.reserve(place, &mut self.rounded, count)
    }

    /// Number of positions.
    pub(super) fn len(&self) -> usize {
        self.rounded.len()
    }

    /// Adds a position.
    pub(super) fn push(&mut self, position: DVec3) {
        let rounded = position.as_vec3();
        if !self.residuals.is_empty() || is_far(position) {
            self.residuals.resize(self.rounded.len(), Vec3::ZERO);
            let rest = position - rounded.as_dvec3();
            self.residuals.push(if rest.is_finite() { rest.as_vec3() } else { Vec3::ZERO });
        }
        self.rounded.push(rounded);
    }

    /// The positions, and the origin subtracted from them.
    pub(super) fn relative(self) -> (Vec<Vec3>, DVec3) {
        if self.residuals.is_empty() {
            return (self.rounded, DVec3::ZERO);
        }
        let whole = |i: usize| self.rounded[i].as_dvec3() + self.residuals[i].as_dvec3();
        let origin = origin_of(sampled(self.rounded.len()).map(whole).collect());
        if origin == DVec3::ZERO {
            return (self.rounded, origin);
        }
        let near = |(rounded, rest): (Vec3, Vec3)| {
            (rounded.as_dvec3() - origin + rest.as_dvec3()).as_vec3()
        };
        (self.rounded.into_iter().zip(self.residuals).map(near).collect(), origin)
    }
}

/// Records the origin subtracted from a scene's positions.
pub(super) fn note_origin(provenance: &mut Provenance, warnings: &mut Vec<String>, origin: DVec3) {
    if origin == DVec3::ZERO {
        return;
    }
    let moved = Placement { center: origin.to_array(), ..Placement::IDENTITY };
    provenance.placement = provenance.placement.then(&moved);
    let [x, y, z] = origin.to_array();
    warnings.push(format!(
        "the scene is far from the origin of its world: {x} {y} {z} is subtracted from every position and stored in the file's placement"
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn loaded(scene: Scene) -> ImportedScene {
        ImportedScene {
            scene,
            provenance: Default::default(),
            warnings: Vec::new(),
            cameras: Vec::new(),
        }
    }

    fn soup(count: usize) -> Soup {
        Soup {
            vertices: vec![[Vec3::X, Vec3::Y, Vec3::Z]; count],
            opacity: vec![0.5; count],
            sigma: vec![1.0; count],
            sh: vec![[0.1; 3]; 4 * count],
            sh_degree: 1,
            ..Soup::default()
        }
    }

    fn mesh() -> Mesh {
        Mesh {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE],
            colors: Colors::Vertex(vec![[0.1; 3], [0.2; 3], [0.3; 3], [0.4; 3]]),
            indices: vec![0, 1, 2, 2, 1, 3],
            opacity: vec![0.5, 0.6],
            ..Mesh::default()
        }
    }

    #[test]
    fn a_soup_loses_what_is_not_finite() {
        type Damage = fn(&mut Soup, f32);
        let damages: [Damage; 5] = [
            |s, x| s.vertices[2][1].z = x,
            |s, x| s.opacity[2] = x,
            |s, x| s.sigma[2] = x,
            |s, x| s.sh[8][0] = x,
            |s, x| s.sh[11][2] = x,
        ];
        for damage in damages {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut broken = soup(4);
                damage(&mut broken, bad);
                let out = finish(Path::new("a"), loaded(Scene::Soup(broken)), DVec3::ZERO)
                    .expect("three are left");
                assert_eq!(out.scene, Scene::Soup(soup(3)));
                assert_eq!(out.warnings.len(), 1);
                assert!(out.warnings[0].contains("triangle 2"), "{}", out.warnings[0]);
            }
        }
    }

    #[test]
    fn a_mesh_loses_faces_and_the_vertices_only_they_used() {
        type Damage = fn(&mut Mesh);
        let damages: [Damage; 3] = [
            |m| m.positions[3].x = f32::NAN,
            |m| m.opacity[1] = f32::INFINITY,
            |m| m.colors = Colors::Vertex(vec![[0.1; 3], [0.2; 3], [0.3; 3], [f32::NAN; 3]]),
        ];
        for damage in damages {
            let mut broken = mesh();
            damage(&mut broken);
            let out = finish(Path::new("a"), loaded(Scene::Mesh(broken)), DVec3::ZERO)
                .expect("one is left");
            let mut wanted = mesh();
            wanted.retain(|face| face == 0);
            assert_eq!((out.scene, out.warnings.len()), (Scene::Mesh(wanted), 1));
        }
        // An unused vertex is dropped silently.
        let mut unused = mesh();
        unused.positions.push(Vec3::NAN);
        unused.colors = Colors::Face(vec![[0.5; 3]; 2]);
        let out = finish(Path::new("a"), loaded(Scene::Mesh(unused)), DVec3::ZERO)
            .expect("both are left");
        assert_eq!((out.scene.triangle_count(), out.warnings.len()), (2, 0));
    }

    #[test]
    fn out_of_range_is_an_error_with_a_remedy() {
        for (opacity, sigma, wants) in
            [(-2.0, 1.0, "sigmoid"), (1.5, 1.0, "sigmoid"), (0.5, -4.6, "raw")]
        {
            let mut raw = soup(3);
            raw.opacity[1] = opacity;
            raw.sigma[1] = sigma;
            let message = finish(Path::new("a"), loaded(Scene::Soup(raw)), DVec3::ZERO)
                .expect_err("raw")
                .to_string();
            assert!(message.contains("triangle 1") && message.contains(wants), "{message}");
        }
        let mut far = mesh();
        far.indices[4] = 4;
        let message = finish(Path::new("a"), loaded(Scene::Mesh(far)), DVec3::ZERO)
            .expect_err("far")
            .to_string();
        assert!(message.contains("face 1"), "{message}");
    }

    #[test]
    fn nothing_or_nothing_left_is_an_error() {
        for count in [0, 2] {
            let mut none = soup(count);
            none.sigma.fill(f32::NAN);
            let message = finish(Path::new("a"), loaded(Scene::Soup(none)), DVec3::ZERO)
                .expect_err("none")
                .to_string();
            assert!(message.contains("none"), "{message}");
        }
    }
}

#[cfg(test)]
mod far_tests {
    use super::*;

    fn read(offset: DVec3) -> (Vec<Vec3>, DVec3) {
        let mut positions = FarPositions::default();
        for p in
            [DVec3::new(0.125, 0.0, -0.5), DVec3::new(1.0, 2.0, 0.1), DVec3::new(-1.0, -2.0, 0.3)]
        {
            positions.push(p + offset);
        }
        positions.relative()
    }

    #[test]
    fn a_scene_far_away_is_the_scene_at_the_origin() {
        let (near, none) = read(DVec3::ZERO);
        assert_eq!(none, DVec3::ZERO);
        let (far, origin) = read(DVec3::new(500_123.0, 5_412_345.0, 321.0));
        assert_eq!(origin, DVec3::new(500_123.0, 5_412_345.0, 321.0));
        for (near, far) in near.iter().zip(far) {
            assert!(near.distance(far) < 1e-7, "{near} {far}");
        }
    }

    #[test]
    fn a_large_scene_and_one_a_little_off_stay_where_they_are() {
        assert_eq!(read(DVec3::splat(4000.0)).1, DVec3::ZERO);
        let mut large = FarPositions::default();
        for p in [DVec3::splat(-90_000.0), DVec3::new(100_000.3, 5.0, 5.0), DVec3::NAN] {
            large.push(p);
        }
        assert_eq!(large.len(), 3);
        let (positions, origin) = large.relative();
        assert_eq!((positions[1], origin), (Vec3::new(100_000.3, 5.0, 5.0), DVec3::ZERO));
    }

    #[test]
    fn strays_and_a_sky_move_no_scene() {
        let at = DVec3::new(500_123.0, 5_412_345.0, 321.0);
        let scene = |i: usize| at + DVec3::new((i % 37) as f64, (i % 11) as f64, 0.5);
        let mut positions: Vec<DVec3> = (0..2000).map(scene).collect();
        positions.extend([DVec3::ZERO, DVec3::NAN, at + DVec3::X * 3e5]);
        assert!(origin_of(positions).distance(at) < 30.0);
        assert_eq!(origin_of(Vec::new()), DVec3::ZERO);
        assert_eq!(sampled(0).count(), 0);
        assert!((2000..=MAX_SAMPLES).contains(&sampled(1_000_003).count()));
    }
}
