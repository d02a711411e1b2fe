//! What a camera sees of the subject of a scene, measured on a small picture.

use super::Subject;
use crate::camera::Camera;
use crate::mesh::{Colors, Mesh};
use crate::raster::solid::{NO_FACE, Solid, SolidRasterOptions};
use glam::{UVec2, Vec3};

/// A scene of more triangles is thinned.
const MOST_FACES: usize = 8000;
/// A triangle of a thinned scene grows at most this many times, so that it covers for those left out.
const MOST_GROWTH: f32 = 6.0;
/// The longer side of the pictures, px.
const SIDE: u32 = 96;
/// What is nearer than this share of the way to the subject stands in the way.
const IN_THE_WAY: f32 = 0.3;
/// Near plane, in radii of the subject.
const NEAR: f32 = 0.01;

/// Draws small pictures of a scene.
#[derive(Debug)]
pub(super) struct Survey {
    mesh: Mesh,
    subject: Subject,
    /// Whether each face of the mesh is of the subject. `[F]`
    of_subject: Vec<bool>,
    solid: Solid,
}

/// What a camera sees; shares of 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sight {
    /// Of the subject's triangles, those that are seen.
    pub(super) seen: f32,
    /// Of the subject's triangles, those within the picture, hidden or not.
    pub(super) framed: f32,
    /// Of the picture, what shows the subject.
    pub(super) filled: f32,
    /// Of the picture, what shows something right before the camera.
    pub(super) blocked: f32,
}

impl Survey {
    /// Of the triangles `corners`, without what is far behind them.
    pub(super) fn new(corners: &dyn Fn(usize) -> [Vec3; 3], count: usize, subject: Subject) -> Self {
        let step = count.div_ceil(MOST_FACES).max(1);
        let growth = (step as f32).sqrt().min(MOST_GROWTH);
        let (mut positions, mut of_subject) = (Vec::new(), Vec::new());
        for face in (0..count).step_by(step) {
            let corners = corners(face);
            if corners.iter().all(|p| p.is_finite()) {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                positions.extend(corners.map(|p| middle + (p - middle) * growth));
                of_subject.push(subject.holds(middle));
            }
        }
        let colors = Colors::Face(vec![[0.0; 3]; of_subject.len()]);
        Self { mesh: Mesh { positions, colors, ..Mesh::default() }, subject, of_subject, solid: Solid::new() }
    }

    /// What `camera` sees, whatever the size of its picture.
    pub(super) fn look(&mut self, camera: &Camera) -> Sight {
        let longest = camera.size.max_element() as f32;
        let size = (camera.size.as_vec2() / longest * SIDE as f32).as_uvec2().max(UVec2::ONE);
        let camera = camera.resized(size);
        let near = (NEAR * self.subject.radius).max(f32::MIN_POSITIVE);
        let options = SolidRasterOptions { near, ..SolidRasterOptions::default() };
        let drawn = self.solid.visibility(&self.mesh, &camera, &options);
        let depth = (camera.rotation * self.subject.center + camera.translation).z;
        let (mut seen, mut filled, mut blocked) = (vec![false; self.of_subject.len()], 0, 0);
        for (face, z) in drawn.face.iter().zip(&drawn.depth).filter(|(face, _)| **face != NO_FACE) {
            let face = *face as usize;
            seen[face] = true;
            filled += usize::from(self.of_subject[face]);
            blocked += usize::from(*z < IN_THE_WAY * depth && !self.of_subject[face]);
        }
        let (mut all, mut shown, mut framed) = (0usize, 0usize, 0usize);
        for face in (0..self.of_subject.len()).filter(|face| self.of_subject[*face]) {
            all += 1;
            shown += usize::from(seen[face]);
            framed += usize::from(camera.frames(self.mesh.centroid(face)));
        }
        let of = |part: usize, whole: usize| part as f32 / whole.max(1) as f32;
        let pixels = drawn.face.len();
        Sight {
            seen: of(shown, all),
            framed: of(framed, all),
            filled: of(filled, pixels),
            blocked: of(blocked, pixels),
        }
    }
}
