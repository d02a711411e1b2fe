//! The appearance of a primitive's faces: colours, opacity, sides, texture coordinates, spherical
//! harmonics.

use super::super::accessor;
use super::super::document::Primitive;
use super::super::material::GltfMaterial;
use super::{MergedMesh, PrimitiveFaces};
use crate::finish::PLAIN_COLOR;
use glam::{DMat3, DMat4, DVec3};
use trisplat_raster::kernel::sh::ShRotation;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::{Result, parallel};

/// Materials to choose from for a primitive.
const VARIANTS: &str = "KHR_materials_variants";
/// Cosine between the axes of a node from which it shears: rounded numbers stay below.
const MAX_SHEAR: f64 = 1e-4;

impl<'a> MergedMesh<'a> {
    /// Appends the colours of a primitive, one per face while all faces so far are flat.
    pub(super) fn read_colors(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        count: usize,
    ) -> Result<()> {
        let default = GltfMaterial::default();
        let given = self.material(primitive, place)?;
        self.unread.extend(given.into_iter().flat_map(GltfMaterial::unread));
        let material = given.unwrap_or(&default);
        if let Some(extension) = material.transmission() {
            self.warn(format!("{extension} is not read: glass becomes opaque"));
        }
        if primitive.extensions.contains_key(VARIANTS) {
            self.warn(format!("{VARIANTS} is not read: meshes have their default materials"));
        }
        let paint = material.paint();
        let [factor @ .., alpha] = paint.factor;
        if paint.emits_more {
            self.warn("light that materials emit is not added to their base colour");
        }
        let Some(accessor) = primitive.attributes.color else {
            if paint.texture.is_none() && !material.is_unlit() {
                self.warn(PLAIN_COLOR);
            }
            self.push_colors(vec![[1.0; 3]; count], part, false, factor);
            self.push_opacity(part, material, |_| alpha);
            return Ok(());
        };
        self.check_colors(accessor, place, count)?;
        let mut colors = vec![[0.0; 3]; count];
        if material.is_opaque() {
            self.accessors
                .for_each(accessor, 1.0, |i, c: [f64; 3]| colors[i] = c.map(|x| x as f32))?;
        } else {
            let mut alphas = vec![0.0; count];
            self.accessors.for_each(accessor, 1.0, |i, [r, g, b, a]| {
                colors[i] = [r, g, b].map(|x| x as f32);
                alphas[i] = a as f32;
            })?;
            let corner =
                |corner: usize| part.indices.as_ref().map_or(corner, |list| list[corner] as usize);
            let mean =
                |face: usize| (0..3).map(|j| alphas[corner(3 * face + j)]).sum::<f32>() / 3.0;
            self.push_opacity(part, material, |face| alpha * mean(face));
        }
        self.push_colors(colors, part, self.srgb || material.is_srgb(), factor);
        Ok(())
    }

    /// Texture coordinates of a primitive's faces, if textured.
    pub(super) fn read_texture(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        mirrored: bool,
    ) -> Result<()> {
        let Some(material) = self.material(primitive, place)? else { return Ok(()) };
        let Some(info) = material.paint().texture else { return Ok(()) };
        if !material.is_opaque() {
            self.warn(format!(
                "{place}: the alpha of its picture is not read: its triangles are drawn whole"
            ));
        }
        // Coordinates of a list were reversed with its faces.
        let reversed = mirrored && part.indices.is_none();
        let corner = |corner: usize| match &part.indices {
            Some(list) => list[corner] as usize,
            None if reversed => 3 * (corner / 3) + [0, 2, 1][corner % 3],
            None => corner,
        };
        let faces = self.faces..self.faces + part.faces;
        let attributes = &primitive.attributes;
        match accessor::painted_faces(
            self.document,
            &mut self.accessors,
            info,
            attributes,
            faces,
            corner,
        )? {
            Ok(painted) => self.painted.push(painted),
            Err(why) => self.warn(format!("{}: {place}: {why}", accessor::UNREAD)),
        }
        Ok(())
    }

    /// Spherical harmonics of a primitive's faces, if its material has some.
    pub(super) fn read_sh(
        &mut self,
        primitive: &Primitive,
        place: &str,
        part: &PrimitiveFaces,
        transform: Option<DMat4>,
    ) -> Result<()> {
        let Some(material) = self.material(primitive, place)? else { return Ok(()) };
        let Some(sh) = material.sh() else { return Ok(()) };
        let Some(rotation) = transform.map_or(Some(DMat3::IDENTITY), rotation_of) else {
            self.warn("view-dependent colours are not read where a node shears its mesh");
            return Ok(());
        };
        let corner =
            |corner: usize| part.indices.as_ref().map_or(corner, |list| list[corner] as usize);
        let document = self.document;
        let limits = self.limits;
        let found = accessor::harmonics(
            document,
            &mut self.accessors,
            sh,
            &primitive.attributes,
            part.faces,
            corner,
            &limits,
        )?;
        match found {
            Ok(mut found) => {
                ShRotation::turn_harmonics(&mut found, rotation);
                self.sh.push((self.faces, found));
            }
            Err(why) => self.warn(format!("view-dependent colours are not read: {place}: {why}")),
        }
        Ok(())
    }

    /// The material of a primitive; `None` when it names none.
    pub(super) fn material(
        &self,
        primitive: &Primitive,
        place: &str,
    ) -> Result<Option<&'a GltfMaterial>> {
        let materials = &self.document.materials;
        let Some(index) = primitive.material else { return Ok(None) };
        materials.get(index).map(Some).ok_or_else(|| {
            self.malformed(
                place,
                format!("has material {index}, but the file has {}", materials.len()),
            )
        })
    }

    /// Checks that an accessor holds a colour for each of `count` positions.
    fn check_colors(&mut self, accessor: usize, place: &str, count: usize) -> Result<()> {
        let layout = self.accessors.layout(accessor)?;
        if !layout.is_unit() || !(3..=4).contains(&layout.width) {
            return Err(self.malformed(
                place,
                "has a COLOR_0 that is not VEC3 or VEC4 of floats or normalised integers",
            ));
        }
        if layout.count != count as u64 {
            return Err(self
                .malformed(place, format!("has {count} positions and {} colours", layout.count)));
        }
        Ok(())
    }

    fn push_colors(
        &mut self,
        mut colors: Vec<[f32; 3]>,
        part: &PrimitiveFaces,
        srgb: bool,
        factor: [f32; 3],
    ) {
        let flat =
            part.indices.is_none() && colors.chunks_exact(3).all(|c| c[0] == c[1] && c[1] == c[2]);
        if !flat && self.flat {
            self.colors = self.colors.iter().flat_map(|&c| [c; 3]).collect();
            self.flat = false;
        }
        if self.flat {
            for face in 0..part.faces {
                colors[face] = colors[3 * face];
            }
            colors.truncate(part.faces);
        } else if part.indices.is_none() {
            colors.truncate(3 * part.faces);
        }
        let outside = |c: &[f32; 3]| !c.iter().all(|x| (0.0..=1.0).contains(x));
        let clamp = |c: &mut [f32; 3]| {
            let bad = outside(c);
            for (channel, factor) in c.iter_mut().zip(factor) {
                let light = unit(*channel);
                let light = if srgb { linear_from_srgb(light) } else { light };
                *channel = unit(light * factor);
            }
            usize::from(bad)
        };
        let parts = colors.chunks_mut(1 << 14);
        self.clamped += parallel::map(parts, |_, part| part.iter_mut().map(clamp).sum::<usize>())
            .iter()
            .sum::<usize>();
        self.colors.append(&mut colors);
    }

    /// Appends the opacity of a primitive's faces; the list stays empty while everything is opaque.
    fn push_opacity(
        &mut self,
        part: &PrimitiveFaces,
        material: &GltfMaterial,
        alpha: impl Fn(usize) -> f32,
    ) {
        if material.is_opaque() {
            return;
        }
        let cutoff = material.cutoff();
        self.mesh.opacity.resize(self.faces, 1.0);
        self.mesh.opacity.extend((0..part.faces).map(|face| {
            let alpha = unit(alpha(face));
            cutoff.map_or(alpha, |cutoff| f32::from(alpha >= cutoff))
        }));
    }

    /// Appends the sides of a primitive's faces; the list stays empty while everything is drawn
    /// from both.
    pub(super) fn push_sides(&mut self, part: &PrimitiveFaces, is_double_sided: bool) {
        if is_double_sided && self.mesh.single_sided.is_empty() {
            return;
        }
        self.mesh.single_sided.resize(self.faces, false);
        self.mesh.single_sided.resize(self.faces + part.faces, !is_double_sided);
    }
}

/// The rotation or reflection of a node that scales, then turns; `None` of one that shears.
fn rotation_of(transform: DMat4) -> Option<DMat3> {
    let linear = DMat3::from_mat4(transform);
    let axes = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.try_normalize());
    let [Some(x), Some(y), Some(z)] = axes else { return None };
    let is_right = |a: DVec3, b: DVec3| a.dot(b).abs() < MAX_SHEAR;
    (is_right(x, y) && is_right(y, z) && is_right(z, x)).then(|| DMat3::from_cols(x, y, z))
}

/// The nearest number in [0, 1]; 0 for NaN.
fn unit(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}
