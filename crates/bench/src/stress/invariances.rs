//! What must not change a picture: a scene is drawn both ways, and the two are compared.

use super::case::StressCase;
use super::exact::{ExactFrame, UNDECIDED};
use super::histogram::Histogram;
use super::rows::InvarianceRow;
use super::scene::StressScene;
use super::tally::summary;
use glam::{DMat3, DQuat, DVec3, UVec2, Vec3};
use trisplat_raster::{
    soft::{SoftRasterizer, SoupRef},
    solid::{NO_FACE, SolidRasterizer},
};
use trisplat_scene::{
    Error, Result, Rng,
    math::lanes::{SimdLevel, with_at_most},
};

/// Columns and rows by which a picture is moved over the tiles, px.
const MOVED: UVec2 = UVec2::new(21, 13);
/// A scale that is no power of two.
const SCALE: f64 = 3.7;
/// Threads that a scene is drawn with in place of one.
const THREADS: usize = 3;

/// What is changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Change {
    Nothing,
    Rotation,
    Translation,
    Scale,
    Order,
    Tiles,
    Threads,
    Portable,
    Avx2,
}

/// A change, its name, and the largest 99.9% quantile of the differences that is allowed.
const CHANGES: [(Change, &str, f64); 8] = [
    (Change::Rotation, "rotation", 1e-4),
    (Change::Translation, "translation", 1e-4),
    (Change::Scale, "scale", 1e-4),
    (Change::Order, "order", 0.0),
    (Change::Tiles, "tiles", 1e-4),
    (Change::Threads, "threads", 0.0),
    (Change::Portable, "portable", 1e-4),
    (Change::Avx2, "avx2", 1e-4),
];

/// The values of a picture's pixels (colour and transmittance), and the faces that the solid rasteriser shows.
struct Drawn {
    values: Vec<[f32; 4]>,
    faces: Vec<u32>,
}

/// Draws `cases` scenes of the promises' domain in all ways.
///
/// # Errors
/// [`Error::Invalid`] when the system has no threads left.
pub(super) fn rows(seed: u64, cases: u64) -> Result<Vec<InvarianceRow>> {
    let (one, several) = (pool(1)?, pool(THREADS)?);
    let row = |(change, name, at_most): (Change, &str, f64)| {
        let pool = if change == Change::Threads { &several } else { &one };
        let (mut value, mut changed, mut samples) = (Histogram::default(), 0u64, 0u64);
        for index in 0..cases {
            let (case, _) = StressCase::random(seed, 4 * index + 3);
            let mut scene = StressScene::new(&case);
            if change == Change::Rotation {
                // Colours that depend on the direction turn with the scene's axes.
                scene.soup.truncate_sh(0);
            }
            let mut exact = ExactFrame::default();
            exact.draw(&scene.soup, &scene.camera, &scene.options);
            let before = one.install(|| drawn(&scene, Change::Nothing));
            let after = pool.install(|| drawn(&changed_scene(&scene, &case, change), change));
            let scale = exact.color_scale;
            for (pixel, margin) in exact.margin.iter().enumerate() {
                if *margin >= UNDECIDED {
                    for (c, scale) in [scale, scale, scale, 1.0].into_iter().enumerate() {
                        let [a, b] = [&before, &after].map(|d| f64::from(d.values[pixel][c]));
                        value.add((a - b).abs() / scale);
                    }
                }
                changed += u64::from(before.faces[pixel] != after.faces[pixel]);
                samples += 1;
            }
        }
        let value = summary(&value);
        InvarianceRow {
            name: name.to_owned(),
            cases,
            value,
            solid_changed: changed as f64 / samples.max(1) as f64,
            at_most,
            kept: value.p999 <= at_most,
        }
    };
    Ok(CHANGES.map(row).to_vec())
}

fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| Error::invalid("threads", threads, e.to_string()))
}

/// The scene with its coordinates changed.
fn changed_scene(scene: &StressScene, case: &StressCase, change: Change) -> StressScene {
    let mut out = scene.clone();
    let rng = Rng::new(case.seed, "stress change", 0);
    let at = |n: u64| rng.uniform_f64(n) * 2.0 - 1.0;
    let axis = DVec3::new(at(0), at(1), at(2)).normalize_or(DVec3::Z);
    let (rotation, translation) = (scene.camera.rotation.as_dmat3(), scene.camera.translation.as_dvec3());
    let mut place = |world: &dyn Fn(DVec3) -> DVec3| {
        out.soup.vertices.iter_mut().for_each(|t| *t = t.map(|v: Vec3| world(v.as_dvec3()).as_vec3()));
    };
    match change {
        Change::Rotation => {
            let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, 3.0 * at(3)));
            place(&|v| turn * v);
            out.camera.rotation = (rotation * turn.transpose()).as_mat3();
        }
        Change::Translation => {
            let by = axis * f64::from(scene.options.near) / 0.01;
            place(&|v| v + by);
            out.camera.translation = (translation - rotation * by).as_vec3();
        }
        Change::Scale => {
            place(&|v| v * SCALE);
            out.camera.translation = (translation * SCALE).as_vec3();
            out.options.near = (f64::from(scene.options.near) * SCALE) as f32;
        }
        Change::Order => {
            let k = scene.soup.sh_count();
            let (soup, from) = (&mut out.soup, &scene.soup);
            soup.vertices.reverse();
            soup.opacity.reverse();
            soup.sigma.reverse();
            soup.sh = from.sh.chunks(k).rev().flatten().copied().collect();
        }
        Change::Tiles => {
            out.camera.center += MOVED.as_vec2();
            out.camera.size += MOVED + UVec2::splat(3);
        }
        Change::Nothing | Change::Threads | Change::Portable | Change::Avx2 => {}
    }
    out
}

/// The picture of a scene, and of [`Change::Tiles`] the part that there is without it.
fn drawn(scene: &StressScene, change: Change) -> Drawn {
    let level = match change {
        Change::Portable => SimdLevel::Portable,
        Change::Avx2 => SimdLevel::Avx2,
        _ => SimdLevel::Avx512,
    };
    let (mut soft, mut solid) = (SoftRasterizer::new(), SolidRasterizer::new());
    let (mesh, solid_options) = scene.solid();
    let (frame, seen) = with_at_most(level, || {
        let frame = soft.render(&SoupRef::from(&scene.soup), &scene.camera, &scene.options);
        (frame, solid.visibility(&mesh, &scene.camera, &solid_options))
    });
    let from = if change == Change::Tiles { MOVED } else { UVec2::ZERO };
    let last = scene.soup.len().saturating_sub(1) as u32;
    let face = |f: u32| if change == Change::Order && f != NO_FACE { last - f } else { f };
    let mut out = Drawn { values: Vec::new(), faces: Vec::new() };
    for y in 0..super::scene::SIDE {
        for x in 0..super::scene::SIDE {
            let at = ((y + from.y) * scene.camera.size.x + x + from.x) as usize;
            let [r, g, b] = frame.rgb[at];
            out.values.push([r, g, b, frame.transmittance[at]]);
            out.faces.push(face(seen.face[at]));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn what_must_not_change_a_picture_does_not() {
        let rows = rows(7, 30).unwrap();
        assert_eq!(rows.len(), CHANGES.len());
        for row in rows {
            assert!(row.kept && row.value.count > 10_000, "{row:?}");
            let exact = ["order", "threads"].contains(&row.name.as_str());
            assert!(!exact || row.value.max == 0.0, "{row:?}");
            assert!(row.solid_changed < 0.01, "{row:?}");
        }
    }

    #[test]
    fn a_change_is_one() {
        let (case, _) = StressCase::random(1, 3);
        let scene = StressScene::new(&case);
        for (change, name, _) in CHANGES {
            let same = changed_scene(&scene, &case, change) == scene;
            let how = [Change::Threads, Change::Portable, Change::Avx2].contains(&change);
            assert_eq!(same, how, "{name}");
        }
        let center = |change| changed_scene(&scene, &case, change).camera.center;
        assert_eq!(center(Change::Tiles), scene.camera.center + Vec2::new(21.0, 13.0));
    }
}
