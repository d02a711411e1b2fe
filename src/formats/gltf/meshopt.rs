//! EXT_meshopt_compression: every stream of every part encoded on its own.

use super::chunk::{Part, Stream};
use super::{GltfOptions, all_streams, encode};
use crate::mesh::Mesh;
use rayon::prelude::*;

/// EXT_meshopt_compression knows vertex codec version 0 only; the crate's own default is 1.
const VERTEX_CODEC: i32 = 0;

/// The compressed streams in file order. Only as many are uncompressed at a time as threads run.
///
/// # Errors
/// What the encoder could not do, with the remedy.
pub(super) fn compress(
    mesh: &Mesh,
    parts: &[Part],
    options: &GltfOptions,
) -> std::result::Result<Vec<Vec<u8>>, String> {
    let streams: Vec<(&Part, Stream)> = all_streams(parts).collect();
    streams
        .into_par_iter()
        .map(|(part, stream)| {
            let encoded = match stream {
                Stream::Positions | Stream::Colors => {
                    let bytes = encode::bytes(mesh, part, stream, options);
                    encode_vertices(&bytes, part.stride(stream, options))
                }
                Stream::Indices => {
                    let corners = 3 * part.faces.start..3 * part.faces.end;
                    let local: Vec<u32> =
                        mesh.indices[corners].iter().map(|&v| part.local(v) as u32).collect();
                    ::meshopt::encode_index_buffer(&local, part.vertex_count()).map_err(|e| e.to_string())
                }
            };
            match encoded {
                Ok(bytes) if !bytes.is_empty() => Ok(bytes),
                Ok(_) => Err(refused(part, "no bytes came out")),
                Err(e) => Err(refused(part, &e)),
            }
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

fn encode_vertices(bytes: &[u8], stride: u64) -> std::result::Result<Vec<u8>, String> {
    fn cells<const N: usize>(bytes: &[u8]) -> std::result::Result<Vec<u8>, String> {
        let (cells, _) = bytes.as_chunks::<N>();
        ::meshopt::encode_vertex_buffer_level(cells, 0, Some(VERTEX_CODEC)).map_err(|e| e.to_string())
    }
    match stride {
        4 => cells::<4>(bytes),
        8 => cells::<8>(bytes),
        12 => cells::<12>(bytes),
        16 => cells::<16>(bytes),
        _ => Err(format!("no element has {stride} bytes")),
    }
}

fn refused(part: &Part, why: &str) -> String {
    format!("meshopt could not encode {}: {why}; write without compression", part.name)
}
