//! How close a soup comes to the photos: draws every view and measures PSNR, SSIM and FLIP.

use crate::asset::Placement;
use crate::camera::Camera;
use crate::dataset::{Dataset, Photos, View};
use crate::error::{Error, Result};
use crate::image::Pixels;
use crate::math::metric;
use crate::raster::soft::{Frame, Soft, SoftOptions, SoupRef};
use crate::report::generator;
use crate::scene::{Loaded, Scene};
use crate::soup::Soup;
use crate::train::space::Space;
use crate::view::show;
use glam::{DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

/// What `trisplat eval --report` writes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat eval report")]
pub struct Fidelity {
    /// Program and version.
    pub generator: String,
    /// The soup, as given.
    pub soup: String,
    /// The data set, as given.
    pub dataset: String,
    /// Which photos: "test", "train" or "all".
    pub split: String,
    /// Triangles of the soup.
    pub triangles: u64,
    /// Means over the photos, each photo counting once.
    pub mean: Score,
    /// Photo by photo, in order of name.
    pub images: Vec<ImageScore>,
    /// Seconds spent drawing.
    pub draw_secs: f64,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// How close a picture comes to a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Score {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
    /// Mean FLIP error; lower is better.
    pub flip: f64,
}

/// One photo's score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImageScore {
    /// The photo's name.
    pub name: String,
    /// Width and height, px.
    pub size: [u32; 2],
    /// How close the drawing comes.
    #[serde(flatten)]
    pub score: Score,
}

/// Draws one soup for many cameras, in the units it was trained in.
#[derive(Debug)]
pub struct Painter {
    soup: Soup,
    space: Space,
    options: SoftOptions,
    soft: Soft,
}

impl Painter {
    /// A painter of `soup` for cameras of `dataset`; `placement` says how the soup's file was placed.
    pub fn new(mut soup: Soup, placement: &Placement, dataset: &Dataset, background: [f32; 3]) -> Self {
        // In one go and in f64: the file may be about another point of a far world than the cameras.
        move_corners(&mut soup, |v| placement.to_world_f64(v) - dataset.origin);
        let cameras: Vec<Camera> = dataset.train().map(|v| v.camera).collect();
        let points: Vec<Vec3> = dataset.points.iter().map(|p| p.position).collect();
        Self::in_space(soup, Space::new(&cameras, &points), background)
    }

    /// A painter of `soup` for cameras in its own coordinates.
    pub fn alone(soup: Soup, background: [f32; 3]) -> Self {
        let corners: Vec<DVec3> = soup.vertices.iter().flatten().map(|v| v.as_dvec3()).collect();
        let center = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
        let spread = corners.iter().map(|v| v.distance(center)).sum::<f64>() / corners.len().max(1) as f64;
        let scale = if spread > 0.0 { (1.0 / spread) as f32 } else { 1.0 };
        Self::in_space(soup, Space { center: center.as_vec3(), scale }, background)
    }

    fn in_space(mut soup: Soup, space: Space, background: [f32; 3]) -> Self {
        space.enter_soup(&mut soup);
        // The cap rises with the least opacity, as it does at the end of training: a soup that is
        // solid throughout is drawn without a leak.
        let least = soup.opacity.iter().copied().fold(1.0, f32::min);
        let defaults = SoftOptions::default();
        let options = SoftOptions { background, alpha_cap: defaults.alpha_cap.max(least), ..defaults };
        Self { soup, space, options, soft: Soft::new() }
    }

    /// What the camera sees.
    pub fn color(&mut self, camera: &Camera) -> Pixels {
        show::color(self.draw(camera, false))
    }

    /// How far away it is; see [`show::depth`].
    pub fn depth(&mut self, camera: &Camera) -> Pixels {
        show::depth(self.draw(camera, true))
    }

    /// Which way it faces; see [`show::normal`].
    pub fn normal(&mut self, camera: &Camera) -> Pixels {
        show::normal(self.draw(camera, true))
    }

    /// How many layers make it up; see [`show::contributions`].
    pub fn contributions(&mut self, camera: &Camera) -> Pixels {
        self.draw(camera, false);
        let layers = self.soft.contributions(&self.options);
        show::contributions(self.soft.frame(), &layers)
    }

    fn draw(&mut self, camera: &Camera, geometry: bool) -> &Frame {
        let camera = self.space.enter_camera(camera);
        self.options.geometry = geometry;
        self.soft.render(&SoupRef::from(&self.soup), &camera, &self.options)
    }
}

/// The soup of a file. Fails for a mesh, which has nothing soft to be drawn.
pub fn soup_of(path: &Path, loaded: Loaded) -> Result<(Soup, crate::asset::Provenance)> {
    match loaded.scene {
        Scene::Soup(soup) => Ok((soup, loaded.provenance)),
        Scene::Mesh(_) => {
            let reason = "is a mesh, baked already; give the trained soup it was baked from (.ply or .pt)";
            Err(Error::unsupported(path, reason))
        }
    }
}

/// Draws and measures `views`; `hear` gets every view, its drawing and its score, as soon as they are
/// there. Returns the scores and the seconds spent drawing.
pub fn judge(
    painter: &mut Painter,
    views: &[&View],
    photo_bytes: u64,
    mut hear: impl FnMut(&View, &Pixels, &ImageScore) -> Result<()>,
) -> Result<(Vec<ImageScore>, f64)> {
    let mut photos = Photos::new(views.iter().map(|v| v.photo.clone()).collect(), photo_bytes);
    photos.expect(0..views.len());
    let mut scores = Vec::with_capacity(views.len());
    let mut draw_secs = 0.0;
    for (i, view) in views.iter().enumerate() {
        let clock = Instant::now();
        let drawn = painter.color(&view.camera);
        draw_secs += clock.elapsed().as_secs_f64();
        let photo = photos.take(i)?;
        let weights = photo.alpha.as_deref();
        let score = Score {
            psnr: metric::psnr(&photo.rgb, &drawn.rgb, weights),
            ssim: metric::ssim(photo.size, &photo.rgb, &drawn.rgb, weights),
            flip: metric::flip(photo.size, &photo.rgb, &drawn.rgb, weights),
        };
        let score = ImageScore { name: view.name.clone(), size: photo.size.to_array(), score };
        hear(view, &drawn, &score)?;
        scores.push(score);
    }
    Ok((scores, draw_secs))
}

/// The mean of some scores; zeros of none.
pub fn mean(scores: &[ImageScore]) -> Score {
    let count = scores.len().max(1) as f64;
    let mean = |of: fn(&Score) -> f64| scores.iter().map(|s| of(&s.score)).sum::<f64>() / count;
    Score { psnr: mean(|s| s.psnr), ssim: mean(|s| s.ssim), flip: mean(|s| s.flip) }
}

impl Fidelity {
    /// A report of scores.
    pub fn new(soup: &Path, dataset: &Path, split: &str, images: Vec<ImageScore>) -> Self {
        Self {
            generator: generator(),
            soup: soup.display().to_string(),
            dataset: dataset.display().to_string(),
            split: split.to_owned(),
            triangles: 0,
            mean: mean(&images),
            images,
            draw_secs: 0.0,
            warnings: Vec::new(),
        }
    }
}

fn move_corners(soup: &mut Soup, to: impl Fn(Vec3) -> DVec3) {
    for corner in soup.vertices.iter_mut().flatten() {
        *corner = to(*corner).as_vec3();
    }
}
