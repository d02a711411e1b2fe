//! Numbers as text, in as few digits as read back equal.

/// Appends `value`.
pub(super) fn push_float(block: &mut Vec<u8>, value: f32) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(value);
    block.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

/// Appends `value`.
pub(super) fn push_integer(block: &mut Vec<u8>, mut value: u64) {
    let mut digits = [b'0'; 20];
    let mut at = digits.len();
    loop {
        at -= 1;
        digits[at] = b'0' + (value % 10) as u8;
        value /= 10;
        if value == 0 {
            break;
        }
    }
    block.extend_from_slice(&digits[at..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_and_floats_are_written_short_and_read_back_equal() {
        for value in [0, 7, 10, 4_294_967_295, u64::MAX] {
            let mut text = Vec::new();
            push_integer(&mut text, value);
            assert_eq!(String::from_utf8_lossy(&text), value.to_string());
        }
        for value in [0.0f32, -1.0, 0.1, 1e-45, f32::MAX, -1.234_567_9e-8, 16_777_216.0] {
            let mut text = Vec::new();
            push_float(&mut text, value);
            let text = String::from_utf8_lossy(&text).into_owned();
            assert_eq!(text.parse::<f32>().map(f32::to_bits), Ok(value.to_bits()), "{text}");
            assert!(text.len() <= 15, "{text}");
        }
    }
}
