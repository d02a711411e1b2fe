//! Gaussian splats in glTF: points with `KHR_gaussian_splatting`, as Khronos ratified it in 2026.
//!
//! Scales are linear, opacities no logits, rotations x y z w, and each coefficient of the spherical
//! harmonics has an attribute of its own.

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::compose;
use super::container::ContainerFile;
use super::document::{self, GltfDocument, MeshInstance, limited};
use crate::finish::{origin_of, sampled};
use crate::format::{self, GLTF_EXTENSION, SPZ_EXTENSION};
use crate::splats::{finish, spz, unit, zeroed};
use crate::{ReadOptions, Source};
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};
use gltf_json::mesh::POINTS;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use trisplat_scene::{Error, ImportedSplats, Limits, Result, Splats, input};

/// The supported colour space.
const COLORS: &str = "srgb_rec709_display";
/// Maximum difference of the lengths of a node's axes, as a share.
const MAX_AXIS_DIFFERENCE: f64 = 1e-3;

/// The primitives of a document, as far as Gaussians are concerned.
#[derive(Deserialize)]
struct SplatDocument {
    #[serde(default, deserialize_with = "limited")]
    meshes: Vec<SplatMesh>,
}

#[derive(Deserialize)]
struct SplatMesh {
    #[serde(default, deserialize_with = "limited")]
    primitives: Vec<SplatPrimitive>,
}

#[derive(Deserialize)]
struct SplatPrimitive {
    mode: Option<u32>,
    #[serde(default)]
    attributes: BTreeMap<String, usize>,
    #[serde(default)]
    extensions: SplatExtensions,
}

#[derive(Default, Deserialize)]
struct SplatExtensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    splatting: Option<Splatting>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Splatting {
    color_space: Option<String>,
    #[serde(default)]
    extensions: BTreeMap<String, Packing>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Packing {
    buffer_view: Option<usize>,
}

/// True when an open glTF file holds Gaussians and no triangles; false for a broken one. The file
/// is back at byte 0 afterwards.
pub fn holds_splats(source: &mut Source, limits: &Limits) -> Result<bool> {
    let [splats, all] = count_primitives(source, limits)?;
    Ok(splats > 0 && splats == all)
}

/// True when it holds Gaussians beside triangles.
pub fn holds_splats_beside_mesh(source: &mut Source, limits: &Limits) -> Result<bool> {
    let [splats, all] = count_primitives(source, limits)?;
    Ok(splats > 0 && splats < all)
}

/// Numbers of primitives that are Gaussians, and of all; zeros for a file without the extension.
fn count_primitives(source: &mut Source, limits: &Limits) -> Result<[usize; 2]> {
    let container = ContainerFile::read(source, limits);
    source.rewind()?;
    let Ok(container) = container else { return Ok([0; 2]) };
    // Few files name the extension, so few are parsed twice.
    if !container.json.windows(GLTF_EXTENSION.len()).any(|text| text == GLTF_EXTENSION.as_bytes()) {
        return Ok([0; 2]);
    }
    let document = document::parse::<SplatDocument>(&source.path, &container.json, limits);
    let Ok(document) = document else { return Ok([0; 2]) };
    let primitives = || document.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let splats = primitives().filter(|primitive| primitive.extensions.splatting.is_some());
    Ok([splats.count(), primitives().count()])
}

/// The Gaussians of the default scene, without triangles beside them.
///
/// # Errors
/// As for triangles; Gaussians that are compressed, of linear colours, or under nodes with uneven
/// scales.
pub fn read_splats(mut source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let path = source.path.clone();
    let limits = options.limits;
    let container = ContainerFile::read(&mut source, &limits)?;
    let document: GltfDocument = document::parse(&path, &container.json, &limits)?;
    let own: SplatDocument = document::parse(&path, &container.json, &limits)?;
    super::read::check_support(&path, &document)?;
    let instances = document::instances(&path, &document, &limits)?;
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    let mut reader = SplatReader {
        options: *options,
        path: &path,
        accessors: Accessors::new(&document, buffers),
        warnings: Vec::new(),
    };
    let parts = reader.parts(&own, &instances)?;
    let (splats, origin) = reader.splats(&parts)?;
    finish(&path, splats, compose::provenance(&document.asset), reader.warnings, origin)
}

/// The Gaussians of one primitive, and their node.
struct SplatInstance {
    place: String,
    splats: Splats,
    transform: DMat4,
    turn: DQuat,
    scale: f64,
}

struct SplatReader<'a> {
    options: ReadOptions,
    path: &'a Path,
    accessors: Accessors<'a>,
    warnings: Vec<String>,
}

impl SplatReader<'_> {
    fn parts(
        &mut self,
        document: &SplatDocument,
        instances: &[MeshInstance],
    ) -> Result<Vec<SplatInstance>> {
        let mut parts = Vec::new();
        for instance in instances {
            let Some(mesh) = document.meshes.get(instance.mesh) else {
                let reason = format!(
                    "shows mesh {}, but the file has {}",
                    instance.mesh,
                    document.meshes.len()
                );
                return Err(Error::malformed(self.path, format!("node {}", instance.node), reason));
            };
            let primitives = mesh.primitives.iter().enumerate();
            for (i, primitive) in
                primitives.filter(|(_, primitive)| primitive.extensions.splatting.is_some())
            {
                parts.push(self.part(
                    primitive,
                    format!("mesh {} primitive {i}", instance.mesh),
                    instance,
                )?);
            }
        }
        Ok(parts)
    }

    fn part(
        &mut self,
        primitive: &SplatPrimitive,
        place: String,
        instance: &MeshInstance,
    ) -> Result<SplatInstance> {
        let malformed = |reason: String| Error::malformed(self.path, place.clone(), reason);
        let unsupported = |what: String| Error::unsupported(self.path, format!("{place}: {what}"));
        if primitive.mode != Some(POINTS) {
            return Err(malformed("has Gaussians that are no points (`mode` 0)".to_owned()));
        }
        let splatting = primitive.extensions.splatting.as_ref();
        let packing = splatting.and_then(|s| s.extensions.first_key_value());
        if let Some((name, _)) = packing.filter(|(name, _)| format::is_draft(name)) {
            return Err(format::draft(self.path, name));
        }
        if let Some((name, _)) = packing.filter(|(name, _)| *name != SPZ_EXTENSION) {
            return Err(unsupported(format!(
                "its Gaussians need {name}; export them again without"
            )));
        }
        if let Some(other) =
            splatting.and_then(|s| s.color_space.as_deref()).filter(|name| *name != COLORS)
        {
            return Err(unsupported(format!(
                "its colours are {other}; export them again as {COLORS}"
            )));
        }
        let transform = instance.transform.unwrap_or(DMat4::IDENTITY);
        let axes = DMat3::from_mat4(transform);
        let size = axes.determinant().cbrt();
        let is_even = (axes.transpose() * axes).abs_diff_eq(
            DMat3::from_diagonal(DVec3::splat(size * size)),
            MAX_AXIS_DIFFERENCE * size * size,
        );
        if !(size > 0.0 && is_even) {
            let what = format!(
                "node {} mirrors it or scales its axes differently; apply the scale before the export",
                instance.node
            );
            return Err(unsupported(what));
        }
        let turn = DQuat::from_mat3(&(axes * size.recip()));
        let splats = match packing {
            Some((name, packing)) => {
                let view = packing.buffer_view;
                self.unpacked(view.ok_or_else(|| malformed(format!("{name} has no bufferView")))?)?
            }
            None => self.listed(primitive, &place)?,
        };
        Ok(SplatInstance { place, splats, transform, turn, scale: size })
    }

    /// The Gaussians in accessors, one for each of their numbers.
    fn listed(&mut self, primitive: &SplatPrimitive, place: &str) -> Result<Splats> {
        let accessor = |name: &str| primitive.attributes.get(name).copied();
        let own = |name: &str| accessor(&format!("{GLTF_EXTENSION}:{name}"));
        let basic = [
            accessor("POSITION"),
            own("ROTATION"),
            own("SCALE"),
            own("OPACITY"),
            own("SH_DEGREE_0_COEF_0"),
        ];
        if ["_ROTATION", "_SCALE"].iter().all(|name| accessor(name).is_some()) {
            return Err(format::draft(self.path, "attributes _ROTATION and _SCALE"));
        }
        let [Some(position), Some(rotation), Some(scale), Some(opacity), Some(first)] = basic
        else {
            let wants =
                "POSITION and, of the extension, ROTATION, SCALE, OPACITY and SH_DEGREE_0_COEF_0";
            let reason = format!("lacks an attribute; expected {wants}");
            return Err(Error::malformed(self.path, place, reason));
        };
        let mut sh = vec![first];
        for degree in 1..=3 {
            let all = (0..2 * degree + 1).map(|n| own(&format!("SH_DEGREE_{degree}_COEF_{n}")));
            match all.collect::<Option<Vec<usize>>>() {
                Some(all) => sh.extend(all),
                None => break,
            }
        }
        let basic = [(position, 3), (rotation, 4), (scale, 3), (opacity, 1)];
        let count = self.check(place, basic.into_iter().chain(sh.iter().map(|i| (*i, 3))))?;
        let degree = (sh.len().isqrt() as u8 - 1).min(self.options.sh_degree);
        let mut splats = zeroed(self.path, count, degree, &self.options.limits)?;
        let k = splats.sh_count();
        let all = &mut self.accessors;
        let single = |numbers: [f64; 3]| DVec3::from(numbers).as_vec3();
        all.for_each(position, 0.0, |i, at| splats.positions[i] = single(at))?;
        all.for_each(rotation, 0.0, |i, q| splats.rotations[i] = DQuat::from_array(q).as_quat())?;
        all.for_each(scale, 0.0, |i, lengths| splats.scales[i] = single(lengths))?;
        all.for_each(opacity, 0.0, |i, [value]| splats.opacity[i] = value as f32)?;
        for (j, coefficient) in sh[..k].iter().enumerate() {
            all.for_each(*coefficient, 0.0, |i, rgb| {
                splats.sh[i * k + j] = single(rgb).to_array()
            })?;
        }
        Ok(splats)
    }

    /// The Gaussians of an SPZ file in a buffer view.
    fn unpacked(&mut self, view: usize) -> Result<Splats> {
        let path = self.path.to_owned();
        let limits = &self.options.limits;
        let (file, len) = input::spool(&path, &mut &*self.accessors.view_bytes(view)?, limits)?;
        let loaded = spz::read(Source { path, file: Arc::new(file), len }, &self.options)?;
        self.warnings.extend(loaded.warnings);
        Ok(loaded.splats)
    }

    /// The number of elements that all of these accessors have. Each comes with its number of
    /// components.
    fn check(
        &mut self,
        place: &str,
        accessors: impl Iterator<Item = (usize, u64)>,
    ) -> Result<usize> {
        let mut count = None;
        for (accessor, width) in accessors {
            let layout = self.accessors.layout(accessor)?;
            let count = *count.get_or_insert(layout.count);
            if layout.count != count || layout.width != width {
                let found = layout.count;
                let has = layout.width;
                let reason = format!(
                    "has {found} elements of {has} numbers in accessor {accessor}; expected {count} of {width}"
                );
                return Err(Error::malformed(self.path, place, reason));
            }
            self.accessors.buffers.spend(count.saturating_mul(4 * width))?;
        }
        Ok(count.unwrap_or(0) as usize)
    }

    /// All of them, and the origin that was subtracted from their positions.
    fn splats(&mut self, parts: &[SplatInstance]) -> Result<(Splats, DVec3)> {
        let limits = self.options.limits;
        let total = parts.iter().fold(0usize, |sum, part| sum.saturating_add(part.splats.len()));
        let degree = parts.iter().map(|part| part.splats.sh_degree).max().unwrap_or(0);
        let mut splats = zeroed(self.path, total, degree, &limits)?;
        let k = splats.sh_count();
        let mut positions: Vec<DVec3> = limits.zeroed(self.path.display(), total)?;
        let mut at = 0;
        for SplatInstance { place, splats: own, transform, turn, scale } in parts {
            let is_turned = turn.w.abs() < 1.0 - f64::EPSILON;
            let coefficients = own.sh_count();
            let drawn = if is_turned { 1 } else { coefficients };
            if drawn < coefficients {
                let warning =
                    format!("{place}: a node turns it, so its colours are the same from all sides");
                self.warnings.push(warning);
            }
            for i in 0..own.len() {
                positions[at] = transform.transform_point3(own.positions[i].as_dvec3());
                let [x, y, z, w] = DVec4::from(*turn * own.rotations[i].as_dquat()).to_array();
                splats.rotations[at] = unit([w, x, y, z]);
                splats.scales[at] = (own.scales[i].as_dvec3() * *scale).as_vec3();
                splats.opacity[at] = own.opacity[i];
                splats.sh[at * k..at * k + drawn]
                    .copy_from_slice(&own.sh[i * coefficients..][..drawn]);
                at += 1;
            }
            splats.filter = own.filter;
        }
        let origin = origin_of(sampled(total).map(|i| positions[i]).collect());
        for (to, position) in splats.positions.iter_mut().zip(&positions) {
            *to = (*position - origin).as_vec3();
        }
        Ok((splats, origin))
    }
}
