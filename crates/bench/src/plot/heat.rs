//! Heat maps: a value for every pair of names, by its power of ten.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A value for pairs of names.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct HeatMap {
    /// What is shown.
    pub title: String,
    /// The rows, and the columns.
    pub names: Vec<String>,
    /// Row, column, value.
    pub cells: Vec<(usize, usize, f64)>,
}

/// Values up to this are white, ...
const WHITE_TO: f64 = 1e-7;
/// ... and from this they are darkest.
const DARK_FROM: f64 = 1.0;
/// Colours between, in equal steps of the logarithm.
const COLORS: [[f64; 3]; 5] = [
    [255.0, 255.0, 255.0],
    [254.0, 224.0, 144.0],
    [244.0, 125.0, 66.0],
    [190.0, 30.0, 45.0],
    [70.0, 0.0, 40.0],
];
/// From this part of the way on, text is white.
const WHITE_TEXT_FROM: f64 = 0.55;

/// Left and upper margin, px, with room for names.
const MARGIN: [i32; 2] = [92, 118];
/// Letters of names and of values, px.
const LETTERS: [i32; 2] = [13, 10];

/// How far a value lies on the way from white to dark, 0 to 1, by its logarithm.
fn darkness(value: f64) -> f64 {
    let share = (value / WHITE_TO).log10() / (DARK_FROM / WHITE_TO).log10();
    if value.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) }
}

fn color(darkness: f64) -> RGBColor {
    let place = darkness * (COLORS.len() - 1) as f64;
    let below = (place as usize).min(COLORS.len() - 2);
    let share = place - below as f64;
    let mix = |k: usize| (COLORS[below][k] + share * (COLORS[below + 1][k] - COLORS[below][k])).round() as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

/// Draws a heat map; nothing when there are no names.
pub(super) fn chart(area: &DrawingArea<SVGBackend<'_>, Shift>, map: &HeatMap) -> Result<(), String> {
    draw(area, map).map_err(|e| e.to_string())
}

type Drawn = Result<(), Box<dyn std::error::Error>>;

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, map: &HeatMap) -> Drawn {
    let (width, height) = area.dim_in_pixel();
    let count = map.names.len() as i32;
    if count == 0 {
        return Ok(());
    }
    let side = ((width as i32 - MARGIN[0] - 8) / count).min((height as i32 - MARGIN[1] - 8) / count);
    let corner = |column: i32, row: i32| (MARGIN[0] + column * side, MARGIN[1] + row * side);
    let text = |size: i32| ("sans-serif", size).into_font();
    let centered = Pos::new(HPos::Center, VPos::Center);
    let title = TextStyle::from(text(16)).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(map.title.clone(), (12, 16), title))?;
    for (i, name) in (0..).zip(&map.names) {
        let (x, y) = corner(i, i);
        let row = TextStyle::from(text(LETTERS[0])).pos(Pos::new(HPos::Right, VPos::Center));
        area.draw(&Text::new(name.clone(), (MARGIN[0] - 6, y + side / 2), row))?;
        let column = text(LETTERS[0]).transform(FontTransform::Rotate270);
        let column = TextStyle::from(column).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(name.clone(), (x + side / 2, MARGIN[1] - 6), column))?;
    }
    for &(row, column, value) in &map.cells {
        let (from, dark) = (corner(column as i32, row as i32), darkness(value));
        let (to, middle) = ((from.0 + side - 1, from.1 + side - 1), (from.0 + side / 2, from.1 + side / 2));
        area.draw(&Rectangle::new([from, to], color(dark).filled()))?;
        area.draw(&Rectangle::new([from, to], BLACK.mix(0.15)))?;
        let ink = if dark >= WHITE_TEXT_FROM { WHITE } else { BLACK };
        let style = text(LETTERS[1]).color(&ink).pos(centered);
        area.draw(&Text::new(power(value), middle, style))?;
    }
    Ok(())
}

/// A value as a cell shows it: "2e-5", "0".
fn power(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.0e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_values_are_darker() {
        let light = |value: f64| {
            let RGBColor(r, g, b) = color(darkness(value));
            u32::from(r) + u32::from(g) + u32::from(b)
        };
        let values = [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];
        assert!(values.windows(2).all(|w| light(w[0]) > light(w[1])), "{:?}", values.map(light));
        assert_eq!((light(0.0), light(1e-9)), (765, 765));
        assert_eq!((light(f64::INFINITY), light(f64::NAN)), (light(1.0), light(1.0)));
    }

    #[test]
    fn cells_are_written_in_short() {
        assert_eq!([0.0, 2.3e-5, 1.0, 31.0].map(power), ["0", "2e-5", "1e0", "3e1"]);
    }
}
