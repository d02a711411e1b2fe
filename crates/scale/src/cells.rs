//! A scene in cells of neighbours, so that a camera looks only at those that may be in its picture.

use glam::{Mat3, Vec2, Vec3};
use std::ops::Range;
use trisplat_scene::{Soup, camera::Camera};

/// Triangles of a cell: the box of fewer is looked at as long as they are drawn.
const CELL: usize = 64;
/// What is farther outside a picture leaves no trace in it: windows and filters reach less far, px.
const MARGIN_PX: f32 = 8.0;

/// Triangles, neighbours beside each other, and the box around each run of them.
pub(super) struct Cells {
    /// The triangles, in that order.
    pub(super) soup: Soup,
    /// Their numbers in the scene. `[N]`
    pub(super) numbers: Vec<u32>,
    /// Middle and half extent of each cell's box.
    boxes: Vec<[Vec3; 2]>,
}

impl Cells {
    /// Of a soup that is changed before it is drawn; `middles` are those of its triangles.
    pub(super) fn new(soup: &Soup, middles: &[Vec3], change: impl FnOnce(&mut Soup)) -> Self {
        let mut numbers: Vec<u32> = (0..soup.len() as u32).collect();
        halve(middles, &mut numbers);
        let order: Vec<usize> = numbers.iter().map(|i| *i as usize).collect();
        let mut soup = soup.picked(&order);
        change(&mut soup);
        let around = |corners: &[[Vec3; 3]]| {
            let corners = corners.as_flattened().iter();
            let low = corners.clone().fold(Vec3::INFINITY, |a, b| a.min(*b));
            let high = corners.fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
            [(low + high) / 2.0, (high - low) / 2.0]
        };
        let boxes = soup.vertices.chunks(CELL).map(around).collect();
        Self { soup, numbers, boxes }
    }

    /// The triangles of the cells that `camera` may have in its picture, as runs of neighbouring cells.
    pub(super) fn within(&self, camera: &Camera) -> Vec<Range<usize>> {
        let sides = sides(camera);
        let mut runs: Vec<Range<usize>> = Vec::new();
        for (cell, [middle, half]) in self.boxes.iter().enumerate() {
            let at = camera.rotation * *middle + camera.translation;
            // What is not finite is in every picture.
            if sides.iter().any(|(side, reach)| side.dot(at) < -reach.dot(*half)) {
                continue;
            }
            let triangles = cell * CELL..((cell + 1) * CELL).min(self.numbers.len());
            match runs.last_mut() {
                Some(last) if last.end == triangles.start => last.end = triangles.end,
                _ => runs.push(triangles),
            }
        }
        runs
    }
}

/// Puts neighbours beside each other: in halves across the longest extent, again and again. Halves are whole cells.
fn halve(middles: &[Vec3], numbers: &mut [u32]) {
    if numbers.len() <= CELL {
        return;
    }
    let at = |i: &u32| middles[*i as usize];
    let low = numbers.iter().map(at).fold(Vec3::INFINITY, Vec3::min);
    let high = numbers.iter().map(at).fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    let half = (numbers.len() / 2).next_multiple_of(CELL);
    // Equal ones by their number: the order of the scene decides nothing else.
    numbers.select_nth_unstable_by(half, |a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
    let (below, above) = numbers.split_at_mut(half);
    rayon::join(|| halve(middles, below), || halve(middles, above));
}

/// The five sides of what a camera sees: their normals in its space, inwards, and for a box of the world how far it reaches along each.
fn sides(camera: &Camera) -> [(Vec3, Vec3); 5] {
    let Vec2 { x: fx, y: fy } = camera.focal;
    let (low, high) = (camera.center + MARGIN_PX, camera.size.as_vec2() + MARGIN_PX - camera.center);
    let normals = [
        Vec3::Z,
        Vec3::new(fx, 0.0, low.x),
        Vec3::new(-fx, 0.0, high.x),
        Vec3::new(0.0, fy, low.y),
        Vec3::new(0.0, -fy, high.y),
    ];
    let to_world: Mat3 = camera.rotation.transpose();
    normals.map(|normal| (normal, (to_world * normal).abs()))
}
