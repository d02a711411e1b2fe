//! Measures a camera's view of the subject, on a small picture.

use super::Subject;
use crate::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use glam::{UVec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::{Colors, Mesh};

/// Largest scene that is not thinned.
const MOST_FACES: usize = 8000;
/// Largest factor by which a triangle of a thinned scene grows to replace the others.
const MOST_GROWTH: f32 = 6.0;
/// The longer side of the pictures, px.
const SIDE: u32 = 96;
/// Surfaces nearer than this share of the subject's distance are obstacles.
const IN_THE_WAY: f32 = 0.3;
/// Near plane, in radii of the subject.
const NEAR: f32 = 0.01;

/// Draws small pictures of a scene.
#[derive(Debug)]
pub(super) struct Survey {
    mesh: Mesh,
    subject: Subject,
    /// Flags of the subject's faces. `[F]`
    of_subject: Vec<bool>,
    solid: SolidRasterizer,
}

/// A camera's view, in shares from 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sight {
    /// Visible share of the subject's triangles.
    pub(super) seen: f32,
    /// Share of the subject's triangles within the picture, hidden or not.
    pub(super) framed: f32,
    /// Share of the picture that shows the subject.
    pub(super) filled: f32,
    /// Share of the picture with obstacles in front of the camera.
    pub(super) blocked: f32,
}

impl Survey {
    /// Of the triangles `corners`, without the far shell.
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
        Self {
            mesh: Mesh { positions, colors, ..Mesh::default() },
            subject,
            of_subject,
            solid: SolidRasterizer::new(),
        }
    }

    /// The view of `camera`, for any size of its picture.
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
