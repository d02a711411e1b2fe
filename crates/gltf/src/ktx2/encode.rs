//! Mip levels become a `.basis` file, by the encoder of Basis Universal.

use super::blocks::Blocks;
use basis_universal::BasisTextureFormat;
use basis_universal::encoding::{ColorSpace, Compressor, CompressorParams};
use trisplat_scene::Texture;

/// Largest quality of the codebooks: lower ones save a quarter of the bytes and lose 2 dB (docs/benchmarks/texture.md).
const QUALITY: u32 = basis_universal::ETC1S_QUALITY_MAX;

/// The file of all mip levels. Each is an image of its own, so all share the codebooks and each has its size.
pub(super) fn basis(texture: &Texture, blocks: Blocks) -> Result<Vec<u8>, String> {
    let mut params = CompressorParams::new();
    params.set_basis_format(match blocks {
        Blocks::Etc1s => BasisTextureFormat::ETC1S,
        Blocks::Uastc => BasisTextureFormat::UASTC4x4,
    });
    params.set_color_space(ColorSpace::Srgb);
    params.set_etc1s_quality_level(QUALITY);
    for (number, level) in texture.levels().iter().enumerate() {
        let texels: &[u8] = bytemuck::cast_slice(&level.rgb);
        params.source_image_mut(number as u32).init(texels, level.size.x, level.size.y, 3);
    }
    let threads = match blocks {
        // Its codebooks depend on how many there are.
        Blocks::Etc1s => 1,
        Blocks::Uastc => trisplat_scene::parallel::threads() as u32,
    };
    run(&params, threads)
}

#[expect(unsafe_code, reason = "the crate leaves it to the caller that the encoder is used in order")]
fn run(params: &CompressorParams, threads: u32) -> Result<Vec<u8>, String> {
    let mut compressor = Compressor::new(threads);
    // SAFETY: `params` has images and outlives the call, which copies it.
    if !unsafe { compressor.init(params) } {
        return Err("the encoder refuses the picture".to_owned());
    }
    // SAFETY: `init` has succeeded, and this is the only call.
    unsafe { compressor.process() }.map_err(|code| format!("the encoder failed ({code:?})"))?;
    Ok(compressor.basis_file().to_vec())
}
