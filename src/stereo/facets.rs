//! Triangles on the surfaces of depth maps. Each photo is cut into squares of one plane: large where it is
//! flat and plain, small in detail. A square is two triangles. Each surface is taken from one photo only.

use super::depth_map::DepthMap;
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Side of the largest squares, px.
const LARGEST: u32 = 32;
/// Side of the smallest, px.
const SMALLEST: u32 = 2;
/// Least share of a square's pixels with a depth.
const LEAST_KNOWN: f32 = 0.6;
/// Least share of these that no other photo's squares cover.
const LEAST_OPEN: f32 = 0.5;
/// Depths of a square differ by less from its plane, as a share, ...
const FLAT: f32 = 0.01;
/// ... except for this share of them.
const UNEVEN: f32 = 0.05;
/// Largest relative difference between two maps' depths of one surface.
const SAME_DEPTH: f32 = 0.02;
/// Largest ratio of pixel sizes at which two photos show a surface equally well.
const COARSER: f32 = 2.0;
/// Squares are enlarged by this factor, so that there are no seams.
const OVERLAP: f32 = 1.1;
/// Cosine of the largest angle between a square's normal and its ray: 80 degrees.
const LEAST_COSINE: f32 = 0.17;

/// A triangle of one colour on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Its corners, in the world of the maps; wound such that they are counter-clockwise for the photo that shows it.
    pub corners: [Vec3; 3],
    /// sRGB-encoded colour.
    pub rgb: [u8; 3],
}

/// At most `most` triangles for the surfaces of `maps`; places with the largest error of colour are refined
/// first.
pub fn facets(maps: &[DepthMap], most: usize) -> Vec<Facet> {
    let open = open(maps);
    let mut queue: BinaryHeap<Square> = roots(maps, &open).into();
    let mut done: Vec<Square> = Vec::new();
    while let Some(square) = queue.pop() {
        let room = 2 * (queue.len() + done.len() + 4) <= most;
        if square.side <= SMALLEST || (!room && square.plane.is_some()) {
            done.push(square);
            continue;
        }
        if !room {
            continue;
        }
        let half = square.side / 2;
        for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
            queue.extend(Square::of(maps, &open, square.map, square.x + dx, square.y + dy, half));
        }
    }
    done.sort_by_key(|square| (square.map, square.y, square.x));
    let facets = done.iter().filter_map(|square| square.facets(&maps[square.map]));
    facets.flatten().take(most).collect()
}

/// The pixels of each map that no earlier map shows equally well. The maps with most depths come first.
fn open(maps: &[DepthMap]) -> Vec<Vec<bool>> {
    let known = |map: &DepthMap| (0..map.depth.len()).filter(|pixel| map.is_known(*pixel)).count();
    let known: Vec<usize> = maps.par_iter().map(known).collect();
    let before = |other: usize, own: usize| (known[own], other) < (known[other], own);
    let of = |own: usize| {
        let map = &maps[own];
        let others: Vec<&DepthMap> =
            (0..maps.len()).filter(|other| *other != own && before(*other, own)).map(|k| &maps[k]).collect();
        let is_open = |pixel: usize| {
            map.point(pixel).is_some_and(|point| {
                let spacing = map.depth[pixel] / map.camera.focal.x;
                !others.iter().any(|other| shows(other, point, spacing))
            })
        };
        (0..map.depth.len()).map(is_open).collect()
    };
    (0..maps.len()).into_par_iter().map(of).collect()
}

/// Whether a map shows a point with pixels not much larger than `spacing`.
fn shows(map: &DepthMap, point: Vec3, spacing: f32) -> bool {
    map.pixel(point).is_some_and(|(pixel, depth)| {
        let near = (map.depth[pixel] - depth).abs() < SAME_DEPTH * depth;
        near && depth / map.camera.focal.x < COARSER * spacing
    })
}

fn roots(maps: &[DepthMap], open: &[Vec<bool>]) -> Vec<Square> {
    let of = |map: usize| {
        let size = maps[map].camera.size;
        let rows = (0..size.y).step_by(LARGEST as usize);
        let places = rows.flat_map(move |y| (0..size.x).step_by(LARGEST as usize).map(move |x| (x, y)));
        places.filter_map(|(x, y)| Square::of(maps, open, map, x, y, LARGEST)).collect::<Vec<_>>()
    };
    (0..maps.len()).into_par_iter().flat_map_iter(of).collect()
}

/// A square of a photo.
#[derive(Debug, Clone, Copy)]
struct Square {
    map: usize,
    x: u32,
    y: u32,
    side: u32,
    /// 1/depth as a linear function of the place (x, y, 1), px, if it lies on one plane and is not covered
    /// elsewhere.
    plane: Option<Vec3>,
    /// Summed squared difference of its pixels from its mean colour; infinite without a plane.
    error: f32,
}

impl Square {
    /// `None` where no pixel is open.
    fn of(maps: &[DepthMap], open: &[Vec<bool>], map: usize, x: u32, y: u32, side: u32) -> Option<Self> {
        let (own, open) = (&maps[map], &open[map]);
        let (mut known, mut free) = (0.0, 0.0);
        let (mut sum, mut square) = (Vec3::ZERO, 0.0);
        let (mut normal, mut right) = (Mat3::ZERO, Vec3::ZERO);
        let middle = Vec2::new(x as f32, y as f32) + 0.5 * side as f32;
        for pixel in pixels(own, x, y, side) {
            let rgb = Vec3::from(own.rgb[pixel].map(f32::from));
            if !own.is_known(pixel) {
                continue;
            }
            known += 1.0;
            free += f32::from(u8::from(open[pixel]));
            sum += rgb;
            square += rgb.length_squared();
            let at = (place(own, pixel) - middle).extend(1.0);
            normal += Mat3::from_cols(at * at.x, at * at.y, at);
            right += at / own.depth[pixel];
        }
        if free == 0.0 {
            return None;
        }
        let is_covered = known < LEAST_KNOWN * (side * side) as f32 || free < LEAST_OPEN * known;
        let fitted = (normal.determinant() > 1e-6).then(|| normal.inverse() * right);
        let plane = fitted.filter(|plane| !is_covered && is_flat(own, x, y, side, middle, *plane));
        let error = plane.map_or(f32::INFINITY, |_| (square - sum.length_squared() / known).max(0.0));
        Some(Self { map, x, y, side, plane, error })
    }

    /// Its two triangles; `None` without a plane.
    fn facets(&self, map: &DepthMap) -> Option<[Facet; 2]> {
        let plane = self.plane?;
        let half = 0.5 * self.side as f32;
        let middle = Vec2::new(self.x as f32, self.y as f32) + half;
        let corner = |dx: f32, dy: f32| {
            let offset = Vec2::new(dx, dy) * half * OVERLAP;
            let inverse = plane.dot(offset.extend(1.0));
            let camera = &map.camera;
            let ray = ((middle + offset - camera.center) / camera.focal).extend(1.0);
            (inverse > 0.0).then(|| camera.rotation.transpose() * (ray / inverse - camera.translation))
        };
        let [a, b, c, d] = [corner(-1.0, -1.0)?, corner(-1.0, 1.0)?, corner(1.0, 1.0)?, corner(1.0, -1.0)?];
        let color = |below: bool| {
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for pixel in pixels(map, self.x, self.y, self.side) {
                let offset = place(map, pixel) - middle;
                // Both share the diagonal from the upper left to the lower right.
                if map.is_known(pixel) && (offset.x == offset.y || (offset.y > offset.x) == below) {
                    sum += Vec3::from(map.rgb[pixel].map(f32::from));
                    count += 1.0;
                }
            }
            (count > 0.0).then(|| (sum / count).round().to_array().map(|c| c as u8))
        };
        let (low, high) = (color(true), color(false));
        let (low, high) = (low.or(high)?, high.or(low)?);
        Some([Facet { corners: [a, b, c], rgb: low }, Facet { corners: [a, c, d], rgb: high }])
    }
}

/// Whether the depths of a square lie on a plane that is not at a grazing angle.
fn is_flat(map: &DepthMap, x: u32, y: u32, side: u32, middle: Vec2, plane: Vec3) -> bool {
    let (mut known, mut off) = (0.0, 0.0);
    for pixel in pixels(map, x, y, side).filter(|pixel| map.is_known(*pixel)) {
        let at = (place(map, pixel) - middle).extend(1.0);
        known += 1.0;
        off += f32::from(u8::from((plane.dot(at) * map.depth[pixel] - 1.0).abs() > FLAT));
    }
    let camera = &map.camera;
    let ray = ((middle - camera.center) / camera.focal).extend(1.0);
    let across = plane.truncate() * camera.focal;
    let m = across.extend(plane.z - across.dot(ray.truncate()));
    plane.z > 0.0 && plane.z > LEAST_COSINE * m.length() * ray.length() && off <= UNEVEN * known
}

/// The pixels of a square within the picture.
fn pixels(map: &DepthMap, x: u32, y: u32, side: u32) -> impl Iterator<Item = usize> {
    let size = map.camera.size;
    let (right, bottom) = ((x + side).min(size.x), (y + side).min(size.y));
    (y..bottom).flat_map(move |y| (x..right).map(move |x| (y * size.x + x) as usize))
}

/// The centre of a pixel, px.
fn place(map: &DepthMap, pixel: usize) -> Vec2 {
    let width = map.camera.size.x as usize;
    Vec2::new((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5)
}

impl Ord for Square {
    fn cmp(&self, other: &Self) -> Ordering {
        let place = |square: &Self| (square.map, square.y, square.x, square.side);
        self.error.total_cmp(&other.error).then_with(|| place(other).cmp(&place(self)))
    }
}

impl PartialOrd for Square {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Square {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Square {}
