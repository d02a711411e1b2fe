//! The background that a soft scene was trained on, and the triangles that show nothing but it.
//!
//! On a black background, training leaves black triangles around the object. They change no picture of the
//! training, but every picture on another background. The borders of the scene's own pictures show the colour.

use super::drawing::{Teacher, is_drawn};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::math::evenly_spaced::evenly_spaced;
use trisplat_scene::{Soup, camera::Camera, math::median::median};

/// Most pictures that are compared, and their longer side, px.
const MOST_PICTURES: usize = 48;
/// Every sixth of them tells by its border whether there is a background: most scenes have none.
const BORDER_EVERY: usize = 6;
const SIDE: u32 = 240;
/// A pixel shows the background when no channel differs more.
const TOLERANCE: f32 = 4.0 / 255.0;
/// Least share of the pixels at the borders that show the background: objects reach over some.
const LEAST_UNIFORM: f64 = 0.9;
/// Least cover of a pixel whose triangles show the colour of the background.
const LEAST_COVER: f32 = 0.1;
/// A triangle belongs to the object when at least this share of what cameras see of it shows the object.
const LEAST_OBJECT: f32 = 0.5;

/// What is behind the object of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// Its colour, sRGB-encoded; `None` where nothing but the object is in view.
    pub rgb: Option<[f32; 3]>,
    /// False for triangles that show only that colour. `[N]`
    pub is_object: Vec<bool>,
}

impl Background {
    /// The background of `soup`, as `cameras` see it; a `given` colour overrules the pictures. `None` where the
    /// borders of the pictures have no common colour, as in a scene that fills them.
    pub fn of(soup: &Soup, cameras: &[Camera], given: Option<[f32; 3]>) -> Option<Self> {
        let chosen = evenly_spaced(cameras.len(), MOST_PICTURES);
        let cameras: Vec<Camera> = chosen.map(|i| cameras[i].within(SIDE)).collect();
        let drawn: Vec<usize> = (0..soup.len()).filter(|i| is_drawn(&soup.vertices[*i])).collect();
        let part = soup.picked(&drawn);
        let rgb = match given {
            Some(rgb) => Some(rgb),
            None => {
                let few: Vec<Camera> = cameras.iter().step_by(BORDER_EVERY).copied().collect();
                Border::of(&part, &few).background()?
            }
        };
        let mut is_object = vec![true; soup.len()];
        if let Some(rgb) = rgb {
            let found = objects(&part, &cameras, rgb);
            // No camera sees all of the shell, which stands for the background wherever it is.
            drawn.iter().zip(found).for_each(|(i, object)| is_object[*i] = object && !soup.is_shell(*i));
        }
        Some(Self { rgb, is_object })
    }
}

/// The pixels at the borders of pictures over black.
struct Border {
    /// Colour and cover of each.
    pixels: Vec<([f32; 3], f32)>,
}

impl Border {
    fn of(soup: &Soup, cameras: &[Camera]) -> Self {
        let mut teacher = Teacher::new(soup.clone(), cameras, &SoftOptions::default());
        let mut pixels = Vec::new();
        for camera in cameras {
            let frame = teacher.frame(camera);
            let last = frame.size - 1;
            let is_border = |i: &usize| {
                let (x, y) = (*i as u32 % frame.size.x, *i as u32 / frame.size.x);
                x == 0 || y == 0 || x == last.x || y == last.y
            };
            let border = (0..frame.rgb.len()).filter(is_border);
            pixels.extend(border.map(|i| (frame.rgb[i], 1.0 - frame.transmittance[i])));
        }
        Self { pixels }
    }

    /// The colour that nearly all pixels show when it is behind them, if there is one; `Some(None)` for any
    /// colour, because no triangle at the border has that of a background.
    fn background(&self) -> Option<Option<[f32; 3]>> {
        let covered = || self.pixels.iter().filter(|(_, cover)| *cover > LEAST_COVER);
        let middle = [0, 1, 2].map(|c| {
            let channel = covered().map(|(rgb, cover)| rgb[c] / cover).collect();
            median(channel, f32::total_cmp).unwrap_or(0.0)
        });
        let shows = |(rgb, cover): &&([f32; 3], f32), behind: &[f32; 3]| {
            let over = [0, 1, 2].map(|c| rgb[c] + (1.0 - cover) * behind[c]);
            !differ(&over, behind)
        };
        // Where only a part of the object reaches the border, the middle is its colour.
        let candidates = [middle, [0.0; 3], [1.0; 3]].map(|behind| {
            let all = self.pixels.iter().filter(|pixel| shows(pixel, &behind)).count();
            (covered().filter(|pixel| shows(pixel, &behind)).count(), all, behind)
        });
        let (showing, all, behind) =
            candidates.into_iter().max_by_key(|(showing, all, _)| (*showing, *all))?;
        let is_uniform = !self.pixels.is_empty() && all as f64 >= LEAST_UNIFORM * self.pixels.len() as f64;
        is_uniform.then_some((showing > 0).then_some(behind))
    }
}

/// Which triangles of `soup` show an object before a background of this colour. `[N]`
fn objects(soup: &Soup, cameras: &[Camera], rgb: [f32; 3]) -> Vec<bool> {
    let options = SoftOptions { background: rgb, ..SoftOptions::default() };
    let mut whole = Teacher::new(soup.clone(), cameras, &options);
    let pictures: Vec<Vec<[f32; 3]>> = cameras.iter().map(|c| whole.frame(c).rgb.clone()).collect();
    let shows = |picture: &Vec<[f32; 3]>| picture.iter().map(|p| f32::from(differ(p, &rgb))).collect();
    let mut shows: Vec<Vec<f32>> = pictures.iter().map(shows).collect();
    let first = whole.shares(cameras, &shows);
    // A part of the object in the colour of the background hides what is behind it: without it, pictures change.
    let kept: Vec<usize> = (0..soup.len()).filter(|i| first[*i] >= LEAST_OBJECT).collect();
    let mut without = Teacher::new(soup.picked(&kept), cameras, &options);
    for ((camera, picture), shows) in cameras.iter().zip(&pictures).zip(&mut shows) {
        let pixels = without.frame(camera).rgb.iter().zip(picture);
        shows
            .iter_mut()
            .zip(pixels)
            .for_each(|(shows, (now, before))| *shows = shows.max(differ(now, before).into()));
    }
    whole.shares(cameras, &shows).into_iter().map(|share| share >= LEAST_OBJECT).collect()
}

/// True when two colours can be told apart.
fn differ(a: &[f32; 3], b: &[f32; 3]) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > TOLERANCE)
}
