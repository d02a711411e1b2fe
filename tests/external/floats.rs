//! NumPy reads the numbers behind pictures, and its PSNR of them is that of the program.

use super::{here, python, runs};
use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;
use trisplat_scene::image::RgbImage;

/// Prints type, shape, the PSNR of the array and of the 8-bit picture against the photo, and the largest difference of the two, in codes.
const SCRIPT: &str = "
import sys, numpy
floats, picture, photo = numpy.load(sys.argv[1]), *(numpy.fromfile(name, 'u1') for name in sys.argv[2:])
codes, photo = picture.reshape(floats.shape).astype('f8'), photo.reshape(floats.shape).astype('f8')
psnr = lambda values: 20 * numpy.log10(255 / numpy.sqrt(numpy.mean((values - photo) ** 2)))
clipped = 255 * numpy.clip(floats.astype('f8'), 0, 1)
print(floats.dtype, floats.shape, psnr(clipped), psnr(codes), abs(clipped - codes).max())
";

/// The colours of a picture as a file of bytes.
fn bytes(picture: &Path, out: &Path) {
    fs::write(out, RgbImage::load(picture).unwrap().rgb.as_flattened()).unwrap();
}

#[test]
fn numpy_reads_floats_whose_psnr_is_that_of_the_picture() {
    let Some(mut numpy) = python("numpy") else { return };
    let folder = TempDir::new().unwrap();
    let renders = folder.path().join("renders");
    let mut eval = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let (scene, dataset) = (here("samples/soups/trained.ply"), here("samples/dataset"));
    eval.arg("eval").arg(scene).arg(&dataset).args(["--as", "solid", "--no-coverage", "--json", "--floats"]);
    let done = runs(eval.arg("--save-renders").arg(&renders));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let first = &report["steps"][0]["images"][0];
    let name = first["name"].as_str().unwrap();
    let [codes, photo] = ["codes.bin", "photo.bin"].map(|name| folder.path().join(name));
    bytes(&renders.join(name), &codes);
    bytes(&dataset.join("images").join(name), &photo);
    numpy.args(["-c", SCRIPT]).arg(renders.join(name).with_extension("npy")).arg(codes).arg(photo);
    let done = runs(&mut numpy);
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let [width, height] = [0, 1].map(|i| first["size"][i].as_u64().unwrap());
    let numbers = said.trim().strip_prefix(&format!("float32 ({height}, {width}, 3) "));
    let numbers = numbers.unwrap_or_else(|| panic!("{said}"));
    let numbers: Vec<f64> = numbers.split(' ').map(|number| number.parse().unwrap()).collect();
    let [floats, codes, apart] = numbers[..] else { panic!("{said}") };
    assert!((codes - first["psnr"].as_f64().unwrap()).abs() < 1e-6, "{said} {first}");
    // Rounding is an error of its own: the two are alike, and not the same.
    assert!(floats != codes && (floats - codes).abs() < 0.01 && apart > 0.4 && apart < 0.501, "{said}");
}
