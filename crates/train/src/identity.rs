//! The identity of a run's inputs: a checkpoint continues with the same photos, cameras and points,
//! or names the differences.

use super::pyramid::Pyramid;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Dataset, View};
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, ImportedScene, Result};
use xxhash_rust::xxh3::Xxh3Default;

/// All inputs, apart from training options, that change the result of a run. Contents are kept as
/// XXH3 hashes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunIdentity {
    /// The colour behind everything, sRGB-encoded in [0, 1].
    pub background: [f32; 3],
    /// The training photos, in order.
    pub photos: Vec<PhotoIdentity>,
    /// Positions and colours of the data set's points.
    pub points: u64,
    /// The scene that training started from, when there is one.
    pub from: Option<u64>,
}

/// A training photo.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoIdentity {
    /// Its name in the data set.
    pub name: String,
    /// Width and height as loaded for training, px.
    pub size: [u32; 2],
    /// Its camera.
    pub pose: u64,
    /// Its decoded pixels and their weights; `None` until the run has decoded them.
    pub pixels: Option<u64>,
}

impl RunIdentity {
    /// Of a run on `dataset` over `background` that starts from its points or from a scene. No
    /// photo is decoded.
    pub fn of(dataset: &Dataset, background: [f32; 3], from: Option<&ImportedScene>) -> Self {
        let photo = |view: &View| PhotoIdentity {
            name: view.name.clone(),
            size: view.photo.size.to_array(),
            pose: camera(&view.camera),
            pixels: None,
        };
        let mut points = Xxh3Default::new();
        for point in &dataset.points {
            points.update(bytemuck::bytes_of(&point.position));
            points.update(&point.rgb);
        }
        points.update(bytemuck::bytes_of(&dataset.origin));
        let photos = dataset.train().map(photo).collect();
        Self { background, photos, points: points.digest(), from: from.map(scene) }
    }

    /// The first difference, in words; pixels are not compared.
    pub(super) fn difference(&self, now: &Self) -> Option<String> {
        if self.background != now.background {
            let was = color(self.background);
            let is = color(now.background);
            return Some(format!("its background was {was} and is {is} (`background`)"));
        }
        for (was, is) in self.photos.iter().zip(&now.photos) {
            let name = &was.name;
            let [w, h] = was.size;
            let [width, height] = is.size;
            if was.size != is.size {
                return Some(format!(
                    "its photo {name} was {w}x{h} px and is {width}x{height} (`max_size`)"
                ));
            }
            if was.pose != is.pose {
                return Some(format!("the camera of its photo {name} differs"));
            }
        }
        if self.points != now.points {
            return Some("the points of its data set differ".into());
        }
        match (self.from, now.from) {
            (Some(was), Some(is)) if was != is => {
                Some("the scene it started from differs (`from`)".into())
            }
            _ => None,
        }
    }
}

/// Differences of the inputs `now` from those of a checkpoint, one sentence each. Photos that its
/// run has used are decoded.
///
/// # Errors
///
/// Photos of other names; without `force`, any difference; photos that cannot be decoded.
pub(super) fn differences(
    before: &RunIdentity,
    now: &RunIdentity,
    photos: &mut Pyramid,
    force: bool,
) -> Result<impl Iterator<Item = String> + use<>> {
    if !now.photos.iter().map(|photo| &photo.name).eq(before.photos.iter().map(|photo| &photo.name))
    {
        let value = format!("of {} other photos", before.photos.len());
        return Err(Error::invalid(
            "resume",
            value,
            "a checkpoint of this data set with this split",
        ));
    }
    let check = |difference: Option<String>| match difference.filter(|_| !force) {
        Some(difference) => {
            let wants =
                "the photos and options of its run, or `force_resume` to continue with others";
            Err(Error::invalid("resume", format!("of another run: {difference}"), wants))
        }
        None => Ok(()),
    };
    let inputs = before.difference(now);
    check(inputs.clone())?;
    let digests =
        before.photos.iter().enumerate().filter_map(|(i, photo)| Some((i, photo.pixels?)));
    let changed = photos.first_changed(&digests.collect::<Vec<_>>())?;
    let pixels = changed.map(|i| {
        let name = &before.photos[i].name;
        format!("its photo {name} has other pixels (`masks` and `background` count too)")
    });
    check(pixels.clone())?;
    Ok(inputs.into_iter().chain(pixels))
}

/// The hash of a camera's bits.
fn camera(camera: &Camera) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(bytemuck::cast_slice(&camera.rotation.to_cols_array()));
    hash.update(bytemuck::bytes_of(&camera.translation));
    hash.update(bytemuck::bytes_of(&camera.focal));
    hash.update(bytemuck::bytes_of(&camera.center));
    hash.digest()
}

/// The hash of a scene's triangles.
fn scene(loaded: &ImportedScene) -> u64 {
    let soup = loaded.scene.to_soup();
    let mut hash = Xxh3Default::new();
    for corner in soup.vertices.iter().flatten() {
        hash.update(bytemuck::bytes_of(corner));
    }
    hash.update(bytemuck::cast_slice(&soup.opacity));
    hash.update(bytemuck::cast_slice(&soup.sigma));
    hash.update(bytemuck::cast_slice(&soup.sh));
    hash.digest()
}

fn color(rgb: [f32; 3]) -> String {
    let [r, g, b] = rgb.map(|c| (c * 255.0).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}
