//! An asset in GPU memory.

use super::cull::Frustum;
use super::layout::{self, Aabb, CornerVertex, TextureVertex, VertexLayout};
use super::pages::{Pages, runs};
use glam::Vec3;
use std::ops::Range;
use trisplat_gpu::{Gpu, buffer};
use trisplat_scene::{
    Asset, Chunk, Error, Result, Rng,
    camera::Camera,
    mesh::{Colors, Mesh},
};
use wgpu::{BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, Buffer, BufferUsages};
use wgpu::{IndexFormat, RenderPass};

/// An asset in GPU memory.
#[derive(Debug)]
pub struct Model {
    /// How its vertices are stored.
    pub layout: VertexLayout,
    /// Bytes of GPU memory that it takes.
    pub bytes: u64,
    /// Runs of faces that are drawn or culled as a whole, and their boxes.
    pub chunks: Vec<(Chunk, Aabb)>,
    vertices: Buffer,
    indices: Option<Buffer>,
    /// Face colours.
    faces: Option<BindGroup>,
    pages: Option<Pages>,
}

/// The layouts of the bind groups that models have.
#[derive(Debug, Clone)]
pub struct ModelGroups {
    /// Face colours.
    pub faces: BindGroupLayout,
    /// A page of a texture.
    pub page: BindGroupLayout,
}

/// Some of a model's faces.
#[derive(Debug)]
pub struct Subset {
    /// Three vertices per face.
    indices: Buffer,
    /// The part of the indices that belongs to each chunk, counted in faces. `[chunks]`
    ranges: Vec<Range<u32>>,
}

/// One draw call: a run of faces, and the chunk that it (or its first face) is in.
pub(crate) type DrawCall = (Range<u32>, u32);

impl Model {
    /// Uploads the faces of `asset`.
    ///
    /// Errors: the layout does not fit the mesh, or the card has no room.
    pub fn upload(gpu: &Gpu, groups: &ModelGroups, asset: &Asset, layout: VertexLayout) -> Result<Self> {
        let mesh = &asset.mesh;
        mesh.validate_shape()?;
        if !layout.fits(mesh) {
            let wants =
                "texture for a textured mesh, corner for another with indices or one colour per vertex";
            return Err(Error::invalid("layout", format!("{layout:?}"), wants));
        }
        let mut chunks = layout::bounds(asset);
        let mut pages = None;
        if let Some(texture) = mesh.texture.as_ref().filter(|_| layout == VertexLayout::Texture) {
            chunks = runs(mesh, texture, chunks);
            pages = Some(Pages::upload(gpu, &groups.page, texture, &chunks)?);
        }
        let indexed = !mesh.indices.is_empty() && pages.is_none();
        let vertices = match layout {
            VertexLayout::Corner => corners(gpu, mesh)?,
            VertexLayout::Face => {
                let at = |v: usize| mesh.positions[v].to_array();
                buffer::filled(gpu, "corners", BufferUsages::VERTEX, mesh.vertex_count(), at)?
            }
            VertexLayout::Texture => texture_corners(gpu, mesh)?,
        };
        let usage = BufferUsages::INDEX;
        let index = |i: usize| mesh.indices[i];
        let indices =
            indexed.then(|| buffer::filled(gpu, "indices", usage, mesh.indices.len(), index)).transpose()?;
        let mut bytes = vertices.size() + indices.as_ref().map_or(0, Buffer::size);
        bytes += pages.as_ref().map_or(0, |pages| pages.bytes);
        let faces = match &mesh.colors {
            Colors::Face(colors) if layout == VertexLayout::Face => {
                let (group, size) = face_group(gpu, &groups.faces, colors)?;
                bytes += size;
                Some(group)
            }
            _ => None,
        };
        Ok(Self { layout, bytes, chunks, vertices, indices, faces, pages })
    }

    /// Number of triangles.
    pub fn triangles(&self) -> u64 {
        self.chunks.iter().map(|(chunk, _)| u64::from(chunk.count)).sum()
    }

    /// The box around all chunks.
    pub fn bounds(&self) -> Aabb {
        self.chunks.iter().fold(Aabb::EMPTY, |all, (_, bounds)| all.union(*bounds))
    }

    /// The faces selected by `keep`, about `share` of all; the same ones for the same seed.
    pub fn subset(
        &self,
        gpu: &Gpu,
        mesh: &Mesh,
        share: f64,
        seed: u64,
        keep: impl Fn(u32) -> bool,
    ) -> Result<Subset> {
        let rng = Rng::new(seed, "random subset", 0);
        let (mut faces, mut ranges) = (Vec::new(), Vec::with_capacity(self.chunks.len()));
        for (chunk, _) in &self.chunks {
            let first = faces.len() as u32;
            let all = chunk.first..chunk.first + chunk.count;
            faces.extend(all.filter(|&face| rng.uniform_f64(face.into()) < share && keep(face)));
            ranges.push(first..faces.len() as u32);
        }
        let index = |i: usize| match self.pages {
            Some(_) => 3 * faces[i / 3] + (i % 3) as u32,
            None => mesh.face(faces[i / 3] as usize)[i % 3],
        };
        let indices = buffer::filled(gpu, "subset", BufferUsages::INDEX, 3 * faces.len(), index)?;
        Ok(Subset { indices, ranges })
    }

    /// The draw calls for the view of `camera`; with `per_chunk` one for every chunk.
    pub fn draw_calls(&self, camera: &Camera, near: f32, per_chunk: bool) -> Vec<DrawCall> {
        let frustum = Frustum::new(camera, near);
        let mut draws: Vec<DrawCall> = Vec::new();
        for (i, (chunk, bounds)) in self.chunks.iter().enumerate() {
            if chunk.count == 0 || !frustum.sees(bounds) {
                continue;
            }
            let faces = chunk.first..chunk.first + chunk.count;
            match draws.last_mut() {
                Some((run, last))
                    if run.end == faces.start && !per_chunk && self.page(*last) == self.page(i as u32) =>
                {
                    run.end = faces.end;
                }
                _ => draws.push((faces, i as u32)),
            }
        }
        draws
    }

    /// The page that a chunk is on.
    fn page(&self, chunk: u32) -> u16 {
        self.pages.as_ref().map_or(0, |pages| pages.page(chunk))
    }

    /// Draws with a pipeline of this model's layout; returns the number of triangles.
    pub fn draw(&self, pass: &mut RenderPass<'_>, draws: &[DrawCall]) -> u64 {
        self.bind(pass);
        for (faces, chunk) in draws {
            let corners = 3 * faces.start..3 * faces.end;
            self.pages.iter().for_each(|pages| pages.bind(pass, *chunk));
            match &self.indices {
                Some(_) => pass.draw_indexed(corners, 0, *chunk..chunk + 1),
                None => pass.draw(corners, *chunk..chunk + 1),
            }
        }
        draws.iter().map(|(faces, _)| u64::from(faces.end - faces.start)).sum()
    }

    /// Draws the faces of `subset` in the chunks of `draws`, one by one.
    pub fn draw_subset(&self, pass: &mut RenderPass<'_>, draws: &[DrawCall], subset: &Subset) -> u64 {
        self.bind(pass);
        pass.set_index_buffer(subset.indices.slice(..), IndexFormat::Uint32);
        let mut triangles = 0;
        for (_, chunk) in draws {
            let Some(faces) = subset.ranges.get(*chunk as usize) else { continue };
            self.pages.iter().for_each(|pages| pages.bind(pass, *chunk));
            pass.draw_indexed(3 * faces.start..3 * faces.end, 0, *chunk..chunk + 1);
            triangles += u64::from(faces.end - faces.start);
        }
        triangles
    }

    fn bind(&self, pass: &mut RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        if let Some(indices) = &self.indices {
            pass.set_index_buffer(indices.slice(..), IndexFormat::Uint32);
        }
        if let Some(faces) = &self.faces {
            pass.set_bind_group(1, faces, &[]);
        }
    }
}

/// Position and colour of every vertex, or of every corner with one colour per face.
fn corners(gpu: &Gpu, mesh: &Mesh) -> Result<Buffer> {
    let corner = |position: Vec3, linear| CornerVertex {
        position: position.to_array(),
        color: layout::pack_color(linear),
    };
    let usage = BufferUsages::VERTEX;
    match &mesh.colors {
        Colors::Vertex(colors) => buffer::filled(gpu, "corners", usage, mesh.vertex_count(), |v| {
            corner(mesh.positions[v], colors[v])
        }),
        Colors::Face(colors) if mesh.indices.is_empty() => {
            buffer::filled(gpu, "corners", usage, mesh.vertex_count(), |v| {
                corner(mesh.positions[v], colors[v / 3])
            })
        }
        Colors::Face(_) => {
            let wants = "one colour per vertex where there are indices (bake it first)";
            Err(Error::invalid("mesh colors", "one per face", wants))
        }
    }
}

/// Position and place on the picture of every corner.
fn texture_corners(gpu: &Gpu, mesh: &Mesh) -> Result<Buffer> {
    let uvs = mesh.texture.as_ref().map_or(&[][..], |texture| texture.uvs.as_flattened());
    buffer::filled(gpu, "corners", BufferUsages::VERTEX, uvs.len(), |corner| TextureVertex {
        position: mesh.positions[mesh.face(corner / 3)[corner % 3] as usize].to_array(),
        uv: uvs[corner].to_array(),
    })
}

/// The bind group of face colours, and its bytes.
fn face_group(gpu: &Gpu, groups: &BindGroupLayout, colors: &[[f32; 3]]) -> Result<(BindGroup, u64)> {
    let usage = BufferUsages::STORAGE;
    let colors = buffer::filled(gpu, "face colours", usage, colors.len(), |f| layout::pack_color(colors[f]))?;
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("faces"),
        layout: groups,
        entries: &[BindGroupEntry { binding: 0, resource: colors.as_entire_binding() }],
    });
    Ok((group, colors.size()))
}
