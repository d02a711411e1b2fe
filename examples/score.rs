//! Scores a file on photos that its training did not see: `cargo run --release --example score
//! [FILE] [PHOTOS]`.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use trisplat::{Dataset, DatasetOptions};

fn main() -> trisplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or("samples/soups/trained.ply".into());
    let photos = arguments.next().unwrap_or("samples/dataset".into());
    let photos = Dataset::load(photos, &DatasetOptions::default())?;
    let score = trisplat::score(trisplat::read(file)?, &photos)?;
    println!("PSNR {:.2} dB, SSIM {:.4}, FLIP {:.4}", score.psnr, score.ssim, score.flip);
    Ok(())
}
