//! Option values with a text form of their own: an up direction and a known length.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use trisplat_scene::{UpAxis, UpDirection};

/// The up direction of the input.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum UpChoice {
    /// From the file, or from the cameras and the largest level surface.
    #[default]
    Auto,
    /// This direction.
    Given(UpDirection),
}

impl FromStr for UpChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let axis = serde_json::from_value::<UpAxis>(serde_json::Value::from(text));
        if let Ok(axis) = axis {
            return Ok(Self::Given(axis.into()));
        }
        let wants = "expected auto, an axis (x -x y -y z -z) or a direction as in 0.02,-0.9,0.1";
        match numbers(text).as_deref() {
            Some(&[x, y, z]) if DVec3::new(x, y, z).length_squared() > 0.0 => {
                Ok(Self::Given(UpDirection::near(DVec3::new(x, y, z))))
            }
            _ => Err(wants.into()),
        }
    }
}

impl fmt::Display for UpChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Given(UpDirection::Vector([x, y, z])) => write!(f, "{x},{y},{z}"),
            Self::Given(UpDirection::Axis(axis)) => f.write_str(
                serde_json::to_value(axis).unwrap_or_default().as_str().unwrap_or_default(),
            ),
        }
    }
}

/// A length of the input that is known in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct KnownLength {
    /// Length in units of the input, above 0.
    pub units: f64,
    /// The same length in metres, above 0.
    pub metres: f64,
}

impl KnownLength {
    /// Output units, metres, per input unit.
    pub fn scale(&self) -> f64 {
        self.metres / self.units
    }
}

impl FromStr for KnownLength {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wants = "expected two points or a length of the input and its metres, as in 0,1.5,2,0.4,1.5,2=0.25 or 0.4=0.25";
        let (length, metres) = text.split_once('=').ok_or(wants)?;
        let units = match numbers(length).as_deref() {
            Some(&[units]) => units,
            Some(&[x, y, z, u, v, w]) => DVec3::new(x, y, z).distance(DVec3::new(u, v, w)),
            _ => return Err(wants.into()),
        };
        let metres = match numbers(metres).as_deref() {
            Some(&[metres]) => metres,
            _ => return Err(wants.into()),
        };
        let good = |x: f64| x > 0.0 && x.is_finite();
        if good(units) && good(metres) {
            Ok(Self { units, metres })
        } else {
            Err(format!("has a length of {units} units and {metres} m; {wants}"))
        }
    }
}

impl fmt::Display for KnownLength {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.units, self.metres)
    }
}

/// Numbers between commas, all finite.
pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|word| word.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect()
}

trisplat_scene::as_text!(UpChoice, KnownLength);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        for text in ["auto", "x", "-y", "-z"] {
            assert_eq!(text.parse::<UpChoice>().map(|up| up.to_string()), Ok(text.to_owned()));
        }
        let free: UpChoice = "0.02, -0.9,0.1".parse().expect("a direction");
        let UpChoice::Given(direction) = free else { panic!("{free:?}") };
        assert!((direction.vector() - DVec3::new(0.02, -0.9, 0.1).normalize()).length() < 1e-15);
        assert_eq!(free.to_string().parse(), Ok(free));
        assert_eq!("0,-5,0".parse::<UpChoice>(), Ok(UpChoice::Given(UpAxis::NegY.into())));
        for wrong in ["up", "0,0,0", "1,2", "1,2,nan", "", "1,2,3,4"] {
            let reason = wrong.parse::<UpChoice>().expect_err(wrong);
            assert!(reason.contains("0.02,-0.9,0.1"), "{reason}");
        }
    }

    #[test]
    fn a_known_length_is_a_length_or_two_points() {
        let length: KnownLength = "0.4=0.25".parse().expect("a length");
        assert_eq!((length.units, length.metres, length.scale()), (0.4, 0.25, 0.625));
        let points: KnownLength = "0,1,2,3,1,-2=2.5".parse().expect("two points");
        assert_eq!((points.units, points.scale()), (5.0, 0.5));
        assert_eq!(points.to_string().parse(), Ok(points));
        for wrong in ["1", "1=", "=2", "1,2=3", "0=1", "1=-2", "1,2,3,1,2,3=1", "a=b"] {
            assert!(wrong.parse::<KnownLength>().is_err(), "{wrong}");
        }
    }
}
