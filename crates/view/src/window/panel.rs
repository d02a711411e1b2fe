//! The panel over the picture: figures, settings, photos, keys.

use super::controls::Pane;
use super::crop::CropClick;
use super::session::{PhotoPlacement, Session, Settings};
use egui::{Color32, Pos2, Rect, Stroke, Ui};
use glam::{Vec2, Vec3};
use indicatif::HumanCount;
use trisplat_scene::camera::Camera;

/// Width of the panel, points.
const WIDTH: f32 = 320.0;
const EVERYTHING: Rect = Rect { min: Pos2::ZERO, max: Pos2::new(1.0, 1.0) };
const ORANGE: Color32 = Color32::from_rgb(255, 160, 40);
/// Opacity of a photo over the picture.
const PHOTO_OPACITY: f32 = 0.5;

/// Keys, as docs/viewer.md explains them.
const KEYS: &str = "drag left, right, middle: orbit, turn, pan
wheel: zoom
W A S D, Q E, Shift: fly, down, up, faster
F: the subject in view
N, P: next, previous photo; O: show it
3 4: wireframe, soft
X, Enter: crop, save the crop
F12: screenshot; H: hide this panel; Esc: quit";

/// Draws everything and takes input; sets the session's pane, in pixels.
pub(super) fn draw(ui: &mut Ui, session: &mut Session) {
    let scale = ui.ctx().pixels_per_point();
    if !session.settings.no_panel {
        egui::Panel::left("panel")
            .exact_size(WIDTH)
            .resizable(false)
            .show(ui, |ui| side(ui, session));
    }
    let free = ui.available_rect_before_wrap();
    let pane = Pane {
        min: Vec2::new(free.min.x, free.min.y) * scale,
        size: (Vec2::new(free.width(), free.height()) * scale).max(Vec2::ONE),
    };
    session.pane = session.picture_pane(pane);
    let painter = ui.painter().clone();
    photo(&painter, session, pane, scale);
    region(&painter, session, scale);
    if let Some(left) = session.expire_note() {
        ui.ctx().request_repaint_after(left);
    }
    if let Some((note, _)) = &session.note {
        let at = Pos2::new(free.center().x, free.max.y - 24.0);
        let text =
            painter.layout_no_wrap(note.clone(), egui::FontId::proportional(16.0), Color32::WHITE);
        let area = egui::Align2::CENTER_CENTER.anchor_size(at, text.size());
        painter.rect_filled(area.expand(6.0), 4.0, Color32::from_black_alpha(200));
        painter.galley(area.min, text, Color32::WHITE);
    }
}

fn side(ui: &mut Ui, session: &mut Session) {
    egui::ScrollArea::vertical().show(ui, |ui| {
        figures(ui, session);
        ui.separator();
        settings(ui, session);
        crop(ui, session);
        photos(ui, session);
        ui.separator();
        ui.label(egui::RichText::new(KEYS).weak());
    });
}

fn figures(ui: &mut Ui, session: &Session) {
    let fps = session.meter.fps().map_or("at rest".to_owned(), |fps| format!("{fps:.0} FPS"));
    ui.strong(fps);
    if let Some(shown) = &session.shown {
        let drawn = session.drawn.triangles;
        let all = shown.model.triangles();
        ui.label(format!("{} of {} triangles drawn", HumanCount(drawn), HumanCount(all)));
    }
    if let Some(status) = &session.status {
        ui.label(status);
    }
    ui.label(egui::RichText::new(&session.gpu_name).small().weak());
}

fn settings(ui: &mut Ui, session: &mut Session) {
    let has_soft = session.shown.as_ref().is_some_and(|s| s.scene.source.is_some());
    let Settings { soft, wireframe, .. } = &mut session.settings;
    ui.checkbox(wireframe, "wireframe");
    ui.add_enabled(has_soft, egui::Checkbox::new(soft, "soft, as trained (slow)"));
}

fn crop(ui: &mut Ui, session: &mut Session) {
    let Some(shown) = &mut session.shown else { return };
    ui.separator();
    match shown.crop.show(ui) {
        Some(CropClick::Here) => session.move_crop_here(),
        Some(CropClick::Save) => session.saving_crop = true,
        None => {}
    }
}

fn photos(ui: &mut Ui, session: &mut Session) {
    let Some(shown) = &session.shown else { return };
    if shown.scene.photos.is_empty() {
        return;
    }
    ui.separator();
    let name = session
        .current
        .and_then(|i| shown.scene.photos.get(i))
        .map_or("free view", |p| p.name.as_str());
    let place = session.current.map_or("–".to_owned(), |i| (i + 1).to_string());
    ui.label(format!("{name} ({place} of {})", shown.scene.photos.len()));
    let mut step = 0;
    ui.horizontal_wrapped(|ui| {
        step -= isize::from(ui.button("previous").clicked());
        step += isize::from(ui.button("next").clicked());
    });
    ui.horizontal_wrapped(|ui| {
        ui.label("photo");
        let photo = &mut session.settings.photo;
        ui.radio_value(photo, PhotoPlacement::Off, "off");
        ui.radio_value(photo, PhotoPlacement::Beside, "beside");
        ui.radio_value(photo, PhotoPlacement::Over, "over");
    });
    if step != 0 {
        session.step(step);
    }
}

/// The soft picture and the photo, in their places.
fn photo(painter: &egui::Painter, session: &Session, pane: Pane, scale: f32) {
    if session.settings.soft
        && let Some((_, soft, _)) = &session.soft
    {
        painter.image(soft.id(), rect(session.pane, scale), EVERYTHING, Color32::WHITE);
    }
    let Some((index, photo)) = &session.photo else { return };
    if session.current != Some(*index) {
        return;
    }
    match session.settings.photo {
        PhotoPlacement::Off => {}
        PhotoPlacement::Over => {
            let tint = Color32::WHITE.gamma_multiply(PHOTO_OPACITY);
            painter.image(
                photo.id(),
                rect(session.controls.picture(session.pane), scale),
                EVERYTHING,
                tint,
            );
        }
        PhotoPlacement::Beside => {
            let half = Vec2::new(0.5 * pane.size.x, 0.0);
            let right = Pane { min: pane.min + half, size: pane.size - half };
            painter.rect_filled(rect(right, scale), 0.0, Color32::BLACK);
            painter.image(
                photo.id(),
                rect(session.controls.picture(right), scale),
                EVERYTHING,
                Color32::WHITE,
            );
        }
    }
}

/// The edges of the cropped region.
fn region(painter: &egui::Painter, session: &Session, scale: f32) {
    let (Some(shown), Some(camera)) = (&session.shown, &session.camera) else { return };
    if !shown.crop.on {
        return;
    }
    let painter = painter.with_clip_rect(rect(session.pane, scale));
    for ends in shown.crop.lines() {
        let ends = ends.map(|p| shown.scene.placement.to_file(p.as_vec3()));
        line(&painter, camera, session.controls.near(), ends, Stroke::new(1.5, ORANGE), scale);
    }
}

/// A line of the world, clipped at the near plane.
fn line(
    painter: &egui::Painter,
    camera: &Camera,
    near: f32,
    ends: [Vec3; 2],
    stroke: Stroke,
    scale: f32,
) {
    let [a, b] = ends.map(|p| camera.rotation * p + camera.translation);
    if a.z.max(b.z) <= near {
        return;
    }
    let cut = |p: Vec3, other: Vec3| {
        if p.z >= near { p } else { p + (other - p) * ((near - p.z) / (other.z - p.z)) }
    };
    let place = |p: Vec3| {
        let at = (p.truncate() / p.z * camera.focal + camera.center) / scale;
        Pos2::new(at.x, at.y)
    };
    painter.line_segment([place(cut(a, b)), place(cut(b, a))], stroke);
}

fn rect(pane: Pane, scale: f32) -> Rect {
    let min = pane.min / scale;
    let size = pane.size / scale;
    Rect::from_min_size(Pos2::new(min.x, min.y), egui::vec2(size.x, size.y))
}
