//! An object as JSON, by its description. Texts and sequences of a faulty component may lead anywhere, so that every byte is
//! read by [`Peek`](crate::sys::peek::Peek): what is not there is told, and nothing traps.

use component_sdk::object::{Kind, TypeDescriptor};
use serde_json::{Map, Value, json};

use crate::model::limits::{ECHO_DEPTH, ECHO_PARTS, ECHO_TEXT_BYTES};
use crate::sys::peek::Peek;

/// Bytes of a sequence that say where its elements are: address and number.
const HEAD_BYTES: usize = 16;

/// It leads to memory that is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unreadable {
    /// Where that is.
    pub(super) address: usize,
}

/// The object at that address.
///
/// # Errors
/// Where it cannot be read.
pub(super) fn decode(object: &TypeDescriptor, address: usize) -> Result<Value, Unreadable> {
    Decoder { peek: Peek::default(), parts: ECHO_PARTS }.value(object, address, ECHO_DEPTH)
}

struct Decoder {
    peek: Peek,
    /// So many more parts are shown.
    parts: usize,
}

impl Decoder {
    fn value(&mut self, object: &TypeDescriptor, address: usize, depth: usize) -> Result<Value, Unreadable> {
        let Some(depth) = depth.checked_sub(1) else { return Ok("...".into()) };
        self.parts = self.parts.saturating_sub(1);
        match object.kind {
            Kind::Struct => {
                let field = |field: &component_sdk::object::FieldDescriptor| {
                    let value = self.value(field.object, address.wrapping_add(field.offset), depth)?;
                    Ok((field.name.to_string(), value))
                };
                object.fields.iter().map(field).collect::<Result<Map<_, _>, _>>().map(Value::Object)
            }
            Kind::Array => self.elements(object, address, object.count, depth),
            Kind::Sequence => {
                let (start, count) = self.head(address)?;
                self.elements(object, start, count, depth)
            }
            Kind::Text => self.text(address),
            number => self.number(number, address, object.size),
        }
    }

    fn bytes(&mut self, address: usize, len: usize) -> Result<&[u8], Unreadable> {
        self.peek.at(address, len).ok_or(Unreadable { address })
    }

    fn word(&mut self, address: usize) -> Result<usize, Unreadable> {
        let mut word = [0; 8];
        word.copy_from_slice(self.bytes(address, 8)?);
        Ok(usize::from_le_bytes(word))
    }

    /// Where the elements of a sequence or text are, and how many.
    fn head(&mut self, address: usize) -> Result<(usize, usize), Unreadable> {
        self.bytes(address, HEAD_BYTES)?;
        Ok((self.word(address)?, self.word(address.wrapping_add(8))?))
    }

    /// As many elements as are shown; a text at the end tells how many more there are.
    fn elements(
        &mut self,
        object: &TypeDescriptor,
        start: usize,
        count: usize,
        depth: usize,
    ) -> Result<Value, Unreadable> {
        let Some(element) = object.element() else { return Ok(Value::Null) };
        let mut shown = Vec::new();
        for index in 0..count {
            if self.parts == 0 {
                shown.push(json!(format!("... {} more", count - index)));
                break;
            }
            let place = start.wrapping_add(index.wrapping_mul(element.size));
            shown.push(self.value(element, place, depth)?);
        }
        Ok(Value::Array(shown))
    }

    fn text(&mut self, address: usize) -> Result<Value, Unreadable> {
        let (start, len) = self.head(address)?;
        if len == 0 {
            return Ok("".into());
        }
        let shown = len.min(ECHO_TEXT_BYTES);
        let mut text = String::from_utf8_lossy(self.bytes(start, shown)?).into_owned();
        if shown < len {
            text.push_str(&format!("... {} more", len - shown));
        }
        Ok(text.into())
    }

    fn number(&mut self, kind: Kind, address: usize, size: usize) -> Result<Value, Unreadable> {
        let mut word = [0; 8];
        let bytes = self.bytes(address, size.min(word.len()))?;
        word[..bytes.len()].copy_from_slice(bytes);
        let bits = u64::from_le_bytes(word);
        Ok(match kind {
            Kind::Bool => match bits as u8 {
                0 => false.into(),
                1 => true.into(),
                // No bool, whatever the component calls it.
                other => other.into(),
            },
            Kind::I8 => (bits as i8).into(),
            Kind::I16 => (bits as i16).into(),
            Kind::I32 => (bits as i32).into(),
            Kind::I64 => (bits as i64).into(),
            Kind::F32 => float(f32::from_bits(bits as u32)),
            Kind::F64 => float(f64::from_bits(bits)),
            _ => bits.into(),
        })
    }
}

/// A number as it is written shortest; what JSON has no number for is a text.
fn float<F: Into<f64> + ToString>(number: F) -> Value {
    let text = number.to_string();
    let number: f64 = number.into();
    if !number.is_finite() {
        return text.into();
    }
    text.parse::<f64>().unwrap_or(number).into()
}

#[cfg(test)]
mod tests {
    use component_sdk::objects::Pose2D;
    use component_sdk::prelude::*;

    use super::*;

    #[repr(C)]
    #[derive(CommObject, Debug, Default)]
    struct Scan {
        name: Text,
        ranges: Sequence<f32>,
        poses: Sequence<Pose2D>,
        flags: [bool; 2],
        count: i16,
        all: u64,
    }

    fn shown<T: CommObject>(object: &T) -> Result<Value, Unreadable> {
        decode(T::DESCRIPTOR, std::ptr::from_ref(object).addr())
    }

    #[test]
    fn an_object_is_shown_with_all_its_parts() {
        let scan = Scan {
            name: "front".into(),
            ranges: vec![0.1, f32::INFINITY].into(),
            poses: vec![Pose2D { x: 1.5, ..Pose2D::default() }].into(),
            flags: [true, false],
            count: -3,
            all: u64::MAX,
        };
        let json = shown(&scan).unwrap();
        assert_eq!((json["name"].as_str(), &json["ranges"]), (Some("front"), &json!([0.1, "inf"])));
        assert_eq!((&json["poses"][0]["x"], &json["flags"]), (&json!(1.5), &json!([true, false])));
        assert_eq!((&json["count"], &json["all"]), (&json!(-3), &json!(u64::MAX)));
        assert_eq!(shown(&Scan::default()).unwrap()["poses"], json!([]));
    }

    #[test]
    fn what_is_long_is_cut_and_tells_so() {
        let scan = Scan { name: "x".repeat(100_000).into(), ranges: vec![1.0; 1_000_000].into(), ..Scan::default() };
        let json = shown(&scan).unwrap();
        assert!(json["name"].as_str().unwrap().ends_with(" more"));
        let ranges = json["ranges"].as_array().unwrap();
        assert!(ranges.len() <= ECHO_PARTS && ranges.last().unwrap().as_str().unwrap().ends_with(" more"));
    }

    #[test]
    fn a_wild_pointer_is_told_and_nothing_traps() {
        #[repr(C)]
        struct Head {
            start: usize,
            len: usize,
            capacity: usize,
            free: usize,
        }
        let heads = [(8, 3), (usize::MAX, usize::MAX), (0xdead_0000_0000, 1)];
        for (start, len) in heads {
            let head = Head { start, len, capacity: 0, free: 0 };
            let address = std::ptr::from_ref(&head).addr();
            assert_eq!(decode(Text::DESCRIPTOR, address), Err(Unreadable { address: start }));
            assert!(decode(<Sequence<f64> as CommObject>::DESCRIPTOR, address).is_err());
        }
        assert_eq!(decode(u64::DESCRIPTOR, 64), Err(Unreadable { address: 64 }));
    }
}
