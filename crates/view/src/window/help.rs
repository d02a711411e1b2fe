//! The controls by mouse and keys, in the panel.

use egui::{RichText, Ui};

const KEYS: [(&str, &str); 19] = [
    ("left drag", "orbit"),
    ("right drag", "turn"),
    ("middle drag", "pan"),
    ("wheel", "zoom"),
    ("W A S D", "fly"),
    ("Q E", "down, up"),
    ("Shift", "faster"),
    ("click", "pick a triangle"),
    ("F", "the subject in view"),
    ("N, P", "next, previous photo"),
    ("O", "photo beside, over, off"),
    ("C", "cameras"),
    ("1 2 3", "colour, normals, chunks"),
    ("4 5 6", "wireframe, subset, soft"),
    ("X, Enter", "crop, save the crop"),
    ("F12", "screenshot"),
    ("H", "hide this panel"),
    ("Esc", "quit"),
    ("drop", "another scene, or its photos"),
];

/// The list, a line for each.
pub(super) fn show(ui: &mut Ui) {
    let list = |ui: &mut Ui| {
        for (keys, what) in KEYS {
            ui.label(RichText::new(keys).strong());
            ui.label(what);
            ui.end_row();
        }
    };
    egui::CollapsingHeader::new("mouse and keys").default_open(true).show(ui, |ui| {
        egui::Grid::new("keys").num_columns(2).spacing([10.0, 3.0]).striped(true).show(ui, list);
    });
}
