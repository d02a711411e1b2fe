//! The curve of a run as a picture: PSNR and triangles over CPU seconds.

use plotters::prelude::*;
use std::path::Path;
use trisplat_dataset::ShrunkSize;
use trisplat_scene::{Error, Result, report::short};
use trisplat_train::TrainSample;

/// The curve as SVG; `path` is for messages.
pub(super) fn svg(path: &Path, samples: &[TrainSample]) -> Result<String> {
    let mut svg = String::new();
    draw(&mut svg, samples).map_err(|e| Error::io(path, std::io::Error::other(e.to_string())))?;
    Ok(svg)
}

fn draw(svg: &mut String, samples: &[TrainSample]) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let points = |value: &dyn Fn(&TrainSample) -> Option<f64>| -> Vec<(f64, f64)> {
        samples.iter().filter_map(|s| value(s).filter(|v| v.is_finite()).map(|v| (s.cpu_secs, v))).collect()
    };
    let train = points(&|s| Some(s.psnr));
    let test = points(&|s| s.test_psnr);
    let triangles = points(&|s| Some(s.triangles as f64));
    let end = samples.iter().map(|s| s.cpu_secs).fold(1e-3, f64::max);
    let (low, high) = value_range(train.iter().chain(&test));
    let (_, most) = value_range(triangles.iter());

    let area = SVGBackend::with_string(svg, (900, 480)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(48)
        .right_y_label_area_size(56)
        .build_cartesian_2d(0.0..end, low..high)?
        .set_secondary_coord(0.0..end, 0.0..most * 1.05);
    chart
        .configure_mesh()
        .x_desc("CPU seconds")
        .y_desc("PSNR, dB")
        .light_line_style(WHITE.mix(0.0))
        .draw()?;
    chart.configure_secondary_axes().y_desc("triangles").y_label_formatter(&|v| short(*v)).draw()?;
    chart
        .draw_secondary_series(LineSeries::new(triangles, RGBColor(170, 170, 170)))?
        .label("triangles")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], RGBColor(170, 170, 170)));
    chart
        .draw_series(LineSeries::new(train, RGBColor(90, 140, 220)))?
        .label("training photos")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], RGBColor(90, 140, 220)));
    chart
        .draw_series(LineSeries::new(test.clone(), RGBColor(200, 70, 40).stroke_width(2)))?
        .label(format!("held out{}", ShrunkSize::beside(samples.iter().find_map(|s| s.test_size))))
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], RGBColor(200, 70, 40)));
    chart.draw_series(test.iter().map(|p| Circle::new(*p, 3, RGBColor(200, 70, 40).filled())))?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE)
        .draw()?;
    area.present()?;
    Ok(())
}

fn value_range<'a>(points: impl Iterator<Item = &'a (f64, f64)>) -> (f64, f64) {
    let (low, high) =
        points.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.1), high.max(p.1)));
    if low < high { (low.floor(), high.ceil()) } else { (0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_of_any_length_is_a_picture() {
        let sample = |i: u64| TrainSample {
            step: i,
            triangles: 100 * i,
            psnr: 10.0 + i as f64,
            cpu_secs: i as f64,
            test_psnr: i.is_multiple_of(2).then_some(9.0),
            ..TrainSample::default()
        };
        for n in [0, 1, 5] {
            let samples: Vec<TrainSample> = (0..n).map(sample).collect();
            let mut svg = String::new();
            draw(&mut svg, &samples).unwrap();
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"), "{n}");
        }
    }
}
