//! Normals, for engines that light the scene, and faces whose fronts face the viewer.
//!
//! Triangles of a trained scene lie across the surfaces that they show, with either winding: their
//! own normals sparkle. Normals come from the connected surface that is fused from depths of the
//! scene. Where there is none, they are the mean of the triangles around, weighted by visible
//! pixels. The cameras decide which side is the front.

use glam::{IVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::report::Outcome;
use trisplat_surface::SurfaceOptions;

/// Options of normals and a lit material.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct LitOptions {
    /// Give triangles normals and a lit material instead of an unlit one. The colours contain the
    /// light of the photos, and the engine adds its own: for shadows, fog and the mood of a scene,
    /// not for true relighting
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = LitOptions::DEFAULT.lit, num_args = 0..=1,
          require_equals = true, default_missing_value = "smooth", value_name = "NORMALS"))]
    pub lit: Lit,
}

impl LitOptions {
    /// Colours as they are.
    pub const DEFAULT: Self = Self { lit: Lit::Off };
}

/// Normals of the triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Lit {
    /// None: the material is unlit.
    #[default]
    Off,
    /// Normals of one connected surface, fused from depths, which takes seconds.
    Smooth,
    /// Each triangle's own normal.
    Flat,
}

/// Sources of the normals.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LitDetails {
    /// Number of cameras that decided the fronts of faces.
    pub cameras: u64,
    /// Faces whose winding was reversed.
    pub flipped: u64,
    /// Faces that no camera sees; their winding decides their front.
    pub unseen: u64,
    /// Faces with the normal of the connected surface near them; others take that of the triangles
    /// around.
    pub on_surface: u64,
    /// Median angle between a face's normal and its own plane's, degrees; 0 for flat ones.
    pub median_angle: f32,
}

trisplat_scene::stage!(LitDetails, "lit");

/// Maximum number of cameras that decide the fronts of faces.
const MAX_CAMERAS: usize = 100;
/// Longer side of the pictures that show which faces are visible, px.
const PICTURE_SIDE: u32 = 320;
/// Side of a cell whose triangles share normals, in sides of the median triangle.
const CELL_SIDES: f64 = 4.0;
/// Options of the surface for smooth normals: coarse, because lights show every wave of a fine one.
pub(super) const SURFACE: SurfaceOptions =
    SurfaceOptions { resolution: Some(128), ..SurfaceOptions::DEFAULT };

/// Winds the faces of `mesh` so that their fronts face `cameras`, and gives them normals. Smooth
/// ones come from `surface` where it is near, else from the triangles around. All are in the frame
/// of the mesh.
pub fn lit(
    mesh: &mut Mesh,
    cameras: &[Camera],
    surface: Option<&Mesh>,
    options: &LitOptions,
    details: &mut LitDetails,
) -> Result<Outcome<()>> {
    if options.lit == Lit::Off {
        return Ok(Outcome::Skipped("it was not asked for"));
    }
    if !mesh.normals.is_empty() || mesh.face_count() == 0 {
        return Ok(Outcome::Skipped("there is no face without a normal"));
    }
    let cameras: Vec<&Camera> = sampled_cameras(cameras).collect();
    let fronts = face_fronts(mesh, &cameras);
    details.cameras = cameras.len() as u64;
    details.unseen =
        fronts.iter().filter(|fronts| !cameras.is_empty() && fronts.weight == 0.0).count() as u64;
    mesh.normals = match options.lit {
        Lit::Smooth => smooth(mesh, &fronts, surface, details),
        _ => fronts.iter().map(|fronts| fronts.normal).collect(),
    };
    // An engine reverses the normal of a face seen from behind. So a face must show its front to
    // everyone who sees the front of the surface, even if it leans away from it. One that is drawn
    // from its front only is never seen from behind.
    for face in 0..mesh.face_count() {
        if !mesh.is_single_sided(face) && mesh.flat_normal(face).dot(mesh.normals[face]) < 0.0 {
            mesh.flip(face);
            details.flipped += 1;
        }
    }
    let mut angles: Vec<f32> = fronts
        .iter()
        .zip(&mesh.normals)
        .map(|(fronts, n)| fronts.normal.angle_between(*n).to_degrees())
        .collect();
    let middle = angles.len() / 2;
    details.median_angle = *angles.select_nth_unstable_by(middle, f32::total_cmp).1;
    Ok(Outcome::Changed(()))
}

/// The front of a face, towards the cameras.
struct FaceFront {
    /// Unit normal of its plane, towards the cameras.
    normal: Vec3,
    /// The pixels that show it; without cameras its area.
    weight: f32,
}

/// At most [`MAX_CAMERAS`] of `cameras`, evenly spaced.
fn sampled_cameras(cameras: &[Camera]) -> impl Iterator<Item = &Camera> {
    cameras.iter().step_by(cameras.len().div_ceil(MAX_CAMERAS).max(1))
}

/// Fronts of all faces, as `cameras` see them: hidden pixels do not count.
fn face_fronts(mesh: &Mesh, cameras: &[&Camera]) -> Vec<FaceFront> {
    let mut pixels = vec![[0u32; 2]; mesh.face_count()];
    let mut solid = SolidRasterizer::new();
    let drawing = SolidRasterOptions { samples: 1, ..SolidRasterOptions::default() };
    for camera in cameras {
        let camera = camera.fit_within(PICTURE_SIDE);
        let eye = camera.position();
        let visibility = solid.visibility(mesh, &camera, &drawing);
        for &face in visibility.face.iter().filter(|face| **face != NO_FACE) {
            let face = face as usize;
            let behind = mesh.flat_normal(face).dot(eye - mesh.corners(face)[0]) < 0.0;
            pixels[face][usize::from(behind)] += 1;
        }
    }
    let front_of = |face: usize| {
        let [front, back] = pixels[face];
        let normal = mesh.flat_normal(face);
        let weight =
            if cameras.is_empty() { mesh.area(face) as f32 } else { (front + back) as f32 };
        FaceFront { normal: if back > front { -normal } else { normal }, weight }
    };
    parallel::collect(pixels.len(), GRAIN, front_of)
}

/// Smooth normals from the surface or the neighbourhood.
fn smooth(
    mesh: &Mesh,
    fronts: &[FaceFront],
    surface: Option<&Mesh>,
    details: &mut LitDetails,
) -> Vec<Vec3> {
    let of_surface = surface.map(SurfaceNormals::of);
    let around = NormalCells::of(mesh, fronts);
    let normal = |face: usize| {
        let fronts = &fronts[face];
        let centroid = mesh.centroid(face);
        let of_surface =
            of_surface.as_ref().and_then(|surface| surface.at(centroid, fronts.normal));
        match of_surface {
            Some(normal) => (normal, 1),
            None => (around.at(centroid, fronts.normal), 0),
        }
    };
    let normals: Vec<(Vec3, u64)> = parallel::collect(fronts.len(), 1, normal);
    details.on_surface = normals.iter().map(|(_, on)| on).sum();
    normals.into_iter().map(|(normal, _)| normal).collect()
}

/// A surface's vertices by the cell they are in.
struct SurfaceNormals {
    /// Side of a cell, and the reach of a vertex.
    side: f32,
    cells: HashMap<IVec3, Vec<(Vec3, Vec3)>>,
}

impl SurfaceNormals {
    fn of(surface: &Mesh) -> Self {
        let side = (CELL_SIDES * surface.detail()).max(f64::from(f32::MIN_POSITIVE)) as f32;
        let mut sums = vec![Vec3::ZERO; surface.vertex_count()];
        for face in 0..surface.face_count() {
            let normal = surface.flat_normal(face) * surface.area(face) as f32;
            for vertex in surface.face(face) {
                sums[vertex as usize] += normal;
            }
        }
        let mut cells: HashMap<IVec3, Vec<(Vec3, Vec3)>> = HashMap::new();
        for (position, sum) in surface.positions.iter().zip(sums) {
            let cell = cells.entry((*position / side).floor().as_ivec3()).or_default();
            cell.push((*position, sum.normalize_or_zero()));
        }
        Self { side, cells }
    }

    /// The mean around a point, with more weight for near vertices; those that face away from
    /// `towards` do not count. `None` far from the surface.
    fn at(&self, point: Vec3, towards: Vec3) -> Option<Vec3> {
        let middle = (point / self.side).floor().as_ivec3();
        let mut sum = Vec3::ZERO;
        for step in 0..27 {
            let step = IVec3::new(step % 3, step / 3 % 3, step / 9) - 1;
            for (position, normal) in self.cells.get(&(middle + step)).into_iter().flatten() {
                let near = 1.0 - position.distance_squared(point) / (self.side * self.side);
                sum += *normal * near.max(0.0).powi(2) * agreement(*normal, towards);
            }
        }
        sum.try_normalize()
    }
}

/// Weight of one normal for a face with another: 0 when they lie back to back.
fn agreement(normal: Vec3, other: Vec3) -> f32 {
    (0.5 + 0.5 * normal.dot(other)).powi(2)
}

/// The normals of triangles, summed for each cell by their nearest axis, so that sheets back to
/// back stay apart.
struct NormalCells {
    side: f32,
    sums: HashMap<IVec3, [Vec3; 6]>,
}

impl NormalCells {
    fn of(mesh: &Mesh, seen: &[FaceFront]) -> Self {
        let side = (CELL_SIDES * mesh.detail()).max(f64::from(f32::MIN_POSITIVE)) as f32;
        let mut sums: HashMap<IVec3, [Vec3; 6]> = HashMap::new();
        for (face, seen) in seen.iter().enumerate() {
            let cell = sums.entry((mesh.centroid(face) / side).floor().as_ivec3()).or_default();
            let axis = seen.normal.abs().max_position();
            cell[2 * axis + usize::from(seen.normal[axis] < 0.0)] += seen.normal * seen.weight;
        }
        Self { side, sums }
    }

    /// The mean normal of the cells around a point, for a face there with this normal.
    fn at(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let at = point / self.side - 0.5;
        let corner = at.floor();
        let share = at - at.floor();
        let mut sum = Vec3::ZERO;
        for step in 0..8 {
            let step = IVec3::new(step & 1, step >> 1 & 1, step >> 2);
            let Some(cell) = self.sums.get(&(corner.as_ivec3() + step)) else { continue };
            let shares = Vec3::select(step.cmpeq(IVec3::ONE), share, 1.0 - share);
            let said = |sum: &Vec3| *sum * agreement(sum.normalize_or_zero(), normal);
            sum += shares.element_product() * cell.iter().map(said).sum::<Vec3>();
        }
        sum.try_normalize().unwrap_or(normal)
    }
}
