//! Colours of the panorama: of each texel the colour that some photos agree on.

use crate::views::Views;
use glam::Vec2;
use rayon::slice::ParallelSliceMut;
use trisplat_raster::solid::{Barycentrics, NO_FACE, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Result, parallel};

/// Pixels with less than this weight, of 255, are not taken: masked, or with gaps in a drawn
/// picture.
const MIN_ALPHA: u8 = 230;
/// Maximum distance of a channel from the median among photos that agree, codes.
const MAX_CODE_DIFFERENCE: i32 = 80;
/// Weight of each photo that agrees, against the pull of a neighbouring texel.
const PHOTO_WEIGHT: f32 = 0.1;

/// Colours of a picture with twice as many columns as rows.
#[derive(Debug, Clone)]
pub(super) struct PanoramaColors {
    pub(super) rows: usize,
    /// sRGB-encoded, 0 to 255. `[H * W]`
    pub(super) values: Vec<[f32; 3]>,
    /// 0 for texels without a colour. `[H * W]`
    pub(super) weights: Vec<f32>,
}

impl PanoramaColors {
    pub(super) fn nothing(rows: usize) -> Self {
        let texels = 2 * rows * rows;
        Self { rows, values: vec![[0.0; 3]; texels], weights: vec![0.0; texels] }
    }

    /// Colours of the faces of `mesh` from `scene_faces` on in `views`; their corners are at `uvs`.
    ///
    /// # Errors
    ///
    /// A photo that cannot be decoded.
    pub(super) fn of_photos(
        mesh: &Mesh,
        scene_faces: usize,
        uvs: &[[Vec2; 3]],
        rows: usize,
        views: &mut Views,
    ) -> Result<Self> {
        let drawing = views.drawing(mesh, 1);
        let mut solid = SolidRasterizer::new();
        let mut samples: Vec<u64> = Vec::new();
        views.prefetch(&(0..views.len()).collect::<Vec<_>>());
        for view in 0..views.len() {
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visible = solid.visibility(mesh, camera, &drawing);
            let visible_photo = VisiblePhoto {
                mesh,
                scene_faces,
                uvs,
                rows,
                camera,
                photo: &photo,
                face: &visible.face,
            };
            samples.extend(visible_photo.texels());
        }
        samples.par_sort_unstable();
        let mut colors_of_texels = Self::nothing(rows);
        for of_texel in samples.chunk_by(|a, b| texel(*a) == texel(*b)) {
            let inner: Vec<[u8; 3]> =
                of_texel.iter().filter(|one| !is_rim(**one)).map(|one| rgb(*one)).collect();
            // Pixels beside the scene show some of it, or things in a hole: only where there are no
            // others.
            let colors = if inner.is_empty() {
                of_texel.iter().map(|one| rgb(*one)).collect()
            } else {
                inner
            };
            let (value, count) = agreed(&colors);
            let at = texel(of_texel[0]);
            colors_of_texels.values[at] = value;
            colors_of_texels.weights[at] = PHOTO_WEIGHT * count;
        }
        Ok(colors_of_texels)
    }

    /// Gives texels without a colour those of `picture`, with a small weight.
    pub(super) fn add(&mut self, picture: &RgbImage, weight: f32) {
        for (i, rgb) in picture
            .rgb
            .iter()
            .enumerate()
            .filter(|(i, _)| self.weights[*i] == 0.0)
            .collect::<Vec<_>>()
        {
            self.values[i] = rgb.map(f32::from);
            self.weights[i] = weight;
        }
    }

    /// With half as many rows and columns.
    pub(super) fn halved(&self) -> Self {
        let mut half = Self::nothing(self.rows / 2);
        let columns = 2 * self.rows;
        for i in 0..half.values.len() {
            let first = 2 * (i / self.rows) * columns + 2 * (i % self.rows);
            for j in [first, first + 1, first + columns, first + columns + 1] {
                let weight = self.weights[j];
                half.weights[i] += weight;
                for channel in 0..3 {
                    half.values[i][channel] += weight * self.values[j][channel];
                }
            }
            let per = 1.0 / half.weights[i].max(f32::MIN_POSITIVE);
            half.values[i] = half.values[i].map(|sum| sum * per);
        }
        half
    }

    /// The mean colour.
    pub(super) fn mean(&self) -> [f32; 3] {
        let mut sums = [0.0f64; 4];
        for (value, weight) in self.values.iter().zip(&self.weights) {
            for channel in 0..3 {
                sums[channel] += f64::from(weight * value[channel]);
            }
            sums[3] += f64::from(*weight);
        }
        [0, 1, 2].map(|c| (sums[c] / sums[3].max(1e-30)) as f32)
    }
}

/// The mean of the photos that agree, and their number.
fn agreed(colors: &[[u8; 3]]) -> ([f32; 3], f32) {
    let middle = [0, 1, 2].map(|c: usize| {
        i32::from(median(colors.iter().map(|color| color[c]).collect(), u8::cmp).unwrap_or(0))
    });
    let mut sum = [0.0f32; 3];
    let mut count = 0.0f32;
    for color in colors {
        if (0..3).all(|c| (i32::from(color[c]) - middle[c]).abs() <= MAX_CODE_DIFFERENCE) {
            for channel in 0..3 {
                sum[channel] += f32::from(color[channel]);
            }
            count += 1.0;
        }
    }
    if count > 0.0 {
        (sum.map(|sum| sum / count), count)
    } else {
        (middle.map(|code| code as f32), 1.0)
    }
}

/// A texel and its colour in one photo, in one number that sorts by texel.
fn packed(texel: usize, rim: bool, [r, g, b]: [u8; 3]) -> u64 {
    (texel as u64) << 32
        | u64::from(rim) << 24
        | u64::from(r) << 16
        | u64::from(g) << 8
        | u64::from(b)
}

fn texel(packed: u64) -> usize {
    (packed >> 32) as usize
}

fn is_rim(packed: u64) -> bool {
    packed >> 24 & 1 == 1
}

fn rgb(packed: u64) -> [u8; 3] {
    [16, 8, 0].map(|shift| (packed >> shift) as u8)
}

/// A photo and its visible faces.
struct VisiblePhoto<'a> {
    mesh: &'a Mesh,
    scene_faces: usize,
    uvs: &'a [[Vec2; 3]],
    rows: usize,
    camera: &'a Camera,
    photo: &'a RgbImage,
    /// `[H * W]`
    face: &'a [u32],
}

impl VisiblePhoto<'_> {
    /// The mean colour of each texel, once for pixels beside the scene and once for others.
    fn texels(&self) -> Vec<u64> {
        let mut pixels: Vec<u64> = parallel::map(0..self.photo.size.y, |_, y| self.row(y)).concat();
        pixels.par_sort_unstable();
        let mean = |run: &[u64]| {
            let sum = run.iter().fold([0u32; 3], |sum, one| {
                let rgb = rgb(*one);
                [0, 1, 2].map(|c| sum[c] + u32::from(rgb[c]))
            });
            let count = run.len() as u32;
            packed(texel(run[0]), is_rim(run[0]), sum.map(|sum| ((sum + count / 2) / count) as u8))
        };
        pixels.chunk_by(|a, b| a >> 24 == b >> 24).map(mean).collect()
    }

    /// Pixels of a row that show the backdrop.
    fn row(&self, y: u32) -> Vec<u64> {
        let barycentrics = Barycentrics::new(self.mesh, self.camera, 1);
        let width = self.photo.size.x;
        let columns = 2 * self.rows;
        let mut last = (NO_FACE, None);
        let mut samples = Vec::new();
        for x in 0..width {
            let pixel = (y * width + x) as usize;
            let face = self.face[pixel];
            let masked = self.photo.alpha.as_ref().is_some_and(|alpha| alpha[pixel] < MIN_ALPHA);
            if face == NO_FACE || (face as usize) < self.scene_faces || masked {
                continue;
            }
            if last.0 != face {
                last = (face, Some(barycentrics.face(face)));
            }
            let Some(of_face) = &last.1 else { continue };
            let weights = barycentrics.weights(of_face, x, y);
            let uvs = &self.uvs[face as usize - self.scene_faces];
            let place = uvs[0] * weights[0] + uvs[1] * weights[1] + uvs[2] * weights[2];
            let [column, row] =
                [place.x * columns as f32, place.y * self.rows as f32].map(|at| at as usize);
            let texel = row.min(self.rows - 1) * columns + column.min(columns - 1);
            samples.push(packed(texel, self.is_rim(x, y), self.photo.rgb[pixel]));
        }
        samples
    }

    /// True if a pixel beside this one shows the scene.
    fn is_rim(&self, x: u32, y: u32) -> bool {
        let size = self.photo.size;
        let shows =
            |x: u32, y: u32| (self.face[(y * size.x + x) as usize] as usize) < self.scene_faces;
        let left = x.saturating_sub(1);
        let right = (x + 1).min(size.x - 1);
        let above = y.saturating_sub(1);
        let below = (y + 1).min(size.y - 1);
        shows(left, y) || shows(right, y) || shows(x, above) || shows(x, below)
    }
}

// ---- Directions that no photo shows -----------------------------------------------------------

/// Rounds at each size.
const ROUNDS: usize = 16;
/// Rows of the coarsest picture.
const MIN_ROWS: usize = 8;

/// The whole picture, sRGB-encoded, 0 to 255. `colors` have twice as many columns as rows, a power
/// of two. `[H * W]`
pub(super) fn fill(colors: PanoramaColors) -> Vec<[f32; 3]> {
    let mut sizes = vec![colors];
    while let Some(finest) = sizes.last().filter(|colors| colors.rows > MIN_ROWS) {
        sizes.push(finest.halved());
    }
    let mut filled: Option<Vec<[f32; 3]>> = None;
    for colors in sizes.iter().rev() {
        let mut values = match filled {
            Some(coarse) => doubled(&coarse, colors.rows),
            None => vec![colors.mean(); colors.values.len()],
        };
        let weights = RowWeights::new(colors.rows);
        for _ in 0..ROUNDS {
            for parity in [0, 1] {
                relax(&mut values, colors, &weights, parity);
            }
        }
        filled = Some(values);
    }
    filled.unwrap_or_default()
}

/// The picture with twice as many rows and columns, interpolated.
fn doubled(coarse: &[[f32; 3]], rows: usize) -> Vec<[f32; 3]> {
    let height = rows / 2;
    let width = rows;
    let at = |row: usize, column: usize| coarse[row.min(height - 1) * width + column % width];
    let value = |i: usize| {
        let row = i / (2 * rows);
        let column = i % (2 * rows);
        // A texel lies a quarter of a coarse one from the middle of its own, towards a neighbour.
        let beside = |i: usize, count: usize| {
            if i.is_multiple_of(2) { (i / 2 + count - 1) % count } else { i / 2 + 1 }
        };
        let other_row = if row == 0 { 0 } else { beside(row, usize::MAX / 2) };
        let other = beside(column, width);
        let row = row / 2;
        let column = column / 2;
        let corners =
            [at(row, column), at(row, other), at(other_row, column), at(other_row, other)];
        let mix = |c: usize| {
            let [own, along, down, both] = corners.map(|corner| corner[c]);
            (9.0 * own + 3.0 * (along + down) + both) / 16.0
        };
        [mix(0), mix(1), mix(2)]
    };
    (0..2 * rows * rows).map(value).collect()
}

/// Weights that tie the texels of each row to their neighbours.
struct RowWeights {
    along: Vec<f32>,
    above: Vec<f32>,
    below: Vec<f32>,
}

impl RowWeights {
    fn new(rows: usize) -> Self {
        let sine = |row: f64| libm::sin(row / rows as f64 * std::f64::consts::PI);
        let of_rows =
            |link: &dyn Fn(f64) -> f64| (0..rows).map(|row| link(row as f64) as f32).collect();
        Self {
            along: of_rows(&|row| sine(row + 0.5).powi(-1)),
            above: of_rows(&|row| sine(row).max(0.0)),
            below: of_rows(&|row| sine(row + 1.0).max(0.0)),
        }
    }
}

/// Solves every second texel for its neighbours.
fn relax(values: &mut [[f32; 3]], colors: &PanoramaColors, links: &RowWeights, parity: usize) {
    let rows = colors.rows;
    let columns = 2 * colors.rows;
    for row in 0..rows {
        let along = links.along[row];
        let above = links.above[row];
        let below = links.below[row];
        let [up, down] = [row.saturating_sub(1) * columns, (row + 1).min(rows - 1) * columns];
        let own = row * columns;
        for column in ((row + parity) % 2..columns).step_by(2) {
            let i = own + column;
            let left = values[own + (column + columns - 1) % columns];
            let right = values[own + (column + 1) % columns];
            let over = values[up + column];
            let under = values[down + column];
            let weight = colors.weights[i];
            let per = 1.0 / (2.0 * along + above + below + weight);
            for c in 0..3 {
                let pulled = along * (left[c] + right[c]) + above * over[c] + below * under[c];
                values[i][c] = (pulled + weight * colors.values[i][c]) * per;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_that_agree_outvote_one_that_does_not() {
        let (value, count) =
            agreed(&[[100, 50, 20], [104, 52, 24], [250, 250, 250], [102, 54, 22]]);
        assert_eq!((value, count), ([102.0, 52.0, 22.0], 3.0));
        assert_eq!(agreed(&[[7, 8, 9]]), ([7.0, 8.0, 9.0], 1.0));
    }

    #[test]
    fn a_sample_is_packed_without_loss() {
        let one = packed(123_456, true, [1, 200, 255]);
        assert_eq!((texel(one), is_rim(one), rgb(one)), (123_456, true, [1, 200, 255]));
    }
}

#[cfg(test)]
mod fill_tests {
    use super::*;

    #[test]
    fn what_is_known_stays_and_the_rest_has_no_edge() {
        let rows = 64;
        let mut known = PanoramaColors::nothing(rows);
        // A bright cap above, a dark one below, and a red patch between them.
        for row in 0..rows {
            for column in 0..2 * rows {
                let color = match (row, column) {
                    (0..12, _) => [200.0; 3],
                    (52.., _) => [40.0; 3],
                    (28..34, 30..40) => [180.0, 20.0, 20.0],
                    _ => continue,
                };
                known.values[row * 2 * rows + column] = color;
                known.weights[row * 2 * rows + column] = 50.0;
            }
        }
        let kept = known.clone();
        let filled = fill(known);
        for (i, value) in filled.iter().enumerate() {
            let row = i / (2 * rows);
            let column = i % (2 * rows);
            if kept.weights[i] > 0.0 {
                assert!((value[1] - kept.values[i][1]).abs() < 12.0, "{row} {column} {value:?}");
                continue;
            }
            let right = filled[row * 2 * rows + (column + 1) % (2 * rows)];
            let below = filled[(row + 1) * 2 * rows + column];
            for c in 0..3 {
                let step = (value[c] - right[c]).abs().max((value[c] - below[c]).abs());
                assert!(
                    step < 40.0 && (20.0..=200.0).contains(&value[c]),
                    "{row} {column} {value:?}"
                );
            }
        }
        // Far from the patch the colour is that of the height.
        let middle = filled[32 * 2 * rows + 100];
        assert!((middle[0] - 120.0).abs() < 12.0, "{middle:?}");
    }

    #[test]
    fn nothing_known_is_one_colour() {
        assert!(fill(PanoramaColors::nothing(16)).iter().all(|value| *value == [0.0; 3]));
    }
}
