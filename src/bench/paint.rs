//! Draws one scene for many cameras, soft or solid, wherever its file was placed.

use crate::asset::Placement;
use crate::camera::Camera;
use crate::dataset::Dataset;
use crate::error::{Error, Result};
use crate::image::Pixels;
use crate::mesh::Mesh;
use crate::raster::soft::{Frame, Soft, SoftOptions, SoupRef};
use crate::raster::solid::{NO_FACE, Solid, SolidRasterOptions};
use crate::soup::Soup;
use crate::train::space::Space;
use crate::view::show;
use glam::{DVec3, UVec2, Vec3};
use serde::{Deserialize, Serialize};

/// The two ways to draw.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Way {
    /// As it was trained: windows, blended in order of depth. Soups only.
    Soft,
    /// As an engine does: every triangle opaque, nearest first.
    Solid,
}

/// How scenes are drawn.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct DrawOptions {
    /// How the file is drawn; a mesh is always solid.
    #[arg(id = "as", long = "as", value_enum, value_name = "WAY")]
    pub way: Option<Way>,
    /// Samples a pixel along each axis of solid drawings: 1, 2 or 4.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = samples)]
    pub ssaa: u32,
}

fn samples(text: &str) -> std::result::Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("wants 1, 2 or 4".into()),
    }
}

/// Draws one scene for many cameras.
#[derive(Debug)]
pub enum Painter {
    /// A soup, in training space.
    Soft(Box<SoftPainter>),
    /// A mesh, in the cameras' world.
    Solid(Box<SolidPainter>),
}

/// Draws a soup.
#[derive(Debug)]
pub struct SoftPainter {
    soup: Soup,
    space: Space,
    options: SoftOptions,
    soft: Soft,
}

/// Draws a mesh.
#[derive(Debug)]
pub struct SolidPainter {
    mesh: Mesh,
    options: SolidRasterOptions,
    solid: Solid,
    frame: Frame,
}

/// Depth of the near plane in units of training space: that of the soft rasteriser.
const NEAR: f32 = 0.01;

impl Painter {
    /// A painter of a soup for cameras of `dataset`; `placement` says how the soup's file was placed.
    /// Without a data set the cameras are in the file's own coordinates.
    pub fn soft(
        mut soup: Soup,
        placement: &Placement,
        dataset: Option<&Dataset>,
        background: [f32; 3],
    ) -> Self {
        let space = match dataset {
            Some(dataset) => {
                move_points(soup.vertices.as_flattened_mut(), placement, dataset);
                space_of(dataset)
            }
            None => space_around(soup.vertices.as_flattened()),
        };
        space.soup_to_training(&mut soup);
        // The cap rises with the least opacity, as it does at the end of training: a soup that is
        // solid throughout is drawn without a leak.
        let least = soup.opacity.iter().copied().fold(1.0, f32::min);
        let defaults = SoftOptions::default();
        let alpha_cap = defaults.alpha_cap.max(least);
        let options = SoftOptions { background, alpha_cap, near: NEAR, ..defaults };
        Self::Soft(Box::new(SoftPainter { soup, space, options, soft: Soft::new() }))
    }

    /// A painter of a mesh, with `samples` a pixel along each axis; the rest as for [`Painter::soft`].
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
                space_of(dataset)
            }
            None => space_around(&mesh.positions),
        };
        let options = SolidRasterOptions { background, samples, near: NEAR / space.scale };
        Self::Solid(Box::new(SolidPainter { mesh, options, solid: Solid::new(), frame: Frame::default() }))
    }

    /// Checks that a picture of `size` can be drawn.
    pub fn validate(&self, size: UVec2) -> Result<()> {
        match self {
            Self::Soft(_) => Ok(()),
            Self::Solid(painter) => painter.options.validate(size),
        }
    }

    /// What the camera sees.
    pub fn color(&mut self, camera: &Camera) -> Pixels {
        match self {
            Self::Soft(painter) => show::color(painter.draw(camera, false)),
            Self::Solid(painter) => painter.solid.render(&painter.mesh, camera, &painter.options),
        }
    }

    /// How far away it is; see [`show::depth`].
    pub fn depth(&mut self, camera: &Camera) -> Pixels {
        show::depth(self.geometry(camera))
    }

    /// Which way it faces; see [`show::normal`].
    pub fn normal(&mut self, camera: &Camera) -> Pixels {
        show::normal(self.geometry(camera))
    }

    /// How many layers make it up; see [`show::contributions`]. Fails for a mesh: it has one everywhere.
    pub fn contributions(&mut self, camera: &Camera) -> Result<Pixels> {
        let Self::Soft(painter) = self else {
            let wants = "color, depth, normal or random-subset: a solid drawing has one layer everywhere";
            return Err(Error::invalid("--show", "contributions", wants));
        };
        painter.draw(camera, false);
        let layers = painter.soft.contributions(&painter.options);
        Ok(show::contributions(painter.soft.frame(), &layers))
    }

    fn geometry(&mut self, camera: &Camera) -> &Frame {
        match self {
            Self::Soft(painter) => painter.draw(camera, true),
            Self::Solid(painter) => painter.geometry(camera),
        }
    }
}

impl SoftPainter {
    fn draw(&mut self, camera: &Camera, geometry: bool) -> &Frame {
        let camera = self.space.camera_to_training(camera);
        self.options.geometry = geometry;
        self.soft.render(&SoupRef::from(&self.soup), &camera, &self.options)
    }
}

impl SolidPainter {
    /// Depth and normals at the centres of pixels; no colours.
    fn geometry(&mut self, camera: &Camera) -> &Frame {
        let options = SolidRasterOptions { samples: 1, ..self.options };
        let seen = self.solid.visibility(&self.mesh, camera, &options);
        let normal = |face: u32| {
            let [a, b, c] = self.mesh.corners(face as usize);
            let across = camera.rotation * (b - a).cross(c - a).normalize_or_zero();
            let towards = camera.rotation * a + camera.translation;
            (across * -across.dot(towards).signum()).to_array()
        };
        self.frame = Frame { size: seen.size, ..Frame::default() };
        for (face, depth) in seen.face.iter().zip(&seen.depth) {
            let nothing = *face == NO_FACE;
            self.frame.transmittance.push(if nothing { 1.0 } else { 0.0 });
            self.frame.depth.push(if nothing { 0.0 } else { *depth });
            self.frame.normal.push(if nothing { [0.0; 3] } else { normal(*face) });
        }
        &self.frame
    }
}

/// File to the cameras' world in one go and in f64: the file may be about another point of a far world than the
/// cameras.
fn move_points(points: &mut [Vec3], placement: &Placement, dataset: &Dataset) {
    for point in points {
        *point = (placement.to_world_f64(*point) - dataset.origin).as_vec3();
    }
}

fn space_of(dataset: &Dataset) -> Space {
    let cameras: Vec<Camera> = dataset.train().map(|v| v.camera).collect();
    let points: Vec<Vec3> = dataset.points.iter().map(|p| p.position).collect();
    Space::new(&cameras, &points)
}

/// The space about the middle of some points, their mean distance from it as unit.
fn space_around(points: &[Vec3]) -> Space {
    let count = points.len().max(1) as f64;
    let center = points.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / count;
    let spread = points.iter().map(|v| v.as_dvec3().distance(center)).sum::<f64>() / count;
    let scale = if spread > 0.0 { (1.0 / spread) as f32 } else { 1.0 };
    Space { center: center.as_vec3(), scale }
}
