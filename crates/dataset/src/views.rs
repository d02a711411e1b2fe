//! The photo of a wide lens as pinhole views that cover its field: one up to 110°, two or more
//! above, the faces of a cube for 360°.

use super::lens::{Lens, LensProjection, Undistort};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// The widest view, from its axis, rad: 110° in all.
const WIDEST: f64 = 55.0 * PI / 180.0;
/// Cells per side of the search for the part of a view that the lens shows.
const CELLS: usize = 96;
/// The narrowest view worth a picture, in units of the distance.
const NARROWEST: f64 = 0.12;

/// A view before it is cut to what the lens shows.
struct ViewPart {
    name: &'static str,
    /// From the axes of the view to those of the lens.
    to_lens: DMat3,
    /// Edges in units of the distance: left and upper, right and lower.
    low: DVec2,
    high: DVec2,
}

/// The names and resampling of the views of a lens; `None` for a photo that is a pinhole's already.
///
/// # Errors
///
/// The reason why the lens has none.
pub(super) fn plans(lens: &Lens) -> Result<Vec<(&'static str, Option<Undistort>)>, String> {
    if lens.distortion.is_none() {
        return Ok(vec![("", None)]);
    }
    let widest = lens.distortion.widest().min(lens.distortion.limit.unwrap_or(PI));
    let field = FieldOfView { lens, widest };
    let parts = match lens.distortion.projection {
        LensProjection::Perspective => return Ok(vec![("", Some(Undistort::new(lens)?))]),
        LensProjection::Spherical if 2 * lens.size.y != lens.size.x => {
            let [w, h] = lens.size.to_array();
            return Err(format!(
                "an equirectangular (latlong) photo is twice as wide as high, this one is {w}x{h}"
            ));
        }
        LensProjection::Spherical => cube(),
        LensProjection::Fisheye => field.parts(),
    };
    let plans: Vec<_> =
        parts.iter().filter_map(|part| Some((part.name, Some(field.plan(part)?)))).collect();
    if plans.is_empty() {
        return Err("its lens shows nothing: its coefficients cannot be right".into());
    }
    Ok(plans)
}

/// The name of a view: `walk_0007@left.jpg`.
pub(super) fn name(photo: &str, part: &str) -> String {
    if part.is_empty() {
        return photo.to_owned();
    }
    match photo.rsplit_once('.') {
        Some((stem, extension)) => format!("{stem}@{part}.{extension}"),
        None => format!("{photo}@{part}"),
    }
}

/// The name of the photo of a view.
pub(super) fn photo(view: &str) -> String {
    let (stem, extension) =
        view.rsplit_once('.').map_or((view, ""), |(stem, _)| (stem, &view[stem.len()..]));
    match stem.rsplit_once('@') {
        Some((photo, part)) if NAMES.contains(&part) => format!("{photo}{extension}"),
        _ => view.to_owned(),
    }
}

/// The views that there may be.
const NAMES: [&str; 6] = ["front", "right", "back", "left", "up", "down"];

/// The faces of a cube around the lens.
fn cube() -> Vec<ViewPart> {
    let turn = |name| match name {
        "front" => DMat3::IDENTITY,
        "up" => DMat3::from_rotation_x(FRAC_PI_2),
        "down" => DMat3::from_rotation_x(-FRAC_PI_2),
        "left" => DMat3::from_rotation_y(-FRAC_PI_2),
        "right" => DMat3::from_rotation_y(FRAC_PI_2),
        _ => DMat3::from_rotation_y(PI),
    };
    let part = |name| ViewPart { name, to_lens: turn(name), low: DVec2::NEG_ONE, high: DVec2::ONE };
    NAMES.map(part).into()
}

/// Field of view of a lens.
struct FieldOfView<'a> {
    lens: &'a Lens,
    /// From the axis, rad.
    widest: f64,
}

impl FieldOfView<'_> {
    /// True for a direction that the lens shows.
    fn shows(&self, ray: DVec3) -> bool {
        let inside =
            |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.cmple(self.lens.size.as_dvec2()).all();
        match self.lens.distortion.projection {
            LensProjection::Fisheye => {
                ray.angle_between(DVec3::Z) <= self.widest
                    && self.lens.pixel(ray).is_some_and(inside)
            }
            _ => self.lens.pixel(ray).is_some(),
        }
    }

    /// The angle from the axis towards `side` to where the photo ends, rad.
    fn reach(&self, side: DVec3) -> f64 {
        let angles = (0..=720).map(|k| f64::from(k) * PI / 720.0);
        let visible_angles = angles.take_while(|a| self.shows(DVec3::Z * a.cos() + side * a.sin()));
        visible_angles.last().unwrap_or(0.0)
    }

    /// The views of a fisheye lens.
    fn parts(&self) -> Vec<ViewPart> {
        let [left, right, up, down] =
            [DVec3::NEG_X, DVec3::X, DVec3::NEG_Y, DVec3::Y].map(|side| self.reach(side));
        let edge = |angle: f64| angle.min(WIDEST).tan();
        let low = DVec2::new(-edge(left), -edge(up));
        let high = DVec2::new(edge(right), edge(down));
        let half = |name, to_lens, side: usize, angle: f64| {
            let mut low = low;
            let mut high = high;
            low[side] = -edge(angle / 2.0);
            high[side] = edge(angle / 2.0);
            ViewPart { name, to_lens, low, high }
        };
        match (left.max(right) > WIDEST, up.max(down) > WIDEST) {
            (false, false) => vec![ViewPart { name: "", to_lens: DMat3::IDENTITY, low, high }],
            (true, false) => vec![
                half("left", DMat3::from_rotation_y(-left / 2.0), 0, left),
                half("right", DMat3::from_rotation_y(right / 2.0), 0, right),
            ],
            (false, true) => vec![
                half("up", DMat3::from_rotation_x(up / 2.0), 1, up),
                half("down", DMat3::from_rotation_x(-down / 2.0), 1, down),
            ],
            (true, true) => cube(),
        }
    }

    /// The resampling for the largest rectangle of `part` that the lens shows, if that is worth a
    /// picture.
    fn plan(&self, part: &ViewPart) -> Option<Undistort> {
        let step = (part.high - part.low) / CELLS as f64;
        let at = |x: usize, y: usize| part.low + step * DVec2::new(x as f64, y as f64);
        let side = CELLS + 1;
        let corners: Vec<bool> = (0..side * side)
            .map(|i| self.shows(part.to_lens * at(i % side, i / side).extend(1.0)))
            .collect();
        let whole = |x: usize, y: usize| {
            let first = y * side + x;
            [first, first + 1, first + side, first + side + 1].iter().all(|&i| corners[i])
        };
        let [left, top, right, bottom] = largest_rectangle(CELLS, whole)?;
        let low = at(left, top);
        let high = at(right, bottom);
        let focal = self.lens.focal.element_product().sqrt();
        let size = ((high - low) * focal).round();
        if (high - low).min_element() < NARROWEST || size.min_element() < 1.0 {
            return None;
        }
        // Whole pixels, and yet all of the rectangle.
        let focal = size / (high - low);
        let size = size.as_uvec2();
        let center = -low * focal;
        let pinhole = Lens { size, focal, center, distortion: Default::default() };
        Some(Undistort { lens: *self.lens, pinhole, turn: part.to_lens.transpose() })
    }
}

/// The largest upright rectangle of cells, `side` by `side`, that are all `whole`: left, top,
/// right, bottom.
fn largest_rectangle(side: usize, whole: impl Fn(usize, usize) -> bool) -> Option<[usize; 4]> {
    let mut best = None;
    let mut area = 0;
    let mut height = vec![0; side];
    for y in 0..side {
        for (x, height) in height.iter_mut().enumerate() {
            *height = if whole(x, y) { *height + 1 } else { 0 };
        }
        for left in 0..side {
            let mut lowest = height[left];
            for (right, &tall) in height.iter().enumerate().skip(left) {
                lowest = lowest.min(tall);
                if lowest * (right + 1 - left) > area {
                    area = lowest * (right + 1 - left);
                    best = Some([left, y + 1 - lowest, right + 1, y + 1]);
                }
            }
        }
    }
    best
}
