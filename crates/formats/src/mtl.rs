//! The materials of an OBJ: the pictures or colours of its faces.

use crate::faces::{PaintedFaces, paint};
use crate::lines::Lines;
use crate::{ReadOptions, Source};
use glam::Vec2;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Error, Limits, Result, Texture, input};

/// Most libraries of a file; each is read whole.
const MOST_LIBRARIES: usize = 64;

/// Keywords of pictures that do not begin with `map_`.
const OTHER_PICTURES: [&str; 5] = ["bump", "disp", "decal", "refl", "norm"];

/// A material of a library.
#[derive(Debug, Clone, Default, PartialEq)]
struct Material {
    /// sRGB-encoded.
    color: Option<[f32; 3]>,
    picture: Option<String>,
}

/// Materials, and the faces that have them.
#[derive(Debug, Default)]
pub(crate) struct Materials {
    libraries: Vec<String>,
    names: Vec<String>,
    numbers: BTreeMap<String, usize>,
    /// That of the next face.
    current: u32,
    /// Numbers of the faces' materials; empty without materials. `[F]`
    pub(crate) of_face: Vec<u32>,
}

/// Of faces before the first material.
const NONE: u32 = u32::MAX;

impl Materials {
    /// `mtllib NAME`.
    pub(crate) fn library(&mut self, name: &str) {
        if !name.is_empty()
            && self.libraries.len() < MOST_LIBRARIES
            && !self.libraries.iter().any(|n| n == name)
        {
            self.libraries.push(name.to_owned());
        }
    }

    /// `usemtl NAME`, behind `faces` faces.
    pub(crate) fn begin(&mut self, name: &str, faces: usize) {
        if self.names.is_empty() {
            self.of_face.resize(faces, NONE);
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

    /// Gives `mesh`, which has no colours, those of its materials, with the given texture coordinates.
    /// Returns whether any material had a colour or picture. Materials are per triangle. `[F]`
    pub(crate) fn apply(
        &self,
        mesh: &mut Mesh,
        uvs: &[[Vec2; 3]],
        path: &Path,
        options: &ReadOptions,
        warnings: &mut Vec<String>,
    ) -> bool {
        let known = self.read(path, options, warnings);
        let of_name = |number: usize| known.get(&self.names[number]).cloned().unwrap_or_default();
        let materials: Vec<Material> = (0..self.names.len()).map(of_name).collect();
        if materials.iter().all(|material| *material == Material::default()) {
            return false;
        }
        let (mut textures, mut painted) = (BTreeMap::new(), Vec::new());
        let mut colors = vec![[1.0f32; 3]; mesh.face_count()];
        let mut end = 0;
        for run in self.of_face.chunk_by(|a, b| a == b) {
            let (faces, number) = (end..end + run.len(), run[0] as usize);
            end += run.len();
            let Some(material) = materials.get(number) else { continue };
            let color = material.color.unwrap_or([1.0; 3]);
            colors[faces.clone()].fill(color.map(|c| linear_from_srgb(c.clamp(0.0, 1.0))));
            if let Some(name) = &material.picture
                && uvs.len() == mesh.face_count()
                && uvs[faces.clone()].as_flattened().iter().all(|uv| uv.is_finite())
            {
                let picture = textures.entry(number).or_insert_with(|| {
                    let read = picture(path, name, options);
                    read.map_err(|e| {
                        warnings.push(format!(
                            "a texture is not read, its triangles have the colour of their material: {e}"
                        ))
                    })
                    .ok()
                });
                if picture.is_some() {
                    // Many programs write a meaningless colour beside a picture: black, or grey.
                    colors[faces.clone()].fill([1.0; 3]);
                }
                painted.push(PaintedFaces {
                    image: number,
                    uvs: uvs[faces.clone()].to_vec(),
                    faces,
                    plain: true,
                });
            }
        }
        mesh.colors = Colors::Face(colors);
        warnings.extend(paint(mesh, painted, &textures));
        true
    }

    /// The materials of all libraries, by name.
    fn read(
        &self,
        path: &Path,
        options: &ReadOptions,
        warnings: &mut Vec<String>,
    ) -> BTreeMap<String, Material> {
        let mut known = BTreeMap::new();
        for name in &self.libraries {
            let read = beside(path, name, options).and_then(|file| library(&file, options, &mut known));
            if let Err(error) = read {
                warnings.push(format!("materials are not read, their triangles are white: {error}"));
            }
        }
        known
    }
}

/// The libraries that an OBJ names, and the pictures that these name.
pub fn named_files(source: &Source, limits: &Limits) -> Result<Vec<PathBuf>> {
    let options = ReadOptions { limits: *limits, allow_outside: true, ..ReadOptions::default() };
    let (mut lines, mut materials) = (Lines::new(source)?, Materials::default());
    while lines.advance()? {
        if lines.words().next() == Some("mtllib") {
            materials.library(lines.rest());
        }
    }
    let mut files = Vec::new();
    for name in &materials.libraries {
        let library = beside(&source.path, name, &options)?;
        // One that cannot be read names nothing.
        let pictures = pictures(&library, &options).unwrap_or_default();
        files.push(library);
        files.extend(pictures.iter().filter_map(|name| beside(&source.path, name, &options).ok()));
    }
    Ok(files)
}

/// The names of all pictures in a library, also of kinds that are not read: of bumps, reflections and so on.
fn pictures(library: &Path, options: &ReadOptions) -> Result<Vec<String>> {
    let source = Source::open(library, &options.limits)?;
    let (mut lines, mut names) = (Lines::new(&source)?, Vec::new());
    while lines.advance_to_text()? {
        let keyword = lines.words().next().unwrap_or_default().to_ascii_lowercase();
        if keyword.starts_with("map_") || OTHER_PICTURES.contains(&keyword.as_str()) {
            names.push(without_options(lines.rest()));
        }
    }
    Ok(names)
}

/// The path of a file that the OBJ names.
fn beside(path: &Path, name: &str, options: &ReadOptions) -> Result<PathBuf> {
    let refuse = |why: &str| Err(Error::unsupported(path, format!("it names {name:?}, {why}")));
    if path.as_os_str() == "-" {
        return refuse("which standard input cannot reach; give the file by name");
    }
    // Some programs write Windows separators.
    let relative = PathBuf::from(name.replace('\\', "/"));
    let outside = relative.is_absolute() || name.contains(':') || input::leaves_folder(&relative);
    if outside && !options.allow_outside {
        return refuse("outside the folder of the file; if that is right, give `allow_outside`");
    }
    Ok(path.parent().unwrap_or(Path::new("")).join(relative))
}

fn library(path: &Path, options: &ReadOptions, known: &mut BTreeMap<String, Material>) -> Result<()> {
    let source = Source::open(path, &options.limits)?;
    let mut lines = Lines::new(&source)?;
    let mut name = None;
    while lines.advance_to_text()? {
        let mut words = lines.words();
        let (Some(keyword), rest) = (words.next(), lines.rest()) else { continue };
        if keyword == "newmtl" {
            known.entry(rest.to_owned()).or_default();
            name = Some(rest.to_owned());
        }
        let Some(material) = name.as_ref().and_then(|name| known.get_mut(name)) else { continue };
        match keyword {
            "Kd" => {
                let numbers: Vec<f32> =
                    words.filter_map(|word| word.parse().ok()).filter(|x: &f32| x.is_finite()).collect();
                material.color = numbers.try_into().ok();
            }
            "map_Kd" => material.picture = Some(without_options(rest)),
            _ => {}
        }
    }
    Ok(())
}

/// The name of a picture after options such as `-clamp on` and `-s 1 1 1`; it may hold spaces.
fn without_options(text: &str) -> String {
    let mut rest = text.trim();
    while let Some((option, after)) =
        rest.strip_prefix('-').and_then(|_| rest.split_once(char::is_whitespace))
    {
        rest = after.trim_start();
        let numbers = matches!(option, "-s" | "-o" | "-t" | "-mm");
        let mut left = if numbers { 3 } else { 1 };
        while left > 0 {
            let Some((word, after)) = rest.split_once(char::is_whitespace) else { break };
            if numbers && word.parse::<f32>().is_err() {
                break;
            }
            (rest, left) = (after.trim_start(), left - 1);
        }
    }
    rest.to_owned()
}

fn picture(path: &Path, name: &str, options: &ReadOptions) -> Result<Arc<Texture>> {
    let file = beside(path, name, options)?;
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
        ] {
            assert_eq!(without_options(text), name, "{text}");
        }
    }
}
