//! Photos with poses become a scene, with progress and an end on request:
//! `cargo run --release --example train [PHOTOS] [OUT.ply] [STEPS]`.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use std::ops::ControlFlow;
use trisplat::{Dataset, DatasetOptions, Event, TrainOptions};

fn main() -> trisplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let photos = arguments.next().unwrap_or("samples/dataset".into());
    let out = arguments.next().unwrap_or("scene.ply".into());
    let steps = arguments.next().map_or(300, |steps| steps.parse().expect("STEPS is a number"));

    let photos = Dataset::load(photos, &DatasetOptions::default())?;
    println!("{} photos, {} held out", photos.len(), photos.test().count());
    let options = TrainOptions::default().steps(steps).max_triangles(4000);
    let trained = trisplat::train(&photos, &options, &mut |event| match event {
        Event::Step { part, sample, .. } if sample.step % 100 == 0 => {
            println!(
                "{part:?} {:>5}: {:.2} dB, {} triangles",
                sample.step, sample.psnr, sample.triangles
            );
            // Good enough: `Break` ends the training here.
            if sample.psnr < 45.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        }
        _ => ControlFlow::Continue(()),
    })?;
    println!("{} triangles, {} bytes", trained.soup.len(), trained.save(out)?);
    Ok(())
}
