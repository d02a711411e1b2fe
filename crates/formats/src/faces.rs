//! Faces with any number of corners, cut into triangles.
//!
//! A convex polygon becomes a fan around its first corner. Any other is projected onto its mean
//! plane (Newell's normal, "Triangulating Polygons", Graphics Gems III) and its ears are clipped by
//! the crate `earcut`, so that concave polygons of a plane keep their outline.

use earcut::Earcut;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::path::Path;
use trisplat_scene::{Error, Result};

/// Maximum number of corners of one face: cutting a polygon may cost up to the cube of its corners.
pub(super) const MAX_CORNERS: usize = 1 << 12;

/// The message about a polygon where only triangles are permitted.
pub(super) fn not_a_triangle(corners: i64) -> String {
    format!(
        "has {corners} corners; expected triangles only: triangulate the mesh where it was made"
    )
}

/// The number of corners of a face if it is within the limit; otherwise the message.
pub(super) fn check_corners(corners: i64) -> Result<usize, String> {
    match usize::try_from(corners) {
        Ok(count @ 3..=MAX_CORNERS) => Ok(count),
        Ok(count @ 3..) => Err(format!(
            "has {count} corners; the limit is {MAX_CORNERS}: triangulate the mesh where it was made"
        )),
        _ => Err(format!("has {corners} corners; expected 3 or more")),
    }
}

/// The faces of a file, in order. Polygons are cut at the end, when all vertices are known.
#[derive(Debug, Default)]
pub(super) struct FaceList {
    /// Three corners per triangle; polygons are fans for now. `[T * 3]`
    indices: Vec<u32>,
    /// The faces with more than three corners.
    polygons: Vec<PolygonFan>,
}

#[derive(Debug)]
struct PolygonFan {
    face: usize,
    /// Its first triangle.
    first: usize,
    triangles: usize,
}

/// Faces after they were cut.
pub(super) struct Triangles {
    /// Three corners per triangle. `[T * 3]`
    pub(super) indices: Vec<u32>,
    /// The faces that had more than three corners, in order, and the number of triangles each
    /// became.
    polygons: Vec<(usize, usize)>,
}

impl FaceList {
    /// Faces that are all triangles, or an empty list with capacity for them. `[T * 3]`
    pub(super) fn from_triangles(indices: Vec<u32>) -> Self {
        Self { indices, polygons: Vec::new() }
    }

    /// Number of triangles of all faces.
    pub(super) fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// Number of faces.
    pub(super) fn len(&self) -> usize {
        let last = self.polygons.last().map_or(0, |p| p.first + p.triangles - (p.face + 1));
        self.indices.len() / 3 - last
    }

    /// Adds a face. Fails, with the reason, when it has too few or too many corners.
    pub(super) fn push(&mut self, corners: &[u32]) -> Result<(), String> {
        let count = check_corners(i64::try_from(corners.len()).unwrap_or(i64::MAX))?;
        let first = self.indices.len() / 3;
        if count > 3 {
            self.polygons.push(PolygonFan { face: self.len(), first, triangles: count - 2 });
        }
        self.indices
            .extend(corners[1..].windows(2).flat_map(|pair| [corners[0], pair[0], pair[1]]));
        Ok(())
    }

    /// The triangles; every corner must be below `positions.len()`.
    pub(super) fn triangulate(self, positions: &[Vec3]) -> Triangles {
        let Self { mut indices, mut polygons } = self;
        let mut cutter = PolygonCutter::default();
        let concave: Vec<(usize, Vec<u32>)> = polygons
            .iter()
            .enumerate()
            .filter_map(|(i, p)| Some((i, cutter.cut(&p.corners(&indices), positions)?)))
            .collect();
        if !concave.is_empty() {
            let mut cut = Vec::with_capacity(indices.len());
            let mut copied = 0;
            for (i, triangles) in &concave {
                let polygon = &mut polygons[*i];
                cut.extend_from_slice(&indices[copied..3 * polygon.first]);
                copied = 3 * (polygon.first + polygon.triangles);
                cut.extend_from_slice(triangles);
                polygon.triangles = triangles.len() / 3;
            }
            cut.extend_from_slice(&indices[copied..]);
            indices = cut;
        }
        Triangles { indices, polygons: polygons.iter().map(|p| (p.face, p.triangles)).collect() }
    }
}

impl PolygonFan {
    /// Its corners, recovered from the fan.
    fn corners(&self, indices: &[u32]) -> Vec<u32> {
        let fan = &indices[3 * self.first..3 * (self.first + self.triangles)];
        fan[..2].iter().copied().chain(fan.chunks_exact(3).map(|triangle| triangle[2])).collect()
    }
}

impl Triangles {
    /// Values per face, repeated for every triangle of each. `[F]` to `[T]`
    pub(super) fn repeat<T: Copy>(&self, of_faces: Vec<T>) -> Vec<T> {
        if self.polygons.is_empty() {
            return of_faces;
        }
        let mut out = Vec::with_capacity(self.indices.len() / 3);
        let mut copied = 0;
        for &(face, triangles) in &self.polygons {
            out.extend_from_slice(&of_faces[copied..face]);
            out.resize(out.len() + triangles, of_faces[face]);
            copied = face + 1;
        }
        out.extend_from_slice(&of_faces[copied..]);
        out
    }

    /// The corners of a mesh of `vertices`; empty where they are 0, 1, 2, 3, ... and no two
    /// triangles share one.
    pub(super) fn into_indices(self, vertices: usize) -> Vec<u32> {
        let unshared = self.indices.len() == vertices
            && self.indices.iter().enumerate().all(|(i, v)| i == *v as usize);
        if unshared { Vec::new() } else { self.indices }
    }
}

/// Cuts polygons one after the other, and reuses its memory.
#[derive(Default)]
struct PolygonCutter {
    plane: Vec<[f64; 2]>,
    ears: Vec<u32>,
    earcut: Earcut<f64>,
}

impl PolygonCutter {
    /// The triangles of a polygon, or none when a fan is as good: it is convex, has no area, is not
    /// finite, or crosses itself beyond repair.
    fn cut(&mut self, corners: &[u32], positions: &[Vec3]) -> Option<Vec<u32>> {
        self.project(corners, positions)?;
        if self.is_convex() {
            return None;
        }
        self.earcut.earcut_slice(&self.plane, &[], &mut self.ears);
        let indices: Vec<u32> = self.ears.iter().map(|&ear| corners[ear as usize]).collect();
        (!indices.is_empty()).then_some(indices)
    }

    /// Projects the corners onto their mean plane, counter-clockwise, in units of their extent;
    /// none without such a plane.
    fn project(&mut self, corners: &[u32], positions: &[Vec3]) -> Option<()> {
        let points = corners.iter().map(|&v| positions[v as usize].as_dvec3());
        let first = points.clone().next()?;
        let extent = points.clone().map(|p| (p - first).abs().max_element()).fold(0.0, f64::max);
        let points = points.map(|p| (p - first) / extent);
        let next = points.clone().skip(1).chain([DVec3::ZERO]);
        let normal =
            points.clone().zip(next).map(|(a, b)| a.cross(b)).sum::<DVec3>().try_normalize()?;
        let (right, up) = normal.any_orthonormal_pair();
        self.plane.clear();
        self.plane.extend(points.map(|p| [right.dot(p), up.dot(p)]));
        Some(())
    }

    /// True when no corner turns clockwise, except by rounding, and the outline goes around once.
    fn is_convex(&self) -> bool {
        let at = |i: usize| DVec2::from(self.plane[i % self.plane.len()]);
        let edges = (0..self.plane.len()).map(|i| at(i + 1) - at(i)).filter(|e| *e != DVec2::ZERO);
        let edges: Vec<DVec2> = edges.collect();
        let turns = || edges.iter().zip(edges.iter().cycle().skip(1));
        let around: f64 = turns().map(|(a, b)| a.angle_to(*b)).sum();
        turns().all(|(a, b)| a.perp_dot(*b) > -1e-6) && around < 1.5 * std::f64::consts::TAU
    }
}

// ---- Texture coordinates of corners -------------------------------------------------------------

/// The texture coordinates of the corners of a file's faces.
#[derive(Debug, Default)]
pub(super) struct CornerUvs {
    /// Texture coordinates, from the lower left corner.
    pub(super) uvs: Vec<Vec2>,
    /// Vertex and number of the coordinates, of all corners that have some.
    corners: Vec<(u32, u32)>,
    /// End of each face's corners in that list; empty until the first. `[F]`
    face_ends: Vec<usize>,
}

impl CornerUvs {
    /// Adds a corner of face number `face`, which has not ended.
    pub(super) fn push(&mut self, face: usize, vertex: u32, place: u32) {
        // Earlier faces may have none.
        self.face_ends.resize(face, self.corners.len());
        self.corners.push((vertex, place));
    }

    /// Ends a face.
    pub(super) fn end_face(&mut self) {
        if !self.corners.is_empty() {
            self.face_ends.push(self.corners.len());
        }
    }

    /// Texture coordinates of the corners of triangles, from the upper left corner; not finite
    /// where a corner has none. Empty when no corner has any. `[T]`
    pub(super) fn of(&self, triangles: &[[u32; 3]], face_of: &[u32]) -> Vec<[Vec2; 3]> {
        if self.corners.is_empty() {
            return Vec::new();
        }
        let of = |(triangle, face): (&[u32; 3], &u32)| {
            let face = *face as usize;
            let first = if face == 0 { 0 } else { self.face_ends[face - 1] };
            let corners = &self.corners[first..self.face_ends[face]];
            triangle.map(|vertex| {
                let place = corners.iter().find(|corner| corner.0 == vertex).map(|corner| corner.1);
                let place = place.and_then(|place| self.uvs.get(place as usize));
                place.map_or(Vec2::NAN, |place| Vec2::new(place.x, 1.0 - place.y))
            })
        };
        triangles.iter().zip(face_of).map(of).collect()
    }
}

// ---- Colour channels from floats: sRGB-encoded, usually but not always in [0, 1] ----------------

/// Maximum overshoot of a channel; above it the file has another scale.
const MAX_OVERSHOOT: f32 = 2.0;

/// The mean of the colours of three corners, exact when they are equal.
pub(super) fn mean([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    if a == b && b == c { a } else { [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0) }
}

/// Counter of clamped colour values.
#[derive(Debug, Default)]
pub(super) struct ClampCounter {
    count: usize,
    largest: f32,
}

impl ClampCounter {
    /// The channel in [0, 1]; NaN when it is not finite, so that its triangle is dropped and
    /// counted.
    #[inline]
    pub(super) fn channel(&mut self, value: f32) -> f32 {
        if (0.0..=1.0).contains(&value) {
            return value;
        }
        if !value.is_finite() {
            return f32::NAN;
        }
        self.count += 1;
        self.largest = self.largest.max(value);
        value.clamp(0.0, 1.0)
    }

    /// Adds the counts of another thread.
    pub(super) fn merge(&mut self, other: ClampCounter) {
        self.count += other.count;
        self.largest = self.largest.max(other.largest);
    }

    /// A warning when values were clamped, an error when they are on another scale altogether.
    pub(super) fn report(&self, path: &Path, warnings: &mut Vec<String>) -> Result<()> {
        if self.largest > MAX_OVERSHOOT {
            let reason = format!(
                "float colours reach {}; floats must lie in 0 to 1: divide by 255, or write integers \
                 where the format has them",
                self.largest
            );
            return Err(Error::malformed(path, "colours", reason));
        }
        if self.count > 0 {
            warnings.push(format!("{} colour values outside 0 to 1 were clamped", self.count));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(triangles: &Triangles, positions: &[Vec3]) -> f32 {
        let doubled = |t: &[u32]| {
            let [a, b, c] = [0, 1, 2].map(|i| positions[t[i] as usize]);
            (b - a).cross(c - a).z
        };
        triangles.indices.chunks_exact(3).map(doubled).sum::<f32>() / 2.0
    }

    proptest! {
        /// Any polygon around a point, however far its corners are from it, has the area of its
        /// triangles.
        #[test]
        fn a_polygon_keeps_its_area(radii in prop::collection::vec(0.1f32..1.0, 4..60), reversed: bool) {
            let count = radii.len();
            let place = |(i, r): (usize, &f32)| {
                let angle = std::f32::consts::TAU * i as f32 / count as f32;
                Vec3::new(r * angle.cos(), r * angle.sin(), 0.0)
            };
            let positions: Vec<Vec3> = radii.iter().enumerate().map(place).collect();
            let mut corners: Vec<u32> = (0..count as u32).collect();
            if reversed {
                corners.reverse();
            }
            let mut faces = FaceList::default();
            faces.push(&corners).unwrap();
            let triangles = faces.triangulate(&positions);
            let sign = if reversed { -1.0 } else { 1.0 };
            let flat = |i: usize| positions[i % count].truncate();
            let wanted = (0..count).map(|i| flat(i).perp_dot(flat(i + 1))).sum::<f32>() / 2.0;
            prop_assert!((area(&triangles, &positions) - sign * wanted).abs() < 1e-4 * wanted.abs().max(1.0));
        }

        #[test]
        fn nothing_is_lost_or_panics_whatever_the_positions(bits in prop::collection::vec(any::<u32>(), 3 * 12)) {
            let values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            let positions: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
            let mut faces = FaceList::default();
            faces.push(&[0, 1, 2]).unwrap();
            faces.push(&(0..12).collect::<Vec<u32>>()).unwrap();
            faces.push(&[3, 4, 5, 6]).unwrap();
            faces.push(&[7, 8, 9]).unwrap();
            prop_assert_eq!(faces.len(), 4);
            let triangles = faces.triangulate(&positions);
            let of_triangles = triangles.repeat(vec!['a', 'b', 'c', 'd']);
            prop_assert_eq!(of_triangles.len(), triangles.indices.len() / 3);
            prop_assert!(of_triangles.first() == Some(&'a') && of_triangles.last() == Some(&'d'));
            prop_assert!(of_triangles.contains(&'b') && of_triangles.contains(&'c'));
        }
    }

    #[test]
    fn the_largest_polygon_is_cut_in_a_moment() {
        // A comb: every second corner is a tooth.
        let count = MAX_CORNERS;
        let place = |i: usize| match i {
            0 => Vec3::new(count as f32, -1.0, 0.0),
            1 => Vec3::new(0.0, -1.0, 0.0),
            _ => Vec3::new(i as f32, if i.is_multiple_of(2) { 0.0 } else { 50.0 }, 0.0),
        };
        let positions: Vec<Vec3> = (0..count).map(place).collect();
        let mut faces = FaceList::default();
        faces.push(&(0..count as u32).collect::<Vec<_>>()).unwrap();
        assert_eq!(faces.triangulate(&positions).indices.len(), 3 * (count - 2));
        let error = FaceList::default().push(&vec![0; count + 1]).unwrap_err();
        assert!(error.contains("4097"), "{error}");
    }
}
