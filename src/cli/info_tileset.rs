//! `trisplat info SCENE.tileset.json`: tiles, levels, files.

use super::counts::{many, thousands};
use super::messages;
use std::io::Write;
use trisplat_formats::TilesetInfo;
use trisplat_scene::{Error, Result};

/// Writes the table, or the figures as JSON, to `out`.
pub(super) fn run(info: &TilesetInfo, json: bool, out: &mut dyn Write) -> Result<()> {
    let text = if json { serde_json::to_string_pretty(info).unwrap_or_default() + "\n" } else { table(info) };
    out.write_all(text.as_bytes()).map_err(|e| Error::io("-", e))
}

/// The table, one figure per line.
fn table(info: &TilesetInfo) -> String {
    let (tiles, levels) = (thousands(info.tiles), many(info.levels, "level"));
    let within = match info.tilesets {
        1 => String::new(),
        count => format!(", in {}", many(count, "tileset")),
    };
    let mut rows = vec![
        ("kind", "3D Tiles; `trisplat validate` reads the tiles, too".to_owned()),
        ("tiles", format!("{tiles} of {levels}{within}")),
        (
            "files",
            format!("{} with triangles, {} bytes in all", thousands(info.files), thousands(info.bytes)),
        ),
        ("error", format!("the first tile leaves out detail of {:.4} units", info.geometric_error)),
    ];
    if info.missing > 0 {
        let are = if info.missing == 1 { "is" } else { "are" };
        rows.push(("warning", format!("{} {are} missing", many(info.missing, "file"))));
    }
    let rows = rows.iter().map(|(name, value)| format!("{name:<10} {value}\n"));
    format!("{}\n", messages::visible(&info.path)) + &rows.collect::<String>()
}
