//! A page with a scene: one HTML file with a viewer and a GLB, which opens from disk.
//!
//! ```text
//! <!doctype html><!-- trisplat page 1 -->
//! ... style, viewer (page/ in the repository) ...
//! <script type="image/jpeg;base64" id="sky">...</script>    with a panorama in place of a backdrop
//! <script type="model/gltf-binary;base64">...</script><script>trisplat.block()</script>    one line per block
//! ...
//! ```
//!
//! The blocks are the GLB in order. A browser, like our reader, decodes each while it reads the
//! next.

use crate::gltf::{self as gltf, GltfOptions, WrittenGltf};
use crate::{Format, Source};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use trisplat_scene::{Asset, Error, Result};

/// The page without a scene, built from `page/src`.
const PAGE: &str = include_str!("../page/page.html");
const OPEN: &str = "<script type=\"model/gltf-binary;base64\">";
const CLOSE: &str = "</script><script>trisplat.block()</script>\n";
/// Bytes of the GLB in a block: a multiple of 3, so that only the last block is padded.
const BLOCK_BYTES: usize = 3 << 20;
/// Maximum length of a line of a page, bytes.
const MAX_LINE_BYTES: u64 = 1 << 25;

/// Writes the page of `asset`, with its `sky` as media type and bytes; `path` is for messages.
///
/// # Errors
/// As [`gltf::write_glb`].
pub(crate) fn write(
    out: &mut dyn Write,
    path: &Path,
    title: &str,
    asset: &Asset,
    sky: Option<(&str, Vec<u8>)>,
    options: &GltfOptions,
) -> Result<WrittenGltf> {
    let io = |e| Error::io(path, e);
    let (head, tail) = PAGE.split_once("@SCENE@\n").unwrap_or((PAGE, ""));
    let head = head
        .replace("@TITLE@", &escaped(title))
        .replace("@GENERATOR@", &trisplat_scene::report::generator());
    out.write_all(head.as_bytes()).map_err(io)?;
    if let Some((mime, bytes)) = sky {
        let text = BASE64.encode(bytes);
        writeln!(out, "<script type=\"{mime};base64\" id=\"sky\">{text}</script>").map_err(io)?;
    }
    let mut blocks =
        BlockWriter { out, pending: Vec::with_capacity(BLOCK_BYTES), text: String::new() };
    let glb = gltf::write_glb(&mut blocks, path, asset, options)?;
    blocks.end().map_err(io)?;
    out.write_all(tail.as_bytes()).map_err(io)?;
    out.flush().map_err(io)?;
    Ok(glb)
}

/// Text escaped for HTML, in elements and attributes.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Cuts bytes into blocks and writes each as a line of HTML. Holds one block.
struct BlockWriter<'a> {
    out: &'a mut dyn Write,
    pending: Vec<u8>,
    text: String,
}

impl BlockWriter<'_> {
    fn end(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        self.text.clear();
        self.text.push_str(OPEN);
        BASE64.encode_string(&self.pending, &mut self.text);
        self.text.push_str(CLOSE);
        self.pending.clear();
        self.out.write_all(self.text.as_bytes())
    }
}

impl Write for BlockWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(BLOCK_BYTES - self.pending.len());
        self.pending.extend(&bytes[..taken]);
        if self.pending.len() == BLOCK_BYTES {
            self.end()?;
        }
        Ok(taken)
    }

    /// Does nothing, because an incomplete block waits for more bytes.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The input of a scene reader: the GLB of a page, or any other file itself.
pub(super) fn inside(format: Format, source: Source) -> Result<(Format, Source)> {
    if format == Format::Html { Ok((Format::Glb, unpack(source)?)) } else { Ok((format, source)) }
}

/// The GLB of a page, in a temporary file.
///
/// # Errors
/// [`Error::Unsupported`] for a page that does not hold a scene, [`Error::Malformed`] for one that
/// is damaged.
fn unpack(source: Source) -> Result<Source> {
    let io = |e| Error::io(&source.path, e);
    let mut page = BufReader::with_capacity(1 << 20, &*source.file);
    let mut glb = tempfile::tempfile().map_err(Error::temporary)?;
    let mut line = Vec::new();
    let mut number = 0u64;
    let mut len = 0u64;
    loop {
        line.clear();
        if page.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line).map_err(io)? == 0 {
            break;
        }
        number += 1;
        let Some(rest) = line.strip_prefix(OPEN.as_bytes()) else { continue };
        let bytes = rest.strip_suffix(CLOSE.as_bytes()).and_then(|text| BASE64.decode(text).ok());
        let Some(bytes) = bytes else {
            let reason =
                "this block of the scene is cut short or is not base64; bake the page again";
            return Err(Error::malformed(&source.path, format!("line {number}"), reason));
        };
        glb.write_all(&bytes).map_err(Error::temporary)?;
        len += bytes.len() as u64;
    }
    if len == 0 {
        let reason = "is a page without a scene: only pages written by `trisplat bake -o scene.html` hold one";
        return Err(Error::unsupported(&source.path, reason));
    }
    glb.seek(SeekFrom::Start(0)).map_err(io)?;
    Ok(Source { path: source.path, file: Arc::new(glb), len })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_every_place_that_is_filled_in() {
        assert!(PAGE.len() < 1 << 20, "{} bytes", PAGE.len());
        assert!(PAGE.starts_with("<!doctype html><!-- trisplat page 1 -->\n"));
        assert_eq!(PAGE.matches("@SCENE@\n").count(), 1);
        assert_eq!(PAGE.matches("@TITLE@").count(), 3);
        assert_eq!(PAGE.matches("@GENERATOR@").count(), 1);
        assert_eq!(PAGE.matches("</script").count(), 1, "the script would end early");
        assert_eq!(PAGE.matches("<!--").count(), 1, "the script could hide its end");
        assert!(PAGE.contains("three.js authors") && PAGE.contains("Permission is hereby granted"));
        for outside in ["<script src", "<link", "<img", "@import"] {
            assert!(!PAGE.contains(outside), "{outside}: the page must hold all it needs");
        }
    }

    #[test]
    fn the_page_runs_its_own_script_and_nothing_else() {
        let policy = PAGE
            .split("Content-Security-Policy\" content=\"")
            .nth(1)
            .and_then(|rest| rest.split('"').next());
        let policy = policy.expect("the page has a policy");
        assert!(policy.starts_with("default-src 'none'; script-src 'sha256-"), "{policy}");
        for word in ["unsafe-inline", "'unsafe-eval'", "*", "http", "'self'"] {
            assert!(!policy.contains(word), "{word}: {policy}");
        }
        // SHA-256 of the script that CLOSE calls after each block.
        assert!(
            CLOSE.contains("<script>trisplat.block()</script>"),
            "another call has another hash"
        );
        assert!(
            policy.contains("'sha256-ZQOv0Lu+eRhE+APYwZz0YBUx54qprr2YYea/uxYEggw='"),
            "{policy}"
        );
    }

    #[test]
    fn titles_are_text() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
    }

    #[test]
    fn blocks_hold_every_byte_in_order() {
        let bytes: Vec<u8> = (0..BLOCK_BYTES + 10_001).map(|i| (i % 251) as u8).collect();
        let mut out = Vec::new();
        let mut blocks = BlockWriter { out: &mut out, pending: Vec::new(), text: String::new() };
        for part in bytes.chunks(70_000) {
            blocks.write_all(part).unwrap();
            blocks.flush().unwrap();
        }
        blocks.end().unwrap();
        let lines = out.split(|b| *b == b'\n').filter(|line| !line.is_empty());
        let decoded = lines.map(|line| {
            let text = &line[OPEN.len()..line.len() + 1 - CLOSE.len()];
            BASE64.decode(text).unwrap()
        });
        let blocks: Vec<Vec<u8>> = decoded.collect();
        assert_eq!(blocks.len(), 2);
        assert_eq!(blocks.concat(), bytes);
    }
}
