//! How a merged scene looks where blocks meet, and elsewhere: against the photos that were held out.

use super::merge::{Blocks, SeamQuality};
use super::task::read_source;
use glam::{Vec2, Vec3};
use std::path::Path;
use trisplat_bake::is_solid;
use trisplat_dataset::{Dataset, DatasetOptions, Photos, ShrunkSize, View};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_raster::{
    soft::{SoftOptions, SoftRasterizer, SoupRef, Window},
    solid::SolidRasterizer,
};
use trisplat_scene::{
    Error, ImportedScene, Result, Scene, SceneNormalization, Soup, camera::Camera, math::metric,
};
use trisplat_train::EvalScene;

/// Compares each of `scenes`, a name for the report and a file, with the held-out photos of the plan. A pixel is at a seam when it shows, by the coarse scene, what two blocks
/// have trained: the halo of one and the core of another. So the pixels are the same for all scenes.
///
/// Errors: no photo is held out; scenes or photos that cannot be read.
pub fn compare(blocks: &Blocks, scenes: &[(&Path, &Path)], how: &DatasetOptions) -> Result<Vec<SeamQuality>> {
    let plan = &blocks.manifest;
    let path = plan.dataset_path(blocks.folder());
    let dataset = Dataset::load(&path, &plan.dataset_options)?;
    let views: Vec<&View> = dataset.test().collect();
    if views.is_empty() {
        return Err(Error::invalid("evaluate", "given", "a data set with held-out photos: see `test_every`"));
    }
    let cameras: Vec<Camera> = dataset.train().map(|view| view.camera).collect();
    let points: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
    let space = if plan.coarse.is_some() { plan.space() } else { SceneNormalization::new(&cameras, &points) };
    let drawing = plan.options.drawing(plan.dataset_options.background.to_f32());
    let mut photos = Photos::new(views.iter().map(|view| view.photo.clone()).collect(), how.photo_bytes());
    let masks = masks(blocks, &views, space, &drawing)?;
    let options = ReadOptions { sh_degree: 3, limits: how.limits, ..ReadOptions::default() };
    let compared = |(scene, file): &(&Path, &Path)| {
        let soup = soup_of(file, formats::read(file, &options)?)?;
        let window = if is_solid(&soup) { Window::Coverage { width_px: 1.0 } } else { drawing.window };
        let drawn = EvalScene::new(&soup, &space, &SoftOptions { window, ..drawing });
        let mut sums = Sums::default();
        for (i, view) in views.iter().enumerate() {
            let camera = space.camera_to_training(&view.camera);
            let picture =
                drawn.draw(&camera, &drawing, &mut SoftRasterizer::new(), &mut SolidRasterizer::new());
            sums.add(&picture.rgb, &photos.take(i)?.rgb, &masks[i]);
        }
        Ok(sums.quality(scene, &views))
    };
    scenes.iter().map(compared).collect()
}

fn soup_of(path: &Path, loaded: ImportedScene) -> Result<Soup> {
    match loaded.scene {
        Scene::Soup(soup) => Ok(soup),
        Scene::Mesh(_) => Err(Error::unsupported(path, "is a mesh; give the soup that it was baked from")),
    }
}

/// Which pixels of each view are at a seam. `[views][H * W]`
fn masks(
    blocks: &Blocks,
    views: &[&View],
    space: SceneNormalization,
    drawing: &SoftOptions,
) -> Result<Vec<Vec<bool>>> {
    let plan = &blocks.manifest;
    let Some(coarse) = &plan.coarse else {
        return Ok(views
            .iter()
            .map(|view| vec![false; view.camera.size.element_product() as usize])
            .collect());
    };
    let loaded = read_source(blocks.folder(), coarse, &plan.dataset_options.limits)?;
    let Scene::Soup(mut soup) = loaded.scene else { return Ok(Vec::new()) };
    soup.truncate_sh(0);
    space.soup_to_training(&mut soup);
    let options = SoftOptions { geometry: true, ..*drawing };
    let mut soft = SoftRasterizer::new();
    let mask = |view: &&View| {
        let camera = space.camera_to_training(&view.camera);
        let depths = &soft.render(&SoupRef::from(&soup), &camera, &options).median_depth;
        let at_seam = |(i, depth): (usize, &f32)| {
            *depth > 0.0 && is_at_seam(blocks, shown(&view.camera, i, *depth / space.scale))
        };
        depths.iter().enumerate().map(at_seam).collect()
    };
    Ok(views.iter().map(mask).collect())
}

/// The point of the world that a camera shows at pixel `i`, at a depth.
fn shown(camera: &Camera, i: usize, depth: f32) -> Vec3 {
    let width = camera.size.x as usize;
    let pixel = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
    let seen = ((pixel - camera.center) / camera.focal * depth).extend(depth);
    camera.rotation.transpose() * (seen - camera.translation)
}

fn is_at_seam(blocks: &Blocks, point: Vec3) -> bool {
    blocks.manifest.blocks.iter().filter(|block| block.halo.contains(point)).count() > 1
}

/// Squared errors of pixels at seams and elsewhere.
#[derive(Default)]
struct Sums {
    /// Sum of the PSNR of whole photos.
    psnr: f64,
    /// Squared errors over channels, and channels: elsewhere, at seams.
    errors: [(f64, u64); 2],
}

impl Sums {
    fn add(&mut self, picture: &[[u8; 3]], photo: &[[u8; 3]], at_seam: &[bool]) {
        self.psnr += metric::psnr(picture, photo, None);
        for ((a, b), at_seam) in picture.iter().zip(photo).zip(at_seam) {
            let (error, count) = &mut self.errors[usize::from(*at_seam)];
            *error += (0..3).map(|c| f64::from(i32::from(a[c]) - i32::from(b[c])).powi(2)).sum::<f64>();
            *count += 3;
        }
    }

    fn quality(&self, scene: &Path, views: &[&View]) -> SeamQuality {
        let psnr = |(error, count): (f64, u64)| {
            (count > 0).then(|| -10.0 * (error / count as f64 / (255.0 * 255.0)).max(1e-12).log10())
        };
        let [elsewhere, seams] = self.errors;
        SeamQuality {
            scene: scene.display().to_string(),
            photos: views.len() as u64,
            photo_size: ShrunkSize::of(views.iter().copied()),
            psnr: self.psnr / views.len().max(1) as f64,
            seams_psnr: psnr(seams),
            elsewhere_psnr: psnr(elsewhere),
            seams_share: seams.1 as f64 / (seams.1 + elsewhere.1).max(1) as f64,
        }
    }
}
