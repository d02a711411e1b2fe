//! View-dependent colours from the photos: spherical harmonics for each triangle, beside the
//! colours that `refit` found, which stay as they are.
//!
//! Shine, and light that a surface shows from one side only, are missing in one colour per
//! triangle. Harmonics of the direction are linear in their coefficients, so the best ones solve a
//! small system per triangle, of the residuals that the photos have to the scene in its own
//! colours:
//!
//! ```text
//! minimise Σ_pixels (photo - drawn - Σ_j c_j Y_j(direction))² + λ Σ_(j > 0) (c_j - m_j)²
//! ```
//!
//! Y are orthonormal on the sphere, so λ is as strong as that many pixels, seen from all directions
//! alike. The m are those of a group of triangles, which fit all of them and are pulled to 0 by the
//! same λ. So where no photo stood, the harmonics fade. The degree and λ are those that lower the
//! error of held-out photos most.

mod equations;

use crate::refit::{ColorFit, Gatherer, PhotoObserver};
use crate::views::Views;
use equations::{Regularization, ShEquations};
use trisplat_raster::solid::direction_basis;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Error, FaceSh, Result, sh_count};

/// The degree of the spherical harmonics.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum ShDegree {
    /// 1 or 2, if held-out photos gain 0.15 dB
    #[serde(rename = "auto")]
    Auto,
    /// Colours do not depend on the direction
    #[serde(rename = "0")]
    #[cfg_attr(feature = "cli", value(name = "0"))]
    Zero,
    /// 4 texels per triangle
    #[serde(rename = "1")]
    #[cfg_attr(feature = "cli", value(name = "1"))]
    One,
    /// 9 texels per triangle
    #[serde(rename = "2")]
    #[cfg_attr(feature = "cli", value(name = "2"))]
    Two,
    /// 16 texels per triangle
    #[serde(rename = "3")]
    #[cfg_attr(feature = "cli", value(name = "3"))]
    Three,
}

impl ShDegree {
    /// Degrees to choose from.
    fn degrees(self) -> &'static [u8] {
        match self {
            Self::Auto => &[1, 2],
            Self::Zero => &[],
            Self::One => &[1],
            Self::Two => &[2],
            Self::Three => &[3],
        }
    }

    /// The degree that was asked for; 0 for plain colours and where photos decide.
    pub fn asked(self) -> u8 {
        if self == Self::Auto { 0 } else { self.max_degree() }
    }

    /// The highest of them; 0 for plain colours.
    pub fn max_degree(self) -> u8 {
        self.degrees().last().copied().unwrap_or(0)
    }
}

/// View-dependent colours.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct ShOptions {
    /// Colours that depend on the direction: the degree of spherical harmonics beside the plain
    /// colours, for .glb, .gltf and .html
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = ShOptions::DEFAULT.sh, value_name = "DEGREE"))]
    pub sh: ShDegree,
}

impl ShOptions {
    /// Plain colours.
    pub const DEFAULT: Self = Self { sh: ShDegree::Zero };
    /// The degree that held-out photos ask for.
    pub const AUTO: Self = Self { sh: ShDegree::Auto };
}

trisplat_scene::default!(ShOptions);

/// The harmonics, and what held-out photos gained by them.
#[derive(
    Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
pub struct ShDetails {
    /// Degree of the harmonics; absent when colours stay plain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub degree: Option<u8>,
    /// λ: pull of view dependence to 0, equivalent to this many pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ridge: Option<f64>,
    /// PSNR of plain colours that were fitted to the other photos on held-out photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_plain: Option<f64>,
    /// The same with harmonics that were fitted to the other photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_sh: Option<f64>,
}

trisplat_scene::stage!(ShDetails, "sh");

impl ShDetails {
    /// Gain on held-out photos by the harmonics that were written, dB.
    pub fn gain(&self) -> Option<f64> {
        self.degree.and(Some(self.psnr_sh? - self.psnr_plain?))
    }
}

/// Candidates for λ, px: with many photos per triangle little pull is best, with few much.
const RIDGES: [f64; 6] = [0.25, 1.0, 4.0, 16.0, 64.0, 256.0];
/// A pull that leaves only the constant.
const CONSTANT: Regularization = Regularization { degree: 1, ridge: 1e12 };
/// λ where no photo can be held out.
const CAREFUL_RIDGE: f64 = 16.0;
/// Larger residuals, sRGB-encoded, count as this: highlights reach it, passers-by do not lead
/// beyond.
const MAX_RESIDUAL: f32 = 0.3;
/// Minimum gain of held-out photos, dB, for `auto`: less is not worth the larger file.
const MIN_GAIN: f64 = 0.15;
/// Maximum memory of the equations, bytes; a lower degree takes less.
const MAX_EQUATION_BYTES: u64 = 2 << 30;
/// Progress when all photos are summed up.
const SUMMED_PART: f64 = 0.8;

/// Fits harmonics for the faces of `mesh` before `behind` to `views`; those behind are
/// surroundings. None where other options ask for what excludes them: `instead`.
///
/// # Errors
///
/// A photo that cannot be decoded; a degree that was asked for and is not possible.
pub fn sh(
    mesh: &mut Mesh,
    behind: usize,
    views: Option<&mut Views>,
    instead: Option<&'static str>,
    options: &ShOptions,
    details: &mut ShDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    let degrees = options.sh.degrees();
    if degrees.is_empty() {
        return Ok(Outcome::Skipped("`sh` 0"));
    }
    let refused = |why| match options.sh {
        ShDegree::Auto => Ok(Outcome::Skipped(why)),
        _ => {
            let wants = "0, or photos (`dataset`), no `texture` and no `lit`";
            Err(Error::invalid("sh", format!("{} with {why}", degrees[0]), wants))
        }
    };
    if let Some(instead) = instead {
        mesh.sh = None;
        return refused(instead);
    }
    let Some(views) = views.filter(|views| !views.is_empty()) else {
        let Some(own) = &mesh.sh else {
            return refused("neither photos nor harmonics of the scene");
        };
        let degree = own.degree();
        if behind > FaceSh::max_faces(degree) {
            mesh.sh = None;
            return refused("too many triangles");
        }
        details.degree = Some(degree);
        return Ok(Outcome::Skipped("the scene has its own harmonics"));
    };
    if !mesh.indices.is_empty() {
        return refused("a mesh whose faces share vertices");
    }
    let fits = |degree: &u8| {
        behind <= FaceSh::max_faces(*degree)
            && 2 * equations::bytes(*degree, behind) <= MAX_EQUATION_BYTES
    };
    let degrees: Vec<u8> = degrees.iter().copied().filter(fits).collect();
    let Some(&max_degree) = degrees.last() else {
        return refused("too many triangles");
    };
    mesh.sh = None;
    let (held_out, others) = views.held_out();
    let mut sums = ShSums::new(mesh, views);
    let split = SUMMED_PART * others.len() as f64 / views.len() as f64;
    let mut fitted = ShEquations::new(max_degree, behind);
    sums.add(mesh, views, &others, &mut fitted, progress.part(0.0, split))?;
    let mut unseen = ShEquations::new(max_degree, behind);
    sums.add(mesh, views, &held_out, &mut unseen, progress.part(split, SUMMED_PART))?;
    let mut how = Regularization { degree: max_degree, ridge: CAREFUL_RIDGE };
    if !held_out.is_empty() {
        how = best(&fitted, &unseen, &degrees);
        // The colours have seen the held-out photos: without them only the constant counts.
        mesh.sh = Some(harmonics(&fitted, CONSTANT, mesh)?);
        let plain = views.mean_psnr(mesh, &held_out)?;
        mesh.sh = Some(harmonics(&fitted, how, mesh)?);
        let with = views.mean_psnr(mesh, &held_out)?;
        details.psnr_plain = Some(plain);
        details.psnr_sh = Some(with);
        let is_worth = with - plain >= MIN_GAIN;
        if options.sh == ShDegree::Auto && !is_worth {
            mesh.sh = None;
            return Ok(Outcome::Skipped("held-out photos gain too little"));
        }
    }
    fitted.merge(&unseen);
    mesh.sh = Some(harmonics(&fitted, how, mesh)?);
    details.degree = Some(how.degree);
    details.ridge = Some(how.ridge);
    Ok(Outcome::Changed(()))
}

/// The degree and λ that lower the error of the photos of `unseen` most.
fn best(fitted: &ShEquations, unseen: &ShEquations, degrees: &[u8]) -> Regularization {
    let of_degree = |degree: &u8| RIDGES.map(|ridge| Regularization { degree: *degree, ridge });
    let candidates = degrees.iter().flat_map(of_degree);
    let gains = candidates.map(|how| (how, unseen.gain(how.degree, &fitted.solve(how))));
    let best = gains.reduce(|best, other| if other.1 > best.1 { other } else { best });
    best.map_or(Regularization { degree: 1, ridge: CAREFUL_RIDGE }, |(how, _)| how)
}

/// The coefficients of all faces of `mesh`; those without equations have no view dependence.
fn harmonics(sums: &ShEquations, how: Regularization, mesh: &Mesh) -> Result<FaceSh> {
    let mut coefficients = sums.solve(how);
    let width = sh_count(how.degree);
    coefficients.resize(mesh.face_count() * width, [0.0; 3]);
    FaceSh::new(how.degree, coefficients)
}

/// Sums up the residuals of photos to the scene in its own colours.
struct ShSums {
    observer: PhotoObserver,
    gatherer: Gatherer,
    colors: ColorFit,
}

impl ShSums {
    fn new(mesh: &Mesh, views: &Views) -> Self {
        Self {
            observer: PhotoObserver::new(mesh, views, MAX_RESIDUAL),
            gatherer: Gatherer::new(mesh.face_count()),
            colors: ColorFit::new(mesh, 0.0),
        }
    }

    /// Adds the photos `chosen` to the equations `out` of the first faces.
    fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        out: &mut ShEquations,
        progress: StageProgress<'_>,
    ) -> Result<()> {
        let Self { observer, gatherer, colors } = self;
        let faces = out.face_count();
        let degree = out.degree();
        observer.for_each_photo(mesh, views, chosen, progress, |_, observation| {
            let eye = observation.camera.position();
            gatherer.for_each_face(observation, colors, |face, sums| {
                let face = face as usize;
                if face < faces {
                    let corners = mesh.corners(face);
                    let harmonics = corners.map(|corner| direction_basis(degree, corner, eye));
                    out.add(face, &harmonics, sums);
                }
            });
        })
    }
}
