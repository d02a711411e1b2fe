//! Numbers of three digits, for axes.

/// A number for axes: three digits, then k, M or G. 20000 as "20k", 1234567 as "1.23M", 0.5 as "0.5".
pub fn short(value: f64) -> String {
    let (unit, letter) = match value.abs() {
        size if size >= 0.9995e9 => (1e9, "G"),
        size if size >= 0.9995e6 => (1e6, "M"),
        size if size >= 9995.0 => (1e3, "k"),
        _ => (1.0, ""),
    };
    let scaled = value / unit;
    let digits = (2 - scaled.abs().max(1e-4).log10().floor() as i32).clamp(0, 5) as usize;
    let text = format!("{scaled:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{}{letter}", if text == "-0" { "0" } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_axes_are_short() {
        let wants = [
            (0.0, "0"),
            (0.5, "0.5"),
            (0.00123, "0.00123"),
            (12.0, "12"),
            (28.25, "28.2"),
            (999.4, "999"),
            (5000.0, "5000"),
            (10_000.0, "10k"),
            (150_000.0, "150k"),
            (999_900.0, "1M"),
            (1_234_567.0, "1.23M"),
            (-20_000.0, "-20k"),
            (3e9, "3G"),
        ];
        for (value, text) in wants {
            assert_eq!(short(value), text);
        }
    }
}
