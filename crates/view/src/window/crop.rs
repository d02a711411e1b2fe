//! The region of `trisplat bake --crop`, set in the panel and drawn over the picture.

use egui::{DragValue, Ui};
use glam::{DVec3, Vec3};
use trisplat_scene::Region;

/// A box being edited, in the coordinates of the shown file and of `bake --crop`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CropEditor {
    pub(super) on: bool,
    low: DVec3,
    high: DVec3,
}

/// The clicked element of the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CropClick {
    /// Move it to the pivot of the view.
    Here,
    /// Save it.
    Save,
}

impl CropEditor {
    /// Switched off; a box around `bounds`, which are in the frame of the window. `to_file` leads
    /// to that of the file.
    pub(super) fn around(bounds: &[Vec3; 2], to_file: impl Fn(Vec3) -> DVec3) -> Self {
        let corner = |i: usize| {
            let pick = |axis: usize| bounds[i >> axis & 1][axis];
            to_file(Vec3::new(pick(0), pick(1), pick(2)))
        };
        let low = (0..8).map(corner).fold(DVec3::INFINITY, DVec3::min);
        let high = (0..8).map(corner).fold(DVec3::NEG_INFINITY, DVec3::max);
        let mut editor = Self { on: false, low, high };
        editor.round();
        editor
    }

    /// The region, when it is switched on.
    pub(super) fn region(&self) -> Option<Region> {
        self.on.then(|| Region::Box(self.low.to_array(), self.high.to_array()))
    }

    /// Moves it to a point of the file, without changing its size.
    pub(super) fn move_to(&mut self, center: DVec3) {
        let half = (self.high - self.low) / 2.0;
        self.low = center - half;
        self.high = center + half;
        self.round();
    }

    /// Numbers of a few digits, because people read and type them.
    fn round(&mut self) {
        let step = 10f64.powf((self.size() * 1e-3).log10().floor());
        let nearest =
            |x: f64| if step > 0.0 && step.is_finite() { (x / step).round() * step } else { x };
        // Rounds to the shortest decimal text.
        let short = |x: f64| format!("{:.9}", nearest(x)).parse().unwrap_or(x);
        for vector in [&mut self.low, &mut self.high] {
            *vector = DVec3::from(vector.to_array().map(short));
        }
    }

    fn size(&self) -> f64 {
        (self.high - self.low).max_element()
    }

    /// Its edges, in the coordinates of the file.
    pub(super) fn lines(&self) -> Vec<[DVec3; 2]> {
        let corner = |i: usize| {
            let pick =
                |axis: usize| if i >> axis & 1 == 0 { self.low[axis] } else { self.high[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let from = |i: usize| {
            (0..3).filter(move |axis| i >> axis & 1 == 0).map(move |axis| [i, i | 1 << axis])
        };
        (0..8).flat_map(from).map(|ends| ends.map(corner)).collect()
    }

    /// Its settings in the panel; returns the clicked element.
    pub(super) fn show(&mut self, ui: &mut Ui) -> Option<CropClick> {
        ui.checkbox(&mut self.on, "crop to a region");
        if !self.on {
            return None;
        }
        let size = self.size();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            ui.horizontal_wrapped(|ui| {
                ui.label(*name);
                let low = self.low[axis];
                let high = self.high[axis];
                ui.add(number(&mut self.low[axis], size).range(f64::MIN..=high));
                ui.label("to");
                ui.add(number(&mut self.high[axis], size).range(low..=f64::MAX));
            });
        }
        let clicks = [("move here", CropClick::Here), ("save", CropClick::Save)];
        ui.horizontal_wrapped(|ui| {
            clicks
                .into_iter()
                .filter_map(|(name, click)| ui.button(name).clicked().then_some(click))
                .last()
        })
        .inner
    }
}

/// A number that is dragged in steps suitable for this region.
fn number(value: &mut f64, size: f64) -> DragValue<'_> {
    let digits = (3.0 - size.log10().floor()).clamp(0.0, 9.0) as usize;
    DragValue::new(value).speed(2e-3 * size).max_decimals(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: [Vec3; 2] = [Vec3::new(-1.0, 0.0, 2.0), Vec3::new(3.0, 1.0, 4.0)];

    #[test]
    fn a_box_has_twelve_edges() {
        let editor = CropEditor { on: true, ..CropEditor::around(&BOUNDS, |p| p.as_dvec3()) };
        assert_eq!(editor.region(), Some(Region::Box([-1.0, 0.0, 2.0], [3.0, 1.0, 4.0])));
        let lines = editor.lines();
        assert_eq!(lines.len(), 12);
        let lengths: f64 = lines.iter().map(|[a, b]| a.distance(*b)).sum();
        assert_eq!(lengths, 4.0 * (4.0 + 1.0 + 2.0));
    }

    #[test]
    fn it_moves_as_large_as_it_is_and_its_numbers_are_short() {
        let mut editor =
            CropEditor { on: true, ..CropEditor::around(&BOUNDS, |p| p.as_dvec3() / 3.0) };
        editor.move_to(DVec3::new(0.123_456_78, -2.0, 1.0 / 3.0));
        let Some(Region::Box(low, high)) = editor.region() else { panic!("it is a box") };
        assert!(((high[0] - low[0]) - 4.0 / 3.0).abs() < 0.01);
        let text = editor.region().map(|region| region.to_string()).unwrap_or_default();
        assert!(text.split(',').all(|number| number.len() <= 8), "{text}");
        editor.on = false;
        assert_eq!(editor.region(), None);
    }
}
