//! A soft surrounding behind the scene: one closed surface, with a picture of everything around.
//!
//! Photos show sky and walls without points. Training closes a scene with a shell of triangles that have one colour each; a scene without one has
//! holes, pixels of photos that no triangle covers. In place of the shell, or behind the holes, stands a smooth `surface`. Its texture has the
//! colours that photos agree on (`known`), and continues them where nobody looked (`fill`). Without photos or pictures of a soft scene a shell
//! stays as it is.
//!
//! The backdrop does not belong to the scene: its triangles come last, [`Provenance::backdrop`] counts them, and
//! files store them separately. They are visible from inside only, so a viewer outside looks through the near
//! side.
//!
//! [`Provenance::backdrop`]: trisplat_scene::Provenance::backdrop

mod fill;
mod known;
mod panorama;
mod surface;

use super::views::Views;
use fill::fill;
use glam::{DVec3, UVec2, Vec2, Vec3};
use known::Known;
use panorama::panorama;
use std::sync::Arc;
use surface::surface;
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::{
    Asset, FaceTexture, Result, Texture,
    camera::Camera,
    image::RgbImage,
    math::median::median,
    math::octasphere::face_count,
    mesh::{Colors, Mesh},
    report::{Outcome, StageDetails},
};

/// Photos that are searched for holes.
const VIEWS: usize = 16;
/// Holes below this share of the photos are not closed.
const LEAST_HOLES: f64 = 0.001;
/// Below this covered share of a picture, or unmasked share of a photo, the scene is an object without
/// background.
const LEAST_COVERED: f64 = 0.8;
/// Least distance of the surface, as a multiple of that of the farthest camera, and without a shell of the farthest triangle.
const BEHIND: f32 = 1.2;
/// Most subdivisions of the octahedron: 8 · 4⁴ triangles, and ...
const MOST_SUBDIVISIONS: u32 = 4;
/// ... fewest without a shell.
const LEAST_SUBDIVISIONS: u32 = 2;
/// The surface has at most as many triangles as the shell. Without one it has one per this many of the scene.
const SCENE_PER_BACKDROP: u64 = 20;
/// Texels per pixel of the photos: what stands behind a scene is out of focus.
const TEXELS_PER_PIXEL: f64 = 0.5;
/// Fewest and most rows of the picture.
const PICTURE_ROWS: [u32; 2] = [256, 1024];
/// Weight of a shell's own colours where no picture looks, against the pull of a neighbour: little, so that its edges do not show ...
const SHELL_WEIGHT: f32 = 0.005;
/// ... and where there are no pictures.
const ONLY_SHELL_WEIGHT: f32 = 0.3;

/// Whether holes are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum BackdropWhen {
    /// When photos show something where no triangle is, as the node `backdrop` of the output
    Auto,
    /// Always with photos, as the node `backdrop` of the output
    Sphere,
    /// Always with photos, in a file of its own: OUT.backdrop.glb
    File,
    /// Always with photos, as a panorama for the sky of an engine: OUT.sky.jpg
    Sky,
    /// Never; a backdrop of the input is removed
    Off,
}

/// The backdrop of the scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct BackdropOptions {
    /// When a far sphere is put behind the scene, with the photos' colours where they see it
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = BackdropOptions::DEFAULT.backdrop, value_name = "WHEN"))]
    pub backdrop: BackdropWhen,
}

impl BackdropOptions {
    /// Closes holes if there are any.
    pub const DEFAULT: Self = Self { backdrop: BackdropWhen::Auto };

    /// The triangles of a budget that are left for the scene itself.
    pub fn scene_budget(&self, budget: Option<u64>) -> Option<u64> {
        match self.backdrop {
            BackdropWhen::Off => budget,
            _ => budget.map(|most| most - backdrop_triangles(most).min(most / 2)),
        }
    }
}

impl Default for BackdropOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Measurements of holes.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct BackdropDetails {
    /// Share of the photos' pixels without a triangle; absent when photos were not searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holes: Option<f64>,
    /// True when the backdrop is that of the input.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub kept: bool,
}

impl StageDetails for BackdropDetails {
    const STAGE: &'static str = "backdrop";
}

/// Puts a surface behind `mesh` in place of `given`, the shell or the backdrop of the input, or where `views` see holes. Without views, `given`
/// itself.
///
/// Errors: a photo that cannot be decoded; more vertices than 32 bits count.
pub fn backdrop(
    mesh: &mut Mesh,
    given: Option<Mesh>,
    views: Option<&mut Views>,
    options: &BackdropOptions,
    details: &mut BackdropDetails,
) -> Result<Outcome<()>> {
    if options.backdrop == BackdropWhen::Off {
        return Ok(Outcome::Skipped("`backdrop` off"));
    }
    let views = views.filter(|views| !views.is_empty());
    let (given, views) = match (given, views) {
        (Some(given), Some(views)) if mesh.indices.is_empty() => (Some(given), views),
        (Some(given), _) => {
            mesh.append(given)?;
            details.kept = true;
            return Ok(Outcome::Changed(()));
        }
        (None, Some(views)) => (None, views),
        (None, None) => {
            return Ok(Outcome::Skipped("it needs photos (`dataset`) or a soft scene (`teacher`)"));
        }
    };
    if given.is_none()
        && let Some(why) = why_none(mesh, views, options, details)?
    {
        return Ok(Outcome::Skipped(why));
    }
    let behind = surrounding(mesh, given.as_ref(), views)?;
    mesh.append(behind)?;
    Ok(Outcome::Changed(()))
}

/// The reason why a scene without a shell gets no backdrop, if there is one.
fn why_none(
    mesh: &Mesh,
    views: &mut Views,
    options: &BackdropOptions,
    details: &mut BackdropDetails,
) -> Result<Option<&'static str>> {
    if !mesh.indices.is_empty() {
        return Ok(Some("a mesh with shared vertices is left as it is"));
    }
    if views.covered() < LEAST_COVERED {
        return Ok(Some("the scene is an object: there is nothing behind it"));
    }
    let holes = find_holes(mesh, views)?;
    details.holes = Some(holes.share);
    let auto = options.backdrop == BackdropWhen::Auto;
    Ok(match () {
        () if auto && views.are_cut() && holes.counted < 1.0 => {
            Some("transparent photos show an object: there is nothing behind it")
        }
        () if auto && holes.counted < LEAST_COVERED => {
            Some("masks leave an object: there is nothing behind it")
        }
        () if auto && holes.share < LEAST_HOLES => Some("triangles cover the photos"),
        () => None,
    })
}

/// The surface behind `mesh` in place of `shell`, with a picture of what `views` show.
fn surrounding(mesh: &Mesh, shell: Option<&Mesh>, views: &mut Views) -> Result<Mesh> {
    let (center, mut least) = (views.center(), views.radius());
    if shell.is_none() {
        least = mesh.positions.iter().map(|v| v.distance(center)).fold(least, f32::max);
    }
    let scene = mesh.face_count() as u64;
    let faces = shell.map_or_else(|| backdrop_triangles(scene), |shell| shell.face_count() as u64);
    let (behind, uvs) = surface(center, subdivisions(faces), shell, BEHIND * least);
    let mut all = Mesh { shell: Vec::new(), ..mesh.clone() };
    all.append(behind.clone())?;
    let rows = picture_rows(views);
    let mut known = Known::of_photos(&all, mesh.face_count(), &uvs, rows as usize, views)?;
    if let Some(shell) = shell.filter(|_| views.is_drawn()) {
        known.add(&panorama(shell, center, rows), SHELL_WEIGHT);
    }
    Ok(painted(behind, uvs, known))
}

/// A surface with a smooth picture of a shell's own colours, for a scene without photos that `cameras` may have looked at.
pub(super) fn smoothed(shell: &Mesh, cameras: &[Camera]) -> Mesh {
    let mean = |points: &mut dyn ExactSizeIterator<Item = Vec3>| {
        let count = points.len().max(1) as f32;
        points.sum::<Vec3>() / count
    };
    let center = match cameras.is_empty() {
        true => mean(&mut shell.positions.iter().copied()),
        false => mean(&mut cameras.iter().map(Camera::position)),
    };
    let (behind, uvs) = surface(center, subdivisions(shell.face_count() as u64), Some(shell), 0.0);
    let mut known = Known::nothing(PICTURE_ROWS[0] as usize);
    known.add(&panorama(shell, center, PICTURE_ROWS[0]), ONLY_SHELL_WEIGHT);
    painted(behind, uvs, known)
}

/// A surface with a picture of what is known of it.
fn painted(surface: Mesh, uvs: Vec<[Vec2; 3]>, known: Known) -> Mesh {
    let rows = known.rows as u32;
    let rgb = fill(known).into_iter().map(|value| value.map(|code| (code + 0.5) as u8)).collect();
    let picture = RgbImage { size: UVec2::new(2 * rows, rows), rgb, alpha: None };
    let texture = FaceTexture::new(uvs, Arc::new(Texture::new(picture)));
    let corners = (0..surface.face_count()).flat_map(|face| texture.corner_means(face).unwrap_or_default());
    Mesh { colors: Colors::Vertex(corners.collect()), texture: Some(texture), ..surface }
}

/// Subdivisions of an octahedron for at most `faces` triangles.
fn subdivisions(faces: u64) -> u32 {
    (1..=MOST_SUBDIVISIONS).rev().find(|s| face_count(*s) <= faces).unwrap_or(0)
}

/// Triangles of the surface behind a scene of `faces` triangles that has no shell.
fn backdrop_triangles(faces: u64) -> u64 {
    face_count(subdivisions(faces / SCENE_PER_BACKDROP).max(LEAST_SUBDIVISIONS))
}

/// Rows of a picture that suits the photos.
fn picture_rows(views: &Views) -> u32 {
    let focals = views.cameras().iter().map(|camera| camera.mean_focal()).collect();
    let per_radian = TEXELS_PER_PIXEL * median(focals, f64::total_cmp).unwrap_or(0.0);
    ((per_radian * std::f64::consts::PI) as u32).next_power_of_two().clamp(PICTURE_ROWS[0], PICTURE_ROWS[1])
}

/// Turns the backdrop of `asset` into a panorama, seen from its middle, and leaves it out of the levels.
pub(super) fn take_sky(asset: &mut Asset) {
    let Some((scene, backdrop)) = asset.apart() else { return };
    let behind = backdrop.mesh;
    let center = behind.positions.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / behind.vertex_count() as f64;
    let rows = behind.texture.as_ref().map_or(PICTURE_ROWS[0], |texture| texture.pages[0].size().y);
    let rows = rows.clamp(PICTURE_ROWS[0], PICTURE_ROWS[1]);
    asset.sky = Some(panorama(&behind, center.as_vec3(), rows));
    (asset.mesh, asset.chunks, asset.provenance.backdrop) = (scene.mesh, scene.chunks, 0);
    for level in &mut asset.levels {
        if let Some((scene, _)) = level.apart() {
            *level = scene;
        }
    }
}

/// What photos show where no triangle is.
struct Holes {
    /// Share of the photos' pixels that count.
    share: f64,
    /// Share of all pixels that count.
    counted: f64,
}

fn find_holes(mesh: &Mesh, views: &mut Views) -> Result<Holes> {
    let drawing = views.drawing(mesh, 1);
    let mut solid = SolidRasterizer::new();
    let (mut open, mut all) = (0.0, 0.0);
    let mut pixels = 0;
    let chosen = views.evenly_spaced(VIEWS);
    views.prefetch(&chosen);
    for view in chosen {
        let photo = views.photo(view)?;
        let seen = solid.visibility(mesh, views.camera(view), &drawing);
        pixels += seen.face.len();
        for (pixel, face) in seen.face.iter().enumerate() {
            let weight = photo.alpha.as_ref().map_or(1.0, |a| f64::from(a[pixel]) / 255.0);
            all += weight;
            if *face == NO_FACE {
                open += weight;
            }
        }
    }
    let counted = all / pixels.max(1) as f64;
    Ok(Holes { share: open / f64::max(all, 1e-9), counted })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_never_exceeded() {
        for most in [1, 5, 300, 5000, 100_000, 2_000_000] {
            let scene = BackdropOptions::DEFAULT.scene_budget(Some(most)).unwrap_or(0);
            assert!(scene + backdrop_triangles(scene) <= most || most < 512, "{most}: {scene}");
        }
    }
}
