//! Region of a scene: a box, a sphere, the view of cameras, or the subject.

use crate::camera::Camera;
use glam::DVec3;
use std::fmt;
use std::str::FromStr;

/// A part of space.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Region {
    /// Between two corners, the lower one first.
    Box([f64; 3], [f64; 3]),
    /// Centre and radius.
    Sphere([f64; 3], f64),
    /// In the pictures of at least this many cameras, hidden or not.
    Seen(u32),
    /// The object that the cameras look at, with the ground near it.
    Subject,
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wants = "expected a box x0,y0,z0,x1,y1,z1, a sphere x,y,z,radius, seen:K, or subject";
        if text == "subject" {
            return Ok(Self::Subject);
        }
        if let Some(count) = text.strip_prefix("seen:") {
            let count = count.parse().ok().filter(|k| *k > 0);
            return count
                .map(Self::Seen)
                .ok_or_else(|| format!("has no number of cameras; {wants}"));
        }
        let number = |word: &str| word.trim().parse().ok().filter(|x: &f64| x.is_finite());
        match text.split(',').map(number).collect::<Option<Vec<f64>>>().as_deref() {
            Some(&[a, b, c, x, y, z]) if a <= x && b <= y && c <= z => {
                Ok(Self::Box([a, b, c], [x, y, z]))
            }
            Some(&[_, _, _, _, _, _]) => Err("is a box with x0 > x1, y0 > y1 or z0 > z1".into()),
            Some(&[x, y, z, radius]) if radius > 0.0 => Ok(Self::Sphere([x, y, z], radius)),
            _ => Err(wants.into()),
        }
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Box([a, b, c], [x, y, z]) => write!(f, "{a},{b},{c},{x},{y},{z}"),
            Self::Sphere([x, y, z], radius) => write!(f, "{x},{y},{z},{radius}"),
            Self::Seen(count) => write!(f, "seen:{count}"),
            Self::Subject => write!(f, "subject"),
        }
    }
}

crate::as_text!(Region);

impl Region {
    /// True when a point is in the region; `cameras` look at the scene. A subject is determined
    /// from the whole scene: every point may be in it.
    pub fn holds(&self, point: DVec3, cameras: &[Camera]) -> bool {
        match *self {
            Self::Box(low, high) => {
                point.cmpge(DVec3::from(low)).all() && point.cmple(DVec3::from(high)).all()
            }
            Self::Sphere(center, radius) => point.distance(DVec3::from(center)) <= radius,
            Self::Seen(count) => {
                let observers =
                    cameras.iter().filter(|camera| camera.project(point.as_vec3()).is_some());
                observers.take(count as usize).count() == count as usize
            }
            Self::Subject => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_read_as_they_are_written() {
        for text in ["0,-1,2,3,4.5,6", "1,2,3,0.5", "seen:4", "subject"] {
            assert_eq!(
                text.parse::<Region>().map(|region| region.to_string()),
                Ok(text.to_owned())
            );
        }
        for wrong in
            ["1,0,0,0,1,1", "1,2,3", "1,2,3,0", "seen:0", "seen:x", "a,b,c,d", "1,2,3,nan", ""]
        {
            assert!(wrong.parse::<Region>().is_err(), "{wrong}");
        }
    }
}
