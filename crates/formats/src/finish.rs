//! The end of every reader: drops triangles that are not finite, and validates the rest.

use std::path::Path;
use trisplat_scene::{
    Error, ImportedScene, Result, Scene, Soup,
    mesh::{Colors, Mesh},
    report::counted,
};

/// The scene without triangles that are not finite; a warning counts these.
///
/// A valid scene costs one parallel pass over its numbers. Errors: `Malformed` when opacity, σ or colours are
/// out of range, when a corner names a missing vertex, or when no triangle is left.
pub fn finish(path: &Path, loaded: ImportedScene) -> Result<ImportedScene> {
    let ImportedScene { mut scene, mut provenance, mut warnings, cameras } = loaded;
    let total = scene.triangle_count();
    let error = |e: Error| Error::malformed(path, "values", e.to_string());
    let first = match &mut scene {
        _ if total == 0 => return Err(Error::malformed(path, "triangles", "there are none in the file")),
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
    if dropped > 0 || provenance.backdrop as usize > scene.triangle_count() {
        provenance.backdrop = 0;
    }
    if let Some(first) = first {
        let dropped = counted(dropped as u64, "triangle");
        warnings.push(format!("dropped {dropped} with non-finite values (first: triangle {first})"));
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

/// Drops faces that are not finite, and unused vertices, and validates the rest; returns the first dropped
/// face.
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn loaded(scene: Scene) -> ImportedScene {
        ImportedScene { scene, provenance: Default::default(), warnings: Vec::new(), cameras: Vec::new() }
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
                let out = finish(Path::new("a"), loaded(Scene::Soup(broken))).expect("three are left");
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
            let out = finish(Path::new("a"), loaded(Scene::Mesh(broken))).expect("one is left");
            let mut wanted = mesh();
            wanted.retain(|face| face == 0);
            assert_eq!((out.scene, out.warnings.len()), (Scene::Mesh(wanted), 1));
        }
        // An unused vertex is dropped silently.
        let mut unused = mesh();
        unused.positions.push(Vec3::NAN);
        unused.colors = Colors::Face(vec![[0.5; 3]; 2]);
        let out = finish(Path::new("a"), loaded(Scene::Mesh(unused))).expect("both are left");
        assert_eq!((out.scene.triangle_count(), out.warnings.len()), (2, 0));
    }

    #[test]
    fn out_of_range_is_an_error_with_a_remedy() {
        for (opacity, sigma, wants) in [(-2.0, 1.0, "sigmoid"), (1.5, 1.0, "sigmoid"), (0.5, -4.6, "raw")] {
            let mut raw = soup(3);
            (raw.opacity[1], raw.sigma[1]) = (opacity, sigma);
            let message = finish(Path::new("a"), loaded(Scene::Soup(raw))).expect_err("raw").to_string();
            assert!(message.contains("triangle 1") && message.contains(wants), "{message}");
        }
        let mut far = mesh();
        far.indices[4] = 4;
        let message = finish(Path::new("a"), loaded(Scene::Mesh(far))).expect_err("far").to_string();
        assert!(message.contains("face 1"), "{message}");
    }

    #[test]
    fn nothing_or_nothing_left_is_an_error() {
        for count in [0, 2] {
            let mut none = soup(count);
            none.sigma.fill(f32::NAN);
            let message = finish(Path::new("a"), loaded(Scene::Soup(none))).expect_err("none").to_string();
            assert!(message.contains("none"), "{message}");
        }
    }
}
