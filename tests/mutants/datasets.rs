//! Mutants of what training reads: data sets, photos and masks, checkpoints. Each is refused with a
//! clear error or read, and nothing panics, waits or takes memory that was not there.

use glam::UVec2;
use std::ops::ControlFlow::Continue;
use std::path::{Path, PathBuf};
use trisplat::{Dataset, DatasetOptions, Limits};
use trisplat_fixtures::edits::mutate;
use trisplat_fixtures::png;
use trisplat_scene::{Error, image::RgbImage};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::{TrainInputs, TrainOptions, TrainOutputs, checkpoint};

/// A refusal names its file and is one line of a readable length.
fn check_refusal(error: &Error, folder: &Path) {
    let message = error.to_string();
    let named = message.contains(&*folder.to_string_lossy())
        || matches!(error, Error::Invalid { .. } | Error::InvalidData(_));
    assert!(named && message.len() < 1500, "{message}");
}

fn small_set(folder: &Path) {
    let options =
        SyntheticOptions { views: 3, width: 16, points: 9, seed: 1, ..SyntheticOptions::default() };
    trisplat_synthetic::write(folder, &options).expect("a data set");
}

fn survive_dataset(folder: &Path) {
    match Dataset::load(folder, &DatasetOptions::default()) {
        Ok(dataset) => {
            for view in &dataset.views {
                view.camera.validate(&Limits::DEFAULT).expect("a valid camera");
                if let Err(error) = view.photo.decode() {
                    check_refusal(&error, folder);
                }
            }
        }
        Err(error) => check_refusal(&error, folder),
    }
}

fn mutate_file(path: &Path, count: u32, survive: impl Fn()) {
    let seed = std::fs::read(path).expect("readable");
    mutate(&path.display().to_string(), &seed, count, |bytes| {
        std::fs::write(path, bytes).expect("writable");
        survive();
    });
    std::fs::write(path, seed).expect("writable");
}

#[test]
fn mutants_of_a_colmap_text_model_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    small_set(folder.path());
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        let path = folder.path().join("sparse/0").join(name);
        mutate_file(&path, 300, || survive_dataset(folder.path()));
    }
}

#[test]
fn mutants_of_a_colmap_binary_model_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    let sparse = folder.path().join("sparse/0");
    std::fs::create_dir_all(&sparse).unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    picture(16, 12).save_png(folder.path().join("images/a.png")).unwrap();
    let camera = [
        &1u64.to_le_bytes()[..],
        &1u32.to_le_bytes(),
        &1i32.to_le_bytes(),
        &16u64.to_le_bytes(),
        &12u64.to_le_bytes(),
        &[20.0f64, 20.0, 8.0, 6.0].map(f64::to_le_bytes).concat(),
    ];
    let seen = [&2.5f64.to_le_bytes()[..], &3.5f64.to_le_bytes(), &7u64.to_le_bytes()].concat();
    let image = [
        &1u64.to_le_bytes()[..],
        &1u32.to_le_bytes(),
        &[1.0f64, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0].map(f64::to_le_bytes).concat(),
        &1u32.to_le_bytes(),
        b"a.png\0",
        &1u64.to_le_bytes(),
        &seen,
    ];
    let point = [
        &1u64.to_le_bytes()[..],
        &7u64.to_le_bytes(),
        &[0.1f64, 0.2, 0.3].map(f64::to_le_bytes).concat(),
        &[1, 2, 3],
        &0.5f64.to_le_bytes(),
        &1u64.to_le_bytes(),
        &[1, 0, 0, 0, 0, 0, 0, 0],
    ];
    let files = [
        ("cameras.bin", camera.concat()),
        ("images.bin", image.concat()),
        ("points3D.bin", point.concat()),
    ];
    files.iter().for_each(|(name, bytes)| std::fs::write(sparse.join(name), bytes).unwrap());
    Dataset::load(folder.path(), &DatasetOptions::default()).expect("the seed is valid");
    for (name, _) in files {
        mutate_file(&sparse.join(name), 300, || survive_dataset(folder.path()));
    }
}

#[test]
fn mutants_of_a_transforms_file_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.png", "mask.png"] {
        picture(16, 12).save_png(folder.path().join(name)).unwrap();
    }
    let matrix = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let text = format!(
        "{{\"camera_model\":\"OPENCV\",\"fl_x\":20.5,\"fl_y\":20,\"cx\":8,\"cy\":6,\"w\":16,\"h\":12,\"k1\":0.01,\
         \"p1\":0.001,\"ply_file_path\":\"points.ply\",\"frames\":[{{\"file_path\":\"a.png\",\"mask_path\":\"mask.png\",\
         \"transform_matrix\":{matrix}}}]}}"
    );
    let path = folder.path().join("transforms.json");
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                  end_header\n1 2 3\n";
    std::fs::write(folder.path().join("points.ply"), points).unwrap();
    std::fs::write(&path, text).unwrap();
    Dataset::load(folder.path(), &DatasetOptions::default()).expect("the seed is valid");
    mutate_file(&path, 1000, || survive_dataset(folder.path()));
    mutate_file(&folder.path().join("points.ply"), 300, || survive_dataset(folder.path()));
}

/// The lists that other programs write.
#[test]
fn mutants_of_lists_of_other_programs_are_survived() {
    let metashape = "<document><chunk><sensors><sensor id=\"0\" type=\"frame\"><resolution width=\"16\" height=\"12\"/><calibration \
        class=\"adjusted\"><f>20</f><cx>0.1</cx><k1>0.01</k1></calibration></sensor></sensors><cameras><group><camera label=\"a.png\" \
        sensor_id=\"0\" enabled=\"true\"><transform>1 0 0 0 0 1 0 0 0 0 1 4 0 0 0 1</transform></camera></group></cameras><transform>\
        <rotation>1 0 0 0 1 0 0 0 1</rotation><translation>1 2 3</translation><scale>2</scale></transform></chunk></document>";
    let realityscan = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px,py,k1,k2,k3,k4,t1,t2\na.png,1,2,3,10,80,5,40,0.01,0,0.1,0,0,0,0,0\n";
    let mut npy =
        b"\x93NUMPY\x01\0\x40\0{'descr': '<f8', 'fortran_order': False, 'shape': (1, 17), }   \n"
            .to_vec();
    let row = [
        0.0, 1.0, 0.0, 0.0, 12.0, 1.0, 0.0, 0.0, 0.0, 16.0, 0.0, 0.0, -1.0, 4.0, 20.0, 0.5, 9.0f64,
    ];
    npy.extend(row.iter().flat_map(|number| number.to_le_bytes()));
    for (name, bytes) in [
        ("cameras.xml", metashape.into()),
        ("poses.csv", realityscan.into()),
        ("poses_bounds.npy", npy),
    ] {
        let bytes: Vec<u8> = bytes;
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        picture(16, 12).save_png(folder.path().join("images/a.png")).unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Dataset::load(folder.path(), &DatasetOptions::default())
            .unwrap_or_else(|e| panic!("the seed is valid: {e}"));
        mutate_file(&path, 300, || survive_dataset(folder.path()));
    }
}

fn picture(width: u32, height: u32) -> RgbImage {
    let rgb = (0..width * height).map(|i| [(7 * i) as u8, (13 * i) as u8, i as u8]).collect();
    RgbImage { size: UVec2::new(width, height), rgb, alpha: None }
}

#[test]
fn mutants_of_photos_and_masks_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("photo.any");
    let plain = picture(32, 24);
    let mut jpeg = Vec::new();
    let mut webp = Vec::new();
    let bytes = plain.rgb.as_flattened();
    let rgb8 = image::ExtendedColorType::Rgb8;
    image::codecs::jpeg::JpegEncoder::new(&mut jpeg).encode(bytes, 32, 24, rgb8).unwrap();
    image::codecs::webp::WebPEncoder::new_lossless(&mut webp).encode(bytes, 32, 24, rgb8).unwrap();
    let masked = RgbImage { alpha: Some((0..32 * 24).map(|i| i as u8).collect()), ..plain.clone() };
    let seeds = [
        ("png", plain.to_png().unwrap()),
        ("masked", masked.to_png().unwrap()),
        ("indexed", png::indexed(32, 24, &[7; 12], &[])),
        ("indexed, masked", png::indexed(32, 24, &[7; 12], &[0, 128])),
        ("jpeg", jpeg),
        ("webp", webp),
    ];
    for (name, seed) in seeds {
        mutate(name, &seed, 500, |bytes| {
            // Half of them are seen by more than the check of checksums.
            let bytes = if bytes.len() % 2 == 0 { &png::with_checksums(bytes) } else { bytes };
            std::fs::write(&path, bytes).expect("writable");
            let size = RgbImage::size_of(&path, &Limits::DEFAULT);
            match (&size, &RgbImage::load(&path)) {
                (Ok(size), Ok(pixels)) => {
                    assert_eq!(
                        (pixels.size, pixels.rgb.len() as u32),
                        (*size, size.x * size.y),
                        "{name}"
                    );
                }
                (Err(error), _) | (_, Err(error)) => check_refusal(error, folder.path()),
            }
            if let Err(error) = RgbImage::load_mask(&path, &Limits::DEFAULT) {
                check_refusal(&error, folder.path());
            }
        });
    }
}

#[test]
fn mutants_of_checkpoints_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    small_set(folder.path());
    let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    let options = TrainOptions { steps: 4, max_triangles: 20, ..TrainOptions::default() };
    let path = folder.path().join("scene.checkpoint");
    let outputs = TrainOutputs {
        checkpoint: Some(path.clone()),
        checkpoint_every: 2,
        ..TrainOutputs::default()
    };
    TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) }
        .run(&mut |_| Continue(()))
        .unwrap();
    mutate_file(&path, 500, || match checkpoint::read(&path) {
        Ok(point) => {
            if let Err(error) = TrainInputs::from_checkpoint(&dataset, point).start().map(drop) {
                assert!(error.to_string().len() < 1500, "{error}");
            }
        }
        Err(error) => check_refusal(&error, folder.path()),
    });
}
