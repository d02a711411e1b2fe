//! The finished product: a mesh, its chunks and its provenance.

use crate::camera::Viewpoint;
use crate::image::RgbImage;
use crate::mesh::Mesh;
use crate::raycast::{Hit, RayTree};
use crate::report::Counts;
use glam::{DMat3, DQuat, DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A run of faces that one engine node draws and frustum-culls as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunk {
    /// First face.
    pub first: u32,
    /// Number of faces.
    pub count: u32,
}

/// Mesh + chunks + provenance.
#[derive(Debug, Clone, Default)]
pub struct Asset {
    /// The drawn triangles.
    pub mesh: Mesh,
    /// Consecutive runs that together hold every face once; a single one when not chunked. A
    /// backdrop is a separate run, the last.
    pub chunks: Vec<Chunk>,
    /// Its provenance and placement.
    pub provenance: Provenance,
    /// The same scene with fewer triangles, finest first; these have no levels themselves.
    pub levels: Vec<Asset>,
    /// The same scene, without its backdrop, in tiles; the root shows all of it.
    pub tiles: Option<Box<Tile>>,
    /// The collider, which replaces the scene's triangles for collisions: a connected surface, in
    /// the same frame. Not drawn.
    pub collision: Option<Mesh>,
    /// Storage of what is around the scene.
    pub surroundings: SurroundingsStorage,
    /// The tree that [`Asset::raycast`] builds.
    pub rays: RayTree,
}

/// Storage of the surroundings of a scene.
#[derive(Debug, Clone, Default)]
pub enum SurroundingsStorage {
    /// The backdrop, the last faces of the mesh, in the file of the scene.
    #[default]
    SceneFile,
    /// The backdrop in a file of its own.
    BackdropFile,
    /// A panorama in place of a backdrop, in a file of its own: equirectangular, its middle towards
    /// +X, a quarter from the left -Z.
    Sky(RgbImage),
}

/// A piece of a scene at one level of detail; its children show the same piece with more triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// Drawn while the children are not; may be empty.
    pub mesh: Mesh,
    /// Geometric error: the size of the detail that it leaves out, units of the file; 0 for full
    /// detail.
    pub error: f64,
    /// Its children, which replace it, each for a part of it.
    pub children: Vec<Tile>,
}

impl Tile {
    /// A level of detail suffices while its median triangle is this many times smaller than the
    /// error that a viewer permits: 2 px with the usual 16 px of 3D Tiles. Chosen by comparing
    /// pictures of levels with those of the whole scene (docs/benchmarks/figures.md).
    const ERROR_PER_DETAIL: f64 = 8.0;

    /// The error of the tile's level of detail, in the units of its [detail](Mesh::detail).
    pub fn error_of(detail: f64) -> f64 {
        Self::ERROR_PER_DETAIL * detail
    }

    /// True when the tile has neither faces nor children.
    pub fn is_empty(&self) -> bool {
        self.mesh.face_count() == 0 && self.children.is_empty()
    }

    /// Calls `visit` with this tile and all below it, each before its children.
    pub fn visit<'a>(&'a self, visit: &mut impl FnMut(&'a Tile)) {
        visit(self);
        for child in &self.children {
            child.visit(visit);
        }
    }
}

impl Asset {
    /// The first face of the scene, without its backdrop, on a ray; faces are hit from both sides.
    /// Ties go to the lowest number. `None` for no hit, a zero direction, or numbers that are not
    /// finite.
    ///
    /// The first call builds a tree; see [`RayTree`].
    pub fn raycast(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        self.rays.first_hit(&self.mesh, self.scene_faces(), origin, direction)
    }

    /// Number of faces of the scene itself; later ones are the backdrop.
    pub fn scene_faces(&self) -> usize {
        self.mesh.face_count().saturating_sub(self.provenance.backdrop_faces as usize)
    }

    /// The size of the scene's detail, without its backdrop: see [`Mesh::detail`].
    pub fn detail(&self) -> f64 {
        self.mesh.detail_of_first(self.scene_faces())
    }

    /// True when there are faces of both the scene and a backdrop.
    pub fn has_backdrop(&self) -> bool {
        (1..self.mesh.face_count()).contains(&self.scene_faces())
    }

    /// Distance from a point to the backdrop; infinite without one.
    pub fn distance_to_backdrop(&self, from: Vec3) -> f32 {
        let backdrop = self.scene_faces()..self.mesh.face_count();
        let corners = backdrop.flat_map(|face| self.mesh.corners(face));
        corners.map(|corner| corner.distance_squared(from)).fold(f32::INFINITY, f32::min).sqrt()
    }

    /// The panorama in place of a backdrop, if there is one.
    pub fn sky(&self) -> Option<&RgbImage> {
        match &self.surroundings {
            SurroundingsStorage::Sky(picture) => Some(picture),
            SurroundingsStorage::SceneFile | SurroundingsStorage::BackdropFile => None,
        }
    }

    /// The scene and its backdrop as two assets without levels; `None` when it has none.
    pub fn split_backdrop(&self) -> Option<(Asset, Asset)> {
        if !self.has_backdrop() {
            return None;
        }
        let faces = self.scene_faces();
        let mut mesh = self.mesh.clone();
        let backdrop_mesh = mesh.split_off(faces);
        let provenance = |backdrop_faces| Provenance { backdrop_faces, ..self.provenance.clone() };
        let chunks =
            self.chunks.iter().filter(|chunk| (chunk.first as usize) < faces).copied().collect();
        let collision = self.collision.clone();
        let scene =
            Asset { mesh, chunks, provenance: provenance(0), collision, ..Asset::default() };
        let provenance = provenance(self.provenance.backdrop_faces).without_views();
        let backdrop = Asset { provenance, ..Asset::from(backdrop_mesh) };
        Some((scene, backdrop))
    }

    /// Triangles and vertices, for the report.
    pub fn counts(&self) -> Counts {
        self.mesh.counts()
    }
}

impl From<Mesh> for Asset {
    /// An unchanged mesh: one chunk, unknown provenance.
    fn from(mesh: Mesh) -> Self {
        let chunks = vec![Chunk { first: 0, count: mesh.face_count() as u32 }];
        Self { mesh, chunks, ..Self::default() }
    }
}

/// The up axis of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum UpAxis {
    /// +X up.
    #[serde(rename = "x")]
    #[cfg_attr(feature = "cli", value(name = "x"))]
    X,
    /// -X up.
    #[serde(rename = "-x")]
    #[cfg_attr(feature = "cli", value(name = "-x"))]
    NegX,
    /// +Y up: glTF, usually OBJ.
    #[serde(rename = "y")]
    #[cfg_attr(feature = "cli", value(name = "y"))]
    Y,
    /// -Y up: COLMAP and every trainer that follows it.
    #[default]
    #[serde(rename = "-y")]
    #[cfg_attr(feature = "cli", value(name = "-y"))]
    NegY,
    /// +Z up: Blender, Unreal, survey data.
    #[serde(rename = "z")]
    #[cfg_attr(feature = "cli", value(name = "z"))]
    Z,
    /// -Z up.
    #[serde(rename = "-z")]
    #[cfg_attr(feature = "cli", value(name = "-z"))]
    NegZ,
}

impl UpAxis {
    const ALL: [UpAxis; 6] =
        [UpAxis::X, UpAxis::NegX, UpAxis::Y, UpAxis::NegY, UpAxis::Z, UpAxis::NegZ];

    /// The unit vector along this axis.
    pub fn vector(self) -> DVec3 {
        use DVec3 as V;
        [V::X, V::NEG_X, V::Y, V::NEG_Y, V::Z, V::NEG_Z][self as usize]
    }

    /// The axis with the smallest angle to a direction.
    pub fn nearest(direction: DVec3) -> Self {
        let nearer = |best: Self, axis: Self| {
            if axis.vector().dot(direction) > best.vector().dot(direction) { axis } else { best }
        };
        Self::ALL.into_iter().fold(Self::X, nearer)
    }

    /// The proper rotation (determinant +1) that takes this axis to +Y.
    pub fn to_y_up(self) -> DMat3 {
        let rows = |x: DVec3, y: DVec3, z: DVec3| DMat3::from_cols(x, y, z).transpose();
        let x = DVec3::X;
        let y = DVec3::Y;
        let z = DVec3::Z;
        match self {
            UpAxis::Y => DMat3::IDENTITY,
            UpAxis::NegY => rows(x, -y, -z),
            UpAxis::Z => rows(x, z, -y),
            UpAxis::NegZ => rows(x, -z, y),
            UpAxis::X => rows(-y, x, z),
            UpAxis::NegX => rows(y, -x, z),
        }
    }
}

/// The up direction of a world: an axis or any other direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum UpDirection {
    /// One of the six axes, exactly.
    Axis(UpAxis),
    /// A vector, not zero; its length does not matter.
    Vector([f64; 3]),
}

impl UpDirection {
    /// The axis when `direction` is one to within rounding, else the direction as a unit vector.
    pub fn near(direction: DVec3) -> Self {
        let unit = direction.normalize_or(DVec3::NEG_Y);
        match UpAxis::ALL.into_iter().find(|axis| axis.vector().distance(unit) < 1e-12) {
            Some(axis) => Self::Axis(axis),
            None => Self::Vector(unit.to_array()),
        }
    }

    /// The direction as a unit vector.
    pub fn vector(self) -> DVec3 {
        match self {
            Self::Axis(axis) => axis.vector(),
            Self::Vector(v) => DVec3::from(v).normalize_or(DVec3::NEG_Y),
        }
    }

    /// The proper rotation that takes this direction to +Y: the shortest rotation to the nearest
    /// axis, then the rotation of that axis. So a scene a few degrees off an axis is turned by a
    /// few degrees more.
    pub fn to_y_up(self) -> DMat3 {
        if let Self::Axis(axis) = self {
            return axis.to_y_up();
        }
        let up = self.vector();
        let axis = UpAxis::nearest(up);
        axis.to_y_up() * DMat3::from_quat(DQuat::from_rotation_arc(up, axis.vector()))
    }
}

impl From<UpAxis> for UpDirection {
    fn from(axis: UpAxis) -> Self {
        Self::Axis(axis)
    }
}

/// Transform from the source's world to the file:
/// `file = turn(rotate) * up_to_y * (scale * (world - center))`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// The direction of the source world that points up; the file is Y-up.
    pub up: UpDirection,
    /// Turn about the file's up axis, degrees, counter-clockwise as seen from above; absent when 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rotate: f64,
    /// File units per world unit.
    pub scale: f64,
    /// World point that became the file's origin.
    pub center: [f64; 3],
}

/// Maximum scale, turn and centre of a placement, so that combined placements stay within the range
/// of an `f64`.
const MAX_PLACEMENT: f64 = f32::MAX as f64;

fn is_zero<T: Default + PartialEq>(x: &T) -> bool {
    *x == T::default()
}

impl Placement {
    /// True when the numbers are in range and the scale is positive.
    fn is_possible(&self) -> bool {
        let numbers = [self.rotate, self.scale, 1.0 / self.scale].into_iter().chain(self.center);
        self.scale > 0.0 && numbers.into_iter().all(|number| number.abs() <= MAX_PLACEMENT)
    }

    /// The identity: the file is in the frame of its source.
    pub const IDENTITY: Placement =
        Placement { up: UpDirection::Axis(UpAxis::Y), rotate: 0.0, scale: 1.0, center: [0.0; 3] };

    /// From directions of the source's world to those of the file.
    pub fn rotation(&self) -> DMat3 {
        match self.rotate {
            0.0 => self.up.to_y_up(),
            degrees => {
                // Not the C library's sine, so that a page writes the bytes of the program.
                let (sin, cos) = libm::sincos(degrees.to_radians());
                let turn = DMat3::from_cols(
                    DVec3::new(cos, 0.0, -sin),
                    DVec3::Y,
                    DVec3::new(sin, 0.0, cos),
                );
                turn * self.up.to_y_up()
            }
        }
    }

    /// Source world to file, in f64, rounded once.
    pub fn to_file(&self, world: Vec3) -> Vec3 {
        self.transform()(world)
    }

    /// [`Placement::to_file`] for many points: the matrix is computed once.
    pub fn transform(&self) -> impl Fn(Vec3) -> Vec3 + Sync + use<> {
        let matrix = self.rotation() * self.scale;
        let center = DVec3::from(self.center);
        move |world| (matrix * (world.as_dvec3() - center)).as_vec3()
    }

    /// File back to source world: undoes [`Placement::to_file`].
    pub fn to_world(&self, file: Vec3) -> Vec3 {
        self.to_world_f64(file).as_vec3()
    }

    /// A viewpoint of the source's world, in the frame of the file. Its up direction is the file's
    /// up axis, unless it looks along that axis.
    pub fn viewpoint_to_file(&self, viewpoint: &Viewpoint) -> Viewpoint {
        let rotation = self.rotation();
        let center = DVec3::from(self.center);
        let point = |p: [f64; 3]| rotation * self.scale * (DVec3::from(p) - center);
        let eye = point(viewpoint.eye);
        let target = point(viewpoint.target);
        let level = (target - eye).normalize_or_zero().y.abs() < MIN_VERTICAL_COSINE;
        let up = if level { DVec3::Y } else { rotation * DVec3::from(viewpoint.up) };
        let radius = viewpoint.radius.map(|radius| radius * self.scale);
        Viewpoint {
            eye: eye.to_array(),
            target: target.to_array(),
            up: up.to_array(),
            radius,
            ..*viewpoint
        }
    }

    /// [`Placement::to_world`] without the last rounding, for worlds far from their origin.
    pub fn to_world_f64(&self, file: Vec3) -> DVec3 {
        self.rotation().transpose() * file.as_dvec3() / self.scale + DVec3::from(self.center)
    }

    /// This placement followed by `next`.
    pub fn then(&self, next: &Placement) -> Placement {
        if *self == Self::IDENTITY {
            return *next;
        }
        if *next == Self::IDENTITY {
            return *self;
        }
        let back = self.rotation().transpose() * DVec3::from(next.center) / self.scale;
        let center = DVec3::from(self.center) + back;
        Self::from_rotation(next.rotation() * self.rotation(), self.scale * next.scale, center)
    }

    /// From the file back to its source.
    pub fn inverse(&self) -> Placement {
        if *self == Self::IDENTITY {
            return *self;
        }
        let center = self.rotation() * DVec3::from(self.center) * -self.scale;
        Self::from_rotation(self.rotation().transpose(), self.scale.recip(), center)
    }

    fn from_rotation(rotation: DMat3, scale: f64, center: DVec3) -> Self {
        let up = UpDirection::near(rotation.transpose() * DVec3::Y);
        let turn = rotation * up.to_y_up().transpose() * DVec3::X;
        let degrees = libm::atan2(-turn.z, turn.x).to_degrees();
        let rotate = if degrees.abs() < 1e-10 { 0.0 } else { degrees };
        Self { up, rotate, scale, center: center.to_array() }
    }
}

/// Cosine of the angle to the up axis from which a view keeps the up direction of the photos.
const MIN_VERTICAL_COSINE: f64 = 0.995;

impl Default for Placement {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// The provenance of a scene. Written to `asset.extras` of a GLB and to comments of PLY and OBJ.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Provenance {
    /// The program that wrote it, "trisplat 0.1.0".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub generator: Option<String>,
    /// Name (not path) of its source file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// The program that trained the soup.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trainer: Option<String>,
    /// The up axis of *this file*, if the file names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpAxis>,
    /// The up axis that files of its format usually have, for a file that names none; not stored.
    #[serde(skip)]
    pub usual_up: Option<UpAxis>,
    /// The placement from the source's world to this file.
    #[serde(default)]
    pub placement: Placement,
    /// The first viewpoint of this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viewpoint: Option<Viewpoint>,
    /// Number of last triangles that are the backdrop: a far sphere outside the scene. Absent when
    /// 0.
    #[serde(default, rename = "backdrop", skip_serializing_if = "is_zero")]
    pub backdrop_faces: u32,
    /// Shares of the estimated gain, white balance and falloff by which its photos were corrected
    /// in training; absent where they were taken as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<[f32; 3]>,
    /// Some of its photos' cameras in the frame of this file: position, x, y and z of the
    /// quaternion from camera to world over 1 + w, tangents of half the angles of view across and
    /// down.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<[f64; 8]>,
}

impl Provenance {
    /// The up axis that the file names, or the usual one: −y unless its format has another.
    pub fn up_axis(&self) -> UpAxis {
        self.up.or(self.usual_up).unwrap_or_default()
    }

    /// The same without viewpoint and cameras, for a part that is not viewed alone.
    pub fn without_views(self) -> Self {
        Self { viewpoint: None, cameras: Vec::new(), ..self }
    }

    /// Removes impossible values of damaged files: viewpoints without a camera, invalid placements,
    /// shares beyond 0 to 1.
    pub fn possible(mut self) -> Self {
        let is_share = |share: &f32| (0.0..=1.0).contains(share);
        self.exposure = self.exposure.filter(|shares| shares.iter().all(is_share));
        self.viewpoint = self.viewpoint.filter(Viewpoint::is_possible);
        if !self.placement.is_possible() {
            self.placement = Placement::IDENTITY;
        }
        self
    }
}
