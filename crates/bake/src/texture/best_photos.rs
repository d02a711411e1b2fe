//! The best photo of each face: large and sharp, in the colour that the others see too, and the
//! same one as its neighbours.
//!
//! ```text
//! min over labels l   Σ_faces D_f(l_f) + SEAM_COST Σ_neighbours [l_f ≠ l_g]      D_f(v) = 1 - q_fv / max_v q_fv + |c_fv - mean c_f| / MAX_COLOR_DIFFERENCE
//! ```
//!
//! q is the sum of the brightness gradients of the pixels that show the face (Gal et al. 2010), c
//! their mean colour. The sum is made small by min-sum belief propagation, after Waechter et al.
//! 2014.

use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use trisplat_raster::solid::{NO_FACE, Visibility};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::geometry::place_bits;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};

/// Number of photos that a face chooses from.
const CANDIDATES: usize = 6;
/// Cost of another photo beside a face.
const SEAM_COST: f32 = 0.4;
/// A difference from the mean colour that costs as much as having no quality, sRGB codes.
const MAX_COLOR_DIFFERENCE: f32 = 48.0;
/// Minimum brightness gradient of a pixel, codes: the best photo of an even surface is then the one
/// with most pixels of it.
const MIN_GRADIENT: u64 = 2;
/// Rounds of belief propagation.
const ROUNDS: usize = 12;
/// No photo.
const NONE: u32 = u32::MAX;

/// A photo that shows a face.
#[derive(Debug, Clone, Copy)]
struct PhotoCandidate {
    view: u32,
    quality: f32,
    color: [f32; 3],
}

const NO_CANDIDATE: PhotoCandidate = PhotoCandidate { view: NONE, quality: 0.0, color: [0.0; 3] };

/// The photos that show each face best, as far as they were added.
pub(super) struct PhotoCandidates {
    /// Best first. `[F]`
    of_face: Vec<[PhotoCandidate; CANDIDATES]>,
    /// Sum of colours over the pixels of all photos, and their number. `[F]`
    sums: Vec<[f32; 4]>,
    /// Number of pixels, sum of gradients and sums of three channels in the present photo. `[F]`
    photo_sums: Vec<[AtomicU64; 5]>,
}

impl PhotoCandidates {
    /// None yet of `faces` faces.
    pub(super) fn new(faces: usize) -> Self {
        let mut photo_sums = Vec::new();
        photo_sums.resize_with(faces, Default::default);
        Self {
            of_face: vec![[NO_CANDIDATE; CANDIDATES]; faces],
            sums: vec![[0.0; 4]; faces],
            photo_sums,
        }
    }

    /// Adds a photo.
    pub(super) fn add(&mut self, view: usize, photo: &RgbImage, visibility: &Visibility) {
        let photo_sums = &self.photo_sums;
        parallel::for_each(0..photo.size.y, |_, y| add_row(photo_sums, photo, visibility, y));
        let mut all: Vec<_> =
            self.of_face.iter_mut().zip(&mut self.sums).zip(&mut self.photo_sums).collect();
        parallel::for_each_mut(&mut all, GRAIN, |_, ((candidates, sums), photo_sums)| {
            let [pixels, gradient, rgb @ ..] =
                photo_sums.each_mut().map(|sum| std::mem::take(sum.get_mut()));
            if pixels == 0 {
                return;
            }
            for channel in 0..3 {
                sums[channel] += rgb[channel] as f32;
            }
            sums[3] += pixels as f32;
            let color = rgb.map(|sum| sum as f32 / pixels as f32);
            let candidate = PhotoCandidate {
                view: view as u32,
                quality: (gradient + MIN_GRADIENT * pixels) as f32,
                color,
            };
            let at = candidates
                .partition_point(|other| other.view != NONE && other.quality >= candidate.quality);
            if at < CANDIDATES {
                candidates[at..].rotate_right(1);
                candidates[at] = candidate;
            }
        });
    }

    /// The best photo of every face of `mesh`.
    pub(super) fn best(self, mesh: &Mesh) -> BestPhotos {
        let vertices = number_places(mesh);
        let costs: Vec<[f32; CANDIDATES]> = self.costs();
        let neighbours = neighbour_pairs(&vertices);
        let label = choose_labels(&self.of_face, &costs, &neighbours);
        let view =
            label.iter().zip(&self.of_face).map(|(label, of_face)| of_face[*label as usize].view);
        BestPhotos { view: view.collect(), vertices }
    }

    fn costs(&self) -> Vec<[f32; CANDIDATES]> {
        let cost = |(candidates, sums): (&[PhotoCandidate; CANDIDATES], &[f32; 4])| {
            candidates.map(|candidate| {
                if candidate.view == NONE {
                    return f32::INFINITY;
                }
                let color_distance = (0..3)
                    .map(|c| (candidate.color[c] - sums[c] / sums[3]).powi(2))
                    .sum::<f32>()
                    .sqrt();
                1.0 - candidate.quality / candidates[0].quality
                    + color_distance / MAX_COLOR_DIFFERENCE
            })
        };
        self.of_face.iter().zip(&self.sums).map(cost).collect()
    }
}

/// Adds a row of pixels to the sums of the faces that they show.
fn add_row(photo_sums: &[[AtomicU64; 5]], photo: &RgbImage, visibility: &Visibility, y: u32) {
    let width = photo.size.x as usize;
    let below = if y + 1 < photo.size.y { width } else { 0 };
    let brightness = |at: usize| photo.rgb[at].iter().map(|c| i32::from(*c)).sum::<i32>();
    for x in 0..width {
        let at = y as usize * width + x;
        let face = visibility.face[at];
        if face == NO_FACE || photo.alpha.as_ref().is_some_and(|alpha| alpha[at] < 128) {
            continue;
        }
        let right = if x + 1 < width { 1 } else { 0 };
        let center = brightness(at);
        let gradient =
            (brightness(at + right) - center).abs() + (brightness(at + below) - center).abs();
        let sums = &photo_sums[face as usize];
        let add = |sum: &AtomicU64, x: u64| sum.fetch_add(x, Ordering::Relaxed);
        add(&sums[0], 1);
        add(&sums[1], (gradient / 3) as u64);
        for (channel, code) in photo.rgb[at].into_iter().enumerate() {
            add(&sums[2 + channel], u64::from(code));
        }
    }
}

/// The best photo of every face, and the corners that faces share.
pub(super) struct BestPhotos {
    /// Or [`NONE`]. `[F]`
    view: Vec<u32>,
    /// Corners of faces at one place have one number. `[F * 3]`
    vertices: Vec<u32>,
}

impl BestPhotos {
    /// The best photo of a face.
    #[inline(always)]
    pub(super) fn view(&self, face: u32) -> u32 {
        self.view[face as usize]
    }

    /// Photos that are the best of some face.
    pub(super) fn views(&self) -> Vec<usize> {
        let mut views: Vec<usize> =
            self.view.iter().filter(|view| **view != NONE).map(|v| *v as usize).collect();
        views.par_sort_unstable();
        views.dedup();
        views
    }

    /// Number of each corner's pair of place and photo: equal pairs have equal numbers. `[F * 3]`
    pub(super) fn slots(&self) -> Vec<u32> {
        let key = |corner: usize| {
            u64::from(self.vertices[corner]) << 32 | u64::from(self.view[corner / 3])
        };
        number_by_key(self.vertices.len(), key)
    }
}

/// Numbers for corners by their keys: equal ones have the same.
fn number_by_key<K: Ord + Send + Sync>(
    corners: usize,
    key: impl Fn(usize) -> K + Sync,
) -> Vec<u32> {
    let mut order: Vec<u32> = (0..corners as u32).collect();
    order.par_sort_unstable_by_key(|corner| key(*corner as usize));
    let mut numbers = vec![0; corners];
    let mut number = 0;
    for (i, corner) in order.iter().enumerate() {
        number += u32::from(i > 0 && key(order[i - 1] as usize) != key(*corner as usize));
        numbers[*corner as usize] = number;
    }
    numbers
}

/// Numbers of the places of corners. `[F * 3]`
fn number_places(mesh: &Mesh) -> Vec<u32> {
    let place = |corner: usize| {
        let vertex = mesh.face(corner / 3)[corner % 3];
        place_bits(mesh.positions[vertex as usize])
    };
    number_by_key(3 * mesh.face_count(), place)
}

/// Pairs of faces with a common edge, both ways, sorted by their first face.
struct FacePairs {
    /// Index of the first pair of each face. `[F + 1]`
    first: Vec<u32>,
    /// The second face of each pair.
    other: Vec<u32>,
    /// Index of the same pair, the other way.
    back: Vec<u32>,
}

/// `vertices` are the numbers of corners, equal at one place. `[F * 3]`
fn neighbour_pairs(vertices: &[u32]) -> FacePairs {
    let edge = |at: usize| {
        let face = at / 3;
        let k = at % 3;
        let a = vertices[at];
        let b = vertices[3 * face + (k + 1) % 3];
        (a.min(b), a.max(b))
    };
    let mut edges: Vec<u32> = (0..vertices.len() as u32).collect();
    edges.par_sort_unstable_by_key(|at| (edge(*at as usize), *at));
    let mut pairs: Vec<(u32, u32)> = Vec::new();
    for two in edges.windows(2) {
        let a = two[0] / 3;
        let b = two[1] / 3;
        if a != b && edge(two[0] as usize) == edge(two[1] as usize) {
            pairs.extend([(a, b), (b, a)]);
        }
    }
    pairs.par_sort_unstable();
    pairs.dedup();
    let faces = vertices.len() / 3;
    let first =
        (0..=faces as u32).map(|face| pairs.partition_point(|pair| pair.0 < face) as u32).collect();
    let back = pairs
        .iter()
        .map(|(a, b)| pairs.binary_search(&(*b, *a)).unwrap_or_default() as u32)
        .collect();
    FacePairs { first, other: pairs.into_iter().map(|pair| pair.1).collect(), back }
}

/// The number of the candidate that every face takes, by belief propagation. `[F]`
fn choose_labels(
    of_face: &[[PhotoCandidate; CANDIDATES]],
    costs: &[[f32; CANDIDATES]],
    neighbours: &FacePairs,
) -> Vec<u32> {
    // Belief-propagation messages, one per directed pair of neighbours.
    let mut messages = vec![[0.0f32; CANDIDATES]; neighbours.other.len()];
    let pairs = |face: usize| neighbours.first[face] as usize..neighbours.first[face + 1] as usize;
    let belief = |messages: &[[f32; CANDIDATES]], face: usize| {
        let mut sum = costs[face];
        for pair in pairs(face) {
            let from = &messages[neighbours.back[pair] as usize];
            for (sum, message) in sum.iter_mut().zip(from) {
                *sum += message;
            }
        }
        sum
    };
    for _ in 0..ROUNDS {
        let messages_from = |face: usize| {
            let all = belief(&messages, face);
            let messages = &messages;
            pairs(face).map(move |pair| {
                let back = &messages[neighbours.back[pair] as usize];
                let without: [f32; CANDIDATES] = std::array::from_fn(|l| all[l] - back[l]);
                let least =
                    without.iter().copied().filter(|x| x.is_finite()).fold(f32::INFINITY, f32::min);
                let other = &of_face[neighbours.other[pair] as usize];
                other.map(|candidate| {
                    if candidate.view == NONE || !least.is_finite() {
                        return 0.0;
                    }
                    let same = (0..CANDIDATES).find(|l| of_face[face][*l].view == candidate.view);
                    same.map_or(SEAM_COST, |l| (without[l] - least).min(SEAM_COST))
                })
            })
        };
        let next = parallel::ranges(of_face.len(), 1 << 10, |faces| {
            faces.flat_map(messages_from).collect::<Vec<_>>()
        });
        messages = next.concat();
    }
    let best = |face: usize| {
        let sum = belief(&messages, face);
        (1..CANDIDATES).fold(0, |best, l| if sum[l] < sum[best] { l } else { best }) as u32
    };
    parallel::collect(of_face.len(), GRAIN, best)
}
