//! JSON in which numbers far from 0 have all their digits. The shortest text of an f32 is up to half of its last place off, and readers
//! of scenes far from the origin, ours too, take it in double precision.

use crate::far::is_far;
use glam::DVec3;
use serde::Serialize;
use serde_json::Result;
use serde_json::ser::{CompactFormatter, Formatter, PrettyFormatter, Serializer};
use std::io::{self, Write};

/// The text of `value`, on one line or indented.
pub(crate) fn text(value: &impl Serialize, is_pretty: bool) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    match is_pretty {
        true => {
            value.serialize(&mut Serializer::with_formatter(&mut bytes, Exact(PrettyFormatter::new())))?
        }
        false => value.serialize(&mut Serializer::with_formatter(&mut bytes, Exact(CompactFormatter)))?,
    }
    Ok(bytes)
}

/// Another format but for far numbers.
struct Exact<F>(F);

/// Methods of a [`Formatter`] that are those of the other one.
macro_rules! same {
    ($($name:ident($($argument:ident: $kind:ty),*)),* $(,)?) => {
        $(fn $name<W: ?Sized + Write>(&mut self, writer: &mut W $(, $argument: $kind)*) -> io::Result<()> {
            self.0.$name(writer $(, $argument)*)
        })*
    };
}

impl<F: Formatter> Formatter for Exact<F> {
    fn write_f32<W: ?Sized + Write>(&mut self, writer: &mut W, value: f32) -> io::Result<()> {
        let exact = f64::from(value);
        if is_far(DVec3::splat(exact)) {
            self.0.write_f64(writer, exact)
        } else {
            self.0.write_f32(writer, value)
        }
    }

    same! {
        begin_array(), end_array(), begin_array_value(first: bool), end_array_value(),
        begin_object(), end_object(), begin_object_key(first: bool), end_object_key(),
        begin_object_value(), end_object_value(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_numbers_have_all_their_digits_and_nothing_else_changes() {
        let value = serde_json::json!({ "a": [1.5, { "b": [] }], "c": {}, "d": "e" });
        assert_eq!(text(&value, true).unwrap(), serde_json::to_vec_pretty(&value).unwrap());
        assert_eq!(text(&value, false).unwrap(), serde_json::to_vec(&value).unwrap());
        let numbers = [0.1f32, 1_814_142.9, -123_456_792.0, 4095.9];
        assert_eq!(text(&numbers, false).unwrap(), b"[0.1,1814142.875,-123456792.0,4095.9]");
    }
}
