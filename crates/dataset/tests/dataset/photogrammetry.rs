//! The poses of the sample as LLFF, Metashape and RealityScan write them.

use super::transforms::six_photos;
use super::*;
use glam::{DMat3, DMat4, DVec4};
use std::fmt::Write as _;

/// Camera to world, our axes.
fn to_world(camera: &Camera) -> DMat4 {
    let rotation = camera.rotation.as_dmat3().transpose();
    DMat4::from_mat3(rotation).with_column(3, camera.position().as_dvec3().extend(1.0))
}

trait WithColumn {
    fn with_column(self, index: usize, column: DVec4) -> Self;
}

impl WithColumn for DMat4 {
    fn with_column(mut self, index: usize, column: DVec4) -> Self {
        *self.col_mut(index) = column;
        self
    }
}

fn assert_views(dataset: &Dataset, kind: DatasetKind, views: &[View]) {
    assert_eq!((dataset.kind, dataset.views.len()), (kind, views.len()));
    for (have, want) in dataset.views.iter().zip(views) {
        assert_eq!(have.name, want.name);
        assert_same_camera(&have.camera, &want.camera, &want.name);
    }
}

/// `poses_bounds.npy` of these views, photos `by` times as large.
fn llff(views: &[View], by: f32) -> Vec<u8> {
    let mut header =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}", views.len());
    while !(11 + header.len()).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes =
        [b"\x93NUMPY\x01\0".as_slice(), &(header.len() as u16).to_le_bytes(), header.as_bytes()]
            .concat();
    for view in views {
        let m = to_world(&view.camera);
        let size = view.camera.size.as_vec2() * by;
        let hwf = [size.y, size.x, view.camera.focal.x * by];
        for (row, last) in hwf.into_iter().enumerate() {
            let axes =
                [m.y_axis[row], m.x_axis[row], -m.z_axis[row], m.w_axis[row], f64::from(last)];
            bytes.extend(axes.iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend([0.5f64, 9.0].iter().flat_map(|x| x.to_le_bytes()));
    }
    bytes
}

/// As formats without their own say: square pixels, principal point in the middle.
fn plain(mut views: Vec<View>) -> Vec<View> {
    for view in &mut views {
        view.camera.center = view.camera.size.as_vec2() / 2.0;
        view.camera.focal.y = view.camera.focal.x;
    }
    views
}

#[test]
fn llff_with_shrunk_photos_and_masks() {
    let (folder, views) = six_photos("images");
    let views = plain(views);
    let file = folder.path().join("poses_bounds.npy");
    std::fs::write(&file, llff(&views, 1.0)).unwrap();
    for path in [folder.path(), &file] {
        assert_views(&load(path), DatasetKind::Llff, &views);
    }
    std::fs::rename(folder.path().join("images"), folder.path().join("images_4")).unwrap();
    std::fs::write(&file, llff(&views, 4.0)).unwrap();
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    let mask = RgbImage { size: UVec2::new(160, 120), rgb: vec![[255; 3]; 160 * 120], alpha: None };
    mask.save_png(folder.path().join("masks/view_0001.png")).unwrap();
    let small = load(folder.path());
    assert_views(&small, DatasetKind::Llff, &views);
    assert!(
        small.views[1].photo.mask.is_some() && small.warnings.iter().any(|w| w.contains("scaled"))
    );
    let bytes = llff(&views, 4.0);
    for (bad, part) in [
        (bytes[..bytes.len() - 8].to_vec(), "101 numbers follow"),
        (llff(&views[..5], 4.0), "5 poses"),
        (b"PK\x03\x04 not an array".to_vec(), "NumPy"),
        (b"\x93NUMPY\x02\0\xff\xff\xff\xff{}".to_vec(), "a header of 4294967295 bytes"),
        ([&bytes[..21], b"<i8", &bytes[24..]].concat(), "descr:<i8"),
    ] {
        std::fs::write(&file, bad).unwrap();
        let error = error_of(folder.path());
        assert!(
            error.contains("poses_bounds.npy") && error.contains(part),
            "`{part}` is missing from: {error}"
        );
    }
}

/// A file that no memory holds, with as many poses as it says.
#[test]
fn poses_without_photos_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses_bounds.npy");
    let count = (200u64 << 30) / (17 * 8);
    let mut header =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({count}, 17), }}");
    header += &" ".repeat(117 - header.len());
    header.push('\n');
    let head =
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    std::fs::write(&path, &head).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(head.len() as u64 + 8 * 17 * count).unwrap();
    let error = error_of(folder.path());
    assert!(
        error.contains(&format!("has {count} poses, and there are photos: 0 in images")),
        "{error}"
    );
}

#[test]
fn elements_in_elements_are_refused_before_the_stack_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.xml");
    for element in ["group", "unknown"] {
        let open = format!("<{element}>\n");
        let close = format!("</{element}>");
        let text = |depth: usize| {
            let inside = open.repeat(depth) + &close.repeat(depth);
            format!("<document><chunk><cameras>{inside}</cameras></chunk></document>")
        };
        std::fs::write(&path, text(20_000)).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains("elements are nested more than 128 deep at byte"), "{error}");
        std::fs::write(&path, text(100)).unwrap();
        assert!(error_of(folder.path()).contains("none has a pose"));
    }
}

/// `cameras.xml` of these views in a chunk that is turned, moved and scaled.
fn metashape(views: &[View], kind: &str, calibration: &str) -> String {
    let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(1.1);
    let place = DMat4::from_translation(DVec3::new(3.0, -2.0, 0.5)) * DMat4::from_mat3(turn * 2.5);
    let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\"><chunk label=\"a\" enabled=\"true\">\
         <sensors next_id=\"1\"><sensor id=\"0\" label=\"phone\" type=\"{kind}\"><resolution width=\"160\" height=\"120\"/>\
         <property name=\"layer_index\" value=\"0\"/><calibration type=\"{kind}\" class=\"initial\"><f>9</f></calibration>\
         <calibration type=\"{kind}\" class=\"adjusted\"><resolution width=\"160\" height=\"120\"/>{calibration}</calibration>\
         </sensor></sensors><components/><cameras next_id=\"9\" next_group_id=\"1\">"
    );
    let mut cameras: Vec<String> = Vec::new();
    for view in views {
        // The axes of a chunk keep their length when it is scaled.
        let mut pose = place.inverse() * to_world(&view.camera);
        for axis in [&mut pose.x_axis, &mut pose.y_axis, &mut pose.z_axis] {
            *axis *= 2.5;
        }
        let label = view.name.trim_end_matches(".png");
        let rows = words(&pose.transpose().to_cols_array());
        cameras.push(format!(
            "<camera id=\"{label}\" sensor_id=\"0\" label=\"{label}\"><transform>{rows}</transform></camera>"
        ));
    }
    write!(xml, "{}<group id=\"0\" label=\"g\">{}</group>", cameras[0], cameras[1..3].concat())
        .unwrap();
    write!(
        xml,
        "{}<camera id=\"8\" sensor_id=\"0\" label=\"lost\"/></cameras>",
        cameras[3..].concat()
    )
    .unwrap();
    let rotation = words(&turn.transpose().to_cols_array());
    let moved = words(&[3.0, -2.0, 0.5]);
    writeln!(
        xml,
        "<transform><rotation locked=\"false\">{rotation}</rotation><translation locked=\"false\">{moved}</translation>\
         <scale locked=\"false\">2.5</scale></transform></chunk></document>"
    )
    .unwrap();
    xml
}

#[test]
fn metashape_with_groups_a_placed_chunk_and_every_coefficient() {
    let (folder, views) = six_photos("images");
    let file = folder.path().join("cameras.xml");
    std::fs::write(
        &file,
        metashape(&views, "frame", "<f>167.2</f><cx>1.92</cx><cy>-1.08</cy><b1>0.8</b1>"),
    )
    .unwrap();
    for path in [folder.path(), &file] {
        let dataset = load(path);
        assert_views(&dataset, DatasetKind::Metashape, &views);
        assert!(
            dataset.warnings[0].contains("1 of 7 photos left out: they are not aligned"),
            "{:?}",
            dataset.warnings
        );
    }
    let bent = "<f>167.2</f><k1>-0.1</k1><k3>0.01</k3><p1>0.001</p1><p2>0.002</p2><b1>0.8</b1><b2>0.5</b2>";
    std::fs::write(&file, metashape(&views, "frame", bent)).unwrap();
    assert!(
        load(folder.path()).views.iter().all(|v| v.camera.size != UVec2::new(160, 120)),
        "undistorted"
    );
    std::fs::write(&file, metashape(&views, "fisheye", "<f>60</f>")).unwrap();
    assert_eq!(load(folder.path()).views.len(), 30);
    for (kind, calibration, part) in [
        ("cylindrical", "<f>60</f>", "type cylindrical"),
        ("frame", "<f>sixty</f>", "Agisoft XML"),
        ("frame", "", "no focal length"),
        ("spherical", "", "twice as wide as high"),
    ] {
        std::fs::write(&file, metashape(&views, kind, calibration)).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
}

#[test]
fn a_tangential_coefficient_of_metashape_is_the_other_of_opencv() {
    let (folder, views) = six_photos("images");
    let line = |model: &str| format!("1 {model}\n");
    std::fs::create_dir_all(folder.path().join("sparse/0")).unwrap();
    let sparse = folder.path().join("sparse/0");
    std::fs::write(
        sparse.join("cameras.txt"),
        line("OPENCV 160 120 167.2 167.2 80 60 -0.1 0.02 0.002 0.001"),
    )
    .unwrap();
    let mut rows = String::new();
    for (id, view) in views.iter().enumerate() {
        let q = glam::DQuat::from_mat3(&view.camera.rotation.as_dmat3());
        let t = view.camera.translation;
        writeln!(
            rows,
            "{} {} {} {} {} {} {} {} 1 {}\n",
            id + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            view.name
        )
        .unwrap();
    }
    std::fs::write(sparse.join("images.txt"), rows).unwrap();
    let colmap = load(folder.path());
    let bent = "<f>167.2</f><k1>-0.1</k1><k2>0.02</k2><p1>0.001</p1><p2>0.002</p2>";
    std::fs::write(folder.path().join("cameras.xml"), metashape(&views, "frame", bent)).unwrap();
    let metashape = load(&folder.path().join("cameras.xml"));
    assert_same_views(&colmap, &metashape);
    assert_eq!(colmap.views[2].photo.decode().unwrap(), metashape.views[2].photo.decode().unwrap());
}

/// A table of these views with these columns.
fn realityscan(views: &[View], head: &str) -> String {
    let mut table = format!("{head}\n");
    for view in views {
        // Right, up, backwards: Rz(-heading) Rx(pitch) Ry(roll).
        let m = to_world(&view.camera);
        let right = m.x_axis;
        let up = -m.y_axis;
        let back = -m.z_axis;
        let heading = up.x.atan2(up.y);
        let pitch = up.z.asin();
        let roll = (-right.z).atan2(back.z);
        let [heading, pitch, roll] = [heading, pitch, roll].map(f64::to_degrees);
        let at = view.camera.position();
        let camera = &view.camera;
        let [f, px, py] = [
            camera.focal.x * 36.0 / 160.0,
            (camera.center.x - 80.0) / 160.0,
            (camera.center.y - 60.0) / 160.0,
        ];
        let row = format!(
            "{},{},{},{},{heading},{pitch},{roll},{f},{px},{py},0,0,0,0,0,0",
            view.name, at.x, at.y, at.z
        );
        writeln!(table, "{row}").unwrap();
    }
    table
}

#[test]
fn realityscan_with_the_columns_of_today_and_before() {
    let (folder, mut views) = six_photos("images");
    views.iter_mut().for_each(|view| view.camera.focal.y = view.camera.focal.x);
    let file = folder.path().join("registration.csv");
    for head in [
        "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2",
        "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2",
    ] {
        std::fs::write(&file, realityscan(&views, head)).unwrap();
        for path in [folder.path(), &file] {
            assert_views(&load(path), DatasetKind::RealityScan, &views);
        }
    }
    let head = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2";
    let whole = realityscan(&views, head);
    let on_earth = |(i, view): (usize, &View)| {
        format!("{},-34.82{i},7.16{i},{},0,0,0,26,0,0,0,0,0,0,0,0\n", view.name, 80 + i)
    };
    let on_earth =
        format!("{head}\n{}", views.iter().enumerate().map(on_earth).collect::<String>());
    for (text, part) in [
        (whole.replacen("pitch", "tilt", 1), "Internal/External"),
        (whole.replacen("view_0001.png,", "view_0001.png,x", 1), "line 3: x of `view_0001.png`"),
        (whole.lines().next().unwrap().to_owned(), "no photo follows"),
        (on_earth, "longitude"),
    ] {
        std::fs::write(&file, text).unwrap();
        let error = error_of(&file);
        assert!(
            error.contains("registration.csv") && error.contains(part),
            "`{part}` is missing from: {error}"
        );
    }
}

/// RealityScan's other export, with lines that end as on Windows: a camera for each photo, photos
/// without observations, points never refined.
#[test]
fn colmap_text_of_realityscan() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let at = |name: &str| folder.path().join("sparse/0").join(name);
    let rows = |name: &str| {
        let text = std::fs::read_to_string(at(name)).unwrap();
        text.lines()
            .filter(|line| !line.starts_with('#'))
            .map(str::to_owned)
            .collect::<Vec<String>>()
    };
    let lens = rows("cameras.txt")[0].split_once(' ').unwrap().1.to_owned();
    let poses: Vec<String> = rows("images.txt").into_iter().step_by(2).collect();
    let write = |name: &str, rows: &[String]| {
        std::fs::write(at(name), format!("# exported\r\n{}\r\n", rows.join("\r\n"))).unwrap();
    };
    let cameras: Vec<String> = (1..=poses.len()).map(|id| format!("{id} {lens}")).collect();
    let own = |(i, pose): (usize, &String)| {
        let mut words: Vec<String> = pose.split(' ').map(str::to_owned).collect();
        words[8] = (i + 1).to_string();
        format!("{}\r\n", words.join(" "))
    };
    let points: Vec<String> = rows("points3D.txt")
        .iter()
        .map(|row| {
            let words: Vec<&str> = row.split(' ').take(7).collect();
            format!("{} -1", words.join(" "))
        })
        .collect();
    let wanted = load(folder.path());
    write("cameras.txt", &cameras);
    write("images.txt", &poses.iter().enumerate().map(own).collect::<Vec<_>>());
    write("points3D.txt", &points);
    let dataset = load(folder.path());
    assert_views(&dataset, DatasetKind::ColmapText, &wanted.views);
    assert_eq!((dataset.points.len(), dataset.points[0].error), (wanted.points.len(), None));
    assert_eq!(dataset.reprojection(&Limits::DEFAULT).unwrap(), None);
}
