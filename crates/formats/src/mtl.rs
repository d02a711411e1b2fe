//! The materials of an OBJ: the pictures or colours of its faces.

use crate::faces::mean;
use crate::finish::PLAIN_COLOR;
use crate::lines::{LineReader, as_utf8};
use crate::{ReadOptions, Source};
use glam::Vec2;
use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::atlas::{PaintedFaces, Wrap, paint};
use trisplat_scene::atomic::FileId;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Error, Limits, Result, Texture, excerpt, first_of, input};

/// Maximum number of libraries of a file; each is read whole.
const MAX_LIBRARIES: usize = 64;

/// Maximum number of last parts of a path of another machine that are searched.
const MAX_PARTS: usize = 8;

/// Maximum number of entries of a folder that are searched for folders.
const MAX_ENTRIES: usize = 256;

/// Maximum number of materials that a warning names.
const MAX_NAMED: usize = 8;

/// Keywords of pictures that do not begin with `map_`.
const OTHER_PICTURES: [&str; 5] = ["bump", "disp", "decal", "refl", "norm"];

/// A material of a library.
#[derive(Debug, Clone, Default, PartialEq)]
struct MtlMaterial {
    /// sRGB-encoded.
    color: Option<[f32; 3]>,
    picture: Option<MaterialPicture>,
    /// `Ke`, the light that it emits, sRGB-encoded.
    light: Option<[f32; 3]>,
    /// `map_Ke`.
    light_picture: Option<MaterialPicture>,
    /// Its keyword and value of alpha, if it is not opaque.
    alpha: Option<String>,
}

impl MtlMaterial {
    /// The colour that is seen, and the picture that it multiplies: of a black surface, as of a
    /// screen or a lamp, the light that it emits.
    fn paint(&self) -> (Option<[f32; 3]>, Option<&MaterialPicture>) {
        let light = self.light.filter(|light| light.iter().any(|channel| *channel > 0.0));
        let is_black = self.color == Some([0.0; 3]) && self.picture.is_none();
        if is_black && (light.is_some() || self.light_picture.is_some()) {
            return (light.or(Some([1.0; 3])), self.light_picture.as_ref());
        }
        (self.color, self.picture.as_ref())
    }
}

/// `map_Kd` with its options.
#[derive(Debug, Clone, Default, PartialEq)]
struct MaterialPicture {
    name: String,
    /// Factor of texture coordinates, from the lower left corner.
    scale: Option<Vec2>,
    /// Added to the scaled texture coordinates.
    offset: Vec2,
    wrap: Wrap,
}

impl MaterialPicture {
    /// A place from the upper left corner, from coordinates that have their origin there too.
    fn place(&self, at: Vec2) -> Vec2 {
        let Some(scale) = self.scale else {
            return Vec2::new(at.x + self.offset.x, at.y - self.offset.y);
        };
        let up = Vec2::new(at.x, 1.0 - at.y) * scale + self.offset;
        Vec2::new(up.x, 1.0 - up.y)
    }
}

/// Materials, and the faces that have them.
#[derive(Debug, Default)]
pub(crate) struct Materials {
    libraries: Vec<String>,
    names: Vec<String>,
    numbers: BTreeMap<String, usize>,
    /// Number of the next face's material.
    current: u32,
    /// Numbers of the faces' materials; empty without materials. `[F]`
    pub(crate) of_face: Vec<u32>,
}

/// Material number of faces before the first material.
const NO_MATERIAL: u32 = u32::MAX;

impl Materials {
    /// `mtllib NAME...`: names may be quoted, and hold spaces.
    pub(crate) fn library(&mut self, names: &str) {
        for name in library_names(names) {
            if self.libraries.len() < MAX_LIBRARIES && !self.libraries.contains(&name) {
                self.libraries.push(name);
            }
        }
    }

    /// `usemtl NAME`, behind `faces` faces.
    pub(crate) fn begin(&mut self, name: &str, faces: usize) {
        let name = unquoted(name);
        if self.names.is_empty() {
            self.of_face.resize(faces, NO_MATERIAL);
        }
        let next = self.names.len();
        let number = *self.numbers.entry(name.to_owned()).or_insert(next);
        if number == next {
            self.names.push(name.to_owned());
        }
        self.current = number as u32;
    }

    /// One more face.
    pub(crate) fn add_face(&mut self) {
        if !self.names.is_empty() {
            self.of_face.push(self.current);
        }
    }

    /// Gives `mesh` the pictures of its materials, with the given texture coordinates, and their
    /// colours if it has none. Returns whether any material had a colour or picture. Materials are
    /// per triangle. `[F]`
    pub(crate) fn apply(
        &self,
        mesh: &mut Mesh,
        uvs: &[[Vec2; 3]],
        path: &Path,
        options: &ReadOptions,
        warnings: &mut Vec<String>,
    ) -> bool {
        let libraries = self.read(path, options, warnings);
        let materials = self.find_materials(&libraries, warnings);
        if !materials.iter().flatten().any(|material| **material != MtlMaterial::default()) {
            return false;
        }
        warnings.extend(self.alpha_warning(&materials));
        let is_colored = matches!(&mesh.colors, Colors::Vertex(colors) if !colors.is_empty());
        let mut textures = MaterialTextures::default();
        let mut painted = Vec::new();
        let mut colors = if is_colored {
            (0..mesh.face_count()).map(|face| mean(mesh.corner_colors(face))).collect()
        } else {
            vec![[1.0f32; 3]; mesh.face_count()]
        };
        let mut has_plain_color = false;
        let mut end = 0;
        for run in self.of_face.chunk_by(|a, b| a == b) {
            let faces = end..end + run.len();
            let number = run[0] as usize;
            end += run.len();
            let Some(Some(material)) = materials.get(number) else { continue };
            let (color, picture_of) = material.paint();
            let color = color.unwrap_or([1.0; 3]);
            let light = color.map(|c| linear_from_srgb(c.clamp(0.0, 1.0)));
            if !is_colored {
                colors[faces.clone()].fill(light);
            }
            let Some(stored) = picture_of else {
                has_plain_color |= !is_colored;
                continue;
            };
            let image = textures.number(path, &stored.name, options);
            let texture = textures.textures.entry(image).or_insert_with(|| {
                let read = if uvs.is_empty() {
                    Err(Error::unsupported(path, "its faces have no texture coordinates"))
                } else {
                    picture(path, &stored.name, options)
                };
                let name = excerpt(&self.names[number]);
                let unread =
                    "a texture is not read, its triangles have the colour of their material";
                read.map_err(|e| warnings.push(format!("{unread}: {name}: {e}"))).ok()
            });
            if texture.is_none() {
                continue;
            }
            // Many programs write black beside a picture, and draw the picture alone.
            colors[faces.clone()].fill(if color == [0.0; 3] { [1.0; 3] } else { light });
            let uvs = uvs[faces.clone()].iter().map(|uvs| uvs.map(|uv| stored.place(uv))).collect();
            painted.push(PaintedFaces {
                image,
                faces,
                uvs,
                wrap: [stored.wrap; 2],
                filter: Default::default(),
            });
        }
        if !is_colored || !painted.is_empty() {
            warnings.extend(has_colors(mesh).then(|| OVER_COLORS.to_owned()));
            mesh.colors = Colors::Face(colors);
        }
        warnings.extend(paint(mesh, painted, &textures.textures));
        warnings.extend(has_plain_color.then(|| PLAIN_COLOR.to_owned()));
        true
    }

    /// The warning about materials with alpha, which is not read.
    fn alpha_warning(&self, materials: &[Option<&MtlMaterial>]) -> Option<String> {
        let of_name = |(name, material): (&String, &Option<&MtlMaterial>)| {
            let alpha = material.as_ref()?.alpha.as_ref()?;
            Some(format!("{} ({alpha})", excerpt(name)))
        };
        let named: Vec<String> = self.names.iter().zip(materials).filter_map(of_name).collect();
        (!named.is_empty()).then(|| {
            format!(
                "the alpha of materials is not read, their triangles are drawn whole: {}",
                first_of(named.into_iter(), MAX_NAMED)
            )
        })
    }

    /// The material of each name that faces use, or of a name that differs in case only; a warning
    /// counts missing ones.
    fn find_materials<'m>(
        &self,
        libraries: &'m BTreeMap<String, MtlMaterial>,
        warnings: &mut Vec<String>,
    ) -> Vec<Option<&'m MtlMaterial>> {
        let mut in_any_case = BTreeMap::new();
        for (name, material) in libraries {
            in_any_case.entry(name.to_ascii_lowercase()).or_insert(material);
        }
        let of_name = |name: &String| {
            let exact = libraries.get(name);
            exact.or_else(|| in_any_case.get(&name.to_ascii_lowercase()).copied())
        };
        let materials: Vec<Option<&MtlMaterial>> = self.names.iter().map(of_name).collect();
        let missing = self.names.iter().zip(&materials).filter(|(_, material)| material.is_none());
        let missing: Vec<&str> = missing.map(|(name, _)| name.as_str()).collect();
        if !libraries.is_empty() && !missing.is_empty() {
            let names = missing.iter().map(|name| excerpt(name));
            warnings.push(format!(
                "materials that no library has, their triangles are white: {}",
                first_of(names, MAX_NAMED)
            ));
        }
        materials
    }

    /// The materials of all libraries, by name.
    fn read(
        &self,
        path: &Path,
        options: &ReadOptions,
        warnings: &mut Vec<String>,
    ) -> BTreeMap<String, MtlMaterial> {
        let mut materials = BTreeMap::new();
        for name in &self.libraries {
            let read = resolve(path, name, options)
                .and_then(|file| library(&file, options, &mut materials));
            if let Err(error) = read {
                warnings
                    .push(format!("materials are not read, their triangles are white: {error}"));
            }
        }
        materials
    }
}

/// The pictures of materials, each read once, however many materials name it and by whichever
/// names.
#[derive(Debug, Default)]
struct MaterialTextures {
    numbers: BTreeMap<String, usize>,
    files: HashMap<FileId, usize>,
    /// By number; none if it could not be read.
    textures: BTreeMap<usize, Option<Arc<Texture>>>,
}

impl MaterialTextures {
    /// Return the number of the picture that the OBJ at `path` calls `name`.
    fn number(&mut self, path: &Path, name: &str, options: &ReadOptions) -> usize {
        if let Some(number) = self.numbers.get(name) {
            return *number;
        }
        let mut number = self.numbers.len();
        // A missing file is refused under each of its names.
        if let Ok(file) = resolve(path, name, options) {
            number = *self.files.entry(FileId::of(&file)).or_insert(number);
        }
        self.numbers.insert(name.to_owned(), number);
        number
    }
}

/// The libraries that an OBJ names, and the pictures that these name.
pub fn named_files(source: &Source, limits: &Limits) -> Result<Vec<PathBuf>> {
    let options = ReadOptions { limits: *limits, allow_outside: true, ..ReadOptions::default() };
    let source = &as_utf8(source, limits)?;
    let mut lines = LineReader::new(source)?;
    let mut materials = Materials::default();
    while lines.advance()? {
        if lines.words().next() == Some("mtllib") {
            materials.library(lines.rest());
        }
    }
    let mut files = Vec::new();
    for name in &materials.libraries {
        let Ok(library) = resolve(&source.path, name, &options) else { continue };
        // One that cannot be read names nothing.
        let pictures = pictures(&library, &options).unwrap_or_default();
        files.push(library);
        files.extend(pictures.iter().filter_map(|name| resolve(&source.path, name, &options).ok()));
    }
    Ok(files)
}

/// The names of all pictures in a library, also of kinds that are not read: of bumps, reflections
/// and so on.
fn pictures(library: &Path, options: &ReadOptions) -> Result<Vec<String>> {
    let source = as_utf8(&Source::open(library, &options.limits)?, &options.limits)?;
    let mut lines = LineReader::new(&source)?;
    let mut names = Vec::new();
    while lines.advance_to_text()? {
        let keyword = lines.words().next().unwrap_or_default().to_ascii_lowercase();
        if keyword.starts_with("map_") || OTHER_PICTURES.contains(&keyword.as_str()) {
            names.push(parse_picture(lines.rest()).name);
        }
    }
    Ok(names)
}

/// Resolve the path of a file that the OBJ or PLY at `path` names, or of one whose name differs in
/// case only. A missing file, such as `C:\maps\wall.png` of another machine, is searched beside it
/// by the end of its path.
pub(crate) fn resolve(path: &Path, name: &str, options: &ReadOptions) -> Result<PathBuf> {
    let refuse = |why: &str| Err(Error::unsupported(path, format!("it names {name:?}, {why}")));
    if path.as_os_str() == "-" {
        return refuse("which standard input cannot reach; give the file by name");
    }
    // Some programs write Windows separators.
    let relative = PathBuf::from(unquoted(name).replace('\\', "/"));
    let folder = path.parent().unwrap_or(Path::new(""));
    let outside = relative.is_absolute() || name.contains(':') || input::leaves_folder(&relative);
    if !outside || options.allow_outside {
        let there = in_any_case(folder, &relative);
        if there.is_file() {
            return Ok(there);
        }
    }
    if let Some(file) = by_end(folder, &relative) {
        return Ok(file);
    }
    let is_elsewhere = cfg!(not(windows)) && name.contains([':', '\\']);
    match (outside, options.allow_outside || is_elsewhere) {
        (true, true) => {
            refuse("which is not there and not beside the file; copy it beside the file")
        }
        (true, false) => refuse(
            "outside the folder of the file; copy it beside the file, or give `allow_outside`",
        ),
        (false, _) => Ok(in_any_case(folder, &relative)),
    }
}

/// The file in `folder` with the longest end of the path `relative`, in any case; else the only one
/// of its name in a folder there.
fn by_end(folder: &Path, relative: &Path) -> Option<PathBuf> {
    let is_name = |part: &Component| matches!(part, Component::Normal(_));
    let parts: Vec<Component> = relative.components().filter(is_name).collect();
    let ends = (parts.len().saturating_sub(MAX_PARTS)..parts.len())
        .map(|first| parts[first..].iter().collect::<PathBuf>());
    let own = ends.map(|end| in_any_case(folder, &end)).find(|file| file.is_file());
    own.or_else(|| {
        let name = Path::new(relative.file_name()?);
        let folders = input::entries(folder).take(MAX_ENTRIES).filter(|entry| entry.is_dir());
        let inside = folders.map(|inner| in_any_case(&inner, name)).filter(|file| file.is_file());
        let found: Vec<PathBuf> = inside.take(2).collect();
        <[PathBuf; 1]>::try_from(found).ok().map(|[only]| only)
    })
}

/// The path of `relative` in `folder`, with the case that its parts have on disk where they exist
/// in another.
fn in_any_case(folder: &Path, relative: &Path) -> PathBuf {
    let mut path = folder.to_owned();
    for part in relative.components() {
        let exact = path.join(part);
        let wanted = part.as_os_str().to_string_lossy().to_lowercase();
        let name =
            |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let alike = || input::entries(&path).filter(|path| name(path) == wanted).min();
        path = if exact.exists() { exact } else { alike().unwrap_or(exact) };
    }
    path
}

/// The names in a `mtllib` line. A name ends with its quote, or with `.mtl`.
fn library_names(text: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() && names.len() < MAX_LIBRARIES {
        let lower = rest.to_ascii_lowercase();
        let quoted = rest.strip_prefix('"').and_then(|inner| inner.split_once('"'));
        let end = lower.match_indices(".mtl").map(|(at, ending)| at + ending.len());
        let end = end.into_iter().find(|end| rest[*end..].starts_with(char::is_whitespace));
        let (name, after) = quoted.unwrap_or_else(|| rest.split_at(end.unwrap_or(rest.len())));
        names.push(name.trim().to_owned());
        rest = after.trim_start();
    }
    names.retain(|name| !name.is_empty());
    names
}

/// A name without the quotes around it.
fn unquoted(name: &str) -> &str {
    name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name)
}

fn library(
    path: &Path,
    options: &ReadOptions,
    materials: &mut BTreeMap<String, MtlMaterial>,
) -> Result<()> {
    let source = as_utf8(&Source::open(path, &options.limits)?, &options.limits)?;
    let mut lines = LineReader::new(&source)?;
    let mut name = None;
    while lines.advance_to_text()? {
        let mut words = lines.words();
        let Some(keyword) = words.next() else { continue };
        let rest = lines.rest();
        if keyword == "newmtl" {
            materials.entry(unquoted(rest).to_owned()).or_default();
            name = Some(unquoted(rest).to_owned());
        }
        let Some(material) = name.as_ref().and_then(|name| materials.get_mut(name)) else {
            continue;
        };
        let finite = words.filter_map(|word| word.parse().ok()).filter(|x: &f32| x.is_finite());
        let numbers: Vec<f32> = finite.collect();
        match keyword.to_ascii_lowercase().as_str() {
            "kd" => material.color = numbers.try_into().ok(),
            "ke" => material.light = numbers.try_into().ok(),
            "map_kd" => material.picture = Some(parse_picture(rest)),
            "map_ke" => material.light_picture = Some(parse_picture(rest)),
            // Its letter o is `-halo`, whose number is no alpha.
            "d" if numbers.first().is_some_and(|alpha| *alpha < 1.0) => {
                material.alpha.get_or_insert(format!("d {}", numbers[0]));
            }
            "tr" if numbers.first().is_some_and(|part| *part > 0.0 && *part < 1.0) => {
                material.alpha.get_or_insert(format!("Tr {}", numbers[0]));
            }
            "map_d" | "map_opacity" | "map_tr" => material.alpha = Some(excerpt(keyword)),
            _ => {}
        }
    }
    Ok(())
}

/// A picture after options such as `-clamp on` and `-s 1 1 1`; its name may hold spaces.
fn parse_picture(text: &str) -> MaterialPicture {
    let mut picture = MaterialPicture::default();
    let mut rest = text.trim();
    while let Some((option, after)) =
        rest.strip_prefix('-').and_then(|_| rest.split_once(char::is_whitespace))
    {
        rest = after.trim_start();
        let mut numbers = Vec::new();
        let mut word = "";
        let takes_numbers = matches!(option, "-s" | "-o" | "-t" | "-mm");
        for _ in 0..if takes_numbers { 3 } else { 1 } {
            let Some((next, after)) = rest.split_once(char::is_whitespace) else { break };
            let number = next.parse::<f32>().ok().filter(|number| number.is_finite());
            if takes_numbers && number.is_none() {
                break;
            }
            numbers.extend(number);
            word = next;
            rest = after.trim_start();
        }
        let pair = |other: f32| {
            Vec2::new(
                numbers.first().copied().unwrap_or(other),
                numbers.get(1).copied().unwrap_or(other),
            )
        };
        match option {
            "-s" => picture.scale = Some(pair(1.0)),
            "-o" => picture.offset = pair(0.0),
            "-clamp" if word == "on" => picture.wrap = Wrap::Clamp,
            _ => {}
        }
    }
    picture.name = unquoted(rest).to_owned();
    picture
}

/// The warning about colours of vertices or faces beside a picture: programs that write both draw
/// the picture alone.
pub(crate) const OVER_COLORS: &str =
    "faces with a picture show it without the colours that the file has too";

/// True when a mesh has colours other than white.
pub(crate) fn has_colors(mesh: &Mesh) -> bool {
    let (Colors::Vertex(colors) | Colors::Face(colors)) = &mesh.colors;
    colors.iter().any(|color| *color != [1.0; 3])
}

/// The texture that a file names.
pub(crate) fn picture(path: &Path, name: &str, options: &ReadOptions) -> Result<Arc<Texture>> {
    let file = resolve(path, name, options)?;
    let bytes = input::read_large(&file, &options.limits, |_, _| Ok(()))?;
    Ok(Arc::new(Texture::decoded(&file, &bytes, &options.limits)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_picture_stands_behind_its_options() {
        for (text, name) in [
            ("wall.jpg", "wall.jpg"),
            ("-clamp on my wall.jpg", "my wall.jpg"),
            ("-s 1 1 1 -o 0 0 wall.jpg", "wall.jpg"),
            ("-bm 0.5 -blendu off a/b.png", "a/b.png"),
            ("-s 2 \"a b.png\"", "a b.png"),
        ] {
            assert_eq!(parse_picture(text).name, name, "{text}");
        }
        let moved = parse_picture("-clamp on -s 2 3 1 -o 0.5 a.png");
        assert_eq!(
            (moved.scale, moved.offset, moved.wrap),
            (Some(Vec2::new(2.0, 3.0)), Vec2::new(0.5, 0.0), Wrap::Clamp)
        );
        assert_eq!(moved.place(Vec2::new(0.25, 1.0)), Vec2::new(1.0, 1.0));
    }

    #[test]
    fn a_line_may_name_several_libraries_and_quote_them() {
        for (text, names) in [
            ("a.mtl", &["a.mtl"][..]),
            ("a.mtl b.MTL", &["a.mtl", "b.MTL"]),
            ("my scene.mtl other one.mtl", &["my scene.mtl", "other one.mtl"]),
            ("\"q mtl.mtl\" b.mtl", &["q mtl.mtl", "b.mtl"]),
            ("plain name", &["plain name"]),
            ("", &[]),
        ] {
            assert_eq!(library_names(text), names, "{text}");
        }
    }
}
