//! Makes soft triangles solid: each becomes the smaller, opaque triangle that looks most like it.
//!
//! The level sets of the window function are copies of the triangle shrunk about its incenter (Held
//! et al. 2025, eq. 1), so no meshing is needed.

use crate::prune::is_degenerate;
use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Error, FaceSh, Result, Soup, parallel, rgb_from_sh0};

/// The σ of a solid triangle: at opacity 1 its half contour is the triangle itself to 1 part in
/// 2^10000.
pub const SOLID_SIGMA: f32 = 1e-4;

/// Size of the solid triangle that replaces a soft one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Solidify {
    /// The larger of `contour` and `area`: hard triangles keep their outline, faint ones their
    /// share
    Auto,
    /// The outline where opacity times window is `contour`; fainter triangles are dropped
    Contour,
    /// As large as the opacity that the triangle adds to the picture
    Area,
    /// Full size
    None,
}

/// Options of the conversion of soft triangles to solid ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolidOptions {
    /// Size of the solid triangle that replaces a soft one
    pub solid: Solidify,
    /// The value of opacity times window that counts as the outline
    #[schemars(range(min = 0.0, max = 1.0))]
    pub contour: f64,
}

impl SolidOptions {
    /// Nothing vanishes and nothing tears.
    pub const DEFAULT: Self = Self { solid: Solidify::Auto, contour: 0.5 };
}

trisplat_scene::default!(SolidOptions);

/// Effect of shrinking.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SolidDetails {
    /// Triangles dropped because opacity times window nowhere reaches `contour`.
    pub no_contour: u64,
    /// Triangles dropped because they shrank to a line or a point.
    pub collapsed: u64,
    /// Area of all triangles after, as a share of that before.
    pub area_ratio: f64,
}

trisplat_scene::stage!(SolidDetails, "solid");

/// Shrinks every triangle about its incenter and makes it opaque. Triangles that shrink below the
/// range of an f32 are dropped; with `contour`, so are triangles without one.
///
/// # Errors
///
/// `contour` outside (0, 1); nothing left.
pub fn solid(
    soup: &mut Soup,
    options: &SolidOptions,
    details: &mut SolidDetails,
) -> Result<Outcome<()>> {
    if !(options.contour > 0.0 && options.contour < 1.0) {
        return Err(Error::invalid("contour", options.contour, "a number above 0 and below 1"));
    }
    let is_soft =
        |i: usize| (!(soup.opacity[i] >= 1.0 && soup.sigma[i] <= SOLID_SIGMA)).then_some(());
    if parallel::find_first(soup.len(), 1 << 14, is_soft).is_none() {
        return Ok(Outcome::Skipped("every triangle is solid already"));
    }
    let (results, areas) = solidify_all(soup, options);
    soup.opacity.fill(1.0);
    soup.sigma.fill(SOLID_SIGMA);
    let lost = |result| results.iter().filter(|&&r| r == result).count();
    let no_contour = lost(Shrunk::NoContour);
    let collapsed = lost(Shrunk::Collapsed);
    if no_contour + collapsed == results.len() {
        return Err(nothing_left(options, no_contour, results.len()));
    }
    if no_contour + collapsed > 0 {
        soup.retain(|i| results[i] == Shrunk::Solid);
    }
    *details = SolidDetails {
        no_contour: no_contour as u64,
        collapsed: collapsed as u64,
        area_ratio: areas.after / areas.before,
    };
    Ok(Outcome::Changed(()))
}

/// Triangles that a thread shrinks at once. Fixed, so that sums do not depend on the number of
/// threads.
const PART: usize = 1 << 12;

/// Sums of areas.
#[derive(Debug, Clone, Copy, Default)]
struct Areas {
    before: f64,
    after: f64,
}

/// Shrinks every triangle in place; returns the areas before and after.
fn solidify_all(soup: &mut Soup, options: &SolidOptions) -> (Vec<Shrunk>, Areas) {
    let mut results = vec![Shrunk::Solid; soup.len()];
    let rows = soup
        .vertices
        .chunks_mut(PART)
        .zip(soup.opacity.chunks(PART))
        .zip(soup.sigma.chunks(PART))
        .zip(results.chunks_mut(PART));
    let parts: Vec<Areas> = parallel::map(rows, |_, (((vertices, opacity), sigma), results)| {
        let mut sum = Areas::default();
        for (((corners, &o), &s), result) in
            vertices.iter_mut().zip(opacity).zip(sigma).zip(results)
        {
            let factor = factor(o.into(), s.into(), options);
            let area = area(corners);
            *result = solidify(corners, factor);
            sum.before += area;
            if *result == Shrunk::Solid {
                sum.after += area * factor.min(1.0).powi(2);
            }
        }
        sum
    });
    let sum = |of: fn(&Areas) -> f64| parts.iter().map(of).sum();
    (results, Areas { before: sum(|part| part.before), after: sum(|part| part.after) })
}

fn nothing_left(options: &SolidOptions, no_contour: usize, total: usize) -> Error {
    if no_contour > 0 {
        let wants = format!(
            "a lower value, or `solid` auto: {no_contour} of {total} triangles never reach it"
        );
        return Error::invalid("contour", options.contour, wants);
    }
    let what = format!("{total} triangles that shrink to nothing");
    Error::invalid(
        "the scene",
        what,
        "triangles of some size (the prune stage drops lines and points)",
    )
}

/// The result of shrinking a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shrunk {
    Solid,
    NoContour,
    Collapsed,
}

/// The scale of a triangle about its incenter.
fn factor(opacity: f64, sigma: f64, options: &SolidOptions) -> f64 {
    let contour = || contour_factor(opacity, sigma, options.contour);
    match options.solid {
        Solidify::Auto => contour().max(area_factor(opacity, sigma)),
        Solidify::Contour => contour(),
        Solidify::Area => area_factor(opacity, sigma),
        Solidify::None => 1.0,
    }
}

/// Shrinks one triangle in place.
fn solidify(corners: &mut [Vec3; 3], factor: f64) -> Shrunk {
    if factor >= 1.0 {
        return Shrunk::Solid;
    }
    if !(factor > 0.0) {
        return Shrunk::NoContour;
    }
    let shrunk = shrink(corners, factor);
    *corners = shrunk;
    if is_degenerate(&shrunk) { Shrunk::Collapsed } else { Shrunk::Solid }
}

/// The scale about the incenter at which opacity times window is `contour`; 0 when it never is.
///
/// ```text
/// o (1 - f)^sigma = t   =>   f = 1 - (t / o)^(1 / sigma)      (Held et al. 2025, eq. 1)
/// ```
///
/// Domain: o in [0, 1], sigma > 0, t in (0, 1). In the log domain, where 1e-4 and 1e3 do not
/// overflow.
pub fn contour_factor(opacity: f64, sigma: f64, contour: f64) -> f64 {
    if !(opacity > contour) {
        return 0.0;
    }
    -((contour.ln() - opacity.ln()) / sigma).exp_m1()
}

/// The scale whose area is the triangle's integrated alpha: the opaque triangle then adds as much
/// to a picture as the soft one.
///
/// ```text
/// f^2 = o * mean(window) = o * 2 / ((sigma + 1) (sigma + 2))
/// ```
///
/// The mean holds for any triangle: the part of it above level t is itself, scaled by 1 -
/// t^(1/sigma), and the mean is the integral of that area over t from 0 to 1.
pub fn area_factor(opacity: f64, sigma: f64) -> f64 {
    (opacity * 2.0 / ((sigma + 1.0) * (sigma + 2.0))).sqrt()
}

/// The triangle scaled by `factor` about its incenter, computed in f64 and rounded once.
///
/// ```text
/// s = (|bc| a + |ca| b + |ab| c) / (|bc| + |ca| + |ab|)
/// ```
#[inline]
pub fn shrink(corners: &[Vec3; 3], factor: f64) -> [Vec3; 3] {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let bc = b.distance(c);
    let ca = c.distance(a);
    let ab = a.distance(b);
    let perimeter = bc + ca + ab;
    if !(perimeter > 0.0) {
        return *corners;
    }
    let incenter = (bc * a + ca * b + ab * c) / perimeter;
    [a, b, c].map(|v| (incenter + factor * (v - incenter)).as_vec3())
}

/// Area of a triangle.
fn area(v: &[Vec3; 3]) -> f64 {
    0.5 * (v[1] - v[0]).as_dvec3().cross((v[2] - v[0]).as_dvec3()).length()
}

// ---- Spherical harmonics of degree 0 become linear face colours ---------------------------------

/// Values clamped by the conversion.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ColorDetails {
    /// Colour channels, three per triangle, that were clamped to [0, 1].
    pub clamped_channels: u64,
}

trisplat_scene::stage!(ColorDetails, "color");

/// A non-indexed mesh with one linear colour per face. Opacity and σ are dropped, and vertices move
/// without a copy. `details` counts the channels clamped to [0, 1].
pub fn color(mut soup: Soup, details: &mut ColorDetails) -> Result<Mesh> {
    soup.truncate_sh(0);
    let Soup { vertices, mut sh, opacity, sigma, shell, .. } = soup;
    drop((opacity, sigma));
    let parts = sh.chunks_mut(1 << 14);
    let clamped = parallel::map(parts, |_, part| part.iter_mut().map(linearise).sum::<u64>());
    details.clamped_channels = clamped.into_iter().sum();
    Ok(Mesh {
        positions: vertices.into_flattened(),
        colors: Colors::Face(sh),
        shell,
        ..Mesh::default()
    })
}

/// [`color`] with the harmonics of the soup up to `sh_degree` beside the plain colours.
pub(super) fn color_with_sh(
    mut soup: Soup,
    sh_degree: u8,
    details: &mut ColorDetails,
) -> Result<Mesh> {
    soup.truncate_sh(sh_degree);
    if soup.sh_degree == 0 {
        return color(soup, details);
    }
    let sh = FaceSh::of_soup(&soup)?;
    let mut mesh = color(soup, details)?;
    if let Colors::Face(colors) = &mut mesh.colors {
        colors.as_flattened_mut().iter_mut().for_each(|channel| *channel = channel.min(1.0));
    }
    Ok(Mesh { sh: Some(sh), ..mesh })
}

/// Turns SH degree 0 coefficients into linear channels; returns how many had to be clamped.
fn linearise(coefficients: &mut [f32; 3]) -> u64 {
    let mut clamped = 0;
    for channel in coefficients {
        let encoded = rgb_from_sh0(*channel);
        clamped += u64::from(!(0.0..=1.0).contains(&encoded));
        *channel = linear_from_srgb(encoded.max(0.0));
    }
    clamped
}
