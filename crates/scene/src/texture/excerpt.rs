//! The parts of pages that faces show, on a page of their own: for a tile or a cropped scene.
//!
//! Rectangles around faces are copied, with free texels around them. They begin at even texels, so
//! that the next mip level stays as clean as it was. Rectangles of connected faces, such as a
//! chart, become one where that has fewer texels.

use super::{FaceTexture, TexelFilter, Texture};
use crate::image::RgbImage;
use crate::math::lists::Sets;
use crate::parallel::{self, GRAIN};
use glam::{UVec2, Vec2};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Texels around a rectangle that are copied with it.
const MARGIN: u32 = 2;
/// Width and height of an excerpt are multiples of this, texels.
const SIZE_STEP: u32 = 32;
/// Side of the squares of the grid that finds overlapping rectangles, texels.
const SQUARE: u32 = 32;
/// Maximum number of grid squares that are searched for one rectangle.
const MAX_SQUARES: u32 = 1 << 12;
/// Maximum texels of an excerpt, as a share of the texels of all pages; above it the pages stay.
const MAX_TEXEL_SHARE: f64 = 0.75;

/// A rectangle of a page, its end excluded.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rectangle {
    page: u16,
    low: UVec2,
    high: UVec2,
}

impl Rectangle {
    fn size(&self) -> UVec2 {
        self.high - self.low
    }

    fn area(&self) -> u64 {
        u64::from(self.size().x) * u64::from(self.size().y)
    }

    /// The rectangle with its margin, from an even texel on.
    fn grown(&self, page: UVec2) -> Self {
        let low = self.low.map(|x| x.saturating_sub(MARGIN) & !1);
        Self { low, high: (self.high + MARGIN).map(|x| x.next_multiple_of(2)).min(page), ..*self }
    }

    /// The smallest rectangle around two.
    fn union(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), ..*self }
    }
}

impl FaceTexture {
    /// The texture of the same faces from pages with half of the texels along each side, `halvings`
    /// times, with only what the faces show. It has one page of at most `max_side` by `max_side`
    /// texels. Unchanged where that saves little, or does not fit.
    pub fn excerpt(&self, halvings: usize, max_side: u32) -> FaceTexture {
        let style = self.style();
        // Levels of a palette have colours that it has not.
        let halvings = if style.filter == TexelFilter::Linear { halvings } else { 0 };
        let pages: Vec<&RgbImage> = self.pages.iter().map(|page| page.level(halvings)).collect();
        let (rectangles, of_face) = self.rectangles(&pages);
        let grown: Vec<Rectangle> =
            rectangles.iter().map(|one| one.grown(pages[usize::from(one.page)].size)).collect();
        let before: u64 =
            self.pages.iter().map(|page| u64::from(page.size().element_product())).sum();
        let sizes: Vec<UVec2> = grown.iter().map(Rectangle::size).collect();
        let Some((size, places)) = pack_rectangles(&sizes, max_side) else { return self.clone() };
        if u64::from(size.element_product()) as f64 > MAX_TEXEL_SHARE * before as f64 {
            return self.clone();
        }
        let moved = |face: usize| {
            let from = &grown[of_face[face] as usize];
            let to = places[of_face[face] as usize];
            let texels = pages[usize::from(from.page)].size.as_vec2();
            self.uvs[face]
                .map(|uv| (uv * texels - from.low.as_vec2() + to.as_vec2()) / size.as_vec2())
        };
        let uvs = parallel::collect(self.uvs.len(), GRAIN, moved);
        let picture = copy_rectangles(&pages, &grown, &places, size);
        FaceTexture::new(uvs, Arc::new(Texture::new(picture).with_style(style)))
    }

    /// Rectangles that hold the texels of all faces, and each face's number of its rectangle. `[F]`
    fn rectangles(&self, pages: &[&RgbImage]) -> (Vec<Rectangle>, Vec<u32>) {
        let of_face = |face: usize| {
            let page = self.page(face);
            let size = pages[page].size;
            let texels = self.uvs[face].map(|uv| uv * size.as_vec2() - 0.5);
            let within = |at: Vec2| at.clamp(Vec2::ZERO, (size - 1).as_vec2());
            let low = within(texels[0].min(texels[1]).min(texels[2])).floor().as_uvec2();
            let high = within(texels[0].max(texels[1]).max(texels[2])).ceil().as_uvec2() + 1;
            Rectangle { page: page as u16, low, high }
        };
        let own: Vec<Rectangle> = parallel::collect(self.uvs.len(), GRAIN, of_face);
        let whole = charts(&self.connected(), &own);
        let mut order: Vec<u32> = (0..own.len() as u32).collect();
        order.par_sort_unstable_by_key(|face| {
            let Rectangle { page, low, .. } = whole[*face as usize];
            (page, low.y, low.x, *face)
        });
        let mut merged = MergedRectangles::default();
        let mut number_of = vec![0; own.len()];
        for face in order {
            number_of[face as usize] = merged.add(whole[face as usize]);
        }
        (merged.rectangles, number_of)
    }

    /// The first of the faces that each is connected with by corners in the same place. `[F]`
    fn connected(&self) -> Vec<u32> {
        let uvs = self.uvs.as_flattened();
        let place = |corner: usize| {
            let face = corner / 3;
            let uv = uvs[corner];
            (self.page(face), uv.x.to_bits(), uv.y.to_bits(), face as u32)
        };
        let mut corners = parallel::collect(uvs.len(), GRAIN, place);
        corners.par_sort_unstable();
        let mut sets = Sets::new(self.uvs.len());
        for pair in corners.windows(2) {
            let (page, x, y, a) = pair[0];
            let (next_page, next_x, next_y, b) = pair[1];
            if (page, x, y) == (next_page, next_x, next_y) {
                sets.join(a, b);
            }
        }
        (0..self.uvs.len() as u32).map(|face| sets.first(face)).collect()
    }
}

/// The rectangle around all faces of each face's chart, or its own if the faces' own rectangles
/// have fewer texels. `[F]`
fn charts(chart_of: &[u32], own: &[Rectangle]) -> Vec<Rectangle> {
    let mut around: Vec<Option<(Rectangle, u64)>> = vec![None; own.len()];
    for (chart, one) in chart_of.iter().zip(own) {
        let bounds = &mut around[*chart as usize];
        let (all, texels) = bounds.map_or((*one, 0), |(all, texels)| (all.union(one), texels));
        *bounds = Some((all, texels + one.grown(UVec2::MAX / 2).area()));
    }
    let of_face = |(chart, one): (&u32, &Rectangle)| match &around[*chart as usize] {
        Some((all, texels)) if all.grown(UVec2::MAX / 2).area() <= *texels => *all,
        _ => *one,
    };
    chart_of.iter().zip(own).map(of_face).collect()
}

/// Rectangles; overlapping ones become one where that has fewer texels.
#[derive(Default)]
struct MergedRectangles {
    rectangles: Vec<Rectangle>,
    /// Numbers of the rectangles that touch each square of a page.
    by_square: BTreeMap<(u16, u32, u32), Vec<u32>>,
}

impl MergedRectangles {
    /// Add a rectangle; return the number of the rectangle that holds it.
    fn add(&mut self, one: Rectangle) -> u32 {
        let squares = squares(&one);
        let near = squares.iter().filter_map(|square| self.by_square.get(square)).flatten();
        let gain = |number: u32| {
            let other = &self.rectangles[number as usize];
            (other.area() + one.area()).checked_sub(other.union(&one).area())
        };
        let best = near.filter_map(|n| gain(*n).map(|gain| (gain, u32::MAX - n))).max();
        let mut number = self.rectangles.len() as u32;
        let mut joined = one;
        if let Some((_, reversed)) = best {
            number = u32::MAX - reversed;
            joined = self.rectangles[number as usize].union(&one);
        }
        match self.rectangles.get_mut(number as usize) {
            Some(existing) if *existing == joined => return number,
            Some(existing) => *existing = joined,
            None => self.rectangles.push(joined),
        }
        for square in self::squares(&joined) {
            let there = self.by_square.entry(square).or_default();
            if !there.contains(&number) {
                there.push(number);
            }
        }
        number
    }
}

/// The squares that a rectangle touches; of a huge one the first ones.
fn squares(one: &Rectangle) -> Vec<(u16, u32, u32)> {
    let low = one.low / SQUARE;
    let high = (one.high - 1) / SQUARE;
    let all = (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| (one.page, y, x)));
    all.take(MAX_SQUARES as usize).collect()
}

/// Pack rectangles of these `sizes` onto a page of at most `max_side` by `max_side` texels, on
/// shelves: the highest first, equal heights in their order. Returns the size of the page and the
/// upper left corner of each rectangle; `None` if they do not fit.
pub fn pack_rectangles(sizes: &[UVec2], max_side: u32) -> Option<(UVec2, Vec<UVec2>)> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|i| u32::MAX - sizes[*i].y);
    let texels: u64 = sizes.iter().map(|size| u64::from(size.x) * u64::from(size.y)).sum();
    let widest = sizes.iter().map(|size| size.x).max()?;
    let width = ((texels as f64).sqrt() as u32).max(widest).next_multiple_of(SIZE_STEP);
    let mut places = vec![UVec2::ZERO; sizes.len()];
    let mut at = UVec2::ZERO;
    let mut shelf = 0;
    for i in order {
        let size = sizes[i].map(|side| side.next_multiple_of(2));
        if at.x + size.x > width {
            at = UVec2::new(0, at.y + shelf);
            shelf = 0;
        }
        places[i] = at;
        at.x += size.x;
        shelf = shelf.max(size.y);
        if at.y + shelf > max_side {
            return None;
        }
    }
    (width <= max_side)
        .then(|| (UVec2::new(width, (at.y + shelf).next_multiple_of(SIZE_STEP)), places))
}

/// Copy rectangles of `pages` to their places on one page; the rest has the mean colour of the
/// pages.
fn copy_rectangles(
    pages: &[&RgbImage],
    rectangles: &[Rectangle],
    places: &[UVec2],
    size: UVec2,
) -> RgbImage {
    let mut sum = [0u64; 3];
    let mut texels = 0;
    for one in rectangles {
        let from = pages[usize::from(one.page)];
        let at =
            ((one.low.y + one.high.y) / 2 * from.size.x + (one.low.x + one.high.x) / 2) as usize;
        for (sum, code) in sum.iter_mut().zip(from.rgb[at.min(from.rgb.len() - 1)]) {
            *sum += one.area() * u64::from(code);
        }
        texels += one.area();
    }
    let mean = sum.map(|sum| (sum / texels.max(1)) as u8);
    let mut rgb = vec![mean; size.element_product() as usize];
    for (one, to) in rectangles.iter().zip(places) {
        let from = pages[usize::from(one.page)];
        let across = one.size().x as usize;
        for y in 0..one.size().y {
            let source = ((one.low.y + y) * from.size.x + one.low.x) as usize;
            let target = ((to.y + y) * size.x + to.x) as usize;
            rgb[target..target + across].copy_from_slice(&from.rgb[source..source + across]);
        }
    }
    RgbImage { size, rgb, alpha: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    /// A page of 512 by 256 texels, none like another, and triangles of at most 24 texels.
    fn texture(faces: u64) -> FaceTexture {
        let size = UVec2::new(512, 256);
        let rgb = (0..size.element_product())
            .map(|i| [(i % 251) as u8, (i / 512) as u8, (i * 7 % 256) as u8]);
        let page = Texture::new(RgbImage { size, rgb: rgb.collect(), alpha: None });
        let rng = Rng::new(3, "excerpt", 0);
        let at = |face: u64| {
            let draw = |k: u64| rng.uniform(8 * face + k);
            let first = Vec2::new(60.0 + 380.0 * draw(0), 40.0 + 180.0 * draw(1));
            let corner =
                |k: u64| (first + 24.0 * Vec2::new(draw(k), draw(k + 1)) + 0.5) / size.as_vec2();
            [corner(2), corner(4), corner(6)]
        };
        FaceTexture::new((0..faces).map(at).collect(), Arc::new(page))
    }

    fn agree(whole: &FaceTexture, part: &FaceTexture, halvings: usize) {
        for (face, uvs) in part.uvs.iter().enumerate() {
            for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, 0.3, 0.4]] {
                let at = |uvs: &[Vec2; 3]| (0..3).map(|k| weights[k] * uvs[k]).sum::<Vec2>();
                let wants = whole.texture(face).sample(at(&whole.uvs[face]), halvings as f32);
                let got = part.texture(face).sample(at(uvs), 0.0);
                assert!(
                    (0..3).all(|c| (wants[c] - got[c]).abs() < 2e-3),
                    "{face}: {wants:?} {got:?}"
                );
            }
        }
    }

    #[test]
    fn an_excerpt_is_smaller_and_shows_the_same() {
        let whole = texture(40);
        for halvings in [0, 1] {
            let part = whole.excerpt(halvings, 4096);
            let texels = part.pages[0].size().element_product();
            assert!(texels < (512 * 256 / 2) >> (2 * halvings), "{:?}", part.pages[0].size());
            agree(&whole, &part, halvings);
        }
        // A texture that is shown whole, or does not fit, stays as it is.
        let all = texture(4000);
        assert!(Arc::ptr_eq(&all.excerpt(0, 4096).pages[0], &all.pages[0]));
        assert!(Arc::ptr_eq(&whole.excerpt(0, 32).pages[0], &whole.pages[0]));
    }

    #[test]
    fn the_next_mip_level_of_an_excerpt_is_that_of_the_page() {
        let whole = texture(40);
        let part = whole.excerpt(0, 4096);
        for (face, uvs) in part.uvs.iter().enumerate() {
            let middle = |uvs: &[Vec2; 3]| (uvs[0] + uvs[1] + uvs[2]) / 3.0;
            let wants = whole.pages[0].sample(middle(&whole.uvs[face]), 1.0);
            let got = part.pages[0].sample(middle(uvs), 1.0);
            assert!((0..3).all(|c| (wants[c] - got[c]).abs() < 2e-3), "{face}: {wants:?} {got:?}");
        }
    }

    #[test]
    fn texture_pages_become_one_and_copy_faces_once() {
        let mut two = texture(10);
        let mut other = texture(10);
        other.pages = vec![Arc::new(Texture::clone(&two.pages[0]))];
        two.append(&other);
        assert_eq!(two.pages.len(), 2);
        let part = two.excerpt(0, 4096);
        assert_eq!(part.pages.len(), 1);
        agree(&two, &part, 0);
        // A fan of triangles.
        let at = |x: f32, y: f32| Vec2::new(x, y) / Vec2::new(512.0, 256.0);
        let rim = |i: i32| {
            at(100.0 + 40.0 * (0.1 * i as f32).cos(), 100.0 + 40.0 * (0.1 * i as f32).sin())
        };
        let fan = (0..63).map(|i| [at(100.0, 100.0), rim(i), rim(i + 1)]).collect();
        let fan = FaceTexture { uvs: fan, ..texture(0) };
        assert_eq!(fan.rectangles(&[fan.pages[0].picture()]).0.len(), 1);
    }
}
