//! Metashape's `cameras.xml` (File > Export > Export Cameras): sensors, photos by label, and the
//! places of the chunk or of its components.
//!
//! Poses are camera to component with our axes (x right, y down, z forward), and the component's,
//! or where it has none the chunk's, are in the world: scale · R p + t. Of a sensor's numbers, cx
//! and cy are from the middle of the photo, p1 and p2 in the order opposite to OpenCV's:
//!
//! ```text
//! u = w / 2 + cx + x' (f + b1) + y' b2        v = h / 2 + cy + y' f
//! ```

use super::dataset::DatasetKind;
use super::lens::{Distortion, Lens, LensProjection};
use super::listing::{DatasetListing, LensClaim, ListedPhoto, NamedFiles};
use super::options::DatasetOptions;
use glam::{DMat3, DMat4, DVec2, DVec3, UVec2};
use quick_xml::Reader;
use quick_xml::de::from_str;
use quick_xml::events::Event;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result, excerpt, input};

/// Maximum depth of elements, as of JSON: the parser calls itself at each.
const MAX_DEPTH: i32 = 128;

#[derive(Deserialize)]
struct XmlDocument {
    chunk: Vec<XmlChunk>,
}

#[derive(Deserialize)]
struct XmlChunk {
    #[serde(rename = "@label", default)]
    label: String,
    #[serde(default)]
    sensors: Sensors,
    #[serde(default)]
    components: Components,
    #[serde(default)]
    cameras: XmlCameras,
    #[serde(default)]
    transform: XmlTransform,
}

#[derive(Default, Deserialize)]
struct Components {
    #[serde(default)]
    component: Vec<Component>,
}

/// Photos that were aligned with each other.
#[derive(Deserialize)]
struct Component {
    #[serde(rename = "@id")]
    id: u32,
    transform: Option<XmlTransform>,
}

#[derive(Default, Deserialize)]
struct Sensors {
    #[serde(default)]
    sensor: Vec<Sensor>,
}

#[derive(Deserialize)]
struct Sensor {
    #[serde(rename = "@id")]
    id: u32,
    #[serde(rename = "@type", default)]
    kind: String,
    resolution: Option<Resolution>,
    #[serde(default)]
    calibration: Vec<Calibration>,
}

#[derive(Deserialize)]
struct Resolution {
    #[serde(rename = "@width")]
    width: u32,
    #[serde(rename = "@height")]
    height: u32,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Calibration {
    #[serde(rename = "@class")]
    class: String,
    f: Option<f64>,
    cx: f64,
    cy: f64,
    k1: f64,
    k2: f64,
    k3: f64,
    k4: f64,
    p1: f64,
    p2: f64,
    b1: f64,
    b2: f64,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct XmlCameras {
    camera: Vec<XmlCamera>,
    group: Vec<XmlCameras>,
}

#[derive(Deserialize)]
struct XmlCamera {
    #[serde(rename = "@label")]
    label: String,
    #[serde(rename = "@sensor_id")]
    sensor: Option<u32>,
    #[serde(rename = "@component_id")]
    component: Option<u32>,
    #[serde(rename = "@enabled", default)]
    enabled: Option<String>,
    transform: Option<String>,
}

/// Placement of a chunk or component in the world.
#[derive(Default, Deserialize)]
#[serde(default)]
struct XmlTransform {
    rotation: Option<String>,
    translation: Option<String>,
    scale: Option<String>,
}

/// The file of a folder.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    Some(root.join("cameras.xml")).filter(|file| file.is_file())
}

/// Refuse elements nested deeper than [`MAX_DEPTH`]. Other faults are left to the parser.
fn check_depth(text: &str) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    let mut depth = 0;
    while depth <= MAX_DEPTH {
        match reader.read_event() {
            Ok(Event::Start(_)) => depth += 1,
            Ok(Event::End(_)) => depth -= 1,
            Ok(Event::Eof) | Err(_) => return Ok(()),
            Ok(_) => {}
        }
    }
    Err(format!(
        "elements are nested more than {MAX_DEPTH} deep at byte {}",
        reader.buffer_position()
    ))
}

/// Reads `file` and finds its photos.
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let text = input::read_text(file, &options.limits)?;
    let wrong = |fault: String| {
        let reason =
            format!("is not Metashape's list of cameras: {fault}; export it as Agisoft XML");
        Error::malformed(file, "XML", reason)
    };
    check_depth(&text).map_err(wrong)?;
    let document: XmlDocument = from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let (chunk, mut warnings) = main_chunk(document.chunk);
    let chunk = chunk.ok_or_else(|| Error::malformed(file, "cameras", NO_POSE))?;
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let mut files = NamedFiles::new(file, &root, options);
    let used = chunk.main_component(&mut warnings);
    let mut photos = Vec::new();
    let mut broken = Vec::new();
    for camera in &used {
        let at = format!("camera `{}`", camera.label);
        let wrong = |reason: String| Error::malformed(file, &at, reason);
        let sensor = chunk
            .sensors
            .sensor
            .iter()
            .find(|sensor| camera.sensor.is_none_or(|id| sensor.id == id));
        let lens = sensor
            .ok_or_else(|| wrong("its sensor is not in the file".into()))?
            .lens()
            .map_err(wrong)?;
        let place = chunk.place(camera).map_err(wrong)?;
        let path = files.find(&at, &camera.label)?;
        let name = files.name_of(&path);
        match camera.pose(place) {
            Ok(pose) => photos.push(ListedPhoto::with_pose(name, path, pose, lens)),
            Err(reason) => broken.push((name, wrong(reason))),
        }
    }
    let total = chunk.cameras.all().len();
    if used.len() < total {
        let without = total - used.len();
        warnings.push(format!(
            "{without} of {total} photos left out: they are not aligned, or disabled"
        ));
    }
    let kind = DatasetKind::Metashape;
    let list = file.to_owned();
    let points = Vec::new();
    Ok(DatasetListing { kind, root, list, photos, broken, points, warnings })
}

/// Reason of a file without poses.
const NO_POSE: &str = "none has a pose; align the photos before the export";

/// The chunk with the most poses, `None` without any pose; and a warning about the poses of others.
fn main_chunk(mut chunks: Vec<XmlChunk>) -> (Option<XmlChunk>, Vec<String>) {
    chunks.retain(|chunk| !chunk.cameras_with_pose().is_empty());
    // Stable: the first of equals.
    chunks.sort_by_key(|chunk| std::cmp::Reverse(chunk.cameras_with_pose().len()));
    let count = chunks.len();
    let mut chunks = chunks.into_iter();
    let main = chunks.next();
    let others =
        chunks.map(|chunk| format!("`{}` {}", chunk.label, chunk.cameras_with_pose().len()));
    let others = others.collect::<Vec<_>>().join(", ");
    let warning = main.as_ref().filter(|_| count > 1).map(|main| {
        format!(
            "{count} chunks have poses: only `{}` is used, of {} photos; the others have: {others} (merge them in Metashape, or \
             export one)",
            main.label,
            main.cameras_with_pose().len()
        )
    });
    (main, warning.into_iter().collect())
}

impl XmlChunk {
    /// The cameras with a pose that are not disabled.
    fn cameras_with_pose(&self) -> Vec<&XmlCamera> {
        let is_used = |camera: &&XmlCamera| {
            camera.transform.is_some() && !matches!(camera.enabled.as_deref(), Some("0" | "false"))
        };
        self.cameras.all().into_iter().filter(is_used).collect()
    }

    /// The place of a component, if it has its own.
    fn component(&self, camera: &XmlCamera) -> Option<&XmlTransform> {
        let component = self.components.component.iter().find(|it| Some(it.id) == camera.component);
        component.and_then(|component| component.transform.as_ref())
    }

    /// Component to world, for the component of a camera.
    fn place(&self, camera: &XmlCamera) -> Result<DMat4, String> {
        self.component(camera).unwrap_or(&self.transform).matrix()
    }

    /// The posed cameras of one world: all, or where a component has no place those of the largest
    /// component. Says so in `warnings`.
    fn main_component(&self, warnings: &mut Vec<String>) -> Vec<&XmlCamera> {
        let mut cameras = self.cameras_with_pose();
        let mut sizes: BTreeMap<Option<u32>, usize> = BTreeMap::new();
        cameras.iter().for_each(|camera| *sizes.entry(camera.component).or_default() += 1);
        let is_placed = cameras.iter().all(|camera| self.component(camera).is_some());
        if sizes.len() > 1 && !is_placed {
            let largest = sizes.iter().rev().max_by_key(|(_, count)| **count);
            let main = largest.and_then(|(id, _)| *id);
            cameras.retain(|camera| camera.component == main);
            warnings.push(format!(
                "the photos fell into {} components without a place relative to each other: only the largest is used; align \
                 them together",
                sizes.len()
            ));
        }
        cameras
    }
}

impl XmlCamera {
    /// World to camera, for a component at `place`.
    fn pose(&self, place: DMat4) -> Result<(DMat3, DVec3), String> {
        let numbers = numbers::<16>(self.transform.as_deref().unwrap_or_default())?;
        let to_world = place * DMat4::from_cols_array(&numbers).transpose();
        let rotation = DMat3::from_mat4(to_world);
        let center = to_world.w_axis.truncate();
        let scale = rotation.determinant().cbrt();
        let proper = scale > 1e-12 && center.is_finite();
        if !proper {
            return Err("its transform is mirrored or singular".into());
        }
        let rotation = (rotation * (1.0 / scale)).transpose();
        Ok((rotation, -(rotation * center)))
    }
}

impl XmlCameras {
    /// All cameras, those of groups included.
    fn all(&self) -> Vec<&XmlCamera> {
        self.camera.iter().chain(self.group.iter().flat_map(Self::all)).collect()
    }
}

impl Sensor {
    fn lens(&self) -> Result<LensClaim, String> {
        let projection = match self.kind.as_str() {
            "" | "frame" => LensProjection::Perspective,
            "fisheye" | "equidistant_fisheye" => LensProjection::Fisheye,
            "spherical" => LensProjection::Spherical,
            other => {
                return Err(format!(
                    "a sensor of type {other} is not read; undistort the photos in Metashape"
                ));
            }
        };
        let size = self.resolution.as_ref().map(|size| UVec2::new(size.width, size.height));
        let size = size.ok_or("its sensor has no resolution")?;
        if projection == LensProjection::Spherical {
            return Ok(LensClaim::of(&Lens::spherical(size)));
        }
        let adjusted = self.calibration.iter().find(|calibration| calibration.class == "adjusted");
        let c = adjusted.or(self.calibration.first()).ok_or("its sensor has no calibration")?;
        let f = c.f.ok_or("its sensor has no focal length")?;
        let focal = DVec2::new(f + c.b1, f);
        let distortion = Distortion {
            radial: [c.k1, c.k2, c.k3, c.k4],
            tangential: [c.p2, c.p1],
            skew: c.b2 / focal.x,
            projection,
            ..Distortion::default()
        };
        Ok(LensClaim::of(&Lens {
            size,
            focal,
            center: size.as_dvec2() / 2.0 + DVec2::new(c.cx, c.cy),
            distortion,
        }))
    }
}

impl XmlTransform {
    fn matrix(&self) -> Result<DMat4, String> {
        let rotation = numbers(self.rotation.as_deref().unwrap_or("1 0 0 0 1 0 0 0 1"))?;
        let rotation = DMat3::from_cols_array(&rotation).transpose();
        let [scale] = numbers(self.scale.as_deref().unwrap_or("1"))?;
        let moved = DVec3::from(numbers(self.translation.as_deref().unwrap_or("0 0 0"))?);
        Ok(DMat4::from_translation(moved) * DMat4::from_mat3(rotation * scale))
    }
}

/// The numbers of a text.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Vec<f64> =
        text.split_whitespace().map(|word| word.parse().unwrap_or(f64::NAN)).collect();
    let finite = numbers.iter().all(|number| number.is_finite());
    numbers
        .try_into()
        .ok()
        .filter(|_| finite)
        .ok_or_else(|| format!("expected {N} numbers, not `{}`", excerpt(text)))
}
