//! Draws one scene for many cameras: soft, solid or as Gaussians.

use glam::{DVec3, UVec2, Vec3};
use serde::{Deserialize, Serialize};
use trisplat_bake::{BakeOptions, TeacherOptions, bake};
use trisplat_dataset::Dataset;
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_raster::kernel::sh::ShRotation;
use trisplat_raster::soft::{Frame, SoftOptions, SoftRasterizer, SoupRef};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::geometry::spread;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{
    Asset, Error, ImportedScene, Limits, Placement, Result, Scene, SceneNormalization, Soup,
    Splats, frames,
};
#[cfg(feature = "gpu")]
use trisplat_train::CardScene;
use trisplat_train::{BackendOptions, SOLID_SAMPLES};
use trisplat_view::show;

/// The two rasterisers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum RenderMode {
    /// As it was trained: windows, blended in order of depth. Soups only.
    Soft,
    /// Like an engine: every triangle opaque, nearest first.
    Solid,
}

/// Options for drawing scenes.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct RenderOptions {
    /// The kind of drawing; a mesh is always solid.
    #[cfg_attr(feature = "cli", arg(id = "as", long = "as", value_enum, value_name = "MODE"))]
    pub mode: Option<RenderMode>,
    /// Samples per pixel along each axis of solid drawings: 1, 2 or 4.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = SOLID_SAMPLES, value_parser = samples))]
    pub ssaa: u32,
}

/// Soups soft and meshes solid, with the samples of training's evaluation.
impl Default for RenderOptions {
    fn default() -> Self {
        Self { mode: None, ssaa: SOLID_SAMPLES }
    }
}

#[cfg(feature = "cli")]
fn samples(text: &str) -> std::result::Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("expected 1, 2 or 4".into()),
    }
}

/// Draws one scene for many cameras, on the CPU or on a graphics card.
#[derive(Debug)]
pub struct SceneRenderer {
    backend: RenderBackend,
}

/// Kind of the scene, and its rasteriser.
#[derive(Debug)]
enum RenderBackend {
    Soft(Box<SoftBackend>),
    Solid(Box<SolidBackend>),
    Splats(Box<SplatsBackend>),
}

/// A soup, in training space.
#[derive(Debug)]
struct SoftBackend {
    soup: Soup,
    space: SceneNormalization,
    options: SoftOptions,
    soft: SoftRasterizer,
    /// Draws colours in its place.
    #[cfg(feature = "gpu")]
    card: Option<CardScene>,
}

/// A mesh, in the cameras' world.
#[derive(Debug)]
struct SolidBackend {
    mesh: Mesh,
    options: SolidRasterOptions,
    solid: SolidRasterizer,
    frame: Frame,
}

/// Gaussian splats, in the frame of their file.
#[derive(Debug)]
struct SplatsBackend {
    splats: Splats,
    options: GaussianOptions,
    /// Placement of the file and origin of the data set, when the cameras are in its world.
    world: Option<(Placement, DVec3)>,
}

/// Depth of the near plane in units of training space: that of the soft rasteriser.
pub(super) const NEAR: f32 = 0.01;

impl SceneRenderer {
    fn of(backend: RenderBackend) -> Self {
        Self { backend }
    }

    /// A renderer of a soup for cameras of `dataset`; `placement` is that of the soup's file.
    /// Without a data set the cameras are in the file's coordinates.
    pub fn soft(
        mut soup: Soup,
        placement: &Placement,
        dataset: Option<&Dataset>,
        background: [f32; 3],
    ) -> Self {
        let space = match dataset {
            Some(dataset) => {
                move_points(soup.vertices.as_flattened_mut(), placement, dataset);
                ShRotation::turn_soup(&mut soup, placement.rotation().transpose());
                space_of(dataset)
            }
            None => space_around(soup.vertices.as_flattened()),
        };
        space.soup_to_training(&mut soup);
        let options = SoftOptions { background, near: NEAR, ..SoftOptions::default() };
        let options = options.with_cap_for(&soup.opacity);
        Self::of(RenderBackend::Soft(Box::new(SoftBackend {
            soup,
            space,
            options,
            soft: SoftRasterizer::new(),
            #[cfg(feature = "gpu")]
            card: None,
        })))
    }

    /// Lets a graphics card draw the colours of a soup from now on, if one is used. Returns the
    /// card, and a note for the user.
    ///
    /// # Errors
    ///
    /// `gpu` without a matching card, or with one that cannot draw.
    pub fn draw_on(&mut self, place: &BackendOptions) -> Result<(Option<String>, Vec<String>)> {
        match &mut self.backend {
            RenderBackend::Soft(scene) => scene.draw_on(place),
            RenderBackend::Solid(_) | RenderBackend::Splats(_) => Ok((None, Vec::new())),
        }
    }

    /// A renderer of a mesh, with `samples` per pixel along each axis; the rest as for
    /// [`SceneRenderer::soft`].
    pub fn solid(
        mut mesh: Mesh,
        placement: &Placement,
        dataset: Option<&Dataset>,
        background: [f32; 3],
        samples: u32,
    ) -> Self {
        let space = match dataset {
            Some(dataset) => {
                move_points(&mut mesh.positions, placement, dataset);
                ShRotation::turn(&mut mesh, placement.rotation().transpose());
                space_of(dataset)
            }
            None => space_around(&mesh.positions),
        };
        let options = SolidRasterOptions { background, samples, near: NEAR / space.scale };
        Self::of(RenderBackend::Solid(Box::new(SolidBackend {
            mesh,
            options,
            solid: SolidRasterizer::new(),
            frame: Frame::default(),
        })))
    }

    /// A renderer of Gaussian splats, whose shape no cameras change; the rest as for
    /// [`SceneRenderer::soft`].
    pub fn splats(
        splats: Splats,
        placement: &Placement,
        dataset: Option<&Dataset>,
        background: [f32; 3],
    ) -> Self {
        let options = GaussianOptions::suited_to(&splats, background);
        let world = dataset.map(|dataset| (*placement, dataset.origin));
        Self::of(RenderBackend::Splats(Box::new(SplatsBackend { splats, options, world })))
    }

    /// Number of Gaussians; `None` of triangles.
    pub(super) fn splat_count(&self) -> Option<u64> {
        match &self.backend {
            RenderBackend::Splats(scene) => Some(scene.splats.len() as u64),
            RenderBackend::Soft(_) | RenderBackend::Solid(_) => None,
        }
    }

    /// The mesh of a solid scene in the cameras' frame, and its near plane.
    pub(super) fn surface(&self) -> Option<(&Mesh, f32)> {
        match &self.backend {
            RenderBackend::Solid(scene) => Some((&scene.mesh, scene.options.near)),
            RenderBackend::Soft(_) | RenderBackend::Splats(_) => None,
        }
    }

    /// Checks that a picture of `size` can be drawn and is within `limits`.
    pub fn validate(&self, size: UVec2, limits: &Limits) -> Result<()> {
        limits.camera("camera", size)?;
        match &self.backend {
            RenderBackend::Soft(_) | RenderBackend::Splats(_) => Ok(()),
            RenderBackend::Solid(scene) => scene.options.validate(size),
        }
    }

    /// Draws the view of a camera.
    pub fn color(&mut self, camera: &Camera) -> RgbImage {
        match &mut self.backend {
            RenderBackend::Soft(scene) => scene.color(camera),
            RenderBackend::Solid(scene) => scene.solid.render(&scene.mesh, camera, &scene.options),
            RenderBackend::Splats(scene) => scene.draw(camera).to_pixels(),
        }
    }

    /// The camera's view over another background, sRGB-encoded; `None`: over its own.
    pub(super) fn color_over(&mut self, camera: &Camera, background: Option<[f32; 3]>) -> RgbImage {
        let Some(background) = background else { return self.color(camera) };
        let own = self.set_background(background);
        let picture = self.color(camera);
        self.set_background(own);
        picture
    }

    /// Draws over `background` from now on; returns the one before.
    fn set_background(&mut self, background: [f32; 3]) -> [f32; 3] {
        match &mut self.backend {
            RenderBackend::Soft(scene) => {
                std::mem::replace(&mut scene.options.background, background)
            }
            RenderBackend::Solid(scene) => {
                std::mem::replace(&mut scene.options.background, background)
            }
            RenderBackend::Splats(scene) => {
                std::mem::replace(&mut scene.options.background, background)
            }
        }
    }

    /// Draws distances; see [`show::depth`]. Fails for Gaussians, which have no surface.
    pub fn depth(&mut self, camera: &Camera) -> Result<RgbImage> {
        self.geometry(camera).map(show::depth)
    }

    /// Draws normals; see [`show::normal`]. Fails for Gaussians, which have no surface.
    pub fn normal(&mut self, camera: &Camera) -> Result<RgbImage> {
        self.geometry(camera).map(show::normal)
    }

    /// Draws visible edges; see [`show::wires`]. Fails for soups and Gaussians.
    pub fn wires(&mut self, camera: &Camera) -> Result<RgbImage> {
        let RenderBackend::Solid(scene) = &mut self.backend else {
            return Err(Error::invalid(
                "show",
                "wires",
                "color, depth or normal: only a baked file has wires",
            ));
        };
        Ok(show::wires(scene.solid.visibility(&scene.mesh, camera, &scene.options), camera.size))
    }

    fn geometry(&mut self, camera: &Camera) -> Result<&Frame> {
        match &mut self.backend {
            RenderBackend::Soft(scene) => Ok(scene.draw(camera, true)),
            RenderBackend::Solid(scene) => Ok(scene.geometry(camera)),
            RenderBackend::Splats(_) => Err(Self::no_surface()),
        }
    }

    /// The error of Gaussians where a surface is drawn.
    pub(super) fn no_surface() -> Error {
        let wants = "color: Gaussians have no surface";
        Error::invalid("show", "a property of surfaces", wants)
    }
}

impl SplatsBackend {
    fn draw(&self, camera: &Camera) -> Frame {
        let camera = match &self.world {
            Some((placement, origin)) => frames::to_file(camera, placement, *origin),
            None => *camera,
        };
        gaussian::draw(&self.splats, &camera, &self.options)
    }
}

#[cfg(not(feature = "gpu"))]
impl SoftBackend {
    fn draw_on(&mut self, place: &BackendOptions) -> Result<(Option<String>, Vec<String>)> {
        place.check().map(|()| (None, Vec::new()))
    }

    fn color(&mut self, camera: &Camera) -> RgbImage {
        self.draw(camera, false).to_pixels()
    }
}

#[cfg(feature = "gpu")]
impl SoftBackend {
    fn draw_on(&mut self, place: &BackendOptions) -> Result<(Option<String>, Vec<String>)> {
        let (card, warnings) = place.with_card(|gpu| CardScene::new(gpu, &self.soup))?;
        self.card = card;
        Ok((self.card.as_ref().map(|card| card.gpu().describe()), warnings))
    }

    fn color(&mut self, camera: &Camera) -> RgbImage {
        if let Some(card) = &mut self.card {
            let camera = self.space.camera_to_training(camera);
            if let Ok(frame) = card.frame(&camera, &self.options) {
                return frame.to_pixels();
            }
            // The card is lost or too small for this picture; the CPU draws this picture and all
            // later ones.
            self.card = None;
        }
        self.draw(camera, false).to_pixels()
    }
}

impl SoftBackend {
    fn draw(&mut self, camera: &Camera, geometry: bool) -> &Frame {
        let camera = self.space.camera_to_training(camera);
        self.options.geometry = geometry;
        self.soft.render(&SoupRef::from(&self.soup), &camera, &self.options)
    }
}

impl SolidBackend {
    /// Depth and normals at the centres of pixels; no colours.
    fn geometry(&mut self, camera: &Camera) -> &Frame {
        let options = SolidRasterOptions { samples: 1, ..self.options };
        let drawn = self.solid.visibility(&self.mesh, camera, &options);
        let normal = |face: u32| {
            let [a, b, c] = self.mesh.corners(face as usize);
            let across = camera.rotation * (b - a).cross(c - a).normalize_or_zero();
            let towards = camera.rotation * a + camera.translation;
            (across * -across.dot(towards).signum()).to_array()
        };
        self.frame = Frame { size: drawn.size, ..Frame::default() };
        for (face, depth) in drawn.face.iter().zip(&drawn.depth) {
            let nothing = *face == NO_FACE;
            self.frame.transmittance.push(if nothing { 1.0 } else { 0.0 });
            self.frame.depth.push(if nothing { 0.0 } else { *depth });
            self.frame.normal.push(if nothing { [0.0; 3] } else { normal(*face) });
        }
        &self.frame
    }
}

/// A scene baked in memory, ready for drawing.
#[derive(Debug)]
pub struct BakedScene {
    /// Y-up, in chunks, in order.
    pub asset: Asset,
    /// The input, if it was a soup.
    pub soup: Option<Soup>,
    /// The bake's placement, in the file's frame.
    pub bake_placement: Placement,
}

impl BakedScene {
    /// Bakes with the default preset and unchanged colours.
    ///
    /// # Errors
    ///
    /// See [`bake()`].
    pub fn new(loaded: ImportedScene) -> Result<Self> {
        let file_placement = loaded.provenance.placement;
        let soup = match &loaded.scene {
            Scene::Soup(soup) => Some(soup.clone()),
            Scene::Mesh(_) => None,
        };
        let options = BakeOptions { teacher: TeacherOptions::OFF, ..BakeOptions::DEFAULT };
        let asset = bake(loaded, &options)?;
        let bake_placement = file_placement.inverse().then(&asset.provenance.placement);
        Ok(Self { asset, soup, bake_placement })
    }

    /// A camera of the source's world, given relative to its point `origin`, in the frame of the
    /// asset.
    pub fn place(&self, camera: &Camera, origin: DVec3) -> Camera {
        frames::to_file(camera, &self.asset.provenance.placement, origin)
    }
}

/// From the file's frame to the cameras' world, in f64: the two may have their origins at different
/// points of a large world.
fn move_points(points: &mut [Vec3], placement: &Placement, dataset: &Dataset) {
    for point in points {
        *point = (placement.to_world_f64(*point) - dataset.origin).as_vec3();
    }
}

/// The space that a training on this data set uses.
fn space_of(dataset: &Dataset) -> SceneNormalization {
    let cameras: Vec<Camera> = dataset.train().map(|v| v.camera).collect();
    let points: Vec<Vec3> = dataset.points.iter().map(|p| p.position).collect();
    SceneNormalization::new(&cameras, &points)
}

/// A space centred on the mean of some points, with their mean distance from it as unit.
fn space_around(points: &[Vec3]) -> SceneNormalization {
    let (center, spread) = spread(points);
    let scale = if spread > 0.0 { (1.0 / spread) as f32 } else { 1.0 };
    SceneNormalization { center: center.as_vec3(), scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::{DatasetOptions, View};
    use trisplat_synthetic::SyntheticOptions;

    #[test]
    fn harmonics_of_a_placed_soup_turn_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let photos =
            SyntheticOptions { views: 4, width: 32, points: 50, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &photos).unwrap();
        let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        let placement = Placement { rotate: 70.0, scale: 2.0, ..Placement::IDENTITY };
        // Colours as bright as the direction is along this axis.
        let draw = |axis: Vec3, placement: &Placement, view: &View| {
            let back = view.camera.rotation.transpose();
            let corner = |x: f32, y: f32| {
                let world = back * (Vec3::new(x, y, 2.0) - view.camera.translation);
                placement.to_file((world.as_dvec3() + dataset.origin).as_vec3())
            };
            let soup = Soup {
                vertices: vec![[corner(-3.0, -3.0), corner(9.0, -3.0), corner(-3.0, 9.0)]],
                opacity: vec![1.0],
                sigma: vec![1e-3],
                sh: vec![[0.0; 3], [-axis.y; 3], [axis.z; 3], [-axis.x; 3]],
                sh_degree: 1,
                ..Soup::default()
            };
            SceneRenderer::soft(soup, placement, Some(&dataset), [0.0; 3]).color(&view.camera)
        };
        let axis = Vec3::new(0.7, -0.2, 0.4);
        let in_file = (placement.rotation() * axis.as_dvec3()).as_vec3();
        for view in &dataset.views[..2] {
            let own = draw(axis, &Placement::IDENTITY, view);
            let placed = draw(in_file, &placement, view);
            let apart = |(a, b): (&u8, &u8)| a.abs_diff(*b);
            let codes = own.rgb.as_flattened().iter().zip(placed.rgb.as_flattened());
            assert!(codes.map(apart).max().unwrap() <= 2);
        }
    }
}
