//! USDZ, which phones show in a room: one mesh as text (`usda`) and the picture of its texture in a
//! zip archive, written only.
//!
//! After the specifications of USD's text form, UsdPreviewSurface and USDZ (openusd.org): nothing
//! is compressed, and the bytes of every file begin at a multiple of 64.

use crate::lines::{push_float, push_integer, write_blocks};
use glam::Vec2;
use std::io::{self, Cursor, Write};
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::generator;
use trisplat_scene::{Asset, FaceTexture};
use zip::write::{SimpleFileOptions, ZipWriter};

/// Alignment of the bytes of each file in the archive.
const ALIGNMENT: u16 = 64;
/// The name of the scene in its archive.
const LAYER: &str = "scene.usda";
/// Emissive surface: the photos' light is baked in.
const UNLIT: &str = "                color3f inputs:diffuseColor = (0, 0, 0)
                color3f inputs:specularColor = (0, 0, 0)
                int inputs:useSpecularWorkflow = 1
                color3f inputs:emissiveColor.connect = ";
/// The surface in the light of the room.
const LIT: &str = "                color3f inputs:diffuseColor.connect = ";

/// Writes an asset, whose texture is the file `picture` of that name, as its mesh without levels.
///
/// # Errors
///
/// Errors of `out`.
pub(crate) fn write(
    out: &mut dyn Write,
    picture: Option<(&str, &[u8])>,
    asset: &Asset,
) -> io::Result<()> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .with_alignment(ALIGNMENT);
    // The first file of an archive is its scene.
    zip.start_file(LAYER, stored)?;
    write_layer(&mut zip, picture.map(|(name, _)| name), &asset.mesh)?;
    if let Some((name, bytes)) = picture {
        zip.start_file(name, stored)?;
        zip.write_all(bytes)?;
    }
    out.write_all(zip.finish()?.get_ref())
}

/// The scene as text.
fn write_layer(out: &mut dyn Write, picture: Option<&str>, mesh: &Mesh) -> io::Result<()> {
    writeln!(
        out,
        "#usda 1.0\n(\n    defaultPrim = \"scene\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n    customLayerData = {{\n        \
         string generator = \"{}\"\n    }}\n)\n",
        generator()
    )?;
    writeln!(out, "def Xform \"scene\" (\n    kind = \"component\"\n)\n{{")?;
    let texture = mesh.texture.as_ref().filter(|_| picture.is_some()).map(FaceTexture::joined);
    if mesh.single_sided.is_empty() {
        write_mesh(out, mesh, texture.as_ref(), "triangles", false)?;
    } else {
        let whole = Mesh { texture, ..mesh.clone() };
        for (name, single_sided) in [("triangles", false), ("triangles_front", true)] {
            let faces = (0..whole.face_count() as u32)
                .filter(|face| whole.is_single_sided(*face as usize) == single_sided);
            let part = whole.part(&faces.collect::<Vec<_>>());
            if part.face_count() > 0 {
                write_mesh(out, &part, part.texture.as_ref(), name, single_sided)?;
            }
        }
    }
    write_material(out, picture, !mesh.normals.is_empty())?;
    writeln!(out, "}}")
}

/// Writes a mesh of this name, drawn from its front only or from both sides.
fn write_mesh(
    out: &mut dyn Write,
    mesh: &Mesh,
    texture: Option<&FaceTexture>,
    name: &str,
    single_sided: bool,
) -> io::Result<()> {
    let faces = mesh.face_count();
    writeln!(
        out,
        "    def Mesh \"{name}\" (\n        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{"
    )?;
    let sides = u8::from(!single_sided);
    writeln!(
        out,
        "        uniform bool doubleSided = {sides}\n        uniform token subdivisionScheme = \"none\""
    )?;
    writeln!(out, "        rel material:binding = </scene/material>")?;
    let corners = (0..faces).flat_map(|face| mesh.corners(face));
    let extent = bounds(corners).unwrap_or_default();
    list(out, "float3[] extent", "", 2, |i, block| push_tuple(block, &extent[i].to_array()))?;
    list(out, "int[] faceVertexCounts", "", faces, |_, block| block.push(b'3'))?;
    list(out, "int[] faceVertexIndices", "", 3 * faces, |i, block| {
        push_integer(block, u64::from(mesh.face(i / 3)[i % 3]));
    })?;
    list(out, "point3f[] points", "", mesh.vertex_count(), |v, block| {
        push_tuple(block, &mesh.positions[v].to_array());
    })?;
    list(out, "normal3f[] normals", "uniform", mesh.normals.len(), |face, block| {
        push_tuple(block, &mesh.normals[face].to_array());
    })?;
    match (texture, &mesh.colors) {
        (Some(texture), _) => {
            let uvs = texture.uvs.as_flattened();
            list(out, "texCoord2f[] primvars:st", "faceVarying", uvs.len(), |i, block| {
                let Vec2 { x, y } = uvs[i];
                // From the lower left.
                push_tuple(block, &[x, 1.0 - y]);
            })?;
        }
        (None, Colors::Vertex(colors)) => {
            list(out, COLORS, "vertex", colors.len(), |i, block| push_tuple(block, &colors[i]))?;
        }
        (None, Colors::Face(colors)) => {
            list(out, COLORS, "uniform", colors.len(), |i, block| push_tuple(block, &colors[i]))?;
        }
    }
    writeln!(out, "    }}\n")
}

/// Linear colours, as everywhere in USD.
const COLORS: &str = "color3f[] primvars:displayColor";

/// A surface that shows the picture, or the colours of the mesh.
fn write_material(out: &mut dyn Write, picture: Option<&str>, lit: bool) -> io::Result<()> {
    let surface = if lit { LIT } else { UNLIT };
    let output = if picture.is_some() { "rgb" } else { "result" };
    writeln!(
        out,
        "    def Material \"material\"\n    {{\n        token outputs:surface.connect = </scene/material/surface.outputs:surface>\n\n        \
         def Shader \"surface\"\n        {{\n                uniform token info:id = \"UsdPreviewSurface\"\n\
         {surface}</scene/material/color.outputs:{output}>\n                float inputs:roughness = 1\n                \
         token outputs:surface\n        }}\n"
    )?;
    match picture {
        Some(name) => writeln!(
            out,
            "        def Shader \"color\"\n        {{\n                uniform token info:id = \"UsdUVTexture\"\n                \
             asset inputs:file = @{name}@\n                float2 inputs:st.connect = </scene/material/places.outputs:result>\n                \
             token inputs:sourceColorSpace = \"sRGB\"\n                token inputs:wrapS = \"clamp\"\n                \
             token inputs:wrapT = \"clamp\"\n                float3 outputs:rgb\n        }}\n\n        \
             def Shader \"places\"\n        {{\n                uniform token info:id = \"UsdPrimvarReader_float2\"\n                \
             string inputs:varname = \"st\"\n                float2 outputs:result\n        }}"
        )?,
        None => writeln!(
            out,
            "        def Shader \"color\"\n        {{\n                uniform token info:id = \"UsdPrimvarReader_float3\"\n                \
             string inputs:varname = \"displayColor\"\n                float3 outputs:result\n        }}"
        )?,
    }
    writeln!(out, "    }}")
}

/// A primvar array of `count` values; nothing if empty.
fn list(
    out: &mut dyn Write,
    name: &str,
    interpolation: &str,
    count: usize,
    push: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    if count == 0 {
        return Ok(());
    }
    write!(out, "        {name} = [")?;
    write_blocks(out, count, |i, block| {
        if i > 0 {
            block.extend_from_slice(b", ");
        }
        push(i, block);
    })?;
    match interpolation {
        "" => writeln!(out, "]"),
        per => writeln!(out, "] (\n            interpolation = \"{per}\"\n        )"),
    }
}

fn push_tuple(block: &mut Vec<u8>, values: &[f32]) {
    block.push(b'(');
    for (i, &value) in values.iter().enumerate() {
        if i > 0 {
            block.extend_from_slice(b", ");
        }
        push_float(block, value);
    }
    block.push(b')');
}
