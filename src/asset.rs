//! The finished product: a mesh, its chunks, its BVH and where it came from.

use crate::bvh::Bvh;
use crate::camera::Viewpoint;
use crate::mesh::Mesh;
use crate::report::Counts;
use glam::{DMat3, DVec3, Vec3};
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

/// Mesh + chunks + BVH + provenance.
#[derive(Debug, Clone, Default)]
pub struct Asset {
    /// What an engine draws.
    pub mesh: Mesh,
    /// Consecutive runs that together hold every face once; a single one when not chunked.
    pub chunks: Vec<Chunk>,
    /// Hierarchy over the faces; primitive i is face i.
    pub bvh: Option<Bvh>,
    /// Where it came from and how it was placed.
    pub provenance: Provenance,
    /// The same scene with fewer triangles, finest first; these have no levels themselves.
    pub levels: Vec<Asset>,
}

impl Asset {
    /// Triangles and vertices, for the report.
    pub fn counts(&self) -> Counts {
        Counts { triangles: self.mesh.face_count() as u64, vertices: self.mesh.vertex_count() as u64 }
    }
}

impl From<Mesh> for Asset {
    /// A mesh as it is: one chunk, no BVH, nothing known of its origin.
    fn from(mesh: Mesh) -> Self {
        let chunks = vec![Chunk { first: 0, count: mesh.face_count() as u32 }];
        Self { mesh, chunks, ..Self::default() }
    }
}

/// Which axis of a file points up.
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
    /// +Y up: glTF, OBJ by habit.
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
    /// The proper rotation (determinant +1) that takes this axis to +Y.
    pub fn to_y_up(self) -> DMat3 {
        let rows = |x: DVec3, y: DVec3, z: DVec3| DMat3::from_cols(x, y, z).transpose();
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
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

/// How the source's world became the file's: `file = up_to_y * (scale * (world - center))`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// The axis of the source world that points up; the file is Y-up.
    pub up: UpAxis,
    /// File units per world unit.
    pub scale: f64,
    /// World point that became the file's origin.
    pub center: [f64; 3],
}

impl Placement {
    /// Nothing was moved: the file is in the frame of its source.
    pub const IDENTITY: Placement = Placement { up: UpAxis::Y, scale: 1.0, center: [0.0; 3] };

    /// Source world to file, in f64, rounded once.
    pub fn to_file(&self, world: Vec3) -> Vec3 {
        self.transform()(world)
    }

    /// [`Placement::to_file`] for many points: the matrix is computed once.
    pub fn transform(&self) -> impl Fn(Vec3) -> Vec3 + Sync + use<> {
        let (matrix, center) = (self.up.to_y_up() * self.scale, DVec3::from(self.center));
        move |world| (matrix * (world.as_dvec3() - center)).as_vec3()
    }

    /// File back to source world: undoes [`Placement::to_file`].
    pub fn to_world(&self, file: Vec3) -> Vec3 {
        self.to_world_f64(file).as_vec3()
    }

    /// A viewpoint in the source's world, in the frame of the file.
    pub fn viewpoint_to_file(&self, viewpoint: &Viewpoint) -> Viewpoint {
        let (rotation, center) = (self.up.to_y_up(), DVec3::from(self.center));
        let point = |p: [f64; 3]| (rotation * self.scale * (DVec3::from(p) - center)).to_array();
        let up = (rotation * DVec3::from(viewpoint.up)).to_array();
        Viewpoint { eye: point(viewpoint.eye), target: point(viewpoint.target), up, fov: viewpoint.fov }
    }

    /// [`Placement::to_world`] without the last rounding, for worlds far from their origin.
    pub fn to_world_f64(&self, file: Vec3) -> DVec3 {
        self.up.to_y_up().transpose() * file.as_dvec3() / self.scale + DVec3::from(self.center)
    }
}

impl Default for Placement {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// Where a scene came from. Written to `asset.extras` of a GLB and to comments of PLY and OBJ.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Provenance {
    /// The program that wrote it, "trisplat 0.1.0".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub generator: Option<String>,
    /// Name (not path) of the file it was made from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// The program that trained the soup.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trainer: Option<String>,
    /// The axis of *this file* that points up, when it says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpAxis>,
    /// How the source's world became this file's.
    #[serde(default)]
    pub placement: Placement,
    /// Where to look at this file from first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viewpoint: Option<Viewpoint>,
}
