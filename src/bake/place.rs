//! Moves the scene into the frame of a game engine: right-handed, Y up, its median at the origin if
//! asked for.
//!
//! Runs after `color`, so that it runs once over plain positions, and before `bvh`, whose boxes must
//! be those of the file.

use crate::asset::{Placement, Provenance, UpAxis};
use crate::error::{Error, Result};
use crate::math::median::median;
use crate::mesh::Mesh;
use crate::report::{Outcome, StageDetails};
use glam::Vec3;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The frame of the output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct PlaceOptions {
    /// Axis of the input that points up; the output is Y-up. Without it: what the file says, else
    /// -y (COLMAP and its trainers), y for glTF and OBJ.
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "AXIS", allow_hyphen_values = true))]
    pub up: Option<UpAxis>,
    /// Output units per input unit.
    #[cfg_attr(feature = "cli", arg(long, default_value_t = PlaceOptions::DEFAULT.scale, value_name = "FACTOR"))]
    pub scale: f64,
    /// Put the middle of the scene (the median of its vertices) at the origin.
    #[cfg_attr(feature = "cli", arg(long, default_value_t = PlaceOptions::DEFAULT.center, num_args = 0..=1, require_equals = true,
          default_missing_value = "true", action = clap::ArgAction::Set, value_name = "BOOL"))]
    pub center: bool,
}

impl PlaceOptions {
    /// Only turns the up axis.
    pub const DEFAULT: Self = Self { up: None, scale: 1.0, center: false };

    /// Checks ranges.
    pub fn validate(&self) -> Result<()> {
        if !(self.scale > 0.0 && self.scale.is_finite()) {
            return Err(Error::invalid("scale", self.scale, "a positive number"));
        }
        Ok(())
    }
}

impl Default for PlaceOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What became of the placement that the input had.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EarlierPlacement {
    /// It was forgotten: the output says how to get back to the input, not to the input's source.
    Replaced,
}

/// How the scene was moved.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlaceDetails {
    /// The axis of the input that points up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpAxis>,
    /// Present when the input was placed by an earlier bake.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub earlier_placement: Option<EarlierPlacement>,
    /// Output units per input unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// The point of the input that became the origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 3]>,
}

impl StageDetails for PlaceDetails {
    const STAGE: &'static str = "place";
}

/// The placement that `options` ask for.
pub fn placement(mesh: &Mesh, provenance: &Provenance, options: &PlaceOptions) -> Placement {
    let up = options.up.or(provenance.up).unwrap_or_default();
    let center = if options.center { middle(&mesh.positions).as_dvec3().to_array() } else { [0.0; 3] };
    Placement { up, scale: options.scale, center }
}

/// Moves `mesh` by `placement` and writes into `provenance` how, so that it can be undone.
///
/// Errors: a scale that takes a position out of the range of an f32.
pub fn place(
    mesh: &mut Mesh,
    provenance: &mut Provenance,
    placement: Placement,
    details: &mut PlaceDetails,
) -> Result<Outcome<()>> {
    provenance.up = Some(UpAxis::Y);
    details.up = Some(placement.up);
    if placement == Placement::IDENTITY {
        return Ok(Outcome::Unneeded("the input is Y-up already and no scale or center was asked for"));
    }
    if provenance.placement != Placement::IDENTITY {
        // Two placements do not compose into one of the six axes; what is kept is the way back to
        // the file we were given.
        details.earlier_placement = Some(EarlierPlacement::Replaced);
    }
    provenance.placement = placement;
    provenance.viewpoint = provenance.viewpoint.map(|viewpoint| placement.viewpoint_to_file(&viewpoint));
    (details.scale, details.center) = (Some(placement.scale), Some(placement.center));
    let transform = placement.transform();
    mesh.positions.par_iter_mut().with_min_len(1 << 14).for_each(|p| *p = transform(*p));
    match mesh.positions.par_iter().position_any(|p| !p.is_finite()) {
        Some(_) => Err(Error::invalid("scale", placement.scale, "a factor that keeps every position finite")),
        None => Ok(Outcome::Changed(())),
    }
}

/// Median along each axis: unlike the middle of the bounds it does not follow a far background.
fn middle(positions: &[Vec3]) -> Vec3 {
    let along = |axis: usize| median(positions.iter().map(|p| p[axis]).collect(), f32::total_cmp);
    Vec3::from_array([0, 1, 2].map(|axis| along(axis).unwrap_or(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Viewpoint;
    use crate::mesh::Colors;

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 7.0), Vec3::new(-1.0, 0.5, 2.0)],
            colors: Colors::Face(vec![[0.5; 3]]),
            ..Mesh::default()
        }
    }

    #[test]
    fn every_axis_goes_up_and_comes_back() {
        for (up, axis) in [
            (UpAxis::X, Vec3::X),
            (UpAxis::NegX, -Vec3::X),
            (UpAxis::Y, Vec3::Y),
            (UpAxis::NegY, -Vec3::Y),
            (UpAxis::Z, Vec3::Z),
            (UpAxis::NegZ, -Vec3::Z),
        ] {
            let placement = Placement { up, scale: 2.0, center: [1.0, -2.0, 3.0] };
            let origin = placement.to_file(Vec3::new(1.0, -2.0, 3.0));
            let tip = placement.to_file(Vec3::new(1.0, -2.0, 3.0) + axis);
            assert!((tip - origin - 2.0 * Vec3::Y).length() < 1e-6, "{up:?}");
            assert!((up.to_y_up().determinant() - 1.0).abs() < 1e-12, "{up:?} mirrors");
            let there = Vec3::new(0.3, 0.7, -0.9);
            assert!((placement.to_world(placement.to_file(there)) - there).length() < 1e-5);
        }
    }

    #[test]
    fn a_second_run_has_nothing_to_do() {
        let viewpoint = Viewpoint { eye: [1.0, 2.0, 3.0], target: [0.0; 3], up: [0.0, -1.0, 0.0], fov: 40.0 };
        let (mut mesh, mut provenance) =
            (triangle(), Provenance { viewpoint: Some(viewpoint), ..Provenance::default() });
        let run = |mesh: &mut Mesh, provenance: &mut Provenance| {
            let placement = placement(mesh, provenance, &PlaceOptions::DEFAULT);
            place(mesh, provenance, placement, &mut PlaceDetails::default()).unwrap()
        };
        let first = run(&mut mesh, &mut provenance);
        assert_eq!(first, Outcome::Changed(()));
        assert_eq!(mesh.positions[0], Vec3::new(1.0, -2.0, -3.0));
        let placed = Viewpoint { eye: [1.0, -2.0, -3.0], up: [0.0, 1.0, 0.0], ..viewpoint };
        assert_eq!(provenance.viewpoint, Some(placed));
        let again = run(&mut mesh, &mut provenance);
        assert!(matches!(again, Outcome::Unneeded(_)));
        assert_eq!(provenance.placement.up, UpAxis::NegY);
    }
}
