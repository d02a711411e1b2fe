//! The elements of a PLY that are read, and the places of their rows.

use super::corners;
use super::header::{Element, Header};
use super::table::Table;
use super::transcode::Wanted;
use crate::source::Source;
use trisplat_scene::{Error, Limits, Result};

/// The two elements of every triangle PLY, and the optional cameras of a soup.
pub(super) struct Tables<'a> {
    pub(super) vertices: Table<'a>,
    pub(super) faces: Table<'a>,
    pub(super) views: Option<Table<'a>>,
}

/// Finds the rows of `vertex`, `face` and `view`, checking that the file is as long as they need. `faces`
/// says which faces are permitted.
pub(super) fn locate<'a>(
    source: &'a Source,
    header: &'a Header,
    faces: Wanted,
    limits: &Limits,
) -> Result<Tables<'a>> {
    check_rows(source, header, limits)?;
    let cameras = corners::element(header);
    let wanted = |element: &Element| match element.name.as_str() {
        "vertex" => Wanted::Triangles,
        "face" => faces,
        _ if cameras == Some(element) => Wanted::Triangles,
        _ => Wanted::Nothing,
    };
    let missing = |name: &str| Error::malformed(&source.path, "header", format!("has no element {name}"));
    let [vertices, faces, views] = open(source, header, wanted, ["vertex", "face", corners::NAME])?;
    Ok(Tables {
        vertices: vertices.ok_or_else(|| missing("vertex"))?,
        faces: faces.ok_or_else(|| missing("face"))?,
        views,
    })
}

/// Refuses more rows than a scene may have, before any is read.
fn check_rows(source: &Source, header: &Header, limits: &Limits) -> Result<()> {
    let place = |element: &Element| format!("{}: element {}", source.path.display(), element.name);
    header.element("face").map_or(Ok(()), |face| limits.triangles(place(face), face.rows))?;
    header.element("vertex").map_or(Ok(()), |vertex| limits.vertices(place(vertex), vertex.rows))
}

/// Only the rows of `vertex`: a cloud of points.
pub fn points<'a>(source: &'a Source, header: &'a Header, limits: &Limits) -> Result<Table<'a>> {
    let [vertices] = some(source, header, ["vertex"], limits)?;
    vertices.ok_or_else(|| Error::malformed(&source.path, "header", "has no element vertex"))
}

/// The rows of elements that have no lists which are read; `None` for those that the file lacks.
pub(super) fn some<'a, const N: usize>(
    source: &'a Source,
    header: &'a Header,
    names: [&str; N],
    limits: &Limits,
) -> Result<[Option<Table<'a>>; N]> {
    check_rows(source, header, limits)?;
    let wanted = |element: &Element| match names.contains(&element.name.as_str()) {
        true => Wanted::Triangles,
        false => Wanted::Nothing,
    };
    open(source, header, wanted, names)
}

/// Walks the elements of a file up to the last needed one; returns those of `names` that exist.
fn open<'a, const N: usize>(
    source: &'a Source,
    header: &'a Header,
    wanted: impl Fn(&Element) -> Wanted,
    names: [&str; N],
) -> Result<[Option<Table<'a>>; N]> {
    let mut tables = [const { None }; N];
    let mut at = header.body;
    let last = header.elements.iter().rposition(|e| wanted(e) != Wanted::Nothing).map_or(0, |last| last + 1);
    for element in &header.elements[..last] {
        let used = wanted(element);
        let (table, end) = Table::open(source, header.encoding, element, at, used)?;
        at = end;
        if used != Wanted::Nothing
            && let Some(slot) = names.iter().position(|name| *name == element.name)
        {
            tables[slot] = Some(table);
        }
    }
    Ok(tables)
}
